"""Repair: rows on stamps of their own, rows said twice, stamps that cannot be true."""

from bisect import bisect_left
from dataclasses import replace
from itertools import pairwise

import numpy as np

from dynid.core import Array, UnclearRecordError, scipy_part
from dynid.recording.headers import by_rows
from dynid.recording.table import Mask, RawTable, Rows, at_times, rows_with

MOST_DROPPED = 0.2
"""Share of rows that may go for their stamps."""
_RARE = 0.005


def repair_stamps(table: RawTable) -> RawTable:
    """Leave out rows whose stamps cannot be true, so that time increases strictly.

    Raises:
        RecordError: Time does not run forwards, or more than a fifth of the rows would go.
    """
    t = table.stamps
    steps = np.diff(t)
    forward = steps[steps > 0]
    if len(forward) == 0 or (len(forward) < 0.5 * np.count_nonzero(steps)):
        raise UnclearRecordError(
            "time does not increase",
            value=f"{len(forward)} of {len(steps)} steps are positive",
            # No two alike: rows in another order, not a clock that stood.
            next_step="Sort the rows by their time."
            if len(np.unique(t)) == len(t)
            else f"Check which column is the time. {by_rows(table.columns)}",
        )
    nominal = float(np.median(forward))
    wrong = _single_outliers(t, nominal)
    if (steps <= 0).any():
        keep = np.flatnonzero(~wrong)
        wrong[np.setdiff1d(keep, keep[_longest_rise(t[keep])], assume_unique=True)] = True
    lost = int(wrong.sum())
    if lost == 0:
        return table
    if lost > MOST_DROPPED * table.samples and lost > 1:
        raise UnclearRecordError(
            f"{lost} of {table.samples} rows have stamps that repeat or decrease",
            limit=f"{MOST_DROPPED:.0%} of the rows",
            next_step=by_rows(table.columns),
        )
    why = "have stamps that repeat, run backwards or jump,"
    return table.leave_out(wrong, why, "dropped_rows")


def _single_outliers(t: Array, nominal: float) -> Mask:
    """Stamps that are off while both neighbours agree with each other.

    Frequent deviations are jitter of the clock, which is kept and reported; rare ones on an
    otherwise steady clock are damage.
    """
    wrong = np.zeros(len(t), dtype=np.bool_)
    if len(t) < 8:
        return wrong
    middle = 0.5 * (t[2:] + t[:-2])
    off = t[1:-1] - middle
    # The largest of three, so that one wrong stamp does not blame its neighbours too.
    size = np.abs(off)
    padded = np.concatenate([[0.0], size, [0.0]])
    peak = (size >= padded[:-2]) & (size >= padded[2:])
    agree = np.abs(t[2:] - t[:-2] - 2 * nominal) < 0.5 * nominal
    spread = 1.4826 * float(np.median(np.abs(off - np.median(off))))
    suspect = agree & peak & (size > max(8 * spread, 0.02 * nominal))
    backwards = suspect & (size >= nominal)
    if np.count_nonzero(suspect) > max(3, _RARE * len(t)):
        suspect = backwards
    wrong[1:-1] = suspect
    return wrong


def _longest_rise(t: Array) -> Rows:
    """Indices of a longest strictly increasing subsequence, so that fewest rows go."""
    tails: list[float] = []
    ends: list[int] = []
    previous = np.full(len(t), -1, dtype=np.int64)
    for k, value in enumerate(t.tolist()):
        place = bisect_left(tails, value)
        if place == len(tails):
            tails.append(value)
            ends.append(k)
        else:
            tails[place] = value
            ends[place] = k
        previous[k] = ends[place - 1] if place else -1
    chain: list[int] = []
    k = ends[-1]
    while k >= 0:
        chain.append(k)
        k = int(previous[k])
    return np.array(chain[::-1], dtype=np.int64)


_MOSTLY = 0.1
"""A quantity that is missing on more of the rows of q than this has rows of its own."""
_FEWEST_ROWS = 24
_FARTHEST = 5.0
"""Median steps of a quantity's own rows, across which it is still read between them."""


