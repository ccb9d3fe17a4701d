"""The appendix: everything else, folded, as tables and figures."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dynid import core, identification, validation
from dynid import figures as draw
from dynid.report import figures, screens
from dynid.report.contents import JudgedMotion, ReportContents, ReportedDesign, ReportedEstimate

SAMPLES = 1000
QUANTITIES = (("position", "rad"), ("velocity", "rad/s"), ("acceleration", "rad/s^2"))


def design_figures(item: ReportedDesign) -> tuple[draw.Figure, ...]:
    """All figures of a design."""
    judged = () if item.judged is None else _arm_figures(item.judged, item.name)
    search = () if item.search is None else (_search_figure(item, *item.search),)
    return (_motion_figure(item), *judged, *search)


def _motion_figure(item: ReportedDesign) -> draw.Figure:
    """Positions, velocities and accelerations, and what they use of their limits."""
    names, slides = draw.joint_labels(item.robot.joint_names), item.robot.prismatic
    motion = item.trajectory.evaluate(np.linspace(0.0, item.trajectory.duration, SAMPLES))
    middle = (item.bounds.upper + item.bounds.lower) / 2
    half = (item.bounds.upper - item.bounds.lower) / 2
    used = (
        np.abs(motion.q - middle) / half,
        np.abs(motion.dq) / item.bounds.velocity,
        np.abs(motion.ddq) / item.bounds.acceleration,
    )
    panels: list[draw.Panel] = []
    for (what, unit), values, share in zip(
        QUANTITIES, (motion.q, motion.dq, motion.ddq), used, strict=True
    ):
        known = np.isfinite(share).all(axis=0)
        most = 100 * share[:, known].max(initial=0.0)
        largest = f", at most {most:.0f} % of its limit"
        panels.append(
            draw.Panel(
                title=f"{what.capitalize()} [{draw.joint_unit(unit, slides)}]"
                + (largest if known.any() else ""),
                y=draw.axis_around(values, zero=True),
                marks=tuple(
                    draw.Line(motion.t, values[:, j], draw.joint_role(j), name)
                    for j, name in enumerate(names)
                ),
                height=110,
            )
        )
    return draw.Figure(
        title="One period",
        x=draw.Axis(low=0, high=item.trajectory.duration, label="time [s]"),
        panels=tuple(panels),
        link=f"period {item.name}",
    )


def _arm_figures(judged: JudgedMotion, name: str) -> Iterator[draw.Figure]:
    """Shares of the limits of the whole arm, and distances beyond what must be kept."""
    for title, curves, unit, level in (
        ("Share of the arm's limits [%]", judged.shares, 100.0, 100.0),
        ("Distance beyond the clearance [mm]", judged.distances, 1000.0, 0.0),
    ):
        known = {kind: unit * row for kind, row in curves.items() if np.isfinite(row).all()}
        if known:
            lines = (
                draw.Line(judged.t, known[kind], draw.joint_role(k), kind.replace("_", " "))
                for k, kind in enumerate(curves)
                if kind in known
            )
            yield draw.Figure(
                title=title,
                x=draw.Axis(low=0, high=float(judged.t[-1]), label="time [s]"),
                panels=(
                    draw.Panel(
                        y=draw.axis_around(*known.values(), [level], zero=True),
                        marks=(draw.Level(level, name="limit"), *lines),
                    ),
                ),
                link=name,
            )


def _search_figure(item: ReportedDesign, count: core.Array, best: core.Array) -> draw.Figure:
    criterion = dict(item.facts).get("criterion", "criterion")
    return draw.Figure(
        title=f"Search: best {criterion} so far",
        x=draw.axis_around(count, label="objective evaluations", zero=True),
        panels=(
            draw.Panel(
                y=draw.axis_around(best, log=bool((best > 0).all())),
                marks=(draw.Line(np.repeat(count, 2)[1:], np.repeat(best, 2)[:-1]),),
            ),
        ),
    )


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of text."""

    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]

    @property
    def numeric(self) -> tuple[bool, ...]:
        """Which columns hold numbers alone, and stand right below each other."""
        cells = list(zip(*self.rows, strict=True)) if any(self.columns) else []
        found = tuple(any(column) and all(map(_is_number, column)) for column in cells)
        return found or (False,) * len(self.columns)


@dataclass(frozen=True, slots=True)
class Chapter:
    """What one fold of the appendix shows."""

    title: str
    tables: Sequence[Table] = ()
    figures: Sequence[draw.Figure] = ()
    words: str = ""


