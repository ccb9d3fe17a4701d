"""The description that our own recordings carry, as JSON: metadata, units, problems."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Any

from dynid.core import Array, Finding, RecordError, finding_from_json
from dynid.recording.record import JOINT_QUANTITIES, RecordMetadata

VERSION = 1
UNITS: dict[str, str] = {
    "t": "s",
    "q": "rad",
    "qd": "rad/s",
    "qdd": "rad/s^2",
    "current": "A",
    "effort": "N.m",
    "target_q": "rad",
    "target_qd": "rad/s",
    "target_qdd": "rad/s^2",
    "target_current": "A",
    "target_moment": "N.m",
    "temperature": "degC",
}
"""Unit of each column; m and N instead of rad and N.m on prismatic joints."""


def metadata_to_json(metadata: RecordMetadata) -> dict[str, Any]:
    """Metadata as a JSON object."""
    gains = metadata.drive_gains
    return {
        "robot": metadata.robot,
        "joint_names": list(metadata.joint_names),
        "origin": metadata.origin,
        "format": metadata.format,
        "clock": metadata.clock,
        "drive_gains": None if gains is None else [float(gain) for gain in gains],
        "dropped_rows": int(metadata.dropped_rows),
        "input_hash": metadata.input_hash,
        "extra": {str(name): str(value) for name, value in metadata.extra.items()},
    }


def metadata_from_json(data: Mapping[str, Any]) -> RecordMetadata:
    """Metadata from a JSON object.

    Raises:
        RecordError: A field of the wrong type.
    """
    known = {item.name for item in fields(RecordMetadata)}
    values = {name: value for name, value in data.items() if name in known}
    try:
        gains = values.get("drive_gains")
        return RecordMetadata(
            robot=None if values["robot"] is None else str(values["robot"]),
            joint_names=tuple(str(name) for name in values["joint_names"]),
            origin=str(values["origin"]),
            format=str(values["format"]),
            clock=str(values["clock"]),
            drive_gains=None if gains is None else tuple(float(gain) for gain in gains),
            dropped_rows=int(values["dropped_rows"]),
            input_hash=str(values["input_hash"]),
            extra={str(name): str(value) for name, value in dict(values["extra"]).items()},
        )
    except (KeyError, TypeError, ValueError) as error:
        raise RecordError("the recording's metadata is damaged", value=str(error)) from error


def notices_from_json(data: Iterable[Any]) -> tuple[Finding, ...]:
    """Notices from a list of JSON objects.

    Raises:
        RecordError: Something that is no notice.
    """
    notices: list[Finding] = []
    for item in data:
        try:
            notices.append(finding_from_json(item))
        except (KeyError, TypeError, ValueError) as error:
            raise RecordError(
                "the recording's list of problems is damaged", value=str(error)
            ) from error
    return tuple(notices)


def column_names(quantities: Iterable[str], joints: int) -> list[str]:
    """`q_0`, `q_1`, ..., in the order of the given quantities."""
    return [f"{quantity}_{k}" for quantity in quantities for k in range(joints)]


def check_quantities(quantities: Iterable[str]) -> tuple[str, ...]:
    """The quantities, if a recording can hold them.

    Raises:
        RecordError: An unknown one, one named twice, or no positions.
    """
    names = tuple(quantities)
    if len(set(names)) != len(names) or not set(names) <= set(JOINT_QUANTITIES):
        raise RecordError("unknown or repeated quantities", value=names, limit=JOINT_QUANTITIES)
    if "q" not in names:
        raise RecordError("a recording needs positions q", value=names)
    return names


def digest(description: Mapping[str, Any], columns: Iterable[Array]) -> str:
    """A fingerprint of the description and every number, to notice damage.

    Args:
        description: The JSON object without its own digest.
        columns: All columns in the order of the file.
    """
    hasher = hashlib.blake2b(json.dumps(description, sort_keys=True).encode(), digest_size=16)
    for column in columns:
        hasher.update(column.astype("<f8").tobytes())
    return hasher.hexdigest()
