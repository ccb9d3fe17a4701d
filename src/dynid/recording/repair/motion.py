"""Repair: samples and stretches that no motion can have made, velocities against the motion."""

import math

import numpy as np

from dynid.core import Array, Mask
from dynid.recording.records import are_poses
from dynid.recording.table import TORQUE_SOURCES, RawTable, Rows, rows_with

DEGREE = np.pi / 180
"""A degree [rad]."""
RPM = np.pi / 30
"""A revolution a minute [rad/s]."""
FASTEST = 2e-5
"""Shortest step that a robot's recorder may have [s]."""


def velocity_slopes(t: Array, q: Array, qd: Array) -> tuple[Array, Array]:
    """How far joints move for each unit that their velocities say, and how surely.

    Args:
        t: (N) time.
        q: (N, n) positions.
        qd: (N, n) velocities.

    Returns:
        (n) slope of the displacement over the integrated velocity, and (n) their
        correlation; NaN for joints that hardly move.
    """
    slopes, correlations = np.full(q.shape[1], np.nan), np.full(q.shape[1], np.nan)
    window = min(max(4, len(t) // 20), 25) if len(t) < 4000 else min(len(t) // 150, 100)
    if len(t) < 4 * window:
        return slopes, correlations
    way = np.cumsum(0.5 * (qd[1:] + qd[:-1]) * np.diff(t)[:, None], axis=0)
    area = np.pad(way, ((1, 0), (0, 0)))
    stride = max(1, window // 2)
    said = (area[window:] - area[:-window])[::stride]
    moved = (q[window:] - q[:-window])[::stride]
    span = (t[window:] - t[:-window])[::stride]
    # Over a gap the integral of the velocity means nothing.
    close = span < 1.5 * np.median(span)
    said, moved = said[close], moved[close]
    for joint, (a, b) in enumerate(zip(said.T, moved.T, strict=True)):
        energy, motion = float(a @ a), float(b @ b)
        if np.abs(b).max(initial=0.0) < 5e-3:
            continue
        if energy <= 0:
            slopes[joint] = correlations[joint] = 0.0
            continue
        slopes[joint] = float(a @ b) / energy
        correlations[joint] = float(a @ b) / np.sqrt(energy * motion)
    return slopes, correlations


def common_slope(slopes: Array, correlations: Array) -> float | None:
    """The slope that the well correlated joints agree on, or None."""
    sure: Mask = np.isfinite(slopes) & (np.abs(np.nan_to_num(correlations)) > 0.95)
    return float(np.median(slopes[sure])) if sure.any() else None


def check_velocities(table: RawTable, rate_hz: float | None) -> RawTable:
    """Compare velocities with the motion: the clock, units and order of the columns.

    Velocities in another unit than positions are left out: both cannot be right.
    """
    nominal = 1.0 / float(np.median(np.diff(table.stamps)))
    if rate_hz is not None and table.clock != "rate" and abs(rate_hz / nominal - 1) > 0.03:
        text = f"the time stamps say {nominal:.5g} Hz, not the {rate_hz:.5g} Hz given; they stay"
        table = table.report("clock_mismatch", text)
    if "qd" not in table.signals:
        return table
    slopes, sure = velocity_slopes(table.stamps, table.signals["q"], table.signals["qd"])
    slope = common_slope(slopes, sure)
    if slope is None:
        odd = np.isfinite(sure) & (np.abs(np.nan_to_num(sure)) < 0.5)
        table = _report_odd(table, odd, "do not follow the motion")
        if odd.any() and bool((odd | ~np.isfinite(sure)).all()):
            return table.without("qd").note("qd is left out: it is no velocity of these joints")
        return table
    wrong = _wrong_unit(nominal, slope, np.where(np.abs(sure) > 0.95, slopes, np.nan))
    if wrong:
        return table.without("qd").report("unit_suspect", f"{wrong}; qd is left out")
    if abs(slope * DEGREE - 1) < 0.15:
        return table.report(
            "unit_suspect",
            "positions move 57.3 times as far as velocities in rad/s say: positions are probably "
            "in degrees, or velocities in rad/s already (--degrees converts both)",
        )
    table = _report_odd(table, slopes * np.sign(slope) < -0.5 * abs(slope), "have the other sign")
    low = np.isfinite(sure) & (np.abs(np.nan_to_num(sure)) < 0.5)
    table = _report_odd(table, low, "do not follow the motion")
    if abs(slope - 1) > 0.03:
        table = table.report(
            "clock_mismatch",
            f"positions move {slope:.4g} times as far as velocities and clock say: the clock "
            f"gives {nominal:.5g} Hz, the velocities {nominal / abs(slope):.4g} Hz",
        )
    return table


def _wrong_unit(nominal: float, slope: float, sure: Array) -> str:
    """What velocities are where they cannot be the joints' in rad/s; empty where they can."""
    if abs(slope / DEGREE - 1) < 0.15:
        return "velocities are 57.3 times what positions in rad say: they are in deg/s"
    if abs(slope / RPM - 1) < 0.05:
        return "velocities are 9.55 times what positions in rad say: they are in rpm"
    if abs(slope + 1) < 0.15:
        return "velocities have the other sign than the motion of all joints"
    times = np.abs(1 / sure)
    low, high = int(np.nanargmin(times)), int(np.nanargmax(times))
    least, most = float(times[low]), float(times[high])
    if most > 1.5 * least and max(most, 1 / least) > 3:
        return (
            f"velocities are {least:.4g} to {most:.4g} times what positions say (joints {low + 1} "
            f"and {high + 1}): in different units, or measured on the motors' side"
        )
    if nominal / abs(slope) > 1 / FASTEST:
        return f"velocities are {1 / slope:.4g} times what positions say: in another unit"
    return ""


def _report_odd(table: RawTable, odd: Mask, why: str) -> RawTable:
    if not odd.any():
        return table
    names = ", ".join(str(k + 1) for k in np.flatnonzero(odd))
    text = f"the velocities of joint {names} {why}: check the columns of q and qd"
    return table.report("unit_suspect", text)


_SHARE = 0.05
"""Spikes on more rows than this are noise: reported, kept."""
_ROUGH = 0.005
"""Torques that stand out on more rows than this are rough by nature, but for what is beyond their
usual range."""
_MOST_CANDIDATES = 0.15
_SMOOTH = 0.2
_BLOCK = 64
# How far above the local noise a sample must stand, and the least height that counts, as a
# share of the signal's range and in its own unit. Torques are rough: their bar is higher.
_BARS: dict[str, tuple[float, float, float]] = {
    "q": (15.0, 1e-4, 1e-3),
    "target_q": (15.0, 1e-4, 1e-3),
    "qd": (15.0, 0.02, 1e-2),
    "target_qd": (15.0, 0.02, 1e-2),
    "current": (15.0, 0.1, 0.0),
    "effort": (15.0, 0.1, 0.0),
    "temperature": (40.0, 0.5, 5.0),
}
_DEFAULT_BAR = (40.0, 0.5, 0.0)


def drop_spikes(table: RawTable) -> RawTable:
    """Leave out samples that stand far off the curve through their neighbours."""
    bad = np.zeros(table.samples, dtype=np.bool_)
    found: list[str] = []
    for quantity, value in table.signals.items():
        bar = _BARS.get(quantity, _DEFAULT_BAR)
        heights = np.column_stack([_find_spikes(table.stamps, x, *bar) for x in value.T])
        if quantity in ("q", "target_q"):
            heights = _without_late_readings(value, heights)
        elif quantity in TORQUE_SOURCES and rows_with(heights > 0).mean() > _ROUGH:
            low, high = np.quantile(value, [0.01, 0.99], axis=0)
            heights = np.where(heights > high - low, heights, 0.0)
        for joint in np.flatnonzero(heights.any(axis=0)).tolist():
            first = int(np.argmax(heights[:, joint] > 0))
            place = f"{table.label(quantity, joint)} at {table.row(first)}"
            found.append(f"{place} ({value[first, joint]:.6g})")
        bad |= rows_with(heights > 0)
    if not found:
        return table
    what = f"{', '.join(found[:3])}{' and others' if len(found) > 3 else ''}"
    return table.leave_out(bad, f"hold stray values ({what})", most=_SHARE)


def _without_late_readings(value: Array, heights: Array) -> Array:
    """Spare positions that were only read a little early or late.

    Such a sample is off by no more than the joint moves in two or three steps, and so are
    the other joints in the same row. It is spared as well where that happens often.
    """
    if not (heights > 0).any():
        return heights
    rows = np.arange(len(value), dtype=np.float64)
    typical = np.column_stack([_local_median(np.abs(np.diff(x, append=x[-1:]))) for x in value.T])
    off = np.column_stack([np.abs(_off_the_curve(rows, x, 1)) for x in value.T])
    share = off / np.maximum(typical, 1e-9)
    small = (heights > 0) & (heights < 2.5 * typical)
    moving = (typical > 1e-6) & ~small
    others = np.sum(np.where(moving, share, 0.0), axis=1) / np.maximum(moving.sum(axis=1), 1)
    late = small & ((others > 0.25)[:, None] | (small.sum(axis=1) >= 2)[:, None])
    if (small & ~late).any(axis=1).sum() > max(3, 0.002 * len(value)):
        late = small
    return np.where(late, 0.0, heights)


def _find_spikes(t: Array, x: Array, bar: float, share: float, least: float) -> Array:
    """Samples, alone or up to three in a row, that their neighbours contradict.

    A sample of x (N) is compared with the cubic over t (N) through two neighbours on each side. A
    kink or a jump of the true signal stays when the sample is left out; a spike does not. It
    exceeds `bar` times the local noise, `share` of the signal's range, and `least` in its unit.

    Returns:
        (N) height of each spike, 0 elsewhere.
    """
    heights = np.zeros(len(x))
    low, high = np.quantile(x, [0.01, 0.99])
    steps = np.abs(np.diff(x))
    grain = float(np.min(steps[steps > 0], initial=np.inf))
    floor = max(least, share * float(high - low), 4 * grain if np.isfinite(grain) else 0.0)
    if float(steps.max()) <= floor:
        return heights
    for width in (1, 2, 3):
        keep = np.flatnonzero(heights == 0)
        x_kept, bases = x[keep], (t[keep], np.arange(len(keep), dtype=np.float64))
        # Stamps may jitter while samples do not, or rows may be missing: a spike is off the
        # curve over time and over the row number as well.
        by_time, by_row = (_off_the_curve(base, x_kept, width) for base in bases)
        off = np.minimum(np.abs(by_time), np.abs(by_row))
        noise = 1.4826 * _local_median(off)
        candidates = np.flatnonzero(off > np.maximum(bar * noise, floor))
        if len(candidates) > _MOST_CANDIDATES * len(x):
            return np.zeros(len(x))
        for block, height in _confirmed(bases, x_kept, candidates, off, width):
            heights[keep[block]] = height
    return heights


def _off_the_curve(base: Array, x: Array, width: int) -> Array:
    """(N) distance of each sample to the cubic through the two before and after a block.

    The block is of `width` samples from the sample on; zero where neighbours are missing. `base`
    (N) is the abscissa, increasing.
    """
    off = np.zeros(len(x))
    n = len(x) - 3 - width
    starts = (0, 1, 2 + width, 3 + width)
    nodes = [base[k : n + k] for k in starts]
    at = slice(2, n + 2)
    for i, start in enumerate(starts):
        weight = np.ones(n)
        for j, other in enumerate(nodes):
            if j != i:
                weight = weight * ((base[at] - other) / (nodes[i] - other))
        off[at] += weight * x[start : n + start]
    off[at] -= x[at]
    return off


def _local_median(size: Array) -> Array:
    """(N) typical size nearby: block medians, the largest of a block and its neighbours."""
    blocks = -(-len(size) // _BLOCK)
    padded = np.pad(size, (0, blocks * _BLOCK - len(size)), mode="edge")
    medians = np.median(padded.reshape(blocks, _BLOCK), axis=1)
    edges = np.pad(medians, 1, mode="edge")
    widest = np.maximum(np.maximum(edges[:-2], edges[1:-1]), edges[2:])
    return np.repeat(widest, _BLOCK)[: len(size)]


def _confirmed(
    bases: tuple[Array, Array], x: Array, candidates: Rows, off: Array, width: int
) -> list[tuple[list[int], float]]:
    """The candidates whose neighbourhood is smooth once they are left out, highest first."""
    taken: list[tuple[list[int], float]] = []
    for k in sorted(candidates.tolist(), key=lambda k: -float(off[k])):
        block = list(range(k, k + width))
        if any(abs(k - other[0]) <= width + 1 for other, _ in taken):
            continue
        around = [j for j in range(k - 3, k + width + 3) if 0 <= j < len(x) and j not in block]
        sides = (k - 1, k + width)
        residue = min(max(_residue(base, x, around, j) for j in sides) for base in bases)
        height = min(float(off[k]), *(abs(float(x[m] - x[k - 1])) for m in block))
        if max(residue, _step_across(x, k, width)) < _SMOOTH * height:
            taken.append((block, float(off[k])))
    return taken


def _step_across(x: Array, k: int, width: int) -> float:
    """How far the signal has gone over a block, beyond what its slope on both sides explains.

    A spike comes back to where it left; a step, as of a slow sensor, does not.
    """
    before, after = k - 1, k + width
    slope = 0.5 * float(x[before] - x[before - 1] + x[after + 1] - x[after])
    return abs(float(x[after] - x[before]) - (width + 1) * slope)


def _residue(base: Array, x: Array, around: list[int], at: int) -> float:
    """Distance of one sample to the cubic through the four nearest of its neighbours."""
    nodes = sorted((m for m in around if m != at), key=lambda m: abs(m - at))[:4]
    points = [(float(base[m]), float(x[m])) for m in nodes]
    here, guess = float(base[at]), 0.0
    for node, value in points:
        others = (other for other, _ in points if other != node)
        guess += math.prod((here - other) / (node - other) for other in others) * value
    return abs(float(x[at]) - guess)


_LONGEST = 0.05
"""Longest stretch that is left out, as a share of the rows."""
_MOST_JUMPS = 200
_RENEWED = 0.03
"""Share of rows on which positions change, above which these are motion and no jumps."""


def drop_bursts(table: RawTable) -> RawTable:
    """Leave out stretches that positions enter and leave by impossible jumps.

    A jump without a way back is reported and kept: rows may be missing there.
    """
    q = table.signals["q"]
    # How many ordinary steps each step spans: rows were left out, or are missing.
    steps = np.diff(table.stamps)
    ticks = np.maximum(table.ticks, steps / float(np.median(steps)))
    bad = np.zeros(table.samples, dtype=np.bool_)
    open_jumps: list[tuple[int, int, float]] = []
    for joint in range(table.joints):
        stretches, left = _stretches(q[:, joint], ticks, max(12, int(_LONGEST * table.samples)))
        for start, stop in stretches:
            bad[start:stop] = True
        open_jumps += [(at, joint, float(q[at + 1, joint] - q[at, joint])) for at in left]
    # A jump of one joint inside a stretch that goes for another joint is gone with it.
    open_jumps = [jump for jump in open_jumps if not (bad[jump[0]] or bad[jump[0] + 1])]
    if open_jumps:
        at, joint, height = max(open_jumps, key=lambda jump: abs(jump[2]))
        table = table.report(
            "corrupt_rows",
            f"{table.label('q', joint)} jumps by {height:.4g} before {table.row(at + 1)} "
            f"({len(open_jumps)} such jumps): rows are missing, or two recordings in one",
        )
    return table.leave_out(bad, "have positions that the robot cannot have reached")


def _stretches(x: Array, ticks: Array, longest: int) -> tuple[list[tuple[int, int]], list[int]]:
    """Stretches between a jump away and a jump back, and the jumps that are left."""
    steps = np.abs(np.diff(x)) / ticks
    # Positions that are renewed every tenth row stand still on most rows.
    moved = steps[steps > 0]
    moved = moved if len(moved) > _RENEWED * len(steps) else steps
    usual = float(np.quantile(moved, 0.99))
    large = steps > max(6 * usual, 0.01)
    usual = float(np.quantile(steps[~large], 0.99))
    jumps = np.flatnonzero(large).tolist()
    if not jumps or len(jumps) > _MOST_JUMPS:
        return [], []
    found: list[tuple[int, int]] = []
    left: list[int] = []
    k = 0
    while k < len(jumps):
        start = int(jumps[k])
        back = next(
            (
                m
                for m in range(k + 1, len(jumps))
                if jumps[m] - start <= longest
                and abs(float(x[jumps[m] + 1] - x[start])) <= 2 * usual * (jumps[m] - start + 1)
            ),
            None,
        )
        if back is None:
            left.append(start)
            k += 1
        else:
            found.append((start + 1, int(jumps[back]) + 1))
            k = back + 1
    return found, left


def check_counted_rows(table: RawTable) -> RawTable:
    """Report rows that seem lost or doubled where time is counted by rows.

    Without stamps, a lost row shifts all later time. It shows as a step of all joints that
    is twice as long as those before and after.
    """
    q, index = table.signals["q"], table.index
    if are_poses(q):
        # Between single poses there is no motion that could tell.
        return table
    steps, ticks = np.diff(q, axis=0), table.ticks
    last = len(steps) - 6
    around = 0.25 * (steps[:last] + steps[1 : last + 1] + steps[5 : last + 5] + steps[6:])
    # Rows that were left out are known: they widen the window, they do not shift the clock.
    whole = np.all([ticks[k : last + k] == 1 for k in (0, 1, 5, 6)], axis=0)
    expected = index[5 : last + 5] - index[2 : last + 2]
    inside = q[5 : last + 5] - q[2 : last + 2]
    energy = np.sum(around * around, axis=1)
    fast = energy > 0.1 * float(np.quantile(energy, 0.9))
    lapse = np.sum(inside * around, axis=1) / np.where(energy > 0, energy, 1.0)
    miss: Array = np.sum((inside - lapse[:, None] * around) ** 2, axis=1)
    sure = miss < 0.01 * np.sum(inside * inside, axis=1)
    odd = fast & sure & whole & (expected < 12) & (np.abs(lapse - expected) > 0.6)
    rows = np.flatnonzero(odd)
    events = rows[np.concatenate([[True], np.diff(rows) > 8])[: len(rows)]]
    if len(events) == 0 or len(events) > 3 + 0.005 * table.samples:
        return table
    return table.report(
        "clock_mismatch",
        f"rows seem lost or doubled (places: {len(events)}), the first near "
        f"{table.row(int(events[0]) + 3)}: time counted from --rate is off after them",
    )


def drop_zero_positions(table: RawTable) -> RawTable:
    """Leave out rows whose positions are all exactly zero, reached by a jump: they are empty."""
    q = table.signals["q"]
    zero = ~rows_with(q != 0)
    if not zero.any() or zero.all():
        return table
    reach = np.abs(q).max(axis=1)
    edges = np.flatnonzero(np.diff(zero.astype(np.int8)) != 0)
    steps = np.delete(np.abs(np.diff(q, axis=0)).max(axis=1), edges)
    usual = float(np.quantile(steps, 0.9)) if len(steps) else 0.0
    # A robot that truly passes its zero comes there gradually.
    jumps = np.maximum(reach[edges], reach[edges + 1])
    if float(jumps.min()) < max(0.02 * float(np.median(reach[~zero])), 5 * usual):
        return table
    return table.leave_out(zero, "have only zeros as positions")
