"""Repair: rows and stamps of their own, stamps that cannot be true, clocks that jump or restart."""

from bisect import bisect_left
from dataclasses import replace
from decimal import Decimal
from itertools import pairwise

import numpy as np

from dynid.core import Array, Mask, UnclearRecordError, scipy_part
from dynid.recording.headers import by_rows
from dynid.recording.repair.motion import DEGREE, FASTEST, common_slope, velocity_slopes
from dynid.recording.table import RawTable, Rows, at_times, rows_with

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
_FEWEST_BESIDE = 24
_FARTHEST = 5.0
"""Median steps of a quantity's own rows, across which it is still read between them."""


def lay_together(table: RawTable) -> RawTable:
    """Bring signals with rows of their own to the rows of q; drop rows of other topics."""
    t = table.stamps
    there = np.isfinite(t) & np.isfinite(table.signals["q"]).all(axis=1)
    if there.sum() < _FEWEST_BESIDE or there.all():
        return table
    for quantity in [name for name in table.signals if name != "q"]:
        value = table.signals[quantity]
        own = np.isfinite(t) & np.isfinite(value).all(axis=1)
        missing = there & ~own
        if missing.sum() <= _MOSTLY * there.sum() or (own & ~there).sum() < _FEWEST_BESIDE:
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
    why = "repeat all signals of the row before while the robot moves (read faster than updated)"
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


_DAY = 86400.0
_UNITS = {1.0: "s", 1e-3: "ms", 1e-6: "us", 1e-9: "ns", _DAY: "days"}
_DAY_COUNTS = ((3e4, 6e4), (7e5, 8e5))
"""Days since 1900, as spreadsheets count, and since year 0, as MATLAB does."""


def settle_unit(table: RawTable) -> RawTable:
    """Bring the stamps to seconds from the first sample.

    The unit is what the file says, else what makes positions and velocities agree, else
    what makes the sampling rate one of a robot (10 Hz to 10 kHz).
    """
    first = float(table.stamps[0])
    t = table.stamps - first
    scale = table.time_scale
    guessed = scale is None
    if scale is None:
        scale = _scale(t, table)
    # Rows before the first may have gone, so its stamp counts from where t was zero.
    stamp = f"{Decimal(table.t0) + Decimal(repr(first)):f}" if table.t0 else repr(first * scale)
    table = replace(table, t=t * scale, time_scale=1.0, t0=stamp)
    if guessed and scale != 1.0:
        rate = 1.0 / (float(np.median(np.diff(t))) * scale)
        # A robot's rate says which power of a thousand it is.
        table = table.report(
            "unit_suspect" if scale == _DAY else "time_unit",
            f"time stamps are in {_UNITS[scale]} by their size ({rate:.4g} Hz); converted to s",
        )
    step = float(np.median(np.diff(table.stamps)))
    if step < FASTEST:
        text = f"the time stamps say {1 / step:.4g} Hz, which is no robot's rate: another unit?"
        table = table.report("unit_suspect", text)
    return table


def _scale(t: Array, table: RawTable) -> float:
    step = float(np.median(np.diff(t)))
    q = table.signals["q"]
    if "qd" in table.signals:
        slope = common_slope(*velocity_slopes(t, q, table.signals["qd"]))
        if slope is not None and slope > 0:
            # Degrees on one side only show as a factor of 57.3 on top of the unit.
            for scale in _UNITS:
                for factor in (1.0, DEGREE, 1 / DEGREE):
                    if step * scale > FASTEST and abs(slope / (scale * factor) - 1) < 0.25:
                        return scale
    first = float(table.stamps[0])
    if step < FASTEST and any(low < first < high for low, high in _DAY_COUNTS):
        return _DAY
    if step < 0.5:
        return 1.0
    scale = 1e-3 if step < 100 else 1e-6 if step < 1e5 else 1e-9
    # A slow log of a moving robot has large steps of position as well.
    speed = float(np.quantile(np.abs(np.diff(q, axis=0)), 0.99)) / (step * scale)
    return 1.0 if speed > 50 else scale


_BESIDE = 9
"""Rows on each side of a wide step that tell whether it is a gap."""


