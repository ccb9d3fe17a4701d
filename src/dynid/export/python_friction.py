"""Friction in the generated Python file: of speed, of load, and ripple of gears."""

from __future__ import annotations

from dynid.export.model import ExportModel

_OF_SPEED = '''
def <name>(dq):
    """Friction torques [N.m, N], shape (..., n), for speeds dq of shape (..., n)."""
    dq = np.asarray(dq, dtype=float)
    step = _step(dq, WIDTH)
    torque = FC * step + FV * dq + FO + FCA * np.abs(step) + FVA * np.abs(dq)
    torque = torque + FS * np.exp(-np.square(dq / STRIBECK_VELOCITY)) * step + FR * np.cbrt(dq)
    speed = dq @ SHARES.T
    return torque + (FCM * _step(speed, MOTOR_WIDTH) + FVM * speed) @ SHARES

'''
_ALL = '''
def friction(q, dq, ddq):
    """Friction torques [N.m, N], shape (..., n), all of them, for q, dq, ddq of shape (..., n).

<words>
    Where no acceleration is known, give zeros for ddq.
    """
    return <parts>

'''
_OF_LOAD = '''
def load_friction(q, dq, ddq):
    """Friction that grows with the load of a gear [N.m, N], shape (..., n)."""
    load = rigid_body(q, dq, ddq, bodies=LOAD) + known_torque(q)
    return FL * np.abs(load) * _step(np.asarray(dq, dtype=float), WIDTH)

'''
_RIPPLE = '''
def ripple(q, dq):
    """Torque ripple of gears [N.m, N], shape (..., n): waves in a position, sized by the speed.

    Their size depends on the speed's share of the fastest that was identified; beyond it they
    stay as they are.
    """
    q, dq = (np.asarray(x, dtype=float) for x in (q, dq))
    torque = np.zeros(np.broadcast_shapes(q.shape, dq.shape))
    for joint, gear, number, speed, cosine, sine in WAVES:
        share = np.clip(dq[..., gear] / speed, -1.0, 1.0)
        angle = number * q[..., gear]
        torque[..., joint] += _polynomial(cosine, share) * np.cos(angle)
        torque[..., joint] += _polynomial(sine, share) * np.sin(angle)
    return torque


def _polynomial(coefficients, x):
    return sum(c * x**k for k, c in enumerate(coefficients))

'''


def python_friction(model: ExportModel, words: list[str]) -> str:
    """The functions; `words` say what friction depends on beside speed."""
    if model.speed_alone:
        return _OF_SPEED.replace("<name>", "friction")
    parts, texts = ["speed_friction(dq)"], [_OF_SPEED.replace("<name>", "speed_friction")]
    if model.terms["Fl"].any():
        parts.append("load_friction(q, dq, ddq)")
        texts.append(_OF_LOAD)
    if model.terms["Fw"].any():
        parts.append("ripple(q, dq)")
        texts.append(_RIPPLE)
    known = _ALL.replace("<words>", "\n".join(f"    {line}" for line in words))
    return "".join([known.replace("<parts>", " + ".join(parts)), *texts])


def friction_arguments(model: ExportModel) -> tuple[str, str, str]:
    """What `friction` is called with, with what where no acceleration is known, and a comment."""
    if model.speed_alone:
        return "dq", "dq", ""
    why = "# No acceleration is known here: the load of a gear is that of gravity and speed."
    return "q, dq, ddq", "q, dq, np.zeros(JOINTS)", f"        {why}\n"
