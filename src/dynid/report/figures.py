"""Figures of parameters, friction, identifiability and signals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynid.core import Array, InputError
from dynid.identification import Estimate
from dynid.reduction import BaseParametrization
from dynid.report.theme import (
    LIMIT,
    MEASURED,
    PALETTE,
    PREDICTED,
    Canvas,
    bar,
    colour,
    figure,
    joint_unit,
    label,
    line,
    log_axis,
    points,
    rounded,
    scatter,
    torque_unit,
)
from dynid.validation import ValidationResult

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


CONFIDENCE = 1.96
"""Standard deviations either side of a 95 % interval."""


def parameter_intervals(estimate: Estimate) -> Canvas:
    """Each base parameter with its 95 % interval, in one plot a unit.

    Args:
        estimate: The estimate; parameters that the data hardly speak about are drawn hollow.
    """
    units = list(dict.fromkeys(estimate.units))
    drawn = figure(
        len(units),
        title="Base parameters with 95 % intervals",
        x="",
        y=[f"[{unit}]" for unit in units],
        height=120 + 210 * len(units),
    )
    drawn.update_layout(hovermode="closest")
    std = estimate.std
    for row, unit in enumerate(units, start=1):
        chosen = [k for k, other in enumerate(estimate.units) if other == unit]
        solid = [k in estimate.essential for k in chosen]
        drawn.add_trace(
            scatter(
                x=[label(estimate.names[k]) for k in chosen],
                y=estimate.values[chosen],
                error_y={"type": "data", "array": CONFIDENCE * std[chosen], "thickness": 1.2},
                mode="markers",
                marker={
                    "color": PALETTE[(row - 1) % len(PALETTE)],
                    "symbol": ["circle" if full else "circle-open" for full in solid],
                    "size": 7,
                },
                name=unit,
                showlegend=False,
                customdata=[label(estimate.expressions[k], 120) for k in chosen],
                hovertemplate="%{customdata}<br>%{y:.4g}<extra></extra>",
            ),
            row=row,
            col=1,
        )
    drawn.update_layout(hovermode="closest")
    # Every parameter has its name, on a telephone too.
    drawn.update_xaxes(
        matches=None, showticklabels=True, tickangle=-90, dtick=1, tickfont={"size": 10}
    )
    return drawn


def parameter_changes(
    names: Sequence[str],
    change_percent: Sequence[float],
    std_percent: Sequence[float],
    *,
    first: str = "cold",
    second: str = "warm",
) -> Canvas:
    """How much each parameter changed, with 95 % intervals.

    Args:
        names: (r) parameters.
        change_percent: (r) change from the first estimate to the second [%].
        std_percent: (r) standard deviation of the change [%].
        first: What the first estimate is called.
        second: What the second estimate is called.
    """
    drawn = figure(
        title=f"Change of the parameters, {label(first)} to {label(second)}",
        x="",
        y="change [%]",
        height=420,
    )
    drawn.add_trace(
        bar(
            x=[label(name) for name in names],
            y=np.asarray(change_percent, dtype=float),
            error_y={
                "type": "data",
                "array": CONFIDENCE * np.asarray(std_percent, dtype=float),
                "thickness": 1.2,
            },
            marker_color=PALETTE[0],
            showlegend=False,
        )
    )
    drawn.add_hline(0, line={"color": LIMIT})
    drawn.update_xaxes(tickangle=-60)
    return drawn


def side_by_side(first: Estimate, second: Estimate, labels: tuple[str, str]) -> Canvas:
    """Friction of two estimates beside each other, as the paper draws cold and warm.

    Args:
        first: One estimate.
        second: Another with the same parameters.
        labels: What they are called.
    """
    friction = [k for k, name in enumerate(first.names) if name.startswith(("Fc", "Fv"))]
    units = " and ".join(dict.fromkeys(f"[{first.units[k]}]" for k in friction))
    drawn = figure(title="Friction of two runs", x="", y=units or "friction", height=420)
    for k, (estimate, name) in enumerate(zip((first, second), labels, strict=True)):
        drawn.add_trace(
            bar(
                x=[label(estimate.names[i]) for i in friction],
                y=estimate.values[friction],
                error_y={
                    "type": "data",
                    "array": CONFIDENCE * estimate.std[friction],
                    "thickness": 1.2,
                },
                name=label(name),
                marker_color=PALETTE[k],
            )
        )
    return drawn


SPECTRUM_FLOOR = 1e-9


def spectrum(
    values: Array, rate_hz: float, cutoff_hz: float, names: Sequence[str], what: str
) -> Canvas:
    """Amplitudes over frequency, with the cut-off.

    Args:
        values: (N, n) uniform samples.
        rate_hz: Their rate [Hz].
        cutoff_hz: Cut-off that was chosen [Hz].
        names: (n) joint names.
        what: What is shown, with its unit.
    """
    centred: Array = values - values.mean(axis=0)
    window = np.hanning(len(values))[:, None]
    amplitude = 2 * np.abs(np.fft.rfft(centred * window, axis=0)) / window.sum()
    frequency = np.arange(float(len(amplitude))) * (rate_hz / len(values))
    drawn = figure(
        title=f"Spectrum: {what}, cut-off {cutoff_hz:.3g} Hz", x="frequency [Hz]", y="amplitude"
    )
    for j, name in enumerate(names):
        drawn.add_trace(
            line(
                frequency[1:],
                np.maximum(amplitude[1:, j], SPECTRUM_FLOOR),
                label(name),
                color=colour(j),
            )
        )
    drawn.add_vline(cutoff_hz, line={"color": LIMIT, "dash": "dash"})
    drawn.update_xaxes(**log_axis(frequency[1:]))
    drawn.update_yaxes(type="log", exponentformat="power")
    return drawn


FLOOR = 1e-17
"""Singular values of zero, drawn here on a logarithmic axis."""


def singular_values(base: BaseParametrization) -> Canvas:
    """Singular values of the stacked regressor and their cumulative energy.

    Args:
        base: The base parametrization; the line stands at its rank.
    """
    values = np.asarray(base.singular_values)
    count = np.arange(1, len(values) + 1)
    energy = 100 * np.cumsum(values**2) / np.sum(values**2)
    drawn = figure(
        2,
        title=f"{base.rank} of {len(values)} directions can be identified",
        x="index",
        y=("singular value / largest", "cumulative energy [%]"),
        height=520,
    )
    for row, (series, name) in enumerate(
        ((np.maximum(values / values[0], FLOOR), "singular value"), (energy, "cumulative energy")),
        start=1,
    ):
        drawn.add_trace(
            scatter(
                x=count,
                y=rounded(series) if row == 2 else series,
                name=name,
                mode="lines+markers",
                line={"color": PALETTE[row - 1]},
                marker={"size": 5},
            ),
            row=row,
            col=1,
        )
        drawn.add_vline(base.rank + 0.5, line={"color": LIMIT, "dash": "dash"}, row=row, col=1)
    drawn.add_hline(base.tolerance, line={"color": LIMIT, "dash": "dot"}, row=1, col=1)
    drawn.update_yaxes(type="log", exponentformat="power", row=1, col=1)
    return drawn
