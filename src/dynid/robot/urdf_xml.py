"""URDF text as checked values: every number finite, every name known, one tree.

No parser but Python's own sees the text, so a broken file is an error with a place in it,
never a crash of a C++ library.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import RobotError
from dynid.robot.files import shown
from dynid.robot.inertia import from_body, move
from dynid.robot.urdf_numbers import read_bound, read_number, read_origin, read_vector
from dynid.robot.urdf_tree import FIXED, MOVING, UrdfJoint, UrdfTree, check_tree

_MAX_DEPTH = 100


def parse_urdf(data: bytes, where: str) -> UrdfTree:
    """Check URDF text and take its kinematics and inertias.

    Args:
        data: The file's bytes.
        where: The file's name, for errors.

    Raises:
        RobotError: Anything that is not a URDF of one tree with sane numbers; the message
            names the element.
    """
    root = parse_root(data, where)
    notes: list[str] = []
    links: dict[str, Array | None] = {}
    for element in root.iterfind("link"):
        name = _name(element, where, links)
        links[name] = _inertia(element, f"{where}: link {shown(name)}")
    joints: dict[str, UrdfJoint] = {}
    for element in root.iterfind("joint"):
        name = _name(element, where, joints)
        joints[name] = _joint(element, name, f"{where}: joint {shown(name)}", links, notes)
    if not links:
        raise RobotError("the file has no links", where=where)
    title = shown(root.get("name") or "", 80).strip()
    top = check_tree(links, joints, where)
    return UrdfTree(name=title, root=top, links=links, joints=joints, notes=tuple(notes))


class _ShallowBuilder(ET.TreeBuilder):
    """A tree builder that refuses absurd depth and drops namespaces."""

    def __init__(self) -> None:
        super().__init__()
        self._depth = 0

    def start(self, tag: str, attrs: dict[str, str], /) -> ET.Element:  # pyright: ignore[reportIncompatibleMethodOverride]
        self._depth += 1
        if self._depth > _MAX_DEPTH:
            raise ET.ParseError(f"elements nest more than {_MAX_DEPTH} deep")
        if "xacro" in tag:
            raise ET.ParseError("this is a xacro file, not a URDF; run: xacro FILE > FILE.urdf")
        return super().start(tag.rpartition("}")[2], attrs)

    def end(self, tag: str, /) -> ET.Element:
        self._depth -= 1
        return super().end(tag.rpartition("}")[2])

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise ET.ParseError("a URDF with a document type is refused")


def parse_root(data: bytes, where: str) -> ET.Element:
    """The outer element of URDF text, parsed with care.

    Raises:
        RobotError: Not XML, a xacro file, or no `robot` element.
    """
    text = data.lstrip()
    if not text:
        raise RobotError("the file is empty", where=where)
    try:
        root = ET.fromstring(text, ET.XMLParser(target=_ShallowBuilder()))
    except (ET.ParseError, LookupError, ValueError, RecursionError) as error:
        reason = shown(error)
        step = "Run: xacro FILE > FILE.urdf" if b"xacro:" in text else None
        raise RobotError(f"not well-formed XML ({reason})", where=where, next_step=step) from error
    if root.tag != "robot":
        raise RobotError(
            "not a URDF: the outer element is not <robot>", where=where, value=shown(root.tag)
        )
    return root


def _name(element: ET.Element, where: str, known: Mapping[str, object]) -> str:
    name = (element.get("name") or "").strip()
    if not name:
        raise RobotError(f"a <{element.tag}> has no name", where=where)
    if name in known:
        raise RobotError(
            f"two elements <{element.tag}> have the same name", where=where, value=name
        )
    return name


def _inertia(element: ET.Element, where: str) -> Array | None:
    inertial = element.find("inertial")
    if inertial is None:
        return None
    mass = read_number(inertial.find("mass"), "value", where)
    if mass < 0:
        raise RobotError("negative mass", where=where, value=mass)
    found = inertial.find("inertia")
    six = [0.0 if found is None else read_number(found, key, where, 0.0) for key in _TENSOR]
    xx, xy, xz, yy, yz, zz = six
    central = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return move(from_body(mass, np.zeros(3), central), read_origin(inertial, where))


_TENSOR = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def _joint(
    element: ET.Element, name: str, where: str, links: dict[str, Array | None], notes: list[str]
) -> UrdfJoint:
    kind = (element.get("type") or "").strip()
    if kind not in MOVING + FIXED:
        raise RobotError("unknown joint type", where=where, value=kind, limit=MOVING + FIXED)
    ends: list[str] = []
    for side in ("parent", "child"):
        found = element.find(side)
        link = (found.get("link") or "").strip() if found is not None else ""
        if link not in links:
            raise RobotError(
                f"the {side} link does not exist", where=where, value=link or "nothing"
            )
        ends.append(link)
    axis = np.array([1.0, 0.0, 0.0])
    found = element.find("axis")
    if kind in MOVING and found is not None:
        axis = np.array(read_vector(found, "xyz", where))
        length = float(np.linalg.norm(axis))
        if length < 1e-6:
            raise RobotError("the axis has no length", where=where, value=axis.tolist())
        if abs(length - 1) > 1e-3:
            notes.append(f"joint {shown(name)}: axis of length {length:.4g} made a unit axis")
        axis = axis / length
    return UrdfJoint(
        name=name,
        kind=kind,
        parent=ends[0],
        child=ends[1],
        origin=read_origin(element, where),
        axis=axis,
        limits=_limits(element.find("limit"), kind, name, where, notes),
        mimic=_mimic(element.find("mimic"), where),
    )


def _limits(
    found: ET.Element | None, kind: str, name: str, where: str, notes: list[str]
) -> tuple[float, float, float, float]:
    nan = math.nan
    if kind not in MOVING or found is None:
        return nan, nan, nan, nan
    lower = read_bound(found, "lower", where)
    upper = read_bound(found, "upper", where)
    if lower > upper:
        raise RobotError("lower limit above the upper one", where=where, value=lower, limit=upper)
    if kind == "continuous" or (lower == 0 == upper):
        if kind != "continuous":
            notes.append(f"joint {shown(name)}: limits 0 to 0 read as unknown")
        lower = upper = nan
    speed = read_bound(found, "velocity", where)
    effort = read_bound(found, "effort", where)
    # Zero or less is how files say that they do not know.
    return lower, upper, speed if speed > 0 else nan, effort if effort > 0 else nan


def _mimic(found: ET.Element | None, where: str) -> tuple[str, float, float] | None:
    if found is None:
        return None
    multiplier = read_number(found, "multiplier", where, 1.0)
    offset = read_number(found, "offset", where, 0.0)
    return (found.get("joint") or "").strip(), multiplier, offset
