"""Inverse dynamics as code: a C99 header, and a Python file that needs nothing but NumPy.

Their functions are the same for every robot and stand in `assets`; here are the numbers of a model
by name, the words on its friction, and how both become a file.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import astuple
from functools import cache
from importlib.resources import files
from textwrap import wrap
from typing import Any

import numpy as np

from dynid.core import Array
from dynid.export.model import JOINT_SYMBOLS, MOTOR_SYMBOLS, ExportModel
from dynid.robot import joint_turns

_WIDTH = 88
Row = tuple[int | float | tuple[float, ...], ...]


def arrays(model: ExportModel) -> Iterator[tuple[str, str, Array]]:
    """Comment (or none), name and value of each array."""
    robot, motors = model.robot, list(model.motors)
    yield "1 where a joint slides", "prismatic", np.array(robot.prismatic)
    yield "gravity in the frame of the base [m/s^2]", "gravity_vector", robot.gravity
    said = "frame i in the one before: rotation fixed + sine sin(q) + cosine cos(q), row by row"
    turns, placed = joint_turns(robot), robot.placements[:, :3, :3]
    for name, part in (("fixed", 0), ("sine", 2), ("cosine", 1)):
        yield said, name, placed @ turns[part] + 0.0
        said = ""
    slide = (placed @ robot.axes[:, :, None])[:, :, 0] * np.array(robot.prismatic)[:, None]
    yield "its place: origin [m] + slide q", "origin", robot.placements[:, :3, 3]
    yield "", "slide", slide
    yield "what a joint turns about or slides along", "axis", robot.axes
    about = "m, mx, my, mz, Jxx, Jyy, Jzz, Jyz, Jxz, Jxy about the joint frame"
    yield about, "inertials", model.inertials
    yield "of the Coulomb step tanh(dq / width), 0 for the sign", "width", model.width
    yield "", "stribeck_velocity", model.stribeck_velocity
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
    if model.presliding is not None:
        both = np.concatenate([model.presliding, model.presliding[motors]])
        said = "over which friction builds up [rad, m], 0 where it does not: joints, coupled motors"
        yield said, "displacement", both


COUNTERBALANCE = "joint, outer, inner, rest_length, offset, piston_area, gas_work, gas_volume"
"""The columns of `counterbalances`."""


def counterbalances(model: ExportModel) -> list[Row]:
    """Joint from 0, then SI numbers, as `COUNTERBALANCE` names them."""
    return [
        tuple(x if isinstance(x, int) else float(x) for x in astuple(spring))
        for spring in model.robot.counterbalances
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


@cache
def _functions_of(name: str) -> dict[str, str]:
    """The sections of one of the `assets`."""
    text = files("dynid.export").joinpath("assets", name).read_text(encoding="utf-8")
    parts = re.split(r"^==== (\w+)\n", text, flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def number(value: float) -> str:
    """A double constant that reads back exactly."""
    text = repr(float(value))
    return text if any(mark in text for mark in ".e") else f"{text}.0"


def literal(value: int | float | Sequence[Any]) -> str:
    """Numbers, rows and tables as C writes them."""
    if isinstance(value, Sequence):
        return f"{{{', '.join(map(literal, value))}}}"
    return number(value) if isinstance(value, float) else str(value)


def _c_array(comment: str, name: str, values: Array) -> Iterator[str]:
    if comment:
        yield f"/* {comment[:1].upper()}{comment[1:]}. */"
    if values.ndim and not len(values):
        # C has no empty tables.
        values = np.zeros((1, *values.shape[1:]))
    if values.ndim > 1:
        values = values.reshape(len(values), -1)
    kind = "int" if values.dtype == bool else "double"
    sizes = "".join(f"[{size}]" for size in values.shape)
    numbers = (values.astype(int) if kind == "int" else values).tolist()
    yield f"static const {kind} @_{name}{sizes} = {literal(numbers)};"


def c_safe(text: str) -> str:
    """Text that cannot end a comment or be taken for one of our marks."""
    clean = "".join(c if c.isascii() and c.isprintable() and c not in "@$\\" else "?" for c in text)
    return clean.replace("*/", "* /").replace("/*", "/ *")


def c_prefix(name: str) -> str:
    """What every name of the header starts with: the robot's name as a C identifier."""
    text = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
    return text if text and text[0].isalpha() else f"robot_{text}".rstrip("_")


