"""Columns beside the inertial ones: which, as a value for files, and those of friction.

Friction: smoothed Coulomb, load-dependent, presliding (Dahl) and gear ripple.
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from dynid.core import Array, InputError, JsonFields, compiled

Width = float | tuple[float, ...]
"""One speed for all joints, or one a joint [rad/s or m/s]; as a width, 0 gives the sign."""


def smooth_sign(dq: Array, width: Width) -> Array:
    """tanh(dq / width) for dq (n, N) or (N), the sign where the width is 0."""
    if isinstance(width, tuple):
        return np.array([smooth_sign(*each) for each in zip(dq, width, strict=True)])
    return np.tanh(dq / width) if width > 0 else np.sign(dq)


def smooth_slope(dq: Array, width: Width) -> Array:
    """Derivative of `smooth_sign` by dq (n, N) or (N): zero where the width is 0."""
    if isinstance(width, tuple):
        return np.array([smooth_slope(*each) for each in zip(dq, width, strict=True)])
    return (1.0 - np.square(np.tanh(dq / width))) / width if width > 0 else np.zeros_like(dq)


def stribeck(dq: Array, velocity: Width) -> Array:
    """exp(-(dq / velocity)^2) for dq (n, N) or (N): the share of breakaway torque that is left."""
    return np.exp(-np.square(dq / by_joint(velocity)))


def by_joint(speeds: Width) -> Array:
    """Speeds that divide dq (n, N): (n, 1), or one for all joints."""
    return np.array(speeds)[:, None] if isinstance(speeds, tuple) else np.array(speeds)


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadFriction:
    """Which joints have it, and what their load is.

    The load is the torque of known inertial parameters. They come from an earlier fit and are
    part of the column's shape, as a Stribeck velocity is: so the column stays linear in its own
    parameter (Bittencourt and Axelsson 2014; the load of the previous iterate).

    Raises:
        InputError: No, repeated or negative joints, or parameters that are not finite.
    """

    joints: tuple[int, ...]
    """From 0."""
    parameters: tuple[float, ...]
    """(10 n) inertial parameters whose torque is the load, in the model's frames."""

    def __post_init__(self) -> None:
        if not self.joints or len(set(self.joints)) < len(self.joints) or min(self.joints) < 0:
            raise InputError("load friction needs joints, each once", value=self.joints)
        if not all(math.isfinite(value) for value in self.parameters):
            raise InputError("the parameters of the load must be finite")

    def describe(self) -> str:
        """In the form of `--terms`."""
        return f"fl:{'+'.join(str(j + 1) for j in self.joints)}"

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {"joints": [j + 1 for j in self.joints], "parameters": list(self.parameters)}


def friction_state(q: Array, displacement: Array, *, periodic: bool = False) -> Array:
    """The state of friction along a motion.

    A joint that turns back between two samples does so where its velocity, linear between them, is
    zero; without that, friction would turn half a sample late.

    Args:
        q: (n, N) positions in the order of time [rad or m].
        displacement: (n) delta, over which friction builds up [rad or m], above 0.
        periodic: The motion is one period of many: it begins as it ends. Else it begins at 0,
            and is forgotten after a few displacements.

    Returns:
        (n, N) from -1 to 1.
    """
    samples = q.shape[1]
    whole = np.array(np.concatenate([q, q], axis=1) if periodic else q, order="C")
    state = np.zeros(whole.shape)
    _follow(whole, np.array(displacement), state)
    return state[:, -samples:]


@compiled()
def _follow(q: Array, displacement: Array, state: Array) -> None:
    last = q.shape[1] - 1
    for j in range(q.shape[0]):
        z, before = 0.0, 0.0
        for i in range(1, last + 1):
            step = q[j, i] - q[j, i - 1]
            # Velocities times the time between samples; a motion turns where they are zero.
            after = (q[j, i + 1] - q[j, i - 1]) / 2 if i < last else step
            if before * after < 0.0:
                share = before / (before - after)
                z = _moved(z, share * before / 2 / displacement[j])
                step = (1.0 - share) * after / 2
            z = _moved(z, step / displacement[j])
            state[j, i] = z
            before = after


