"""URDF text as checked values: a tree of links and joints, every number finite."""

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from xml.parsers import expat

import numpy as np

from dynid.core import Array, RobotError, printable
from dynid.robot.model import UNLIMITED
from dynid.robot.transforms import from_body, from_xyz_rpy, move, translation

_LARGEST = 1e6
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_UNBOUNDED = re.compile(r"[+-]?inf(inity)?", re.IGNORECASE)


def read_origin(element: ET.Element, where: str) -> Array:
    """The `origin` within an element (4, 4), or none at all.

    Raises:
        RobotError: Not three finite numbers.
    """
    found = element.find("origin")
    if found is None:
        return translation(0, 0, 0)
    zero = [0.0, 0.0, 0.0]
    xyz = read_vector(found, "xyz", where) if found.get("xyz") is not None else zero
    rpy = read_vector(found, "rpy", where) if found.get("rpy") is not None else zero
    return from_xyz_rpy(xyz, rpy)


def read_vector(element: ET.Element, key: str, where: str) -> list[float]:
    """Three numbers.

    Raises:
        RobotError: Not three finite numbers within reason.
    """
    words = (element.get(key) or "").split()
    if len(words) != 3:
        raise RobotError(
            f"<{element.tag} {key}> needs three numbers", where=where, value=element.get(key)
        )
    return [_number(word, f"<{element.tag} {key}>", where) for word in words]


def read_number(
    element: ET.Element | None, key: str, where: str, default: float | None = None
) -> float:
    """One number, or the default where there is none.

    Raises:
        RobotError: Missing without a default, or not a finite number within reason.
    """
    text = element.get(key) if element is not None else None
    if element is None or text is None:
        if default is None:
            raise RobotError(f"the mass or its '{key}' is missing", where=where)
        return default
    return _number(text.strip(), f"<{element.tag} {key}>", where)


def read_bound(element: ET.Element, key: str, where: str) -> float:
    """A joint limit; NaN where there is none, or one far beyond any robot.

    Raises:
        RobotError: Not a number.
    """
    text = element.get(key)
    if text is None or _UNBOUNDED.fullmatch(text.strip()):
        return math.nan
    value = _number(text.strip(), f"<{element.tag} {key}>", where, math.inf)
    return value if abs(value) <= _LARGEST else math.nan


def _number(text: str, what: str, where: str, largest: float = _LARGEST) -> float:
    if not _NUMBER.fullmatch(text) or not text.isascii():
        step = "Run: xacro FILE > FILE.urdf" if "${" in text or "$(" in text else None
        raise RobotError(f"{what} is not a finite number", where=where, value=text, next_step=step)
    value = float(text)
    if abs(value) > largest:
        raise RobotError(f"{what} is out of range", where=where, value=text, limit=largest)
    return value


MOVING = ("revolute", "continuous", "prismatic")
FIXED = ("fixed", "floating", "planar")


