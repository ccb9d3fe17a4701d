"""Random states that excite every identifiable direction."""

from __future__ import annotations

import numpy as np

from dynid.core.arrays import Array
from dynid.robot.model import RobotModel

SPEED = np.pi
"""[rad/s or m/s] the paper's UR5 limit; the structure does not depend on it."""
ACCELERATION = 5.5 * np.pi
"""[rad/s^2 or m/s^2]"""


def random_states(robot: RobotModel, samples: int, seed: int) -> tuple[Array, Array, Array]:
    """Uniform random q, dq, ddq, each (samples, n); q spans +-pi rad or +-1 m."""
    return _states(robot, samples, seed, SPEED)


def slow_states(
    robot: RobotModel, samples: int, seed: int, speed: float
) -> tuple[Array, Array, Array]:
    """As `random_states`, no joint faster than `speed`: columns that die out above it show."""
    return _states(robot, samples, seed, speed)


def _states(robot: RobotModel, samples: int, seed: int, speed: float) -> tuple[Array, Array, Array]:
    generator = np.random.default_rng(seed)
    shape = (samples, robot.joints)
    reach = np.where(robot.prismatic, 1.0, np.pi)
    q = generator.uniform(-1, 1, shape) * reach
    dq = generator.uniform(-speed, speed, shape)
    ddq = generator.uniform(-ACCELERATION, ACCELERATION, shape)
    return q, dq, ddq
