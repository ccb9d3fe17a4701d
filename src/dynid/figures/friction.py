"""Friction over velocity: what was measured and what the model says."""

from __future__ import annotations

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.figures.canvas import Canvas
from dynid.figures.theme import (
    MEASURED,
    PREDICTED,
    figure,
    joint_unit,
    line,
    points,
    torque_unit,
)
from dynid.identification.estimate import Estimate
from dynid.validation.prediction import ValidationResult

CURVE = 400


def friction_curve(estimate: Estimate, speeds: Array) -> Array:
    """Friction torques (N, n) of the model at speeds (N, n): its columns beside the inertial ones.

    Args:
        estimate: The estimate.
        speeds: (N, n) joint velocities [rad/s or m/s].
    """
    model = estimate.model
    rest = np.zeros_like(speeds)
    parameters = np.array(estimate.standard_parameters())
    parameters[: 10 * model.robot.joints] = 0.0
    return model.inverse_dynamics(rest, speeds, rest, parameters)


def friction_figure(estimate: Estimate, result: ValidationResult) -> Canvas:
    """Measured torque less the rigid body's, over velocity, with the model's friction.

    Args:
        estimate: The estimate.
        result: Its prediction of a record.

    Raises:
        InputError: A prediction of another robot.
    """
    robot = estimate.model.robot
    if result.dq.shape[1] != robot.joints:
        raise InputError("joints of the prediction", value=result.dq.shape[1], limit=robot.joints)
    # Predicted less its friction is the rigid body; what is measured beyond it is friction.
    data = result.measured - result.predicted + friction_curve(estimate, result.dq)
    reach = np.abs(result.dq).max(axis=0)
    grid: Array = np.linspace(-1.0, 1.0, CURVE)[:, None] * reach
    curve = friction_curve(estimate, grid)
    drawn = figure(
        robot.joints,
        title="Friction over velocity",
        x=f"velocity [{joint_unit('rad/s', robot.prismatic)}]",
        y=[f"[{torque_unit(slides)}]" for slides in robot.prismatic],
        titles=robot.joint_names,
    )
    for j in range(robot.joints):
        drawn.add_trace(
            points(result.dq[:, j], data[:, j], "measured", color=MEASURED, legend=j == 0),
            row=j + 1,
            col=1,
        )
        drawn.add_trace(
            line(grid[:, j], curve[:, j], "model", color=PREDICTED, legend=j == 0),
            row=j + 1,
            col=1,
        )
    drawn.update_layout(hovermode="closest")
    return drawn
