"""Measured and predicted torques, and what is left (the paper's Figure 3)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynid.core.arrays import Array
from dynid.figures.canvas import Canvas, bar
from dynid.figures.theme import (
    LIMIT,
    MEASURED,
    PREDICTED,
    colour,
    figure,
    joint_unit,
    label,
    line,
    points,
    torque_unit,
)
from dynid.validation.metrics import MOVING_SPEED, Metrics
from dynid.validation.prediction import ValidationResult

CONFIDENCE = 1.96
LAGS = 200


def prediction(result: ValidationResult, names: Sequence[str], prismatic: Sequence[bool]) -> Canvas:
    """Measured and predicted torque of each joint.

    Args:
        result: Prediction of a record.
        names: (n) joint names.
        prismatic: (n) which joints slide.
    """
    drawn = figure(
        len(names),
        title="Measured and predicted torque",
        x="time [s]",
        y=[f"[{torque_unit(slides)}]" for slides in prismatic],
        titles=names,
    )
    for j in range(len(names)):
        for values, name, color, width in (
            (result.measured, "measured", MEASURED, 2.4),
            (result.predicted, "predicted", PREDICTED, 1.1),
        ):
            trace = line(result.t, values[:, j], name, color=color, legend=j == 0, width=width)
            drawn.add_trace(trace, row=j + 1, col=1)
    return drawn


def residuals(
    result: ValidationResult,
    names: Sequence[str],
    *,
    against: Array | None = None,
    what: str | None = None,
    prismatic: Sequence[bool] = (),
) -> Canvas:
    """Prediction errors as points, over velocity or anything else.

    Args:
        result: Prediction of a record.
        names: (n) joint names.
        against: (N, n) or (N) values of the x axis; None for the velocities.
        what: Label of the x axis, with its unit; None for that of velocities.
        prismatic: (n) which joints slide; empty for none.
    """
    slides = tuple(prismatic) or (False,) * len(names)
    axis = what or f"velocity [{joint_unit('rad/s', slides)}]"
    values = result.dq if against is None else np.asarray(against)
    columns = values if values.ndim == 2 else np.repeat(values[:, None], len(names), axis=1)
    error = result.measured - result.predicted
    drawn = figure(
        len(names),
        title=f"Residuals over {axis}",
        x=axis,
        y=[f"residual [{torque_unit(sliding)}]" for sliding in slides],
        titles=names,
    )
    for j in range(len(names)):
        drawn.add_trace(
            points(columns[:, j], error[:, j], "residual", color=colour(j), legend=False),
            row=j + 1,
            col=1,
        )
    drawn.update_layout(hovermode="closest")
    return drawn


def autocorrelations(result: ValidationResult, names: Sequence[str]) -> Canvas:
    """Autocorrelation of the residuals; white ones stay inside the dashed lines.

    Args:
        result: Prediction of a record.
        names: (n) joint names.
    """
    error = result.measured - result.predicted
    error = error - error.mean(axis=0)
    lags = min(LAGS, len(error) - 1)
    size = 1 << (2 * len(error) - 1).bit_length()
    power = np.abs(np.fft.rfft(error, size, axis=0)) ** 2
    raw = np.fft.irfft(power, size, axis=0)[: lags + 1]
    scale = np.where(raw[0] > 0, raw[0], 1.0)
    drawn = figure(title="Autocorrelation of the residuals", x="lag [samples]", y="correlation")
    lag = np.arange(lags + 1.0)
    for j, name in enumerate(names):
        drawn.add_trace(line(lag, raw[:, j] / scale[j], label(name), color=colour(j)))
    bound = CONFIDENCE / np.sqrt(len(error))
    for value in (-bound, bound):
        drawn.add_hline(value, line={"color": LIMIT, "dash": "dash"})
    return drawn


def moving_and_at_rest(
    result: ValidationResult, names: Sequence[str], prismatic: Sequence[bool] = (False,)
) -> Canvas:
    """RMS errors of moving joints and of joints at rest.

    Args:
        result: Prediction of a record.
        names: (n) joint names.
        prismatic: (n) which joints slide.
    """
    slowest = f"{MOVING_SPEED} {joint_unit('rad/s', prismatic)}"
    drawn = figure(
        title=f"Errors of moving joints (above {slowest}) and at rest",
        x="joint",
        y=f"RMS error [{joint_unit('N.m', prismatic)}]",
    )
    parts: tuple[tuple[Metrics, str], ...] = (
        (result.moving, "moving"),
        (result.at_rest, "at rest"),
    )
    for k, (part, name) in enumerate(parts):
        drawn.add_trace(
            bar(
                x=[label(joint) for joint in names],
                y=np.nan_to_num(part.rmse),
                name=name,
                marker_color=colour(k),
            )
        )
    return drawn
