"""What a fit is worth where it was not recorded: left-out errors, rival models, intervals."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynid.core import Array, Indices, Mask, Value
from dynid.identification.bayesian import PublishedPrior, published_prior
from dynid.identification.least_squares import Fit
from dynid.identification.problem import IdentificationProblem
from dynid.identification.selection import gram, regions
from dynid.identification.selection.scoring import PRIOR_WEIGHTS, gain_of
from dynid.robot import joints_by_kind
from dynid.signals import Samples

SCALES = tuple(float(s) for s in np.geomspace(1.0, 100.0, 21))
"""Factors of the leverage that are tried: 1 is what white residuals do to the parameters."""
FEWEST_ROWS = 50
"""Rows at rest or in motion that have quantiles of their own."""
MOST_ROWS = 20_000
"""Rows that calibrate the intervals: of longer recordings every so manieth."""
SPEEDS = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
"""Bounds of the bands of speed, in shares of a joint's top speed: friction is known least where a
joint hardly moves, and another motion may be slow for longer."""
FAST = 0.1
"""Share of a joint's top speed from which friction no longer turns round from row to row, which
looks like noise."""
MEAN_ROWS = 10.0
"""Rows that the error at all speeds counts as in each band."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Assessment(Value):
    """What left-out parts of the recordings say about a result, on all rows.

    Where repetitions were averaged, errors are those of one: what differs between them counts.
    """

    anywhere: Array
    """(n) RMS error on regions left out, or on recordings left out [N.m or N]."""
    this_motion: Array
    """(n) RMS error on stretches of time left out [N.m or N]."""
    noise_floor: Array
    """(n) standard deviation of what no model of the motion explains [N.m or N]."""
    torque: Array
    """(n) RMS of the measured torque [N.m or N]."""
    models: Mapping[str, Array]
    """(n) left-out errors of rival models on the parts of `anywhere` [N.m or N]: `published`, the
    inertias as given; `published_friction`, with fitted friction and motor inertia; `identified`,
    all identified."""
    pays: bool | None
    """Whether identifying the inertias lowers the errors, by more than their standard error;
    None where none are published."""
    interval: regions.TorqueInterval
    by_speed: Array
    """(2, n, B) mean square error on what was left out in the bands of `SPEEDS`, and its standard
    error [(N.m)^2 or N^2]."""

    def squares_at(self, dq: Array) -> Array:
        """(2, n) mean square error to expect at velocities (N, n), and its standard error.

        [(N.m)^2 or N^2]; what raises the error in one band may raise it in all.
        """
        bands = _bands(np.abs(dq.T), self.interval.slowest)
        errors = [self.by_speed[:, j, own].mean(axis=1) for j, own in enumerate(bands)]
        return np.stack(errors, axis=1)

    def model_percent(self, dq: Array, prismatic: Sequence[bool]) -> float:
        """That error beyond noise over the RMS torque, of the kind of joints that errs more [%]."""
        left, torque = self.squares_at(dq)[0] - np.square(self.noise_floor), np.square(self.torque)
        kinds = joints_by_kind(prismatic).values()
        shares = (left[joints].sum() / max(float(torque[joints].sum()), 1e-18) for joints in kinds)
        return 100.0 * float(np.sqrt(max(0.0, *shares)))

    @property
    def expected_error_percent(self) -> float:
        """Root-sum-square of the errors anywhere over that of the torques [%]."""
        return 100.0 * float(np.linalg.norm(self.anywhere) / max(np.linalg.norm(self.torque), 1e-9))

    @property
    def sample_noise(self) -> Array:
        """(n) noise floor of single samples, not of means over blocks and periods [N.m or N]."""
        return np.hypot(self.noise_floor, self.interval.averaged)

    def deciding_percent(self, prismatic: Sequence[bool]) -> tuple[float, float]:
        """That error of single samples and what of it is noise [%].

        As `dynid.validation.deciding_errors` tells them of another recording.
        """
        found: list[tuple[float, float]] = []
        for joints in joints_by_kind(prismatic).values():
            size = max(float(np.linalg.norm(self.torque[joints])), 1e-9)
            parts = np.hypot(self.anywhere, self.interval.averaged), self.sample_noise
            error, noise = (100.0 * float(np.linalg.norm(part[joints])) / size for part in parts)
            found.append((error, noise))
        return max(found, key=lambda one: one[0] ** 2 - one[1] ** 2)

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {
            "left_out_rms": {
                "anywhere": self.anywhere.tolist(),
                "this_motion": self.this_motion.tolist(),
            },
            "expected_error_percent": self.expected_error_percent,
            "noise_floor": self.noise_floor.tolist(),
            "torque_rms": self.torque.tolist(),
            "models": [{"name": name, "rms": rms.tolist()} for name, rms in self.models.items()],
            "identification_pays": self.pays,
            "interval": self.interval.to_json(),
            "by_speed": {"bounds": list(SPEEDS), "square_errors": self.by_speed.tolist()},
        }


