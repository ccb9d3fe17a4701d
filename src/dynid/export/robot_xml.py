"""URDF and MJCF: inertias, armature, damping and dry friction of an identified arm.

A URDF that the robot came from is copied, with what was identified in it. Names, limits, visuals,
meshes and everything else stay as they are. The link that a joint moves holds the inertia of all
that moves with it; links fixed to it have none of their own. Links behind a frozen joint, such as
fingers, keep theirs where the rest remains possible.
"""

import html
import math
import os
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynid.core import Array, JobError, printable, scipy_part
from dynid.export.model import ExportModel, NearestFriction
from dynid.robot import RobotModel, UrdfLink, is_physical, move, parse_xml, tensor, urdf_links


def roll_pitch_yaw(rotation: Array) -> tuple[float, float, float]:
    """Angles of a rotation (3, 3) about the fixed axes x, y, z, in that order [rad], as in URDF."""
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    c, s = math.cos(yaw), math.sin(yaw)
    pitch = math.atan2(-rotation[2, 0], c * rotation[0, 0] + s * rotation[1, 0])
    # Of the rotation turned back by the yaw: near upright, where the yaw is all rounding, the
    # roll takes its error back.
    roll = math.atan2(
        s * rotation[0, 2] - c * rotation[1, 2], c * rotation[1, 1] - s * rotation[0, 1]
    )
    return roll, pitch, yaw


def quaternion(rotation: Array) -> Array:
    """(4) w, x, y, z of a rotation (3, 3), w not negative."""
    # A copy: SciPy 1.11 takes no array that is read-only.
    turned = scipy_part("spatial.transform").Rotation.from_matrix(np.array(rotation))
    return np.roll(turned.as_quat(canonical=True), 1)


def upright(gravity: Array) -> Array:
    """(3, 3) the rotation that takes a gravity vector (3) to straight down, -z."""
    size = float(np.linalg.norm(gravity))
    if size == 0.0:
        return np.eye(3)
    z = -gravity / size
    if z[2] > 1.0 - 1e-15:
        return np.eye(3)
    helper = np.eye(3)[0] if abs(z[0]) < 0.9 else np.eye(3)[1]
    across: Array = helper - (helper @ z) * z
    x = across / float(np.linalg.norm(across))
    return np.array([x, np.cross(z, x), z], dtype=np.float64)


ADVICE = "Identify with --estimator sdp, or export to json, c or python."
_LONG = {
    "Im": "motor inertias",
    "Fo": "friction offsets",
    "Fca": "Coulomb asymmetries",
    "Fva": "viscous asymmetries",
    "Fs": "Stribeck terms",
    "Fr": "cube-root friction",
    "Fcm": "friction of coupled motors",
    "Fvm": "friction of coupled motors",
    "Imm": "inertias of coupled motors",
    "Fl": "friction that grows with load",
    "Fw": "torque ripple of gears",
}

_SIX = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
"""Attributes of an inertia tensor in URDF, in the order of `bodies`."""


def bodies(model: ExportModel) -> list[tuple[float, Array, Array]]:
    """Mass [kg], centre of mass (3) [m] and central inertia (6) [kg.m^2] of each link, as `_SIX`.

    Raises:
        JobError: A link whose mass is not positive, which has no centre of mass that loaders
            take.
    """
    found: list[tuple[float, Array, Array]] = []
    for i, row in enumerate(model.inertials):
        mass = float(row[0])
        if not mass > 0.0:
            raise JobError(
                f"not physical: the mass of link {i + 1} is not positive, and loaders refuse it",
                value=mass,
                next_step=ADVICE,
            )
        centre = row[1:4] / mass
        steiner = mass * ((centre @ centre) * np.eye(3) - np.outer(centre, centre))
        central = tensor(row) - steiner
        found.append((mass, centre, central[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]))
    return found


def joint_names(robot: RobotModel) -> list[str]:
    """(n) printable names, each once: two may differ in nothing that is printable."""
    found: list[str] = []
    for name in robot.joint_names:
        found.append(_free(printable(name, None), found))
    return found


def _free(name: str, taken: Iterable[str]) -> str:
    while name in taken:
        name += "_"
    return name


def refuse_negative_friction(model: ExportModel) -> None:
    """Check what loaders check.

    Raises:
        JobError: Negative Coulomb or viscous friction.
    """
    for symbol, word in (("Fc", "Coulomb friction"), ("Fv", "viscous friction")):
        low = int(np.argmin(model.terms[symbol]))
        if model.terms[symbol][low] < 0.0:
            raise JobError(
                f"not physical: the {word} of joint {low + 1} is negative, and loaders refuse it",
                value=float(model.terms[symbol][low]),
                next_step=ADVICE,
            )


