"""Motions in sequence, and point-to-point motions for controllers that only take points.

Point to point, every joint has a trapezoid of velocity: it accelerates for `BLEND` of the leg,
moves at constant velocity, and decelerates as long, all joints together: the profile that `movej`,
`PTP` and `MoveAbsJ` make of a leg. The arm rests in every point; no blending radius is used, so
that the path is the one that was certified.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, InputError, MotionBounds, check_word, frozen
from dynid.trajectory.base import MotionFamily, StandingMotion, Trajectory, require_whole
from dynid.trajectory.quintic import StraightMove, rest_to_rest

_JUMP = 1e-6
"""Largest jump where two parts meet: rad, rad/s and rad/s^2 (m for prismatic joints)."""
_MOST = 10_000
"""Repetitions; more is a mistake, and would fill the memory of what lists them."""
_WORDS = {"q": "position", "dq": "velocity", "ddq": "acceleration"}


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionSequence(StandingMotion):
    """Parts run one after the other.

    Raises:
        InputError: No parts, parts of different joints, or a part that does not go on from where
            the one before ends, in position, velocity and acceleration.
    """

    parts: tuple[Trajectory, ...]
    """The motions in their order."""

    def __post_init__(self) -> None:
        if not self.parts:
            raise InputError("a sequence needs a part")
        object.__setattr__(self, "parts", tuple(self.parts))
        for index, (before, after) in enumerate(itertools.pairwise(self.parts), start=2):
            _check_meeting(before, after, f"part {index} of the sequence")

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.parts[0].joints

    @property
    def starts(self) -> Array:
        """(parts) when each part starts [s]."""
        return np.concatenate([[0.0], np.cumsum([part.duration for part in self.parts[:-1]])])

    @property
    def duration(self) -> float:
        """The parts' durations added up [s]."""
        return float(self.starts[-1]) + self.parts[-1].duration

    def inside(self, t: Array) -> tuple[Array, Array, Array]:
        """See `StandingMotion`."""
        starts = self.starts
        index = np.searchsorted(starts, t, side="right") - 1
        q, dq, ddq = (np.empty((len(t), self.joints)) for _ in range(3))
        for number, part in enumerate(self.parts):
            mine = index == number
            if not mine.any():
                continue
            # A time that rounding puts after the part belongs to its end, not to a new period.
            motion = part.evaluate(np.minimum(t[mine] - starts[number], part.duration))
            q[mine], dq[mine], ddq[mine] = motion.q, motion.dq, motion.ddq
        return q, dq, ddq


@dataclass(frozen=True, slots=True, kw_only=True)
class Repetition(StandingMotion):
    """One motion several times over.

    Raises:
        InputError: No repetition, more than 10 000 of them, or a motion that does not end where
            and as it starts.
    """

    part: Trajectory
    """The motion of one period."""
    times: int
    """How many periods."""

    def __post_init__(self) -> None:
        require_whole("the number of repetitions", self.times, 1, _MOST)
        if self.times > 1:
            _check_meeting(self.part, self.part, "the repetition")

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.part.joints

    @property
    def duration(self) -> float:
        """All periods together [s]."""
        return self.times * self.part.duration

    def inside(self, t: Array) -> tuple[Array, Array, Array]:
        """See `StandingMotion`."""
        period = self.part.duration
        motion = self.part.evaluate(np.where(t < self.duration, np.mod(t, period), period))
        return motion.q, motion.dq, motion.ddq


def _chained(parts: Sequence[Trajectory]) -> Trajectory:
    """The parts as one motion; a single part stays what it is."""
    return parts[0] if len(parts) == 1 else MotionSequence(parts=tuple(parts))


def _check_meeting(before: Trajectory, after: Trajectory, where: str) -> None:
    if before.joints != after.joints:
        raise InputError(
            "joints of the motion", where=where, value=after.joints, limit=before.joints
        )
    end, start = before.evaluate([before.duration]), after.evaluate([0.0])
    for name, word in _WORDS.items():
        jump = np.abs(getattr(start, name) - getattr(end, name))[0]
        if (jump > _JUMP).any():
            joint = int(np.argmax(jump))
            raise InputError(
                f"joint {joint + 1}: the {word} jumps where the motions meet",
                where=where,
                value=float(jump[joint]),
                limit=_JUMP,
            )


