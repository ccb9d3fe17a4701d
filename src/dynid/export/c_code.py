"""Inverse dynamics as one C header: C99, no allocation, nothing but math.h."""

import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from dynid.core import Array
from dynid.export.c_template import BODY, LOAD, RIPPLE, SHAPED, SPEED
from dynid.export.constants import arrays, counterbalances, friction_words, ripple_waves
from dynid.export.model import ExportModel


def number(value: float) -> str:
    """A double constant that reads back exactly."""
    text = repr(float(value))
    return text if any(mark in text for mark in ".e") else f"{text}.0"


def literal(value: int | float | Sequence[Any]) -> str:
    """Numbers, rows and tables as C writes them."""
    if isinstance(value, Sequence):
        return f"{{{', '.join(map(literal, value))}}}"
    return number(value) if isinstance(value, float) else str(value)


def _declared(comment: str, name: str, values: Array) -> Iterator[str]:
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


def safe(text: str) -> str:
    """Text that cannot end a comment or be taken for one of our marks."""
    clean = "".join(c if c.isascii() and c.isprintable() and c not in "@$\\" else "?" for c in text)
    return clean.replace("*/", "* /").replace("/*", "/ *")


def c_prefix(name: str) -> str:
    """What every name of the header starts with: the robot's name as a C identifier."""
    text = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
    return text if text and text[0].isalpha() else f"robot_{text}".rstrip("_")


def c_code(model: ExportModel, comment: str = "") -> str:
    """The header's text; `comment` says where the model comes from."""
    words = "\n".join(f"   {line}" for line in friction_words(model))
    springs = counterbalances(model)
    lines = [
        f"/* Dynamics of {safe(model.robot.name)}, {model.joints} joints, as identified by dynid.",
        *(f"   {safe(line)}" for line in comment.splitlines()),
        "   C99; no allocation, no hidden state; SI units (rad, m, s, N.m, N, kg). Joints:",
        f"   {', '.join(safe(name) for name in model.robot.joint_names)}.",
        "   To call: @_inverse_dynamics, @_mass_matrix, @_coriolis, @_gravity, @_friction,",
        "   @_momentum, @_observer_step; all else serves these. Torques are on the joints' side.",
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
        *(line for one in arrays(model) for line in _declared(*one)),
        "static const struct {",
        "    int joint;",
        "    double outer, inner, rest_length, offset, piston_area, gas_work, gas_volume;",
        # C has no empty tables, and C++ wants every number.
        f"}} @_counterbalances[] = {literal(springs or [(0, *[0.0] * 7)])};",
        *_functions(model, words),
        "#endif",
        "",
    ]
    prefix = c_prefix(model.robot.name)
    return "\n".join(lines).replace("@", prefix).replace("$", prefix.upper())


def _functions(model: ExportModel, words: str) -> Iterator[str]:
    rigid, rest = BODY.split("<friction>\n")
    yield rigid
    if model.speed_alone:
        yield SPEED.replace("speed_friction", "friction")
        yield rest.replace("<state>", "dq").replace("<still>", "dq").replace("<note>", "")
        return
    yield SPEED
    calls: list[str] = []
    if model.terms["Fl"].any():
        yield LOAD
        calls.append("    @_add_load_friction(q, dq, ddq, torque);")
    if waves := ripple_waves(model):
        powers = max(gear.powers for ripple in model.ripples for gear in ripple.gears)
        yield "static const struct {"
        yield "    int joint, gear;"
        yield f"    double number, speed, cosine[{powers}], sine[{powers}];"
        yield f"}} @_waves[] = {literal(waves)};"
        yield RIPPLE.replace("<waves>", str(len(waves))).replace("<powers>", str(powers))
        calls.append("    @_add_ripple(q, dq, torque);")
    yield SHAPED.replace("<words>", words).replace("<calls>", "\n".join(calls))
    note = (
        "    /* No acceleration is known here: the load is that of gravity and speed. */\n"
        "    static const double still[$_JOINTS] = {0.0};\n"
    )
    rest = rest.replace("<state>", "q, dq, ddq").replace("<still>", "q, dq, still")
    yield rest.replace("<note>", note)
