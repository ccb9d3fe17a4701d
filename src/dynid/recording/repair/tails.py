"""Repair: invalid samples at the ends, where a recorder starts or a robot is stopped hard."""

from __future__ import annotations

import numpy as np

from dynid.core import Array
from dynid.recording.table import Mask, RawTable, Rows

_MOST = 50
_TIMES = 2.2


def drop_broken_ends(table: RawTable) -> RawTable:
    """Leave out the first or last few rows where a signal breaks off.

    At most 2 % of the rows and 50 of them at each end; a break is a step of position or
    velocity more than twice the largest in all the rest of the recording.
    """
    most = min(_MOST, table.samples // 50)
    if most < 2:
        return table
    # A step over rows that were left out is a step of as many rows.
    ticks = np.ones(table.samples - 1) if table.index is None else np.diff(table.index)
    bad = np.zeros(table.samples, dtype=np.bool_)
    for quantity in ("q", "qd"):
        if quantity in table.signals:
            bad |= _broken(table.signals[quantity], ticks, most)
    if not bad.any():
        return table
    first = int(np.argmax(bad))
    side = "end" if bad[-1] and not bad[0] else "start" if bad[0] and not bad[-1] else "ends"
    return table.keep(~bad).report(
        "corrupt_rows",
        f"{int(bad.sum())} rows at the {side} break off from the motion and are left out; first: "
        f"{table.row(first)}",
    )


def _broken(value: Array, ticks: Array | Rows, most: int) -> Mask:
    steps = np.abs(np.diff(value, axis=0)) / ticks[:, None]
    inner = steps[most:-most].max(axis=0)
    over = (steps > _TIMES * inner) & (steps > 1e-3) & (inner > 0)
    rows = over.any(axis=1)
    bad = np.zeros(len(value), dtype=np.bool_)
    head, tail = np.flatnonzero(rows[:most]), np.flatnonzero(rows[-most:])
    if len(head):
        bad[: int(head[-1]) + 1] = True
    if len(tail):
        bad[len(value) - most + int(tail[0]) :] = True
    return bad
