"""What is drawn in a plot: axes with ticks at round numbers; lines, points, bands, bars and levels.

Every mark has a role (`ROLES`), which is its colour on light and on dark ground.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, Indices, InputError, printable

MINUS = "\N{MINUS SIGN}"
_STEPS = (1.0, 2.0, 5.0, 10.0)
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: float | None, digits: int = 3) -> str:
    """A number for people, with a true minus sign; a dash where there is none.

    Args:
        value: The number, or None or NaN.
        digits: Significant digits.
    """
    if value is None or not math.isfinite(value):
        return "\N{EN DASH}"
    # Hundreds of percent are read as such, not as powers of ten.
    whole = 10.0**digits <= float(f"{abs(value):.{digits - 1}e}") < 1e5
    text = f"{value:.0f}" if whole else f"{value:#.{digits}g}".rstrip(".") if value else "0"
    return text.replace("-", MINUS)


def units(text: str) -> str:
    """A unit as it is printed: `N.m.s/rad` becomes N\N{MIDDLE DOT}m\N{MIDDLE DOT}s/rad."""
    for plain, printed in (("N.m.s", "N·m·s"), ("N.m", "N·m"), ("kg.m", "kg·m"), ("N.s", "N·s")):
        text = text.replace(plain, printed)
    return text.replace("m^2", "m²").replace("s^2", "s²")


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """The range of one axis.

    Attributes:
        low: Value at its start.
        high: Value at its end; above `low`.
        label: What it shows, with its unit in brackets.
        log: Whether it is logarithmic; both ends are positive then.
        names: Names of the values 0, 1, 2...: an axis of categories.
        bounds: One tick with plus and minus, for a narrow strip around zero.
    """

    low: float
    high: float
    label: str = ""
    log: bool = False
    names: tuple[str, ...] = ()
    bounds: bool = False

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise InputError("range of an axis", value=(self.low, self.high), where=self.label)
        if self.log and self.low <= 0:
            raise InputError("start of a logarithmic axis", value=self.low, limit="above 0")

    def share(self, values: ArrayLike) -> Array:
        """Where values lie: 0 at the start, 1 at the end, NaN where not known."""
        given = np.asarray(values, dtype=np.float64)
        low, high = self.low, self.high
        if self.log:
            given = np.log10(np.maximum(given, low * 1e-6))
            low, high = math.log10(low), math.log10(high)
        placed: Array = (given - low) / (high - low)
        return placed

    def ticks(self, most: int) -> tuple[tuple[float, str], ...]:
        """Values with their texts, about as many at most as there is room for."""
        if self.names:
            return tuple((float(k), name) for k, name in enumerate(self.names))
        if self.bounds:
            reach = max(abs(self.low), abs(self.high))
            return ((0.0, f"±{float(f'{reach:.2g}'):g}"),)
        if self.log:
            return _decades(self.low, self.high, most)
        step = _round_step((self.high - self.low) / max(most, 1))
        first, last = self._within(step)
        if last - first < 2:
            step = _round_step(step / 2.5)
            first, last = self._within(step)
        digits = max(0, -math.floor(math.log10(step) + 1e-9))
        return tuple((k * step, _tick(k * step, digits)) for k in range(first, last + 1))

    def _within(self, step: float) -> tuple[int, int]:
        return math.ceil(self.low / step - 1e-6), math.floor(self.high / step + 1e-6)


_ROOM = 0.06
"""Left free at each end of an axis, as a share of its range."""


def axis_around(
    *values: ArrayLike,
    label: str = "",
    log: bool = False,
    zero: bool = False,
    even: bool = False,
) -> Axis:
    """An axis that holds values.

    Args:
        values: Arrays; what is not finite does not count.
        label: What it shows, with its unit.
        log: Logarithmic; only positive values count.
        zero: Zero is on it.
        even: As far below zero as above.
    """
    flat = np.concatenate([np.ravel(np.asarray(v, dtype=np.float64)) for v in values])
    flat = flat[np.isfinite(flat) & ((flat > 0) if log else True)]
    if flat.size == 0:
        flat = np.array([1.0, 10.0] if log else [0.0, 1.0])
    low, high = float(flat.min()), float(flat.max())
    if zero:
        low, high = min(low, 0.0), max(high, 0.0)
    if even:
        low, high = -max(-low, high), max(-low, high)
    if log:
        grow = max((high / low) ** _ROOM, 1.1)
        return Axis(low=low / grow, high=high * grow, label=label, log=True)
    spread = high - low or abs(high) or 1.0
    return Axis(
        low=low if zero and low == 0 < high else low - _ROOM * spread,
        high=high if zero and high == 0 > low else high + _ROOM * spread,
        label=label,
    )


def category_axis(names: Sequence[str]) -> Axis:
    """An axis with a place for each name."""
    return Axis(low=-0.5, high=len(names) - 0.5, names=tuple(names))


def _round_step(least: float) -> float:
    decade = 10.0 ** math.floor(math.log10(least))
    return next(decade * step for step in _STEPS if decade * step >= least * (1 - 1e-9))


def _tick(value: float, digits: int) -> str:
    if abs(value) >= 1e5:
        mantissa, power = f"{value:.5e}".split("e")
        return f"{float(mantissa):g}e{int(power)}".replace("-", MINUS)
    return f"{value:.{digits}f}".replace("-", MINUS) if abs(value) > 1e-12 else "0"


def _decades(low: float, high: float, most: int) -> tuple[tuple[float, str], ...]:
    first, last = math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9)
    if last - first < 2:
        steps = [m * 10.0**k for k in range(first - 1, last + 1) for m in (1, 2, 5)]
        return tuple((v, f"{v:g}") for v in steps if low <= v <= high)
    every = max(1, math.ceil((last - first + 1) / max(most, 1)))
    # One way of writing on one axis.
    short = first >= -3 and last <= 4
    return tuple(
        (10.0**k, f"{10.0**k:g}" if short else f"10{str(k).translate(_RAISED)}")
        for k in range(first, last + 1, every)
    )


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
    sliding = unit.replace("N.m", "N").replace("rad", "m").replace("deg", "m")
    if all(prismatic):
        return units(sliding)
    return units(f"{unit}, {sliding} where sliding" if any(prismatic) else unit)


def joint_labels(names: tuple[str, ...]) -> tuple[str, ...]:
    """Names of joints for people: `shoulder_pan_joint` is Shoulder pan."""
    plain = [name.replace("_", " ").strip() for name in names]
    short = [name.removesuffix(" joint").removesuffix(" Joint") or name for name in plain]
    chosen = short if len(set(short)) == len(names) else plain
    return tuple(printable(name[:1].upper() + name[1:], 28) for name in chosen)


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
