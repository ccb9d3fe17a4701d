"""Repair: values that are missing, impossible, repeated or filled with zeros."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynid.core import RecordError
from dynid.recording.chosen import NOT_TAKEN
from dynid.recording.families import by_rows
from dynid.recording.table import ESSENTIAL, TORQUE_SOURCES, Mask, RawTable, rows_with

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
        signals = {
            name: np.where(np.abs(value) < ABSURD, value, np.nan)
            for name, value in table.signals.items()
        }
        t = None if table.t is None else np.where(np.abs(table.t) < 1e20, table.t, np.nan)
    table = replace(table, signals=signals, t=t)
    rows = table.samples
    alive = rows_with(np.isfinite(signals["q"]))
    if t is not None:
        if np.isnan(t).mean() > _MOST_LOST:
            raise RecordError(
                "the time column has no numbers on most rows",
                where=table.source,
                value=f"{int(np.isnan(t).sum())} of {rows}",
                next_step=by_rows(table.columns),
            )
        alive &= np.isfinite(t)
    _require_positions(table, alive)
    for quantity in [name for name in signals if name != "q"]:
        table = _judge(table, quantity, alive)
    table = _without_silence(table)
    if not any(name in table.signals for name in TORQUE_SOURCES):
        hints = [n.message for n in table.notices if n.kind == "dead_channel"]
        hints += [note for note in table.notes if note.startswith(NOT_TAKEN)]
        raise RecordError(
            "there is neither current nor effort",
            where=table.source,
            value="; ".join(hints) or None,
            next_step="A recording needs motor currents or joint torques; name their columns "
            "with --columns, for example current=13:19.",
        )
    good = np.all([np.isfinite(value).all(axis=1) for value in table.signals.values()], axis=0)
    if table.t is not None:
        good &= np.isfinite(table.t)
    if (~good).mean() > _MOST_LOST:
        raise RecordError(
            f"{int((~good).sum())} of {rows} rows cannot be used",
            where=table.source,
            limit="half of the rows",
            next_step=_first_cause(table, good),
        )
    fresh = ~good if table.reported is None else ~good & ~table.reported
    if fresh.any():
        table = table.report(
            "corrupt_rows",
            f"{int(fresh.sum())} of {rows} rows have missing or impossible values and are left "
            f"out; first: {_place(table, int(np.argmax(fresh)))}",
        )
    return table.keep(good)


def _without_silence(table: RawTable) -> RawTable:
    """Without a source of torque that is zero everywhere, where another is not.

    Drivers fill fields that their robot does not measure with zeros.
    """
    loud = {
        name: bool(np.nan_to_num(table.signals[name]).any())
        for name in TORQUE_SOURCES
        if name in table.signals
    }
    if all(loud.values()) or not any(loud.values()):
        return table
    silent = next(name for name, there in loud.items() if not there)
    return table.without(silent).report(
        "dead_channel", f"{silent} is 0 on every row of every joint; it is left out"
    )


def _require_positions(table: RawTable, alive: Mask) -> None:
    lost = np.isnan(table.signals["q"]).mean(axis=0)
    lost_alive = np.isnan(table.signals["q"][alive]).mean(axis=0) if alive.any() else lost
    joint = int(np.argmax(lost))
    if not alive.any() or lost[joint] > _MOST_LOST or lost_alive.max() > _MOST_LOST:
        raise RecordError(
            f"{table.label('q', joint)} has no numbers on most rows",
            where=table.source,
            value=f"{round(100 * float(lost[joint]))} % missing",
        )


def _judge(table: RawTable, quantity: str, alive: Mask) -> RawTable:
    """Keep a quantity, or leave it out where keeping it would cost too many rows."""
    value = table.signals[quantity]
    lost = np.isnan(value[alive]).any(axis=1)
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
        return table.report(
            "corrupt_rows",
            f"temperature is missing on {int(lost.sum())} rows; interpolated between the others",
        )
    others = [name for name in TORQUE_SOURCES if name in table.signals and name != quantity]
    spare = quantity in TORQUE_SOURCES and any(
        np.isfinite(table.signals[name][alive]).all() for name in others
    )
    limit = {True: _MOST_LOST, False: 0.01}[quantity in ESSENTIAL]
    if quantity == "qd" or spare:
        limit = 0.1
    if share <= limit:
        return table
    joint = int(np.argmax(np.isnan(value[alive]).mean(axis=0)))
    return table.without(quantity).report(
        "corrupt_rows",
        f"{table.label(quantity, joint)} has no usable number on {round(100 * share)} % of the "
        f"rows; {quantity} is left out",
    )


def _place(table: RawTable, index: int) -> str:
    if table.t is not None and not np.isfinite(table.t[index]):
        return f"{table.row(index)}, time"
    for quantity, value in table.signals.items():
        if not np.isfinite(value[index]).all():
            joint = int(np.argmax(~np.isfinite(value[index])))
            return f"{table.row(index)}, {table.label(quantity, joint)}"
    return table.row(index)


def _first_cause(table: RawTable, good: Mask) -> str:
    return f"The first is {_place(table, int(np.argmax(~good)))}."
