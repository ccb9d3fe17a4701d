"""Friction in the generated C header: of speed, of load, and ripple of gears."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

from dynid.export.c_text import number, spread, table, weighted_sum
from dynid.export.friction_words import friction_words
from dynid.export.model import ExportModel
from dynid.export.waves import Wave, ripple_waves

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
    yield "   fit: they need not be those of bodies that can exist. */"
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
