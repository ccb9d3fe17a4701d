"""Noise in the motion: instrumental variables, output error, and maximum likelihood.

For the likelihood, how noisy the measured motion is, is read off its spectrum above the motion.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dynid import core, regressor
from dynid.identification.least_squares import Estimator, Fit, WeightedLeastSquares, residual_noise
from dynid.identification.problem import IdentificationProblem, joint_factors
from dynid.signals import Samples, derivative, low_pass, motion_bandwidth, stretches

BANDWIDTH_FACTOR = 4.0
"""Cut-off of the smooth motion over the motion's own bandwidth: the motion passes whole."""
LOWEST_HZ = 1.0
SETTLED = 1.0
"""Periods of that cut-off at both ends that the filter spoils."""
GAP = 1.5
"""Steps in time longer than this many samples part two records."""


def smooth_motion(samples: Samples) -> tuple[Samples, core.Indices]:
    """The motion low-passed near its own bandwidth, far below the cut-off of the samples.

    Several records are smoothed one by one.

    Returns:
        Samples with smooth q, dq, ddq, same torques; and the indices where the filter has
        settled, whole blocks of the samples.

    Raises:
        InputError: Too few samples remain.
    """
    rate, block = samples.rate_hz, samples.block
    q, dq, ddq = np.array(samples.q), np.array(samples.dq), np.array(samples.ddq)
    kept: list[core.Indices] = []
    for part in stretches(samples.t, GAP / rate):
        cutoff = smooth_cutoff(samples.q[part], rate)
        q[part] = low_pass(samples.q[part], rate, cutoff)
        dq[part] = derivative(q[part], rate, "central", cutoff)
        ddq[part] = derivative(dq[part], rate, "central", cutoff)
        edge = int(np.ceil(SETTLED * rate / cutoff))
        inner: core.Indices = np.arange(part.start + edge, part.stop - edge, dtype=np.intp)
        kept.append(inner[: len(inner) // block * block])
    indices = np.concatenate(kept)
    if len(indices) < 16 * block:
        raise core.InputError(
            "the record is too short to smooth its motion",
            value=f"{samples.count} samples",
            next_step="Use --estimator wls, or a longer record.",
        )
    return replace(samples, q=q, dq=dq, ddq=ddq, unfiltered_q=None), indices


def smooth_cutoff(q: core.Array, rate_hz: float) -> float:
    """Cut-off [Hz] of the smooth motion."""
    return max(BANDWIDTH_FACTOR * motion_bandwidth(q, rate_hz), LOWEST_HZ)


def picked(samples: Samples, indices: core.Indices) -> Samples:
    """The samples at some indices."""
    names = ("t", "q", "dq", "ddq", "tau")
    chosen = {name: getattr(samples, name)[indices] for name in names}
    return replace(samples, unfiltered_q=samples.friction_q[indices], **chosen)


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

    model: regressor.InverseDynamicModel
    parameters: core.Array
    """(p) standard parameters of the arm."""
    servo: core.Array | None = None
    """(p) what the servo believes of them; None for the truth."""

    def simulate(self, reference: Samples) -> Samples:
        """Positions, velocities, accelerations of the simulated arm at the samples' times.

        Of the reference, a smooth motion, gaps in time part the records.

        Raises:
            JobError: The arm runs away.
        """
        rate = reference.rate_hz
        steps = max(1, int(np.ceil(1.0 / (rate * LARGEST_STEP_S))))
        length, settle = max(2, round(STRETCH_S * rate)), round(SETTLE_S * rate)
        # No stretch goes on into another record.
        first, begin, end = np.array(
            [
                (max(part.start, start - settle), start, min(start + length, part.stop))
                for part in stretches(reference.t, GAP / rate)
                for start in range(part.start, part.stop, length)
            ]
        ).T
        motion = (reference.q, reference.dq, reference.ddq)
        out = [np.array(x) for x in motion]
        q, dq, ddq = (x[first] for x in motion)
        for k in range(int((end - first).max())):
            at = np.minimum(first + k, end - 1)
            writing = (first + k >= begin) & (first + k < end)
            for target, value in zip(out, (q, dq, ddq), strict=True):
                target[at[writing]] = value[writing]
            ahead = np.minimum(at + 1, end - 1)
            for s in range(steps):
                share = s / steps
                aim = tuple((1 - share) * x[at] + share * x[ahead] for x in motion)
                ddq = self._acceleration(aim, q, dq, 1.0 / (rate * steps))
                q = q + dq / (rate * steps) + ddq / (2 * (rate * steps) ** 2)
                dq = dq + ddq / (rate * steps)
                if not np.abs(q - aim[0]).max() < RUNAWAY:
                    raise core.JobError(
                        "the simulation of the arm diverges: its model or its servo's is wrong",
                        value=f"{np.abs(q - aim[0]).max():.3g} rad or m beside its reference",
                        next_step="Use --estimator sdp, or record a better motion.",
                    )
        return replace(reference, q=out[0], dq=out[1], ddq=out[2], unfiltered_q=None)

    def _acceleration(
        self, aim: tuple[core.Array, ...], q: core.Array, dq: core.Array, step: float
    ) -> core.Array:
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
        implicit: core.Array = mass + step * slope[:, :, None] * np.eye(joints)
        push: core.Array = np.einsum("bij,bj->bi", believed, wanted) + planned - bias
        found = np.asarray(np.linalg.solve(implicit, push[:, :, None]), dtype=np.float64)
        return found[:, :, 0]


def _mass(torque: core.Array, gravity: core.Array) -> core.Array:
    """(B, n, n) mass matrices from the torques at rest and at each unit acceleration."""
    count, joints = gravity.shape
    units = torque[count:].reshape(joints, count, joints).transpose(1, 2, 0)
    mass = units - gravity[:, :, None]
    # The nearest symmetric matrices with positive eigenvalues.
    values, vectors = np.linalg.eigh((mass + mass.transpose(0, 2, 1)) / 2)
    raised = np.maximum(values, LEAST_MASS * values[:, -1:])
    return np.asarray((vectors * raised[:, None]) @ vectors.transpose(0, 2, 1), dtype=np.float64)


ITERATIONS = 4
TOLERANCE = 1e-3
"""Change over a standard deviation at which iterations stop."""


@dataclass(frozen=True, kw_only=True)
class InstrumentalVariables(Estimator):
    """p = (Z' W)^-1 Z' tau with the simulated arm's observation matrix Z (IDIM-IV).

    Noise of the measured motion stands in W but not in Z, the columns of a noise-free
    simulation of the identified model in closed loop (Janot, Vandanjon and Gautier 2014). Its
    reference is the measured motion low-passed near its own bandwidth.
    """

    name: ClassVar[str] = "iv"
    prior_gain: float | None = None
    """See `WeightedLeastSquares`, where it starts."""

    def fit(self, problem: IdentificationProblem) -> Fit:
        """See `Estimator`."""
        smooth, inner = smooth_motion(problem.samples)
        measured = replace(problem, samples=picked(problem.samples, inner))
        # A start from the noisy motion may have a mass matrix that cannot be simulated.
        first = replace(problem, samples=picked(smooth, inner))
        fit = WeightedLeastSquares(prior_gain=self.prior_gain).fit(first)
        factors = joint_factors(measured)
        for _ in range(ITERATIONS):
            simulated = simulated_problem(problem, smooth, inner, fit.values)
            values, root = solve_instrumental(measured, simulated, fit.weights)
            step = float(np.linalg.norm(root @ (values - fit.values)))
            noise = residual_noise(factors, values, measured)
            fit = replace(fit, values=values, information=root, noise=noise, weights=1.0 / noise)
            if step < TOLERANCE * np.sqrt(len(values)):
                break
        return fit


@dataclass(frozen=True, kw_only=True)
class OutputError(Estimator):
    """Fits the torques of the simulated arm to the measured ones (DIDIM, CLIE).

    The simulated motion replaces the measured one altogether: the model is simulated forward in
    closed loop, its inverse model fitted to the measured torques, and so on (Gautier, Janot and
    Vandanjon 2013). Two or three rounds are enough.
    """

    name: ClassVar[str] = "didim"
    prior_gain: float | None = None
    """See `WeightedLeastSquares`."""

    def fit(self, problem: IdentificationProblem) -> Fit:
        """See `Estimator`."""
        weighted = WeightedLeastSquares(prior_gain=self.prior_gain)
        smooth, inner = smooth_motion(problem.samples)
        fit = weighted.fit(replace(problem, samples=picked(smooth, inner)))
        for _ in range(ITERATIONS):
            update = weighted.fit(simulated_problem(problem, smooth, inner, fit.values))
            step = float(np.linalg.norm(update.information @ (update.values - fit.values)))
            fit = update
            if step < TOLERANCE * np.sqrt(len(fit.values)):
                break
        return fit


def simulated_problem(
    problem: IdentificationProblem, smooth: Samples, inner: core.Indices, values: core.Array
) -> IdentificationProblem:
    """The same torques with the motion of the simulated arm of base parameters (r)."""
    loop = ClosedLoop(model=problem.base.model, parameters=problem.base.to_standard(values))
    return replace(problem, samples=picked(loop.simulate(smooth), inner))


def solve_instrumental(
    measured: IdentificationProblem, simulated: IdentificationProblem, weights: core.Array
) -> tuple[core.Array, core.Array]:
    """(r) p = (Z' W)^-1 Z' tau, and the (r, r) triangular root of W' Z (Z' Z)^-1 Z' W.

    W and tau are the measured problem's, Z the simulated one's with as many rows; all rows are
    weighted by those (n) of their joints [1/(N.m)].

    Raises:
        JobError: Z' W is singular to working precision.
    """
    rank = measured.base.rank
    cross = np.zeros((rank, rank))
    right = np.zeros(rank)
    stacked = np.zeros((rank, rank))
    for (_, w, torque), (_, z, _) in zip(measured.chunks(), simulated.chunks(), strict=True):
        square = np.square(weights)[:, None]
        cross += np.einsum("rjt,sjt->rs", z * square, w, optimize=True)
        right += np.einsum("rjt,jt->r", z * square, torque, optimize=True)
        rows = (z * weights[:, None]).reshape(rank, -1).T
        stacked = core.upper_triangle(np.vstack([stacked, rows]))
    scale = np.linalg.norm(stacked, axis=0)
    if (scale == 0).any() or np.linalg.cond(cross / np.outer(scale, scale)) > 1e13:
        raise core.JobError(
            "the instruments do not determine all parameters",
            next_step="Record a motion that excites every joint, or use --estimator wls.",
        )
    scaled = cross / np.outer(scale, scale)
    values = np.asarray(np.linalg.solve(scaled, right / scale), dtype=np.float64) / scale
    projected = np.asarray(np.linalg.solve(stacked.T, cross), dtype=np.float64)
    return values, core.upper_triangle(projected)


UPPER_SHARE = 0.7
"""Of the cut-off: above it the filter falls."""
LEAST_STEP = 1e-7
"""Steps of differences are no smaller [rad, rad/s, rad/s^2]."""


def motion_covariance(density: core.Array, cutoff_hz: float) -> core.Array:
    """(3n, 3n) of q, dq, ddq at one instant: velocities are independent of the others.

    Of white position noise with a density as of `motion_noise`, let through up to a cut-off [Hz].
    """
    turn = 2 * np.pi
    q, dq, ddq = (turn ** (2 * k) * cutoff_hz ** (2 * k + 1) / (2 * k + 1) for k in range(3))
    one = np.array([[q, 0, -dq], [0, dq, 0], [-dq, 0, ddq]])
    return np.asarray(np.kron(one, np.diag(density)), dtype=np.float64)


def motion_noise(samples: Samples) -> core.Array:
    """(n) one-sided power density of the position noise [rad^2/Hz].

    The level of the acceleration's spectrum between motion and cut-off; of several records the
    longest counts.
    """
    rate = samples.rate_hz
    part = max(stretches(samples.t, GAP / rate), key=lambda s: s.stop - s.start)
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
        turn = core.inverse_upper(start.information)

        def cost(step: core.Array) -> tuple[float, core.Array]:
            value, slope = likelihood.cost(start.values + turn @ step)
            return value, turn.T @ slope

        found = core.scipy_part("optimize").minimize(
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
            root = core.upper_triangle(np.vstack([root, part.information(values)]))
        inverse = core.inverse_upper(root)
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

    columns: core.Array
    """(r, n, N)"""
    slopes: core.Array
    """(r, n, 3n, N) derivatives of the columns by q, dq, ddq."""
    torque: core.Array
    """(n, N) [N.m or N]"""
    torque_noise: core.Array
    """(n) variance of the torques."""
    passed: core.Array
    """(n) variance that the noise of the motion adds to that, mean over the instants."""
    motion_covariance: core.Array
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

    def cost(self, values: core.Array) -> tuple[float, core.Array]:
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

    def information(self, values: core.Array) -> core.Array:
        """(r, r) triangular root of the Fisher information of the whole record."""
        _, weight, _ = self._parts(values)
        roots = np.linalg.cholesky(weight)
        rows = np.einsum("tij,rit->tjr", roots, self.columns).reshape(-1, len(values))
        return core.upper_triangle(np.asarray(rows, dtype=np.float64))

    def _parts(self, values: core.Array) -> tuple[core.Array, core.Array, core.Array]:
        """D (n, 3n, N), the inverse covariances (N, n, n) and the errors (n, N)."""
        through = np.tensordot(values, self.slopes, axes=1)
        spread = np.einsum("jkt,kl->jlt", through, self.motion_covariance)
        covariance = np.einsum("ikt,jkt->tij", spread, through) + np.diag(self.torque_noise)
        weight = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
        return through, weight, self.torque - np.tensordot(values, self.columns, axes=1)


def _slopes(
    model: regressor.InverseDynamicModel,
    motion: tuple[core.Array, ...],
    columns: list[int],
    steps: core.Array,
) -> core.Array:
    """(r, n, 3n, N) differences of the columns over the noise's own size (3, n)."""
    joints = model.robot.joints
    out = np.empty((len(columns), joints, 3 * joints, len(motion[0])))
    for kind in range(3):
        for j in range(joints):
            step = steps[kind, j]
            ends: list[core.Array] = []
            for sign in (1.0, -1.0):
                moved = [x.copy() for x in motion]
                moved[kind][:, j] += sign * step
                ends.append(model.stack(moved[0], moved[1], moved[2])[columns])
            out[:, :, kind * joints + j] = (ends[0] - ends[1]) / (2 * step)
    return out
