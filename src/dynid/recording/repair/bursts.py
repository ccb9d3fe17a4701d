"""Repair: stretches of positions that the robot cannot have reached."""

from __future__ import annotations

import numpy as np

from dynid.core import Array
from dynid.recording.table import RawTable, rows_with

_LONGEST = 0.05
"""Longest stretch that is left out, as a share of the rows."""
_MOST_JUMPS = 200


def drop_bursts(table: RawTable) -> RawTable:
    """Leave out stretches that positions enter and leave by impossible jumps.

    A jump without a way back is reported and kept: rows may be missing there.
    """
    q = table.signals["q"]
    if table.samples < 24:
        return table
    ticks = _ticks(table)
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
            f"({len(open_jumps)} such jumps): rows missing, or two recordings in one?",
        )
    if not bad.any():
        return table
    return table.keep(~bad).report(
        "corrupt_rows",
        f"{int(bad.sum())} of {table.samples} rows have positions that the robot cannot have "
        f"reached and are left out; first: {table.row(int(np.argmax(bad)))}",
    )


def _ticks(table: RawTable) -> Array:
    """(N - 1) how many ordinary steps each step spans: rows were left out, or are missing."""
    ticks = np.ones(table.samples - 1)
    if table.index is not None:
        ticks = np.maximum(ticks, np.diff(table.index))
    if table.t is not None:
        steps = np.diff(table.t)
        ticks = np.maximum(ticks, steps / float(np.median(steps)))
    return ticks


def _stretches(x: Array, ticks: Array, longest: int) -> tuple[list[tuple[int, int]], list[int]]:
    """Stretches between a jump away and a jump back, and the jumps that are left."""
    steps = np.abs(np.diff(x)) / ticks
    ordinary, usual = (float(value) for value in np.quantile(steps, [0.9, 0.99]))
    edges = np.pad(steps, 1)
    # In a short recording a few jumps are more than one per cent of the steps: there they
    # must stand alone, as no motion does.
    lonely = (steps > 10 * np.maximum(edges[:-2], edges[2:])) & (steps > 10 * ordinary)
    large = (steps > max(6 * usual, 0.01)) | (lonely & (steps > 0.03))
    usual = float(np.quantile(steps[~large], 0.99)) if (~large).any() else usual
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
    if table.clock != "rate" or index is None or table.samples < 50:
        return table
    steps, ticks = np.diff(q, axis=0), np.diff(index)
    last = len(steps) - 6
    around = 0.25 * (steps[:last] + steps[1 : last + 1] + steps[5 : last + 5] + steps[6:])
    # Rows that were left out are known: they widen the window, they do not shift the clock.
    whole = (
        (ticks[:last] == 1)
        & (ticks[1 : last + 1] == 1)
        & (ticks[5 : last + 5] == 1)
        & (ticks[6:] == 1)
    )
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
        f"rows seem lost or doubled at {len(events)} places, the first near "
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
    return table.keep(~zero).report(
        "corrupt_rows",
        f"{int(zero.sum())} of {table.samples} rows have only zeros as positions and are left "
        f"out; first: {table.row(int(np.argmax(zero)))}",
    )
