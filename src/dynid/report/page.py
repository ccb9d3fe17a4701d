"""The pages of a run and of a fleet: files that need nothing else; and their figures as files."""

from collections.abc import Iterator, Sequence
from html import escape
from importlib.metadata import version
from importlib.resources import files
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from dynid import figures as draw
from dynid.core import Array, InputError, make_folder, require, require_absent, write_text
from dynid.identification import CONFIDENCE, JointState, Trend
from dynid.report import appendix, figures, screens
from dynid.report.contents import ReportContents, ReportedEstimate

DAY_S, PLOT_HEIGHT = 86400.0, 90.0
STYLE = """body{font:15px/1.5 var(--font);margin:0 auto;max-width:1120px;padding:16px;
background:var(--ground);color:var(--ink)}h1{font-size:1.5rem}p{max-width:80ch}
summary{cursor:pointer;padding:4px 0}summary .no{color:var(--no)}"""


def write_fleet_page(
    path: Path,
    *,
    joints: Sequence[JointState],
    notes: Sequence[str],
    facts: Sequence[str],
) -> None:
    """Write the page of a fleet in one piece.

    Args:
        path: The page.
        joints: Of all robots, robot by robot.
        notes: Alarms and what is missing, in words.
        facts: What was done and how alarms are raised, in words.

    Raises:
        InputError: A place where no such file can be.
        JobError: The disk does not take it.
    """
    parts = [
        f"<h1>Fleet: {_alarms(joints)}</h1>",
        *(f"<p>{escape(fact)}</p>" for fact in facts),
        "<ul>" + "".join(f"<li>{escape(note)}</li>" for note in notes) + "</ul>",
    ]
    for robot, group in groupby(joints, key=lambda joint: joint.robot):
        own = list(group)
        found = any(joint.alarm for joint in own)
        parts.append(
            f"<details{' open' if found else ''}><summary><b>{escape(robot or 'no name')}</b>: "
            f'<span class="{"no" if found else "yes"}">{_alarms(own)}</span></summary>'
            f"{_plots(own)}</details>"
        )
    write_text(
        path,
        '<!doctype html><html lang="en"><meta charset="utf-8"><title>Fleet</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{draw.style()}{STYLE}</style><body>{''.join(parts)}"
        f"<script>{draw.script()}</script></body></html>\n",
    )


def _alarms(joints: Sequence[JointState]) -> str:
    count = sum(bool(joint.alarm) for joint in joints)
    return "1 alarm" if count == 1 else f"{count or 'no'} alarms"


def _plots(joints: Sequence[JointState]) -> str:
    """Friction at the left and its control at the right, joint by joint."""
    known = [joint for joint in joints if joint.friction.known]
    if not known:
        return "<p>Too few recordings for trends.</p>"
    days = [joint.friction.time_s / DAY_S for joint in known]
    first = min(float(np.floor(d[0])) for d in days)
    last = max(float(d[-1]) for d in days)
    # Seconds since 1970 have no ticks that a reader knows.
    label = f"days since {np.datetime64(int(first), 'D')}"
    figure = draw.Figure(
        title="Values at the reference temperature with 95 % intervals",
        x=draw.Axis(low=-0.5, high=max(last - first, 1.0) + 0.5, label=label),
        panels=tuple(panel for joint in known for panel in _panels(joint, first)),
        columns=2,
        link=f"fleet-{joints[0].robot}",
    )
    return draw.fragment(figure)


def _panels(joint: JointState, first_day: float) -> Iterator[draw.Panel]:
    step, low, high = joint.change_percent
    (name,), unit = draw.joint_labels((joint.name,)), joint.unit.replace(".", "·")
    told = f"step {step:+.1f} % ({low:+.1f} to {high:+.1f}), p {joint.friction_p:.2g}"
    scale = f"{name}: torque of the inertias [1], p {joint.control_p:.2g}"
    for trend, title, alarm in (
        (joint.friction, f"{name}: friction [{unit}], {told}", bool(joint.alarm)),
        (joint.control, scale, joint.alarm == "torque_scale"),
    ):
        if not trend.known:
            yield draw.Panel(
                marks=(), y=draw.Axis(low=0.0, high=1.0), title=title, height=PLOT_HEIGHT
            )
            continue
        days, reach = trend.time_s / DAY_S - first_day, CONFIDENCE * trend.std
        low_end, high_end = trend.at_reference - reach, trend.at_reference + reach
        marks: tuple[draw.Mark, ...] = (
            draw.Ranges(days, low_end, high_end, "published"),
            draw.Points(days, trend.at_reference, "measured", "a recording"),
            draw.Line(*_level(trend, days, alarm), "no" if alarm else "predicted", "fitted level"),
        )
        yield draw.Panel(
            marks=marks,
            y=draw.axis_around(low_end, high_end),
            title=title,
            height=PLOT_HEIGHT,
        )