def chapters(contents: ReportContents) -> Iterator[Chapter]:
    """All folds, in the order in which they are asked for."""
    item = contents.estimates[0]
    if item.warnings:
        rows = [(f.severity, f.text, f.next_step or "") for f in item.warnings]
        columns = ("severity", "finding", "next step")
        yield Chapter(f"Findings ({len(rows)})", [Table(columns, rows)])
    if item.shown is not None:
        words = "A joint at rest can hold any torque within its stiction: judge by moving joints."
        yield Chapter("Errors by joint", [_errors(item, item.shown)], words=words)
    if (poses := _poses_figure(item)) is not None:
        words = "Do not use the model at poses where a curve comes near the RMS torque."
        yield Chapter("Where to use it", figures=[poses], words=words)
    yield _parameters(item)
    if item.links is not None:
        yield _standard(item, item.links)
    if item.shown is not None:
        words = "A shape in a cloud is what the model lacks: a step at zero velocity is friction."
        drawn = [
            figures.residual_figure(item, item.shown),
            figures.correlation_figure(item, item.shown),
        ]
        yield Chapter("Residuals", figures=drawn, words=words)
    if item.base is not None:
        yield Chapter("Identifiability", figures=[figures.singular_figure(item.base)])
    if len(contents.estimates) > 1:
        yield _others(contents)
    for first, second, compared in contents.comparisons:
        changes = figures.changes_figure(first, second, compared)
        own = [told for told in compared.warnings if told.kind in validation.OF_COMPARISON]
        rows = [
            (
                group.name,
                "moved" if group.moved else "did not move",
                draw.number(group.median_change_percent),
                "" if group.largest is None else compared.names[group.largest],
                draw.number(group.largest_z),
                draw.number(group.limit_z),
            )
            for group in compared.groups
        ]
        yield Chapter(
            f"Change from {first} to {second}",
            [Table(("group", "", "median change [%]", "largest", "z", "limit of z"), rows)],
            [] if changes is None else [changes],
            " ".join(
                [
                    "Inertias do not change with temperature: they are the control group. If they "
                    "moved, something else than friction differs between the two recordings.",
                    *(f"{told.message[:1].upper()}{told.message[1:]}." for told in own),
                ]
            ),
        )
    for design in contents.designs:
        facts = [Table(("", ""), design.facts)] if design.facts else []
        yield Chapter(f"Motion: {design.name}", facts, design_figures(design))
    yield from _made(contents)


def _errors(item: ReportedEstimate, shown: validation.ValidationResult) -> Table:
    robot = item.estimate.model.robot
    unit = draw.joint_unit("N.m", robot.prismatic)
    whole, moving = shown.metrics, shown.moving
    parts = (whole.rmse, moving.rmse, whole.relative_error_percent, moving.relative_error_percent)
    rows = [
        (name, *(draw.number(float(part[j])) for part in parts), draw.number(float(whole.r2[j])))
        for j, name in enumerate(draw.joint_labels(robot.joint_names))
    ]
    for kind, errors in validation.errors_by_kind(
        shown.measured, shown.predicted, shown.moves, robot.prismatic
    ).items():
        overall = (draw.number(part.relative_error_overall_percent) for part in errors)
        rows.append((f"{kind} joints", "", "", *overall, ""))
        (every, _), of_kind = errors, "" if kind == "all" else f", {kind} joints"
        label = f"e_N{of_kind} (N = {every.samples})"
        rows.append((label, draw.number(every.normalized_error), "", "", "", ""))
    columns = (f"RMS [{unit}]", f"RMS, moving [{unit}]", "relative [%]", "relative, moving [%]")
    return Table(("joint", *columns, "R²"), rows)


def _poses_figure(item: ReportedEstimate) -> draw.Figure | None:
    estimate = item.estimate
    known, robot, seen = estimate.assessment, estimate.model.robot, estimate.motion
    if known is None:
        return None
    panels: list[draw.Panel] = []
    for j, found in enumerate(validation.uncertainty_over_poses(estimate)):
        scale = 1.0 if robot.prismatic[j] else 180.0 / np.pi
        at, recorded = scale * found.position, scale * np.array([seen.lower[j], seen.upper[j]])
        torque = float(known.torque[j])
        panels.append(
            draw.Panel(
                title=draw.joint_labels(robot.joint_names)[j],
                # Of a slide without limits that stood at zero, no other place is known.
                x=draw.Axis(low=float(at[0]), high=max(float(at[-1]), float(at[0]) + 1e-3)),
                y=draw.Axis(low=0.0, high=1.1 * max(float(found.anywhere.max()), torque)),
                marks=(
                    draw.Spans([tuple(recorded.tolist())], name="recorded range"),
                    draw.Level(torque, name="RMS torque of the recording"),
                    draw.Line(at, found.anywhere, "predicted", "other joints anywhere", 2.0),
                    draw.Line(at, found.near, "truth", "other joints as recorded", 1.6, "2 5"),
                ),
                height=112,
                grid=True,
            )
        )
    return draw.Figure(
        title="Uncertainty over poses",
        note=f"Half widths of 90 % intervals [{draw.joint_unit('N.m', robot.prismatic)}] that nine "
        "of ten poses do not exceed, at half of the recorded speed.",
        x=draw.Axis(low=-1, high=1, label=f"position [{draw.joint_unit('deg', robot.prismatic)}]"),
        panels=tuple(panels),
        columns=3,
    )


