"""Inverse dynamics as one C header: C99, no allocation, nothing but math.h."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np

from dynid.core.arrays import Array
from dynid.export.c_template import BODY, OBSERVER, RIGID
from dynid.export.chain import joint_turns
from dynid.export.model import ExportModel


def c_code(model: ExportModel, comment: str = "") -> str:
    """The header's text.

    Args:
        model: The model.
        comment: Where it comes from, for the file's head.
    """
    lines = [
        f"/* Dynamics of {_safe(model.robot.name)}, {model.joints} joints, as identified by dynid.",
        *(f"   {_safe(line)}" for line in comment.splitlines()),
        "   C99; no allocation, no hidden state; SI units (rad, m, s, N.m, N, kg). Joints:",
        f"   {', '.join(_safe(name) for name in model.robot.joint_names)}. */",
        "#ifndef $_DYNAMICS_H",
        "#define $_DYNAMICS_H",
        "",
        "#include <math.h>",
        "",
        f"#define $_JOINTS {model.joints}",
        "",
        *_constants(model),
        *_motors(model),
        RIGID,
        *_known(model),
        *_friction(model),
        BODY,
        OBSERVER,
        "#endif",
        "",
    ]
    prefix = c_prefix(model.robot.name)
    return "\n".join(lines).replace("@", prefix).replace("$", prefix.upper())


def c_prefix(name: str) -> str:
    """What every name of the header starts with: the robot's name as a C identifier."""
    text = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
    return text if text and text[0].isalpha() else f"robot_{text}".rstrip("_")


def number(value: float) -> str:
    """A double constant that reads back exactly."""
    text = repr(float(value))
    return text if any(mark in text for mark in ".e") else f"{text}.0"


def _constants(model: ExportModel) -> Iterator[str]:
    robot, turns = model.robot, joint_turns(model.robot)
    n = model.joints
    slides = ", ".join(str(int(x)) for x in robot.prismatic)
    yield f"static const int @_prismatic[$_JOINTS] = {{{slides}}};"
    yield _vector("@_gravity_vector[3]", robot.gravity)
    for name, value in (
        ("fixed", turns.fixed.reshape(n, 9)),
        ("sine", turns.sine.reshape(n, 9)),
        ("cosine", turns.cosine.reshape(n, 9)),
        ("origin", turns.origin),
        ("slide", turns.slide),
        ("axis", robot.axes),
    ):
        yield _table(f"@_{name}", value)
    yield "/* m, mx, my, mz, Jxx, Jyy, Jzz, Jyz, Jxz, Jxy about the joint frame. */"
    yield _table("@_inertials", model.inertials)


def _motors(model: ExportModel) -> Iterator[str]:
    yield "/* Adds the torques that turn the motors. */"
    yield "static inline void @_add_motors(const double ddq[$_JOINTS], double *torque)"
    yield "{"
    for i, inertia in enumerate(model.terms["Im"]):
        if inertia:
            yield f"    torque[{i}] += {number(inertia)} * ddq[{i}];"
    for share, motor in zip(model.shares, model.motors, strict=True):
        inertia = model.terms["Imm"][motor]
        yield "    {"
        yield f"        const double push = {number(inertia)} * ({_sum(share, 'ddq')});"
        yield from _spread(share, "push")
        yield "    }"
    yield "    (void)ddq;"
    yield "    (void)torque;"
    yield "}"
    yield ""


def _known(model: ExportModel) -> Iterator[str]:
    yield "/* Adds what counterbalances leave for the motors. */"
    yield "static inline void @_add_known(const double *q, double *torque)"
    yield "{"
    for spring in model.springs:
        outer, inner = spring.outer, spring.inner
        yield "    {"
        yield f"        const double angle = q[{spring.joint}] + {number(spring.offset)};"
        square, product = number(outer**2 + inner**2), number(2 * outer * inner)
        yield f"        const double length = sqrt({square} - {product} * cos(angle));"
        yield f"        const double arm = {number(outer * inner)} * sin(angle) / length;"
        yield (
            f"        const double volume = {number(spring.gas_volume)} - "
            f"(length - {number(spring.rest_length)}) * {number(spring.piston_area)};"
        )
        work = number(spring.gas_work * spring.piston_area)
        yield f"        torque[{spring.joint}] += arm * {work} / volume;"
        yield "    }"
    yield "    (void)q;"
    yield "    (void)torque;"
    yield "}"
    yield ""


def _friction(model: ExportModel) -> Iterator[str]:
    yield "/* Friction torques [N.m, N] at speeds dq. */"
    yield "static inline void @_friction(const double dq[$_JOINTS], double torque[$_JOINTS])"
    yield "{"
    for i in range(model.joints):
        terms = [text for text in _joint_friction(model, i) if text]
        yield f"    torque[{i}] = {' + '.join(terms) if terms else '0.0'};"
    for share, motor in zip(model.shares, model.motors, strict=True):
        coulomb, viscous = model.terms["Fcm"][motor], model.terms["Fvm"][motor]
        yield "    {"
        yield f"        const double speed = {_sum(share, 'dq')};"
        step = _step("speed", float(model.width[motor]))
        yield f"        const double push = {number(coulomb)} * {step} + {number(viscous)} * speed;"
        yield from _spread(share, "push")
        yield "    }"
    yield "    (void)dq;"
    yield "}"
    yield ""


def _joint_friction(model: ExportModel, i: int) -> Iterator[str]:
    terms = {symbol: float(values[i]) for symbol, values in model.terms.items()}
    speed, step = f"dq[{i}]", _step(f"dq[{i}]", float(model.width[i]))
    bell = f"exp(-({speed} * {speed}) / {number(model.stribeck_velocity**2)})"
    for symbol, factor in (
        ("Fc", step),
        ("Fv", speed),
        ("Fca", f"fabs({step})"),
        ("Fva", f"fabs({speed})"),
        ("Fs", f"{bell} * {step}"),
        ("Fr", f"cbrt({speed})"),
    ):
        if terms[symbol]:
            yield f"{number(terms[symbol])} * {factor}"
    if terms["Fo"]:
        yield number(terms["Fo"])


def _step(speed: str, width: float) -> str:
    if width > 0:
        return f"tanh({speed} / {number(width)})"
    return f"(double)(({speed} > 0.0) - ({speed} < 0.0))"


def _sum(share: Array, name: str) -> str:
    return " + ".join(f"{number(x)} * {name}[{k}]" for k, x in enumerate(share) if x)


def _spread(share: Array, name: str) -> Iterator[str]:
    for k, x in enumerate(share):
        if x:
            yield f"        torque[{k}] += {number(x)} * {name};"


def _vector(name: str, values: Sequence[float] | Array) -> str:
    return f"static const double {name} = {{{', '.join(number(x) for x in values)}}};"


def _table(name: str, values: Array) -> str:
    rows = ",\n".join(f"    {{{', '.join(number(x) for x in row)}}}" for row in np.asarray(values))
    return f"static const double {name}[$_JOINTS][{values.shape[1]}] = {{\n{rows}}};"


def _safe(text: str) -> str:
    """Text that cannot end a comment or be taken for one of our marks."""
    clean = "".join(c if c.isascii() and c.isprintable() and c not in "@$\\" else "?" for c in text)
    return clean.replace("*/", "* /").replace("/*", "/ *")
