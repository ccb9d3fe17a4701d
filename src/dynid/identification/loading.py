"""The load that load-dependent friction depends on, from the data themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynid.core.arrays import Array
from dynid.identification.least_squares import PRIOR_GAIN, WeightedLeastSquares
from dynid.identification.problem import IdentificationProblem
from dynid.reduction.base import reduce_model
from dynid.regressor.load import LoadFriction
from dynid.regressor.model import InverseDynamicModel
from dynid.regressor.terms import FrictionTerms
from dynid.robot.model import RobotModel
from dynid.signals.samples import Samples

ITERATIONS = 3
"""Fits of parameters and load in turn; the load changes by a per mille after two."""


def with_load(
    model: InverseDynamicModel, samples: Samples, prior_gain: float | None
) -> InverseDynamicModel:
    """The model with the load of its load-dependent friction as these samples show it.

    Args:
        model: A model; one without load-dependent friction is returned as it is.
        samples: The samples that it will be fitted to.
        prior_gain: See `WeightedLeastSquares`.
    """
    load = model.friction.load
    if load is None:
        return model
    for _ in range(ITERATIONS):
        parameters = tuple(inertial_parameters(model, samples, prior_gain).tolist())
        found = LoadFriction(joints=load.joints, parameters=parameters)
        model = InverseDynamicModel(
            robot=model.robot, frames=model.frames, friction=replace(model.friction, load=found)
        )
    return model


def inertial_parameters(
    model: InverseDynamicModel, samples: Samples, prior_gain: float | None
) -> Array:
    """(10 n) inertial parameters of a weighted fit, zero outside the base."""
    base = reduce_model(model)
    fit = WeightedLeastSquares(prior_gain=prior_gain).fit(
        IdentificationProblem(base=base, samples=samples)
    )
    parameters = np.zeros(len(model.columns))
    parameters[list(base.independent)] = fit.values
    return parameters[: 10 * model.robot.joints]


def load_size(robot: RobotModel, frames: str, samples: Samples, width: float) -> Array:
    """(n, N) size of each gear's load [N.m or N], from a plain fit of the same samples.

    Args:
        robot: The robot.
        frames: Parameter frames.
        samples: The samples.
        width: Of the plain fit's Coulomb step [rad/s or m/s].
    """
    plain = InverseDynamicModel(robot=robot, frames=frames, friction=FrictionTerms(width=width))
    inertial = inertial_parameters(plain, samples, PRIOR_GAIN)
    parameters = np.append(inertial, np.zeros(len(plain.columns) - len(inertial)))
    carried = plain.inverse_dynamics(samples.q, samples.dq, samples.ddq, parameters)
    return np.abs(carried - plain.known_torque(samples.q)).T
