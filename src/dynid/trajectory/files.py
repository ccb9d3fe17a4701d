"""Trajectories of every kind as JSON files, and as tables for other programs."""

import json
import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, cast

import numpy as np

from dynid import core
from dynid.trajectory import base, fourier, quintic
from dynid.trajectory.points import MotionSequence, PointsFamily, PointToPoint, Repetition

_DEEPEST = 8
"""Levels of sequences within sequences that a file may have."""


KINDS: dict[str, type[base.Trajectory]] = {
    "fourier": fourier.FourierSeries,
    "fourier-quintic": quintic.FourierQuintic,
    "bspline": quintic.BSpline,
    "quintic": quintic.Quintic,
    "point-to-point": PointToPoint,
    "sequence": MotionSequence,
    "repetition": Repetition,
}
"""What a file calls each kind; a field of the trajectory has the same name in the file."""


def trajectory_to_json(trajectory: base.Trajectory) -> dict[str, Any]:
    """A JSON object, `type` first, from which the trajectory can be read back exactly.

    Raises:
        InputError: A trajectory of another kind.
    """
    kind = next((name for name, made in KINDS.items() if type(trajectory) is made), None)
    if kind is None:
        raise core.InputError(
            "no file form for this trajectory",
            value=type(trajectory).__name__,
            limit=tuple(KINDS),
            next_step="Files and runs need one of these; dynid.check and dynid.simulate_recording "
            "take any trajectory beside a robot.",
        )
    names = (item.name for item in fields(cast("Any", trajectory)))
    return {"type": kind, **{name: _plain(getattr(trajectory, name)) for name in names}}


def _plain(value: object) -> object:
    if isinstance(value, base.Trajectory):
        return trajectory_to_json(value)
    if isinstance(value, tuple):
        return [_plain(part) for part in cast("tuple[object, ...]", value)]
    return cast("Any", value).tolist() if isinstance(value, np.ndarray | np.generic) else value


def trajectory_from_json(stored: core.JsonFields, *, depth: int = 0) -> base.Trajectory:
    """The trajectory of a JSON object that `trajectory_to_json` made, within so many sequences.

    Raises:
        InputError: An unknown type, or numbers that are not a trajectory of it.
    """
    if depth > _DEEPEST:
        raise core.InputError("sequences within sequences", value=depth, limit=_DEEPEST)
    kind = stored.text("type")
    if kind not in KINDS:
        raise core.InputError(f"{stored.prefix}type is no kind of trajectory", value=kind)
    made, inner = KINDS[kind], dict[str, Any]()
    if made is Repetition:
        inner["part"] = trajectory_from_json(stored.object("part"), depth=depth + 1)
    elif made is MotionSequence:
        parts = stored.objects("parts")
        inner["parts"] = tuple(trajectory_from_json(part, depth=depth + 1) for part in parts)
    return stored.made(made, **inner)


_KIND = "dynid.trajectory"
_VERSION = 2
_VERSIONS = (1, _VERSION)
"""Version 1 knew Fourier series alone, their fields beside the others."""
_SHORTEST, _LONGEST, _LARGEST = 1e-3, 1e6, 1e9
"""Seconds of a motion, and rad or m and their derivatives."""
_LOOKS = 64
_OWN = frozenset({"kind", "version", "robot", "trajectory", "limits", "provenance"})


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredTrajectory(core.Value):
    """A trajectory with what it was made for."""

    trajectory: base.Trajectory
    """The motion."""
    robot: str
    """Name or path of the robot."""
    limits: core.MotionBounds
    """The limits it was made for, NaN where unknown."""
    provenance: core.Provenance
    """How it was made."""
    extra: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """What else its writer put into the file, by key."""


def write_trajectory(
    trajectory: base.Trajectory | StoredTrajectory,
    path: str | Path,
    *,
    robot: str | Path = "",
    limits: core.MotionBounds | None = None,
    provenance: core.Provenance | None = None,
    extra: Mapping[str, Any] | None = None,
) -> None:
    """Write a trajectory as JSON; an interrupted write leaves the old file, or none.

    Args:
        trajectory: The motion, of any kind of this package; or what `read_trajectory` found, whose
            facts are kept where no other ones are given.
        path: File to write.
        robot: Name or path of the robot; without it, whoever takes the file needs `--robot`.
        limits: The limits it was made for, NaN where unknown; default: all unknown.
        provenance: How it was made; default: the time and the versions of now.
        extra: More to keep in the file, by key; JSON values.

    Raises:
        InputError: Limits for another number of joints, a trajectory of a foreign kind, extras
            that take a key of the file's own, settings that JSON cannot hold, or a place where
            no such file can be.
        JobError: The disk does not take the file.
    """
    if isinstance(trajectory, str | Path):  # pyright: ignore[reportUnnecessaryIsInstance]
        # The order of release 0.1, for one release.
        old = "write_trajectory(path, trajectory) is now write_trajectory(trajectory, path)"
        warnings.warn(old, DeprecationWarning, stacklevel=3)
        trajectory, path = cast("base.Trajectory", path), trajectory
    if isinstance(trajectory, StoredTrajectory):
        robot, limits = robot or trajectory.robot, limits or trajectory.limits
        provenance, extra = provenance or trajectory.provenance, extra or trajectory.extra
        trajectory = trajectory.trajectory
    if limits is None:
        unknown = np.full(trajectory.joints, np.nan)
        limits = core.MotionBounds(
            **dict.fromkeys((item.name for item in fields(core.MotionBounds)), unknown)
        )
    if limits.joints != trajectory.joints:
        raise core.InputError("joints of the limits", value=limits.joints, limit=trajectory.joints)
    taken = sorted(_OWN & set(extra or ()))
    if taken:
        raise core.InputError("these keys are the file's own", value=taken)
    document = {
        "kind": _KIND,
        "version": _VERSION,
        "robot": str(robot),
        "trajectory": trajectory_to_json(trajectory),
        **(extra or {}),
        "limits": {
            item.name: core.plain(getattr(limits, item.name)) for item in fields(core.MotionBounds)
        },
        "provenance": (provenance or core.provenance()).to_json(),
    }
    core.write_json(Path(path), document)


