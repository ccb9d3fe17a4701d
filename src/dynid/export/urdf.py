"""URDF: inertias, viscous damping and Coulomb friction of an identified arm."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dynid.export.model import ExportModel
from dynid.export.robot_xml import (
    CentredBody,
    attribute,
    bodies,
    comment,
    left_out,
    numbers,
    refuse_negative_friction,
    roll_pitch_yaw,
    upright,
)

HELD = ("Fc", "Fv")
"""Terms beside the inertias that URDF has a place for."""
_REVOLUTE = 2.0 * np.pi
_PRISMATIC = 10.0
_EFFORT = 1e4
_SPEED = 1e2


def urdf_text(model: ExportModel, note: str = "") -> str:
    """The file's text. The mounting stands as a fixed joint that turns the base under `world`.

    Joint frames, names and signs are the robot's own. URDF has neither motor inertia nor the
    strength of gravity; those, and limits that are not known, stand in the comment.

    Args:
        model: The model.
        note: Where it comes from, for the file's head.

    Raises:
        JobError: A link without mass, or negative friction, which loaders refuse.
    """
    robot = model.robot
    refuse_negative_friction(model)
    parts = bodies(model)
    remarks = [note, f"Gravity: {numbers([float(np.linalg.norm(robot.gravity))])} m/s^2."]
    missing = left_out(model, HELD)
    if missing:
        remarks.append(f"Identified, but without a place in URDF: {', '.join(missing)}.")
    if model.terms["Im"].any():
        remarks.append(f"Motor inertias, joint side, by joint: {numbers(model.terms['Im'])}.")
    if _unknown_limits(model):
        remarks.append("Limits that are not known stand as very large numbers.")
    lines = ['<?xml version="1.0"?>', *comment("\n".join(remarks))]
    lines.append(f"<robot name={attribute(robot.name)}>")
    lines += [f"  {line}" for line in _base(model)]
    for i, body in enumerate(parts):
        lines += [f"  {line}" for line in (*_link(i, body), *_joint(model, i))]
    placed = robot.flange
    lines += [
        '  <link name="flange"/>',
        '  <joint name="flange_fixed" type="fixed">',
        f'    <origin xyz="{numbers(placed[:3, 3])}" rpy="{_rpy(placed)}"/>',
        f'    <parent link="link_{model.joints}"/>',
        '    <child link="flange"/>',
        "  </joint>",
    ]
    return "\n".join([*lines, "</robot>", ""])


def _base(model: ExportModel) -> Iterator[str]:
    turn = np.eye(4)
    turn[:3, :3] = upright(model.robot.gravity)
    yield '<link name="world"/>'
    yield '<link name="base_link"/>'
    yield '<joint name="mounting" type="fixed">'
    yield f'  <origin xyz="0 0 0" rpy="{_rpy(turn)}"/>'
    yield '  <parent link="world"/>'
    yield '  <child link="base_link"/>'
    yield "</joint>"


def _link(i: int, body: CentredBody) -> Iterator[str]:
    j = body.central
    yield f'<link name="link_{i + 1}">'
    yield "  <inertial>"
    yield f'    <origin xyz="{numbers(body.centre)}" rpy="0 0 0"/>'
    yield f'    <mass value="{numbers([body.mass])}"/>'
    yield (
        f'    <inertia ixx="{numbers([j[0, 0]])}" iyy="{numbers([j[1, 1]])}" '
        f'izz="{numbers([j[2, 2]])}" iyz="{numbers([j[1, 2]])}" '
        f'ixz="{numbers([j[0, 2]])}" ixy="{numbers([j[0, 1]])}"/>'
    )
    yield "  </inertial>"
    yield "</link>"


def _joint(model: ExportModel, i: int) -> Iterator[str]:
    robot = model.robot
    placement, limits = robot.placements[i], robot.limits
    wide = _PRISMATIC if robot.prismatic[i] else _REVOLUTE
    lower, upper, effort, velocity = (
        float(value) if np.isfinite(value) else instead
        for value, instead in (
            (limits.lower[i], -wide),
            (limits.upper[i], wide),
            (limits.torque[i], _EFFORT),
            (limits.velocity[i], _SPEED),
        )
    )
    yield f'<joint name={attribute(robot.joint_names[i])} type="{robot.joint_types[i]}">'
    yield f'  <origin xyz="{numbers(placement[:3, 3])}" rpy="{_rpy(placement)}"/>'
    yield f'  <parent link="{f"link_{i}" if i else "base_link"}"/>'
    yield f'  <child link="link_{i + 1}"/>'
    yield f'  <axis xyz="{numbers(robot.axes[i])}"/>'
    yield (
        f'  <limit lower="{numbers([lower])}" upper="{numbers([upper])}" '
        f'effort="{numbers([effort])}" velocity="{numbers([velocity])}"/>'
    )
    yield (
        f'  <dynamics damping="{numbers([model.terms["Fv"][i]])}" '
        f'friction="{numbers([model.terms["Fc"][i]])}"/>'
    )
    yield "</joint>"


def _unknown_limits(model: ExportModel) -> bool:
    limits = model.robot.limits
    return any(
        bool(np.isnan(values).any())
        for values in (limits.lower, limits.upper, limits.velocity, limits.torque)
    )


def _rpy(placement: np.ndarray) -> str:
    return numbers(roll_pitch_yaw(placement[:3, :3]))
