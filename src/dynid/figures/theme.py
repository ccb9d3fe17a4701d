"""One look: colours with a role, on light and on dark ground, and what pages need for them."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files

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
    """Unit of a quantity of several joints on one axis, as it is printed.

    Args:
        unit: That of turning joints, such as `rad/s` or `N.m`.
        prismatic: (n) which joints slide.
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
