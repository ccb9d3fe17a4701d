"""What is drawn in a plot: lines, points, bands, bars, stretches of time and levels.

Every mark has a role (`ROLES`), which is its colour on light and on dark ground.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, Indices
from dynid.figures.axes import units

JOINT_COLOURS = 8
ROLES: dict[str, tuple[str, str]] = {
    "ground": ("#ffffff", "#111317"),
    "panel": ("#f4f5f8", "#191c21"),
    "ink": ("#14171c", "#eceef2"),
    "ink2": ("#555d6b", "#a5adbb"),
    "line": ("#dfe3e9", "#2c313a"),
    "grid": ("#eaedf1", "#23272e"),
    "measured": ("#8c95a3", "#6d7583"),
    "predicted": ("#0a5cad", "#58a9ff"),
    "residual": ("#b5480c", "#ff9d5c"),
    "truth": ("#14171c", "#eceef2"),
    "published": ("#8c95a3", "#7b8493"),
    "limit": ("#6f7683", "#a5adbb"),
    "still": ("#e2e6ec", "#2b313b"),
    "contact": ("#f3c9c6", "#5a2320"),
    "band": ("#f3d9c4", "#57391f"),
    "yes": ("#006b52", "#4fcba3"),
    "with-limits": ("#855000", "#f0b24d"),
    "no": ("#b3221b", "#ff8077"),
    "joint0": ("#0a5cad", "#58a9ff"),
    "joint1": ("#c2500f", "#ff9d5c"),
    "joint2": ("#00805f", "#4fcba3"),
    "joint3": ("#a8418f", "#e58fd0"),
    "joint4": ("#8f6600", "#e3b341"),
    "joint5": ("#1f86b8", "#7fd4ff"),
    "joint6": ("#6b5ad0", "#a99bff"),
    "joint7": ("#6f7683", "#a5adbb"),
}
"""Colour on light and on dark ground. Text keeps a contrast of 4.5, curves one of 3."""
FONT = 'Inter,ui-sans-serif,system-ui,-apple-system,"Segoe UI",Roboto,"DejaVu Sans",sans-serif'


def joint_role(index: int) -> str:
    """The role of a joint's curve, counted from 0."""
    return f"joint{index % JOINT_COLOURS}"


def joint_unit(unit: str, prismatic: Sequence[bool]) -> str:
    """Unit of a quantity of several joints (n) on one axis, as it is printed.

    From that of turning joints, such as `rad/s` or `N.m`, and which joints slide.
    """
    sliding = unit.replace("N.m", "N").replace("rad", "m")
    if all(prismatic):
        return units(sliding)
    return units(f"{unit}, {sliding} where sliding" if any(prismatic) else unit)


def colour(role: str, *, dark: bool = False) -> str:
    """The colour of a role, such as #0a5cad."""
    return ROLES[role][dark]


def style() -> str:
    """The CSS of plots in a page: colours for both grounds, `data-theme` on the root decides."""
    light, dark = ("".join(f"--{role}:{pair[k]};" for role, pair in ROLES.items()) for k in (0, 1))
    roles = "".join(f".plot .{role},.key .{role}{{--c:var(--{role})}}" for role in ROLES)
    return (
        f":root{{color-scheme:light;--font:{FONT};{light}}}"
        f'@media (prefers-color-scheme:dark){{:root:not([data-theme="light"])'
        f"{{color-scheme:dark;{dark}}}}}"
        f':root[data-theme="dark"]{{color-scheme:dark;{dark}}}'
        f"@media print{{:root,:root:not([data-theme]),:root[data-theme]"
        f"{{color-scheme:light;{light}}}}}"
        f"{roles}{_asset('figures.css')}"
    )


def script() -> str:
    """The JavaScript of plots in a page: linked cursor, zoom and readouts."""
    return _asset("figures.js")


def _asset(name: str) -> str:
    return files("dynid.figures").joinpath("assets", name).read_text(encoding="utf-8")


COLUMNS = 2000
"""A curve with more than twice as many points is drawn by the extremes of as many stretches."""


