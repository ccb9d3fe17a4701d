"""Maximum likelihood with noise in positions as well as in torques.

How noisy the measured motion is, is read off its spectrum above the motion.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dynid.core import Array, inverse_upper, scipy_part, upper_triangle
from dynid.identification.instrumental import segments, smooth_cutoff
from dynid.identification.least_squares import Estimator, Fit, WeightedLeastSquares
from dynid.identification.problem import IdentificationProblem
from dynid.regressor import InverseDynamicModel
from dynid.signals import Samples

UPPER_SHARE = 0.7
"""Of the cut-off: above it the filter falls."""
LEAST_STEP = 1e-7
"""Steps of differences are no smaller [rad, rad/s, rad/s^2]."""


def motion_covariance(density: Array, cutoff_hz: float) -> Array:
    """(3n, 3n) of q, dq, ddq at one instant: velocities are independent of the others.

    Of white position noise with a density as of `motion_noise`, let through up to a cut-off [Hz].
    """
    turn = 2 * np.pi
    q, dq, ddq = (turn ** (2 * k) * cutoff_hz ** (2 * k + 1) / (2 * k + 1) for k in range(3))
    one = np.array([[q, 0, -dq], [0, dq, 0], [-dq, 0, ddq]])
    return np.asarray(np.kron(one, np.diag(density)), dtype=np.float64)


def motion_noise(samples: Samples) -> Array:
    """(n) one-sided power density of the position noise [rad^2/Hz].

    The level of the acceleration's spectrum between motion and cut-off; of several records the
    longest counts.
    """
    rate = samples.rate_hz
    part = max(segments(samples.t, rate), key=lambda s: s.stop - s.start)
    ddq = samples.ddq[part]
    taper = np.hanning(len(ddq))
    spectrum = np.abs(np.fft.rfft(ddq * taper[:, None], axis=0)) ** 2
    power = 2 * spectrum / (rate * np.square(taper).sum())
    frequency = np.fft.rfftfreq(len(ddq), 1 / rate)
    lower = 2 * smooth_cutoff(samples.q[part], rate)
    band = (frequency > lower) & (frequency < UPPER_SHARE * samples.cutoff_hz)
    if band.sum() < 5:
        # No room above the motion: nothing to be seen there.
        return np.zeros(samples.joints)
    level = power[band] / (2 * np.pi * frequency[band, None]) ** 4
    # A periodogram's median lies below its mean by log 2.
    return np.asarray(np.median(level, axis=0), dtype=np.float64) / np.log(2.0)


MOST_ROWS = 1200
"""Instants at a time; of longer records the search looks at every so manieth."""
TORQUE_SHARE = 0.05
"""Least share of a joint's residual variance that counts as torque noise."""


