"""The page: one file that needs nothing else, and its figures as files."""

from __future__ import annotations

from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

from dynid.core import InputError, cannot_write, require, require_absent, write_text
from dynid.figures import (
    Figure,
    file_name,
    fragment,
    key,
    legend,
    number,
    plot,
    script,
    style,
    write_figure,
)
from dynid.report.appendix import chapters
from dynid.report.contents import ReportContents, ReportedEstimate, joint_labels
from dynid.report.figures import (
    TIME,
    friction_figure,
    links_figure,
    models_figure,
    time_axis,
    torque_figure,
    torque_panels,
    worst_first,
)
from dynid.report.screens import (
    headline,
    joint_bars,
    lead,
    model_bars,
    models_words,
    next_steps,
    purposes,
)

WIDTHS = "width=device-width, initial-scale=1"


def report_figures(contents: ReportContents) -> tuple[Figure, ...]:
    """All figures of a report, those that decide first.

    Args:
        contents: What the report is about.
    """
    item = contents.estimates[0]
    drawn = (torque_figure(item), friction_figure(item), links_figure(item), models_figure(item))
    more = (figure for chapter in chapters(contents) for figure in chapter.figures)
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
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(target, error) from error
    endings = (".svg", ".png") if png else (".svg",)
    places = [
        (figure, target / f"{k:02d}-{file_name(figure.title)}{ending}")
        for k, figure in enumerate(report_figures(contents), start=1)
        for ending in endings
    ]
    require_absent(*(path for _, path in places), force=force)
    return tuple(write_figure(figure, path) for figure, path in places)


def render(contents: ReportContents) -> str:
    """The report as HTML; text from files is escaped.

    Args:
        contents: What to show.

    Raises:
        InputError: No estimate.
    """
    if not contents.estimates:
        raise InputError("a report needs at least one estimate", where=str(contents.directory))
    item = contents.estimates[0]
    jinja = require("jinja2", "all")
    environment = jinja.Environment(
        autoescape=True, undefined=jinja.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    # Figures escape what they are given themselves.
    environment.filters["drawn"] = _drawn
    environment.filters["number"] = number
    template = environment.from_string(_asset("page.html"))
    page: str = template.render(
        contents=contents,
        item=item,
        headline=headline(item),
        lead=lead(item),
        purposes=purposes(item),
        torque=_torque(item),
        joint_bars=joint_bars(item),
        friction=friction_figure(item),
        links=links_figure(item),
        model_bars=model_bars(item),
        models=models_figure(item),
        models_words=models_words(item),
        steps=next_steps(contents),
        chapters=chapters(contents),
        style=_markup(style() + _asset("page.css")),
        script=_markup(script() + _asset("page.js")),
        version=version("dynid"),
        viewport=WIDTHS,
        link=TIME,
    )
    return page


def write_report(contents: ReportContents, path: str | Path) -> Path:
    """Write the report in one piece: an interrupt leaves the old file or the new one.

    Args:
        contents: What to show.
        path: The page.

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
    names, axis = joint_labels(robot.joint_names), time_axis(result)
    order = worst_first(result)
    rows: list[dict[str, Any]] = []
    marks: list[Any] = []
    for place, j in enumerate(order):
        main, strip = torque_panels(item, result, j)
        marks += [*main.marks, *strip.marks]
        last = place == len(order) - 1
        rows.append(
            {
                "name": names[j],
                "percent": float(result.moving.relative_error_percent[j]),
                "rms": float(result.moving.rmse[j]),
                "unit": main.y.label.strip("[]"),
                "main": _markup(plot(main, axis, ticks=False, link=TIME)),
                "strip": _markup(plot(strip, axis, ticks=last, link=TIME)),
            }
        )
    main, strip = torque_panels(item, result, order[0])
    return {
        "rows": rows,
        "key": _markup(key(legend(marks))),
        "first_main": _markup(plot(main, axis, ticks=False, link=TIME)),
        "first_strip": _markup(plot(strip, axis, link=TIME)),
        "start": axis.low,
        "stop": axis.high,
    }


def _asset(name: str) -> str:
    return files("dynid.report").joinpath("assets", name).read_text(encoding="utf-8")


def _drawn(figure: Figure) -> Any:
    return _markup(fragment(figure))


def _markup(text: str) -> Any:
    return require("markupsafe", "all").Markup(text)
