"""Inverse dynamics as a Python file that needs nothing but NumPy.

In its functions, the same for every robot, `FRICTION` stands for what friction is called with,
`STILL` for the same without acceleration, which `NOTE` explains.
"""

from collections.abc import Iterator

import numpy as np

from dynid.core import Array
from dynid.export import constants
from dynid.export.model import ExportModel

FRICTION = "<state>"
STILL = "<still>"
NOTE = "<note>"

BODY = '''

def inverse_dynamics(q, dq, ddq):
    """Joint torques [N.m, N], shape (..., n), for q [rad, m], dq, ddq of shape (..., n)."""
    return rigid_body(q, dq, ddq) + motor_torque(ddq) + known_torque(q) + friction(<state>)


def mass_matrix(q):
    """M(q) with the motor inertias [kg.m^2, kg], shape (..., n, n)."""
    q = np.asarray(q, dtype=float)
    columns = []
    for unit in np.eye(JOINTS):
        ddq = np.broadcast_to(unit, q.shape)
        torque = rigid_body(q, np.zeros_like(q), ddq, gravity=np.zeros(3))
        columns.append(torque + motor_torque(ddq))
    return np.stack(columns, axis=-1)


def coriolis(q, dq):
    """Coriolis and centrifugal torques c(q, dq) [N.m, N], shape (..., n)."""
    return rigid_body(q, dq, np.zeros_like(q, dtype=float), gravity=np.zeros(3))


def gravity(q):
    """Torques that hold the arm still without friction, g(q) [N.m, N], shape (..., n)."""
    still = np.zeros_like(q, dtype=float)
    return rigid_body(q, still, still) + known_torque(q)


def motor_torque(ddq):
    """Torques that turn the motors [N.m, N], shape (..., n)."""
    ddq = np.asarray(ddq, dtype=float)
    return IM * ddq + (IMM * (ddq @ SHARES.T)) @ SHARES


def known_torque(q):
    """What counterbalances leave for the motors [N.m], shape (..., n)."""
    q = np.asarray(q, dtype=float)
    torque = np.zeros_like(q)
    for joint, outer, inner, rest, offset, area, work, volume in COUNTERBALANCES:
        angle = q[..., joint] + offset
        length = np.sqrt(outer**2 + inner**2 - 2 * outer * inner * np.cos(angle))
        arm = outer * inner * np.sin(angle) / length
        torque[..., joint] += arm * work / (volume - (length - rest) * area) * area
    return torque


def momentum(q, dq):
    """Generalised momentum p = M dq and the derivative of the kinetic energy by q, (..., n) each.

    Without contact dp/dt = torque - friction - gravity(q) + derivative.
    """
    q, dq = (np.asarray(x, dtype=float) for x in (q, dq))
    zero = np.zeros((*q.shape[:-1], 3))
    turn, drift = zero, zero
    frames, motions, momenta = [], [], []
    for i in range(JOINTS):
        rotation, place = _joint(i, q[..., i])
        speed = dq[..., i, None] * AXIS[i]
        drift = _into(rotation, drift + np.cross(turn, place))
        turn = _into(rotation, turn)
        drift, turn = (drift + speed, turn) if PRISMATIC[i] else (drift, turn + speed)
        frames.append((rotation, place))
        motions.append((turn, drift))
        momenta.append(_wrench(INERTIALS[i], zero, turn, drift))
    own, slope = np.empty(q.shape), np.empty(q.shape)
    linear, angular = zero, zero
    for i in reversed(range(JOINTS)):
        linear, angular = linear + momenta[i][0], angular + momenta[i][1]
        turn, drift = motions[i]
        if PRISMATIC[i]:
            own[..., i] = linear @ AXIS[i]
            slope[..., i] = np.sum(linear * np.cross(turn, AXIS[i]), axis=-1)
        else:
            own[..., i] = angular @ AXIS[i]
            slope[..., i] = np.sum(
                angular * np.cross(turn, AXIS[i]) + linear * np.cross(drift, AXIS[i]), axis=-1
            )
        rotation, place = frames[i]
        linear, angular = _out(rotation, linear), _out(rotation, angular)
        angular = angular + np.cross(place, linear)
    return own + motor_torque(dq), slope


class Observer:
    """External joint torques from motor torques and speeds, low-passed (momentum observer).

    Call `step` once a cycle with what was measured; it returns the residual [N.m, N], shape (n).
    A contact is where a residual leaves what free motion shows.
    """

    def __init__(self, bandwidth=50.0):
        """`bandwidth` [1/s]: larger is faster and noisier."""
        self.bandwidth = bandwidth
        self.reset()

    def reset(self):
        """Forget everything; the next step is the first."""
        self.start = None
        self.integral, self.residual = np.zeros(JOINTS), np.zeros(JOINTS)

    def step(self, dt, q, dq, torque):
        """The residual now, `dt` [s] after the step before."""
        own, slope = momentum(q, dq)
<note>        push = np.asarray(torque, dtype=float) - gravity(q) - friction(<still>) + slope
        if self.start is None:
            self.start, self.push = own, push
            return self.residual
        self.integral = self.integral + dt * (push + self.push) / 2.0
        gap = own - self.start - self.integral
        self.residual = self.bandwidth * gap / (1.0 + self.bandwidth * dt)
        self.integral = self.integral + dt * self.residual
        self.push = push
        return self.residual


def rigid_body(q, dq, ddq, gravity=GRAVITY_VECTOR, bodies=INERTIALS):
    """Torques of the links alone, recursive Newton-Euler in the joint frames."""
    q, dq, ddq = (np.asarray(x, dtype=float) for x in (q, dq, ddq))
    zero = np.zeros((*q.shape[:-1], 3))
    turn, spin, push = zero, zero, zero - gravity
    frames, forces = [], []
    for i in range(JOINTS):
        rotation, place = _joint(i, q[..., i])
        speed, gain = dq[..., i, None] * AXIS[i], ddq[..., i, None] * AXIS[i]
        push = push + np.cross(spin, place) + np.cross(turn, np.cross(turn, place))
        turn, spin, push = _into(rotation, turn), _into(rotation, spin), _into(rotation, push)
        if PRISMATIC[i]:
            push = push + 2.0 * np.cross(turn, speed) + gain
        else:
            spin = spin + gain + np.cross(turn, speed)
            turn = turn + speed
        frames.append((rotation, place))
        forces.append(_wrench(bodies[i], turn, spin, push))
    torque = np.empty(q.shape)
    force, moment = zero, zero
    for i in reversed(range(JOINTS)):
        force, moment = force + forces[i][0], moment + forces[i][1]
        torque[..., i] = (force if PRISMATIC[i] else moment) @ AXIS[i]
        rotation, place = frames[i]
        force, moment = _out(rotation, force), _out(rotation, moment)
        moment = moment + np.cross(place, force)
    return torque


def _joint(i, q):
    q = np.asarray(q)[..., None]
    rotation = FIXED[i] + SINE[i] * np.sin(q)[..., None] + COSINE[i] * np.cos(q)[..., None]
    return rotation, ORIGIN[i] + SLIDE[i] * q


def _wrench(body, turn, spin, push):
    first = body[1:4]
    xx, yy, zz, yz, xz, xy = body[4:]
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    force = body[0] * push + np.cross(spin, first) + np.cross(turn, np.cross(turn, first))
    moment = spin @ tensor + np.cross(turn, turn @ tensor) + np.cross(first, push)
    return force, moment


def _into(rotation, vector):
    return np.einsum("...ij,...i->...j", rotation, vector)


def _out(rotation, vector):
    return np.einsum("...ij,...j->...i", rotation, vector)


def _step(speed, width):
    smooth = np.tanh(speed / np.where(width > 0, width, 1.0))
    return np.where(width > 0, smooth, np.sign(speed))
'''


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
    why = "# No acceleration is known here: the load is that of gravity and speed."
    return "q, dq, ddq", "q, dq, np.zeros(JOINTS)", f"        {why}\n"


def python_code(model: ExportModel, comment: str = "") -> str:
    """The file's text: constants, then functions of q, dq, ddq; `comment` says where it is from."""
    words = constants.friction_words(model)
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
    yield f"JOINT_NAMES = {tuple(_safe(name) for name in model.robot.joint_names)!r}"
    yield f"JOINTS = {model.joints}"
    for comment, name, value in constants.arrays(model):
        if comment:
            yield f"# {comment}"
        yield f"{name.upper()} = {_array(value)}"
    yield f"# {constants.COUNTERBALANCE}"
    yield f"COUNTERBALANCES = {constants.counterbalances(model)!r}"
    if waves := constants.ripple_waves(model):
        yield f"# {constants.WAVE}"
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
