"""From a raw table to a recording: every repair in its place, none of them silent."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.core import RecordError
from dynid.recording.record import ExperimentRecord, RecordMetadata
from dynid.recording.repair.angles import (
    convert_degrees,
    refuse_degrees,
    shift_turns,
    unwrap_turns,
)
from dynid.recording.repair.bursts import check_counted_rows, drop_bursts, drop_zero_positions
from dynid.recording.repair.clock import report_clock, settle_unit
from dynid.recording.repair.findings import report_odd_torques, report_rest, report_saturation
from dynid.recording.repair.frozen import drop_frozen
from dynid.recording.repair.joints import settle_joints
from dynid.recording.repair.jumps import mend_jumps, shorten_gaps
from dynid.recording.repair.missing import drop_missing
from dynid.recording.repair.repeats import drop_repeats
from dynid.recording.repair.runs import join_runs, spread_stamps
from dynid.recording.repair.sides import to_joint_side
from dynid.recording.repair.spikes import drop_spikes
from dynid.recording.repair.stamps import repair_stamps
from dynid.recording.repair.tails import drop_broken_ends
from dynid.recording.repair.topics import lay_together
from dynid.recording.repair.velocities import check_velocities
from dynid.recording.table import RawTable
from dynid.robot import RobotModel


@dataclass(frozen=True, slots=True, kw_only=True)
class RepairSettings:
    """What the user knows about a recording."""

    robot: RobotModel | None = None
    """The robot that was recorded."""
    gains: tuple[float, ...] | None = None
    """(n) drive gains [N.m/A] that override the robot's."""
    rate_hz: float | None = None
    """The clock of a recording without time stamps [Hz]."""
    degrees: bool = False
    """Whether positions, velocities and accelerations are in degrees."""
    joint_order: tuple[str, ...] | None = None
    """Column numbers base to tip, or the robot's joint names in the file's order."""


def repair(table: RawTable, settings: RepairSettings) -> ExperimentRecord:
    """Check a raw table, repair what can be repaired, and report all of it.

    Args:
        table: What an importer found.
        settings: What the user knows.

    Raises:
        RecordError: What is left is no recording of this robot.
    """
    robot = settings.robot
    table = settle_joints(table, robot, settings.joint_order)
    table = replace(table, index=np.arange(table.samples, dtype=np.int64))
    _check_gains(settings.gains, table)
    table = _start_clock(table, settings.rate_hz)
    table = lay_together(table)
    table = drop_missing(table)
    table = drop_zero_positions(table)
    table = drop_repeats(table)
    table = mend_jumps(table)
    table = join_runs(table)
    table = spread_stamps(table)
    table = repair_stamps(table)
    table = shorten_gaps(table)
    _require_rows(table)
    table = convert_degrees(table, robot, settings.degrees)
    table = unwrap_turns(table, robot)
    table = to_joint_side(table, robot)
    table = shift_turns(table, robot)
    table = drop_frozen(table)
    table = drop_spikes(table)
    table = drop_bursts(table)
    table = drop_broken_ends(table)
    _require_rows(table)
    table = settle_unit(table)
    table = refuse_degrees(table, robot)
    table = report_clock(table)
    table = check_counted_rows(table)
    table = check_velocities(table, settings.rate_hz)
    table = report_saturation(table)
    table = report_rest(table)
    table = report_odd_torques(table, robot)
    return _record(table, settings)


def _start_clock(table: RawTable, rate_hz: float | None) -> RawTable:
    """Count time by rows, before any row is lost, where there are no stamps."""
    if table.t is not None:
        return table
    if rate_hz is None:
        raise RecordError(
            "the recording has no time",
            where=table.source,
            next_step="Pass its sampling rate with --rate, or map a column with --columns t=...",
        )
    if not np.isfinite(rate_hz) or not 0 < rate_hz <= 1e6:
        raise RecordError("the rate must be positive", value=rate_hz, limit="0 to 1e6 Hz")
    t = np.arange(table.samples, dtype=np.float64) / rate_hz
    return replace(table, t=t, time_scale=1.0, t0="0.0", clock="rate")


def _check_gains(gains: tuple[float, ...] | None, table: RawTable) -> None:
    if gains is None:
        return
    if len(gains) != table.joints:
        raise RecordError(
            "the number of gains is not the number of joints", value=gains, limit=table.joints
        )
    if not all(np.isfinite(gain) and gain != 0 for gain in gains):
        raise RecordError("drive gains must be finite and not zero", value=gains)


def _require_rows(table: RawTable) -> None:
    if table.samples < 2:
        raise RecordError(
            "fewer than two usable rows are left", where=table.source, value=table.samples
        )


def _record(table: RawTable, settings: RepairSettings) -> ExperimentRecord:
    t = table.stamps
    extra = {**table.extra, "t0": table.t0}
    if table.notes:
        extra["notes"] = "; ".join(table.notes)
    metadata = RecordMetadata(
        robot=settings.robot.name if settings.robot else None,
        joint_names=table.joint_names,
        origin=table.source,
        format=table.format,
        clock=table.clock,
        drive_gains=settings.gains,
        dropped_rows=table.dropped,
        extra=extra,
    )
    return ExperimentRecord(
        t=t - t[0],
        signals=table.signals,
        metadata=metadata,
        problems=table.notices,
        channels=table.channels,
    )
