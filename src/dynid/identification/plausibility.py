"""Whether the identified gravity looks like that of the masses that are known."""

from __future__ import annotations

import numpy as np

from dynid.constraints.prior import prior_dynamics
from dynid.core.notices import Notice
from dynid.identification.estimate import Estimate

POSES = 200
SEED = 0
LEAST_TORQUE = 0.02
"""Gravity below this share of the largest joint's says nothing about a joint's gain."""
WRONG_GAIN = 1.5
"""Gravity this many times too large or too small is no matter of masses that differ a little."""
UNLIKE = 0.5
"""Correlation below which the gravity is another one: of another mounting, or other joints."""


def implausible_gravity(estimate: Estimate) -> tuple[Notice, ...]:
    """Compare identified gravity torques with those of the robot's known masses.

    A wrong drive gain scales a joint's torques and leaves the fit perfect; only known masses can
    tell. A wrong mounting turns gravity.

    Args:
        estimate: The estimate.

    Returns:
        Nothing where masses are not known, or all is plausible.
    """
    robot = estimate.model.robot
    prior = prior_dynamics(robot)
    if prior is None:
        return ()
    reach = estimate.motion.upper - estimate.motion.lower
    numbers = np.random.default_rng(SEED)
    q = estimate.motion.lower + reach * numbers.random((POSES, robot.joints))
    rest = np.zeros_like(q)
    known = prior.model.inverse_dynamics(q, rest, rest, prior.parameters)
    parameters = np.array(estimate.standard_parameters())
    parameters[10 * robot.joints :] = 0.0
    found = estimate.model.inverse_dynamics(q, rest, rest, parameters)
    size = np.sqrt(np.square(known).mean(axis=0))
    heavy = [int(j) for j in np.flatnonzero(size > LEAST_TORQUE * max(float(size.max()), 1e-9))]
    turned: list[str] = []
    scaled: list[str] = []
    for j in heavy:
        product = float(known[:, j] @ found[:, j])
        ratio = product / float(known[:, j] @ known[:, j])
        norm = float(np.linalg.norm(known[:, j]) * np.linalg.norm(found[:, j]))
        name = robot.joint_names[j]
        if norm == 0 or product / norm < UNLIKE:
            turned.append(name)
        elif not 1 / WRONG_GAIN < ratio < WRONG_GAIN:
            scaled.append(f"{name} {ratio:.2g} times")
    notices: list[Notice] = []
    if len(turned) > len(heavy) / 2:
        notices.append(
            Notice(
                "not_physical",
                f"gravity as identified is not that of the known masses ({', '.join(turned[:4])}): "
                f"check the mounting ({robot.mount}), the joint order and signs",
            )
        )
    if scaled:
        notices.append(
            Notice(
                "unit_suspect",
                "gravity torques differ from those of the known masses: "
                f"{', '.join(scaled[:4])} as large; check the drive gains, the mounting "
                f"({robot.mount}) and what the robot carries",
            )
        )
    return tuple(notices)