def left_out(model: ExportModel, held: Iterable[str]) -> tuple[str, ...]:
    """What the identified model has and a file with the terms `held` has not, in words."""
    gone = [
        _LONG[symbol]
        for symbol, values in model.terms.items()
        if symbol not in held and values.any()
    ]
    if model.presliding is not None:
        gone.append("presliding friction")
    if model.robot.counterbalances:
        gone.append("torques of counterbalances")
    return tuple(dict.fromkeys(gone))


def stand_in_words(friction: NearestFriction | None) -> list[str]:
    """Lines of a comment where the friction of a file is not the identified one."""
    if friction is None or not friction.stands_in:
        return []
    left = " ".join(f"{value:.3g}" for value in friction.missing)
    return [
        "Damping and dry friction: the two that are nearest to all friction that was identified,",
        f"over the recorded range. RMS of what they leave, by joint: {left} N.m (N).",
    ]


def numbers(*values: float) -> str:
    """Numbers that read back exactly, with blanks between them."""
    return " ".join(repr(float(value) + 0.0) for value in values)


def comment(remarks: Iterable[str]) -> str:
    """Lines as the comment on top of a file."""
    lines = [
        html.escape(printable(line, None), quote=False).replace("--", "- -")
        for remark in remarks
        for line in remark.splitlines()
    ]
    return "\n".join(["<!--", *(f"  {line}" for line in lines), "-->"])


def _document(root: ET.Element, remarks: Sequence[str]) -> str:
    """The file's text, remarks as a comment on top."""
    ET.indent(root)
    return f"{HEAD}\n{comment(remarks)}\n{ET.tostring(root, encoding='unicode')}\n"


HEAD = '<?xml version="1.0"?>'
URDF_HELD = ("Fc", "Fv")
"""Terms beside the inertias that URDF has a place for."""
_REVOLUTE = 2.0 * np.pi
_PRISMATIC = 10.0
_EFFORT = 1e4
_SPEED = 1e2


def urdf_remarks(model: ExportModel, note: str) -> list[str]:
    """Lines of the comment of a URDF: the note, and what was identified and has no place in it."""
    remarks = [note]
    missing = left_out(model, URDF_HELD)
    if missing:
        remarks.append(f"Identified, but without a place in URDF: {', '.join(missing)}.")
    for symbol, what in (("Im", "Motor inertias"), ("Imm", "Inertias of coupled motors")):
        values = model.terms.get(symbol)
        if values is not None and values.any():
            remarks.append(f"{what}, joint side, by joint: {numbers(*values)}.")
    return remarks


def urdf_text(model: ExportModel, note: str = "") -> str:
    """The file's text. The mounting stands as a fixed joint that turns the base under `world`.

    Joint frames, names and signs are the robot's own. URDF has neither motor inertia nor the
    strength of gravity; those, and limits that are not known, stand in the comment, as does the
    note.

    Raises:
        JobError: A link without mass, or negative friction, which loaders refuse.
    """
    robot = model.robot
    refuse_negative_friction(model)
    remarks = urdf_remarks(model, note)
    remarks.insert(1, f"Gravity: {numbers(float(np.linalg.norm(robot.gravity)))} m/s^2.")
    limits = robot.limits
    if np.isnan([limits.lower, limits.upper, limits.velocity, limits.torque]).any():
        remarks.append("Limits that are not known stand as very large numbers.")
    root = ET.Element("robot", name=printable(robot.name, None))
    turn = np.eye(4)
    turn[:3, :3] = upright(robot.gravity)
    ET.SubElement(root, "link", name="world")
    ET.SubElement(root, "link", name="base_link")
    names = joint_names(robot)
    _urdf_joint(root, _free("mounting", names), "fixed", turn, "world", "base_link")
    for i, (mass, centre, inertia) in enumerate(bodies(model)):
        link = ET.SubElement(root, "link", name=f"link_{i + 1}")
        fill_inertial(ET.SubElement(link, "inertial"), mass, centre, inertia)
        _joint(root, model, i, names[i])
    ET.SubElement(root, "link", name="flange")
    last = f"link_{robot.joints}"
    _urdf_joint(root, _free("flange_fixed", names), "fixed", robot.flange, last, "flange")
    return _document(root, remarks)


def fill_inertial(inertial: ET.Element, mass: float, centre: Array, inertia: Array) -> None:
    """Put what `bodies` found of a link into its empty element `inertial`."""
    ET.SubElement(inertial, "origin", xyz=numbers(*centre), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=numbers(mass))
    six = {name: numbers(value) for name, value in zip(_SIX, inertia, strict=True)}
    ET.SubElement(inertial, "inertia", six)