def through_poses(
    poses: ArrayLike,
    limits: MotionBounds,
    *,
    margin: float = 0.5,
    acceleration: ArrayLike | None = None,
) -> Trajectory:
    """The fastest fifth-order polynomials from pose to pose that the limits allow.

    Args:
        poses: (m, n) poses, two or more [rad or m].
        limits: Joint limits; unknown positions count as -pi to pi, other unknowns do not bind.
        margin: Share of the velocity and acceleration limits to use, in (0, 1].
        acceleration: (n) or one number: acceleration limits where `limits` knows none
            [rad/s^2 or m/s^2].

    Raises:
        InputError: Fewer than two poses, a pose outside the position limits, a margin outside
            (0, 1], or no limit that bounds the speed.
    """
    places = frozen(poses, shape=(None, None), name="poses")
    if len(places) < 2:
        raise InputError("a motion needs two poses", value=len(places))
    return _chained(
        [
            rest_to_rest(start, goal, limits, margin=margin, acceleration=acceleration)
            for start, goal in itertools.pairwise(places)
        ]
    )


BLEND = 1 / 3
"""Share of a leg in which the velocity rises, and again in which it falls: with a third, the leg's
peak velocity is 3/2 and its peak acceleration 9/2 of the distance over the (squared) time."""
LANGUAGES = ("movej", "waypoints", "krl", "rapid")
_AXES = 6
_NAME = "dynid_points"
"""Of the programs."""
_SAID = "untested on a controller; exact stop in every point"
_END = 1e-9
"""Share of a leg that rounding may take off its ends."""
_BESIDE = 1e-6
"""Share of a leg between a jump of the acceleration and the times beside it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PointToPoint(StraightMove):
    """A straight line in joint space with a trapezoid of velocity."""

    def profile(self, s: Array) -> tuple[Array, Array, Array]:
        """See `StraightMove`; at the ends the acceleration counts as zero: there the arm stands."""
        top = 1.0 / (1.0 - BLEND)
        push = top / BLEND
        rising, falling = s < BLEND, s > 1.0 - BLEND
        place = np.where(rising, push / 2 * np.square(s), top * (s - BLEND / 2))
        place = np.where(falling, 1.0 - push / 2 * np.square(1.0 - s), place)
        speed = np.where(rising, push * s, np.where(falling, push * (1.0 - s), top))
        inside = (s > _END) & (s < 1.0 - _END)
        return place, speed, inside * push * (rising * 1.0 - falling * 1.0)

    def polynomials(self) -> tuple[tuple[float, Array], ...]:
        """Duration [s] and ascending coefficients (n, 3) of the three parts, each in 0 to 1."""
        way = self.goal - self.start
        top = 1.0 / (1.0 - BLEND)
        ramp = top * BLEND / 2
        found: list[tuple[float, Array]] = []
        for share, powers in (
            (BLEND, (0.0, 0.0, ramp)),
            (1.0 - 2.0 * BLEND, (ramp, 1.0 - 2.0 * ramp, 0.0)),
            (BLEND, (1.0 - ramp, 2.0 * ramp, -ramp)),
        ):
            coefficients = np.outer(way, powers)
            coefficients[:, 0] += self.start
            found.append((share * self.travel_time, coefficients))
        return tuple(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class PointsFamily(MotionFamily):
    """From the offset through free points, a rest in each, and back, in equal times.

    Raises:
        InputError: A duration that is not positive, or no free points.
    """

    name: ClassVar[str] = "points"

    @property
    def corners(self) -> Array:
        """See `MotionFamily`: where legs begin and end to cruise, torque and power are largest."""
        leg = self.duration / (self.order + 1)
        jumps = np.repeat([BLEND, 1.0 - BLEND], 2) + np.tile([-_BESIDE, _BESIDE], 2)
        return leg * np.add.outer(np.arange(self.order + 1), jumps).ravel()

    def member(self, pose: Array, free: Array) -> Trajectory:
        """The points are the free numbers, relative to the pose."""
        leg = self.duration / (self.order + 1)
        legs = itertools.pairwise(np.vstack([pose, pose + free.T, pose]))
        return _chained(
            [PointToPoint(start=start, goal=goal, travel_time=leg) for start, goal in legs]
        )


def check_points(language: str, joints: int, limits: MotionBounds) -> None:
    """Refuse a language that cannot hold motions of a robot.

    Raises:
        InputError: An unknown language, not six joints, or no limits of which KRL takes shares.
    """
    check_word(language, LANGUAGES, "language")
    if language != "waypoints" and joints != _AXES:
        raise InputError("needs six joints", where=f"--{language}", value=joints, limit=_AXES)
    known = np.isfinite(limits.velocity) & np.isfinite(limits.acceleration)
    if language == "krl" and not known.all():
        raise InputError(
            "KRL takes shares of the velocity and acceleration limits, which are not known",
            where="--krl",
            value=f"joint {int(np.argmin(known)) + 1}",
            next_step="Give [limits] velocity and acceleration in a robot file.",
        )


def points_text(
    trajectory: Trajectory, language: str, limits: MotionBounds, *, comment: str = ""
) -> str:
    """A point-to-point motion as a program for a controller that makes the profile itself.

    None of the programs was run on a controller: they are compared with the motion by reading
    them back.

    Args:
        trajectory: A sequence of `PointToPoint`.
        language: `movej` (URScript), `waypoints` (CSV), `krl` (KUKA) or `rapid` (ABB).
        limits: Velocity and acceleration limits, of which KRL takes shares.
        comment: One line for the head of a program.

    Raises:
        InputError: Another kind of motion, an unknown language, or not six joints or no limits
            where the language wants them.
    """
    check_points(language, trajectory.joints, limits)
    parts = trajectory.parts if isinstance(trajectory, MotionSequence) else (trajectory,)
    legs = [part for part in parts if isinstance(part, PointToPoint)]
    if len(legs) < len(parts):
        raise InputError("not a motion through points", next_step="Design with --trajectory points")
    said = f"{_SAID}; {comment}" if comment else _SAID
    if language == "krl":
        lines = _krl(legs, said, limits)
    elif language == "waypoints":
        lines = _waypoints(legs)
    else:
        lines = {"movej": _movej, "rapid": _rapid}[language](legs, said)
    return "\n".join(lines) + "\n"


def _movej(legs: list[PointToPoint], said: str) -> list[str]:
    lines = [f"def {_NAME}():", f"  # {said}"]
    lines.append(f"  movej({_list(legs[0].start, 1.0)}, a=0.5, v=0.5)  # to the start")
    for leg in legs:
        # The leading axis, whose velocity and acceleration movej takes, is the one that goes far.
        far = max(float(np.abs(leg.goal - leg.start).max()), 1e-6)
        speed = far / ((1.0 - BLEND) * leg.travel_time)
        push = speed / (BLEND * leg.travel_time)
        lines.append(f"  movej({_list(leg.goal, 1.0)}, a={push:.12f}, v={speed:.12f}, r=0)")
    return [*lines, "end"]


def _waypoints(legs: list[PointToPoint]) -> list[str]:
    joints = range(1, legs[0].joints + 1)
    rows = [(0.0, legs[0].start), *((leg.travel_time, leg.goal) for leg in legs)]
    header = ",".join(["travel_time [s]", *(f"q{joint}" for joint in joints)])
    return [header, *(",".join(map(repr, [time, *pose.tolist()])) for time, pose in rows)]


def _krl(legs: list[PointToPoint], said: str, limits: MotionBounds) -> list[str]:
    lines = [f"DEF {_NAME}()", f"; {said}", "BAS(#INITMOV,0)", f"PTP {_krl_axes(legs[0].start)}"]
    for leg in legs:
        speed = np.abs(leg.goal - leg.start) / ((1.0 - BLEND) * leg.travel_time)
        share = _percent(speed / np.asarray(limits.velocity))
        push = _percent(speed / (BLEND * leg.travel_time) / np.asarray(limits.acceleration))
        for axis in range(_AXES):
            lines.append(f"$VEL_AXIS[{axis + 1}]={share[axis]}")
            lines.append(f"$ACC_AXIS[{axis + 1}]={push[axis]}")
        lines.append(f"PTP {_krl_axes(leg.goal)}")
    return [*lines, "END"]


def _rapid(legs: list[PointToPoint], said: str) -> list[str]:
    lines = [f"MODULE {_NAME}", f"  PROC {_NAME}_run()", f"    ! {said}"]
    for time, pose in ((None, legs[0].start), *((leg.travel_time, leg.goal) for leg in legs)):
        timed = "" if time is None else f"\\T:={time:.6f}"
        axes = f"[{_list(pose, 180 / math.pi)},[9E9,9E9,9E9,9E9,9E9,9E9]]"
        lines.append(f"    MoveAbsJ {axes}, v100{timed}, fine, tool0;")
    return [*lines, "  ENDPROC", "ENDMODULE"]


def _krl_axes(pose: Array) -> str:
    words = (f"A{axis} {math.degrees(value):.6f}" for axis, value in enumerate(pose, start=1))
    return "{" + ", ".join(words) + "}"


def _list(pose: Array, unit: float) -> str:
    return "[" + ", ".join(f"{value * unit:.9f}" for value in pose) + "]"


def _percent(share: Array) -> list[int]:
    """Whole per cent, rounded down: not faster than what was certified, but for the least, 1."""
    return [int(value) for value in np.clip(np.floor(100.0 * share + 1e-9), 1, 100)]
