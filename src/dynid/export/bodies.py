"""How far standard parameters are from bodies that can exist, and from the prior's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array, Indices
from dynid.reduction.sampling import random_states
from dynid.regressor.model import INERTIAL, InverseDynamicModel
from dynid.robot.inertia import to_pseudo_inertia

MOTOR_SYMBOLS = ("Im", "Imm")
_OTHER = 1e-6
"""Curvature of the parameters without a prior, so that a Newton step is defined."""
_POSSIBLE = 1e-5
"""Share of its prior that a body may lack before it counts as impossible: the solver's digits."""
_POSES = 50
_SEED = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Bodies:
    """The links and motors among the standard parameters, with their prior.

    The divergence of a link is tr(J0^-1 J) - log det(J0^-1 J) - 4 of its pseudo-inertia J to the
    prior's J0; that of a motor inertia is the same for one number.
    """

    names: tuple[str, ...]
    """(p) names of the standard parameters."""
    links: int
    """Number of links n; the first 10 n parameters are theirs."""
    motors: Indices
    """(k) places of the motor inertias."""
    prior: Array
    """(p) inertial parameters and motor inertias of possible bodies; 0 for friction."""

    @staticmethod
    def of(model: InverseDynamicModel, prior: Array) -> Bodies:
        """The bodies of a model.

        A motor's inertia is guessed to be that of the arm it drives, the mean over random poses:
        gears are chosen so that the two are alike.

        Args:
            model: The model.
            prior: (n, 10) inertial parameters of possible bodies in the parameter frames.
        """
        values = np.zeros(len(model.columns))
        values[: prior.size] = prior.ravel()
        motors = [
            k
            for k, column in enumerate(model.columns)
            if k >= prior.size and column.name.rstrip("0123456789") in MOTOR_SYMBOLS
        ]
        driven = _driven(model, values)
        for k in motors:
            values[k] = driven[model.columns[k].joint]
        return Bodies(
            names=model.names,
            links=model.robot.joints,
            motors=np.array(motors, dtype=np.intp),
            prior=values,
        )

    @property
    def inertial(self) -> int:
        """Number of inertial parameters 10 n."""
        return len(INERTIAL) * self.links

    def pseudo_inertias(self, values: Array) -> Array:
        """(n, 4, 4) of parameters (p)."""
        return to_pseudo_inertia(values[: self.inertial].reshape(-1, 10))

    def divergence(self, values: Array) -> tuple[float, Array, Array]:
        """The divergence to the prior, its gradient (p) and its second derivatives (p, p).

        Infinite, with zeros for the derivatives, where a body cannot exist.
        """
        width = len(values)
        gradient, curvature = np.zeros(width), np.zeros((width, width))
        here, known = self.pseudo_inertias(values), self.pseudo_inertias(self.prior)
        motor, expected = values[self.motors], self.prior[self.motors]
        try:
            # Factor and inverse both: bodies at the edge of the possible have the one alone.
            np.linalg.cholesky(here)
            inverses = np.asarray(np.linalg.inv(here), dtype=np.float64)
        except np.linalg.LinAlgError:
            return float("inf"), gradient, curvature
        if (motor <= 0.0).any():
            return float("inf"), gradient, curvature
        share = motor / expected
        total = float((share - np.log(share) - 1.0).sum())
        total += 0.5 * _OTHER * float(np.square(values[self.inertial :]).sum())
        basis = to_pseudo_inertia(np.eye(10))
        for i in range(self.links):
            mine = slice(10 * i, 10 * i + 10)
            body: Array = here[i]
            inverse: Array = inverses[i]
            given = np.asarray(np.linalg.inv(known[i]), dtype=np.float64)
            total += float(np.sum(given * body)) - 4.0
            total -= float(np.linalg.slogdet(given @ body)[1])
            turned: Array = inverse @ basis
            gradient[mine] = np.einsum("ab,kba->k", given - inverse, basis)
            curvature[mine, mine] = np.einsum("kab,lba->kl", turned, turned)
        free = np.arange(self.inertial, width)
        gradient[free] += _OTHER * values[free]
        curvature[free, free] += _OTHER
        gradient[self.motors] += 1.0 / expected - 1.0 / motor
        curvature[self.motors, self.motors] += 1.0 / np.square(motor)
        return total, gradient, curvature

    def shortfalls(self, values: Array) -> Array:
        """(n + k) the share of its prior that each link, then motor, lacks to be possible.

        Negative where it is possible.
        """
        roots = np.linalg.inv(np.linalg.cholesky(self.pseudo_inertias(self.prior)))
        white = roots @ self.pseudo_inertias(values) @ roots.transpose(0, 2, 1)
        links = np.asarray(-np.linalg.eigvalsh(white)[:, 0], dtype=np.float64)
        motors = -values[self.motors] / self.prior[self.motors]
        return np.concatenate([links, motors])

    def prior_by_body(self) -> Array:
        """(p, n + k) a column a link, then a motor: the prior of that one alone."""
        columns = np.zeros((len(self.prior), self.links + len(self.motors)))
        for i in range(self.links):
            mine = slice(10 * i, 10 * i + 10)
            columns[mine, i] = self.prior[mine]
        columns[self.motors, self.links + np.arange(len(self.motors))] = self.prior[self.motors]
        return columns

    def impossible(self, values: Array) -> str:
        """The links and motors that cannot exist, in words; empty if all can."""
        short = self.shortfalls(values) > _POSSIBLE
        links = [str(i + 1) for i in range(self.links) if short[i]]
        motors = [
            self.names[int(self.motors[k])]
            for k in range(len(self.motors))
            if short[self.links + k]
        ]
        words = [f"link {', '.join(links)}"] if links else []
        if motors:
            words.append(f"motor inertia {', '.join(motors)}")
        return " and ".join(words)


def _driven(model: InverseDynamicModel, prior: Array) -> Array:
    """(n) what each joint accelerates, the mean diagonal of the mass matrix [kg.m^2 or kg]."""
    joints = model.robot.joints
    q, _, _ = random_states(model.robot, _POSES, _SEED)
    still = np.zeros_like(q)
    weight = model.inverse_dynamics(q, still, still, prior)
    driven = np.empty(joints)
    for j in range(joints):
        push = still.copy()
        push[:, j] = 1.0
        driven[j] = (model.inverse_dynamics(q, still, push, prior) - weight)[:, j].mean()
    return driven