@dataclass(frozen=True, kw_only=True)
class MaximumLikelihood(Estimator):
    """Minimises sum_t log det S_t(p) + e_t' S_t(p)^-1 e_t (Olsen, Swevers and Verdonck 2002).

    S_t = S_torque + D_t S_motion D_t', D_t the derivative of the model's torque by q, dq, ddq:
    where the motion's noise comes through strongly, a sample counts less, for all joints
    together. Torque noise comes from the scatter between periods where there are periods.
    """

    name: ClassVar[str] = "ml"
    prior_gain: float | None = None
    """See `WeightedLeastSquares`, where it starts."""

    def fit(self, problem: IdentificationProblem) -> Fit:
        """See `Estimator`."""
        start = WeightedLeastSquares(prior_gain=self.prior_gain).fit(problem)
        stride = -(-problem.samples.count // MOST_ROWS)
        likelihood = Likelihood.of(problem, start, slice(0, None, stride))
        turn = inverse_upper(start.information)

        def cost(step: Array) -> tuple[float, Array]:
            value, slope = likelihood.cost(start.values + turn @ step)
            return value, turn.T @ slope

        found = scipy_part("optimize").minimize(
            cost,
            np.zeros(len(start.values)),
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": 200, "maxcor": 30, "ftol": 1e-12, "gtol": 1e-6},
        )
        values = start.values + turn @ np.asarray(found.x, dtype=np.float64)
        # One step of scoring with all instants is as good as a search with all (Fisher 1925).
        root, slope = np.zeros(turn.shape), np.zeros(len(values))
        for k in range(stride):
            part = Likelihood.of(problem, start, slice(k, None, stride))
            slope += part.cost(values)[1]
            root = upper_triangle(np.vstack([root, part.information(values)]))
        inverse = inverse_upper(root)
        values = values - inverse @ (inverse.T @ slope) / 2
        residual = problem.residual(values)
        spread = likelihood.torque_noise + likelihood.passed
        return replace(
            start,
            values=values,
            noise=residual.std(axis=1),
            # Scores are weighed as the information is: scatter between periods is no model error.
            weights=np.sqrt(problem.samples.block / spread),
            information=root,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Likelihood:
    """Minus twice the log likelihood of base parameters, and its gradient."""

    columns: Array
    """(r, n, N)"""
    slopes: Array
    """(r, n, 3n, N) derivatives of the columns by q, dq, ddq."""
    torque: Array
    """(n, N) [N.m or N]"""
    torque_noise: Array
    """(n) variance of the torques."""
    passed: Array
    """(n) variance that the noise of the motion adds to that, mean over the instants."""
    motion_covariance: Array
    """(3n, 3n) of q, dq, ddq at one instant."""

    @staticmethod
    def of(problem: IdentificationProblem, start: Fit, pick: slice) -> "Likelihood":
        """The likelihood of some instants of a problem with the noise of its motion.

        The residuals of a least-squares fit, where it starts, bound the torque noise.
        """
        samples, base = problem.samples, problem.base
        columns = list(base.independent)
        motion = tuple(x[pick] for x in (samples.q, samples.dq, samples.ddq))
        covariance = motion_covariance(motion_noise(samples), samples.cutoff_hz)
        steps = np.maximum(np.sqrt(np.diag(covariance)).reshape(3, -1), LEAST_STEP)
        slopes = _slopes(base.model, motion, columns, steps)
        through = np.einsum("r,rjkt->jkt", start.values, slopes)
        passed = np.einsum("jkt,kl,jlt->j", through, covariance, through) / through.shape[-1]
        given = samples.noise
        seen = np.square(start.noise) * samples.block
        variance = np.square(given) if given is not None else seen - passed
        return Likelihood(
            columns=base.model.stack(*motion)[columns],
            slopes=slopes,
            torque=(samples.tau[pick] + base.model.known_torque(motion[0])).T,
            torque_noise=np.maximum(variance, TORQUE_SHARE * seen),
            passed=passed,
            motion_covariance=covariance,
        )

    def cost(self, values: Array) -> tuple[float, Array]:
        """Minus twice the log likelihood of base parameters (r), and its gradient (r)."""
        through, weight, error = self._parts(values)
        pulled = np.einsum("tij,jt->it", weight, error)
        value = float((error * pulled).sum() - np.linalg.slogdet(weight)[1].sum())
        gradient = -2.0 * np.einsum("rjt,jt->r", self.columns, pulled, optimize=True)
        # d S = 2 sym(D_k C D'): its trace with S^-1 - u u'.
        spread = np.einsum("jkt,kl->jlt", through, self.motion_covariance)
        inner = weight.transpose(1, 2, 0) - pulled[:, None] * pulled[None]
        bars = np.einsum("ijt,jlt->ilt", inner, spread)
        gradient += 2.0 * np.einsum("rjkt,jkt->r", self.slopes, bars, optimize=True)
        return value, gradient

    def information(self, values: Array) -> Array:
        """(r, r) triangular root of the Fisher information of the whole record."""
        _, weight, _ = self._parts(values)
        roots = np.linalg.cholesky(weight)
        rows = np.einsum("tij,rit->tjr", roots, self.columns).reshape(-1, len(values))
        return upper_triangle(np.asarray(rows, dtype=np.float64))

    def _parts(self, values: Array) -> tuple[Array, Array, Array]:
        """D (n, 3n, N), the inverse covariances (N, n, n) and the errors (n, N)."""
        through = np.tensordot(values, self.slopes, axes=1)
        spread = np.einsum("jkt,kl->jlt", through, self.motion_covariance)
        covariance = np.einsum("ikt,jkt->tij", spread, through) + np.diag(self.torque_noise)
        weight = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
        return through, weight, self.torque - np.tensordot(values, self.columns, axes=1)


def _slopes(
    model: InverseDynamicModel, motion: tuple[Array, ...], columns: list[int], steps: Array
) -> Array:
    """(r, n, 3n, N) differences of the columns over the noise's own size (3, n)."""
    joints = model.robot.joints
    out = np.empty((len(columns), joints, 3 * joints, len(motion[0])))
    for kind in range(3):
        for j in range(joints):
            step = steps[kind, j]
            ends: list[Array] = []
            for sign in (1.0, -1.0):
                moved = [x.copy() for x in motion]
                moved[kind][:, j] += sign * step
                ends.append(model.stack(moved[0], moved[1], moved[2])[columns])
            out[:, :, kind * joints + j] = (ends[0] - ends[1]) / (2 * step)
    return out
