"""Figures as SVG: fluid ones for pages, whose curves stretch and whose texts do not, and files.

In a page a plot is an `svg` without a view box: texts stand at percentages of it and keep their
size. The curves are in an `svg` inside, in units of their own, which is stretched to the plot; a
script zooms by changing the view box of the inner one. In a file everything stands in pixels.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, check_word, in_one_piece, require, write_text
from dynid.figures import marks
from dynid.figures.marks import Axis, Mark

FLUID = (20000.0, 10000.0)
"""Units of the inner picture of a plot in a page: finer than pixels at every zoom."""
FINE = 10.0
"""Units a pixel in a file."""
CHARACTER = 6.7
"""Width of a figure at 12 px [px]."""
FAR = 1e7


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """One plot.

    Attributes:
        marks: What is drawn, from below to above.
        y: The y axis.
        x: Its own x axis; None for that of the figure.
        height: Height [px].
        title: Shown above it, such as the joint's name.
        note: A line below the title, such as the values of a curve.
        grid: Also lines at the ticks of the x axis.
    """

    marks: tuple[Mark, ...]
    y: Axis
    x: Axis | None = None
    height: float = 120.0
    title: str = ""
    note: str = ""
    grid: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """Plots with a title and a legend.

    Attributes:
        title: One line.
        x: The x axis of all plots.
        panels: The plots, above each other or in columns.
        columns: Number of columns.
        link: Plots of a page with the same link share cursor and zoom; empty for none.
        note: A sentence below the title.
        rows: Panels side by side share the categories of their y axes, named once.
    """

    title: str
    x: Axis
    panels: tuple[Panel, ...]
    columns: int = 1
    link: str = ""
    note: str = ""
    rows: bool = False

    @property
    def legend(self) -> tuple[marks.LegendEntry, ...]:
        """What the marks are called."""
        return marks.legend([mark for panel in self.panels for mark in panel.marks])


@dataclass(frozen=True, slots=True)
class _Ground:
    """Where things stand and how they are painted: in a page, or in a file of so many pixels."""

    x: Axis
    y: Axis
    size: tuple[float, float] | None = None

    @property
    def units(self) -> tuple[float, float]:
        return FLUID if self.size is None else (self.size[0] * FINE, self.size[1] * FINE)

    def across(self, values: ArrayLike) -> Array:
        return _whole(self.x.share(values) * self.units[0])

    def up(self, values: ArrayLike) -> Array:
        share = self.y.share(values)
        return _whole((share if self.y.names else 1.0 - share) * self.units[1])

    def place(self, share: float, axis: int) -> str:
        """A place for a text."""
        return f"{100 * share:.4g}%" if self.size is None else f"{share * self.size[axis]:.1f}"

    def stroke(self, role: str, width: float, dash: str = "") -> str:
        if self.size is None:
            dashed = f";stroke-dasharray:{dash}" if dash else ""
            return f'class="ln {role}" style="stroke-width:{width:g}{dashed}"'
        dashed = " ".join(f"{float(d) * FINE:g}" for d in dash.split())
        return (
            f'fill="none" stroke="{marks.colour(role)}" stroke-width="{width * FINE:g}"'
            ' stroke-linejoin="round" stroke-linecap="round"'
            + (f' stroke-dasharray="{dashed}"' if dash else "")
        )

    def area(self, role: str) -> str:
        if self.size is None:
            return f'class="ar {role}"'
        return f'fill="{marks.colour(role)}"'

    def text(
        self,
        x: str,
        y: str,
        text: str,
        role: str = "ink2",
        anchor: str = "middle",
        size: float = 12,
    ) -> str:
        paint = f'class="{role}"' if self.size is None else f'fill="{marks.colour(role)}"'
        return (
            f'<text x="{x}" y="{y}" dy=".35em" {paint} text-anchor="{anchor}" '
            f'font-size="{size:g}">{escape(text)}</text>'
        )


def _whole(values: Array) -> Array:
    return np.where(np.isfinite(values), np.rint(np.clip(values, -FAR, FAR)), np.nan)


def _path(x: Array, y: Array) -> str:
    """Whole numbers as a path of relative steps; NaN lifts the pen."""
    parts: list[str] = []
    known = np.isfinite(x) & np.isfinite(y)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], known.astype(np.int8), [0]])))
    for start, stop in edges.reshape(-1, 2):
        px, py = x[start:stop].astype(int), y[start:stop].astype(int)
        steps = np.column_stack([np.diff(px), np.diff(py)]).ravel().tolist()
        parts.append(f"M{px[0]} {py[0]}l" if len(steps) else f"M{px[0]} {py[0]}h1")
        parts.extend(str(s) if s < 0 or k == 0 else f" {s}" for k, s in enumerate(steps))
    return "".join(parts)


def _strokes(sheet: _Ground, mark: Mark) -> Iterator[str]:
    """The mark as elements of the inner picture."""
    wide, tall = sheet.units
    if isinstance(mark, marks.Line):
        x, y = np.asarray(mark.x, dtype=np.float64), np.asarray(mark.y, dtype=np.float64)
        chosen = marks.thinned(y)
        named = f' data-n="{escape(mark.name)}"' if mark.name and sheet.size is None else ""
        path = _path(sheet.across(x[chosen]), sheet.up(y[chosen]))
        yield f'<path {sheet.stroke(mark.role, mark.width, mark.dash)}{named} d="{path}"/>'
    elif isinstance(mark, marks.Points):
        x, y = sheet.across(mark.x), sheet.up(mark.y)
        known = np.isfinite(x) & np.isfinite(y)
        path = "".join(f"M{a:.0f} {b:.0f}h1" for a, b in zip(x[known], y[known], strict=True))
        faint = ' opacity=".45"' if mark.faint else ""
        yield f'<path {sheet.stroke(mark.role, mark.size)}{faint} d="{path}"/>'
        if mark.hollow:
            yield f'<path {sheet.stroke("ground", mark.size - 2.6)} d="{path}"/>'
    elif isinstance(mark, marks.Band):
        x = np.concatenate([np.asarray(mark.x), np.asarray(mark.x)[::-1]])
        y = np.concatenate([np.asarray(mark.low), np.asarray(mark.high)[::-1]])
        yield f'<path {sheet.area(mark.role)} d="{_path(sheet.across(x), sheet.up(y))}z"/>'
    elif isinstance(mark, marks.Bars):
        at, half = np.asarray(mark.at, dtype=np.float64), mark.thickness / 2
        along, beside = (np.zeros(len(at)), np.asarray(mark.length)), (at - half, at + half)
        x, y = (along, beside) if mark.across else (beside, along)
        corners = (*map(sheet.across, x), *map(sheet.up, y))
        path = "".join(
            f"M{a:.0f} {c:.0f}H{b:.0f}V{d:.0f}H{a:.0f}z"
            for a, b, c, d in zip(*corners, strict=True)
            if np.isfinite(a + b + c + d)
        )
        yield f'<path {sheet.area(mark.role)} d="{path}"/>'
    elif isinstance(mark, marks.Ranges):
        first, second = (sheet.across, sheet.up) if mark.across else (sheet.up, sheet.across)
        low, high, at = first(mark.low), first(mark.high), second(mark.at)
        path = "".join(
            f"M{a:.0f} {c:.0f}H{b:.0f}" if mark.across else f"M{c:.0f} {a:.0f}V{b:.0f}"
            for a, b, c in zip(low, high, at, strict=True)
            if np.isfinite(a + b + c)
        )
        yield f'<path {sheet.stroke(mark.role, mark.width)} d="{path}"/>'
    elif isinstance(mark, marks.Spans):
        ends = sheet.across(np.asarray(mark.stretches, dtype=np.float64).reshape(-1, 2))
        path = "".join(f"M{a:.0f} 0H{b:.0f}V{tall:.0f}H{a:.0f}z" for a, b in ends)
        yield f'<path {sheet.area(mark.role)} d="{path}"/>'
    else:
        if mark.upright:
            path = f"M{sheet.across(mark.value):.0f} 0V{tall:.0f}"
        else:
            path = f"M0 {sheet.up(mark.value):.0f}H{wide:.0f}"
        yield f'<path {sheet.stroke(mark.role, 1.1, mark.dash)} d="{path}"/>'


def _picture(sheet: _Ground, panel: Panel, most: int, ticks: bool, named: bool = True) -> str:
    """Grid, curves, then texts."""
    wide, tall = sheet.units
    rows = sheet.y.ticks(_row_count(panel))
    columns = sheet.x.ticks(most)
    lines = [f"M0 {sheet.up(v):.0f}H{wide:.0f}" for v, _ in rows if not sheet.y.names]
    if panel.grid:
        lines += [f"M{sheet.across(v):.0f} 0V{tall:.0f}" for v, _ in columns]
    inner = [f'<path {sheet.stroke("grid", 1)} d="{"".join(lines)}"/>'] if lines else []
    if not sheet.y.names and not sheet.y.log and sheet.y.low < 0 < sheet.y.high:
        inner.append(f'<path {sheet.stroke("line", 1)} d="M0 {sheet.up(0.0):.0f}H{wide:.0f}"/>')
    for mark in panel.marks:
        inner.extend(_strokes(sheet, mark))
    size = (
        'class="in" width="100%" height="100%"'
        if sheet.size is None
        else f'width="{sheet.size[0]:g}" height="{sheet.size[1]:g}"'
    )
    drawn = [
        f'<svg {size} viewBox="0 0 {wide:.0f} {tall:.0f}" preserveAspectRatio="none">'
        f"{''.join(inner)}</svg>"
    ]
    if named:
        texts = ""
        for value, text in rows:
            share = float(sheet.y.share(value))
            at = sheet.place(share if sheet.y.names else 1.0 - share, 1)
            texts += sheet.text("-8", at, text, anchor="end")
        drawn.append(f'<g class="yt">{texts}</g>')
    if ticks:
        below = "100%" if sheet.size is None else f"{sheet.size[1]:g}"
        labels = "".join(
            sheet.text(sheet.place(float(sheet.x.share(value)), 0), below, text)
            for value, text in columns
        )
        drawn.append(f'<g class="xt" transform="translate(0 14)">{labels}</g>')
    return "".join(drawn)


def _row_count(panel: Panel) -> int:
    return max(3, int(panel.height / 28))


def plot(panel: Panel, x: Axis, *, ticks: bool = True, most: int = 7, link: str = "") -> str:
    """One fluid plot for a page, as wide as its place; the texts of its axes stand around it.

    Args:
        panel: What to draw.
        x: The x axis, where the panel has none.
        ticks: Whether the x axis has texts.
        most: About how many.
        link: Plots with the same link share cursor and zoom.
    """
    axis = panel.x or x
    names = ", ".join(entry.name for entry in marks.legend(panel.marks))
    said = f"{panel.title} {panel.y.label} over {axis.label}: {names}".strip(" :")
    linked = (
        f' data-link="{escape(link)}" data-x="{axis.low:.9g},{axis.high:.9g}"'
        f' data-y="{panel.y.low:.9g},{panel.y.high:.9g}"'
        if link
        else ""
    )
    body = _picture(_Ground(axis, panel.y), panel, most, ticks)
    return (
        f'<svg class="plot{"" if ticks else " bare"}" role="img" aria-label="{escape(said)}" '
        f'style="height:{panel.height:g}px"{linked}>{body}</svg>'
    )


def margin(panels: Sequence[Panel]) -> float:
    """Room left of plots for the texts of their y axes [px]."""
    longest = max((len(text) for p in panels for _, text in p.y.ticks(_row_count(p))), default=0)
    return 14 + CHARACTER * longest


def key(entries: Sequence[marks.LegendEntry]) -> str:
    """A legend for a page."""
    shown = "".join(
        f'<span><i class="{entry.swatch} {entry.role}"></i>{escape(entry.name)}</span>'
        for entry in entries
    )
    return f'<div class="key">{shown}</div>' if shown else ""


def fragment(figure: Figure) -> str:
    """A figure for a page: title, legend, plots; needs `style()` and, if linked, `script()`."""
    bottom = len(figure.panels) - figure.columns
    plots: list[str] = []
    for k, panel in enumerate(figure.panels):
        ticks = panel.x is not None or k >= bottom
        svg = plot(panel, figure.x, ticks=ticks, most=max(3, 8 // figure.columns), link=figure.link)
        heading = " ".join(filter(None, (panel.title, panel.y.label)))
        if panel.note:
            heading += f"\n{panel.note}"
        left = margin([panel] if figure.columns > 1 else figure.panels)
        plots.append(
            f'<div class="panel" style="--m:{left:.0f}px">'
            f'<p class="pt">{escape(heading)}</p>{svg}</div>'
        )
    note = f'<p class="note">{escape(figure.note)}</p>' if figure.note else ""
    return (
        f'<figure class="fig{" rows" if figure.rows else ""}" style="--k:{figure.columns}">'
        f"<figcaption><b>{escape(figure.title)}</b>{key(figure.legend)}</figcaption>{note}"
        f'<div class="panels">{"".join(plots)}</div>'
        f'<p class="xl">{escape(figure.x.label)}</p></figure>'
    )


WIDTH, GAP, EDGE = 960.0, 28.0, 24.0
"""Width of a file, between its columns, and around everything [px]."""


def document(figure: Figure) -> str:
    """A figure as an SVG file that needs nothing else, on a light ground."""
    columns = [figure.panels[k :: figure.columns] for k in range(figure.columns)]
    lefts = [margin(c) if k == 0 or not figure.rows else 0 for k, c in enumerate(columns)]
    room = WIDTH - 2 * EDGE - GAP * (figure.columns - 1)
    # Columns of rows have plots of the same width, others the same width with their texts.
    wide = (room - lefts[0]) / figure.columns if figure.rows else room / figure.columns
    cells = [wide + lefts[0] * (k == 0) if figure.rows else wide for k in range(figure.columns)]
    parts: list[str] = []
    page = _Ground(figure.x, figure.panels[0].y, (WIDTH, WIDTH))
    parts.append(page.text(f"{EDGE}", "30", figure.title, "ink", "start", 17))
    y, x = 54.0, EDGE
    for entry in figure.legend:
        role, name = entry.role, entry.name
        if x + 34 + CHARACTER * len(name) > WIDTH - EDGE:
            x, y = EDGE, y + 18
        thick = 10 if entry.swatch == "box" else 3
        parts.append(
            f'<path d="M{x} {y}h18" stroke="{marks.colour(role)}" stroke-width="{thick}"/>'
            + page.text(f"{x + 24}", f"{y}", name, "ink2", "start")
        )
        x += 44 + CHARACTER * len(name)
    y += 18 if figure.legend else 0
    if figure.note:
        parts.append(page.text(f"{EDGE}", f"{y}", figure.note, "ink2", "start"))
        y += 18
    bottom = len(figure.panels) - figure.columns
    for start in range(0, len(figure.panels), figure.columns):
        row = figure.panels[start : start + figure.columns]
        titled = 26 if any(p.title or p.y.label for p in row) else 10
        titled += 15 if any(p.note for p in row) else 0
        for k, panel in enumerate(row):
            x = EDGE + sum(cells[:k]) + k * GAP + lefts[k]
            sheet = _Ground(panel.x or figure.x, panel.y, (cells[k] - lefts[k], panel.height))
            ticks, named = panel.x is not None or start + k >= bottom, not figure.rows or k == 0
            heading = " ".join(filter(None, (panel.title, panel.y.label)))
            note = panel.note.replace("\n", ", ")
            parts += [
                page.text(f"{x:.1f}", f"{y + 12:.1f}", heading, "ink", "start"),
                page.text(f"{x:.1f}", f"{y + 27:.1f}", note, "ink2", "start", 11),
                f'<g transform="translate({x:.1f} {y + titled:.1f})">',
                _picture(sheet, panel, max(3, 8 // figure.columns), ticks, named),
                "</g>",
            ]
        shown = any(p.x is not None for p in row) or start + len(row) > bottom
        y += titled + max(p.height for p in row) + (24 if shown else 6)
    parts.append(page.text(f"{WIDTH - EDGE}", f"{y + 6:.1f}", figure.x.label, "ink2", "end"))
    tall = y + EDGE
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH:g}" height="{tall:.0f}" '
        f'viewBox="0 0 {WIDTH:g} {tall:.0f}" font-family="{escape(marks.FONT)}">'
        f"<title>{escape(figure.title)}</title>"
        f'<rect width="100%" height="100%" fill="{marks.colour("ground")}"/>'
        f"{''.join(parts)}</svg>"
    )


FORMATS = (".svg", ".png")
PIXELS = 2
"""Pixels of a PNG a pixel of the SVG."""


def write_figure(figure: Figure, path: str | Path) -> Path:
    """Write a figure to a file that ends in `.svg`, or in `.png`, which needs the extra `figures`.

    Raises:
        InputError: Another ending, or a place where no such file can be.
        JobError: The disk does not take the file.
        MissingExtraError: A PNG without the extra.
    """
    target = Path(path)
    check_word(target.suffix, FORMATS, str(target))
    text = document(figure)
    if target.suffix == ".svg":
        write_text(target, text)
        return target
    image = require("resvg_py", "figures").svg_to_bytes(
        svg_string=text, zoom=PIXELS, font_family="DejaVu Sans", sans_serif_family="DejaVu Sans"
    )
    with in_one_piece(target) as draft:
        draft.write_bytes(bytes(image))
    return target


def file_name(title: str) -> str:
    """A title as the name of a file, without its ending."""
    return re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")[:60] or "figure"
