"""Trajectories as JSON files that carry their robot, limits and provenance."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.core.provenance import Provenance
from dynid.trajectory.bounds import MotionBounds, MotionLimits, copied_bounds
from dynid.trajectory.fourier import FourierSeries
from dynid.trajectory.json_fields import JsonFields, load_object

_KIND = "dynid.trajectory"
_VERSION = 1
_BOUNDS = ("lower", "upper", "velocity", "acceleration")


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredTrajectory:
    """A Fourier series with what it was made for."""

    series: FourierSeries
    """The motion."""
    robot: str
    """Name or path of the robot."""
    limits: MotionBounds
    """The limits it was made for, NaN where unknown."""
    provenance: Provenance
    """How it was made."""


def write_trajectory(
    path: Path,
    series: FourierSeries,
    *,
    robot: str,
    limits: MotionLimits,
    provenance: Provenance,
) -> None:
    """Write a Fourier series as JSON; an interrupted write leaves the old file, or none.

    Args:
        path: File to write.
        series: The motion.
        robot: Name or path of the robot.
        limits: The limits it was made for, NaN where unknown.
        provenance: How it was made.

    Raises:
        InputError: Limits for another number of joints, or settings that JSON cannot hold.
        OSError: The file cannot be written.
    """
    bounds = copied_bounds(limits)
    if bounds.joints != series.joints:
        raise InputError("joints of the limits", value=bounds.joints, limit=series.joints)
    document = {
        "kind": _KIND,
        "version": _VERSION,
        "robot": robot,
        "type": "fourier",
        "period": series.period,
        "offset": series.offset.tolist(),
        "a": series.a.tolist(),
        "b": series.b.tolist(),
        "limits": {name: _with_null(getattr(bounds, name)) for name in _BOUNDS},
        "provenance": provenance.to_json(),
    }
    try:
        text = json.dumps(document, indent=1, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InputError("the provenance settings must be JSON values", value=error) from error
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        part.write_text(text + "\n", encoding="utf-8")
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def read_trajectory(path: Path) -> StoredTrajectory:
    """Read what `write_trajectory` wrote, checking every number.

    Args:
        path: File to read.

    Raises:
        InputError: A file that is missing, is not JSON, is something else, or whose numbers
            are not a trajectory.
    """
    fields = load_object(path)
    if (fields.get("kind"), fields.get("type")) != (_KIND, "fourier"):
        raise InputError(
            "not a trajectory file", where=str(path), value=fields.get("kind"), limit=_KIND
        )
    if fields.get("version") != _VERSION:
        raise InputError(
            "unknown file version", where=str(path), value=fields.get("version"), limit=_VERSION
        )
    try:
        series = FourierSeries(
            period=fields.number("period"),
            offset=fields.vector("offset"),
            a=fields.matrix("a"),
            b=fields.matrix("b"),
        )
        stored = fields.object("limits")
        limits = MotionBounds(**{name: stored.vector(name, null=True) for name in _BOUNDS})
        if limits.joints != series.joints:
            raise InputError("joints of the limits", value=limits.joints, limit=series.joints)
        return StoredTrajectory(
            series=series,
            robot=fields.text("robot"),
            limits=limits,
            provenance=_provenance(fields.object("provenance")),
        )
    except InputError as error:
        raise InputError(
            error.what, where=str(path), value=error.value, limit=error.limit
        ) from error


def _with_null(values: Array) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]


def _provenance(fields: JsonFields) -> Provenance:
    seed = fields.get("seed")
    if seed is not None and (isinstance(seed, bool) or not isinstance(seed, int)):
        raise InputError("provenance.seed must be a whole number", value=seed)
    return Provenance(
        created=fields.text("created"),
        versions=fields.object("versions").values,
        inputs=fields.object("inputs").values,
        settings=fields.object("settings").values,
        seed=seed,
    )
