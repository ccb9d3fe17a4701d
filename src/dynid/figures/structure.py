"""What motion can show of the parameters (the paper's Figure 1)."""

from __future__ import annotations

import numpy as np

from dynid.figures.canvas import Canvas, scatter
from dynid.figures.theme import LIMIT, PALETTE, figure, rounded
from dynid.reduction.base import BaseParametrization

FLOOR = 1e-17
"""Singular values of zero, drawn here on a logarithmic axis."""


def singular_values(base: BaseParametrization) -> Canvas:
    """Singular values of the stacked regressor and their cumulative energy.

    Args:
        base: The base parametrization; the line stands at its rank.
    """
    values = np.asarray(base.singular_values)
    count = np.arange(1, len(values) + 1)
    energy = 100 * np.cumsum(values**2) / np.sum(values**2)
    drawn = figure(
        2,
        title=f"{base.rank} of {len(values)} directions can be identified",
        x="index",
        y=("singular value / largest", "cumulative energy [%]"),
        height=520,
    )
    for row, (series, name) in enumerate(
        ((np.maximum(values / values[0], FLOOR), "singular value"), (energy, "cumulative energy")),
        start=1,
    ):
        drawn.add_trace(
            scatter(
                x=count,
                y=rounded(series) if row == 2 else series,
                name=name,
                mode="lines+markers",
                line={"color": PALETTE[row - 1]},
                marker={"size": 5},
            ),
            row=row,
            col=1,
        )
        drawn.add_vline(base.rank + 0.5, line={"color": LIMIT, "dash": "dash"}, row=row, col=1)
    drawn.add_hline(base.tolerance, line={"color": LIMIT, "dash": "dot"}, row=1, col=1)
    drawn.update_yaxes(type="log", exponentformat="power", row=1, col=1)
    return drawn
