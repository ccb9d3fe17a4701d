"""MJCF: inertias, armature, damping and dry friction of an identified arm."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dynid.core import JobError
from dynid.export.model import ExportModel
from dynid.export.robot_xml import (
    ADVICE,
    CentredBody,
    attribute,
    bodies,
    comment,
    left_out,
    numbers,
    quaternion,
    refuse_negative_friction,
)

HELD = ("Fc", "Fv", "Im")
"""Terms beside the inertias that MJCF has a place for."""


def mjcf_text(model: ExportModel, note: str = "") -> str:
    """The file's text: one body a link in its joint frame, gravity as mounted.

    Args:
        model: The model.
        note: Where it comes from, for the file's head.

    Raises:
        JobError: Bodies, friction or motor inertias that cannot exist, which MuJoCo refuses.
    """
    if not model.physical:
        raise JobError(
            f"not physical: {model.worst} cannot exist, and MuJoCo refuses it",
            next_step=ADVICE,
        )
    refuse_negative_friction(model)
    robot = model.robot
    missing = left_out(model, HELD)
    remarks = [note]
    if missing:
        remarks.append(f"Identified, but without a place in MJCF: {', '.join(missing)}.")
    lines = [
        *comment("\n".join(remarks)),
        f"<mujoco model={attribute(robot.name)}>",
        '  <compiler angle="radian" autolimits="true"/>',
        f'  <option gravity="{numbers(robot.gravity)}"/>',
        "  <worldbody>",
    ]
    for i, body in enumerate(bodies(model)):
        lines += [f"    {'  ' * i}{line}" for line in _body(model, i, body)]
    indent = "    " + "  " * model.joints
    flange = robot.flange
    place = f'pos="{numbers(flange[:3, 3])}" quat="{numbers(quaternion(flange[:3, :3]))}"'
    lines.append(f'{indent}<site name="flange" {place}/>')
    lines += [f"    {'  ' * i}</body>" for i in reversed(range(model.joints))]
    return "\n".join([*lines, "  </worldbody>", "</mujoco>", ""])


def _body(model: ExportModel, i: int, body: CentredBody) -> Iterator[str]:
    robot, j = model.robot, body.central
    placement, limits = robot.placements[i], robot.limits
    yield (
        f'<body name="link_{i + 1}" pos="{numbers(placement[:3, 3])}" '
        f'quat="{numbers(quaternion(placement[:3, :3]))}">'
    )
    six = (j[0, 0], j[1, 1], j[2, 2], j[0, 1], j[0, 2], j[1, 2])
    yield (
        f'  <inertial pos="{numbers(body.centre)}" mass="{numbers([body.mass])}" '
        f'fullinertia="{numbers(six)}"/>'
    )
    bounds = (limits.lower[i], limits.upper[i])
    known = bool(np.isfinite(bounds).all()) and bounds[0] < bounds[1]
    span = f' range="{numbers(bounds)}"' if known else ""
    yield (
        f"  <joint name={attribute(robot.joint_names[i])} "
        f'type="{"slide" if robot.prismatic[i] else "hinge"}" '
        f'axis="{numbers(robot.axes[i])}"{span} '
        f'armature="{numbers([model.terms["Im"][i]])}" '
        f'damping="{numbers([model.terms["Fv"][i]])}" '
        f'frictionloss="{numbers([model.terms["Fc"][i]])}"/>'
    )