_PRESLIDING_IN_C = (
    "   Friction builds up after a reversal: each sample @_presliding_step(&p, q, q_next), then",
    "   @_presliding_inverse_dynamics(&p, q, dq, ddq, torque); all else has friction of sliding.",
)


def c_code(model: ExportModel, comment: str = "") -> str:
    """The header's text; `comment` says where the model comes from."""
    words = "\n".join(f"   {line}" for line in friction_words(model))
    springs, robot = counterbalances(model), model.robot
    lines = [
        f"/* Dynamics of {c_safe(robot.name)}, {model.joints} joints, as identified by dynid.",
        *(f"   {c_safe(line)}" for line in comment.splitlines()),
        "   C99; no allocation, no hidden state; SI units (rad, m, s, N.m, N, kg). Joints:",
        f"   {', '.join(c_safe(name) for name in robot.joint_names)}.",
        "   To call: @_inverse_dynamics, @_mass_matrix, @_coriolis, @_gravity, @_friction,",
        "   @_momentum, @_observer_step; all else serves these. Torques are on the joints' side.",
        *(() if model.presliding is None else _PRESLIDING_IN_C),
        "   Link with -lm. dynid claims no rights in this file.",
        "   inverse_dynamics(q, dq, ddq) = mass_matrix(q) ddq + coriolis(q, dq) + gravity(q)",
        "   + friction(dq). */"
        if model.speed_alone
        else "   + friction(q, dq, ddq). Friction is more than one of speed here:\n"
        f"{words}\n   To solve for ddq, give friction the last ddq, or zeros. */",
        "#ifndef $_DYNAMICS_H",
        "#define $_DYNAMICS_H",
        "",
        "#include <math.h>",
        "",
        f"#define $_JOINTS {model.joints}",
        f"#define $_MOTORS {len(model.motors)}",
        f"#define $_COUNTERBALANCES {len(springs)}",
        "",
        *(line for one in arrays(model) for line in _c_array(*one)),
        "static const struct {",
        "    int joint;",
        "    double outer, inner, rest_length, offset, piston_area, gas_work, gas_volume;",
        # C has no empty tables, and C++ wants every number.
        f"}} @_counterbalances[] = {literal(springs or [(0, *[0.0] * 7)])};",
        *_c_functions(model, words),
        "#endif",
        "",
    ]
    prefix = c_prefix(robot.name)
    return "\n".join(lines).replace("@", prefix).replace("$", prefix.upper())


def _c_functions(model: ExportModel, words: str) -> Iterator[str]:
    part = _functions_of("c_functions.txt")
    rest = part["rest"]
    if model.presliding is not None:
        load = part["presliding_load"] if model.terms["Fl"].any() else ""
        rest += part["presliding"].replace("<load>", load)
    yield part["rigid"]
    if model.speed_alone:
        yield part["speed"].replace("speed_friction", "friction")
        yield rest.replace("<state>", "dq").replace("<still>", "dq").replace("<note>", "")
        return
    yield part["speed"]
    calls: list[str] = []
    if model.terms["Fl"].any():
        yield part["load"]
        calls.append("    @_add_load_friction(q, dq, ddq, torque);")
    if waves := ripple_waves(model):
        powers = max(gear.powers for ripple in model.ripples for gear in ripple.gears)
        yield "static const struct {"
        yield "    int joint, gear;"
        yield f"    double number, speed, cosine[{powers}], sine[{powers}];"
        yield f"}} @_waves[] = {literal(waves)};"
        yield part["ripple"].replace("<waves>", str(len(waves))).replace("<powers>", str(powers))
        calls.append("    @_add_ripple(q, dq, torque);")
    yield part["shaped"].replace("<words>", words).replace("<calls>", "\n".join(calls))
    note = (
        "    /* No acceleration is known here: the load is that of gravity and speed. */\n"
        "    static const double still[$_JOINTS] = {0.0};\n"
    )
    rest = rest.replace("<state>", "q, dq, ddq").replace("<still>", "q, dq, still")
    yield rest.replace("<note>", note)


