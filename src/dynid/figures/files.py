"""Figures as files."""

from __future__ import annotations

import re
from pathlib import Path

from dynid.core import InputError, cannot_write, require, write_text
from dynid.figures.svg import Figure, document

FORMATS = (".svg", ".png")
PIXELS = 2
"""Pixels of a PNG a pixel of the SVG."""


def write_figure(figure: Figure, path: str | Path, *, dark: bool = False) -> Path:
    """Write a figure; the ending of the name says how.

    Args:
        figure: The figure.
        path: File ending in `.svg`, or in `.png`, which needs the extra `figures`.
        dark: On a dark ground.

    Raises:
        InputError: Another ending, or a place where no such file can be.
        JobError: The disk does not take the file.
        MissingExtraError: A PNG without the extra.
    """
    target = Path(path)
    if target.suffix not in FORMATS:
        raise InputError("figure format", where=str(target), limit=", ".join(FORMATS))
    text = document(figure, dark=dark)
    if target.suffix == ".svg":
        write_text(target, text)
        return target
    image = require("resvg_py", "figures").svg_to_bytes(
        svg_string=text, zoom=PIXELS, font_family="DejaVu Sans", sans_serif_family="DejaVu Sans"
    )
    try:
        target.write_bytes(bytes(image))
    except OSError as error:
        raise cannot_write(target, error) from error
    return target


def file_name(title: str) -> str:
    """A title as the name of a file, without its ending."""
    return re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")[:60] or "figure"
