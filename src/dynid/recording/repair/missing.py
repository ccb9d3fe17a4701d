"""Repair: values that are missing, held, placeholders, or broken off at the ends."""

from dataclasses import replace

import numpy as np

from dynid.core import Array, Mask, RecordError, UnclearRecordError, printable
from dynid.recording.headers import by_rows, spelled
from dynid.recording.table import ESSENTIAL, TORQUE_SOURCES, RawTable, rows_with

ABSURD = 1e12
"""No robot signal is larger, in any unit; larger values count as missing."""
_MOST_LOST = 0.5


def drop_missing(table: RawTable) -> RawTable:
    """Leave out rows with missing values, or quantities that are missing mostly.

    Raises:
        RecordError: Positions, or every source of torque, are missing; or more than half of
            the rows would go.
    """
    with np.errstate(invalid="ignore"):
        given = table.signals.items()
        signals = {name: np.where(np.abs(x) < ABSURD, x, np.nan) for name, x in given}
        t: Array = np.where(np.abs(table.stamps) < 1e20, table.stamps, np.nan)
    table = replace(table, signals=signals, t=t)
    rows = table.samples
    known = rows_with(np.isfinite(signals["q"])) & np.isfinite(t)
    if np.isnan(t).mean() > _MOST_LOST:
        what, count = "the time column has no numbers on most rows", int(np.isnan(t).sum())
        step = by_rows(table.columns)
        raise UnclearRecordError(what, value=f"{count} of {rows}", next_step=step)
    lost = np.isnan(signals["q"]).mean(axis=0)
    lost_known = np.isnan(signals["q"][known]).mean(axis=0) if known.any() else np.ones(1)
    joint = int(np.argmax(lost))
    if max(lost[joint], lost_known.max()) > _MOST_LOST:
        what = f"{table.label('q', joint)} has no numbers on most rows"
        raise RecordError(what, value=f"{round(100 * float(lost[joint]))} % missing")
    for quantity in [name for name in signals if name != "q"]:
        table = _judge(table, quantity, known)
    table = _without_zeros(table)
    if not any(name in table.signals for name in TORQUE_SOURCES):
        hints = [notice.text for notice in table.notices if notice.kind == "dead_channel"]
        if table.channels:
            hints.append(f"unknown columns: {printable(', '.join(table.channels), 200)}")
        hints += table.notes
        raise UnclearRecordError(
            "there is neither current nor effort",
            value="; ".join(hints) or None,
            next_step="A recording needs motor currents or joint torques; name all columns "
            f"with --columns: {_with_torques(table)}.",
        )
    good = np.all([np.isfinite(value).all(axis=1) for value in table.signals.values()], axis=0)
    good &= np.isfinite(t)
    if (~good).mean() > _MOST_LOST:
        raise RecordError(
            f"{int((~good).sum())} of {rows} rows cannot be used",
            limit="half of the rows",
            next_step=f"The first is {_place(table, int(np.argmax(~good)))}.",
        )
    fresh = ~good & ~table.reported
    if fresh.any():
        table = table.report(
            "corrupt_rows",
            f"{int(fresh.sum())} of {rows} rows have missing or impossible values and are left "
            f"out; first: {_place(table, int(np.argmax(fresh)))}",
        )
    return table.keep(good)


def _with_torques(table: RawTable) -> str:
    """How all columns are named, where those of the torques are not known."""
    kept = {name: table.columns[name] for name in ("q", "qd") if name in table.columns}
    if "q" not in kept:
        return "t=PATH,q=PATH,effort=PATH"
    return f"t=COLUMN,{spelled(kept)},effort=FIRST:END (from 0, END excluded)"


def _without_zeros(table: RawTable) -> RawTable:
    """Without a source of torque that is zero everywhere, where another is not.

    Drivers fill fields that their robot does not measure with zeros.
    """
    sources = [name for name in TORQUE_SOURCES if name in table.signals]
    nonzero = {name: bool(np.nan_to_num(table.signals[name]).any()) for name in sources}
    if all(nonzero.values()) or not any(nonzero.values()):
        return table
    zero = next(name for name, found in nonzero.items() if not found)
    return table.without(zero).report(
        "dead_channel", f"{zero} is 0 on every row of every joint; it is left out"
    )


