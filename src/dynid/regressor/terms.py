"""Which columns stand beside the inertial ones, as a value that can be written to a file."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

from dynid.core import InputError
from dynid.regressor.friction import LoadFriction, TorqueRipple, load_from_json, ripples_from_json

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
    stribeck_velocity: float = STRIBECK_VELOCITY
    """For the term `fs` [rad/s or m/s]."""
    presliding: tuple[float, ...] = ()
    """Displacement over which each joint's friction builds up [rad or m]; 0 for joints without,
    none at all for an arm without. Found by an identification, see `presliding.friction_state`."""
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
        widths = self.width if isinstance(self.width, tuple) else (self.width,)
        if not all(math.isfinite(w) and w >= 0 for w in widths):
            raise InputError("Coulomb widths must not be negative", value=self.width)
        if not (math.isfinite(self.stribeck_velocity) and self.stribeck_velocity > 0):
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

    def without(self, names: Collection[str], joints: int) -> FrictionTerms:
        """These terms without some parameters; a joint without Coulomb friction has no presliding.

        Args:
            names: Parameters to drop, such as `Fv3`.
            joints: Number of joints.
        """
        kept: list[tuple[str, tuple[int, ...] | None]] = []
        for term, given in self.terms:
            have = tuple(range(joints)) if given is None else given
            left = tuple(j for j in have if f"{term.capitalize()}{j + 1}" not in names)
            if left:
                kept.append((term, given if left == have else left))
        over = tuple(0.0 if f"Fc{j + 1}" in names else d for j, d in enumerate(self.presliding))
        return replace(self, terms=tuple(kept), presliding=over if any(over) else ())

    def check_joints(self, joints: int) -> None:
        """Check against the number of joints of a robot.

        Raises:
            InputError: A joint or a list of widths that the robot does not have.
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
            self.load.check_joints(joints)
        if isinstance(self.width, tuple) and len(self.width) != joints:
            raise InputError("one Coulomb width a joint", value=len(self.width), limit=joints)
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
        width = list(self.width) if isinstance(self.width, tuple) else self.width
        return {
            "terms": self.describe(),
            "width": width,
            "stribeck_velocity": self.stribeck_velocity,
            **({"presliding": list(self.presliding)} if self.presliding else {}),
            **({} if self.load is None else {"load": self.load.to_json()}),
            **({"ripples": [r.to_json() for r in self.ripples]} if self.ripples else {}),
        }


def parse_terms(
    text: str,
    *,
    width: float | tuple[float, ...] = PAPER_WIDTH,
    stribeck_velocity: float = STRIBECK_VELOCITY,
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
    try:
        width = data["width"]
        friction = parse_terms(
            str(data["terms"]),
            width=(
                tuple(float(w) for w in cast("list[Any]", width))
                if isinstance(width, list)
                else float(width)
            ),
            stribeck_velocity=float(data["stribeck_velocity"]),
        )
        return replace(
            friction,
            presliding=tuple(float(d) for d in data.get("presliding", ())),
            load=load_from_json(data.get("load")),
            ripples=ripples_from_json(data.get("ripples")),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError("friction terms cannot be read", value=str(data)) from error


def _is_count(text: str) -> bool:
    # int() refuses thousands of digits with another error; no robot has that many joints.
    return text.isascii() and text.isdigit() and len(text) < 10 and int(text) > 0
