"""Figures of a result: torque, friction, links, rival models, parameters, residuals."""

from collections.abc import Sequence

import numpy as np

from dynid import figures as draw
from dynid.core import Array
from dynid.identification import CONFIDENCE, Estimate
from dynid.reduction import BaseParametrization
from dynid.report.contents import ReportedEstimate
from dynid.validation import ParameterComparison, ValidationResult

STANDSTILL_S = 0.1
"""Shorter stops are reversals."""
MAX_POINTS = 250
"""Of a cloud, a joint."""
LINK_HEIGHT = 34.0
"""Of a link's row [px]."""
TIME = "time"
"""Link of all plots over the time of the recording."""


def worst_first(result: ValidationResult) -> list[int]:
    """Joints by their relative error while moving, the worst first."""
    error = np.nan_to_num(result.moving.relative_error_percent, nan=-1.0)
    return np.argsort(-error, kind="stable").tolist()


def time_axis(result: ValidationResult) -> draw.Axis:
    """The time of a prediction."""
    first, last = float(result.t[0]), float(result.t[-1])
    return draw.Axis(low=first, high=max(last, first + 1e-3), label="time [s]")


def torque_panels(
    item: ReportedEstimate, result: ValidationResult, j: int
) -> tuple[draw.Panel, draw.Panel]:
    """Measured and predicted torque of a joint (from 0), and its residual on a scale of its own."""
    robot = item.estimate.model.robot
    name = draw.joint_labels(robot.joint_names)[j]
    unit = f"[{draw.joint_unit('N.m', robot.prismatic[j : j + 1])}]"
    t, measured, predicted = result.t, result.measured[:, j], result.predicted[:, j]
    error = measured - predicted
    moving = result.moves[:, j]
    still = draw.shaded(t, ~moving, STANDSTILL_S)
    events = (
        draw.Spans(still, name="standstill"),
        *(
            draw.Spans(stretches, role, name)
            for stretches, role, name in (
                (item.events.contacts, "contact", "contact"),
                (item.events.left_out, "panel", "left out"),
            )
            if stretches
        ),
    )
    usual = float(np.std(error[moving])) if moving.any() else float(np.std(error))
    reach = _rounded_up(max(4.0 * usual, 1e-6))
    told = item.estimate.assessment
    noise = 0.0 if told is None else float(told.sample_noise[j])
    edges = ([-2 * noise] * 2, [2 * noise] * 2)
    band = (draw.Band(t[[0, -1]], *edges, name="noise ±2 σ"),) if noise else ()  # noqa: RUF001
    return (
        draw.Panel(
            title=name,
            y=draw.axis_around(measured, predicted, label=unit, zero=True),
            marks=(
                *events,
                draw.Line(t, measured, "measured", "measured", 3.2),
                draw.Line(t, predicted, "predicted", "predicted", 1.4),
            ),
            height=62,
        ),
        draw.Panel(
            title=f"{name}, residual",
            y=draw.Axis(low=-reach, high=reach, label=unit, bounds=True),
            marks=(*events, *band, draw.Line(t, error, "residual", "residual", 0.8)),
            height=30,
        ),
    )


def _rounded_up(value: float) -> float:
    decade = 10.0 ** np.floor(np.log10(value))
    steps = (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10)
    return float(decade * next(s for s in steps if s * decade >= value))


def torque_figure(item: ReportedEstimate) -> draw.Figure | None:
    """All joints, the worst first; None without a prediction."""
    result = item.shown
    if result is None:
        return None
    panels = [p for j in worst_first(result) for p in torque_panels(item, result, j)]
    title = "Measured and predicted torque"
    return draw.Figure(title=title, x=time_axis(result), panels=tuple(panels), link=TIME)


def _friction_torque(estimate: Estimate, speeds: Array) -> Array:
    """Friction torques (N, n) of the model at speeds (N, n) [rad/s or m/s]."""
    model = estimate.model
    rest = np.zeros_like(speeds)
    parameters = np.array(estimate.standard_parameters())
    parameters[: 10 * model.robot.joints] = 0.0
    return model.inverse_dynamics(rest, speeds, rest, parameters)