def _parameters(item: ReportedEstimate) -> Chapter:
    estimate = item.estimate
    relative = estimate.relative_std_percent
    rows = [
        (
            name,
            draw.number(float(estimate.values[k]), 4),
            draw.units(estimate.units[k]),
            draw.number(float(estimate.std[k]), 2),
            draw.number(float(relative[k]), 2),
            "" if k in estimate.essential else "not essential",
            estimate.expressions[k],
        )
        for k, name in enumerate(estimate.names)
    ]
    return Chapter(
        f"Base parameters ({len(rows)})",
        [Table(("name", "value", "unit", "std", "std [%]", "", "combination"), rows)],
        [figures.parameter_figure(estimate)],
        f"{len(rows)} combinations of the {len(estimate.model.columns)} standard parameters are "
        "identifiable. The last column says which combination a name stands for. Standard "
        "deviations allow for autocorrelated residuals. Without those that are not essential, the "
        "relative deviations of all others are within a factor of 30 (Pham and Gautier 1991).",
    )


def _standard(item: ReportedEstimate, found: identification.StandardParameters) -> Chapter:
    rows = [
        (
            column.name,
            draw.number(float(found.values[k]), 4),
            draw.units(column.unit),
            draw.number(float(found.std[k]), 2),
            draw.number(float(found.prior[k]), 4) if np.isfinite(found.prior[k]) else "",
            draw.number(float(100 * (1 - found.prior_share[k])), 2),
        )
        for k, column in enumerate(item.estimate.model.columns)
    ]
    words = "The prior, published or plausible, corrected by the base parameters."
    if item.estimate.standard is not None:
        words = "Of physically consistent bodies."
    columns = ("name", "value", "unit", "std", "prior", "from data [%]")
    return Chapter(f"Standard parameters ({len(rows)})", [Table(columns, rows)], words=words)


def _others(contents: ReportContents) -> Chapter:
    rows: list[tuple[str, ...]] = []
    for item in contents.estimates:
        error = None if item.errors is None else item.errors.moving
        rows.append(
            (
                item.label or item.name,
                screens.LEVEL_WORDS[item.level],
                draw.number(error, 2),
                str(len(item.estimate.values)),
                item.estimate.estimator,
                item.name,
            )
        )
    columns = ("estimate", "prediction", "error, moving [%]", "parameters", "estimator", "file")
    words = "This page shows the first one."
    return Chapter(f"All estimates ({len(rows)})", [Table(columns, rows)], words=words)


def _made(contents: ReportContents) -> Iterator[Chapter]:
    tables: list[Table] = []
    for item in contents.estimates:
        made = item.estimate.provenance
        rows = [
            ("estimate", item.name),
            ("made", made.created),
            ("estimator", f"{item.estimate.estimator}, preset {item.estimate.preset}"),
            ("samples in the fit", str(item.estimate.samples)),
            ("condition number of the motion", draw.number(item.estimate.motion_condition_number)),
            ("condition number of the regressor", draw.number(item.estimate.condition_number)),
            *((f"version of {name}", value) for name, value in made.versions.items()),
            *((f"input {name}", f"SHA-256 {value}") for name, value in made.inputs.items()),
            *(
                (f"setting {name}", str(value))
                for name, value in made.settings.items()
                if value not in (None, "")
            ),
            *((("seed", str(made.seed)),) if made.seed is not None else ()),
            *(("chosen", choice) for choice in item.estimate.choices),
        ]
        tables.append(Table(("", ""), rows))
    words = "Files, versions, settings and seeds that give the same numbers again."
    yield Chapter("Provenance", tables, words=words)
    if contents.skipped:
        table = Table(("file", "reason"), contents.skipped)
        yield Chapter(f"Files left out ({len(contents.skipped)})", [table])


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace("\N{MINUS SIGN}", "-"))
    except ValueError:
        return cell in ("", "\N{EN DASH}")
    return True
