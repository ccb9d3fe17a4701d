"""Parameters with their uncertainty, and what changed between two estimates (Figure 4)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynid.figures.canvas import Canvas, bar, scatter
from dynid.figures.theme import LIMIT, PALETTE, figure, label
from dynid.identification.estimate import Estimate

CONFIDENCE = 1.96
"""Standard deviations either side of a 95 % interval."""


def parameter_intervals(estimate: Estimate) -> Canvas:
    """Each base parameter with its 95 % interval, in one plot a unit.

    Args:
        estimate: The estimate; parameters that the data hardly speak about are drawn hollow.
    """
    units = list(dict.fromkeys(estimate.units))
    drawn = figure(
        len(units),
        title="Base parameters with 95 % intervals",
        x="",
        y=[f"[{unit}]" for unit in units],
        height=120 + 210 * len(units),
    )
    drawn.update_layout(hovermode="closest")
    std = estimate.std
    for row, unit in enumerate(units, start=1):
        chosen = [k for k, other in enumerate(estimate.units) if other == unit]
        solid = [k in estimate.essential for k in chosen]
        drawn.add_trace(
            scatter(
                x=[label(estimate.names[k]) for k in chosen],
                y=estimate.values[chosen],
                error_y={"type": "data", "array": CONFIDENCE * std[chosen], "thickness": 1.2},
                mode="markers",
                marker={
                    "color": PALETTE[(row - 1) % len(PALETTE)],
                    "symbol": ["circle" if full else "circle-open" for full in solid],
                    "size": 7,
                },
                name=unit,
                showlegend=False,
                customdata=[label(estimate.expressions[k], 120) for k in chosen],
                hovertemplate="%{customdata}<br>%{y:.4g}<extra></extra>",
            ),
            row=row,
            col=1,
        )
    drawn.update_layout(hovermode="closest")
    # Every parameter has its name, on a telephone too.
    drawn.update_xaxes(
        matches=None, showticklabels=True, tickangle=-90, dtick=1, tickfont={"size": 10}
    )
    return drawn


def parameter_changes(
    names: Sequence[str],
    change_percent: Sequence[float],
    std_percent: Sequence[float],
    *,
    first: str = "cold",
    second: str = "warm",
) -> Canvas:
    """How much each parameter changed, with 95 % intervals.

    Args:
        names: (r) parameters.
        change_percent: (r) change from the first estimate to the second [%].
        std_percent: (r) standard deviation of the change [%].
        first: What the first estimate is called.
        second: What the second estimate is called.
    """
    drawn = figure(
        title=f"Change of the parameters, {label(first)} to {label(second)}",
        x="",
        y="change [%]",
        height=420,
    )
    drawn.add_trace(
        bar(
            x=[label(name) for name in names],
            y=np.asarray(change_percent, dtype=float),
            error_y={
                "type": "data",
                "array": CONFIDENCE * np.asarray(std_percent, dtype=float),
                "thickness": 1.2,
            },
            marker_color=PALETTE[0],
            showlegend=False,
        )
    )
    drawn.add_hline(0, line={"color": LIMIT})
    drawn.update_xaxes(tickangle=-60)
    return drawn


def side_by_side(first: Estimate, second: Estimate, labels: tuple[str, str]) -> Canvas:
    """Friction of two estimates beside each other, as the paper draws cold and warm.

    Args:
        first: One estimate.
        second: Another with the same parameters.
        labels: What they are called.
    """
    friction = [k for k, name in enumerate(first.names) if name.startswith(("Fc", "Fv"))]
    units = " and ".join(dict.fromkeys(f"[{first.units[k]}]" for k in friction))
    drawn = figure(title="Friction of two runs", x="", y=units or "friction", height=420)
    for k, (estimate, name) in enumerate(zip((first, second), labels, strict=True)):
        drawn.add_trace(
            bar(
                x=[label(estimate.names[i]) for i in friction],
                y=estimate.values[friction],
                error_y={
                    "type": "data",
                    "array": CONFIDENCE * estimate.std[friction],
                    "thickness": 1.2,
                },
                name=label(name),
                marker_color=PALETTE[k],
            )
        )
    return drawn