def friction_figure(item: ReportedEstimate) -> draw.Figure | None:
    """Measured torque less the rigid body's, over velocity, with the model's friction.

    None without a prediction.
    """
    result, estimate = item.shown, item.estimate
    if result is None:
        return None
    robot = estimate.model.robot
    # Predicted less its friction is the rigid body; what is measured beyond it is friction.
    data = result.measured - result.predicted + _friction_torque(estimate, result.dq)
    reach = 1.03 * np.maximum(np.abs(result.dq).max(axis=0), 1e-3)
    wide, narrow = np.linspace(0.01, 1, 100), np.linspace(-0.01, 0.01, 41)[1:-1]
    steps = np.concatenate([-wide[::-1], narrow, wide])
    grid: Array = steps[:, None] * reach
    curve = _friction_torque(estimate, grid)
    known = dict(zip(estimate.names, zip(estimate.values, estimate.std, strict=True), strict=True))
    panels: list[draw.Panel] = []
    for j, name in enumerate(draw.joint_labels(robot.joint_names)):
        chosen = np.unique(np.linspace(0, len(data) - 1, MAX_POINTS).astype(int))
        marks: list[draw.Mark] = [
            draw.Points(result.dq[chosen, j], data[chosen, j], name="data", faint=True, size=4.5),
            draw.Line(grid[:, j], curve[:, j], "predicted", "identified", 2.2),
        ]
        if item.truth is not None:
            true = item.truth.coulomb[j] * np.sign(grid[:, j])
            true = true + item.truth.viscous[j] * grid[:, j]
            marks.append(draw.Line(grid[:, j], true, "truth", "ground truth", 1.6, "2 5"))
        said = [
            f"{symbol} {draw.number(float(known[f'{symbol}{j + 1}'][0]))} ± "
            f"{draw.number(CONFIDENCE * float(known[f'{symbol}{j + 1}'][1]), 2)}"
            for symbol in ("Fc", "Fv")
            if f"{symbol}{j + 1}" in known
        ]
        shown = np.percentile(np.abs(data[:, j]), 99.5)
        high = 1.08 * max(float(shown), float(np.abs(curve[:, j]).max()), 1e-6)
        panels.append(
            draw.Panel(
                title=name,
                note="\n".join(said),
                x=draw.Axis(low=-float(reach[j]), high=float(reach[j])),
                y=draw.Axis(low=-high, high=high),
                marks=tuple(marks),
                height=112,
                grid=True,
            )
        )
    torque, speed, viscous = (
        draw.joint_unit(unit, robot.prismatic) for unit in ("N.m", "rad/s", "N.m.s/rad")
    )
    return draw.Figure(
        title="Friction",
        note=f"Torque [{torque}] over speed [{speed}]; 95 % intervals of Fc [{torque}] and "
        f"Fv [{viscous}].",
        x=draw.Axis(low=-1, high=1, label=f"speed [{speed}]"),
        panels=tuple(panels),
        columns=3,
    )


def links_figure(item: ReportedEstimate) -> draw.Figure | None:
    """Masses and centres less those of the prior, with intervals, and how much of them is data.

    None where the links are not known.
    """
    found = item.links
    if found is None:
        return None
    names = draw.joint_labels(item.estimate.model.robot.joint_names)
    n, count = len(names), 10 * len(names)
    values, std, prior = (x[:count].reshape(n, 10) for x in (found.values, found.std, found.prior))
    share = 100 * (1 - found.prior_share[:count].reshape(n, 10))
    mass, known = np.maximum(np.abs(values[:, :1]), 1e-9), np.maximum(np.abs(prior[:, :1]), 1e-9)
    rows = np.arange(n, dtype=np.float64)
    places = rows[:, None] + np.array([-0.26, 0.0, 0.26])
    centre = 1000 * (values[:, 1:4] / mass - prior[:, 1:4] / known)
    # First order; mass and first moment taken as independent.
    spread = 1000 * np.hypot(std[:, 1:4] / mass, values[:, 1:4] / mass**2 * std[:, :1])
    change = 100 * (values[:, 0] / prior[:, 0] - 1)
    deviation = 100 * std[:, 0] / known[:, 0]
    truth = None if item.truth is None else item.truth.inertials
    true_mass = None if truth is None else 100 * (truth[:, 0] / prior[:, 0] - 1)
    true_centre = None
    if truth is not None:
        true_centre = 1000 * (truth[:, 1:4] / truth[:, :1] - prior[:, 1:4] / known)
    masses = [draw.number(float(value)) for value in values[:, 0]]
    around = [draw.number(CONFIDENCE * float(value), 2) for value in std[:, 0]]
    labels = [
        f"{name}  {masses[k]}{f' ± {around[k]}' if share[k, 0] > 1 else ''} kg"
        for k, name in enumerate(names)
    ]
    data = (share[:, 0], share[:, 1:4].mean(axis=1), share[:, 4:10].mean(axis=1))
    return draw.Figure(
        title="Links",
        note="Identified less the prior (published, or plausible), 95 % intervals; centre x, y, z "
        "from top to bottom. Each link is named by the joint that moves it.",
        x=draw.Axis(low=0, high=1),
        panels=(
            _from_prior("Mass [%]", labels, rows, change, deviation, share[:, 0], true_mass),
            _from_prior(
                "Centre of mass [mm]", names, places, centre, spread, share[:, 1:4], true_centre
            ),
            draw.Panel(
                title="From data [%]",
                note="mass, centre, inertia",
                x=draw.Axis(low=0, high=100),
                y=draw.category_axis(names),
                marks=tuple(
                    draw.Bars(at, part, thickness=0.2, across=True)
                    for at, part in zip(places.T, data, strict=True)
                ),
                height=LINK_HEIGHT * n,
                grid=True,
            ),
        ),
        columns=3,
        rows=True,
    )


