"""Inverse dynamics as a Python file that needs nothing but NumPy."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import astuple

import numpy as np

from dynid.core.arrays import Array
from dynid.export.chain import joint_turns
from dynid.export.friction_words import friction_words
from dynid.export.model import JOINT_SYMBOLS, MOTOR_SYMBOLS, ExportModel
from dynid.export.python_friction import friction_arguments, python_friction
from dynid.export.python_template import BODY, FRICTION, NOTE, STILL
from dynid.export.waves import ripple_waves


def python_code(model: ExportModel, comment: str = "") -> str:
    """The file's text: constants, then functions of q, dq, ddq.

    Args:
        model: The model.
        comment: Where it comes from, for the file's head.
    """
    words = friction_words(model)
    now, still, why = friction_arguments(model)
    head = [
        f'"""Dynamics of {_safe(model.robot.name)}, {model.joints} joints, as identified by dynid.',
        "",
        *(_safe(line) for line in comment.splitlines()),
        "",
        "inverse_dynamics(q, dq, ddq) = mass_matrix(q) @ ddq + coriolis(q, dq) + gravity(q)",
        f"+ friction({now})",
        *words,
        *([] if model.speed_alone else ["To solve for ddq, give friction the last one, or zeros."]),
        "SI units; torques are on the joints' side. dynid claims no rights in this file.",
        '"""',
        "",
        "import numpy as np",
        "",
    ]
    body = BODY.replace(FRICTION, now).replace(STILL, still).replace(NOTE, why)
    functions = python_friction(model, words)
    return "\n".join([*head, *_constants(model), "", functions.rstrip(), body])


def _constants(model: ExportModel) -> Iterator[str]:
    robot, turns = model.robot, joint_turns(model.robot)
    yield f"JOINT_NAMES = {tuple(_safe(name) for name in robot.joint_names)!r}"
    yield f"JOINTS = {model.joints}"
    yield f"PRISMATIC = {tuple(robot.prismatic)!r}"
    for name, value in (
        ("GRAVITY", robot.gravity),
        ("FIXED", turns.fixed),
        ("SINE", turns.sine),
        ("COSINE", turns.cosine),
        ("ORIGIN", turns.origin),
        ("SLIDE", turns.slide),
        ("AXIS", robot.axes),
        ("INERTIALS", model.inertials),
        ("WIDTH", model.width),
    ):
        yield _array(name, value)
    yield f"STRIBECK_VELOCITY = {model.stribeck_velocity!r}"
    for symbol in (*JOINT_SYMBOLS, *MOTOR_SYMBOLS):
        values = model.terms[symbol]
        chosen = values[list(model.motors)] if symbol in MOTOR_SYMBOLS else values
        yield _array(symbol.upper(), chosen)
    yield _array("SHARES", model.shares)
    yield _array("MOTOR_WIDTH", model.width[list(model.motors)])
    yield "# joint, outer, inner, rest_length, offset, piston_area, gas_work, gas_volume"
    springs = [astuple(spring) for spring in model.springs]
    yield f"COUNTERBALANCES = {[tuple(map(_plain, spring)) for spring in springs]!r}"
    if model.load is not None and model.terms["Fl"].any():
        yield "# What the load of a gear is the torque of: need not be bodies that can exist."
        yield _array("LOAD", model.load)
        yield _array("FL", model.terms["Fl"])
    if waves := ripple_waves(model):
        yield "# joint, whose position, waves a turn, speed, polynomials of cosine and sine"
        yield "WAVES = ["
        for wave in waves:
            one = (wave.joint, wave.gear, wave.number, wave.speed, wave.cosine, wave.sine)
            yield f"    {one!r},"
        yield "]"


def _array(name: str, values: Array) -> str:
    if values.size == 0:
        return f"{name} = np.zeros({values.shape!r})"
    text = np.array2string(
        values,
        separator=", ",
        max_line_width=96,
        threshold=values.size + 1,
        formatter={"float_kind": lambda x: repr(float(x))},
    )
    return f"{name} = np.array({text})"


def _plain(value: float | int) -> float | int:
    return value if isinstance(value, int) else float(value)


def _safe(text: str) -> str:
    """Text that cannot leave a docstring or a string."""
    return "".join(c if c.isprintable() and c not in '\\"' else "?" for c in text)
