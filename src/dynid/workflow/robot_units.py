"""Numbers of a robot file that look like degrees or millimetres, in words."""

from __future__ import annotations

import math

import numpy as np

from dynid.core.arrays import Array
from dynid.robot.model import RobotModel

MOST_TURNS = 4.0
"""No joint with cables through it makes more, to either side."""
FASTEST = 30.0
"""[rad/s] Faster than the joints of any arm that carries its own weight."""
UNLIMITED = 1e4
"""Files write such numbers, or larger ones, where there is no limit."""
LONGEST = 20.0
"""[m] Longer than any arm with serial joints."""


def unit_notes(robot: RobotModel) -> tuple[str, ...]:
    """What in a robot's description is probably not in SI units; nothing where all is well.

    Args:
        robot: The robot.
    """
    turning = [j for j, slides in enumerate(robot.prismatic) if not slides]
    limits = robot.limits
    reach = float(np.linalg.norm(robot.placements[:, :3, 3], axis=1).sum())
    found: list[str] = []
    position = np.fmax(np.abs(limits.lower), np.abs(limits.upper))
    for what, unit, values, most, given in (
        ("position", "rad", position, MOST_TURNS * 2 * math.pi, "degrees"),
        ("velocity", "rad/s", limits.velocity, FASTEST, "degrees a second"),
    ):
        joints = _beyond(values, most, turning)
        if joints:
            found.append(
                f"the {what} limits of joint {', '.join(str(j + 1) for j in joints)} reach "
                f"{values[joints].max():.4g} {unit}, and look like {given}"
            )
    if reach > LONGEST:
        found.append(f"the arm is {reach:.4g} m long: its lengths look like millimetres")
    return tuple(found)


def _beyond(values: Array, most: float, turning: list[int]) -> list[int]:
    # A comparison with an unknown limit (NaN) is false.
    return [j for j in turning if most < values[j] < UNLIMITED]
