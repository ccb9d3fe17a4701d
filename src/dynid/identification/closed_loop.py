"""Forward simulation of an identified model under a servo, many stretches at once."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import JobError
from dynid.identification.smoothing import segments
from dynid.regressor.model import InverseDynamicModel
from dynid.signals.samples import Samples

SERVO_HZ = 5.0
"""Bandwidth of the simulated servo."""
DAMPING = 0.8
LEAST_MASS = 1e-3
"""Smallest eigenvalue of a mass matrix, over its largest: a poor iterate can be simulated too."""
STRETCH_S = 0.4
"""Length of one stretch; all are simulated side by side."""
SETTLE_S = 0.3
"""Run-in of each stretch, from the reference state."""
LARGEST_STEP_S = 0.004
RUNAWAY = 3.0
"""This far beside its reference, the arm is out of control [rad or m]."""
NUDGE = 1e-4
"""Speed by which friction's slope is measured [rad/s or m/s]."""


@dataclass(frozen=True, kw_only=True)
class ClosedLoop:
    """A model that a computed-torque servo with its own parameters moves along a reference.

    As in Gautier, Janot and Vandanjon (2013) the servo keeps the same bandwidth whatever the
    parameters. Semi-implicit in friction, so a Coulomb step of 0.001 rad/s does not chatter.
    """

    model: InverseDynamicModel
    parameters: Array
    """(p) standard parameters of the arm."""
    servo: Array | None = None
    """(p) what the servo believes of them; None for the truth."""

    def simulate(self, reference: Samples) -> Samples:
        """Positions, velocities, accelerations of the simulated arm at the samples' times.

        Args:
            reference: A smooth motion; gaps in time part its records.

        Raises:
            JobError: The arm runs away.
        """
        rate = reference.rate_hz
        steps = max(1, int(np.ceil(1.0 / (rate * LARGEST_STEP_S))))
        length, settle = max(2, round(STRETCH_S * rate)), round(SETTLE_S * rate)
        starts: list[int] = []
        firsts: list[int] = []
        for part in segments(reference.t, rate):
            for start in range(part.start, part.stop, length):
                starts.append(start)
                firsts.append(max(part.start, start - settle))
        out = [np.array(x) for x in (reference.q, reference.dq, reference.ddq)]
        first, begin = np.array(firsts), np.array(starts)
        end = np.minimum(begin + length, reference.count)
        q, dq = reference.q[first].copy(), reference.dq[first].copy()
        ddq = reference.ddq[first].copy()
        for k in range(int((end - first).max())):
            at = np.minimum(first + k, reference.count - 1)
            writing = (first + k >= begin) & (first + k < end)
            for target, value in zip(out, (q, dq, ddq), strict=True):
                target[at[writing]] = value[writing]
            ahead = np.minimum(at + 1, reference.count - 1)
            for s in range(steps):
                share = s / steps
                aim = (
                    (1 - share) * reference.q[at] + share * reference.q[ahead],
                    (1 - share) * reference.dq[at] + share * reference.dq[ahead],
                    (1 - share) * reference.ddq[at] + share * reference.ddq[ahead],
                )
                ddq = self._acceleration(aim, q, dq, 1.0 / (rate * steps))
                q = q + dq / (rate * steps) + ddq / (2 * (rate * steps) ** 2)
                dq = dq + ddq / (rate * steps)
                if not np.abs(q - aim[0]).max() < RUNAWAY:
                    raise JobError(
                        "the simulated arm runs away: its model or its servo's is not physical",
                        value=f"{np.abs(q - aim[0]).max():.3g} rad or m beside its reference",
                        next_step="Use --estimator sdp, or record a better motion.",
                    )
        return replace(reference, q=out[0], dq=out[1], ddq=out[2])

    def _acceleration(
        self, aim: tuple[Array, Array, Array], q: Array, dq: Array, step: float
    ) -> Array:
        """(B, n) accelerations of all stretches for what they aim at."""
        joints = q.shape[1]
        omega = 2 * np.pi * SERVO_HZ
        wanted = aim[2] + 2 * DAMPING * omega * (aim[1] - dq) + omega**2 * (aim[0] - q)
        rest = np.zeros_like(q)
        units = np.repeat(np.eye(joints)[:, None], len(q), axis=1).reshape(-1, joints)
        still = np.zeros_like(units)
        # One call: bias here, friction's slope, bias on the reference, mass matrix.
        states = (
            np.concatenate([q, q, aim[0], q, np.tile(q, (joints, 1))]),
            np.concatenate([dq, dq + NUDGE, aim[1], rest, still]),
            np.concatenate([rest, rest, rest, rest, units]),
        )
        torque = self.model.inverse_dynamics(*states, self.parameters)
        count = len(q)
        bias, nudged, planned, gravity = (torque[k * count : (k + 1) * count] for k in range(4))
        mass = believed = _mass(torque[3 * count :], gravity)
        if self.servo is not None:
            torque = self.model.inverse_dynamics(*states, self.servo)
            planned, gravity = torque[2 * count : 3 * count], torque[3 * count : 4 * count]
            believed = _mass(torque[3 * count :], gravity)
        slope = np.maximum((nudged - bias) / NUDGE, 0.0)
        # The servo's torque is mass times wanted plus the planned bias.
        implicit = mass + step * slope[:, :, None] * np.eye(joints)
        push = np.einsum("bij,bj->bi", believed, wanted) + planned - bias
        found = np.asarray(np.linalg.solve(implicit, push[:, :, None]), dtype=np.float64)
        return found[:, :, 0]


def _mass(torque: Array, gravity: Array) -> Array:
    """(B, n, n) mass matrices from the torques at rest and at each unit acceleration."""
    count, joints = gravity.shape
    units = torque[count:].reshape(joints, count, joints).transpose(1, 2, 0)
    return _positive(units - gravity[:, :, None])


def _positive(mass: Array) -> Array:
    """(B, n, n) the nearest symmetric matrices with positive eigenvalues."""
    values, vectors = np.linalg.eigh((mass + mass.transpose(0, 2, 1)) / 2)
    raised = np.maximum(values, LEAST_MASS * values[:, -1:])
    return np.asarray((vectors * raised[:, None]) @ vectors.transpose(0, 2, 1), dtype=np.float64)
