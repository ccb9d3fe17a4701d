"""One look for every figure, and figures as files."""

from __future__ import annotations

import html
import importlib
import textwrap
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from dynid.core import Array, Indices, InputError, JobError, cannot_write, require, write_text


class Canvas(Protocol):
    """A Plotly figure."""

    def add_trace(self, trace: Any, row: int | None = None, col: int | None = None) -> Any:
        """Draw a series, in one of the plots."""
        ...

    def add_hline(self, y: float, **style: Any) -> Any:
        """A level."""
        ...

    def add_vline(self, x: float, **style: Any) -> Any:
        """An instant, or an index."""
        ...

    def update_layout(self, **changes: Any) -> Any:
        """Change what belongs to the whole figure."""
        ...

    def update_xaxes(self, **changes: Any) -> Any:
        """Change the x axes."""
        ...

    def update_yaxes(self, **changes: Any) -> Any:
        """Change the y axes."""
        ...

    def update_annotations(self, **changes: Any) -> Any:
        """Change the texts."""
        ...

    def to_plotly_json(self) -> dict[str, Any]:
        """The figure as plain objects."""
        ...

    def to_json(self) -> str:
        """The figure as JSON text."""
        ...

    def write_html(self, file: Any, **options: Any) -> None:
        """Write a page."""
        ...

    def write_image(self, file: Any, **options: Any) -> None:
        """Write SVG or PNG."""
        ...


def scatter(**values: Any) -> Any:
    """A line or points."""
    return _objects().Scatter(**values)


def bar(**values: Any) -> Any:
    """Bars."""
    return _objects().Bar(**values)


def copied(canvas: Canvas) -> Canvas:
    """Another figure that shows the same."""
    return _objects().Figure(canvas)


def stacked(rows: int, **options: Any) -> Canvas:
    """An empty figure of plots above each other."""
    made: Canvas = importlib.import_module("plotly.subplots").make_subplots(
        rows=rows, cols=1, **options
    )
    return made


def script() -> str:
    """The text of the library that draws in the browser."""
    source: str = importlib.import_module("plotly.offline").get_plotlyjs()
    return source


def plain(canvas: Canvas) -> Mapping[str, Any]:
    """Data and layout as JSON objects."""
    return canvas.to_plotly_json()


def _objects() -> Any:
    return importlib.import_module("plotly.graph_objects")


PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C6D31", "#7F7F7F")
"""Okabe and Ito's colours, without black and yellow, which vanish on one of the grounds."""
MEASURED, PREDICTED, LIMIT = PALETTE[0], PALETTE[1], PALETTE[7]
POINTS = 800
"""A line is drawn with this many points at most: a page stays light, the picture the same."""
ROW_HEIGHT = 150
WIDE_RANGE = 3000.0
"""Beyond this ratio ticks at each decade are enough; within, there are some at 2 and 5 too."""
TITLE_WIDTH, TITLE_LINE = 36, 20
"""Characters of a title that fit on a telephone, and the height of another line [px]."""
_GROUND = {
    False: {"paper": "#ffffff", "ink": "#1f2933", "grid": "#e4e7eb"},
    True: {"paper": "#14181d", "ink": "#d9e2ec", "grid": "#323f4b"},
}


def colour(index: int) -> str:
    """The palette's colour of a joint, counted from 0."""
    return PALETTE[index % len(PALETTE)]


def label(name: str, longest: int = 40) -> str:
    """A name from a file as plain text: Plotly reads a subset of HTML in its labels."""
    name = "".join(c if c.isprintable() else "?" for c in name)
    short = name if len(name) <= longest else name[: longest - 1] + "\N{HORIZONTAL ELLIPSIS}"
    return html.escape(short, quote=False)


def torque_unit(prismatic: bool) -> str:
    """Unit of a joint's torque or force."""
    return joint_unit("N.m", (prismatic,))


def joint_unit(unit: str, prismatic: Sequence[bool]) -> str:
    """Unit of a quantity of several joints on one axis.

    Args:
        unit: That of turning joints, such as `rad/s` or `N.m`.
        prismatic: (n) which joints slide.
    """
    sliding = unit.replace("N.m", "N").replace("rad", "m")
    if all(prismatic):
        return sliding
    return f"{unit}, {sliding} where sliding" if any(prismatic) else unit


def log_axis(values: Array) -> dict[str, Any]:
    """A logarithmic axis whose ticks are whole numbers, not the last digit of each alone.

    Args:
        values: What is drawn along it, positive.
    """
    wide = float(values.max()) > WIDE_RANGE * float(values.min())
    return {"type": "log", "tickformat": "~g"} | ({} if wide else {"dtick": "D2"})


def layout(*, dark: bool = False) -> dict[str, Any]:
    """Colours and fonts of a figure, for one ground."""
    ground = _GROUND[dark]
    axis = {"gridcolor": ground["grid"], "linecolor": ground["grid"], "zeroline": False}
    return {
        "paper_bgcolor": ground["paper"],
        "plot_bgcolor": ground["paper"],
        "font": {"color": ground["ink"], "family": "system-ui, sans-serif", "size": 12},
        "xaxis": axis,
        "yaxis": axis,
    }


