"""A robot as a JSON object, so that an estimate can carry its robot along."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any, cast

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import InputError, RobotError
from dynid.robot.capsule import Capsule
from dynid.robot.counterbalance import Counterbalance
from dynid.robot.drives import Drives
from dynid.robot.limits import JointLimits
from dynid.robot.model import RobotModel
from dynid.robot.safety import SafetyLimits


def robot_to_json(robot: RobotModel) -> dict[str, Any]:
    """Everything that evaluates the robot's dynamics; unknown numbers become null."""
    return {
        "name": robot.name,
        "joint_names": list(robot.joint_names),
        "joint_types": list(robot.joint_types),
        "placements": _listed(robot.placements),
        "axes": _listed(robot.axes),
        "parameter_frames": {key: _listed(value) for key, value in robot.parameter_frames.items()},
        "default_frames": robot.default_frames,
        "gravity": _listed(robot.gravity),
        "mount": robot.mount,
        "limits": {
            item.name: _listed(getattr(robot.limits, item.name)) for item in fields(JointLimits)
        },
        "drives": {
            "gain": _listed(robot.drives.gain),
            "gear_ratio": _listed(robot.drives.gear_ratio),
            "coupling": None if robot.drives.coupling is None else _listed(robot.drives.coupling),
            "offset": None if robot.drives.offset is None else _listed(robot.drives.offset),
            "position_side": robot.drives.position_side,
            "torque_side": robot.drives.torque_side,
        },
        "inertias": _listed(robot.inertias),
        "flange": _listed(robot.flange),
        "counterbalances": [asdict(spring) for spring in robot.counterbalances],
        "capsules": [
            {
                "name": item.name,
                "link": item.link,
                "start": _listed(item.start),
                "end": _listed(item.end),
                "radius": item.radius,
            }
            for item in robot.capsules
        ],
        "apart": [list(pair) for pair in robot.apart],
        "overlap": [list(row) for row in robot.overlap],
        "safety": {key: _null(value) for key, value in asdict(robot.safety).items()},
        "locked": dict(robot.locked),
        "notes": list(robot.notes),
        "source": robot.source,
    }


def robot_from_json(data: Mapping[str, Any]) -> RobotModel:
    """The inverse of `robot_to_json`.

    Raises:
        RobotError: Missing keys or values that make no robot.
    """
    try:
        limits, drives = data["limits"], data["drives"]
        return RobotModel(
            name=str(data["name"]),
            joint_names=tuple(str(name) for name in data["joint_names"]),
            joint_types=tuple(str(kind) for kind in data["joint_types"]),
            placements=_array(data["placements"]),
            axes=_array(data["axes"]),
            parameter_frames={k: _array(v) for k, v in data["parameter_frames"].items()},
            default_frames=str(data["default_frames"]),
            gravity=_array(data["gravity"]),
            mount=str(data["mount"]),
            limits=JointLimits(
                **{item.name: _array(limits[item.name]) for item in fields(JointLimits)}
            ),
            drives=Drives(
                gain=_array(drives["gain"]),
                gear_ratio=_array(drives["gear_ratio"]),
                coupling=None if drives["coupling"] is None else _array(drives["coupling"]),
                offset=None if drives["offset"] is None else _array(drives["offset"]),
                position_side=str(drives["position_side"]),
                torque_side=str(drives["torque_side"]),
            ),
            inertias=_array(data["inertias"]),
            flange=_array(data["flange"]),
            counterbalances=tuple(Counterbalance(**spring) for spring in data["counterbalances"]),
            capsules=tuple(Capsule(**item) for item in data["capsules"]),
            # Files of the first versions know none of these three.
            overlap=tuple((int(a), int(b), float(c)) for a, b, c in data.get("overlap", [])),
            apart=tuple((int(a), int(b)) for a, b in data.get("apart", [])),
            safety=_safety(data.get("safety", {})),
            locked={str(k): float(v) for k, v in data["locked"].items()},
            notes=tuple(str(note) for note in data["notes"]),
            source=str(data["source"]),
        )
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise RobotError(
            "the robot stored in this file cannot be read", value=f"{type(error).__name__}: {error}"
        ) from error


def _safety(data: Mapping[str, Any]) -> SafetyLimits:
    numbers = {key: _number(value) for key, value in data.items() if key != "elbow"}
    return SafetyLimits(elbow=int(data.get("elbow", 0)), **numbers)


def _listed(array: Array) -> Any:
    return _null(cast("list[Any]", array.tolist()))


def _null(value: Any) -> Any:
    if isinstance(value, list):
        return [_null(item) for item in cast("list[Any]", value)]
    return value if math.isfinite(value) else None


def _array(value: Sequence[Any]) -> Array:
    return np.array(_number(value), dtype=np.float64)


def _number(value: Any) -> Any:
    if isinstance(value, list):
        return [_number(item) for item in cast("list[Any]", value)]
    return math.nan if value is None else float(value)
