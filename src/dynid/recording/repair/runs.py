"""Repair: runs written one after another, whose time starts anew, and stamps with few digits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynid.core import Array
from dynid.recording.table import RawTable, Rows

_GAP_STEPS = 100
"""Pause that is put between two runs [median steps]: nobody mistakes it for motion."""
_FEWEST_ROWS = 50
_MOST_RUNS = 100
_COARSE = 0.1
"""Stamps are coarse where their smallest step is this share of the rows' true step."""


def join_runs(table: RawTable) -> RawTable:
    """Put runs behind each other where time starts anew.

    A run that is there twice, number by number, is left out.
    """
    if table.t is None or table.samples < 2 * _FEWEST_ROWS or table.clock != "recorded":
        return table
    t = table.t
    steps = np.diff(t)
    nominal = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    if nominal <= 0:
        return table
    starts = np.array([0, *(np.flatnonzero(steps < -0.5 * _FEWEST_ROWS * nominal) + 1)])
    ends = np.array([*starts[1:], len(t)])
    if not 1 < len(starts) <= _MOST_RUNS or not _are_runs(t, starts, ends, nominal):
        return table
    q = table.signals["q"]
    kept = np.ones(len(t), dtype=np.bool_)
    joined, index = t.copy(), table.index
    counted = np.arange(len(t), dtype=np.int64) if index is None else index.copy()
    last = float(t[ends[0] - 1])
    for number in range(1, len(starts)):
        rows = slice(int(starts[number]), int(ends[number]))
        for other in range(number):
            before = slice(int(starts[other]), int(ends[other]))
            if np.array_equal(q[rows], q[before]) and np.array_equal(t[rows], t[before]):
                kept[rows] = False
        if not kept[rows.start]:
            continue
        joined[rows] = t[rows] - float(t[rows.start]) + last + _GAP_STEPS * nominal
        last = float(joined[rows.stop - 1])
        counted[rows.start :] += _GAP_STEPS
    where = ", ".join(table.row(int(row)) for row in starts[1:6])
    table = replace(table, t=joined, index=counted).report(
        "clock_mismatch",
        f"time starts anew at {where}: {len(starts)} runs in one file, put behind each other "
        f"with a pause of {_GAP_STEPS} steps",
    )
    if kept.all():
        return table
    twice = int((~kept).sum())
    return table.keep(kept).report("dropped_rows", f"{twice} rows are of runs written twice")


def _are_runs(t: Array, starts: Rows, ends: Rows, nominal: float) -> bool:
    """Whether each piece is long, its time runs on, and starts where the one before started."""
    long = bool(((ends - starts) >= _FEWEST_ROWS).all())
    if not long:
        return False
    # A piece may end in a wrong stamp: its length is that of its rows.
    length = nominal * (ends - starts)
    anew = bool((t[starts[1:]] < t[starts[:-1]] + 0.5 * length[:-1]).all())
    return anew and all(
        bool((np.diff(t[start : end - 1]) > 0).mean() > 0.98)
        and abs(float(t[end - 1] - t[end - 2])) < 20 * nominal
        for start, end in zip(starts, ends, strict=True)
    )


def spread_stamps(table: RawTable) -> RawTable:
    """Spread stamps evenly over the rows where they are even but for their few digits.

    Stamps of 10 ms for rows that come every 8 ms repeat; their places in time are known by the
    rows, as long as none is more than one digit off an even clock.
    """
    if table.t is None or table.samples < 24:
        return table
    t, index = table.t, table.index
    rows = np.arange(len(t), dtype=np.float64) if index is None else index.astype(np.float64)
    steps = np.diff(t)
    rising = steps[steps > 0]
    if len(rising) < 8 or table.clock != "recorded" or (steps < 0).any():
        return table
    digit = float(rising.min())
    multiples = rising / digit
    count = rows - rows.mean()
    slope = float(count @ t) / float(count @ count)
    even: Array = float(t.mean()) + slope * count
    if not slope > 0 or digit < _COARSE * slope or float(multiples.max()) > 20:
        return table
    coarse = np.abs(multiples - np.round(multiples)).max() < 0.01
    off = t - even
    # One odd row among even ones is no coarse clock.
    uneven = float((np.abs(steps - slope * np.diff(rows)) > 0.02 * slope).mean()) > 0.05
    if not coarse or not uneven or float(np.ptp(off)) > 1.5 * digit:
        return table
    # The clock tells a stamp's digit when it is over: the true times are not known better.
    repeated = int((steps == 0).sum())
    return replace(table, t=even).report(
        "clock_jitter",
        f"the stamps go in steps of {digit:.4g}, {repeated} of {table.samples} repeat; they are "
        f"spread evenly over the rows (one each {slope:.6g})",
    )
