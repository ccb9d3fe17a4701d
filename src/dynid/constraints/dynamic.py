"""Joint torques and mechanical power by what is known of the arm before identification."""

from dataclasses import dataclass

import numpy as np

from dynid.core import Array, read_only
from dynid.regressor import FrictionTerms, InverseDynamicModel, torque_adjoint
from dynid.robot import Body, RobotModel, from_body, inverse, move, tensor

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
    size = np.nan_to_num(robot.limits.torque)
    parameters = np.zeros(len(model.columns))
    parameters[: 10 * robot.joints] = np.concatenate(placed)
    for k, column in enumerate(model.columns[10 * robot.joints :], start=10 * robot.joints):
        share = {"Fv": VISCOUS_SHARE, "Im": MOTOR_SHARE}.get(column.name.rstrip("0123456789"), 0.0)
        parameters[k] = share * size[column.joint]
    notes.append(
        f"friction and motor inertia taken as {COULOMB_SHARE:.0%}, {VISCOUS_SHARE:.0%} per rad/s"
        f" and {MOTOR_SHARE:.0%} per rad/s^2 of the torque limits"
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
    whole = np.sum([_uniform(body) for body in solids], axis=0)
    whole *= mass / whole[0]
    own = whole[1:4] / mass
    central = tensor(whole) - mass * (own @ own * np.eye(3) - np.outer(own, own))
    return from_body(mass, centre, (central + central.T) / 2)


def _uniform(body: Body) -> Array:
    """The ten parameters of a body of density 1, summed over tetrahedra from the origin."""
    vertices, faces = body.surface()
    corners = vertices[faces]
    volume = np.linalg.det(corners) / 6
    total = corners.sum(axis=1)
    first = volume @ total / 4
    second = np.einsum("f,fcx,fcy->xy", volume, corners, corners)
    second = (second + np.einsum("f,fx,fy->xy", volume, total, total)) / 20
    about = np.trace(second) * np.eye(3) - second
    six = about[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]
    return np.array([volume.sum(), *first, *six])


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
        worst = (1.0 + _UNCERTAINTY) * np.abs(self._torque(q, dq, ddq)) + self.prior.coulomb
        return worst, np.sum(worst * np.abs(dq), axis=1)

    def violation(
        self, q: Array, dq: Array, ddq: Array, share: float
    ) -> tuple[float, Array, Array, Array]:
        """Sum of squared excesses over `share` of the limits, and its derivatives (N, n)."""
        torque = self._torque(q, dq, ddq)
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
            q_bar[active] += multipliers * self._spring_slope(at[0])
        return total, q_bar, dq_bar, ddq_bar

    def _torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        model = self.prior.model
        rigid = model.inverse_dynamics(q, dq, ddq, self.prior.parameters)
        return rigid + model.known_torque(q)

    def _spring_slope(self, q: Array) -> Array:
        # Counterbalances act on their own joint alone, so one difference serves all joints.
        model = self.prior.model
        if not model.robot.counterbalances:
            return np.zeros(q.shape)
        return (model.known_torque(q + _STEP) - model.known_torque(q - _STEP)) / (2 * _STEP)