def read_trajectory(path: str | Path) -> StoredTrajectory:
    """Read what `write_trajectory` wrote, now or in an earlier version, checking every number.

    Raises:
        InputError: A file that is missing, is not JSON, is something else, or whose numbers
            are not a trajectory.
    """
    whole = core.load_object(path)
    if whole.get("kind") != _KIND:
        raise core.InputError(
            "not a design and no other trajectory",
            where=str(path),
            value=whole.get("kind") or whole.get("format") or "a JSON object of another kind",
            next_step="Make one: dynid design ROBOT -o DESIGN.json",
        )
    version = whole.whole("version") if "version" in whole.values else None
    if version not in _VERSIONS:
        raise core.InputError(
            "unknown file version",
            where=str(path),
            value=version,
            limit=f"up to {_VERSION}",
            next_step="A newer file needs a newer dynid.",
        )
    try:
        trajectory = trajectory_from_json(whole if version == 1 else whole.object("trajectory"))
        _check_size(trajectory)
        limits = whole.object("limits").made(core.MotionBounds)
        if limits.joints != trajectory.joints:
            raise core.InputError(
                "joints of the limits", value=limits.joints, limit=trajectory.joints
            )
        own = _OWN if version == _VERSION else _OWN | {"type", "period", "offset", "a", "b"}
        return StoredTrajectory(
            trajectory=trajectory,
            robot=whole.text("robot"),
            limits=limits,
            provenance=whole.object("provenance").made(core.Provenance),
            extra={key: value for key, value in whole.values.items() if key not in own},
        )
    except core.InputError as error:
        raise error.changed(where=str(path), next_step=None) from error


def _check_size(trajectory: base.Trajectory) -> None:
    """Refuse numbers with which nothing can be reckoned: they would overflow further on."""
    if not _SHORTEST <= trajectory.duration <= _LONGEST:
        raise core.InputError(
            "the motion's duration",
            value=trajectory.duration,
            limit=f"{_SHORTEST:g} to {_LONGEST:g} s",
        )
    times = np.linspace(0.0, trajectory.duration, _LOOKS)
    with np.errstate(all="ignore"):
        motion = trajectory.evaluate(times)
    for name, values in (("position", motion.q), ("acceleration", motion.ddq)):
        largest = float(np.abs(values).max())
        if not largest < _LARGEST:
            raise core.InputError(
                f"the motion's {name}", value=largest, limit=f"below {_LARGEST:g}"
            )


_FAMILIES: dict[str, type[base.MotionFamily]] = {
    made.name: made
    for made in (
        *(fourier.FourierFamily, fourier.ModifiedFourierFamily, quintic.FourierQuinticFamily),
        *(quintic.BSplineFamily, PointsFamily),
    )
}
FAMILY_NAMES = tuple(_FAMILIES)
"""Names that `motion_family` knows."""


def motion_family(name: str, duration: float, harmonics: int) -> base.MotionFamily:
    """A family by its name.

    Args:
        name: One of `FAMILY_NAMES`.
        duration: Time from start to end, the period [s].
        harmonics: Number of harmonics H. A B-spline gets 2H free points, as many as the series
            has sines and cosines; a motion through points rests in H of them.

    Raises:
        InputError: An unknown name, or a duration or number of harmonics that is not allowed.
    """
    if name not in _FAMILIES:
        raise core.InputError(
            "unknown family of motions", value=name, limit=", ".join(FAMILY_NAMES)
        )
    made = _FAMILIES[name]
    order = 2 * harmonics if made is quintic.BSplineFamily else harmonics
    return made(duration=duration, order=order)


_MOST = 10_000_000
"""Samples; more is a mistake in the rate."""
_LATE = 1e-6
"""Share of a step by which the last one may be longer: the end never has the nanosecond of another
point, as a file of joint trajectories has them."""
_APART = 0.1
"""Steps between a point of the grid and a jump of the acceleration that has a point as well."""


