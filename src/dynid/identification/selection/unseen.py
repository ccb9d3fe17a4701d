"""Torques that a recording could not show: of faster motions, and of joints that stood still.

Inertias have published values and their spread; friction and motor inertia are known from the
recording alone.
"""

from dataclasses import dataclass

import numpy as np

from dynid.core import Array, Mask, Value
from dynid.identification.selection.candidates import DISPLACEMENTS, LEVER
from dynid.robot import RobotModel

EXPONENT = 0.1
"""Standard deviation of the power of speed by which friction grows beyond the recorded speeds:
laws that agree there, linear in speed or in a root of it, differ by so much."""


def standing(robot: RobotModel, reach: Array) -> Mask:
    """(n) joints whose range of motion (n) [rad or m] is less than friction builds up over."""
    return reach < DISPLACEMENTS[-1] * np.where(robot.prismatic, LEVER, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionRange(Value):
    """What the identification record covered; beyond it a prediction extrapolates."""

    lower: Array
    """(n) smallest position [rad or m]."""
    upper: Array
    """(n) largest position [rad or m]."""
    speed: Array
    """(n) largest speed [rad/s or m/s]."""
    acceleration: Array
    """(n) largest acceleration [rad/s^2 or m/s^2]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Unseen:
    """What is known of friction and motor inertia, a joint."""

    motion: MotionRange
    """What was recorded."""
    friction: Array
    """(n) friction that a joint that stood still is expected to have; 0 for others [N.m or N]."""
    inertia: Array
    """(n) motor inertia of such a joint; 0 for others [kg.m^2 or kg]."""
    still: Mask
    """(n) whether it stood still."""

    def deviation(self, dq: Array, ddq: Array, friction: Array, sigma: Array) -> Array:
        """(n, N) standard deviation [N.m or N] of what was not recorded, at states.

        Beyond the recorded speed a power of it is unknown. Terms that grow with the acceleration
        were hidden where they stayed below the error.

        Args:
            dq: (n, N) velocities [rad/s or m/s].
            ddq: (n, N) accelerations [rad/s^2 or m/s^2].
            friction: (n, N) friction that is predicted [N.m or N].
            sigma: (n) left-out error [N.m or N].
        """
        faster = np.abs(dq) / np.maximum(self.motion.speed, 1e-9)[:, None]
        harder = np.abs(ddq) / np.maximum(self.motion.acceleration, 1e-9)[:, None]
        moved = np.hypot(
            EXPONENT * np.log(np.maximum(faster, 1.0)) * friction,
            sigma[:, None] * np.maximum(harder - 1.0, 0.0),
        )
        stood = np.hypot(self.friction[:, None], self.inertia[:, None] * ddq)
        return np.where(self.still[:, None], stood, moved)


def unseen(robot: RobotModel, parameters: dict[str, float], motion: MotionRange) -> Unseen:
    """What a recording could not show.

    A joint that stood still is expected to have friction and motor inertia as the others have
    them over their torque limits; without limits, over nothing.

    Args:
        robot: The robot.
        parameters: Base parameters by name.
        motion: What was recorded.
    """
    still, limit = standing(robot, motion.upper - motion.lower), robot.limits.torque
    size = limit if np.isfinite(limit).all() else np.ones(len(limit))

    def usual(known: Array) -> Array:
        shares = known[~still] / size[~still]
        shares = shares[shares > 0]
        share = float(np.sqrt(np.square(shares).mean())) if len(shares) else 0.0
        return still * share * size

    def of(symbol: str) -> Array:
        return np.array([parameters.get(f"{symbol}{j + 1}", 0.0) for j in range(len(size))])

    return Unseen(
        motion=motion,
        friction=usual(of("Fc") + of("Fv") * motion.speed),
        inertia=usual(of("Im")),
        still=still,
    )
