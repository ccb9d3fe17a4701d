"""Several records of one robot at once: what they share, and what each has of its own.

Inertias are the same in every record; friction is not (cold, warm, another day). Ordered record
by record, the observation matrix has its own columns in blocks on the diagonal and the shared
columns beside them. Of each record only the triangle of its QR is kept, so the whole problem has as
many rows as records have columns.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from dynid.core import Array, Indices, InputError, Value, inverse_upper, upper_triangle
from dynid.identification import bayesian, fitting, least_squares, statistics
from dynid.identification.estimate import Estimate
from dynid.identification.problem import IdentificationProblem, triangles
from dynid.reduction import BaseParametrization
from dynid.signals import find_period

INERTIAS = ("Im", "Imm")
"""Columns after the links' that belong to the robot, not to its friction."""
PAYLOAD = 10
"""Inertial parameters of a payload."""
SINGULAR = 1e-11
"""Smallest pivot over the largest, columns of unit norm, that counts as resolved."""


def friction_parameters(base: BaseParametrization | Estimate) -> tuple[int, ...]:
    """(f) base parameters that are friction: all that are neither inertias nor of motors."""
    links = 10 * base.model.robot.joints
    return tuple(
        k
        for k, (column, name) in enumerate(zip(base.independent, base.names, strict=True))
        if column >= links and bayesian.symbol_of(name) not in INERTIAS
    )


def friction_places(base: BaseParametrization | Estimate) -> list[list[int]]:
    """For each joint, which of `friction_parameters` are its own."""
    joint = [base.model.columns[base.independent[k]].joint for k in friction_parameters(base)]
    joints = range(base.model.robot.joints)
    return [[c for c, of in enumerate(joint) if of == j] for j in joints]


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedProblem:
    """Records of one robot, some of them with one and the same payload on its last link.

    Raises:
        InputError: Models whose base parameters differ.
    """

    problems: tuple[IdentificationProblem, ...]
    """One a record; the models may differ in the shapes of their friction columns only."""
    loaded: tuple[bool, ...] = ()
    """For each record, whether it carries the payload; empty for none."""

    def __post_init__(self) -> None:
        first = self.problems[0].base
        for other in self.problems[1:]:
            same = other.base.model.frames == first.model.frames
            if other.base.names != first.names or not same:
                raise InputError(
                    "records with other base parameters cannot share them",
                    value=sorted(set(other.base.names) ^ set(first.names)),
                    limit=f"frames {first.model.frames}",
                )

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.problems[0].samples.joints

    @property
    def own(self) -> tuple[int, ...]:
        """(f) base parameters that each record has of its own: its friction."""
        return friction_parameters(self.problems[0].base)

    @property
    def common(self) -> tuple[int, ...]:
        """(s) base parameters that the records share."""
        own = set(self.own)
        return tuple(k for k in range(self.problems[0].base.rank) if k not in own)

    @property
    def payload(self) -> int:
        """Payload parameters among the shared ones: ten, or none."""
        return PAYLOAD if any(self.loaded) else 0

    @property
    def shared(self) -> int:
        """Number of shared parameters: `common`, then those of the payload."""
        return len(self.common) + self.payload

    def chunks(self, record: int) -> Iterator[tuple[slice, Array, Array]]:
        """Parts of a record as `IdentificationProblem.chunks`, its own columns first.

        Yields:
            Rows covered, columns (f + shared, n, T) with zeros for a payload that the record
            does not carry, torques (n, T).
        """
        problem = self.problems[record]
        last = 10 * (self.joints - 1)
        order = [problem.base.independent[k] for k in (*self.own, *self.common)]
        for rows, columns, torque in problem.chunks([*order, *range(last, last + self.payload)]):
            if self.payload and not self.loaded[record]:
                columns[-PAYLOAD:] = 0.0
            yield rows, columns, torque

    def factors(self, record: int) -> Array:
        """(n, w + 1, w + 1) triangular factors of a record's joints, w = f + shared."""
        width = len(self.own) + self.shared + 1
        return triangles(self.chunks(record), self.joints, width)


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedSolution(Value):
    """A solution for given weights."""

    own: Array
    """(R, f) parameters of each record's own."""
    shared: Array
    """(s) shared parameters."""
    information: Array
    """(R f + s, R f + s) upper triangular root: own of each record in turn, then shared."""

    def local(self, record: int) -> Array:
        """(f + s) parameters in the order of a record's columns."""
        return np.concatenate([self.own[record], self.shared])


UNKNOWN = 100.0
"""Standard deviation of each payload parameter before anything is measured [kg, kg.m, kg.m^2]."""