def assessment_from_json(data: dict[str, Any]) -> Assessment:
    """An assessment as `Assessment.to_json` wrote it."""

    def array(values: Any) -> Array:
        return np.array(values, dtype=np.float64)

    interval = {key: array(rows) for key, rows in data["interval"].items() if key != "levels"}
    # Files of before 0.2 know no noise of single samples.
    interval.setdefault("averaged", np.zeros_like(interval["sigma"]))
    anywhere = array(data["left_out_rms"]["anywhere"])
    # Nor do they tell speeds apart.
    same = np.tile(np.square(anywhere)[:, None], len(SPEEDS) + 1)
    by_speed = data.get("by_speed", {"square_errors": [same, 0.0 * same]})
    return Assessment(
        anywhere=anywhere,
        this_motion=array(data["left_out_rms"]["this_motion"]),
        noise_floor=array(data["noise_floor"]),
        torque=array(data["torque_rms"]),
        models={str(model["name"]): array(model["rms"]) for model in data["models"]},
        pays=data["identification_pays"],
        interval=regions.TorqueInterval(**interval),
        by_speed=array(by_speed["square_errors"]),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOutCells:
    """Products of the rows of a problem by what they are left out with."""

    blocks: gram.GramBlocks
    """Of all rows: base columns, then the torque."""
    keys: Indices
    """(2, C) the part that `anywhere` leaves out, and the stretch of time, of each cell."""
    parts: Indices
    """(N) that part of each row of the problem's samples."""


def assess(
    problem: IdentificationProblem,
    fit: Fit,
    *,
    near_weights: Sequence[float] = (),
    lengths: Sequence[int] = (),
    cells: LeftOutCells | None = None,
) -> Assessment:
    """Judge a fit, whose weights are used, by fits of the same model with parts left out.

    Args:
        problem: The samples of all recordings, with the model that was fitted.
        fit: The fit to all of them.
        near_weights: Weights of the published inertias that score alike, the fit's last, see
            `TowardPublished`; empty where they were not used.
        lengths: Samples of each recording, if there are several.
        cells: Products of more rows than the problem has, which then calibrates intervals only.
    """
    n = problem.samples.joints
    cells = cells or _cells(problem, lengths)
    blocks, keys = cells.blocks, cells.keys
    count = float(blocks.rows[0].sum())
    known = published_prior(problem.base)
    prior = gram.Shrinkage(mean=known.mean, precision=known.precision)
    # A fit may have no prior; left-out parts may leave parameters unseen.
    strength = (near_weights[-1] if near_weights else PRIOR_WEIGHTS[0]) * count
    weights = 1.0 / np.maximum(fit.noise, 1e-12)
    fitted = _LeftOut(blocks.merged(keys[0]), weights, prior.times(strength), n)
    timed = _LeftOut(blocks.merged(keys[1]), weights, prior.times(strength), n)
    models, pays = _rivals(fitted, known, n)
    this_motion = timed.rms
    root = _root(fitted, prior, strength, known, [w * count for w in near_weights])
    samples = problem.samples
    speed = np.abs(samples.dq[samples.rows][:: samples.block][: problem.blocks].T)
    slowest = regions.SLOWEST * np.maximum(np.percentile(speed, 99, axis=1), 1e-9)
    precision = strength * known.precision
    fast = regions.SLOWEST * speed > FAST * slowest[:, None]
    index, error, lever, floor = _rows(problem, fitted, cells.parts, root, precision, fast)
    within = _within(samples)
    if samples.noise is not None:
        floor = np.sqrt(np.maximum(np.square(samples.noise) - within, 0.0))
    floor = this_motion if floor is None else np.minimum(floor, this_motion)
    # No model of the motion tells repetitions apart: all err by what has changed.
    changed = np.zeros(n) if samples.changed is None else samples.changed
    # Of each row that is left out: its part, and whether its joint moves.
    part, moves = cells.parts[index], (speed > slowest[:, None])[:, index]
    return Assessment(
        anywhere=np.hypot(fitted.rms, changed),
        this_motion=np.hypot(this_motion, changed),
        noise_floor=floor,
        torque=fitted.torque,
        models={name: np.hypot(rms, changed) for name, rms in models.items()},
        pays=pays,
        interval=regions.TorqueInterval(
            root=root,
            sigma=np.hypot(this_motion, changed),
            slowest=slowest,
            averaged=np.sqrt(samples.periods * within + (samples.periods - 1) * np.square(floor)),
            **_calibrated(this_motion, part, error, lever, moves),
        ),
        by_speed=_by_speed(
            np.square(error) + np.square(changed)[:, None], _bands(speed[:, index], slowest)
        ),
    )


class _LeftOut:
    """Fits with one part left out each, and their errors there."""

    def __init__(
        self, blocks: gram.GramBlocks, weights: Array, shrinkage: gram.Shrinkage, joints: int
    ) -> None:
        rank = len(shrinkage.mean)
        self.blocks = blocks
        self.system = gram.NormalEquations(blocks, gram.shared_picks(rank, joints), weights)
        self.rows = np.maximum(blocks.rows.sum(axis=1), 1.0)
        self.values = self.system.left_out(shrinkage)
        self.errors = self.system.square_errors(self.values)
        self.torque = np.sqrt(blocks.products[:, :, rank, rank].sum(axis=1) / self.rows)

    @property
    def rms(self) -> Array:
        """(n) RMS error."""
        return np.sqrt(self.errors.sum(axis=1) / self.rows)


def _cells(problem: IdentificationProblem, lengths: Sequence[int]) -> LeftOutCells:
    samples = problem.samples
    q, dq = (x[samples.rows][:: samples.block][: problem.blocks] for x in (samples.q, samples.dq))
    ends = np.cumsum(lengths)[:-1] // samples.block
    recordings = np.searchsorted(ends, np.arange(problem.blocks), side="right")
    parts = recordings
    if len(lengths) <= 1:
        parts = regions.find_regions([q], problem.base.model.robot.prismatic).labels(q, 0)
    (moves,) = regions.moving_rows([dq], problem.rate_hz)
    parts, blocks_of_time = (
        regions.divided(some, moves, recordings)
        for some in (parts, regions.stretches(problem.blocks))
    )
    keys, cells = np.unique(np.stack([parts, blocks_of_time]), axis=1, return_inverse=True)
    blocks = gram.gram_blocks(
        ((rows, np.concatenate([c, t[None]])) for rows, c, t in problem.chunks()),
        np.tile(cells.reshape(-1), (problem.samples.joints, 1)),
        keys.shape[1],
        problem.base.rank + 1,
    )
    return LeftOutCells(blocks=blocks, keys=keys, parts=parts)


def _rivals(
    fitted: _LeftOut, known: PublishedPrior, joints: int
) -> tuple[dict[str, Array], bool | None]:
    """The rival models' errors, and whether identifying all beats fitting friction alone."""
    if not known.published:
        return {"identified": fitted.rms}, None
    system, free = fitted.system, known.free
    given = system.square_errors(known.mean[None])
    # Friction and motor inertia alone: what the published inertias leave over.
    matrix, vector = system.others
    own = gram.solutions(free.T @ matrix @ free, (vector - matrix @ known.mean) @ free, None)
    friction = system.square_errors(known.mean + own @ free.T)
    gain, error = gain_of(friction, fitted.errors)
    rows = fitted.rows
    return {
        "published": np.sqrt(given.sum(axis=1) / rows),
        "published_friction": np.sqrt(friction.sum(axis=1) / rows),
        "identified": fitted.rms,
    }, bool(gain > error)


def _root(
    fitted: _LeftOut,
    prior: gram.Shrinkage,
    strength: float,
    known: PublishedPrior,
    near: Sequence[float],
) -> Array:
    """(r, k) root of the uncertainty of the base parameters; see `TorqueInterval.root`."""
    system = fitted.system
    chosen = system.whole(prior.times(strength))[0]
    inverse = _inverse_root(system.matrix.sum(axis=0) + strength * prior.precision)
    # Published inertias are off: what the shrinkage leaves of that.
    unsure = strength * inverse @ (inverse.T @ known.pull)
    apart = [system.whole(prior.times(w))[0] - chosen for w in near]
    return np.concatenate([inverse, unsure, *(d[:, None] for d in apart)], axis=1)


def _inverse_root(matrix: Array) -> Array:
    """(r, r) S with S S' the inverse of a matrix, which may be near singular."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    return vectors / np.sqrt(np.maximum(values, 1e-12 * values[-1])) / scale[:, None]


def _rows(
    problem: IdentificationProblem,
    fitted: _LeftOut,
    parts: Indices,
    root: Array,
    precision: Array,
    fast: Mask,
) -> tuple[Indices, Array, Array, Array | None]:
    """Rows left out: which (M) they are, errors [N.m or N] and leverages (n, M) without their part.

    And the noise (n) that no motion explains, by second differences [N.m or N]: the smaller one of
    all rows and of `fast` ones (n, N); None where rows were skipped.
    """
    step, extra = -(-problem.blocks // MOST_ROWS), root[:, len(root) :]
    roots: list[Array] = [
        np.concatenate([_inverse_root(matrix + precision), extra], axis=1)
        for matrix in fitted.system.others[0]
    ]
    index: Indices = np.arange(0, problem.blocks, step, dtype=np.intp)
    error, lever = np.empty((2, problem.samples.joints, len(index)))
    counted = np.stack([np.ones_like(fast), fast | ~fast.any(axis=1, keepdims=True)])
    bends = np.zeros(counted.shape[:2])
    for rows, columns, torque in problem.chunks():
        part = slice(*np.searchsorted(index, (rows.start, rows.stop)))
        where = parts[index[part]]
        for k in np.unique(where):
            here = part.start + np.flatnonzero(where == k)
            x, tau = (values[..., index[here] - rows.start] for values in (columns, torque))
            values = fitted.values[min(k, len(fitted.values) - 1)]
            error[:, here] = tau - np.tensordot(values, x, axes=1)
            lever[:, here] = regions.leverage(roots[int(k)], x)
        # Second differences: the torque of a motion hardly bends from row to row.
        squares = np.square(np.diff(error[:, part], n=2, axis=1)) / 6.0
        bends += (squares * counted[..., index[part][1:-1]]).sum(axis=2)
    floor = np.sqrt((bends / counted.sum(axis=2)).min(axis=0)) if step == 1 else None
    return index, error, lever, floor


def _within(samples: Samples) -> Array:
    """(n) mean variance of the torque within a block, which its mean has lost [(N.m)^2 or N^2]."""
    tau = samples.tau[samples.rows]
    count = len(tau) // samples.block
    blocks = tau[: count * samples.block].reshape(count, samples.block, -1)
    return blocks.var(axis=1).mean(axis=0)


def _bands(speed: Array, slowest: Array) -> Indices:
    """(n, N) which band of `SPEEDS` speeds (n, N) lie in, by that from which a joint moves (n)."""
    shares = regions.SLOWEST * speed / slowest[:, None]
    return np.searchsorted(np.array(SPEEDS), shares, side="right")


def _by_speed(square: Array, bands: Indices) -> Array:
    """(2, n, B) means of squares (n, M) by band, and what stretches of time make unsure of them."""
    count = len(SPEEDS) + 1
    cells = regions.stretches(square.shape[1]) * count
    found = np.empty((2, len(square), count))
    for j, (values, own) in enumerate(zip(square, bands, strict=True)):
        rows, sums = (
            np.bincount(cells + own, each, regions.BLOCKS * count).reshape(regions.BLOCKS, count)
            + extra / regions.BLOCKS
            for each, extra in ((None, MEAN_ROWS), (values, MEAN_ROWS * values.mean()))
        )
        mean = sums.sum(axis=0) / rows.sum(axis=0)
        apart = regions.BLOCKS / (regions.BLOCKS - 1) * np.square(sums - rows * mean).sum(axis=0)
        found[:, j] = mean, np.sqrt(apart) / rows.sum(axis=0)
    return found


def _calibrated(
    sigma: Array, part: Indices, error: Array, lever: Array, moves: Mask
) -> dict[str, Array]:
    """The smallest scale of the leverage that the parts left out allow, then quantiles.

    A larger scale must raise the likelihood by more than its standard error over the parts.
    """
    parts = np.unique(part, return_inverse=True)[1]
    count = int(parts.max()) + 1
    n = len(sigma)
    scale, quantiles = np.ones(n), np.zeros((2, n, len(regions.LEVELS)))
    for j in range(n):
        square, floor = np.square(error[j]), max(float(sigma[j]), 1e-9) ** 2
        losses = np.empty((len(SCALES), count))
        for i, c in enumerate(SCALES):
            variance = floor + c**2 * lever[j]
            losses[i] = np.bincount(parts, np.log(variance) + square / variance, count)
        best = int(np.argmin(losses.sum(axis=1)))
        for i in range(best + 1):
            gain = losses[i] - losses[best]
            spread = np.sqrt(count / max(count - 1, 1) * np.square(gain - gain.mean()).sum())
            if gain.sum() <= spread:
                scale[j] = SCALES[i]
                break
        ratio = np.sqrt(square / (floor + scale[j] ** 2 * lever[j]))
        for k, some in enumerate((~moves[j], moves[j])):
            used = ratio[some] if some.sum() >= FEWEST_ROWS else ratio
            quantiles[k, j] = np.quantile(used, regions.LEVELS)
    return {"scale": scale, "quantiles": quantiles}
