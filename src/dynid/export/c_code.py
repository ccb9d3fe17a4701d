"""Inverse dynamics as one C header: C99, no allocation, nothing but math.h."""

from __future__ import annotations

import re
from collections.abc import Iterator

from dynid.export.c_friction import c_friction, friction_call, still_friction_call
from dynid.export.c_observer import OBSERVER
from dynid.export.c_template import BODY, FRICTION, RIGID
from dynid.export.c_text import number, safe, spread, table, vector, weighted_sum
from dynid.export.chain import joint_turns
from dynid.export.friction_words import friction_words
from dynid.export.model import ExportModel


def c_code(model: ExportModel, comment: str = "") -> str:
    """The header's text.

    Args:
        model: The model.
        comment: Where it comes from, for the file's head.
    """
    lines = [
        f"/* Dynamics of {safe(model.robot.name)}, {model.joints} joints, as identified by dynid.",
        *(f"   {safe(line)}" for line in comment.splitlines()),
        "   C99; no allocation, no hidden state; SI units (rad, m, s, N.m, N, kg). Joints:",
        f"   {', '.join(safe(name) for name in model.robot.joint_names)}.",
        "   To call: @_inverse_dynamics, @_mass_matrix, @_coriolis, @_gravity, @_friction,",
        "   @_momentum, @_observer_step; all else serves these. Torques are on the joints' side.",
        "   Link with -lm. dynid claims no rights in this file.",
        *_interface(model),
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
        *c_friction(model),
        BODY.replace(FRICTION, friction_call(model)),
        OBSERVER.replace(FRICTION, still_friction_call(model)),
        "#endif",
        "",
    ]
    prefix = c_prefix(model.robot.name)
    return "\n".join(lines).replace("@", prefix).replace("$", prefix.upper())


def c_prefix(name: str) -> str:
    """What every name of the header starts with: the robot's name as a C identifier."""
    text = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
    return text if text and text[0].isalpha() else f"robot_{text}".rstrip("_")


def _interface(model: ExportModel) -> Iterator[str]:
    if model.speed_alone:
        yield "   inverse_dynamics(q, dq, ddq) = mass_matrix(q) ddq + coriolis(q, dq) + gravity(q)"
        yield "   + friction(dq). */"
        return
    yield "   inverse_dynamics(q, dq, ddq) = mass_matrix(q) ddq + coriolis(q, dq) + gravity(q)"
    yield "   + friction(q, dq, ddq). Friction is more than one of speed here:"
    yield from (f"   {line}" for line in friction_words(model))
    yield "   To solve for ddq, give friction the last ddq, or zeros. */"


def _constants(model: ExportModel) -> Iterator[str]:
    robot, turns = model.robot, joint_turns(model.robot)
    n = model.joints
    slides = ", ".join(str(int(x)) for x in robot.prismatic)
    yield f"static const int @_prismatic[$_JOINTS] = {{{slides}}};"
    yield "/* Gravity in the frame of the base [m/s^2]. */"
    yield vector("@_gravity_vector[3]", robot.gravity)
    yield "/* Frame i in the one before: rotation fixed + sine sin(q) + cosine cos(q), row by row;"
    yield "   origin [m] + slide q; the axis it turns about or slides along. */"
    for name, value in (
        ("fixed", turns.fixed.reshape(n, 9)),
        ("sine", turns.sine.reshape(n, 9)),
        ("cosine", turns.cosine.reshape(n, 9)),
        ("origin", turns.origin),
        ("slide", turns.slide),
        ("axis", robot.axes),
    ):
        yield table(f"@_{name}", value)
    yield "/* m, mx, my, mz, Jxx, Jyy, Jzz, Jyz, Jxz, Jxy about the joint frame. */"
    yield table("@_inertials", model.inertials)


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
        yield f"        const double push = {number(inertia)} * ({weighted_sum(share, 'ddq')});"
        yield from spread(share, "push")
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