@dataclass(frozen=True, slots=True, kw_only=True)
class UrdfJoint:
    """One joint as the file has it."""

    name: str
    kind: str
    """One of `MOVING` or `FIXED`."""
    parent: str
    child: str
    origin: Array
    """(4, 4) in the parent link's frame [m]."""
    axis: Array
    """(3) unit axis in the joint frame."""
    limits: tuple[float, float, float, float]
    """Lower, upper [rad or m], velocity, effort; NaN where unknown."""
    mimic: tuple[str, float, float] | None = None
    """The joint it follows, multiplier and offset: q = multiplier * q_other + offset."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UrdfTree:
    """A robot as the file has it."""

    name: str
    root: str
    links: dict[str, Array | None]
    """Link to its ten parameters in the link frame, None where the file gives none."""
    joints: dict[str, UrdfJoint]
    notes: tuple[str, ...]

    def downward(self) -> list[UrdfJoint]:
        """The joints that are reached from the root, parents before children."""
        below: dict[str, list[UrdfJoint]] = {}
        for joint in self.joints.values():
            below.setdefault(joint.parent, []).append(joint)
        found = list(below.get(self.root, []))
        for joint in found:
            found += below.get(joint.child, [])
        return found


def _root(links: dict[str, Array | None], joints: dict[str, UrdfJoint], where: str) -> str:
    """The one link that no joint moves."""
    above: dict[str, str] = {}
    for joint in joints.values():
        if joint.child in above:
            raise RobotError("a link has two parent joints", where=where, value=joint.child)
        above[joint.child] = joint.parent
    roots = [name for name in links if name not in above]
    if len(roots) != 1:
        raise RobotError(
            "the links do not form one tree: there must be one link without a parent joint",
            where=where,
            value=[printable(name, 40) for name in roots[:6]] or "none (a loop)",
        )
    return roots[0]


_MAX_DEPTH = 100


def parse_urdf(data: bytes, where: str) -> UrdfTree:
    """Check URDF text and take its kinematics and inertias; `where` is the file's name.

    Raises:
        RobotError: Anything that is not a URDF of one tree with sane numbers; the message
            names the element.
    """
    root = parse_root(data, where)
    notes: list[str] = []
    links: dict[str, Array | None] = {}
    for element in root.iterfind("link"):
        name = _name(element, where, links)
        links[name] = _inertia(element, f"{where}: link {printable(name)}")
    joints: dict[str, UrdfJoint] = {}
    for element in root.iterfind("joint"):
        name = _name(element, where, joints)
        joints[name] = _joint(element, name, f"{where}: joint {printable(name)}", links, notes)
    if not links:
        raise RobotError("the file has no links", where=where)
    title = printable(root.get("name") or "", 80).strip()
    top = _root(links, joints, where)
    tree = UrdfTree(name=title, root=top, links=links, joints=joints, notes=tuple(notes))
    # One root and one parent each: whatever is not reached from the root is a loop.
    reached = {top, *(joint.child for joint in tree.downward())}
    lost = [name for name in links if name not in reached]
    if lost:
        raise RobotError("joints form a loop", where=where, value=lost[0])
    return tree


class _ShallowBuilder(ET.TreeBuilder):
    """A tree builder that refuses absurd depth."""

    def __init__(self) -> None:
        super().__init__()
        self._depth = 0

    def start(self, tag: str, attrs: dict[str, str], /) -> ET.Element:  # pyright: ignore[reportIncompatibleMethodOverride]
        self._depth += 1
        if self._depth > _MAX_DEPTH:
            raise ET.ParseError(f"elements nest more than {_MAX_DEPTH} deep")
        if "xacro" in tag:
            raise ET.ParseError("this is a xacro file, not a URDF")
        return super().start(tag.rpartition(":")[2], attrs)

    def end(self, tag: str, /) -> ET.Element:
        self._depth -= 1
        return super().end(tag.rpartition(":")[2])


def parse_xml(data: bytes, builder: ET.TreeBuilder) -> ET.Element:
    """The outer element, names and attributes with the prefixes that the file gives them.

    URDF has no namespaces: its loaders read `drake:` or `gazebo:` also where nothing declares it.

    Raises:
        expat.ExpatError: Not well-formed.
        ET.ParseError: A document type, or what the builder refuses.
        LookupError: An unknown encoding.
    """
    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    parser.CommentHandler = builder.comment
    parser.StartDoctypeDeclHandler = _refuse_doctype
    parser.Parse(data, True)
    return builder.close()


def _refuse_doctype(*_: object) -> None:
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
        root = parse_xml(text, _ShallowBuilder())
    except (expat.ExpatError, ET.ParseError, LookupError, ValueError, RecursionError) as error:
        reason = printable(error, 120)
        step = "Run: xacro FILE > FILE.urdf" if b"xacro:" in text else None
        raise RobotError(f"not well-formed XML ({reason})", where=where, next_step=step) from error
    if root.tag != "robot":
        raise RobotError(
            "not a URDF: the outer element is not <robot>", where=where, value=printable(root.tag)
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
            notes.append(f"joint {printable(name)}: axis of length {length:.4g} made a unit axis")
        axis = axis / length
    return UrdfJoint(
        name=name,
        kind=kind,
        parent=ends[0],
        child=ends[1],
        origin=read_origin(element, where),
        axis=axis,
        limits=_limits(element, kind, name, where, notes),
        mimic=_mimic(element.find("mimic"), where),
    )


def _limits(
    element: ET.Element, kind: str, name: str, where: str, notes: list[str]
) -> tuple[float, float, float, float]:
    nan, found, soft = math.nan, element.find("limit"), element.find("safety_controller")
    if kind not in MOVING or found is None:
        return nan, nan, nan, nan
    lower = read_bound(found, "lower", where)
    upper = read_bound(found, "upper", where)
    absent = [found.get(side) is None for side in ("lower", "upper")]
    if absent[0] != absent[1]:
        # By the format, one that is left out is zero.
        lower, upper = (0.0, upper) if absent[0] else (lower, 0.0)
    if lower > upper:
        raise RobotError("lower limit above the upper one", where=where, value=lower, limit=upper)
    if kind == "continuous" or (lower == 0 == upper):
        if kind != "continuous":
            notes.append(f"joint {printable(name)}: limits 0 to 0 read as unknown")
        lower = upper = nan
    elif soft is not None:
        # Beyond these a controller takes the joint over.
        soft_lower = float(np.fmax(lower, read_bound(soft, "soft_lower_limit", where)))
        soft_upper = float(np.fmin(upper, read_bound(soft, "soft_upper_limit", where)))
        if soft_lower < soft_upper:
            lower, upper = soft_lower, soft_upper
    speed = read_bound(found, "velocity", where)
    for bound, value in {"lower": lower, "upper": upper, "velocity": speed}.items():
        if abs(value) >= UNLIMITED:
            notes.append(f"joint {printable(name)}: {bound} limit of {value:.4g} read as unknown")
    effort = read_bound(found, "effort", where)
    # Zero or less is how files say that they do not know.
    return lower, upper, speed if speed > 0 else nan, effort if effort > 0 else nan


def _mimic(found: ET.Element | None, where: str) -> tuple[str, float, float] | None:
    if found is None:
        return None
    multiplier = read_number(found, "multiplier", where, 1.0)
    offset = read_number(found, "offset", where, 0.0)
    return (found.get("joint") or "").strip(), multiplier, offset
