"""Repair: rows that only say again what the row before said."""

from __future__ import annotations

import numpy as np

from dynid.core import Array
from dynid.recording.table import Mask, RawTable, rows_with


def drop_repeats(table: RawTable) -> RawTable:
    """Leave out rows that say again what the row before said.

    A repeated stamp with the same values is a row written twice. New stamps with exactly
    the same positions and torques, while the robot moves, are a reader that ran faster than
    the robot's updates: those rows are no measurements.
    """
    if table.samples < 3:
        return table
    stacked = np.concatenate(list(table.signals.values()), axis=1)
    same = np.concatenate([[False], (stacked[1:] == stacked[:-1]).all(axis=1)])
    if table.t is not None:
        twice = same & np.concatenate([[False], table.t[1:] == table.t[:-1]])
        if twice.any():
            message = (
                f"{int(twice.sum())} of {table.samples} rows were written twice; first: "
                f"{table.row(int(np.argmax(twice)))}"
            )
            table = table.keep(~twice).report("dropped_rows", message)
            same = same[~twice]
    moving = _moves(table.signals["q"])
    held = same & moving
    if held.sum() < max(3, 0.002 * table.samples) or held.mean() > 0.9:
        return _report_slow_signals(table, moving)
    message = (
        f"{int(held.sum())} of {table.samples} rows repeat all signals of the row before "
        f"while the robot moves (read faster than they are updated); left out; first: "
        f"{table.row(int(np.argmax(held)))}"
    )
    return table.keep(~held).report("dropped_rows", message)


def _report_slow_signals(table: RawTable, moving: Mask) -> RawTable:
    """Report positions or torques that are renewed on some rows only."""
    for quantity, word in (("q", "positions"), ("effort", "efforts"), ("current", "currents")):
        if quantity not in table.signals or not table.signals[quantity].any():
            continue
        changes = rows_with(np.diff(table.signals[quantity], axis=0) != 0)
        still = np.concatenate([[False], ~changes])
        share = float((still & moving).sum()) / max(float(moving.sum()), 1.0)
        if share >= 0.3:
            table = table.report(
                "clock_jitter",
                f"{word} are the same as on the row before on {100 * share:.0f} % of the rows of "
                "the motion: they are renewed more slowly than the rows come, or too coarse",
            )
    return table


def _moves(q: Array) -> Mask:
    """Rows with motion shortly before and after."""
    changed = np.concatenate([[False], (np.diff(q, axis=0) != 0).any(axis=1)])
    total = np.concatenate([[0], np.cumsum(changed)])
    index = np.arange(len(q))
    window = 20
    before = total[index] - total[np.maximum(index - window, 0)]
    after = total[np.minimum(index + 1 + window, len(q))] - total[index + 1]
    # The first and last rows have one side only to judge by.
    first, last = index < window, index >= len(q) - window
    return ((before > 0) | first) & ((after > 0) | last) & (before + after > 0)