def _judge(table: RawTable, quantity: str, known: Mask) -> RawTable:
    """Keep a quantity, or leave it out where keeping it would cost too many rows."""
    value = table.signals[quantity]
    lost = np.isnan(value[known]).any(axis=1)
    share = float(lost.mean())
    if share == 0:
        return table
    if quantity == "temperature" and bool((np.isfinite(value).sum(axis=0) >= 2).all()):
        # Temperatures are slow, and often logged once a second only.
        index = np.arange(len(value), dtype=np.float64)
        filled = value.copy()
        for joint in range(table.joints):
            there = np.isfinite(value[:, joint])
            filled[:, joint] = np.interp(index, index[there], value[there, joint])
        table = table.with_signals({quantity: filled})
        text = f"temperature is missing on {int(lost.sum())} rows; interpolated between the others"
        return table.report("corrupt_rows", text)
    others = [name for name in TORQUE_SOURCES if name in table.signals and name != quantity]
    whole = (np.isfinite(table.signals[name][known]).all() for name in others)
    spare = quantity in TORQUE_SOURCES and any(whole)
    limit = _MOST_LOST if quantity in ESSENTIAL else 0.01
    if share <= (0.1 if quantity == "qd" or spare else limit):
        return table
    joint = int(np.argmax(np.isnan(value[known]).mean(axis=0)))
    return table.without(quantity).report(
        "dead_channel" if quantity in TORQUE_SOURCES else "corrupt_rows",
        f"{table.label(quantity, joint)} has no usable number on {round(100 * share)} % of the "
        f"rows; {quantity} is left out",
    )


def _place(table: RawTable, index: int) -> str:
    if not np.isfinite(table.stamps[index]):
        return f"{table.row(index)}, time"
    for quantity, value in table.signals.items():
        if not np.isfinite(value[index]).all():
            joint = int(np.argmax(~np.isfinite(value[index])))
            return f"{table.row(index)}, {table.label(quantity, joint)}"
    return table.row(index)


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
    q = table.signals["q"]
    torques = [name for name in TORQUE_SOURCES if name in table.signals]
    held_ones = [(_held_torques(table.signals[name], q), name) for name in torques]
    for held, what in ((_held_positions(q), "positions"), *held_ones):
        if not held.any():
            continue
        why = f"repeat the {what} of the row before while the robot moves"
        left = table.leave_out(held, why, most=_MOST)
        # Masks are of the table as it was: one kind of damage at a time.
        return left if held.mean() > _MOST else drop_frozen(left)
    return table


def _drop_placeholders(table: RawTable) -> RawTable:
    for quantity in [name for name in ESSENTIAL if name in table.signals]:
        value = table.signals[quantity]
        bad = np.any([_placeholders(column) for column in value.T], axis=0)
        if quantity in TORQUE_SOURCES and table.joints > 1:
            # A controller that waits for its sensors writes zeros for all of them.
            zeros: Mask = (value == 0).all(axis=1)
            if any(length >= _PLACEHOLDER_ROWS for _, length in _runs(zeros)):
                bad |= zeros
        if bad.any() and bad.mean() <= _MOST:
            row = int(np.argmax(bad))
            joint = int(np.argmax(np.abs(value[row] - np.median(value, axis=0))))
            what = f"{table.label(quantity, joint)}: {value[row, joint]:.6g}"
            table = table.leave_out(bad, f"have numbers that stand for no value ({what})")
    return table


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
    for start, length in long:
        if not low - far <= float(column[start]) <= high + far:
            bad[start - 1 : start + length] = True
    return bad


def _runs(same: Mask) -> list[tuple[int, int]]:
    """First row and length of each run of rows that say what the row before them said."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]])))
    return [(start, stop - start) for start, stop in edges.reshape(-1, 2).tolist()]


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


_TAILS_MOST = 50
_TIMES = 2.2


def drop_broken_ends(table: RawTable) -> RawTable:
    """Leave out the first or last few rows where a signal breaks off.

    At most 2 % of the rows and 50 of them at each end; a break is a step of position or
    velocity more than twice the largest in all the rest of the recording.
    """
    most = min(_TAILS_MOST, table.samples // 50)
    if most < 2:
        return table
    bad = np.zeros(table.samples, dtype=np.bool_)
    for quantity in ("q", "qd"):
        if quantity in table.signals:
            # A step over rows that were left out is a step of as many rows.
            bad |= _broken(table.signals[quantity], table.ticks, most)
    return table.leave_out(bad, "break off from the motion at an end")


def _broken(value: Array, ticks: Array, most: int) -> Mask:
    steps = np.abs(np.diff(value, axis=0)) / ticks[:, None]
    inner = steps[most:-most].max(axis=0)
    over = (steps > _TIMES * inner) & (steps > 1e-3) & (inner > 0)
    rows = over.any(axis=1)
    bad = np.zeros(len(value), dtype=np.bool_)
    head, tail = np.flatnonzero(rows[:most]), np.flatnonzero(rows[-most:])
    if len(head):
        bad[: int(head[-1]) + 1] = True
    if len(tail):
        bad[len(value) - most + int(tail[0]) :] = True
    return bad