def _from_prior(
    title: str,
    names: Sequence[str],
    at: Array,
    values: Array,
    std: Array,
    share: Array,
    truth: Array | None,
) -> draw.Panel:
    """Differences from the prior at places on an axis of names, by how much of them is data [%]."""
    at, values, std, data = at.ravel(), values.ravel(), std.ravel(), share.ravel() >= 50
    true = [] if truth is None else [truth.ravel()]
    sizes = np.concatenate([np.abs(values) + CONFIDENCE * std, *map(np.abs, true)])
    # A link that only the prior knows must not set the scale of all others.
    reach = max(1.1 * float(np.nanpercentile(sizes, 95)), 1e-3)
    low, high = values - CONFIDENCE * std, values + CONFIDENCE * std
    return draw.Panel(
        title=title,
        x=draw.Axis(low=-reach, high=reach),
        y=draw.category_axis(names),
        marks=(
            draw.Level(0.0, "limit", upright=True, dash=""),
            *(draw.Ranges(x, at - 0.13, at + 0.13, "truth", "ground truth", 2.2) for x in true),
            draw.Ranges(at[data], low[data], high[data], "predicted", width=1.6, across=True),
            draw.Points(values[data], at[data], "predicted", "from data", 7),
            draw.Ranges(at[~data], low[~data], high[~data], "limit", width=1.2, across=True),
            draw.Points(values[~data], at[~data], "limit", "mostly prior", 7, hollow=True),
        ),
        height=LINK_HEIGHT * len(names),
        grid=True,
    )


MODEL_NAMES = {
    "published": "published inertias",
    "published_friction": "published inertias, identified friction",
    "identified": "everything identified",
}
MODEL_ROLES = {"published": "published", "published_friction": "joint5", "identified": "predicted"}


def models_figure(item: ReportedEstimate) -> draw.Figure | None:
    """Errors of rival models on data left out, joint by joint; None where they are not known."""
    told = item.estimate.assessment
    if told is None or not told.models:
        return None
    shown = {name: x for name, x in told.models.items() if name != "published"} or told.models
    width, rows = 0.8 / len(shown), np.arange(len(told.torque), dtype=np.float64)
    errors = [100 * rms / np.maximum(told.torque, 1e-9) for rms in shown.values()]
    marks = tuple(
        draw.Bars(
            rows + (k - (len(shown) - 1) / 2) * width,
            error,
            MODEL_ROLES.get(name, "predicted"),
            MODEL_NAMES.get(name, name),
            thickness=0.9 * width,
            across=True,
        )
        for k, (name, error) in enumerate(zip(shown, errors, strict=True))
    )
    highest = max(1.08 * float(np.max(errors)), 1e-6)
    names = draw.category_axis(draw.joint_labels(item.estimate.model.robot.joint_names))
    return draw.Figure(
        title="Error by joint [% of RMS torque], on data left out",
        x=draw.Axis(low=0, high=highest),
        panels=(draw.Panel(y=names, marks=marks, height=22.0 * len(rows), grid=True),),
    )


def parameter_figure(estimate: Estimate) -> draw.Figure:
    """Each base parameter with its 95 % interval; those that are not essential are hollow."""
    kinds = list(dict.fromkeys(estimate.units))
    panels: list[draw.Panel] = []
    for unit in kinds:
        chosen = [k for k, other in enumerate(estimate.units) if other == unit]
        values, half = estimate.values[chosen], CONFIDENCE * estimate.std[chosen]
        solid = np.array([k in estimate.essential for k in chosen])
        rows = np.arange(len(chosen), dtype=np.float64)
        panels.append(
            draw.Panel(
                title=f"[{draw.units(unit)}]",
                x=draw.axis_around(values - half, values + half, zero=True),
                y=draw.category_axis([estimate.names[k] for k in chosen]),
                marks=(
                    draw.Level(0.0, upright=True, dash=""),
                    draw.Ranges(rows, values - half, values + half, "predicted", across=True),
                    draw.Points(values[solid], rows[solid], "predicted", "essential", 6),
                    draw.Points(
                        values[~solid], rows[~solid], "predicted", "not essential", 6, hollow=True
                    ),
                ),
                height=max(15.0 * len(chosen), 40.0),
                grid=True,
            )
        )
    return draw.Figure(
        title="Base parameters with 95 % intervals",
        x=draw.Axis(low=0, high=1),
        panels=tuple(panels),
        columns=min(3, len(panels)),
    )


