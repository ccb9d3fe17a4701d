"""Trajectories as JSON files that carry their robot, limits and provenance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.core.files import write_json
from dynid.core.provenance import Provenance
from dynid.trajectory.bounds import MotionBounds, MotionLimits, copied_bounds
from dynid.trajectory.codec import trajectory_from_json, trajectory_to_json
from dynid.trajectory.json_fields import JsonFields, load_object
from dynid.trajectory.trajectory import Trajectory

_KIND = "dynid.trajectory"
_VERSION = 2
_VERSIONS = (1, _VERSION)
"""Version 1 knew Fourier series alone, their fields beside the others."""
_BOUNDS = ("lower", "upper", "velocity", "acceleration")
_OWN = frozenset({"kind", "version", "robot", "trajectory", "limits", "provenance"})


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredTrajectory:
    """A trajectory with what it was made for."""

    trajectory: Trajectory
    """The motion."""
    robot: str
    """Name or path of the robot."""
    limits: MotionBounds
    """The limits it was made for, NaN where unknown."""
    provenance: Provenance
    """How it was made."""
    extra: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """What else its writer put into the file, by key."""


def write_trajectory(
    path: str | Path,
    trajectory: Trajectory,
    *,
    robot: str,
    limits: MotionLimits,
    provenance: Provenance,
    extra: Mapping[str, Any] | None = None,
) -> None:
    """Write a trajectory as JSON; an interrupted write leaves the old file, or none.

    Args:
        path: File to write.
        trajectory: The motion, of any kind of this package.
        robot: Name or path of the robot.
        limits: The limits it was made for, NaN where unknown.
        provenance: How it was made.
        extra: More to keep in the file, by key; JSON values.

    Raises:
        InputError: Limits for another number of joints, a trajectory of a foreign kind, extras
            that take a key of the file's own, settings that JSON cannot hold, or a place where
            no such file can be.
        JobError: The disk does not take the file.
    """
    bounds = copied_bounds(limits)
    if bounds.joints != trajectory.joints:
        raise InputError("joints of the limits", value=bounds.joints, limit=trajectory.joints)
    taken = sorted(_OWN & set(extra or ()))
    if taken:
        raise InputError("these keys are the file's own", value=taken)
    document = {
        "kind": _KIND,
        "version": _VERSION,
        "robot": robot,
        "trajectory": trajectory_to_json(trajectory),
        **(extra or {}),
        "limits": {name: _with_null(getattr(bounds, name)) for name in _BOUNDS},
        "provenance": provenance.to_json(),
    }
    write_json(Path(path), document)


def read_trajectory(path: str | Path) -> StoredTrajectory:
    """Read what `write_trajectory` wrote, now or in an earlier version, checking every number.

    Args:
        path: File to read.

    Raises:
        InputError: A file that is missing, is not JSON, is something else, or whose numbers
            are not a trajectory.
    """
    fields = load_object(path)
    if fields.get("kind") != _KIND:
        found = fields.get("kind") or fields.get("format")
        raise InputError(
            "not a design and no other trajectory",
            where=str(path),
            value="a JSON object of another kind" if found is None else found,
            next_step="Make one: dynid design ROBOT -o DESIGN.json",
        )
    version = fields.whole("version") if "version" in fields.values else None
    if version not in _VERSIONS:
        raise InputError(
            "unknown file version",
            where=str(path),
            value=version,
            limit=f"up to {_VERSION}",
            next_step="A newer file needs a newer dynid.",
        )
    try:
        trajectory = trajectory_from_json(fields if version == 1 else fields.object("trajectory"))
        stored = fields.object("limits")
        limits = MotionBounds(**{name: stored.vector(name, null=True) for name in _BOUNDS})
        if limits.joints != trajectory.joints:
            raise InputError("joints of the limits", value=limits.joints, limit=trajectory.joints)
        own = _OWN if version == _VERSION else _OWN | {"type", "period", "offset", "a", "b"}
        return StoredTrajectory(
            trajectory=trajectory,
            robot=fields.text("robot"),
            limits=limits,
            provenance=_provenance(fields.object("provenance")),
            extra={key: value for key, value in fields.values.items() if key not in own},
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