def report_clock(table: RawTable) -> RawTable:
    """Report gaps and jitter of the stamps."""
    steps = np.diff(table.stamps)
    nominal = float(np.median(steps))
    # Where rows were left out the step is wide by our own doing, and reported as such.
    steps = np.where(table.ticks > 1, nominal, steps)
    # After a gap all stamps are later than rows that were counted let expect, after jitter few are.
    late = np.concatenate([[0.0], np.cumsum(steps - nominal)])
    padded = np.pad(late, _BESIDE - 1, mode="edge")
    usual = np.median(np.lib.stride_tricks.sliding_window_view(padded, _BESIDE), axis=1)
    gaps = (steps > 1.5 * nominal) & (usual[_BESIDE:] - usual[:-_BESIDE] > 0.5 * nominal)
    missing = int(np.sum(np.round(steps[gaps] / nominal) - 1))
    jitter = 100 * float(np.quantile(np.abs(steps - nominal), 0.99)) / nominal
    parts: list[str] = []
    if jitter > 5:
        span = f"steps between {1e3 * steps.min():.4g} and {1e3 * steps.max():.4g} ms"
        parts.append(f"{span}, {jitter:.0f} % off the nominal")
    if missing > 0:
        largest = int(np.argmax(np.where(gaps, steps, 0.0)))
        parts.append(
            f"gaps: {int(gaps.sum())}, samples missing: about {missing}, the largest "
            f"{1e3 * steps[largest]:.4g} ms before {table.row(largest + 1)}"
        )
    if not parts:
        return table
    return table.report("clock_jitter", f"nominal {1 / nominal:.5g} Hz; {'; '.join(parts)}")


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
"""Length of the pause that replaces a longer one, and of that between two runs [median steps]."""


def mend_jumps(table: RawTable) -> RawTable:
    """Take jumps of the clock out where the robot moves on as in one ordinary step.

    Over rows that are missing, a moving robot has gone as far as the stamps say. Where it has
    gone one step only, the clock was set, or its counter began again.
    """
    t, q, ticks = table.stamps, table.signals["q"], table.ticks
    steps = np.diff(t)
    forward = steps[steps > 0] / ticks[steps > 0]
    nominal = float(np.median(forward)) if len(forward) else 0.0
    if nominal <= 0:
        return table
    share = steps / (nominal * ticks)
    places = np.flatnonzero((share > _FORWARD) | (share < _BACK))
    if not 0 < len(places) <= _MOST:
        return table
    jumps = [k for k in places.tolist() if _moves_on(share, q, ticks, k)]
    if not jumps:
        return table
    mended = t.copy()
    for k in jumps:
        mended[k + 1 :] += nominal * ticks[k] - steps[k]
    largest = max(jumps, key=lambda k: abs(float(steps[k])))
    return replace(table, t=mended).report(
        "clock_mismatch",
        f"jumps of the clock while the robot moves on evenly: {len(jumps)}, the largest by "
        f"{steps[largest] / nominal:.6g} steps before {table.row(largest + 1)}; later stamps are "
        "shifted back",
    )


def _moves_on(share: Array, q: Array, ticks: Array, k: int) -> bool:
    """Whether joints move over step k as over the ordinary steps around it.

    A late stamp would be caught up with: the stamps run evenly before and after.
    """
    around = np.concatenate([share[max(k - _SIDE, 0) : k], share[k + 1 : k + 1 + _SIDE]])
    if len(around) < _SIDE or (np.abs(around - 1) >= _EVEN).any():
        return False
    before, after = q[max(k - _SIDE, 0) : k + 1], q[k + 1 : k + 2 + _SIDE]
    if min(len(before), len(after)) < 3:
        return False
    speeds: list[Array] = [
        (rows[-1] - rows[0]) / float(ticks[start : start + len(rows) - 1].sum())
        for rows, start in ((before, max(k - _SIDE, 0)), (after, k + 1))
    ]
    expected: Array = 0.5 * (speeds[0] + speeds[1]) * ticks[k]
    size = float(np.linalg.norm(expected))
    bends = [np.abs(np.diff(rows, 2, axis=0)).mean(axis=0) for rows in (before, after)]
    rough = float(np.max(bends, initial=0.0))
    turn: Array = speeds[1] - speeds[0]
    off: Array = q[k + 1] - q[k] - expected
    turned, miss = float(np.linalg.norm(turn) * ticks[k]), float(np.linalg.norm(off))
    return size > max(4 * rough, 1e-7) and max(miss, turned) < _EVEN * size