def changes_figure(first: str, second: str, compared: ParameterComparison) -> draw.Figure | None:
    """How friction changed from one estimate to another, with 95 % intervals."""
    chosen = [k for k, name in enumerate(compared.names) if name.startswith(("Fc", "Fv"))]
    if not chosen:
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        half = CONFIDENCE * np.abs(compared.change_percent[chosen] / compared.z[chosen])
    change, at = compared.change_percent[chosen], np.arange(len(chosen), dtype=np.float64)
    return draw.Figure(
        title=f"Change of friction [%], {first} to {second}",
        x=draw.category_axis([compared.names[k] for k in chosen]),
        panels=(
            draw.Panel(
                y=draw.axis_around(change - half, change + half, zero=True),
                marks=(
                    draw.Bars(at, change, "predicted", "change", 0.6),
                    draw.Ranges(at, change - half, change + half, "ink", "95 % interval"),
                ),
                height=140,
            ),
        ),
    )


def singular_figure(base: BaseParametrization) -> draw.Figure:
    """Singular values of the stacked regressor; the upright line stands at the rank."""
    values = np.asarray(base.singular_values)
    count = np.arange(1.0, len(values) + 1)
    relative = np.maximum(values / values[0], 1e-17)
    return draw.Figure(
        title=f"{base.rank} of {len(values)} directions are identifiable",
        x=draw.Axis(low=0, high=len(values) + 1.0, label="index"),
        panels=(
            draw.Panel(
                title="Singular value over the largest",
                y=draw.axis_around(relative, log=True),
                marks=(
                    draw.Level(base.tolerance, name="tolerance"),
                    draw.Level(base.rank + 0.5, upright=True),
                    draw.Points(count, relative, "predicted", size=4),
                ),
                height=140,
            ),
        ),
    )


def residual_figure(item: ReportedEstimate, result: ValidationResult) -> draw.Figure:
    """Residuals over velocity: a shape in a cloud is something that the model lacks."""
    robot = item.estimate.model.robot
    error = result.measured - result.predicted
    chosen = np.unique(np.linspace(0, len(error) - 1, 2 * MAX_POINTS).astype(int))
    panels = [
        draw.Panel(
            title=name,
            x=draw.axis_around(result.dq[:, j], even=True),
            y=draw.axis_around(np.percentile(error[:, j], [0.5, 99.5]), even=True),
            marks=(
                draw.Points(result.dq[chosen, j], error[chosen, j], "residual", size=3, faint=True),
            ),
            height=110,
            grid=True,
        )
        for j, name in enumerate(draw.joint_labels(robot.joint_names))
    ]
    return draw.Figure(
        title=f"Residual [{draw.joint_unit('N.m', robot.prismatic)}] over velocity",
        x=draw.Axis(
            low=-1, high=1, label=f"velocity [{draw.joint_unit('rad/s', robot.prismatic)}]"
        ),
        panels=tuple(panels),
        columns=3,
    )


LAGS = 200


def correlation_figure(item: ReportedEstimate, result: ValidationResult) -> draw.Figure:
    """Autocorrelation of the residuals; white ones stay inside the dashed lines."""
    error = result.measured - result.predicted
    error = error - error.mean(axis=0)
    lags = min(LAGS, len(error) - 1)
    size = 1 << (2 * len(error) - 1).bit_length()
    power = np.abs(np.fft.rfft(error, size, axis=0)) ** 2
    raw = np.fft.irfft(power, size, axis=0)[: lags + 1]
    scale = np.where(raw[0] > 0, raw[0], 1.0)
    bound = CONFIDENCE / np.sqrt(len(error))
    names = draw.joint_labels(item.estimate.model.robot.joint_names)
    curves = [
        draw.Line(np.arange(lags + 1.0), raw[:, j] / scale[j], draw.joint_role(j), name)
        for j, name in enumerate(names)
    ]
    marks = (draw.Level(bound, name="95 % of white noise"), draw.Level(-bound), *curves)
    return draw.Figure(
        title="Autocorrelation of the residuals",
        x=draw.Axis(low=0, high=float(lags), label="lag [samples]"),
        panels=(draw.Panel(y=draw.Axis(low=-1, high=1), marks=marks, height=140),),
    )
