"""The parts of a robot file that go on top of the kinematics.

Each reader takes the parsed table and the robot so far, and gives the fields of RobotModel
that change and the sources that the file names.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import RobotError
from dynid.robot.capsule import Capsule
from dynid.robot.counterbalance import Counterbalance
from dynid.robot.drives import Drives
from dynid.robot.inertia import from_body, move
from dynid.robot.limits import JointLimits
from dynid.robot.model import RobotModel
from dynid.robot.mount import mount_gravity
from dynid.robot.safety import SafetyLimits
from dynid.robot.tables import Table, tables

Part = tuple[dict[str, Any], list[str]]
"""Fields of RobotModel that change, and sources."""

_SIDES = ("joint", "motor")
_BODY_FRAMES = ("dh", "mdh", "urdf", "joint")
_LIMITS = ("lower", "upper", "velocity", "acceleration", "torque")
_CYLINDER = ("outer", "inner", "rest_length", "offset", "piston_area", "gas_work", "gas_volume")
_SAFETY = ("tcp_speed", "elbow_speed", "momentum", "power")
_STRONGEST = 30.0


def read_mount(values: object, robot: RobotModel) -> Part:
    """The table `mount`: a kind, or gravity in the base frame."""
    del robot
    table = Table(values, "", "mount", ("kind", "gravity"))
    if ("kind" in table) == ("gravity" in table):
        raise RobotError("give either kind or gravity")
    if "kind" in table:
        kind = table.text("kind")
        return {"mount": kind, "gravity": mount_gravity(kind)}, table.sources("mount")
    gravity = table.numbers("gravity", 3)
    if float(np.linalg.norm(gravity)) > _STRONGEST:
        raise RobotError(
            "gravity is too strong", value=gravity.tolist(), limit=f"{_STRONGEST} m/s^2"
        )
    return {"mount": "file", "gravity": gravity}, table.sources("mount")


def read_limits(values: object, robot: RobotModel) -> Part:
    """The table `limits`; what it leaves out stays as it was."""
    table = Table(values, "", "limits", _LIMITS)
    found = {
        key: table.numbers(key, robot.joints, unknown=True)
        if key in table
        else getattr(robot.limits, key)
        for key in _LIMITS
    }
    return {"limits": JointLimits(**found)}, table.sources("limits")


def read_safety(values: object, robot: RobotModel) -> Part:
    """The table `safety`; `elbow` is the joint at whose `urdf` frame the elbow is."""
    table = Table(values, "", "safety", (*_SAFETY, "elbow"))
    found: dict[str, Any] = {key: table.number(key) for key in _SAFETY if key in table}
    if "elbow" in table:
        found["elbow"] = 1 + robot.joint_names.index(table.text("elbow", robot.joint_names))
    elif "elbow_speed" in table:
        raise RobotError("'elbow_speed' needs 'elbow', the name of a joint")
    return {"safety": SafetyLimits(**found)}, table.sources("safety")


def read_drives(values: object, robot: RobotModel) -> Part:
    """The table `drives`."""
    known = ("gain", "gear_ratio", "coupling", "offset", "position_side", "torque_side")
    table = Table(values, "", "drives", known)
    n = robot.joints
    found: dict[str, Any] = {
        key: table.numbers(key, n, unknown=True) if key in table else np.full(n, np.nan)
        for key in ("gain", "gear_ratio")
    }
    if "coupling" in table:
        found["coupling"] = table.rows("coupling", n, n)
    if "offset" in table:
        found["offset"] = table.numbers("offset", n)
    for key in ("position_side", "torque_side"):
        if key in table:
            found[key] = table.text(key, _SIDES)
    return {"drives": Drives(**found)}, table.sources("drives")


def read_inertias(values: object, robot: RobotModel) -> Part:
    """The table `inertia`: masses, centres of mass and tensors in frames of one convention."""
    table = Table(values, "", "inertia", ("frames", "mass", "com", "tensor"))
    n = robot.joints
    frames = _frames(table, robot)
    mass = table.numbers("mass", n, unknown=True)
    com = table.rows("com", n, 3, unknown=True) if "com" in table else np.full((n, 3), np.nan)
    six = table.rows("tensor", n, 6, unknown=True) if "tensor" in table else np.full((n, 6), np.nan)
    rows = [_body(mass[k], com[k], six[k], frames[k]) for k in range(n)]
    return {"inertias": np.array(rows)}, table.sources("inertia")


def read_counterbalances(values: object, robot: RobotModel) -> Part:
    """The tables `counterbalance`."""
    found: list[Counterbalance] = []
    texts: list[str] = []
    for table in tables(values, "counterbalance", "", ("joint", *_CYLINDER)):
        joint = robot.joint_names.index(table.text("joint", robot.joint_names))
        numbers = {key: table.number(key) for key in _CYLINDER}
        found.append(Counterbalance(joint=joint, **numbers))
        texts += table.sources("counterbalance")
    return {"counterbalances": tuple(found)}, texts


def read_capsules(values: object, robot: RobotModel) -> Part:
    """The tables `capsule`; `link` is `base` or the joint that moves the link."""
    found: list[Capsule] = []
    texts: list[str] = []
    known = ("name", "link", "frames", "start", "end", "radius")
    for k, table in enumerate(tables(values, "capsule", "", known)):
        links = ("base", *robot.joint_names)
        link = links.index(table.text("link", links))
        placed = _frames(table, robot)[link - 1] if link else np.eye(4)
        start, end = (
            placed[:3, :3] @ table.numbers(key, 3) + placed[:3, 3] for key in ("start", "end")
        )
        name = table.text("name") if "name" in table else f"{links[link]} {k + 1}"
        found.append(
            Capsule(name=name, link=link, start=start, end=end, radius=table.number("radius"))
        )
        texts += table.sources("capsule")
    return {"capsules": tuple(found)}, texts


def read_collision(values: object, robot: RobotModel) -> Part:
    """The table `collision`: a note on the capsules, and what they say too strictly."""
    table = Table(values, "", "collision", ("note", "apart", "overlap", "overlap_by"))
    links = ("base", *robot.joint_names)
    found: dict[str, Any] = {}
    if "note" in table:
        found["capsule_notes"] = (table.text("note"),)
    if "apart" in table:
        found["apart"] = tuple(_sorted_pair(links, pair) for pair in table.pairs("apart", links))
    if "overlap" in table:
        pairs = table.pairs("overlap", links)
        lengths = table.numbers("overlap_by", len(pairs)).tolist()
        if not all(0 <= length < 1 for length in lengths):
            raise RobotError("'overlap_by' is out of range", value=lengths, limit="0 to 1 m")
        found["overlap"] = tuple(
            (*_sorted_pair(links, pair), length)
            for pair, length in zip(pairs, lengths, strict=True)
        )
    return found, table.sources("collision")


def _sorted_pair(links: tuple[str, ...], pair: tuple[str, str]) -> tuple[int, int]:
    first, second = sorted(links.index(name) for name in pair)
    return first, second


def _frames(table: Table, robot: RobotModel) -> Array:
    name = table.text("frames", _BODY_FRAMES) if "frames" in table else "joint"
    if name == "joint":
        return np.tile(np.eye(4), (robot.joints, 1, 1))
    return robot.parameter_frames[name]


def _body(mass: float, com: Array, six: Array, frame: Array) -> Array:
    """The ten parameters in the joint frame, as far as they are known."""
    if mass < 0:
        raise RobotError("negative mass", value=mass)
    xx, yy, zz, yz, xz, xy = six.tolist()
    central = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if np.isnan(mass) or np.isnan(com).any():
        return np.array([mass, *[np.nan] * 9])
    return move(from_body(mass, com, central), frame)
