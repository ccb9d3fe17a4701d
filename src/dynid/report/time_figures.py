"""Figures over time: the motion with its limits, measured and predicted torque."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynid.core import Array
from dynid.report.theme import (
    LIMIT,
    MEASURED,
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
    torque_unit,
)
from dynid.trajectory import JointMotion, MotionBounds, Trajectory
from dynid.validation import MOVING_SPEED, Metrics, ValidationResult

SAMPLES = 1000


def trajectory(
    motion: Trajectory, names: Sequence[str], prismatic: Sequence[bool] = (False,)
) -> Canvas:
    """Positions, velocities and accelerations over one period.

    Args:
        motion: The trajectory.
        names: (n) joint names.
        prismatic: (n) which joints slide.
    """
    samples = motion.evaluate(np.linspace(0.0, motion.duration, SAMPLES))
    drawn = figure(
        3,
        title="Trajectory over one period",
        x="time [s]",
        y=[
            f"{what} [{joint_unit(unit, prismatic)}]"
            for what, unit in (
                ("position", "rad"),
                ("velocity", "rad/s"),
                ("acceleration", "rad/s\N{SUPERSCRIPT TWO}"),
            )
        ],
        height=640,
    )
    for row, part in enumerate((samples.q, samples.dq, samples.ddq), start=1):
        for j, name in enumerate(names):
            drawn.add_trace(
                line(samples.t, part[:, j], label(name), color=colour(j), legend=row == 1),
                row=row,
                col=1,
            )
    return drawn


def limit_usage(samples: JointMotion, bounds: MotionBounds, names: Sequence[str]) -> Canvas:
    """How much of each limit is used over time: 100 % is the limit.

    Args:
        samples: The motion.
        bounds: Its limits, NaN or infinite where unknown: these are not drawn.
        names: (n) joint names.
    """
    middle, half = (bounds.upper + bounds.lower) / 2, (bounds.upper - bounds.lower) / 2
    shares = (
        np.abs(samples.q - middle) / half,
        np.abs(samples.dq) / bounds.velocity,
        np.abs(samples.ddq) / bounds.acceleration,
    )
    drawn = figure(
        3,
        title="Use of the limits",
        x="time [s]",
        y=("position [%]", "velocity [%]", "acceleration [%]"),
        height=640,
    )
    for row, share in enumerate(shares, start=1):
        for j, name in enumerate(names):
            if np.isfinite(share[:, j]).all():
                drawn.add_trace(
                    line(
                        samples.t,
                        100 * share[:, j],
                        label(name),
                        color=colour(j),
                        legend=row == 1,
                    ),
                    row=row,
                    col=1,
                )
        drawn.add_hline(100, line={"color": LIMIT, "dash": "dash"}, row=row, col=1)
    return drawn


def safety_usage(t: Array, shares: Array, kinds: Sequence[str]) -> Canvas:
    """How much of each limit of the whole arm is used over time: 100 % is the limit.

    Args:
        t: (N) time [s].
        shares: (N, k) value over limit; NaN where a kind is not judged.
        kinds: (k) such as `torque` or `tcp_speed`.
    """
    drawn = figure(title="Use of the arm's limits", x="time [s]", y="share of the limit [%]")
    for k, kind in enumerate(kinds):
        if np.isfinite(shares[:, k]).all():
            drawn.add_trace(
                line(t, 100 * shares[:, k], label(kind.replace("_", " ")), color=colour(k))
            )
    drawn.add_hline(100, line={"color": LIMIT, "dash": "dash"})
    return drawn


def distances(t: Array, gaps: Array, pairs: Sequence[str], clearance: float) -> Canvas:
    """Distances between bodies over time.

    Args:
        t: (N) time [s].
        gaps: (N, k) distances [m], negative where bodies overlap.
        pairs: (k) names of the pairs.
        clearance: The smallest distance allowed [m].
    """
    drawn = figure(title="Distances between bodies", x="time [s]", y="distance [mm]")
    nearest = np.argsort(gaps.min(axis=0))[:8]
    for k, pair in enumerate(nearest):
        drawn.add_trace(line(t, 1000 * gaps[:, pair], label(pairs[int(pair)]), color=colour(k)))
    drawn.add_hline(1000 * clearance, line={"color": LIMIT, "dash": "dash"})
    return drawn


def convergence(evaluations: Array, best: Array, criterion: str) -> Canvas:
    """The best criterion so far over the evaluations of a design.

    Args:
        evaluations: (k) number of evaluations.
        best: (k) best value of the criterion so far.
        criterion: Its name.
    """
    drawn = figure(title="Search for the design", x="evaluations", y=label(criterion))
    drawn.add_trace(line(evaluations, best, label(criterion), color=colour(0), shape="hv"))
    if len(best) and (best > 0).all():
        drawn.update_yaxes(**log_axis(best))
    return drawn


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
