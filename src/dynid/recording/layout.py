"""What the columns of a table without a header may be, as a suggestion to the user."""

from __future__ import annotations

import numpy as np

from dynid.core import Array
from dynid.recording.families import spelled
from dynid.recording.repair.velocities import common_slope, velocity_slopes
from dynid.recording.table import Mask

_FEWEST_ROWS = 100
_MOST_COLUMNS = 80


def suggest_columns(values: Array, joints: int | None) -> str:
    """A `--columns` option that fits the numbers of a table, or nothing.

    Time is a column that rises steadily; positions are a block of columns whose derivative
    another block is; what the other blocks are, only the user can know.

    Args:
        values: (N, m) the table.
        joints: Number of joints, if known.
    """
    rows, width = values.shape
    if not rows:
        return ""
    # Columns of text have no numbers at all.
    numbers: Mask = np.asarray(np.isfinite(values).any(axis=0), dtype=np.bool_)
    values = values[np.isfinite(values[:, numbers]).all(axis=1)]
    if len(values) < max(_FEWEST_ROWS, 0.5 * rows) or width > _MOST_COLUMNS:
        return ""
    clock = next((k for k in range(width) if numbers[k] and _is_clock(values[:, k])), None)
    if clock is None:
        return ""
    t = values[:, clock] - values[0, clock]
    first = clock + 1 if clock == 0 else 0
    counts = [joints] if joints else [n for n in (6, 7, 5, 4, 3, 2) if (width - 1) % n == 0]
    for n in counts:
        starts = [
            k
            for k in range(first, width - n + 1, n)
            if not k <= clock < k + n and numbers[k : k + n].all()
        ]
        blocks = [values[:, k : k + n] for k in starts]
        found = _motion(t, blocks)
        if found is None:
            continue
        q, qd = (list(range(starts[k], starts[k] + n)) for k in found)
        rest = [
            k for number, k in enumerate(starts) if number not in found and k > starts[found[0]]
        ]
        columns = {"t": [clock], "q": q, "qd": qd}
        if rest:
            columns["current"] = list(range(rest[0], rest[0] + n))
        hint = f"By their numbers the columns may be --columns {spelled(columns)}"
        if rest:
            others = ", ".join(f"{k}:{k + n}" for k in rest)
            hint += f" (what {others} hold is for you to say: current in A, effort in N.m)"
        return f"{hint}."
    return ""


def _is_clock(x: Array) -> bool:
    steps = np.diff(x)
    return bool((steps > 0).mean() > 0.98 and np.quantile(steps, 0.9) < 5 * np.median(steps))


def _motion(t: Array, blocks: list[Array]) -> tuple[int, int] | None:
    """The first two blocks of which one is the derivative of the other."""
    for k, q in enumerate(blocks):
        for m, qd in enumerate(blocks):
            if m == k:
                continue
            slopes, sure = velocity_slopes(t, q, qd)
            moves = np.isfinite(sure)
            slope = common_slope(slopes, sure)
            if slope is None or slope <= 0 or not moves.any():
                continue
            if (np.abs(sure[moves]) > 0.9).all() and np.ptp(slopes[moves]) < 0.2 * slope:
                return k, m
    return None
