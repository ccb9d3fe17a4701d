"""The linear problem: observation matrix and torques, their factors and condition numbers."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dynid import reduction, regressor, signals
from dynid.core import Array, InputError, Value, upper_triangle


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentificationProblem(Value):
    """Find p_B with W p_B = tau for the base parameters of a model.

    Raises:
        InputError: The joints of samples and model differ, or there are fewer rows than
            parameters.
    """

    base: reduction.BaseParametrization
    """The base parametrization of the model."""
    samples: signals.Samples
    """Processed motion and torques."""
    state: Array | None = field(init=False)
    """(n, N) state of presliding friction along the samples, where the model has it."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "state", motion_state(self.base.model, self.samples))
        robot = self.base.model.robot
        if self.samples.joints != robot.joints:
            raise InputError("joints differ", value=self.samples.joints, limit=robot.joints)
        rows, rank = self.blocks * robot.joints, self.base.rank
        if rows <= rank:
            raise InputError("fewer torque samples than parameters", value=rows, limit=f"> {rank}")

    @property
    def blocks(self) -> int:
        """Rows a joint: samples over block length."""
        rows = self.samples.rows
        return (rows.stop - rows.start) // self.samples.block

    @property
    def rate_hz(self) -> float:
        """Rows a second."""
        return self.samples.rate_hz / self.samples.block

    def chunks(self, columns: Sequence[int] | None = None) -> Iterator[tuple[slice, Array, Array]]:
        """Parts of the problem that fit in the cache, torques and columns averaged alike.

        Of the model's columns (r) those of the base are meant, if no others are named.

        Yields:
            Rows covered, columns (r, n, T), torques (n, T) with known torques added.
        """
        model, samples, block = self.base.model, self.samples, self.samples.block
        chosen = list(self.base.independent if columns is None else columns)
        used, step = samples.rows, max(1, chunk_size(samples) // block)
        for first in range(0, self.blocks, step):
            rows = slice(first, min(first + step, self.blocks))
            part = slice(used.start + rows.start * block, used.start + rows.stop * block)
            stack, torque = recorded_rows(model, samples, part, chosen, self.state)
            yield rows, block_mean(stack, block), block_mean(torque, block)

    def residual(self, values: Array) -> Array:
        """Measured torque minus prediction (n, rows) [N.m or N]."""
        out = np.empty((self.samples.joints, self.blocks))
        for rows, columns, torque in self.chunks():
            out[:, rows] = torque - np.tensordot(values, columns, axes=1)
        return out


def chunk_size(samples: signals.Samples) -> int:
    """Samples evaluated at once: what lies beside a chunk must not outweigh it."""
    reach = 0 if samples.torque_filter is None else samples.torque_filter.reach(samples.rate_hz)
    return max(regressor.CHUNK, 4 * reach)


def motion_state(model: regressor.InverseDynamicModel, samples: signals.Samples) -> Array | None:
    """(n, N) state of presliding friction along samples; None without any."""
    # Only averaged periods know the scatter between them.
    periodic = samples.noise is not None
    q = samples.friction_q
    states = [model.friction_state(q[run], periodic=periodic) for run in samples.runs]
    known = [state for state in states if state is not None]
    return np.concatenate(known, axis=1) if known else None


def recorded_rows(
    model: regressor.InverseDynamicModel,
    samples: signals.Samples,
    part: slice,
    columns: list[int],
    state: Array | None,
) -> tuple[Array, Array]:
    """Columns (r, n, T) as the record would show them, and torques (n, T), known ones added."""
    wide, inner = samples.surroundings(part)
    q = samples.q[wide]
    now = None if state is None else state[:, wide]
    stack = model.stack(q, samples.dq[wide], samples.ddq[wide], state=now)[columns]
    known = samples.as_recorded(model.known_torque(q).T, wide)[:, inner]
    return samples.as_recorded(stack, wide)[..., inner], samples.tau[part].T + known


def block_mean(values: Array, block: int) -> Array:
    """Means over blocks of the last axis, whose length is a multiple of `block`."""
    if block == 1:
        return values
    # Faster than the mean of an axis.
    total = values[..., ::block].copy()
    for k in range(1, block):
        total += values[..., k::block]
    total /= block
    return total


@dataclass(frozen=True, slots=True, kw_only=True)
class SummedProblem(IdentificationProblem):
    """A problem with more rows than its samples, of which only the factors are at hand."""

    factors: Array
    """(n, r + 1, r + 1) from `joint_factors` of all rows."""
    rows: int
    """Rows a joint."""

    @property
    def blocks(self) -> int:
        """See `rows`."""
        return self.rows


def joint_factors(problem: IdentificationProblem, row_weights: Array | None = None) -> Array:
    """(n, r + 1, r + 1) upper triangular R of the QR of [W_j tau_j] for each joint.

    Everything that least squares needs of the data: weights a joint can change afterwards without
    touching it again. `row_weights` (n, N) multiply single rows, for robust estimators.
    """
    if isinstance(problem, SummedProblem):
        return problem.factors
    joints, width = problem.samples.joints, problem.base.rank + 1
    return triangles(problem.chunks(), joints, width, row_weights)


def triangles(
    chunks: Iterable[tuple[slice, Array, Array]],
    joints: int,
    width: int,
    row_weights: Array | None = None,
) -> Array:
    """(n, w, w) as `joint_factors`, of chunks as of a problem, w - 1 columns each."""
    factors = np.zeros((joints, width, width))
    for part, columns, torque in chunks:
        for j in range(joints):
            rows = np.vstack([columns[:, j], torque[j]]).T
            if row_weights is not None:
                rows = rows * row_weights[j, part, None]
            factors[j] = upper_triangle(np.vstack([factors[j], rows]))
    return factors


ILL_CONDITIONED = 20.0
"""Of `motion_condition_number`: motions made to identify arms reach 2 to 18."""
LARGEST = 1e16
"""Beyond rounding all condition numbers are alike, and JSON knows no infinity."""
ELSEWHERE = 1000
"""Random samples of motions elsewhere."""
HARDLY_THERE = 1e-5
"""Directions of the parameters with less of the largest singular value change no torque."""
BANDWIDTH_FACTOR = 2.0
LOWEST_HZ = 0.5


def observation_root(problem: IdentificationProblem) -> Array:
    """(r, r) upper triangular R with R'R = W'W, rows unweighted."""
    rank = problem.base.rank
    return upper_triangle(joint_factors(problem)[:, :, :rank].reshape(-1, rank))


def condition_number(root: Array) -> float:
    """Of W as it stands, which depends on units and frames: the paper's."""
    return min(float(np.linalg.cond(root)), LARGEST)


def scaled_condition_number(root: Array, mapping: Array) -> float:
    """Of all standard columns with unit norm, on what motion can show of them.

    Unlike the paper's it depends neither on units nor on which columns were chosen as base
    parameters: a poor choice (the Panda in DH frames) costs a factor of a thousand there. With the
    root (r, r) from `observation_root` and the mapping (r, p) from `base_mapping`; the largest over
    the r-th singular value, `LARGEST` if that is zero.
    """
    columns = root @ mapping
    norms = np.linalg.norm(columns, axis=0)
    seen = norms > 1e-12 * norms.max(initial=1e-300)
    values = np.linalg.svd(columns[:, seen] / norms[seen], compute_uv=False)
    weakest = values[len(root) - 1] if len(values) >= len(root) else 0.0
    return float(values[0] / weakest) if weakest > 1e-15 * values[0] else LARGEST


def base_mapping(base: reduction.BaseParametrization) -> Array:
    """(r, p) B with p_B = B p."""
    mapping = np.zeros((base.rank, len(base.model.columns)))
    mapping[np.arange(base.rank), list(base.independent)] = 1.0
    mapping[:, list(base.dependent)] = base.regrouping
    return mapping


def motion_condition_number(
    base: reduction.BaseParametrization,
    recordings: Sequence[signals.UniformSignals],
    settings: signals.ProcessingSettings,
    known: Array | None = None,
) -> float:
    """How much errors of torque can grow from the recordings to motions elsewhere.

    Of all combinations of the base parameters, the largest ratio of its RMS torque on random
    motions to that on the recordings and in what is known besides: the condition number of the one
    relative to the other. The random motions are anywhere within the position limits, their RMS
    speeds and accelerations are the recorded ones; torques of a joint count by their recorded RMS.
    Units, link frames and the choice of base parameters do not matter, nor do cut-off, delays and
    velocity source of the settings; another draw of the random motions changes it by a few per
    cent. Differentiated noise fills the columns of a poor record: the motion is smoothed down to
    twice its own bandwidth first, which leaves a good record as it is.

    Args:
        base: Of the paper's parameters.
        recordings: What was recorded.
        settings: How it is processed.
        known: (k, r) root of a prior's precision, times the noise of torques over their RMS.
    """
    robot = base.model.robot
    problems: list[IdentificationProblem] = []
    for uniform in recordings:
        bandwidth = signals.motion_bandwidth(uniform.q, uniform.rate_hz)
        smooth = replace(
            settings,
            cutoff_hz=max(BANDWIDTH_FACTOR * bandwidth, LOWEST_HZ),
            velocity="position",
            delays_s=None,
            decimate=True,
            torque_filter=None,
        )
        samples = signals.samples_from(uniform, smooth)
        problems.append(IdentificationProblem(base=base, samples=samples))
    recorded = np.concatenate([joint_factors(problem) for problem in problems], axis=1)
    torque = np.linalg.norm(recorded[..., -1], axis=1)
    torque = np.maximum(torque, 1e-6 * (torque.max() or 1.0))
    speed, acceleration = (
        np.sqrt(np.square(np.concatenate(rows)).mean(axis=0))
        for rows in zip(*((x.samples.dq, x.samples.ddq) for x in problems), strict=True)
    )
    draw, shape = np.random.default_rng(0), (ELSEWHERE, robot.joints)
    reach = np.where(robot.prismatic, 1.0, np.pi)
    q = draw.uniform(
        np.where(np.isfinite(robot.limits.lower), robot.limits.lower, -reach),
        np.where(np.isfinite(robot.limits.upper), robot.limits.upper, reach),
        shape,
    )
    dq, ddq = (draw.normal(size=shape) * rms for rms in (speed, acceleration))
    elsewhere = base.model.stack(q, dq, ddq)[list(base.independent)].transpose(1, 2, 0)
    count = sum(problem.blocks for problem in problems)
    here, there = (
        (rows / torque[:, None, None]).reshape(-1, base.rank)
        for rows in (recorded[..., :-1], elsewhere * np.sqrt(count / ELSEWHERE))
    )
    if known is not None:
        here = np.vstack([here, known / np.sqrt(count)])
    # Of orthonormal columns, the squares of what either shows add to one.
    stacked = np.vstack([upper_triangle(here), upper_triangle(there)])
    norms = np.linalg.norm(stacked, axis=0)
    left, sizes, _ = np.linalg.svd(stacked / np.where(norms > 0, norms, 1.0), full_matrices=False)
    seen = left[: base.rank, sizes > HARDLY_THERE * sizes[0]]
    weakest = float(np.linalg.svd(seen, compute_uv=False)[-1])
    return float(np.sqrt(max(weakest**-2 - 1.0, 0.0))) if weakest > 1.0 / LARGEST else LARGEST