def lay_together(table: RawTable) -> RawTable:
    """Bring signals with rows of their own to the rows of q; drop rows of other topics."""
    t = table.stamps
    there = np.isfinite(t) & np.isfinite(table.signals["q"]).all(axis=1)
    if there.sum() < _FEWEST_ROWS or there.all():
        return table
    for quantity in [name for name in table.signals if name != "q"]:
        value = table.signals[quantity]
        own = np.isfinite(t) & np.isfinite(value).all(axis=1)
        missing = there & ~own
        if missing.sum() <= _MOSTLY * there.sum() or (own & ~there).sum() < _FEWEST_ROWS:
            continue
        filled = value.copy()
        filled[missing] = at_times(t[missing], t[own], value[own], _FARTHEST)
        rates = [float(1.0 / np.median(np.diff(np.unique(t[rows])))) for rows in (own, there)]
        table = table.with_signals({quantity: filled}).report(
            "clock_mismatch",
            f"{quantity} has rows of its own, {rates[0] / rates[1]:.3g} times as many a second as "
            "q; it is read between them on straight lines",
        )
    return _without_blank(table)


def _without_blank(table: RawTable) -> RawTable:
    """Without rows that have no positions."""
    # Those that held another quantity only: it is on q's rows by now.
    blank = ~rows_with(~np.isnan(table.signals["q"]))
    if blank.mean() <= 0.05:
        return table
    kept = table.keep(~blank, counted=False)
    return replace(kept, index=np.arange(kept.samples, dtype=np.int64)).note(
        f"{int(blank.sum())} of {table.samples} rows have no positions: they are of other topics"
    )


def drop_repeats(table: RawTable) -> RawTable:
    """Leave out rows that say again what the row before said.

    A repeated stamp with the same values is a row written twice. New stamps with exactly
    the same positions and torques, while the robot moves, are a reader that ran faster than
    the robot's updates: those rows are no measurements.
    """
    stacked = np.concatenate(list(table.signals.values()), axis=1)
    same = np.concatenate([[False], (stacked[1:] == stacked[:-1]).all(axis=1)])
    twice = same & np.concatenate([[False], table.stamps[1:] == table.stamps[:-1]])
    table, same = table.leave_out(twice, "were written twice", "dropped_rows"), same[~twice]
    held = same & _moves(table.signals["q"])
    if held.sum() < max(3, 0.002 * table.samples) or held.mean() > 0.9:
        return table
    why = (
        "repeat all signals of the row before while the robot moves (read faster than they are "
        "updated)"
    )
    return table.leave_out(held, why, "dropped_rows")


_UNEVEN = 0.1
"""Share of renewals that may come more or fewer rows after the last one than others do."""


def fill_held(table: RawTable) -> RawTable:
    """Lay positions that are renewed on every k-th row on a smooth way between these rows.

    Positions that are written coarsely are kept: they change on rows at irregular distances, or by
    one step of their scale.
    """
    t, q = table.stamps, table.signals["q"]
    steps = np.abs(np.diff(q, axis=0))
    renewed = np.flatnonzero(rows_with(steps != 0)) + 1
    gaps = np.diff(renewed)
    usual = gaps[gaps <= 2 * np.median(gaps)].mean() if len(gaps) > 10 else 1.0
    every, uneven = round(usual), np.abs(gaps - usual) >= max(1.0, usual / 4)
    if every < 2 or uneven.mean() > _UNEVEN:
        return table
    small, large = np.quantile(steps[renewed - 1].max(axis=1), [0.1, 0.9])
    if large < 2 * small:
        return table
    # At rest they are renewed without a change.
    knots = np.concatenate(
        [np.arange(a, b - every // 2, every) for a, b in pairwise([0, *renewed])] + [renewed[-1:]]
    )
    way = scipy_part("interpolate").CubicSpline(t[knots], q[knots])
    return table.with_signals({"q": way(np.clip(t, t[knots[0]], t[knots[-1]]))}).report(
        "clock_jitter",
        f"positions are renewed every {usual:.3g} rows: those between are interpolated",
    )


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