def solve_shared(factors: Array, weights: Array, own: int, payload: int = 0) -> SharedSolution:
    """Solve for each record's own parameters, the first `own` columns, and for those of all.

    With factors (R, n, w + 1, w + 1) and weights (R, n) [1/(N.m)] of each record and joint. The
    last `payload` columns have a prior of zero +- `UNKNOWN`: not every arm shows all of a payload.

    Raises:
        JobError: A parameter that no record shows, or a singular problem.
    """
    records, width = len(factors), factors.shape[-1] - 1
    first = records * own
    size = first + width - own
    wide = np.zeros((records, width + 1, size + 1))
    for k, rows in enumerate(factors * weights[:, :, None, None]):
        upper = upper_triangle(rows.reshape(-1, width + 1))
        wide[k, :, k * own : (k + 1) * own] = upper[:, :own]
        wide[k, :, first:] = upper[:, own:]
    known = np.eye(payload, size + 1, size - payload) / UNKNOWN
    values, root = least_squares.solve_rows(np.vstack([*wide, known]), SINGULAR)
    each = values[:first].reshape(records, own)
    return SharedSolution(own=each, shared=values[first:], information=root)


SAME_LENGTH = 0.01
"""Records of one motion differ in length by no more than this share ..."""
SAME_PLACE = 0.02
"""... and at no instant in position, over each joint's range."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedFit(Value):
    """A weighted solution with its noise and covariance."""

    solution: SharedSolution
    noise: Array
    """(R, n) residual standard deviation of each record's joints [N.m or N]."""
    covariance: Array
    """(R f + s, R f + s) covariance that allows for correlated residuals."""
    naive: Array
    """The same if residuals were white."""
    shares: Array
    """(R f + s, n) what the torques of each joint add to the solution, which is their sum."""


def fit_shared(problem: SharedProblem, *, one_noise: bool = False) -> SharedFit:
    """Fit, weighting each joint of each record by its own noise, iterated.

    Args:
        problem: The records.
        one_noise: Weight a joint alike in all records: errors that records share, as of a
            model that both get wrong, then cancel in their difference.

    Raises:
        JobError: A singular problem.
    """
    factors = np.array([problem.factors(k) for k in range(len(problem.problems))])
    blocks = np.array([item.blocks for item in problem.problems])
    own = len(problem.own)
    scale = np.linalg.norm(factors[..., -1], axis=2) / np.sqrt(blocks)[:, None]
    scale = np.where(scale > 0, scale, 1.0)
    noise = pooled_noise(scale, blocks) if one_noise else scale
    solution = solve_shared(factors, 1.0 / noise, own, problem.payload)
    for _ in range(least_squares.MOST_WEIGHTINGS):
        update = _noise(factors, solution, blocks, scale)
        if one_noise:
            update = pooled_noise(update, blocks)
        change = np.abs(update / noise - 1).max()
        noise = update
        solution = solve_shared(factors, 1.0 / noise, own, problem.payload)
        if change < least_squares.SETTLED:
            break
    inverse = inverse_upper(solution.information)
    naive = inverse @ inverse.T
    return SharedFit(
        solution=solution,
        noise=noise,
        covariance=_covariance(problem, solution, 1.0 / noise, inverse),
        naive=naive,
        shares=_shares(factors, 1.0 / noise, own, naive),
    )


def _shares(factors: Array, weights: Array, own: int, naive: Array) -> Array:
    """See `SharedFit.shares`: by the normal equations, which are linear in the torques."""
    torque = np.einsum("kjac,kja->kcj", factors[..., :-1], factors[..., -1])
    torque = torque * np.square(weights)[:, None]
    each = torque[:, :own].reshape(-1, weights.shape[1])
    return naive @ np.vstack([each, torque[:, own:].sum(axis=0)])


def pooled_noise(noise: Array, blocks: Array) -> Array:
    """(R, n) the root mean square over records in each record's place."""
    mean = np.sqrt(np.average(np.square(noise), axis=0, weights=blocks))
    return np.tile(mean, (len(noise), 1))


def _noise(factors: Array, solution: SharedSolution, blocks: Array, scale: Array) -> Array:
    values = np.array([np.append(solution.local(k), -1.0) for k in range(len(blocks))])
    norms = np.linalg.norm(np.einsum("kjab,kb->kja", factors, values), axis=2)
    used = solution.own.shape[1] + len(solution.shared) * blocks / blocks.sum()
    found = norms / np.sqrt(np.maximum(blocks - used / scale.shape[1], 1.0))[:, None]
    # A joint that fits to rounding would get an infinite weight.
    return np.maximum(found, 1e-9 * np.maximum(scale, 1e-9))


def _covariance(
    problem: SharedProblem, solution: SharedSolution, weights: Array, root: Array
) -> Array:
    """Sandwich of the Newey-West covariances of the scores, as `statistics.hac_covariance`."""
    records, own = solution.own.shape
    total = sum(item.blocks for item in problem.problems)

    def scored(k: int) -> tuple[Array, Array]:
        blocks, values = problem.problems[k].blocks, solution.local(k)
        local, residual = statistics.scores_of(problem.chunks(k), blocks, values, weights[k])
        scores = np.zeros((len(root), local.shape[1]))
        scores[k * own : (k + 1) * own], scores[records * own :] = local[:own], local[own:]
        return scores, residual

    def freedom(rows: int, together: int) -> float:
        used = own * together + len(solution.shared) * rows * together / total
        return rows / max(rows - used / (problem.joints * together), 1.0)

    return shared_sandwich(problem, root, scored, freedom)


