"""Repair: a clock that is set while the robot moves on: wrapped counters, a synchronised PC."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynid.core import Array
from dynid.recording.table import Mask, RawTable, Rows

_FEWEST_ROWS = 50
_SIDE = 6
"""Rows on each side of a jump whose stamps and motion must be even."""
_FORWARD, _BACK = 3.0, -0.5
"""Steps beyond these are jumps [ordinary steps]."""
_EVEN = 0.5
"""Largest deviation of an even step, and of a displacement from that of an ordinary step."""
_MOST = 50
_LONGEST_SPAN = 3.0
"""Time may span this many times what the rows fill; longer gaps are shortened."""
_GAP_STEPS = 100


def mend_jumps(table: RawTable) -> RawTable:
    """Take jumps of the clock out where the robot moves on as in one ordinary step.

    Over rows that are missing, a moving robot has gone as far as the stamps say. Where it has
    gone one step only, the clock was set, or its counter began again.
    """
    if table.t is None or table.clock == "rate" or table.samples < _FEWEST_ROWS:
        return table
    t, q = table.t, table.signals["q"]
    ticks = np.ones(len(t) - 1) if table.index is None else np.diff(table.index).astype(np.float64)
    steps = np.diff(t)
    forward = steps[steps > 0] / ticks[steps > 0]
    nominal = float(np.median(forward)) if len(forward) else 0.0
    if nominal <= 0:
        return table
    share = steps / (nominal * ticks)
    places = np.flatnonzero((share > _FORWARD) | (share < _BACK))
    if not 0 < len(places) <= _MOST:
        return table
    jumps = [int(k) for k in places if _even(share, int(k)) and _moves_on(q, ticks, int(k))]
    if not jumps:
        return table
    mended = t.copy()
    for k in jumps:
        mended[k + 1 :] += nominal * ticks[k] - steps[k]
    largest = max(jumps, key=lambda k: abs(float(steps[k])))
    return replace(table, t=mended).report(
        "clock_mismatch",
        f"the clock jumps {len(jumps)} times while the robot moves on evenly, by "
        f"{steps[largest] / nominal:.6g} steps before {table.row(largest + 1)}: later stamps are "
        "shifted back",
    )


def _even(share: Array, k: int) -> bool:
    """Whether the stamps run evenly before and after: a late stamp would be caught up with."""
    around = np.concatenate([share[max(k - _SIDE, 0) : k], share[k + 1 : k + 1 + _SIDE]])
    return len(around) >= _SIDE and bool((np.abs(around - 1) < _EVEN).all())


def _moves_on(q: Array, ticks: Array, k: int) -> bool:
    """Whether joints move over step k as over the ordinary steps around it."""
    before, after = q[max(k - _SIDE, 0) : k + 1], q[k + 1 : k + 2 + _SIDE]
    if min(len(before), len(after)) < 3:
        return False
    speeds = [
        (rows[-1] - rows[0]) / float(ticks[start : start + len(rows) - 1].sum())
        for rows, start in ((before, max(k - _SIDE, 0)), (after, k + 1))
    ]
    expected = 0.5 * (speeds[0] + speeds[1]) * ticks[k]
    size = float(np.linalg.norm(expected))
    rough = max(
        float(np.abs(np.diff(rows, 2, axis=0)).mean(axis=0).max(initial=0.0))
        for rows in (before, after)
    )
    turned = float(np.linalg.norm(speeds[1] - speeds[0])) * float(ticks[k])
    miss = float(np.linalg.norm(q[k + 1] - q[k] - expected))
    return size > max(4 * rough, 1e-7) and max(miss, turned) < _EVEN * size


def shorten_gaps(table: RawTable) -> RawTable:
    """Shorten pauses of the recorder that are far longer than the recording itself."""
    if table.t is None or table.samples < _FEWEST_ROWS:
        return table
    steps = np.diff(table.t)
    nominal = float(np.median(steps))
    filled = nominal * len(steps)
    if nominal <= 0 or float(steps.sum()) <= _LONGEST_SPAN * filled:
        return table
    long: Mask = steps > _GAP_STEPS * nominal
    if not long.any() or float(steps[~long].sum()) > _LONGEST_SPAN * filled:
        return table
    places: Rows = np.flatnonzero(long)
    seconds = float(steps[long].sum())
    steps[long] = _GAP_STEPS * nominal
    t = np.concatenate([[table.t[0]], table.t[0] + np.cumsum(steps)])
    return replace(table, t=t).report(
        "clock_jitter",
        f"{len(places)} pauses of the recorder, {seconds / filled:.3g} times as long as all that "
        f"was recorded, are shortened to {_GAP_STEPS} steps each; the first before "
        f"{table.row(int(places[0]) + 1)}",
    )
