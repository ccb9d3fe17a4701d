"""Trajectories as tables for other programs: CSV, and ROS JointTrajectory as YAML."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence

import numpy as np

from dynid.core.errors import InputError
from dynid.trajectory.motion import JointMotion
from dynid.trajectory.trajectory import Trajectory

_MOST = 10_000_000
"""Samples; more is a mistake in the rate."""
_LATE = 1e-9
"""Share of a step that rounding may take off the last one."""


def sampled(trajectory: Trajectory, rate_hz: float) -> JointMotion:
    """The motion on a regular grid from zero, and at its end.

    Args:
        trajectory: The motion.
        rate_hz: Samples a second; the last step is shorter where the duration asks for it.

    Raises:
        InputError: A rate that is not positive, or too many samples.
    """
    if not (math.isfinite(rate_hz) and rate_hz > 0):
        raise InputError("the rate must be positive", value=rate_hz)
    steps = math.ceil(trajectory.duration * rate_hz - _LATE)
    if steps > _MOST:
        raise InputError("samples of the motion", value=steps, limit=_MOST)
    return trajectory.evaluate(np.append(np.arange(steps) / rate_hz, trajectory.duration))


def csv_text(
    trajectory: Trajectory, rate_hz: float = 125.0, *, units: Sequence[str] | None = None
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
    names = _units(trajectory, units)
    header = ["t [s]"] + [
        f"{quantity}{joint} [{unit}{per}]"
        for quantity, per in (("q", ""), ("dq", "/s"), ("ddq", "/s^2"))
        for joint, unit in enumerate(names, start=1)
    ]
    rows = np.column_stack([motion.t, motion.q, motion.dq, motion.ddq]).tolist()
    return "\n".join([",".join(header), *(",".join(map(repr, row)) for row in rows)]) + "\n"


def joint_trajectory_yaml(
    trajectory: Trajectory,
    joint_names: Sequence[str],
    rate_hz: float = 125.0,
    *,
    frame: str = "",
) -> str:
    """The motion as a ROS 2 `trajectory_msgs/msg/JointTrajectory` in YAML.

    Args:
        trajectory: The motion.
        joint_names: (n) names, in the order of the joints.
        rate_hz: Points a second.
        frame: `frame_id` of the header.

    Raises:
        InputError: A rate that is not positive, or names that do not fit the joints.
    """
    if len(joint_names) != trajectory.joints or len(set(joint_names)) != len(joint_names):
        raise InputError(
            "one name a joint, each once", value=tuple(joint_names), limit=trajectory.joints
        )
    return "\n".join(_yaml_lines(sampled(trajectory, rate_hz), joint_names, frame)) + "\n"


def _yaml_lines(motion: JointMotion, names: Sequence[str], frame: str) -> Iterator[str]:
    yield "header:"
    yield "  stamp: {sec: 0, nanosec: 0}"
    yield f"  frame_id: {json.dumps(frame)}"
    yield f"joint_names: [{', '.join(json.dumps(name) for name in names)}]"
    yield "points:"
    for t, q, dq, ddq in zip(motion.t, motion.q, motion.dq, motion.ddq, strict=True):
        second, nano = divmod(round(float(t) * 1e9), 1_000_000_000)
        yield f"- positions: {_flow(q.tolist())}"
        yield f"  velocities: {_flow(dq.tolist())}"
        yield f"  accelerations: {_flow(ddq.tolist())}"
        yield f"  time_from_start: {{sec: {second}, nanosec: {nano}}}"


def _flow(values: Sequence[float]) -> str:
    # YAML 1.1 takes 1e-05 for a text: an exponent needs a point before it.
    return "[" + ", ".join(_yaml_float(value) for value in values) + "]"


def _yaml_float(value: float) -> str:
    text = repr(value)
    return text if "e" not in text or "." in text else text.replace("e", ".0e")


def _units(trajectory: Trajectory, units: Sequence[str] | None) -> list[str]:
    names = list(units) if units is not None else ["rad"] * trajectory.joints
    if len(names) != trajectory.joints or not set(names) <= {"rad", "m"}:
        raise InputError("one unit a joint, rad or m", value=tuple(names), limit=trajectory.joints)
    return names
