"""Repair: time stamps that repeat, run backwards, or are plainly wrong."""

from __future__ import annotations

from bisect import bisect_left

import numpy as np

from dynid.core import Array, RecordError
from dynid.recording.families import by_rows
from dynid.recording.table import Mask, RawTable, Rows

MOST_DROPPED = 0.2
"""Share of rows that may go for their stamps."""
_RARE = 0.005


def repair_stamps(table: RawTable) -> RawTable:
    """Leave out rows whose stamps cannot be true, so that time increases strictly.

    Raises:
        RecordError: Time does not run forwards, or more than a fifth of the rows would go.
    """
    if table.t is None or table.samples < 2:
        return table
    t = table.t
    steps = np.diff(t)
    forward = steps[steps > 0]
    if len(forward) == 0 or (len(forward) < 0.5 * np.count_nonzero(steps)):
        raise RecordError(
            "time does not run forwards",
            where=table.source,
            value=f"{len(forward)} of {len(steps)} steps are positive",
            next_step=f"Check which column is the time. {by_rows(table.columns)}",
        )
    nominal = float(np.median(forward))
    wrong = _single_outliers(t, nominal)
    if (steps <= 0).any():
        keep = np.flatnonzero(~wrong)
        wrong[np.setdiff1d(keep, keep[_longest_rise(t[keep])], assume_unique=True)] = True
    wrong |= _stray_ends(t, wrong, nominal)
    lost = int(wrong.sum())
    if lost == 0:
        return table
    if lost > MOST_DROPPED * table.samples and lost > 1:
        raise RecordError(
            f"{lost} of {table.samples} rows have stamps that repeat or run backwards",
            where=table.source,
            limit=f"{MOST_DROPPED:.0%} of the rows",
            next_step=by_rows(table.columns),
        )
    first = int(np.argmax(wrong))
    repeated = int(np.count_nonzero(steps == 0))
    if repeated > 0.02 * table.samples:
        table = table.report(
            "clock_jitter",
            f"{repeated} of {table.samples} stamps repeat the one before: the clock is too coarse "
            "for the rows; better leave t out and give --rate",
        )
    return table.keep(~wrong).report(
        "dropped_rows",
        f"{lost} of {table.samples} rows have stamps that repeat, run backwards or jump, and are "
        f"left out; first: {table.row(first)} (t = {t[first]:.9g})",
    )


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


def _stray_ends(t: Array, wrong: Mask, nominal: float) -> Mask:
    """One or two rows far away in time from all others, at either end."""
    stray = np.zeros(len(t), dtype=np.bool_)
    keep = np.flatnonzero(~wrong)
    if len(keep) < 20:
        return stray
    steps = np.diff(t[keep])
    usual = max(float(np.quantile(steps, 0.95)), nominal)
    for count in (1, 2):
        if steps[-count] > 50 * usual:
            stray[keep[-count:]] = True
        if steps[count - 1] > 50 * usual:
            stray[keep[:count]] = True
    return stray
