"""Repair: values held while the robot moved on, and numbers that stand for no value."""

from __future__ import annotations

import numpy as np

from dynid.core import Array
from dynid.recording.table import ESSENTIAL, TORQUE_SOURCES, Mask, RawTable

_POSITIONS_HELD = 5
_TORQUES_HELD = 25
_TIMES_USUAL = 8.0
"""A value is held where it stays this many times as long as such values usually stay."""
_PLACEHOLDER_ROWS = 3
_FAR = 3.0
"""Numbers that stand for no value lie this many times the signal's range beyond it."""
_MOST = 0.2
"""More of the rows than this are not left out but told."""


def drop_frozen(table: RawTable) -> RawTable:
    """Leave out stretches in which positions or torques were held while the robot moved.

    Positions are held where they are the same on all joints and then jump as far as the
    robot has gone meanwhile. Torques are held where a number stays far longer than is usual
    for it, while its joint moves. A number that stays the same far beyond all others, such as
    -9999, stands for no value.
    """
    if table.samples < 100:
        return table
    table = _drop_placeholders(table)
    for held, what in ((_held_positions(table.signals["q"]), "positions"), *_torques(table)):
        if not held.any():
            continue
        first = table.row(int(np.argmax(held)))
        count = f"{int(held.sum())} of {table.samples} rows repeat the {what} of the row before"
        if held.mean() > _MOST:
            return table.report(
                "corrupt_rows",
                f"{count} while the robot moves, too many to leave out; first: {first}",
            )
        # Masks are of the table as it was: one kind of damage at a time.
        kept = table.keep(~held).report(
            "corrupt_rows", f"{count} while the robot moves; they are left out; first: {first}"
        )
        return drop_frozen(kept)
    return table


def _drop_placeholders(table: RawTable) -> RawTable:
    for quantity in [name for name in ESSENTIAL if name in table.signals]:
        value = table.signals[quantity]
        bad = np.any([_placeholders(column) for column in value.T], axis=0)
        if quantity in TORQUE_SOURCES and table.joints > 1:
            # A controller that waits for its sensors writes zeros for all of them.
            silent: Mask = (value == 0).all(axis=1)
            bad |= silent if _long(silent) else False
        if bad.any() and bad.mean() <= _MOST:
            row = int(np.argmax(bad))
            joint = int(np.argmax(np.abs(value[row] - np.median(value, axis=0))))
            table = table.keep(~bad).report(
                "corrupt_rows",
                f"{int(bad.sum())} of {table.samples} rows have numbers in {quantity} that stand "
                f"for no value and are left out; first: {table.label(quantity, joint)} at "
                f"{table.row(row)} ({value[row, joint]:.6g})",
            )
    return table


def _long(mask: Mask) -> bool:
    """Whether a mask has a run of some rows."""
    return any(length >= _PLACEHOLDER_ROWS for _, length in _runs(mask))


def _placeholders(column: Array) -> Mask:
    """Rows of a number that repeats itself, far beyond the numbers that do not."""
    same: Mask = np.concatenate([[False], np.diff(column) == 0])
    long = [run for run in _runs(same) if run[1] + 1 >= _PLACEHOLDER_ROWS]
    bad = np.zeros(len(column), dtype=np.bool_)
    single = np.ones(len(column), dtype=np.bool_)
    for start, length in long:
        single[start - 1 : start + length] = False
    if not long or single.sum() < 0.5 * len(column):
        return bad
    low, high = np.quantile(column[single], [0.005, 0.995])
    far = _FAR * float(high - low)
    if far > 0:
        for start, length in long:
            if not low - far <= float(column[start]) <= high + far:
                bad[start - 1 : start + length] = True
    return bad


def _torques(table: RawTable) -> list[tuple[Mask, str]]:
    q = table.signals["q"]
    return [
        (_held_torques(table.signals[name], q), name)
        for name in TORQUE_SOURCES
        if name in table.signals
    ]


def _runs(same: Mask) -> list[tuple[int, int]]:
    """First row and length of each run of rows that say what the row before them said."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]])))
    return [
        (int(a), int(b - a)) for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    ]


def _held_positions(q: Array) -> Mask:
    held = np.zeros(len(q), dtype=np.bool_)
    steps = np.diff(q, axis=0)
    same: Mask = np.concatenate([[False], (steps == 0).all(axis=1)])
    for start, length in _runs(same):
        stop = start + length
        if length < _POSITIONS_HELD or start < 3 or stop + 2 >= len(q):
            continue
        jump = np.abs(q[stop] - q[stop - 1])
        joint = int(np.argmax(jump))
        before = 0.5 * abs(float(q[start - 1, joint] - q[start - 3, joint]))
        after = 0.5 * abs(float(q[stop + 2, joint] - q[stop, joint]))
        # A coarse position stands still and goes one grain further; one at rest stays.
        least = max(0.3 * length, 4.0) * max(before, after)
        if before > 0 and after > 0 and float(jump[joint]) > least:
            held[start:stop] = True
    return held


def _held_torques(torque: Array, q: Array) -> Mask:
    held = np.zeros(len(q), dtype=np.bool_)
    for joint in range(torque.shape[1]):
        column, position = torque[:, joint], q[:, joint]
        same: Mask = np.concatenate([[False], np.diff(column) == 0])
        runs = _runs(same)
        long = [run for run in runs if run[1] >= _TORQUES_HELD]
        if not long or float(np.ptp(column)) == 0:
            continue
        # Joints at rest hold their torque: only what happens in motion is usual.
        reach = 0.01 * float(np.ptp(position))
        moved = {run: abs(float(position[sum(run) - 1] - position[run[0] - 1])) for run in runs}
        in_motion = [length for start, length in runs if moved[start, length] > 0.1 * reach]
        rows_of_runs = np.repeat(in_motion, in_motion) if in_motion else np.zeros(1)
        single = int((~same).sum())
        usual = float(np.quantile(np.concatenate([rows_of_runs, np.ones(single)]), 0.75))
        low, high = float(column.min()), float(column.max())
        for start, length in long:
            inner = low < float(column[start]) < high
            moving = moved[start, length] > max(reach, 1e-4)
            if inner and moving and length > _TIMES_USUAL * usual:
                # A zero stands for no value at all: the row before says nothing either.
                held[start - (column[start] == 0) : start + length] = True
    return held