def shorten_gaps(table: RawTable) -> RawTable:
    """Shorten pauses of the recorder that are far longer than the recording itself."""
    steps = np.diff(table.stamps)
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
    t = float(table.stamps[0]) + np.pad(np.cumsum(steps), (1, 0))
    return replace(table, t=t).report(
        "clock_jitter",
        f"{len(places)} pauses of the recorder, {seconds / filled:.3g} times as long as all that "
        f"was recorded, are shortened to {_GAP_STEPS} steps each; the first before "
        f"{table.row(int(places[0]) + 1)}",
    )


_MOST_RUNS = 100
_COARSE = 0.1
"""Stamps are coarse where their smallest step is this share of the rows' true step."""


def join_runs(table: RawTable) -> RawTable:
    """Put runs behind each other where time starts anew."""
    t = table.stamps
    steps = np.diff(t)
    nominal = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    if nominal <= 0:
        return table
    starts = np.array([0, *(np.flatnonzero(steps < -0.5 * _FEWEST_ROWS * nominal) + 1)])
    ends = np.array([*starts[1:], len(t)])
    if not 1 < len(starts) <= _MOST_RUNS or not _are_runs(t, starts, ends, nominal):
        return table
    joined, counted = t.copy(), table.index.copy()
    for start, end in zip(starts[1:].tolist(), ends[1:].tolist(), strict=True):
        joined[start:end] += float(joined[start - 1] - t[start]) + _GAP_STEPS * nominal
        counted[start:] += _GAP_STEPS
    where = ", ".join(table.row(int(row)) for row in starts[1:6])
    return replace(table, t=joined, index=counted).report(
        "clock_mismatch",
        f"time starts anew at {where}: {len(starts)} runs in one file, put behind each other "
        f"with a pause of {_GAP_STEPS} steps",
    )


def _are_runs(t: Array, starts: Rows, ends: Rows, nominal: float) -> bool:
    """Whether each piece is long, and starts where the one before started."""
    # A piece may end in a wrong stamp: its length is that of its rows.
    length = nominal * (ends - starts)
    anew = t[starts[1:]] < t[starts[:-1]] + 0.5 * length[:-1]
    return bool((ends - starts >= _FEWEST_ROWS).all() and anew.all())


def _goes_with_time(q: Array, steps: Array) -> bool:
    """Whether joints go further over longer steps: then rows are missing, and the stamps right.

    Over the neighbours' mean, a joint goes as much further as the step is longer, or no further.
    """
    gone = np.linalg.norm(np.diff(q, axis=0), axis=1)
    even = np.full(_BESIDE, 1.0 / _BESIDE)
    usual, usual_step = (np.convolve(x, even, "same") for x in (gone, steps))
    moving = (usual > 0.1 * float(np.nanmax(usual, initial=0.0))) & (usual_step > 0)
    longer, further = steps[moving] / usual_step[moving] - 1, gone[moving] / usual[moving] - 1
    return bool(longer @ further > 0.5 * (longer @ longer))


def spread_stamps(table: RawTable) -> RawTable:
    """Spread stamps evenly over the rows where they are even but for their few digits.

    Stamps of 10 ms for rows that come every 8 ms repeat; their places in time are known by the
    rows, as long as none is more than one digit off an even clock.
    """
    t, rows = table.stamps, table.index.astype(np.float64)
    steps = np.diff(t)
    rising = steps[steps > 0]
    if len(rising) < 8 or (steps < 0).any():
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
    if _goes_with_time(table.signals["q"], steps):
        return table
    # The clock tells a stamp's digit when it is over: the true times are not known better.
    repeated = int((steps == 0).sum())
    return replace(table, t=even).report(
        "clock_jitter",
        f"the stamps go in steps of {digit:.4g}, {repeated} of {table.samples} repeat; they are "
        f"spread evenly over the rows (one each {slope:.6g})",
    )
