"""How large the base parameters of a robot are, before they are known."""

from __future__ import annotations

import numpy as np

from dynid.core.arrays import Array, read_only
from dynid.reduction.base import BaseParametrization
from dynid.regressor.model import InverseDynamicModel
from dynid.robot.model import RobotModel

FRICTION_SHARE = 0.1
"""Of a joint's torque limit that Coulomb friction takes; viscous friction at full speed alike."""
FULL_SPEED_AFTER = 0.2
"""[s] at the acceleration where a motor's inertia takes the same share, if no limit is known."""
LEAST_SHARE = 0.01
"""No parameter is taken for smaller than this share of the largest with its unit."""


def prior_scale(robot: RobotModel, base: BaseParametrization) -> Array:
    """(b) magnitudes D of the base parameters, in their units.

    Where the robot gives masses, a first moment is as large as the mass times the largest of the
    distance to the centre of mass and the radius of gyration, an inertia as the mass times its
    square. Where it gives torque and speed limits, friction takes a tenth of the torque at any
    speed and at full speed, motor inertia at the largest acceleration. Anything else is 1. A base
    parameter is as large as what is regrouped into it, added as if unrelated.
    """
    standard = np.concatenate([_inertial(robot), _beside(base.model)])
    parts = base.regrouping * standard[list(base.dependent)]
    scale = np.hypot(standard[list(base.independent)], np.linalg.norm(parts, axis=1))
    units = np.array(base.units)
    for unit in set(base.units):
        same = units == unit
        scale[same] = np.maximum(scale[same], LEAST_SHARE * scale[same].max())
    return read_only(scale)


def _inertial(robot: RobotModel) -> Array:
    out = np.ones((robot.joints, 10))
    for link, given in zip(out, robot.inertias, strict=True):
        mass = given[0]
        if not (np.isfinite(mass) and mass > 0):
            continue
        moment, inertia = np.nan_to_num(given[1:4]), np.nan_to_num(given[4:7])
        squares = (float(moment @ moment) / mass**2, float(inertia.max()) / mass)
        length = np.sqrt(max(squares))
        if length > 0:
            link[0], link[1:4], link[4:] = mass, mass * length, mass * length**2
    return out.ravel()


def _beside(model: InverseDynamicModel) -> Array:
    limits = model.robot.limits
    torque = FRICTION_SHARE * limits.torque
    acceleration = np.where(
        np.isfinite(limits.acceleration), limits.acceleration, limits.velocity / FULL_SPEED_AFTER
    )
    sizes = {"": torque, "speed": torque / limits.velocity, "acceleration": torque / acceleration}
    columns = model.columns[10 * model.robot.joints :]
    found = np.array([sizes[_multiplies(column.unit)][column.joint] for column in columns])
    return np.where(np.isfinite(found), found, 1.0)


def _multiplies(unit: str) -> str:
    """What a parameter of this unit multiplies to give a torque or a force."""
    if unit in ("kg.m^2", "kg"):
        return "acceleration"
    return "speed" if "s/" in unit else ""