@dataclass(frozen=True, slots=True)
class Line:
    """A curve; NaN interrupts it."""

    x: ArrayLike
    y: ArrayLike
    role: str = "predicted"
    name: str = ""
    width: float = 1.4
    dash: str = ""
    """SVG dash array [px], such as `4 3`."""


@dataclass(frozen=True, slots=True)
class Points:
    """Round dots, or rings of the ground's colour inside."""

    x: ArrayLike
    y: ArrayLike
    role: str = "measured"
    name: str = ""
    size: float = 5.0
    hollow: bool = False
    faint: bool = False
    """Half transparent: clouds of many points."""


@dataclass(frozen=True, slots=True)
class Band:
    """The area between two curves."""

    x: ArrayLike
    low: ArrayLike
    high: ArrayLike
    role: str = "band"
    name: str = ""


@dataclass(frozen=True, slots=True)
class Bars:
    """Bars from zero; `across` lays them along the x axis."""

    at: ArrayLike
    length: ArrayLike
    role: str = "predicted"
    name: str = ""
    thickness: float = 0.7
    """In units of the axis that they stand on."""
    across: bool = False


@dataclass(frozen=True, slots=True)
class Ranges:
    """Intervals as straight strokes: `across` along the x axis, else along the y axis."""

    at: ArrayLike
    low: ArrayLike
    high: ArrayLike
    role: str = "predicted"
    name: str = ""
    width: float = 1.4
    across: bool = False


@dataclass(frozen=True, slots=True)
class Spans:
    """Stretches of the x axis that are shaded over the whole height."""

    stretches: Sequence[tuple[float, float]]
    role: str = "still"
    name: str = ""


@dataclass(frozen=True, slots=True)
class Level:
    """A straight line over the whole plot: at a y value, or at an x value if `upright`."""

    value: float
    role: str = "limit"
    name: str = ""
    upright: bool = False
    dash: str = "4 3"


Mark = Line | Points | Band | Bars | Ranges | Spans | Level


@dataclass(frozen=True, slots=True)
class LegendEntry:
    """What marks of one name are called and look like."""

    name: str
    role: str
    swatch: str
    """`stroke`, `dash`, `dot`, `ring` or `box`."""


def legend(marks: Sequence[Mark]) -> tuple[LegendEntry, ...]:
    """One entry a name, in the order in which they are drawn."""
    found: dict[str, LegendEntry] = {}
    for mark in marks:
        if mark.name:
            found.setdefault(mark.name, LegendEntry(mark.name, mark.role, _swatch(mark)))
    return tuple(found.values())


def _swatch(mark: Mark) -> str:
    if isinstance(mark, Points):
        return "ring" if mark.hollow else "dot"
    if isinstance(mark, Level) or (isinstance(mark, Line) and mark.dash):
        return "dash"
    return "box" if isinstance(mark, Band | Bars | Spans) else "stroke"


def shaded(t: Array, mask: ArrayLike, shortest: float = 0.0) -> tuple[tuple[float, float], ...]:
    """Stretches of instants (N) in which a condition (N) holds, shorter ones left out."""
    edges = np.diff(np.concatenate([[0], np.asarray(mask, dtype=np.int8), [0]]))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return tuple(
        (float(t[a]), float(t[b]))
        for a, b in zip(starts, stops, strict=True)
        if t[b] - t[a] >= shortest
    )


def thinned(y: Array, columns: int = COLUMNS) -> Indices:
    """Indices that draw the same picture: smallest and largest of (N) values of many stretches.

    NaN is kept where a whole stretch has no value.
    """
    count = len(y)
    if count <= 2 * columns:
        return np.arange(count)
    length = -(-count // columns)
    padded = np.concatenate([y, np.full(-count % length, np.nan)]).reshape(-1, length)
    first = np.where(np.isnan(padded), np.inf, padded).argmin(axis=1)
    last = np.where(np.isnan(padded), -np.inf, padded).argmax(axis=1)
    offset = length * np.arange(len(padded))
    chosen = np.unique(np.concatenate([[0, count - 1], offset + first, offset + last]))
    found: Indices = chosen[chosen < count]
    return found
