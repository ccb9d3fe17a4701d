"""What generated code computes with: the numbers of a model by name, and words on its friction."""

from collections.abc import Iterator
from dataclasses import astuple
from textwrap import wrap

import numpy as np

from dynid.core import Array
from dynid.export.model import JOINT_SYMBOLS, MOTOR_SYMBOLS, ExportModel
from dynid.robot import RobotModel

_WIDTH = 88
Row = tuple[int | float | tuple[float, ...], ...]


def arrays(model: ExportModel) -> Iterator[tuple[str, str, Array]]:
    """Comment (or none), name and value of each array."""
    robot, motors = model.robot, list(model.motors)
    yield "1 where a joint slides", "prismatic", np.array(robot.prismatic)
    yield "gravity in the frame of the base [m/s^2]", "gravity_vector", robot.gravity
    said = "frame i in the one before: rotation fixed + sine sin(q) + cosine cos(q), row by row"
    for name, value in zip(("fixed", "sine", "cosine"), _turns(robot), strict=True):
        yield said, name, value
        said = ""
    slide = [
        placement[:3, :3] @ axis * slides
        for placement, axis, slides in zip(
            robot.placements, robot.axes, robot.prismatic, strict=True
        )
    ]
    yield "its place: origin [m] + slide q", "origin", robot.placements[:, :3, 3]
    yield "", "slide", np.array(slide)
    yield "what a joint turns about or slides along", "axis", robot.axes
    about = "m, mx, my, mz, Jxx, Jyy, Jzz, Jyz, Jxz, Jxy about the joint frame"
    yield about, "inertials", model.inertials
    yield "of the Coulomb step tanh(dq / width), 0 for the sign", "width", model.width
    yield "", "stribeck_velocity", np.array(model.stribeck_velocity)
    for symbol in JOINT_SYMBOLS:
        yield "", symbol.lower(), model.terms[symbol]
    for symbol in MOTOR_SYMBOLS:
        yield "", symbol.lower(), model.terms[symbol][motors]
    yield "turns of each coupled motor per turn of the joints", "shares", model.shares
    yield "", "motor_width", model.width[motors]
    if model.load is not None and model.terms["Fl"].any():
        said = "what the load of a gear is the torque of: need not be physically consistent"
        yield said, "load", model.load
        yield "", "fl", model.terms["Fl"]


def _turns(robot: RobotModel) -> tuple[Array, Array, Array]:
    """(n, 3, 3) each: Rodrigues' formula with the placements multiplied in."""
    fixed, sine, cosine = (np.zeros((robot.joints, 3, 3)) for _ in range(3))
    for i, (placement, axis) in enumerate(zip(robot.placements, robot.axes, strict=True)):
        rotation = placement[:3, :3]
        if robot.prismatic[i]:
            fixed[i] = rotation
            continue
        x, y, z = axis
        along = np.outer(axis, axis)
        fixed[i] = rotation @ along
        sine[i] = rotation @ np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        cosine[i] = rotation @ (np.eye(3) - along)
    return fixed, sine, cosine


COUNTERBALANCE = "joint, outer, inner, rest_length, offset, piston_area, gas_work, gas_volume"
"""The columns of `counterbalances`."""


def counterbalances(model: ExportModel) -> list[Row]:
    """Joint from 0, then SI numbers, as `COUNTERBALANCE` names them."""
    return [
        tuple(x if isinstance(x, int) else float(x) for x in astuple(spring))
        for spring in model.springs
    ]


WAVE = "joint, whose position, waves a turn, speed, polynomials of cosine and sine"
"""The columns of `ripple_waves`."""


def ripple_waves(model: ExportModel) -> list[Row]:
    """Waves C(s) cos(waves q) + S(s) sin(waves q), s = clip(dq / speed, -1, 1), as `WAVE` says.

    Joints from 0; C and S have their coefficients by the power of s, `Fw` included [N.m or N].
    """
    found: list[Row] = []
    for ripple in model.ripples:
        factor = float(model.terms["Fw"][ripple.joint])
        if not factor:
            continue
        left = factor * np.array(ripple.coefficients)
        for gear in ripple.gears:
            own, left = left[: gear.size], left[gear.size :]
            pairs = own.reshape(len(gear.waves), gear.powers, 2).tolist()
            for number, rows in zip(gear.waves, pairs, strict=True):
                cosine, sine = (tuple(row[k] for row in rows) for k in (0, 1))
                found.append((ripple.joint, gear.joint, number, gear.speed, cosine, sine))
    return found


def friction_words(model: ExportModel) -> list[str]:
    """Lines of a comment; none where friction depends on speed alone."""
    lines: list[str] = []
    if model.terms["Fl"].any():
        lines += wrap(
            f"Friction that grows with load, joints {_joints(model, 'Fl')}: a share of |load| "
            "times the Coulomb step. The load is the torque (recursive Newton-Euler, less that "
            "of counterbalances) of bodies with fixed numbers, so it needs q, dq and ddq.",
            _WIDTH,
        )
    if model.terms["Fw"].any():
        lines += wrap(
            f"Torque ripple of gears, joints {_joints(model, 'Fw')}: waves in the positions of "
            "joints whose size changes with their speeds; it needs q and dq.",
            _WIDTH,
        )
    return lines


def _joints(model: ExportModel, symbol: str) -> str:
    return ", ".join(str(j + 1) for j in np.flatnonzero(model.terms[symbol]).tolist())
