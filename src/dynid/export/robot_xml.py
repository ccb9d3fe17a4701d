"""URDF and MJCF: inertias, armature, damping and dry friction of an identified arm."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from dynid.core import Array, JobError, printable
from dynid.export.model import ExportModel, NearestFriction
from dynid.robot import tensor


def roll_pitch_yaw(rotation: Array) -> tuple[float, float, float]:
    """Angles about the fixed axes x, y, z, in that order [rad], as URDF has them.

    Args:
        rotation: (3, 3) rotation.
    """
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
    # The eigenvector of Bar-Itzhack's symmetric matrix: no case is badly conditioned.
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    matrix = np.array(
        [
            [a + e + i, h - f, c - g, d - b],
            [h - f, a - e - i, b + d, c + g],
            [c - g, b + d, e - a - i, f + h],
            [d - b, c + g, f + h, i - a - e],
        ]
    )
    largest: Array = np.linalg.eigh(matrix)[1][:, -1]
    return np.copysign(1.0, largest[0]) * largest


def upright(gravity: Array) -> Array:
    """(3, 3) the rotation that takes a gravity vector (3) to straight down, -z."""
    size = float(np.linalg.norm(gravity))
    if size == 0.0:
        return np.eye(3)
    z = -gravity / size
    if z[2] > 1.0 - 1e-15:
        return np.eye(3)
    helper = np.eye(3)[0] if abs(z[0]) < 0.9 else np.eye(3)[1]
    across = helper - (helper @ z) * z
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


@dataclass(frozen=True, slots=True, kw_only=True)
class CentredBody:
    """A link by its centre of mass."""

    mass: float
    """[kg]"""
    centre: Array
    """(3) in the joint frame [m]."""
    central: Array
    """(3, 3) tensor about the centre of mass, along the joint frame [kg.m^2]."""


def bodies(model: ExportModel) -> list[CentredBody]:
    """The links, base to tip.

    Raises:
        JobError: A link whose mass is not positive, which has no centre of mass that loaders
            take.
    """
    found: list[CentredBody] = []
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
        found.append(CentredBody(mass=mass, centre=centre, central=tensor(row) - steiner))
    return found


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
    springs = ["torques of counterbalances"] if model.springs else []
    return tuple(dict.fromkeys([*gone, *springs]))


def stand_in_words(friction: NearestFriction | None) -> list[str]:
    """Lines of a comment where the friction of a file is not the identified one."""
    if friction is None or not friction.stands_in:
        return []
    left = " ".join(f"{value:.3g}" for value in friction.missing)
    return [
        "Damping and dry friction: the two that are nearest to all friction that was identified,",
        f"over the recorded range. RMS of what they leave, by joint: {left} N.m (N).",
    ]


def numbers(values: Iterable[float]) -> str:
    """Numbers that read back exactly, with blanks between them."""
    return " ".join(repr(float(value) + 0.0) for value in values)


def attribute(text: str) -> str:
    """A quoted attribute value."""
    return quoteattr(printable(text, None))


def comment(text: str) -> list[str]:
    """Lines of an XML comment."""
    lines = [escape(printable(line, None)).replace("--", "- -") for line in text.splitlines()]
    return ["<!--", *(f"  {line}" for line in lines), "-->"] if lines else []


URDF_HELD = ("Fc", "Fv")
"""Terms beside the inertias that URDF has a place for."""
_REVOLUTE = 2.0 * np.pi
_PRISMATIC = 10.0
_EFFORT = 1e4
_SPEED = 1e2


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
    parts = bodies(model)
    remarks = [note, f"Gravity: {numbers([float(np.linalg.norm(robot.gravity))])} m/s^2."]
    missing = left_out(model, URDF_HELD)
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


MJCF_HELD = ("Fc", "Fv", "Im")
"""Terms beside the inertias that MJCF has a place for."""


def mjcf_text(model: ExportModel, note: str = "") -> str:
    """The file's text: one body a link in its joint frame, gravity as mounted, the note on top.

    Raises:
        JobError: Bodies, friction or motor inertias that cannot exist, which MuJoCo refuses.
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
