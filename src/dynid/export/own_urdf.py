"""The URDF that a robot came from, with what was identified in it.

Names, limits, visuals, meshes and everything else stay as they are. The link that a joint moves
holds the inertia of all that moves with it; links fixed to it have none of their own. Links behind
a frozen joint, such as fingers, keep theirs where the rest remains possible.
"""

import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynid.core import Array
from dynid.export.model import ExportModel
from dynid.export.robot_xml import (
    HEAD,
    bodies,
    comment,
    fill_inertial,
    numbers,
    refuse_negative_friction,
    urdf_remarks,
)
from dynid.robot import UrdfLink, is_physical, move, parse_xml, urdf_links

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
    children = [_child(moved[name]) for name in model.robot.joint_names]
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


def _child(joint: ET.Element) -> str:
    return (next(_children(joint, "child")).get("link") or "").strip()


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