def _urdf_joint(
    root: ET.Element, name: str, kind: str, placement: Array, parent: str, child: str
) -> ET.Element:
    joint = ET.SubElement(root, "joint", name=name, type=kind)
    angles = roll_pitch_yaw(placement[:3, :3])
    ET.SubElement(joint, "origin", xyz=numbers(*placement[:3, 3]), rpy=numbers(*angles))
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    return joint


def _joint(root: ET.Element, model: ExportModel, i: int, name: str) -> None:
    robot, limits = model.robot, model.robot.limits
    parent, kind = f"link_{i}" if i else "base_link", robot.joint_types[i]
    joint = _urdf_joint(root, name, kind, robot.placements[i], parent, f"link_{i + 1}")
    ET.SubElement(joint, "axis", xyz=numbers(*robot.axes[i]))
    wide = _PRISMATIC if robot.prismatic[i] else _REVOLUTE
    known = {
        "lower": (limits.lower[i], -wide),
        "upper": (limits.upper[i], wide),
        "effort": (limits.torque[i], _EFFORT),
        "velocity": (limits.velocity[i], _SPEED),
    }
    shown = {k: numbers(x if np.isfinite(x) else instead) for k, (x, instead) in known.items()}
    ET.SubElement(joint, "limit", shown)
    damping, friction = numbers(model.terms["Fv"][i]), numbers(model.terms["Fc"][i])
    ET.SubElement(joint, "dynamics", damping=damping, friction=friction)


MJCF_HELD = ("Fc", "Fv", "Im")
"""Terms beside the inertias that MJCF has a place for."""


def mjcf_text(model: ExportModel, note: str = "") -> str:
    """The file's text: one body a link in its joint frame, gravity as mounted, the note on top.

    Raises:
        JobError: Links that are not physically consistent, negative friction or motor inertias.
    """
    if not model.physical:
        raise JobError(
            f"not physically consistent: {model.worst}; MuJoCo refuses such a model",
            next_step=ADVICE,
        )
    refuse_negative_friction(model)
    robot = model.robot
    missing = left_out(model, MJCF_HELD)
    remarks = [note]
    if missing:
        remarks.append(f"Identified, but without a place in MJCF: {', '.join(missing)}.")
    root = ET.Element("mujoco", model=printable(robot.name, None))
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    ET.SubElement(root, "option", gravity=numbers(*robot.gravity))
    parent, names = ET.SubElement(root, "worldbody"), joint_names(robot)
    for i, (mass, centre, inertia) in enumerate(bodies(model)):
        place = {"name": f"link_{i + 1}", **_place(robot.placements[i])}
        parent = ET.SubElement(parent, "body", place)
        ET.SubElement(
            parent,
            "inertial",
            pos=numbers(*centre),
            mass=numbers(mass),
            fullinertia=numbers(*inertia),
        )
        joint = ET.SubElement(
            parent,
            "joint",
            name=names[i],
            type="slide" if robot.prismatic[i] else "hinge",
            axis=numbers(*robot.axes[i]),
            armature=numbers(model.terms["Im"][i]),
            damping=numbers(model.terms["Fv"][i]),
            frictionloss=numbers(model.terms["Fc"][i]),
        )
        bounds = (robot.limits.lower[i], robot.limits.upper[i])
        if np.isfinite(bounds).all() and bounds[0] < bounds[1]:
            joint.set("range", numbers(*bounds))
    ET.SubElement(parent, "site", {"name": "flange", **_place(robot.flange)})
    return _document(root, remarks)


def _place(pose: Array) -> dict[str, str]:
    return {"pos": numbers(*pose[:3, 3]), "quat": numbers(*quaternion(pose[:3, :3]))}


_OTHER_SCHEMES = ("://", ":\\")