def _level(trend: Trend, days: Array, stepped: bool) -> tuple[Array, Array]:
    """The fitted level over days: a step where there is an alarm."""
    if not stepped:
        return days[[0, -1]], np.full(2, trend.level)
    after = trend.before + trend.change
    return (
        days[[0, trend.step_at, trend.step_at, -1]],
        np.array([trend.before, trend.before, after, after]),
    )


def _report_figures(contents: ReportContents) -> tuple[draw.Figure, ...]:
    """All figures of a report, those that decide first."""
    item = contents.estimates[0]
    drawn = (
        figures.torque_figure(item),
        figures.friction_figure(item),
        figures.links_figure(item),
        figures.models_figure(item),
    )
    more = (figure for chapter in appendix.chapters(contents) for figure in chapter.figures)
    return (*(figure for figure in drawn if figure is not None), *more)


def write_figures(
    contents: ReportContents, folder: str | Path, *, png: bool = False, force: bool = True
) -> tuple[Path, ...]:
    """Write each figure of a report as a file.

    Args:
        contents: What the report is about.
        folder: Where; it is made.
        png: PNG beside SVG; needs the extra `figures`.
        force: Whether figures that stand there are replaced.

    Raises:
        InputError: A place where no such files can be, or where one is.
        JobError: The disk does not take them.
        MissingExtraError: PNG without the extra.
    """
    target = Path(folder)
    if target.exists() and not target.is_dir():
        raise InputError("this is a file, and the figures need a folder", where=str(target))
    make_folder(target)
    endings = (".svg", ".png") if png else (".svg",)
    places = [
        (figure, target / f"{k:02d}-{draw.file_name(figure.title)}{ending}")
        for k, figure in enumerate(_report_figures(contents), start=1)
        for ending in endings
    ]
    require_absent(*(path for _, path in places), force=force)
    return tuple(draw.write_figure(figure, path) for figure, path in places)


def render(contents: ReportContents) -> str:
    """The report as HTML; text from files is escaped.

    Raises:
        InputError: No estimate.
    """
    if not contents.estimates:
        raise InputError("a report needs at least one estimate", where=str(contents.directory))
    item = contents.estimates[0]
    jinja = require("jinja2", "all")
    environment = jinja.Environment(
        autoescape=True,
        undefined=jinja.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_signed,
    )
    # Figures escape what they are given themselves.
    environment.filters |= {"drawn": _drawn, "number": draw.number}
    template = environment.from_string(_asset("page.html"))
    page: str = template.render(
        contents=contents,
        item=item,
        screens=screens,
        torque=_torque(item),
        friction=figures.friction_figure(item),
        links=figures.links_figure(item),
        models=figures.models_figure(item),
        chapters=list(appendix.chapters(contents)),
        style=_markup(draw.style() + _asset("page.css")),
        script=_markup(draw.script() + _asset("page.js")),
        version=version("dynid"),
        link=figures.TIME,
    )
    return page


def _signed(value: object) -> object:
    """Messages with the sign that not every terminal has; markup as it is."""
    return value.replace("+-", "±") if type(value) is str else value


def write_report(contents: ReportContents, path: str | Path) -> Path:
    """Write the report in one piece: an interrupt leaves the old file or the new one.

    Raises:
        InputError: No estimate, or a place where no such file can be.
        JobError: The disk does not take it.
    """
    target = Path(path)
    write_text(target, render(contents))
    return target


def _torque(item: ReportedEstimate) -> dict[str, Any] | None:
    """The rows of the torque section: the worst joint first, with its own place on screen one."""
    result = item.shown
    if result is None:
        return None
    robot = item.estimate.model.robot
    names, axis = draw.joint_labels(robot.joint_names), figures.time_axis(result)
    order = figures.worst_first(result)
    panels = [figures.torque_panels(item, result, j) for j in order]
    rows = [
        {
            "name": names[j],
            "percent": float(result.moving.relative_error_percent[j]),
            "rms": float(result.moving.rmse[j]),
            "unit": main.y.label.strip("[]"),
            "main": _markup(draw.plot(main, axis, ticks=False, link=figures.TIME)),
            "strip": _markup(draw.plot(strip, axis, ticks=j == order[-1], link=figures.TIME)),
        }
        for j, (main, strip) in zip(order, panels, strict=True)
    ]
    return {
        "rows": rows,
        "unit": draw.joint_unit("N.m", robot.prismatic),
        "key": _markup(
            draw.key(draw.legend([mark for pair in panels for p in pair for mark in p.marks]))
        ),
        "first_main": rows[0]["main"],
        "first_strip": _markup(draw.plot(panels[0][1], axis, link=figures.TIME)),
        "start": axis.low,
        "stop": axis.high,
    }


def _asset(name: str) -> str:
    return files("dynid.report").joinpath("assets", name).read_text(encoding="utf-8")


def _drawn(figure: draw.Figure) -> Any:
    return _markup(draw.fragment(figure))


def _markup(text: str) -> Any:
    return require("markupsafe", "all").Markup(text)
