"""Robots by built-in name, URDF file or robot file, and as JSON objects."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from dynid.core import JsonFields, RobotError, like_named, plain, printable
from dynid.robot import body, kinematics, robotfile, tables, urdf, urdf_bodies
from dynid.robot.model import RobotModel

_CALIBRATED = 3e-3
"""Placements of one arm and its factory calibration differ by less [m]."""


class BuiltinRobot(NamedTuple):
    """A robot that comes with dynid."""

    name: str
    """What `load_robot` calls it."""
    joints: int
    """Number of joints."""
    source: str
    """Where its numbers are from."""


def robots() -> list[BuiltinRobot]:
    """The built-in robots, by name."""
    found = [load_robot(name) for name in robotfile.builtin_names()]
    return [BuiltinRobot(robot.name, robot.joints, robot.source) for robot in found]


RobotLike = RobotModel | str | Path
"""A robot, its built-in name or its file."""


def load_robot(
    name_or_path: RobotLike,
    *,
    mount: str | None = None,
    collision: bool = True,
    mesh_dirs: Sequence[Path] = (),
) -> RobotModel:
    """A robot by built-in name, URDF file or robot file (TOML).

    Files are told apart by what is in them, not by their ending.

    Args:
        name_or_path: A name that `robots` lists, or a path; a robot model stays as it is, but for
            the mounting.
        mount: `floor`, `wall`, `ceiling` or `tilt:DEG`, in place of what the file says.
        collision: Whether to read the collision geometry of a URDF, meshes included, where the
            robot has no bodies; what cannot be read is in the robot's `body_notes`. It is
            read all the same where a link of known mass has no tensor: its shape tells one.
        mesh_dirs: Further folders where meshes are looked for.

    Raises:
        RobotError: No such robot or file (the message lists the built-in ones), a file that
            cannot be read or understood, or an unknown mounting.
    """
    if isinstance(name_or_path, RobotModel):
        robot = name_or_path
    else:
        robot = _load(name_or_path, collision, mesh_dirs)
    return robot if mount is None else kinematics.with_mount(robot, mount)


def _load(name_or_path: str | Path, collision: bool, mesh_dirs: Sequence[Path] = ()) -> RobotModel:
    text = str(name_or_path)
    if text.lower() in robotfile.builtin_names():
        return _built_in(text.lower())
    path = Path(os.path.expanduser(text))
    if not text.strip() or not tables.is_there(path):
        names = robotfile.builtin_names()
        looks_like_path = "/" in text or path.suffix.lower() in (".urdf", ".toml", ".xml")
        raise RobotError(
            "no such file" if looks_like_path else "neither a built-in robot nor a file",
            where="robot",
            value=printable(text, 120) or "nothing",
            limit=f"{', '.join(names)}, or a URDF or robot file",
            next_step=like_named(path, *names),
        )
    data, where = tables.read_limited(path, urdf.MAX_BYTES), tables.shown_path(path)
    if data.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] == b"<" or path.suffix.lower() == ".urdf":
        robot = urdf.robot_from_urdf(data, where=where, file=path)
        known = ~np.isnan(robot.inertias)
        if collision or (known[:, 0] & ~known.all(axis=1)).any():
            robot = urdf_bodies.with_collision_geometry(robot, path, mesh_dirs=mesh_dirs)
    elif len(data) > robotfile.MAX_BYTES:
        limit = robotfile.MAX_BYTES
        raise RobotError("the file is too large for a robot file", where=where, limit=limit)
    else:
        robot = robotfile.robot_from_toml(data, path, collision=collision, mesh_dirs=mesh_dirs)
    return replace(robot, file=str(path.parent.resolve() / path.name))


@cache
def _built_in(name: str) -> RobotModel:
    """Read once: robots cannot be changed, and reading takes as long as all else of a command."""
    return robotfile.robot_from_toml(robotfile.builtin_file(name), Path(f"{name}.toml"))


def robot_to_json(robot: RobotModel) -> dict[str, Any]:
    """Everything that evaluates the robot's dynamics; unknown numbers become null."""
    values = cast("dict[str, Any]", plain(robot))
    # What the flange carries is not part of the robot.
    del values["tool"]
    return {key: value for key, value in values.items() if key not in _PLACES or value}


_PLACES = ("urdf", "file")


def robot_from_json(data: Mapping[str, Any]) -> RobotModel:
    """The inverse of `robot_to_json`; files of the first versions know neither notes nor safety.

    Raises:
        InputError: Missing keys or values that make no robot.
    """
    try:
        return JsonFields(data, "robot.").made(RobotModel, bodies=_bodies(data))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise RobotError(
            "the robot stored in this file cannot be read", value=f"{type(error).__name__}: {error}"
        ) from error


def _bodies(data: Mapping[str, Any]) -> tuple[body.Body, ...]:
    """The collision bodies of a stored robot.

    Those of a built-in arm that release 0.1 stored were capsules that nothing had checked:
    today's take their place.
    """
    stored = JsonFields(data, "robot.")
    if "bodies" in data:
        return tuple(item.made(body.Body) for item in stored.objects("bodies"))
    if data["name"] in robotfile.builtin_names():
        today = _load(str(data["name"]), collision=False)
        there = np.array(data["placements"])
        if there.shape == today.placements.shape and np.allclose(
            there, today.placements, atol=_CALIBRATED
        ):
            return today.bodies
    return tuple(
        item.made(body.Body, points=np.array([item.vector("start"), item.vector("end")]))
        for item in stored.objects("capsules")
    )
