"""From a raw table to a recording: every repair in its place and reported.

Inputs are checked before algebra: constant channels, absurd scales, one run given twice.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.core import Array, Finding, Mask, RecordError, UnclearRecordError
from dynid.recording import content, records
from dynid.recording.repair import clock, joints, missing, motion
from dynid.recording.table import TORQUE_SOURCES, RawTable, ReadOptions, rows_with
from dynid.robot import RobotModel

_SCALES = {"q": (0.0, 1e5), "qd": (0.0, 1e5), "effort": (1e-9, 1e7), "current": (1e-9, 1e5)}
"""Quantity to the largest value of a joint below and above which no arm can be."""


def check_channels(record: records.ExperimentRecord) -> tuple[Finding, ...]:
    """Channels of torque that do not change, and values that no arm can have.

    Args:
        record: The recording.

    Returns:
        `dead_channel` for torques that stay the same while their arm moves, and for positions
        that stay the same while their velocity is not zero; `unit_suspect` with severity `error`
        for absurd scales. Dead channels with the same value are one finding.
    """
    moves = bool(np.ptp(record.signals["q"], axis=0).max() > 0)
    found: list[Finding] = []
    for quantity, (least, most) in _SCALES.items():
        values = record.signals.get(quantity)
        if values is None:
            continue
        size = np.abs(values).max(axis=0)
        absurd = (size > most) | ((size > 0) & (size < least))
        for joint in np.flatnonzero(absurd).tolist():
            finding = Finding(
                "unit_suspect",
                f"{quantity} of joint {joint + 1} reaches {size[joint]:.4g} "
                f"{records.UNITS[quantity]}, which no arm does",
                severity="error",
                joints=(joint,),
                value=float(size[joint]),
                unit=records.UNITS[quantity],
                next_step="check column and unit",
            )
            found.append(finding)
        dead = moves & ~absurd & (np.ptp(values, axis=0) == 0)
        if quantity not in TORQUE_SOURCES:
            # A joint may be locked: positions are dead beside a velocity alone.
            speed = record.signals.get("qd") if quantity == "q" else None
            dead &= False if speed is None else speed.any(axis=0)
        for value in dict.fromkeys(values[0, dead].tolist()):
            alike = np.flatnonzero(dead & (values[0] == value)).tolist()
            which = f"joint{'s' * (len(alike) > 1)} {', '.join(str(joint + 1) for joint in alike)}"
            finding = Finding(
                "dead_channel",
                f"{quantity} of {which} is {value + 0.0:.4g} on every row",
                joints=tuple(alike),
                value=value,
                unit=records.UNITS[quantity],
                next_step="check column and sensor",
            )
            found.append(finding)
    return tuple(found)


def checked_records(
    recordings: Sequence[records.ExperimentRecord],
) -> list[records.ExperimentRecord]:
    """Recordings fit for identification, with what was found among their problems.

    One that is there twice counts once: the first carries the finding `duplicate_record`.

    Args:
        recordings: The recordings that are to be identified from, together.

    Raises:
        RecordError: A recording without a torque that changes, or with an absurd scale.
    """
    kept: list[records.ExperimentRecord] = []
    places: dict[str, int] = {}
    for number, record in enumerate(recordings, 1):
        # Of one file imported twice, or of one run in two formats or with other stamps.
        own = (records.identity(record), records.signals_hash(record))
        first = next((places[one] for one in own if one in places), None)
        if first is not None:
            note = Finding(
                "duplicate_record",
                f"recording {number} is the same as one before it and is left out",
                value=float(number),
                next_step="give each recording once",
            )
            kept[first] = replace(kept[first], problems=(*kept[first].problems, note))
            continue
        known = {(finding.kind, finding.joints, finding.text) for finding in record.problems}
        fresh = [x for x in check_channels(record) if (x.kind, x.joints, x.text) not in known]
        _refuse(record, (*record.problems, *fresh))
        places |= dict.fromkeys(own, len(kept))
        kept.append(replace(record, problems=(*record.problems, *fresh)))
    return kept


def _refuse(record: records.ExperimentRecord, findings: Sequence[Finding]) -> None:
    where = record.metadata.origin or None
    for finding in findings:
        if finding.kind == "unit_suspect" and finding.severity == "error" and finding.joints:
            step = f"{finding.next_step.capitalize()}."
            raise RecordError(finding.text, where=where, next_step=step)
    # Without torques there is nothing to check; whoever needs them says so.
    sources = [name for name in TORQUE_SOURCES if name in record.signals]
    if sources and not any(np.ptp(record.signals[name]) > 0 for name in sources):
        raise RecordError(
            f"{sources[-1]} is the same on every row of every joint",
            where=where,
            next_step="Check the columns of the torques: nothing can be identified from them.",
        )


_LONG_REST = 1.0
"""Standstill at an end that is worth a word [s]."""
_HOLDS = 0.05
"""Torque at rest over that in motion below which something else holds the arm."""
_FAR_BEYOND, _FAR_BELOW = 3.0, 0.06
"""Shares of the torque limits that no motion exceeds, and that any motion does."""


def _report_rest(table: RawTable) -> RawTable:
    """Report long standstill at the start and end; the rows are kept."""
    t = table.stamps
    moving = _moving(t, table.signals["q"])
    if not moving.any():
        return table.report("at_rest", "the robot does not move in this recording")
    rows = np.flatnonzero(moving)
    first, last = int(rows[0]), int(rows[-1])
    # The half of a rest that is further from the motion: brakes open before it.
    rests = (
        (float(t[first] - t[0]), "start", slice(0, (first + 1) // 2)),
        (float(t[-1] - t[last]), "end", slice((last + len(t)) // 2, len(t))),
    )
    parts: list[str] = []
    for seconds, where, rest in rests:
        if seconds > _LONG_REST:
            held = "" if _held(table, rest, moving) else " without torque (by brakes? leave it out)"
            parts.append(f"{seconds:.2g} s at the {where}{held}")
    if not parts:
        return table
    return table.report("at_rest", f"the robot stands still for {' and '.join(parts)}")


def _held(table: RawTable, rest: slice, moving: Mask) -> bool:
    """Whether motors hold the robot in rows in which it stands still."""
    value = next(table.signals[name] for name in TORQUE_SOURCES if name in table.signals)
    usual = np.sqrt(np.square(value[moving]).mean(axis=0))
    mean = np.abs(value[rest].mean(axis=0)) / np.maximum(usual, 1e-300)
    return bool(np.sqrt(np.square(mean).mean()) > _HOLDS)


def _moving(t: Array, q: Array) -> Mask:
    """Rows around which some joint moves by more than its noise."""
    span = max(1, min(len(t) // 4, int(0.1 / max(float(np.median(np.diff(t))), 1e-6))))
    shift = np.abs(q[span:] - q[:-span])
    fastest = float(shift.max(initial=0.0))
    active = rows_with(shift > max(1e-4, 0.005 * fastest))
    mask = np.zeros(len(t), dtype=np.bool_)
    mask[span // 2 : span // 2 + len(active)] = active
    return mask


_PILED, _FLAT_SHARE, _CLIPPED = 3.0, 0.01, 10
"""Rows at exactly the largest torque that are no coincidence: so many times those at the level next
to it, a share of all, and at least so many."""


def _report_saturation(table: RawTable) -> RawTable:
    """Report torques and currents that are clipped."""
    moving = _moving(table.stamps, table.signals["q"])
    for quantity in ("effort", "current"):
        value = table.signals.get(quantity)
        if value is None:
            continue
        clipped = (at_limit(value) & moving[:, None]).sum(axis=0)
        for joint in np.flatnonzero(clipped >= _CLIPPED).tolist():
            peak = value[np.argmax(np.abs(value[:, joint])), joint]
            table = table.report(
                "saturated",
                f"{table.label(quantity, joint)} stands at its extreme ({peak:.4g}) on "
                f"{clipped[joint]} rows of the motion, as if clipped",
                (joint,),
            )
    return table


_NOISE_BAND, _WIDEST = 3.0, 0.03
"""Noise about a known limit: its standard deviations, and the largest share of the limit."""


def at_limit(values: Array, limit: Array | None = None) -> Mask:
    """(N, n) rows of torques that pile up at exactly their largest or smallest value.

    Of a peak that is written coarsely, a parabola, the highest level holds up to 1 + sqrt(2) times
    the rows of the next one. About known limits (n), NaN or infinite where there is none, torques
    may be noisy: they pile up within the noise, and none is beyond it.
    """
    out = np.zeros(values.shape, dtype=np.bool_)
    for end in (values.max(axis=0), values.min(axis=0)):
        away = np.abs(values - end)
        flat = (away == 0.0) & (np.ptp(values, axis=0) > 0)
        step = np.min(np.where(away > 0.0, away, np.inf), axis=0)
        following = _PILED * ((away > 0.0) & (away <= (1 + 1e-6) * step)).sum(axis=0)
        out |= flat & (flat.sum(axis=0) > np.maximum(following, _FLAT_SHARE * len(values)))
    if limit is None:
        return out
    bend = np.abs(np.diff(values, n=4, axis=0))
    band = _NOISE_BAND * 1.48 * np.median(bend, axis=0) / np.sqrt(70)
    for side in (values, -values):
        near = np.abs(side - limit) <= band
        below = (side >= limit - 3 * band) & (side < limit - band)
        count = near.sum(axis=0)
        least = np.maximum(_PILED * below.sum(axis=0), _FLAT_SHARE * len(values))
        beyond = (side > limit + band).sum(axis=0)
        out |= near & (count > least) & (beyond <= 0.01 * count) & (band <= _WIDEST * limit)
    return out


def _report_odd_torques(table: RawTable, robot: RobotModel | None) -> RawTable:
    """Report torques that are far beyond the robot's, and efforts that may be motor currents."""
    if robot is None or np.isnan(robot.limits.torque).all():
        return table
    gains = {"effort": np.ones(robot.joints), "current": np.abs(robot.drives.gain)}
    for quantity, gain in gains.items():
        if quantity not in table.signals or np.isnan(gain).any():
            continue
        share = np.quantile(np.abs(table.signals[quantity]), 0.98, axis=0) * gain
        share = share / robot.limits.torque
        if float(np.nanmax(share)) > _FAR_BEYOND:
            joint = int(np.nanargmax(share))
            table = table.report(
                "unit_suspect",
                f"{table.label(quantity, joint)} stands for {share[joint]:.3g} times the torque "
                "limit: probably another unit (mA, mN.m, percent), or on the motor's side",
            )
        # UR drivers send motor currents in A as effort.
        alone = quantity == "effort" and "current" not in table.signals
        small = 0 < float(np.nanmax(share)) <= _FAR_BELOW and not np.isnan(robot.drives.gain).any()
        if alone and small:
            table = table.report(
                "unit_suspect",
                f"efforts stay below {100 * float(np.nanmax(share)):.2g} % of the torque limits: "
                "they may be motor currents in A (map them as current, or pass --gains)",
            )
    return table


