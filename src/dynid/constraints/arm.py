"""The arm as compiled judges read it; torques and power by what is known before identification."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from dynid.core import Array, Indices, compiled, read_only
from dynid.regressor import FrictionTerms, InverseDynamicModel, torque_adjoint
from dynid.robot import Body, RobotModel, from_body, inverse, joint_turns, move, tensor


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmGeometry:
    """Joint frames as functions of the joint positions, and how far points are from axes."""

    joints: Array
    """(n, 36) R0, R1, R2 (row-major), p0, p3, axis: joint frame i in frame i - 1 is
    R = R0 + R1 cos q + R2 sin q, p = p0 + p3 q; the axis in its own frame."""
    prismatic: Indices
    """(n) 1 where the joint slides."""

    @property
    def count(self) -> int:
        """Number of joints n."""
        return len(self.prismatic)

    @property
    def length(self) -> float:
        """The way from the base along all axes [m], as short as least squares find it.

        It takes points of the axes, not the frames' origins: it is the same wherever the frames of
        turning joints stand on their axes.
        """
        n = self.count
        turn, origin, axis = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty((n, 3))
        place_joints(self.joints, np.zeros(n), turn, origin, axis)
        along = np.where(self.prismatic[:, None], 0.0, axis)[:, :, None] * np.eye(n)[:, None]
        ways = np.diff(along, axis=0, prepend=0.0).reshape(3 * n, n)
        steps = np.diff(origin, axis=0)
        least = np.linalg.lstsq(ways, -steps.ravel())[0]
        return float(np.linalg.norm(steps + (ways @ least).reshape(n, 3), axis=1).sum())

    def reach(self, link: int, point: Array, travel: Array) -> Array:
        """(n) a bound on how fast each joint moves a point (3) of a link [m/rad or 1].

        Not below the true one anywhere: the point is never farther from axis k than the way along
        the arm, for joints that travel to `travel` (n), the largest |q| of each [rad or m].
        """
        found = np.zeros(self.count)
        way = float(np.linalg.norm(point))
        for k in range(link - 1, -1, -1):
            slides = bool(self.prismatic[k])
            found[k] = 1.0 if slides else way
            # p0 is the way from frame to frame.
            way += float(np.linalg.norm(self.joints[k, 27:30]) + slides * travel[k])
        return found


def arm_geometry(robot: RobotModel) -> ArmGeometry:
    """The geometry of a robot."""
    n, turn, place = robot.joints, robot.placements[:, :3, :3], robot.placements[:, :3, 3]
    slides = np.array(robot.prismatic)[:, None]
    turns = (turn @ part for part in joint_turns(robot))
    slide = slides * (turn @ robot.axes[:, :, None])[:, :, 0]
    rows = np.hstack([*(part.reshape(n, 9) for part in turns), place, slide, robot.axes])
    return ArmGeometry(
        joints=rows,  # Writable, as they come to a worker: see `samples_of`.
        prismatic=np.array(robot.prismatic, dtype=np.intp),
    )


def samples_of(values: Array) -> Array:
    """A contiguous writable copy: read-only arrays would make Numba compile once more."""
    return np.array(values, dtype=np.float64, order="C", ndmin=2)


@compiled(fastmath=True, error_model="numpy")
def place_joints(joints: Array, q: Array, turn: Array, origin: Array, axis: Array) -> None:
    """Write the joint frames at q (n) in the base frame.

    Of `ArmGeometry.joints`: rotations (n + 1, 3, 3) and origins (n + 1, 3) [m], the base first, and
    axes (n, 3).
    """
    for r in range(3):
        for c in range(3):
            turn[0, r, c] = 1.0 if r == c else 0.0
        origin[0, r] = 0.0
    for i in range(len(q)):
        g = joints[i]
        cosine, sine = math.cos(q[i]), math.sin(q[i])
        for r in range(3):
            t0, t1, t2 = turn[i, r, 0], turn[i, r, 1], turn[i, r, 2]
            for c in range(3):
                a = g[c] + g[9 + c] * cosine + g[18 + c] * sine
                b = g[3 + c] + g[12 + c] * cosine + g[21 + c] * sine
                d = g[6 + c] + g[15 + c] * cosine + g[24 + c] * sine
                turn[i + 1, r, c] = t0 * a + t1 * b + t2 * d
            p0 = g[27] + g[30] * q[i]
            p1 = g[28] + g[31] * q[i]
            p2 = g[29] + g[32] * q[i]
            origin[i + 1, r] = origin[i, r] + t0 * p0 + t1 * p1 + t2 * p2
        for r in range(3):
            t0, t1, t2 = turn[i + 1, r, 0], turn[i + 1, r, 1], turn[i + 1, r, 2]
            axis[i, r] = t0 * g[33] + t1 * g[34] + t2 * g[35]


@compiled(fastmath=True, error_model="numpy")
def place_point(turn: Array, origin: Array, point: Array, out: Array) -> None:
    """Write a point of one link in the base frame: turn (3, 3), origin (3), point (3)."""
    for r in range(3):
        out[r] = origin[r] + turn[r, 0] * point[0] + turn[r, 1] * point[1] + turn[r, 2] * point[2]


@compiled(fastmath=True, error_model="numpy")
def collect(
    origin: Array, axis: Array, prismatic: Indices, force: Array, moment: Array, out: Array
) -> None:
    """Add what forces on the links do at the joints to `out` (n).

    With joint origins (n + 1, 3) [m] and axes (n, 3); the sums of the forces on each link (n + 1,
    3) and of their moments about the base's origin are overwritten.
    """
    n = len(prismatic)
    for k in range(n - 1, -1, -1):
        f0, f1, f2 = force[k + 1, 0], force[k + 1, 1], force[k + 1, 2]
        if prismatic[k]:
            out[k] += axis[k, 0] * f0 + axis[k, 1] * f1 + axis[k, 2] * f2
        else:
            x, y, z = origin[k + 1, 0], origin[k + 1, 1], origin[k + 1, 2]
            out[k] += (
                axis[k, 0] * (moment[k + 1, 0] - y * f2 + z * f1)
                + axis[k, 1] * (moment[k + 1, 1] - z * f0 + x * f2)
                + axis[k, 2] * (moment[k + 1, 2] - x * f1 + y * f0)
            )
        for r in range(3):
            force[k, r] += force[k + 1, r]
            moment[k, r] += moment[k + 1, r]


COULOMB_SHARE = 0.06
"""Coulomb torque over the torque limit."""
VISCOUS_SHARE = 0.08
"""Viscous torque at 1 rad/s or m/s over the torque limit [s/rad or s/m]."""
MOTOR_SHARE = 0.01
"""Torque of the motor's inertia at 1 rad/s^2 or m/s^2 over the torque limit [s^2/rad]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PriorDynamics:
    """A first guess of the joint torques."""

    model: InverseDynamicModel
    """Inertial, viscous and motor columns."""
    parameters: Array
    """(p) for the columns of `model`."""
    coulomb: Array
    """(n) Coulomb friction, which acts either way [N.m or N]."""
    notes: tuple[str, ...]
    """What was assumed, in words."""

    def torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Torques (N, n) of the motors without Coulomb friction [N.m or N]; motion (N, n)."""
        rigid = self.model.inverse_dynamics(q, dq, ddq, self.parameters)
        return rigid - self.model.known_torque(q)


def prior_dynamics(robot: RobotModel) -> PriorDynamics | None:
    """The prior of a robot, or None where a mass or a centre of mass is unknown."""
    if np.isnan(robot.inertias[:, :4]).any():
        return None
    notes: list[str] = []
    links = np.array([prior_link(robot, k) for k in range(robot.joints)])
    unknown = np.isnan(robot.inertias).any(axis=1)
    shaped = np.isin(np.arange(robot.joints) + 1, [body.link for body in robot.bodies])
    for rows, guess in (
        (unknown & shaped, "uniform solids in the shape of their bodies"),
        (unknown & ~shaped, "point masses"),
    ):
        if rows.any():
            names = ", ".join(robot.joint_names[k] for k in np.flatnonzero(rows))
            notes.append(f"no inertia tensor is known for {names}: taken as {guess}")
    model = InverseDynamicModel(
        robot=robot, friction=FrictionTerms(terms=(("fv", None), ("im", None)))
    )
    frames = robot.parameter_frames[model.frames]
    placed = [move(row, inverse(frame)) for row, frame in zip(links, frames, strict=True)]
    # Without a torque limit nothing tells how large a joint is; nothing is judged there either.
    size = np.nan_to_num(robot.limits.torque, posinf=0.0)
    parameters = np.zeros(len(model.columns))
    parameters[: 10 * robot.joints] = np.concatenate(placed)
    for k, column in enumerate(model.columns[10 * robot.joints :], start=10 * robot.joints):
        share = {"Fv": VISCOUS_SHARE, "Im": MOTOR_SHARE}.get(column.name.rstrip("0123456789"), 0.0)
        parameters[k] = share * size[column.joint]
    slides = any(robot.prismatic)
    speed, change = ("rad/s or m/s", "rad/s^2 or m/s^2") if slides else ("rad/s", "rad/s^2")
    notes.append(
        f"friction and motor inertia taken as {COULOMB_SHARE:.0%}, {VISCOUS_SHARE:.0%} per {speed}"
        f" and {MOTOR_SHARE:.0%} per {change} of the torque limits"
    )
    return PriorDynamics(
        model=model,
        parameters=read_only(parameters),
        coulomb=read_only(COULOMB_SHARE * size),
        notes=tuple(notes),
    )


def prior_link(robot: RobotModel, k: int) -> Array:
    """The ten parameters of link k + 1 about its joint frame, its tensor guessed if unknown.

    Masses and centres of mass of the robot must be known.
    """
    row = robot.inertias[k]
    if not np.isnan(row).any():
        return row
    mass = float(row[0])
    centre = row[1:4] / mass if mass > 0 else np.zeros(3)
    solids = [body for body in robot.bodies if body.link == k + 1]
    if not solids or mass == 0:
        return from_body(mass, centre, np.zeros((3, 3)))
    whole = np.sum([_uniform(body.points.tobytes(), body.radius) for body in solids], axis=0)
    whole *= mass / whole[0]
    own = whole[1:4] / mass
    central = tensor(whole) - mass * (own @ own * np.eye(3) - np.outer(own, own))
    return from_body(mass, centre, (central + central.T) / 2)


@lru_cache(maxsize=256)
def _uniform(points: bytes, radius: float) -> Array:
    """The ten parameters of a body of density 1, summed over tetrahedra from the origin.

    Kept: a surface takes 10 ms, and one robot is judged often.
    """
    rows = np.frombuffer(points).reshape(-1, 3)
    vertices, faces = Body(name="", link=0, points=rows, radius=radius).surface()
    corners = vertices[faces]
    volume = np.linalg.det(corners) / 6
    total = corners.sum(axis=1)
    first = volume @ total / 4
    second = np.einsum("f,fcx,fcy->xy", volume, corners, corners)
    second = (second + np.einsum("f,fx,fy->xy", volume, total, total)) / 20
    about = np.trace(second) * np.eye(3) - second
    six = about[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]
    return read_only(np.array([volume.sum(), *first, *six]))


_STEP = 1e-5
_UNCERTAINTY = 0.15
"""Share by which the prior model may underestimate a torque."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TorqueJudge:
    """Torque and power limits of a robot of which a prior is known."""

    prior: PriorDynamics
    limits: Array
    """(n) torque limits, NaN where unknown or not held [N.m or N]."""
    power: float
    """Power limit, NaN where unknown or not held [W]."""

    def largest(self, q: Array, dq: Array, ddq: Array) -> tuple[Array, Array]:
        """The largest torques (N, n) [N.m or N] and powers (N) [W] that the prior allows for."""
        worst = (1.0 + _UNCERTAINTY) * np.abs(self.prior.torque(q, dq, ddq)) + self.prior.coulomb
        return worst, np.sum(worst * np.abs(dq), axis=1)

    def violation(
        self, q: Array, dq: Array, ddq: Array, share: float
    ) -> tuple[float, Array, Array, Array]:
        """Sum of squared excesses over `share` of the limits, and its derivatives (N, n)."""
        torque = self.prior.torque(q, dq, ddq)
        grows = (1.0 + _UNCERTAINTY) * np.sign(torque)
        worst = grows * torque + self.prior.coulomb
        limits = share * np.where(np.isnan(self.limits), np.inf, self.limits)
        over = np.maximum(worst / limits - 1.0, 0.0)
        total = float(np.vdot(over, over))
        pull = 2.0 * over / limits
        q_bar, dq_bar, ddq_bar = np.zeros(q.shape), np.zeros(q.shape), np.zeros(q.shape)
        if not np.isnan(self.power):
            limit = share * self.power
            beyond = np.maximum(np.sum(worst * np.abs(dq), axis=1) / limit - 1.0, 0.0)
            total += float(beyond @ beyond)
            weight = (2.0 * beyond / limit)[:, None]
            pull += weight * np.abs(dq)
            dq_bar += weight * worst * np.sign(dq)
        active = pull.any(axis=1)
        if active.any():
            at = q[active], dq[active], ddq[active]
            multipliers = (pull * grows)[active]
            prior = self.prior
            found = torque_adjoint(prior.model, *at, prior.parameters, multipliers)
            for bar, part in zip((q_bar, dq_bar, ddq_bar), found, strict=True):
                bar[active] += part
            q_bar[active] -= multipliers * self._spring_slope(at[0])
        return total, q_bar, dq_bar, ddq_bar

    def _spring_slope(self, q: Array) -> Array:
        # Counterbalances act on their own joint alone, so one difference serves all joints.
        model = self.prior.model
        if not model.robot.counterbalances:
            return np.zeros(q.shape)
        return (model.known_torque(q + _STEP) - model.known_torque(q - _STEP)) / (2 * _STEP)
