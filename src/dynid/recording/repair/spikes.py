"""Repair: single samples that no motion can have made."""

import math

import numpy as np

from dynid.core import Array
from dynid.recording.table import TORQUE_SOURCES, RawTable, Rows, rows_with

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
            found.append(
                f"{table.label(quantity, joint)} at {table.row(first)} ({value[first, joint]:.6g})"
            )
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
        residue = min(
            max(_residue(base, x, around, j) for j in (k - 1, k + width)) for base in bases
        )
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