@compiled()
def _moved(z: float, step: float) -> float:
    """The state after a motion in one direction, in displacements."""
    if step > 0.0:
        return 1.0 - (1.0 - z) * math.exp(-step)
    return (1.0 + z) * math.exp(step) - 1.0


MOST_POWERS = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Gear:
    """What one gear's ripple looks like: waves a turn and how they change with speed.

    Raises:
        InputError: A negative joint, no waves, numbers that are not positive and finite.
    """

    joint: int
    """The joint whose position it follows, from 0."""
    waves: tuple[float, ...]
    """Periods a turn of the joint."""
    speed: float
    """Highest speed that was seen [rad/s]: beyond it the ripple stays as it is."""
    powers: int
    """Powers of the speed, from 0, that the size of each wave is made of."""

    def __post_init__(self) -> None:
        numbers = (*self.waves, self.speed)
        good = all(math.isfinite(x) and x > 0 for x in numbers)
        if self.joint < 0 or not self.waves or not good or not 1 <= self.powers <= MOST_POWERS:
            raise InputError("a gear's ripple cannot be read", value=self)

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return 2 * len(self.waves) * self.powers

    def columns(self, q: Array, dq: Array) -> Array:
        """(size, N) what the coefficients multiply.

        For each wave and each power of the speed from 0: the cosine, the sine, at positions (N)
        [rad] and velocities (N) [rad/s] of the gear's joint.
        """
        share = np.clip(dq / self.speed, -1.0, 1.0)
        scales = [share**power for power in range(self.powers)]
        return np.array(
            [
                scale * wave
                for number in self.waves
                for scale in scales
                for wave in (np.cos(number * q), np.sin(number * q))
            ]
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class TorqueRipple:
    """The ripple in one joint's torque: of its own gear, and of others that shake the arm.

    The coefficients come from an earlier fit and are part of the column's shape.

    Raises:
        InputError: A negative joint, no gears, coefficients that do not fit or are not finite.
    """

    joint: int
    """From 0."""
    gears: tuple[Gear, ...]
    coefficients: tuple[float, ...]
    """Those of each gear, one after the other [N.m]."""

    def __post_init__(self) -> None:
        wanted = sum(gear.size for gear in self.gears)
        finite = all(math.isfinite(x) for x in self.coefficients)
        if self.joint < 0 or not self.gears or len(self.coefficients) != wanted or not finite:
            raise InputError(
                "torque ripple cannot be read",
                value=f"joint {self.joint + 1}, {len(self.coefficients)} coefficients",
                limit=f"{wanted} finite ones",
            )

    def torque(self, q: Array, dq: Array) -> Array:
        """(N) the ripple [N.m] at positions and velocities (n, N) of all joints."""
        columns = [gear.columns(q[gear.joint], dq[gear.joint]) for gear in self.gears]
        total = np.array(self.coefficients) @ np.concatenate(columns)
        return np.asarray(total, dtype=np.float64)

    def describe(self) -> str:
        """In words."""
        gears = ", ".join(
            f"{' '.join(f'{wave:.4g}' for wave in gear.waves)} waves a turn of joint "
            f"{gear.joint + 1}"
            for gear in self.gears
        )
        return f"torque ripple of joint {self.joint + 1}: {gears}"

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        gears = [
            {**asdict(gear), "joint": gear.joint + 1, "waves": list(gear.waves)}
            for gear in self.gears
        ]
        return {"joint": self.joint + 1, "gears": gears, "coefficients": list(self.coefficients)}


def ripples_from_json(fields: JsonFields) -> tuple[TorqueRipple, ...]:
    """The inverse of `TorqueRipple.to_json` for each of the list `ripples`, if there is one."""
    return tuple(
        one.made(
            TorqueRipple,
            joint=one.whole("joint") - 1,
            gears=tuple(
                gear.made(Gear, joint=gear.whole("joint") - 1) for gear in one.objects("gears")
            ),
        )
        for one in (fields.objects("ripples") if "ripples" in fields.values else ())
    )


PAPER_WIDTH = 0.001
"""Width of the paper's Coulomb column tanh(dq / 0.001) [rad/s]."""
STRIBECK_VELOCITY = 0.1
"""[rad/s or m/s]"""
TERMS = ("fc", "fv", "im", "fo", "fca", "fva", "fs", "fr")
"""Coulomb, viscous, motor inertia, offset, asymmetries, Stribeck, cube root: column order."""
PAPER_TERMS = ("fc", "fv", "im")


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionTerms:
    """Terms, the joints that have them, and their shapes.

    Raises:
        InputError: An unknown or repeated term, no, repeated or negative joints, a shape out
            of range.
    """

    terms: tuple[tuple[str, tuple[int, ...] | None], ...] = tuple((t, None) for t in PAPER_TERMS)
    """(term, joints from 0, or None for all)."""
    width: float | tuple[float, ...] = PAPER_WIDTH
    """Width of the Coulomb step, for all or a joint [rad/s or m/s]; 0 gives the sign."""
    stribeck_velocity: Width = STRIBECK_VELOCITY
    """For the term `fs`, for all or a joint [rad/s or m/s]."""
    presliding: tuple[float, ...] = ()
    """Displacement over which each joint's friction builds up [rad or m]; 0 for joints without,
    none at all for an arm without. Coulomb, Stribeck and load friction are then `friction_state`
    in place of the step. Found by an identification."""
    load: LoadFriction | None = None
    """Friction that grows with the load: found by an identification, not a word of `--terms`."""
    ripples: tuple[TorqueRipple, ...] = ()
    """Torque ripple of gears, by joint: found by an identification too."""

    def __post_init__(self) -> None:
        words = [term for term, _ in self.terms]
        if not words or set(words) - set(TERMS) or len(set(words)) < len(words):
            raise InputError(
                "unknown, repeated or no terms",
                where="--terms",
                value=",".join(words),
                limit=",".join(TERMS),
            )
        widths, speeds = (
            given if isinstance(given, tuple) else (given,)
            for given in (self.width, self.stribeck_velocity)
        )
        if not all(math.isfinite(w) and w >= 0 for w in widths):
            raise InputError("Coulomb widths must not be negative", value=self.width)
        if not all(math.isfinite(v) and v > 0 for v in speeds):
            raise InputError("the Stribeck velocity must be positive", value=self.stribeck_velocity)
        if not all(math.isfinite(d) and d >= 0 for d in self.presliding):
            raise InputError("displacements must not be negative", value=self.presliding)
        if any(j < 0 for _, joints in self.terms for j in joints or ()):
            raise InputError("joints of a term count from 0", value=self.terms)
        if any(js is not None and (not js or len(set(js)) < len(js)) for _, js in self.terms):
            raise InputError("a term needs joints, each once", value=self.terms)
        joints = [ripple.joint for ripple in self.ripples]
        if joints != sorted(set(joints)):
            raise InputError("torque ripple by joint, each once", value=joints)

    def without(self, names: Collection[str], joints: int) -> "FrictionTerms":
        """These terms of so many joints without named parameters, such as `Fv3`.

        Displacements stay: a coupled motor has that of its joint, which may turn freely.
        """
        kept: list[tuple[str, tuple[int, ...] | None]] = []
        for term, given in self.terms:
            have = tuple(range(joints)) if given is None else given
            left = tuple(j for j in have if f"{term.capitalize()}{j + 1}" not in names)
            if left:
                kept.append((term, given if left == have else left))
        load = self.load
        if load is not None:
            loaded = tuple(j for j in load.joints if f"Fl{j + 1}" not in names)
            load = replace(load, joints=loaded) if loaded else None
        return replace(self, terms=tuple(kept), load=load)

    def check_joints(self, joints: int) -> None:
        """Check against the number of joints of a robot.

        Raises:
            InputError: A joint, a list of widths or a load that the robot does not have.
        """
        named = [r.joint for r in self.ripples] + [j for _, js in self.terms for j in js or ()]
        highest = max([*named, *(gear.joint for r in self.ripples for gear in r.gears)], default=0)
        if highest >= joints:
            raise InputError(
                "a term names a joint that the robot does not have",
                where="--terms",
                value=highest + 1,
                limit=joints,
            )
        if self.load is not None:
            found = max(self.load.joints) + 1, len(self.load.parameters)
            if found[0] > joints or found[1] != 10 * joints:
                limit = (joints, 10 * joints)
                raise InputError("load friction of another robot", value=found, limit=limit)
        shapes = {"Coulomb width": self.width, "Stribeck velocity": self.stribeck_velocity}
        for what, given in shapes.items():
            if isinstance(given, tuple) and len(given) != joints:
                raise InputError(f"one {what} a joint", value=len(given), limit=joints)
        if len(self.presliding) not in (0, joints):
            raise InputError("one displacement a joint", value=len(self.presliding), limit=joints)

    def describe(self) -> str:
        """The terms as `--terms` takes them, e.g. `fc,fv,im,fo:1+3`."""
        return ",".join(
            term if joints is None else f"{term}:{'+'.join(str(j + 1) for j in joints)}"
            for term, joints in self.terms
        )

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {
            "terms": self.describe(),
            "width": self.width,
            "stribeck_velocity": self.stribeck_velocity,
            **({"presliding": list(self.presliding)} if self.presliding else {}),
            **({} if self.load is None else {"load": self.load.to_json()}),
            **({"ripples": [r.to_json() for r in self.ripples]} if self.ripples else {}),
        }


def parse_terms(
    text: str,
    *,
    width: float | tuple[float, ...] = PAPER_WIDTH,
    stribeck_velocity: Width = STRIBECK_VELOCITY,
) -> FrictionTerms:
    """Read `--terms`: words of `TERMS`, each with the joints it is for if not all (`fo:1+3`).

    Raises:
        InputError: An unknown word or a joint that is not a positive number.
    """
    terms: list[tuple[str, tuple[int, ...] | None]] = []
    for item in text.split(","):
        word, colon, joints = item.strip().partition(":")
        if not colon:
            terms.append((word, None))
            continue
        numbers = joints.split("+")
        if not all(_is_count(number) for number in numbers):
            raise InputError(
                "joints of a term count from 1",
                where="--terms",
                value=item,
                next_step="Write for example fo:1+3.",
            )
        terms.append((word, tuple(sorted({int(number) - 1 for number in numbers}))))
    return FrictionTerms(terms=tuple(terms), width=width, stribeck_velocity=stribeck_velocity)


def terms_from_json(data: Mapping[str, Any]) -> FrictionTerms:
    """The inverse of `FrictionTerms.to_json`.

    Raises:
        InputError: Missing keys or values of the wrong type.
    """
    fields = JsonFields({"width": None, "stribeck_velocity": None, **data}, "friction.")
    load = fields.object("load") if "load" in data else None
    return fields.made(
        FrictionTerms,
        terms=parse_terms(fields.text("terms")).terms,
        load=load
        and load.made(LoadFriction, joints=tuple(int(j) - 1 for j in load.vector("joints"))),
        ripples=ripples_from_json(fields),
    )


def _is_count(text: str) -> bool:
    # int() refuses thousands of digits with another error; no robot has that many joints.
    return text.isascii() and text.isdigit() and len(text) < 10 and int(text) > 0
