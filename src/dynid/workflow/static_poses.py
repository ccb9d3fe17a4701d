"""Gravity parameters from poses at rest: rows of single poses, or the stops of a recording."""

import numpy as np
from threadpoolctl import threadpool_limits  # pyright: ignore[reportMissingTypeStubs]

from dynid import identification
from dynid.core import Array, InputError, Mask
from dynid.recording import ExperimentRecord, RecordLike, are_poses, open_record
from dynid.robot import RobotLike, load_robot
from dynid.signals import measured_torque

STILL = 2e-3
"""Displacement within twice `BESIDE_S` below which a joint rests [rad or m]."""
BESIDE_S = 0.15
STOP_S = 0.3
"""Shortest stop whose mean is a pose [s]."""


def identify_gravity(
    record: RecordLike, robot: RobotLike, *, frames: str = ""
) -> identification.GravityEstimate:
    """Gravity parameters, and what friction may hold, of an arm at rest.

    Each row is a pose where rows are unrelated; of a motion, each stop of all joints is one. What
    friction holds has a mean only if poses are approached from both sides.

    Args:
        record: The recording or its file.
        robot: The robot, or its name or file.
        frames: Parameter frames; the default is the robot's own.

    Raises:
        InputError: A recording without poses at rest, without torques, or of another robot.
    """
    robot = load_robot(robot)
    record = open_record(record, robot)
    torque, q = measured_torque(record, robot), record.signals["q"]
    if not are_poses(q):
        q, torque = _stops(record, torque)
    with threadpool_limits(limits=1, user_api="blas"):
        return identification.gravity_of(robot, q, torque, frames=frames)


def _stops(record: ExperimentRecord, torque: Array) -> tuple[Array, Array]:
    """Mean positions and torques (P, n) of the times at which all joints rest."""
    q = record.signals["q"]
    beside = max(round(BESIDE_S * record.rate_hz), 1)
    still: Mask = np.zeros(len(q) + 2, dtype=np.bool_)
    moved = np.abs(q[2 * beside :] - q[: -2 * beside]).max(axis=1, initial=0.0)
    still[1 + beside : 1 + beside + len(moved)] = moved < STILL
    edges = np.flatnonzero(still[1:] != still[:-1]).reshape(-1, 2)
    long = [slice(a, b) for a, b in edges if b - a >= STOP_S * record.rate_hz]
    if len(long) < 2:
        raise InputError(
            "the recording has no poses at rest",
            where=record.metadata.origin or None,
            value=len(long),
            limit=f"2 stops of {STOP_S + 2 * BESIDE_S:g} s at least",
            next_step="Let the arm rest for a second at many poses, or give a row a pose.",
        )
    means = [(q[part].mean(axis=0), torque[part].mean(axis=0)) for part in long]
    places, efforts = zip(*means, strict=True)
    return np.array(places), np.array(efforts)