def own_urdf_text(file: Path, output: Path, model: ExportModel, note: str) -> str:
    """The text of a robot's URDF with the model's inertias, damping and dry friction.

    Args:
        file: The URDF; meshes named relative to it are named relative to `output`.
        output: The file to be written.
        model: What to write.
        note: Lines of the comment on top.

    Raises:
        RobotError: The URDF cannot be read, is not sound, or of an arm with other joints or
            lengths.
        JobError: A link without mass, or negative friction, which loaders refuse.
    """
    refuse_negative_friction(model)
    links = urdf_links(model.robot, file)
    kept, rest = _kept(links, model.inertials)
    found = bodies(replace(model, inertials=rest))
    # Only now, that it is known to be sound, once more with its comments.
    builder = _CommentBuilder()
    root = parse_xml(file.read_bytes().lstrip(), builder)
    elements = {_name(element): element for element in _children(root, "link")}
    moved = {_name(element): element for element in _children(root, "joint")}
    ends = [next(_children(moved[name], "child")) for name in model.robot.joint_names]
    children = [(end.get("link") or "").strip() for end in ends]
    for link in links:
        element = elements[link.name]
        if link.name in children:
            _set_inertial(element, *found[children.index(link.name)])
        elif link.joint and link.name not in kept and _has_body(element):
            # Not left out: MuJoCo makes up the mass of such a link from its geometry.
            _set_inertial(element, 0.0, np.zeros(3), np.zeros(6))
    for k, name in enumerate(model.robot.joint_names):
        damping, friction = numbers(model.terms["Fv"][k]), numbers(model.terms["Fc"][k])
        _part(moved[name], "dynamics").attrib.update(damping=damping, friction=friction)
    for tag in ("mesh", "texture"):
        for element in root.iter(tag):
            name = (element.get("filename") or "").strip()
            if name and not os.path.isabs(name) and not any(s in name for s in _OTHER_SCHEMES):
                # Of true folders: `..` behind a link leads elsewhere.
                there = os.path.relpath(file.parent.resolve() / name, output.parent.resolve())
                element.set("filename", Path(there).as_posix())
    remarks = [f"A copy of {file.name} with identified inertias, damping and friction."]
    remarks.append(f"Gravity in the frame of its root: {numbers(*model.robot.gravity)} m/s^2.")
    # As most writers of URDF close an element, so that the two files compare line by line.
    text = ET.tostring(root, encoding="unicode").replace('" />', '"/>')
    return "\n".join(
        [HEAD, comment([*remarks, *urdf_remarks(model, note)]), *builder.above, text, ""]
    )


class _CommentBuilder(ET.TreeBuilder):
    """A tree builder that keeps comments, those above the outer element apart."""

    def __init__(self) -> None:
        super().__init__(insert_comments=True)
        self.above: list[str] = []
        self._begun = False

    def start(self, tag: str, attrs: dict[str, str], /) -> ET.Element:  # pyright: ignore[reportIncompatibleMethodOverride]
        self._begun = True
        return super().start(tag, attrs)

    def comment(self, text: str | None, /) -> ET.Element:
        if not self._begun:
            self.above.append(f"<!--{text}-->")
        return super().comment(text)


def _kept(links: Sequence[UrdfLink], inertials: Array) -> tuple[set[str], Array]:
    """Links that keep their inertia, and (n, 10) what is left for those that joints move."""
    kept: set[str] = set()
    rest = np.array(inertials)
    for k in range(len(rest)):
        own = [link for link in links if link.joint == k + 1 and link.hinged]
        weights = [link for link in own if link.inertia is not None]
        left = rest[k] - sum(
            (move(link.inertia, link.frame) for link in weights if link.inertia is not None),
            np.zeros(10),
        )
        if is_physical(left) or (not is_physical(rest[k]) and left[0] > 0.0):
            kept |= {link.name for link in own}
            rest[k] = left
    return kept, rest


def _children(root: ET.Element, tag: str) -> Iterator[ET.Element]:
    """Elements by name, whatever their prefix."""
    return (item for item in root if str(item.tag).rpartition(":")[2] == tag)


def _part(element: ET.Element, tag: str) -> ET.Element:
    """The first element of a name within another; made as its first one if there is none."""
    found = next(_children(element, tag), None)
    if found is None:
        found = ET.Element(tag)
        found.tail = element.text
        element.insert(0, found)
    return found


def _name(element: ET.Element) -> str:
    return (element.get("name") or "").strip()


def _has_body(link: ET.Element) -> bool:
    return any(True for tag in ("inertial", "collision", "visual") for _ in _children(link, tag))


def _set_inertial(link: ET.Element, mass: float, centre: Array, inertia: Array) -> None:
    inertial = _part(link, "inertial")
    for old in list(inertial):
        inertial.remove(old)
    inertial.text = None
    fill_inertial(inertial, mass, centre, inertia)
    if link.text and not link.text.strip():
        # As deep as the link's own indentation.
        ET.indent(inertial, level=0)
        _shift(inertial, link.text.rpartition("\n")[2])


def _shift(element: ET.Element, margin: str) -> None:
    """Indent what stands within an element by a margin more."""
    element.text = f"{element.text}{margin}"
    for item in element:
        item.tail = f"{item.tail}{margin}"
