"""Figures as files: HTML, SVG, PNG or JSON."""

from __future__ import annotations

from pathlib import Path

from dynid.core.errors import InputError, JobError
from dynid.core.files import cannot_write, write_text
from dynid.core.optional import require
from dynid.figures.canvas import Canvas, copied
from dynid.figures.theme import paint

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