def figure(
    rows: int = 1,
    *,
    title: str,
    x: str,
    y: str | Sequence[str],
    titles: Sequence[str] = (),
    height: int | None = None,
) -> Canvas:
    """An empty figure with `rows` plots above each other that share their x axis.

    Args:
        rows: Number of plots.
        title: Of the whole.
        x: Axis label with its unit, below the last plot.
        y: Axis label with its unit: one for all plots, or one a plot.
        titles: One a plot, such as the joint's name.
        height: Of the whole [px].
    """
    made = stacked(
        rows,
        shared_xaxes=True,
        vertical_spacing=min(0.05, 0.2 / rows),
        subplot_titles=[label(name) for name in titles] or None,
    )
    lines = textwrap.wrap(title, TITLE_WIDTH)
    more = TITLE_LINE * (len(lines) - 1)
    made.update_layout(
        title={"text": "<br>".join(lines), "x": 0, "xref": "container", "pad": {"l": 12}},
        height=(height or (380 if rows == 1 else 110 + ROW_HEIGHT * rows)) + more,
        margin={"l": 64, "r": 16, "t": 56 + more, "b": 84},
        # At the foot of the page's box: below the plots it would meet slanted labels.
        legend={"orientation": "h", "yref": "container", "y": 0, "yanchor": "bottom", "x": 0},
        hovermode="x",
    )
    labels = [y] * rows if isinstance(y, str) else list(y)
    for row, text in enumerate(labels, start=1):
        made.update_yaxes(title_text=text, row=row, col=1)
    made.update_xaxes(title_text=x, row=rows, col=1)
    made.update_xaxes(automargin=True)
    made.update_annotations(font_size=12, x=0, xanchor="left")
    return paint(made)


def paint(drawn: Canvas, *, dark: bool = False) -> Canvas:
    """The figure in the colours of one ground; the same object."""
    style = layout(dark=dark)
    axis = style.pop("xaxis")
    style.pop("yaxis")
    drawn.update_layout(**style)
    drawn.update_xaxes(**axis)
    drawn.update_yaxes(**axis)
    return drawn


def line(
    t: Array, y: Array, name: str, *, color: str, legend: bool = True, **line_style: Any
) -> Any:
    """A line through the samples, thinned to what a screen can show.

    Between kept samples the extremes survive: each stretch gives its smallest and largest value.
    """
    keep = thinned(y)
    return scatter(
        x=rounded(t[keep]),
        y=rounded(y[keep]),
        name=name,
        legendgroup=name,
        showlegend=legend,
        mode="lines",
        line={"color": color, "width": 1.4} | line_style,
    )


def points(x: Array, y: Array, name: str, *, color: str, legend: bool = True) -> Any:
    """A cloud of points, at most `POINTS` of them, evenly taken."""
    keep = np.unique(np.linspace(0, len(x) - 1, min(len(x), POINTS)).astype(int))
    return scatter(
        x=rounded(x[keep]),
        y=rounded(y[keep]),
        name=name,
        legendgroup=name,
        showlegend=legend,
        mode="markers",
        marker={"color": color, "size": 3, "opacity": 0.5},
    )


def thinned(y: Array, count: int = POINTS) -> Indices:
    """Indices of at most `count` samples that keep the extremes of each stretch."""
    if len(y) <= count:
        return np.arange(len(y))
    edges = np.linspace(0, len(y), count // 2 + 1).astype(int)
    found = [
        (first + int(np.argmin(y[first:last])), first + int(np.argmax(y[first:last])))
        for first, last in pairwise(edges)
    ]
    return np.unique(np.ravel(found))


def rounded(values: Array) -> Any:
    """Single precision: half the bytes of a page, and finer than a pixel."""
    return np.asarray(values, dtype=np.float32)


FORMATS = (".html", ".svg", ".png", ".json")
WIDTH = 900
PAPER_SCALE = 2.0


def write_figure(drawn: Canvas, path: str | Path, *, dark: bool = False) -> Path:
    """Write a figure; the ending of the name says how.

    SVG and PNG are drawn by a Chromium or Chrome that must be installed.

    Args:
        drawn: The figure.
        path: File ending in `.html` (self-contained), `.svg`, `.png` or `.json`.
        dark: On a dark ground.

    Raises:
        InputError: Another ending, or a place where no such file can be.
        JobError: The disk does not take the file, or there is no browser for SVG and PNG.
        MissingExtraError: The package that drives the browser is not installed.
    """
    target = Path(path)
    if target.suffix not in FORMATS:
        raise InputError("figure format", where=str(target), limit=", ".join(FORMATS))
    painted = paint(copied(drawn), dark=dark)
    try:
        if target.suffix == ".html":
            painted.write_html(target, include_plotlyjs=True, full_html=True)
        elif target.suffix == ".json":
            write_text(target, painted.to_json() or "")
        else:
            _draw(painted, target)
    except OSError as error:
        raise cannot_write(target, error) from error
    return target


def _draw(painted: Canvas, target: Path) -> None:
    require("kaleido", "figures")
    try:
        painted.write_image(target, width=WIDTH, scale=PAPER_SCALE)
    except (RuntimeError, ValueError) as error:
        raise JobError(
            "the figure cannot be drawn",
            where=str(target),
            value=str(error).splitlines()[0] if str(error) else type(error).__name__,
            next_step="Install Chromium, or write .html.",
        ) from error
