"""Repair: the unit of time, clocks that jump or start anew, and what the clock is worth."""

from dataclasses import replace
from decimal import Decimal

import numpy as np

from dynid.core import Array
from dynid.recording.repair.motion import DEGREE, FASTEST, common_slope, velocity_slopes
from dynid.recording.table import Mask, RawTable, Rows

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
        table = table.report(
            "unit_suspect",
            f"the time stamps say {1 / step:.4g} Hz, which is no robot's rate: "
            "probably another unit",
        )
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
        parts.append(
            f"steps between {1e3 * steps.min():.4g} and {1e3 * steps.max():.4g} ms, "
            f"{jitter:.0f} % off the nominal"
        )
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
    rough = max(
        float(np.abs(np.diff(rows, 2, axis=0)).mean(axis=0).max(initial=0.0))
        for rows in (before, after)
    )
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