@dataclass(frozen=True, slots=True)
class Rule:
    """One thing that a file may have wrong, and what is done about it."""

    apply: Callable[..., RawTable]
    """The table with it repaired and reported."""
    earned_by: str
    """A file or damage that is read worse without it."""
    needs: tuple[str, ...] = ()
    """What it takes beside the table: the robot, options."""
    rows: int = 0
    """The fewest that it can judge."""
    clocks: tuple[str, ...] = ("recorded", "header", "receive", "rate")
    """Clocks of the tables that it is for."""


def repair(
    table: RawTable, options: ReadOptions, robot: RobotModel | None = None
) -> records.ExperimentRecord:
    """Check a raw table, repair what can be repaired, and report all of it.

    Args:
        table: What an importer found.
        options: What the user knows.
        robot: The robot that was recorded, if it is known.

    Raises:
        RecordError: What is left is no recording of this robot.
    """
    with content.located(table.source):
        for rule in RULES:
            if table.samples < rule.rows or table.clock not in rule.clocks:
                continue
            of_rule = (robot if name == "robot" else getattr(options, name) for name in rule.needs)
            table = rule.apply(table, *of_rule)
        return _record(table, robot)


_LEAST_TICK = 1e-12
"""A microsecond in days is ten times as much."""


def _start_clock(table: RawTable, rate_hz: float | None) -> RawTable:
    """Count time by rows, before any row is lost, where there are no stamps."""
    if table.t is not None:
        with np.errstate(invalid="ignore", over="ignore"):
            steps = np.abs(np.diff(table.stamps))
        steps = steps[np.isfinite(steps) & (steps > 0)]
        if len(steps) and float(np.median(steps)) < _LEAST_TICK:
            raise UnclearRecordError(
                "the time stamps hardly increase",
                value=f"{float(np.median(steps)):.3g} a row",
                limit=f"{_LEAST_TICK:g} at least, in any unit",
                next_step="Check the column of time, or leave it out and pass --rate.",
            )
        return table
    if rate_hz is None and records.are_poses(table.signals["q"]):
        # Single poses need no clock.
        rate_hz = 1.0
    if rate_hz is None:
        step = "Pass its sampling rate with --rate, or map a column with --columns t=..."
        raise UnclearRecordError("the recording has no time", next_step=step)
    t = np.arange(table.samples, dtype=np.float64) / rate_hz
    return replace(table, t=t, time_scale=1.0, t0="0.0", clock="rate")


