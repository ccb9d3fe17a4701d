"""Input checks before algebra: channels that say nothing, absurd scales, one run given twice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynid.core import Finding, RecordError
from dynid.recording.record import UNITS, ExperimentRecord, identity
from dynid.recording.table import TORQUE_SOURCES

_SCALES = {
    "q": (0.0, 1e5),
    "qd": (0.0, 1e5),
    "effort": (1e-9, 1e7),
    "current": (1e-9, 1e5),
}
"""Quantity to the largest value of a joint below and above which no arm can be."""


def check_channels(record: ExperimentRecord) -> tuple[Finding, ...]:
    """Channels of torque that do not change, and values that no arm can have.

    Args:
        record: The recording.

    Returns:
        `dead_channel` for torques that stay the same while their arm moves, and for positions
        that stay the same while their velocity is not zero; `unit_suspect` with severity `error`
        for absurd scales. One finding a channel, with its joint and value.
    """
    moves = bool(np.ptp(record.signals["q"], axis=0).max() > 0)
    found: list[Finding] = []
    for quantity, (least, most) in _SCALES.items():
        values = record.signals.get(quantity)
        if values is None:
            continue
        for joint, (low, high) in enumerate(zip(values.min(0), values.max(0), strict=True)):
            name = f"{quantity} of joint {joint + 1}"
            size = float(max(abs(low), abs(high)))
            if size > most or 0 < size < least:
                found.append(
                    Finding(
                        "unit_suspect",
                        f"{name} reaches {size:.4g} {UNITS[quantity]}, which no arm does",
                        severity="error",
                        joints=(joint,),
                        value=size,
                        unit=UNITS[quantity],
                        next_step="check its unit and its column",
                    )
                )
            elif low == high and moves and _is_dead(record, quantity, joint):
                found.append(
                    Finding(
                        "dead_channel",
                        f"{name} is {float(low):.4g} on every row",
                        joints=(joint,),
                        value=float(low),
                        unit=UNITS[quantity],
                        next_step="check its column and its sensor",
                    )
                )
    return tuple(found)


def _is_dead(record: ExperimentRecord, quantity: str, joint: int) -> bool:
    """Whether a signal that never changes should have; a joint may be locked."""
    if quantity in TORQUE_SOURCES:
        return True
    speed = record.signals.get("qd")
    return quantity == "q" and speed is not None and bool(speed[:, joint].any())


def checked_records(records: Sequence[ExperimentRecord]) -> list[ExperimentRecord]:
    """Recordings fit for identification, with what was found among their problems.

    One that is there twice counts once: the first carries the finding `duplicate_record`.

    Args:
        records: The recordings that are to be identified from, together.

    Raises:
        RecordError: A recording without a torque that changes, or with an absurd scale.
    """
    kept: list[ExperimentRecord] = []
    hashes: list[str] = []
    for number, record in enumerate(records, 1):
        own = identity(record)
        if own in hashes:
            first = hashes.index(own)
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
        hashes.append(own)
        kept.append(replace(record, problems=(*record.problems, *fresh)))
    return kept


def _refuse(record: ExperimentRecord, findings: Sequence[Finding]) -> None:
    where = record.metadata.origin or None
    for finding in findings:
        if finding.kind == "unit_suspect" and finding.severity == "error" and finding.joints:
            raise RecordError(
                finding.text, where=where, next_step=f"{finding.next_step.capitalize()}."
            )
    source = next((name for name in TORQUE_SOURCES[::-1] if name in record.signals), None)
    if source is None:
        # Without torques there is nothing to check; whoever needs them says so.
        return
    if not any(
        np.ptp(record.signals[name]) > 0 for name in TORQUE_SOURCES if name in record.signals
    ):
        raise RecordError(
            f"{source} is the same on every row of every joint",
            where=where,
            next_step="Check the columns of the torques: nothing can be identified from them.",
        )