def sampled(trajectory: base.Trajectory, rate_hz: float) -> base.JointMotion:
    """The motion on a regular grid from zero, and at its end: the last step may be shorter.

    Raises:
        InputError: A rate that is not positive, or too many samples.
    """
    base.require_positive("the rate", rate_hz)
    steps = math.ceil(trajectory.duration * rate_hz - _LATE)
    if steps > _MOST:
        raise core.InputError("samples of the motion", value=steps, limit=_MOST)
    return trajectory.evaluate(np.append(np.arange(steps) / rate_hz, trajectory.duration))


def csv_text(
    trajectory: base.Trajectory, rate_hz: float = 125.0, *, units: Sequence[str] | None = None
) -> str:
    """The motion as CSV: t, q1.., dq1.., ddq1.., with units in the header.

    Numbers stand so that they read back exactly; `dynid import` and spreadsheets know the header.

    Args:
        trajectory: The motion.
        rate_hz: Rows a second.
        units: (n) unit of each joint's position, `rad` or `m`; radians if not given.

    Raises:
        InputError: A rate that is not positive, or units for other joints.
    """
    motion = sampled(trajectory, rate_hz)
    names = list(units) if units is not None else ["rad"] * trajectory.joints
    if len(names) != trajectory.joints or not set(names) <= {"rad", "m"}:
        raise core.InputError(
            "one unit a joint, rad or m", value=tuple(names), limit=trajectory.joints
        )
    header = ["t [s]"] + [
        f"{quantity}{joint} [{unit}{per}]"
        for quantity, per in (("q", ""), ("dq", "/s"), ("ddq", "/s^2"))
        for joint, unit in enumerate(names, start=1)
    ]
    rows = np.column_stack([motion.t, motion.q, motion.dq, motion.ddq]).tolist()
    return "\n".join([",".join(header), *(",".join(map(repr, row)) for row in rows)]) + "\n"


def joint_trajectory_yaml(
    trajectory: base.Trajectory, joint_names: Sequence[str], rate_hz: float = 125.0
) -> str:
    """The motion as a ROS 2 `trajectory_msgs/msg/JointTrajectory` in YAML.

    Controllers join points by quintics, which overshoot where the acceleration jumps: a motion
    with legs from point to point has points at the jumps and no accelerations, so that cubics
    join them, which are the legs themselves.

    Args:
        trajectory: The motion.
        joint_names: (n) names, in the order of the joints.
        rate_hz: Points a second.

    Raises:
        InputError: A rate that is not positive, or names that do not fit the joints.
    """
    if len(joint_names) != trajectory.joints or len(set(joint_names)) != len(joint_names):
        raise core.InputError(
            "one name a joint, each once", value=tuple(joint_names), limit=trajectory.joints
        )
    motion, jumps = sampled(trajectory, rate_hz), np.array(list(_jumps(trajectory, 0.0)))
    if len(jumps):
        away = np.abs(motion.t[:, None] - jumps).min(axis=1) > _APART / rate_hz
        motion = trajectory.evaluate(np.unique([*motion.t[away], *jumps]))
    return "\n".join(_yaml_lines(motion, joint_names, smooth=not len(jumps))) + "\n"


def _jumps(trajectory: base.Trajectory, start: float) -> Iterator[float]:
    """When the acceleration jumps in a motion that starts then [s]."""
    if isinstance(trajectory, MotionSequence):
        for part, begin in zip(trajectory.parts, trajectory.starts.tolist(), strict=True):
            yield from _jumps(part, start + begin)
    elif isinstance(trajectory, Repetition):
        for number in range(trajectory.times):
            yield from _jumps(trajectory.part, start + number * trajectory.part.duration)
    elif isinstance(trajectory, PointToPoint):
        ends = np.cumsum([start, *(time for time, _ in trajectory.polynomials())])
        # In nanoseconds, as the file has it: the end of one leg is the start of the next.
        yield from ends.round(9).tolist()


def _yaml_lines(motion: base.JointMotion, names: Sequence[str], *, smooth: bool) -> Iterator[str]:
    yield "header:"
    yield "  stamp: {sec: 0, nanosec: 0}"
    yield '  frame_id: ""'
    yield f"joint_names: [{', '.join(json.dumps(name) for name in names)}]"
    yield "points:"
    for t, q, dq, ddq in zip(motion.t, motion.q, motion.dq, motion.ddq, strict=True):
        second, nano = divmod(round(float(t) * 1e9), 1_000_000_000)
        yield f"- positions: {_flow(q.tolist())}"
        yield f"  velocities: {_flow(dq.tolist())}"
        if smooth:
            yield f"  accelerations: {_flow(ddq.tolist())}"
        yield f"  time_from_start: {{sec: {second}, nanosec: {nano}}}"


def _flow(values: Sequence[float]) -> str:
    # YAML 1.1 takes 1e-05 for a text: an exponent needs a point before it.
    texts = map(repr, values)
    pointed = (text if "." in text else text.replace("e", ".0e") for text in texts)
    return "[" + ", ".join(pointed) + "]"