def _require_rows(table: RawTable) -> RawTable:
    if table.samples < 2:
        raise RecordError("fewer than two usable rows are left", value=table.samples)
    return table


def _record(table: RawTable, robot: RobotModel | None) -> records.ExperimentRecord:
    t = table.stamps
    extra = {**table.extra, "t0": table.t0}
    if table.notes:
        extra["notes"] = "; ".join(table.notes)
    metadata = records.RecordMetadata(
        robot=robot.name if robot else None,
        joint_names=table.joint_names,
        origin=table.source,
        format=table.format,
        clock=table.clock,
        dropped_rows=table.dropped,
        extra=extra,
    )
    record = records.ExperimentRecord(
        t=t - t[0],
        signals=table.signals,
        metadata=metadata,
        problems=table.notices,
        channels=table.channels,
    )
    return replace(record, problems=(*record.problems, *check_channels(record)))


_STAMPED = ("recorded", "header", "receive")
RULES: tuple[Rule, ...] = (
    Rule(joints.settle_joints, "kinova_gen3, bags: joints by name", ("robot", "joint_order")),
    Rule(_start_clock, "tx40: no time stamps", ("rate_hz",)),
    Rule(clock.lay_together, "topics of one table on rows of their own"),
    Rule(missing.drop_missing, "cells that are empty or no number"),
    Rule(motion.drop_zero_positions, "rows of zeros at a lost link"),
    Rule(clock.drop_repeats, "panda_gaz: rows read faster than they are updated", rows=3),
    Rule(clock.mend_jumps, "a clock that was set while it ran", rows=50, clocks=_STAMPED),
    Rule(clock.join_runs, "several runs in one file", rows=100, clocks=("recorded",)),
    Rule(clock.spread_stamps, "stamps that are rounded", rows=24, clocks=("recorded",)),
    Rule(clock.repair_stamps, "stamps that repeat, run backwards or jump", rows=2),
    Rule(clock.shorten_gaps, "a pause of an hour; a first or last stamp that is far off", rows=50),
    Rule(joints.convert_degrees, "degrees that a user announces", ("robot", "degrees")),
    Rule(joints.unwrap_turns, "angles that jump where a turn is full", ("robot",)),
    Rule(joints.to_joint_side, "kr300_weigand, tx40: motor values", ("robot",)),
    Rule(joints.shift_turns, "angles that are a turn off", ("robot",)),
    Rule(missing.drop_frozen, "kinova_gen3: a torque that stands still"),
    Rule(motion.drop_spikes, "panda_gaz, kinova_gen3, ur5_kufieta: single wrong samples", rows=24),
    Rule(motion.drop_bursts, "stretches of rows that are wrong", rows=24),
    Rule(missing.drop_broken_ends, "kinova_gen3: invalid last rows"),
    Rule(clock.fill_held, "positions renewed on every tenth row"),
    Rule(_require_rows, "files of damage alone"),
    Rule(clock.settle_unit, "kinova_gen3: time in milliseconds"),
    Rule(joints.refuse_degrees, "degrees that nobody announced", ("robot",)),
    Rule(clock.report_clock, "panda_gaz: jitter and lost rows", rows=4, clocks=_STAMPED),
    Rule(motion.check_counted_rows, "rows lost without stamps", rows=50, clocks=("rate",)),
    Rule(motion.check_velocities, "velocities in another unit", ("rate_hz",)),
    Rule(_report_saturation, "torques that are clipped", rows=50),
    Rule(_report_rest, "long standstill at an end", rows=10),
    Rule(_report_odd_torques, "currents called efforts", ("robot",)),
)
"""All rules in their order; `benchmarks/import_rules.py` takes out one after the other."""
