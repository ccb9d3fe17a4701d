"""Inverse dynamics as one C header: C99, no allocation, nothing but math.h."""

import re
from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np

from dynid.core import Array
from dynid.export.c_template import BODY, FRICTION, OBSERVER, RIGID
from dynid.export.model import ExportModel, Wave, friction_words, joint_turns, ripple_waves


def number(value: float) -> str:
    """A double constant that reads back exactly."""
    text = repr(float(value))
    return text if any(mark in text for mark in ".e") else f"{text}.0"


def vector(name: str, values: Sequence[float] | Array) -> str:
    """A constant array; `name` with its length, as C writes it."""
    return f"static const double {name} = {{{', '.join(number(x) for x in values)}}};"


def table(name: str, values: Array) -> str:
    """A constant table (n, k) with a row a joint."""
    rows = ",\n".join(f"    {{{', '.join(number(x) for x in row)}}}" for row in np.asarray(values))
    return f"static const double {name}[$_JOINTS][{values.shape[1]}] = {{\n{rows}}};"


def weighted_sum(share: Array, name: str) -> str:
    """The sum of share[k] name[k]."""
    return " + ".join(f"{number(x)} * {name}[{k}]" for k, x in enumerate(share) if x)


def spread(share: Array, name: str) -> Iterator[str]:
    """Lines that add share[k] times a scalar to torque[k]."""
    for k, x in enumerate(share):
        if x:
            yield f"        torque[{k}] += {number(x)} * {name};"


def safe(text: str) -> str:
    """Text that cannot end a comment or be taken for one of our marks."""
    clean = "".join(c if c.isascii() and c.isprintable() and c not in "@$\\" else "?" for c in text)
    return clean.replace("*/", "* /").replace("/*", "/ *")


_STATE = "const double q[$_JOINTS], const double dq[$_JOINTS]"


def c_friction(model: ExportModel) -> Iterator[str]:
    """The lines of `friction` and of what it is made of."""
    if model.speed_alone:
        yield from _of_speed(model, "friction")
        return
    yield from _of_speed(model, "speed_friction")
    calls: list[str] = []
    if model.terms["Fl"].any():
        yield from _of_load(model)
        calls.append("    @_add_load_friction(q, dq, ddq, torque);")
    if waves := ripple_waves(model):
        yield from _ripple(waves)
        calls.append("    @_add_ripple(q, dq, torque);")
    yield "/* Friction torques [N.m, N], all of them:"
    yield from (f"   {line}" for line in friction_words(model))
    yield "   Where no acceleration is known, give zeros for ddq. */"
    yield f"static inline void @_friction({_STATE},"
    yield "                               const double ddq[$_JOINTS], double torque[$_JOINTS])"
    yield "{"
    yield "    @_speed_friction(dq, torque);"
    yield from calls
    yield "    (void)q;"
    yield "    (void)ddq;"
    yield "}"
    yield ""


def friction_call(model: ExportModel) -> str:
    """A call of `friction` into `rubbing`."""
    return f"@_friction({'dq' if model.speed_alone else 'q, dq, ddq'}, rubbing);"


def still_friction_call(model: ExportModel) -> str:
    """The same where no acceleration is known."""
    if model.speed_alone:
        return friction_call(model)
    return (
        "/* No acceleration is known here: the load of a gear is that of gravity and speed. */\n"
        "    static const double still[$_JOINTS] = {0.0};\n"
        "    @_friction(q, dq, still, rubbing);"
    )


def _of_speed(model: ExportModel, name: str) -> Iterator[str]:
    yield "/* Friction torques [N.m, N] at speeds dq. */"
    yield f"static inline void @_{name}(const double dq[$_JOINTS], double torque[$_JOINTS])"
    yield "{"
    for i in range(model.joints):
        terms = [text for text in _joint_friction(model, i) if text]
        yield f"    torque[{i}] = {' + '.join(terms) if terms else '0.0'};"
    for share, motor in zip(model.shares, model.motors, strict=True):
        coulomb, viscous = model.terms["Fcm"][motor], model.terms["Fvm"][motor]
        yield "    {"
        yield f"        const double speed = {weighted_sum(share, 'dq')};"
        step = _step("speed", float(model.width[motor]))
        yield f"        const double push = {number(coulomb)} * {step} + {number(viscous)} * speed;"
        yield from spread(share, "push")
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


def _of_load(model: ExportModel) -> Iterator[str]:
    if model.load is None:
        return
    yield "/* What the load of a gear is the torque of, in the order of @_inertials. Numbers of a"
    yield "   fit: they need not be physically consistent. */"
    yield table("@_load", model.load)
    yield ""
    yield "/* Adds the friction that grows with the load of a gear. */"
    yield f"static inline void @_add_load_friction({_STATE},"
    yield "                                        const double ddq[$_JOINTS], double *torque)"
    yield "{"
    yield "    double load[$_JOINTS];"
    yield "    @_newton_euler(@_load, q, dq, ddq, @_gravity_vector, load);"
    yield "    @_add_known(q, load);"
    for i, factor in enumerate(model.terms["Fl"]):
        if factor:
            step = _step(f"dq[{i}]", float(model.width[i]))
            yield f"    torque[{i}] += {number(factor)} * fabs(load[{i}]) * {step};"
    yield "}"
    yield ""


def _ripple(waves: Sequence[Wave]) -> Iterator[str]:
    yield "/* Adds the torque ripple of gears: waves in a position, their size by the speed's share"
    yield "   s of the fastest that was identified, beyond which they stay as they are. */"
    yield "static inline void @_add_ripple(const double *q, const double *dq, double *torque)"
    yield "{"
    # A gear that shakes several joints is looked at once.
    for (gear, speed), turning in groupby(sorted(waves, key=_gear), key=_gear):
        yield "    {"
        yield f"        const double share = dq[{gear}] / {number(speed)};"
        yield "        const double s = share > 1.0 ? 1.0 : share < -1.0 ? -1.0 : share;"
        yield "        double c, n;"
        for turns, same in groupby(sorted(turning, key=_number), key=_number):
            yield f"        c = cos({number(turns)} * q[{gear}]);"
            yield f"        n = sin({number(turns)} * q[{gear}]);"
            for wave in same:
                yield f"        torque[{wave.joint}] += ({_polynomial(wave.cosine)}) * c;"
                yield f"        torque[{wave.joint}] += ({_polynomial(wave.sine)}) * n;"
        yield "        (void)s;"
        yield "    }"
    yield "}"
    yield ""


def _gear(wave: Wave) -> tuple[int, float]:
    return wave.gear, wave.speed


def _number(wave: Wave) -> float:
    return wave.number


def _polynomial(coefficients: Sequence[float]) -> str:
    text = number(coefficients[-1])
    for value in reversed(coefficients[:-1]):
        text = f"{number(value)} + s * ({text})"
    return text


def _step(speed: str, width: float) -> str:
    if width > 0:
        return f"tanh({speed} / {number(width)})"
    return f"(double)(({speed} > 0.0) - ({speed} < 0.0))"


def c_code(model: ExportModel, comment: str = "") -> str:
    """The header's text; `comment` says where the model comes from."""
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
