"""Robots by built-in name, URDF file or robot file, and as JSON objects."""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from dynid.core import Array, InputError, RobotError, like_named
from dynid.robot import library
from dynid.robot.body import Body
from dynid.robot.kinematics import with_mount
from dynid.robot.model import Counterbalance, Drives, JointLimits, RobotModel, SafetyLimits
from dynid.robot.robotfile import MAX_BYTES as MAX_TOML
from dynid.robot.robotfile import robot_from_toml
from dynid.robot.tables import is_there, read_limited, shown, shown_path
from dynid.robot.urdf import MAX_BYTES as MAX_URDF
from dynid.robot.urdf import robot_from_urdf
from dynid.robot.urdf_bodies import with_collision_geometry

_CALIBRATED = 3e-3
"""Placements of one arm and its factory calibration differ by less [m]."""


class BuiltinRobot(NamedTuple):
    """A robot that comes with dynid."""

    name: str
    joints: int
    source: str
    """Where its numbers are from."""


def robots() -> list[BuiltinRobot]:
    """The built-in robots, by name."""
    found = [load_robot(name) for name in builtin_names()]
    return [BuiltinRobot(robot.name, robot.joints, robot.source) for robot in found]


def load_robot(
    name_or_path: str | Path,
    *,
    mount: str | None = None,
    collision: bool = True,
    mesh_dirs: Sequence[Path] = (),
) -> RobotModel:
    """A robot by built-in name, URDF file or robot file (TOML).

    Files are told apart by what is in them, not by their ending.

    Args:
        name_or_path: A name that `robots` lists, or a path.
        mount: `floor`, `wall`, `ceiling` or `tilt:DEG`, in place of what the file says.
        collision: Whether to read the collision geometry of a URDF, meshes included, where the
            robot has no bodies; what cannot be read is in the robot's `body_notes`.
        mesh_dirs: Further folders where meshes are looked for.

    Raises:
        RobotError: No such robot or file (the message lists the built-in ones), a file that
            cannot be read or understood, or an unknown mounting.
    """
    robot = _load(name_or_path, collision, mesh_dirs)
    return robot if mount is None else with_mount(robot, mount)


def _load(name_or_path: str | Path, collision: bool, mesh_dirs: Sequence[Path] = ()) -> RobotModel:
    text = str(name_or_path)
    names = builtin_names()
    if text.lower() in names:
        file = resources.files(library) / f"{text.lower()}.toml"
        return robot_from_toml(file.read_bytes(), Path(f"{text.lower()}.toml"))
    path = Path(os.path.expanduser(text))
    if not text.strip() or not is_there(path):
        looks_like_path = "/" in text or path.suffix.lower() in (".urdf", ".toml", ".xml")
        raise RobotError(
            "no such file" if looks_like_path else "neither a built-in robot nor a file",
            where="robot",
            value=shown(text) or "nothing",
            limit=f"{', '.join(names)}, or a URDF or robot file",
            next_step=like_named(path, *names),
        )
    data = read_limited(path, MAX_URDF)
    if data.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] == b"<" or path.suffix.lower() == ".urdf":
        robot = robot_from_urdf(data, where=shown_path(path), stem=path.stem)
        if not collision:
            return robot
        return with_collision_geometry(robot, path, mesh_dirs=mesh_dirs)
    if len(data) > MAX_TOML:
        raise RobotError(
            "the file is too large for a robot file", where=shown_path(path), limit=MAX_TOML
        )
    return robot_from_toml(data, path, collision=collision, mesh_dirs=mesh_dirs)


def builtin_names() -> list[str]:
    """The names of the built-in robots, sorted."""
    files = resources.files(library).iterdir()
    return sorted(file.name[:-5] for file in files if file.name.endswith(".toml"))


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
        "bodies": [
            {
                "name": item.name,
                "link": item.link,
                "points": _listed(item.points),
                "radius": item.radius,
            }
            for item in robot.bodies
        ],
        "body_notes": list(robot.body_notes),
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
            bodies=_bodies(data),
            # Files of the first versions know neither of these.
            body_notes=tuple(str(note) for note in data.get("body_notes", [])),
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


def _bodies(data: Mapping[str, Any]) -> tuple[Body, ...]:
    """The collision bodies of a stored robot.

    Those of a built-in arm that release 0.1 stored were capsules that nothing had checked:
    today's take their place.
    """
    if "bodies" in data:
        return tuple(Body(**item) for item in data["bodies"])
    if data["name"] in builtin_names():
        today = _load(str(data["name"]), collision=False)
        there = _array(data["placements"])
        if there.shape == today.placements.shape and np.allclose(
            there, today.placements, atol=_CALIBRATED
        ):
            return today.bodies
    return tuple(
        Body(
            name=str(item["name"]),
            link=int(item["link"]),
            points=_array([item["start"], item["end"]]),
            radius=float(item["radius"]),
        )
        for item in data["capsules"]
    )


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
