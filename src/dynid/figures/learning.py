"""How the error falls with the length of the record."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynid.figures.canvas import Canvas
from dynid.figures.theme import PALETTE, figure, line


def learning_curve(
    lengths_s: Sequence[float], training: Sequence[float], validation: Sequence[float]
) -> Canvas:
    """Errors on the record itself and on another one, over the length that was identified from.

    Args:
        lengths_s: (k) lengths [s].
        training: (k) relative errors of moving joints on the record itself [%].
        validation: (k) the same on another record [%].
    """
    drawn = figure(
        title="Learning curve", x="length identified from [s]", y="relative error, moving [%]"
    )
    for k, (values, name) in enumerate(((training, "own record"), (validation, "other record"))):
        drawn.add_trace(
            line(
                np.asarray(lengths_s, dtype=float),
                np.asarray(values, dtype=float),
                name,
                color=PALETTE[k],
            )
        )
    return drawn
