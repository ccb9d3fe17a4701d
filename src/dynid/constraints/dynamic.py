"""Joint torques and mechanical power by the prior model, taken at their worst.

The prior may be wrong by a share u of the torque it predicts, and Coulomb friction may act
either way: |tau| <= (1 + u) |tau_prior| + Fc. The power counts every joint's |tau dq|.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.constraints.prior import PriorDynamics
from dynid.core.arrays import Array
from dynid.regressor.adjoint import torque_adjoint

_STEP = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True)
class TorqueJudge:
    """Torque and power limits of a robot of which a prior is known."""

    prior: PriorDynamics
    limits: Array
    """(n) torque limits, NaN where unknown or not held [N.m or N]."""
    power: float
    """Power limit, NaN where unknown or not held [W]."""
    uncertainty: float
    """The share u."""

    def largest(self, q: Array, dq: Array, ddq: Array) -> tuple[Array, Array]:
        """The largest torques (N, n) [N.m or N] and powers (N) [W] that the prior allows for."""
        worst = (1.0 + self.uncertainty) * np.abs(self._torque(q, dq, ddq)) + self.prior.coulomb
        return worst, np.sum(worst * np.abs(dq), axis=1)

    def violation(
        self, q: Array, dq: Array, ddq: Array, share: float
    ) -> tuple[float, Array, Array, Array]:
        """Sum of squared excesses over `share` of the limits, and its derivatives (N, n)."""
        torque = self._torque(q, dq, ddq)
        grows = (1.0 + self.uncertainty) * np.sign(torque)
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