_PRESLIDING_IN_PYTHON = (
    "Friction builds up after a reversal: each sample state = presliding_step(state, q, q_next),",
    "None at first, then inverse_dynamics(q, dq, ddq, state); all else has friction of sliding.",
)


def python_code(model: ExportModel, comment: str = "") -> str:
    """The file's text: constants, then functions of q, dq, ddq; `comment` says where it is from."""
    words = friction_words(model)
    now, still, why = "dq", "dq", ""
    if not model.speed_alone:
        now, still = "q, dq, ddq", "q, dq, np.zeros(JOINTS)"
        why = "        # No acceleration is known here: the load is that of gravity and speed.\n"
    head = [
        f'"""Dynamics of {_safe(model.robot.name)}, {model.joints} joints, as identified by dynid.',
        "",
        *(_safe(line) for line in comment.splitlines()),
        "",
        "inverse_dynamics(q, dq, ddq) = mass_matrix(q) @ ddq + coriolis(q, dq) + gravity(q)",
        f"+ friction({now})",
        *words,
        *(() if model.presliding is None else _PRESLIDING_IN_PYTHON),
        *([] if model.speed_alone else ["To solve for ddq, give friction the last one, or zeros."]),
        "SI units; torques are on the joints' side. dynid claims no rights in this file.",
        '"""',
        "",
        "import numpy as np",
        "",
    ]
    part = _functions_of("python_functions.txt")
    body = part["body"].replace("<state>", now).replace("<still>", still).replace("<note>", why)
    friction, memory, more = _python_friction(model, words), "", ""
    if model.presliding is not None:
        load = part["presliding_load"] if model.terms["Fl"].any() else ""
        friction += part["presliding"].replace("<load>", load)
        memory, more = ", state=None", " + presliding(state, q, dq, ddq)"
    body = body.replace("<memory>", memory).replace("<more>", more)
    return "\n".join([*head, *_constants(model), "", friction.rstrip(), body])


def _python_friction(model: ExportModel, words: list[str]) -> str:
    """The functions; `words` say what friction depends on beside speed."""
    part = _functions_of("python_functions.txt")
    if model.speed_alone:
        return part["speed"].replace("<name>", "friction")
    calls, texts = ["speed_friction(dq)"], [part["speed"].replace("<name>", "speed_friction")]
    if model.terms["Fl"].any():
        calls.append("load_friction(q, dq, ddq)")
        texts.append(part["load"])
    if model.terms["Fw"].any():
        calls.append("ripple(q, dq)")
        texts.append(part["ripple"])
    known = part["all"].replace("<words>", "\n".join(f"    {line}" for line in words))
    return "".join([known.replace("<parts>", " + ".join(calls)), *texts])


def _constants(model: ExportModel) -> Iterator[str]:
    yield f"JOINT_NAMES = {model.robot.joint_names!r}"
    yield f"JOINTS = {model.joints}"
    for comment, name, value in arrays(model):
        if comment:
            yield f"# {comment}"
        yield f"{name.upper()} = {_array(value)}"
    yield f"# {COUNTERBALANCE}"
    yield f"COUNTERBALANCES = {counterbalances(model)!r}"
    if waves := ripple_waves(model):
        yield f"# {WAVE}"
        yield "WAVES = ["
        yield from (f"    {wave!r}," for wave in waves)
        yield "]"


def _array(values: Array) -> str:
    if values.size == 0:
        return f"np.zeros({values.shape!r})"
    text = np.array2string(
        values,
        separator=", ",
        max_line_width=96,
        threshold=values.size + 1,
        formatter={"float_kind": lambda x: repr(float(x))},
    )
    return f"np.array({text})"


def _safe(text: str) -> str:
    """Text that cannot leave a docstring or a string."""
    return "".join(c if c.isprintable() and c not in '\\"' else "?" for c in text)
