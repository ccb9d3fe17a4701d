"""The functions of the generated Python file, the same for every robot.

`FRICTION` stands for what friction is called with, `STILL` for the same without acceleration, which
`NOTE` explains.
"""

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


def rigid_body(q, dq, ddq, gravity=GRAVITY, bodies=INERTIALS):
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