def shared_sandwich(
    problem: SharedProblem,
    root: Array,
    scored: Callable[[int], tuple[Array, Array]],
    freedom: Callable[[int, int], float],
) -> Array:
    """(s, s) covariance from scores of records, never below the naive one root root' (s, s).

    The scores of records that repeat one motion are added instant by instant: what the model gets
    wrong there is the same in all of them, and says nothing about their difference. So are those
    of the periods of a record. `scored` gives scores (s, N) and residuals (n, N) of a record,
    `freedom` the factor of so many rows of so many records.
    """
    long_run = np.zeros_like(root)
    for group in repetitions(problem):
        rows = min(problem.problems[k].blocks for k in group)
        period = min(_period(problem.problems[group[0]]), rows)
        summed, lag = np.zeros((len(root), -(-rows // period) * period)), 1
        for k in group:
            scores, residual = scored(k)
            rate = problem.problems[k].rate_hz
            lag = max(lag, statistics.correlation_lag(residual, rate, period, below_white=True))
            summed[:, :rows] += scores[:, :rows]
        once = summed.reshape(len(root), -1, period).sum(axis=1)
        short = 1.0 / max(1.0 - 2.0 * lag / period, 0.5)
        long_run += freedom(rows, len(group)) * short * statistics.long_run_covariance(once, lag)
    payload = np.arange(len(root) - problem.payload, len(root))
    long_run[payload, payload] += UNKNOWN**-2
    return root @ statistics.at_least(root.T @ long_run @ root, 1.0) @ root.T


def _period(record: IdentificationProblem) -> int:
    """Rows of a period of the motion, all where it has none."""
    period_s = find_period(record.samples.q, record.samples.rate_hz)
    return record.blocks if period_s is None else round(period_s * record.rate_hz)


def repetitions(problem: SharedProblem) -> list[list[int]]:
    """The records, those that repeat one motion together."""
    groups: list[list[int]] = []
    for k, item in enumerate(problem.problems):
        for group in groups:
            if _same_motion(problem.problems[group[0]], item):
                group.append(k)
                break
        else:
            groups.append([k])
    return groups


def _same_motion(a: IdentificationProblem, b: IdentificationProblem) -> bool:
    if abs(a.blocks - b.blocks) > SAME_LENGTH * a.blocks or a.rate_hz != b.rate_hz:
        return False
    rows = min(a.samples.count, b.samples.count)
    apart = np.abs(a.samples.q[:rows] - b.samples.q[:rows]).max(axis=0)
    return bool((apart <= SAME_PLACE * np.ptp(a.samples.q, axis=0)).all())


ESTIMATOR = "wls, shared"


def base_order(base: BaseParametrization | Estimate, records: int, record: int = 0) -> list[int]:
    """(r) where the base parameters of one of so many records stand in `SharedFit.covariance`."""
    own, order = friction_parameters(base), list[int]()
    for k in range(len(base.independent)):
        before = sum(friction < k for friction in own)
        first, place = (record, before) if k in own else (records, k - before)
        order.append(first * len(own) + place)
    return order


def friction_order(base: BaseParametrization | Estimate, records: int, c: list[int]) -> Indices:
    """Where some of `friction_parameters` stand there, of each record in turn."""
    first = len(friction_parameters(base)) * np.arange(records)
    return np.asarray(np.add.outer(first, c).ravel(), dtype=np.intp)


def shared_estimates(
    problem: SharedProblem, fit: SharedFit, source: fitting.EstimateSource
) -> tuple[Estimate, ...]:
    """One estimate a record, all with the same inertias."""
    flat = np.concatenate([fit.solution.own.ravel(), fit.solution.shared])
    words = (*source.choices, f"inertias shared by {len(problem.problems)} records")
    found: list[Estimate] = []
    for k, (item, record) in enumerate(zip(problem.problems, source.records, strict=True)):
        order = base_order(item.base, len(problem.problems), k)
        values, rank = flat[order], len(order)
        # Behind the parameters of the others, the root is that of these alone.
        others = np.setdiff1d(np.arange(len(flat)), order)
        root = upper_triangle(fit.solution.information[:, [*others, *order]])[-rank:, -rank:]
        noise = fit.noise[k]
        plain = least_squares.Fit(values=values, noise=noise, weights=1.0 / noise, information=root)
        found.append(
            fitting.judged(
                item,
                plain,
                replace(source, records=[record], choices=words),
                covariance=fit.covariance[np.ix_(order, order)],
                naive_std=np.sqrt(np.diag(fit.naive)[order]),
                estimator=ESTIMATOR,
                residual_autocorrelation=least_squares.autocorrelation(item.residual(values), 1),
            )
        )
    return tuple(found)
