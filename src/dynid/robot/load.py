"""The one door to robots: a built-in name, a URDF file or a robot file."""

from __future__ import annotations

import difflib
import os
from importlib import resources
from pathlib import Path
from typing import NamedTuple

from dynid.core.errors import RobotError
from dynid.robot import library
from dynid.robot.files import is_there, read_limited, shown, shown_path
from dynid.robot.model import RobotModel
from dynid.robot.mount import with_mount
from dynid.robot.robotfile import MAX_BYTES as MAX_TOML
from dynid.robot.robotfile import robot_from_toml
from dynid.robot.urdf import MAX_BYTES as MAX_URDF
from dynid.robot.urdf import robot_from_urdf
from dynid.robot.urdf_capsules import with_collision_geometry


class BuiltinRobot(NamedTuple):
    """A robot that comes with dynid."""

    name: str
    joints: int
    source: str
    """Where its numbers are from."""


def robots() -> list[BuiltinRobot]:
    """The built-in robots, by name."""
    found = [load_robot(name) for name in _names()]
    return [BuiltinRobot(robot.name, robot.joints, robot.source) for robot in found]


def load_robot(
    name_or_path: str | Path, *, mount: str | None = None, collision: bool = True
) -> RobotModel:
    """A robot by built-in name, URDF file or robot file (TOML).

    Files are told apart by what is in them, not by their ending.

    Args:
        name_or_path: A name that `robots` lists, or a path.
        mount: `floor`, `wall`, `ceiling` or `tilt:DEG`, in place of what the file says.
        collision: Whether to read the collision geometry of a URDF, meshes included, where the
            robot has no capsules; what cannot be read is in the robot's `capsule_notes`.

    Raises:
        RobotError: No such robot or file (the message lists the built-in ones), a file that
            cannot be read or understood, or an unknown mounting.
    """
    robot = _load(name_or_path, collision)
    return robot if mount is None else with_mount(robot, mount)


def _load(name_or_path: str | Path, collision: bool) -> RobotModel:
    text = str(name_or_path)
    names = _names()
    if text.lower() in names:
        file = resources.files(library) / f"{text.lower()}.toml"
        return robot_from_toml(file.read_bytes(), Path(f"{text.lower()}.toml"))
    path = Path(os.path.expanduser(text))
    if not text.strip() or not is_there(path):
        near = difflib.get_close_matches(text.lower(), names, n=1)
        looks_like_path = "/" in text or path.suffix.lower() in (".urdf", ".toml", ".xml")
        raise RobotError(
            "no such file" if looks_like_path else "neither a built-in robot nor a file",
            where="robot",
            value=shown(text) or "nothing",
            limit=f"{', '.join(names)}, or a URDF or robot file",
            next_step=f"Did you mean {near[0]}?" if near else None,
        )
    data = read_limited(path, MAX_URDF)
    if data.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] == b"<" or path.suffix.lower() == ".urdf":
        robot = robot_from_urdf(data, where=shown_path(path), stem=path.stem)
        return with_collision_geometry(robot, path) if collision else robot
    if len(data) > MAX_TOML:
        raise RobotError(
            "the file is too large for a robot file", where=shown_path(path), limit=MAX_TOML
        )
    return robot_from_toml(data, path, collision=collision)


def _names() -> list[str]:
    files = resources.files(library).iterdir()
    return sorted(file.name[:-5] for file in files if file.name.endswith(".toml"))
