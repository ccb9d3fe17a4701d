"""Figures without a drawing library: marks and axes in, SVG out, for pages and for files."""

from dynid.figures.axes import Axis, axis_around, category_axis, number, units
from dynid.figures.files import FORMATS, file_name, write_figure
from dynid.figures.marks import (
    Band,
    Bars,
    LegendEntry,
    Level,
    Line,
    Mark,
    Points,
    Ranges,
    Spans,
    Texts,
    legend,
    shaded,
    thinned,
)
from dynid.figures.svg import Figure, Panel, document, fragment, key, plot
from dynid.figures.theme import ROLES, colour, joint_role, joint_unit, script, style

__all__ = [
    "FORMATS",
    "ROLES",
    "Axis",
    "Band",
    "Bars",
    "Figure",
    "LegendEntry",
    "Level",
    "Line",
    "Mark",
    "Panel",
    "Points",
    "Ranges",
    "Spans",
    "Texts",
    "axis_around",
    "category_axis",
    "colour",
    "document",
    "file_name",
    "fragment",
    "joint_role",
    "joint_unit",
    "key",
    "legend",
    "number",
    "plot",
    "script",
    "shaded",
    "style",
    "thinned",
    "units",
    "write_figure",
]
