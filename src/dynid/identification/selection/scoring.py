"""Left-out scores of friction choices, and the descent that improves them joint by joint."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.core import Array, Indices, InputError, Mask, scipy_part
from dynid.identification.bayesian import not_negative, published_prior
from dynid.identification.problem import IdentificationProblem, block_mean
from dynid.identification.selection import candidates, gram, regions
from dynid.identification.selection.candidates import EXTRA_WIDTH, CandidateColumns, JointChoice
from dynid.identification.selection.unseen import standing
from dynid.reduction import reduce_model
from dynid.regressor import TERMS, FrictionTerms, InverseDynamicModel, coupled_motors
from dynid.robot import RobotModel
from dynid.signals import ProcessingSettings, Samples, UniformSignals, delayed, samples_from

PRIOR_WEIGHTS = (1e-8, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0, 3.0, 10.0)
"""Weights of the published inertias that are tried, see `TowardPublished`."""
COARSE_WEIGHTS = (1e-8, 1e-3, 0.1, 3.0)
"""Those that are tried with every cut-off."""
GAIN_OF_TERM = 0.03
"""An extra column, or presliding, must lower the sum over joints of log RMS by this much, and by
a standard error over the parts left out."""
GAIN_OF_SHAPE = 0.01
"""So must a cut-off or a torque filter."""
ONE_ERROR = 0.8413
"""Of all parts that are left out, a share that lies below one standard error."""
LEAST_GAIN = 1e-3
PRIOR_OF_PLAIN, PRIOR_OF_GUESS = 1e-3, 1e-6
"""Weight of the published inertias until one is chosen, and of bodies that were guessed: these
may be wrong by many times their spread, and delays would compensate for it."""
PASSES = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Scores:
    """Left-out errors of one choice."""

    errors: tuple[Array, ...]
    """For each partition (n, F) sums of squared errors over the rows that count."""
    rows: tuple[Array, ...]
    """Their numbers (n, F)."""

    @property
    def value(self) -> float:
        """Mean over partitions of the sum over joints of log RMS."""
        return float(np.mean([np.log(rms).sum() for rms in self._rms()]))

    @property
    def noise(self) -> Array:
        """(n) RMS error."""
        return np.asarray(np.mean(self._rms(), axis=0), dtype=np.float64)

    def _rms(self) -> list[Array]:
        pairs = zip(self.errors, self.rows, strict=True)
        return [np.sqrt(e.sum(axis=1) / np.maximum(k.sum(axis=1), 1.0)) + 1e-9 for e, k in pairs]

    def gains(self, before: "Scores") -> list[tuple[float, float]]:
        """For each partition how much lower the sum of log RMS is, and its standard error."""
        return [gain_of(b, e) for e, b in zip(self.errors, before.errors, strict=True)]


def gain_of(before: Array, after: Array) -> tuple[float, float]:
    """How much lower the sum over joints of log RMS is, and its standard error over the parts.

    From sums of squared errors (n, F) by joint and part left out of two models.
    """
    total = np.maximum(before.sum(axis=1) + after.sum(axis=1), 1e-300)
    parts = ((before - after) / total[:, None]).sum(axis=0)
    count = len(parts)
    if count < 2:
        return float(parts.sum()), 0.0
    scatter = count / (count - 1) * np.square(parts - parts.mean()).sum()
    return float(parts.sum()), float(np.sqrt(scatter))


class CandidateBlocks:
    """Gram blocks of some settings, by the partitions of a purpose."""

    def __init__(
        self, blocks: gram.GramBlocks, groups: Indices, moving: Indices, counted: Indices
    ) -> None:
        self.all = blocks
        # One cell of the rows in motion.
        self.moving = blocks.merged(moving - 1)
        used = [np.where(counted, group, -1) for group in groups]
        self.parts = [
            (blocks.merged(group), blocks.merged(some))
            for group, some in zip(groups, used, strict=True)
            if group.max() > 0
        ]
        # Columns of blocks: rows of one joint.
        self.rows = float(blocks.rows.sum(axis=1).mean())


def _moved(signals: UniformSignals, late_s: float, circular: bool) -> UniformSignals:
    """Signals whose motion comes later [s], by less than a sample."""
    index = np.arange(len(signals.t) + circular, dtype=np.float64)

    def moved(values: Array) -> Array:
        whole = np.concatenate([values, values[:1]]) if circular else values
        spline = scipy_part("interpolate").CubicSpline(
            index, whole, bc_type="periodic" if circular else "not-a-knot"
        )
        at = index[: len(values)] - late_s * signals.rate_hz
        return np.asarray(spline(at), dtype=np.float64)

    qd = None if signals.qd is None else moved(signals.qd)
    return replace(signals, q=moved(signals.q), qd=qd)


class ScoreSearch:
    """Scores choices on the recordings; caches the blocks of the current settings."""

    def __init__(
        self,
        robot: RobotModel,
        frames: str,
        recordings: Sequence[UniformSignals],
        terms: FrictionTerms | None,
        *,
        presliding: bool,
        purpose: str,
    ) -> None:
        self.robot, self.recordings, self.given = robot, recordings, terms
        self.anywhere = purpose == "anywhere"
        fixed = terms or FrictionTerms()
        stepped = ("fc", "fca", "fs")
        shared = tuple(term for term in fixed.terms if term[0] not in stepped)
        levers = np.where(robot.prismatic, candidates.LEVER, 1.0)
        # What is given stays as it is; ours is that of joints that turn.
        speeds = np.broadcast_to(fixed.stribeck_velocity, levers.shape)
        speeds = speeds * levers if terms is None else speeds
        self.columns = CandidateColumns(
            stepped=tuple(term for term in fixed.terms if term[0] in stepped),
            extras=candidates.EXTRA_TERMS if terms is None else (),
            stribeck_velocity=tuple(speeds.tolist()),
            levers=levers,
            unit=levers,
            displacements=candidates.DISPLACEMENTS if presliding and terms is None else (),
        )
        self.base = reduce_model(
            InverseDynamicModel(
                robot=robot,
                frames=frames,
                friction=FrictionTerms(terms=shared or (("fv", None),), width=EXTRA_WIDTH),
            )
        )
        known = published_prior(self.base)
        self.prior = gram.Shrinkage(mean=known.mean, precision=known.precision)
        self.plain_prior = PRIOR_OF_PLAIN if robot.published.all() else PRIOR_OF_GUESS
        self.regions = regions.find_regions([r.q for r in recordings], robot.prismatic)
        self._cache: tuple[ProcessingSettings, CandidateBlocks] | None = None
        self._load: tuple[ProcessingSettings, Array] | None = None

    def blocks(self, settings: ProcessingSettings) -> CandidateBlocks:
        """Blocks of all candidates for one cut-off and velocity source."""
        if self._cache is None or self._cache[0] != settings:
            self._cache = (settings, self.summed(settings, self.columns))
        return self._cache[1]

    def plain_score(
        self, settings: ProcessingSettings, choices: Sequence[JointChoice] | None = None
    ) -> float:
        """Score of the paper's friction, or of the steps of choices, from their columns alone."""
        plain = [candidates.PLAIN_WIDTH] * self.robot.joints
        steps = [c.step for c in choices] if choices else plain
        columns = replace(self.columns, extras=())
        if choices is None:
            columns = replace(columns, displacements=())
        blocks = self.summed(settings, columns)
        places = [columns.places(j, step, frozenset()) for j, step in enumerate(steps)]
        picks = self.picks_at(places, columns)
        prior = self.prior.times(self.plain_prior)
        weights = gram.joint_weights(blocks.all, picks, prior)
        return min(self.scores(blocks, picks, weights, w).value for w in COARSE_WEIGHTS)

    def summed(
        self,
        settings: ProcessingSettings,
        columns: CandidateColumns,
        versions: Array | None = None,
        late_s: float = 0.0,
    ) -> CandidateBlocks:
        """Blocks of some columns, and of the torques with the delays (V, n) of some versions [s].

        None for those of the settings alone. The motion is moved later by `late_s` [s], which adds
        to the delays.
        """
        if versions is None:
            versions = np.array(settings.delays_s or (0.0,) * self.robot.joints)[None]
        decimated = replace(settings, decimate=True)
        processed = [samples_from(signals, decimated) for signals in self.recordings]
        inertias = None
        if candidates.LOAD in columns.extras:
            if self._load is None or self._load[0] != settings:
                found = candidates.load_inertias(
                    self.base.model, processed, EXTRA_WIDTH, self.plain_prior
                )
                self._load = (settings, found)
            inertias = self._load[1]
        used = [samples.dq[samples.rows] for samples in processed]
        moving = regions.moving_rows(used, processed[0].rate_hz)
        pairs = zip(processed, moving, strict=True)
        labels = [self._labels(samples, k, moves) for k, (samples, moves) in enumerate(pairs)]
        if late_s:
            moved = [_moved(s, late_s, settings.period_s is not None) for s in self.recordings]
            processed = [samples_from(signals, decimated) for signals in moved]
        groups = np.concatenate(labels, axis=2)
        for group in groups[:-1]:
            group[:] = regions.divided(group[0], groups[-1].T > 0, groups[-2, 0])
        if not groups[:-1].any():
            raise InputError(
                "the arm's poses are too much alike: no part of the recordings can be left out",
                next_step="Record a motion that moves every joint.",
            )
        n = self.robot.joints
        groups = groups.reshape(len(groups), -1)
        sizes = tuple((groups.max(axis=1) + 1).tolist())
        # Numbers sort faster than columns, in the same order.
        codes, cells = np.unique(np.ravel_multi_index(tuple(groups), sizes), return_inverse=True)
        keys = np.stack(np.unravel_index(codes, sizes))
        width = self.base.rank + len(columns.positive) + len(versions)
        counted = keys[-1] if self.anywhere else np.ones(keys.shape[1], dtype=np.intp)
        starts = np.cumsum([0, *(label.shape[2] for label in labels)])
        parts = (
            (slice(first + rows.start, first + rows.stop), values)
            for first, signals, samples in zip(starts, self.recordings, processed, strict=False)
            for rows, values in self._parts(signals, samples, settings, columns, versions, inertias)
        )
        blocks = gram.gram_blocks(parts, cells.reshape(n, -1), keys.shape[1], width)
        return CandidateBlocks(blocks, keys[:-1], keys[-1], counted)

    def _labels(self, samples: Samples, recording: int, moves: Mask) -> Indices:
        """(K, n, N) groups of rows: regions or stretches, recording, whether the joint moves."""
        used, n = samples.rows, samples.joints
        count = (used.stop - used.start) // samples.block
        if count < 4 * regions.BLOCKS:
            raise InputError(
                "the record is too short to choose settings from",
                value=samples.count,
                limit=f"at least {4 * regions.BLOCKS * samples.block} samples",
                next_step="Use --preset paper, or a longer record.",
            )
        q = samples.q[used][:: samples.block][:count]
        moves = moves[:: samples.block][:count]
        parts = [regions.stretches(count)]
        if self.anywhere:
            parts = [self.regions.labels(q, k) for k in (0, 1)]
        each = [*parts, np.full(count, recording)]
        return np.stack([*(np.tile(part, (n, 1)) for part in each), moves.T.astype(np.intp)])

    def _parts(
        self,
        signals: UniformSignals,
        samples: Samples,
        settings: ProcessingSettings,
        columns: CandidateColumns,
        versions: Array,
        inertias: Array | None,
    ) -> Iterator[tuple[slice, Array]]:
        """Rows covered and (m, n, T): shared columns, candidate columns, torques by delay."""
        rate = signals.rate_hz
        kept = np.round(samples.t * rate).astype(int)
        circular = settings.period_s is not None
        first, block = samples.rows.start, samples.block
        # The torques come in several versions: only what is added to them is wanted of the problem.
        still = replace(samples, tau=np.zeros(samples.q.shape))
        problem = IdentificationProblem(base=self.base, samples=still)
        used = kept[first : first + problem.blocks * block]
        torques = np.stack(
            [
                block_mean(delayed(signals.torque, rate, tuple(d), circular)[used].T, block)
                for d in versions.tolist()
            ]
        )
        load = np.zeros(samples.q.T.shape)
        if inertias is not None:
            load = candidates.load_size(self.base.model, samples, inertias)
        states = columns.states(samples)
        for rows, stack, known in problem.chunks():
            part = slice(first + block * rows.start, first + block * rows.stop)
            wide, inner = samples.surroundings(part)
            each = zip(samples.dq[wide].T, load[:, wide], states[..., wide], strict=True)
            own = np.stack([columns.values(j, *joint) for j, joint in enumerate(each)], axis=1)
            own = block_mean(samples.as_recorded(own, wide)[..., inner], block)
            yield rows, np.concatenate([stack, own, torques[..., rows] + known])

    def picks_at(
        self,
        places: Sequence[tuple[int, ...]],
        columns: CandidateColumns,
        versions: Sequence[int] | None = None,
    ) -> tuple[gram.Pick, ...]:
        """What each joint uses of blocks.

        Args:
            places: Of its columns, among `columns`.
            columns: What the blocks hold.
            versions: Of its torque; None for the first.
        """
        rank = self.base.rank
        common, first = np.arange(rank), rank
        positive = columns.positive
        signs = not_negative(self.base.model)[list(self.base.independent)]
        picks: list[gram.Pick] = []
        for place, version in zip(places, versions or [0] * len(places), strict=True):
            own = np.arange(first, first + len(place))
            first += len(place)
            there = rank + np.array(place, dtype=np.intp)
            picks.append(
                gram.Pick(
                    unknowns=np.concatenate([common, own]),
                    columns=np.concatenate([common, there]),
                    torque=rank + len(positive) + version,
                    positive=np.concatenate([signs, positive[list(place)]]),
                )
            )
        return tuple(picks)

    def picks(self, choices: tuple[JointChoice, ...]) -> tuple[gram.Pick, ...]:
        """The candidate columns that choices stand for."""
        places = [self.columns.places(j, c.step, c.terms) for j, c in enumerate(choices)]
        return self.picks_at(places, self.columns)

    def weights(
        self, blocks: CandidateBlocks, choices: tuple[JointChoice, ...], prior: float
    ) -> Array:
        """(n) weights of the joints."""
        return gram.joint_weights(blocks.all, self.picks(choices), self.prior.times(prior))

    def scores(
        self,
        blocks: CandidateBlocks,
        picks: tuple[gram.Pick, ...],
        weights: Array,
        prior: float,
    ) -> Scores:
        """Left-out errors of the columns that are picked."""
        shrinkage = self.prior.times(prior * blocks.rows)
        errors: list[Array] = []
        rows: list[Array] = []
        for whole, counted in blocks.parts:
            values = gram.NormalEquations(whole, picks, weights).left_out(shrinkage)
            errors.append(gram.NormalEquations(counted, picks, weights).square_errors(values))
            rows.append(counted.rows)
        return Scores(errors=tuple(errors), rows=tuple(rows))

    def prior_weights(
        self, settings: ProcessingSettings, choices: tuple[JointChoice, ...], prior: float
    ) -> tuple[tuple[float, ...], Scores]:
        """Weights of the prior that score as well as the best to a standard error, and the last.

        The error is Student's. Of all that are near, the strongest is taken (Breiman, Friedman,
        Olshen and Stone 1984): what the recordings cannot tell, the prior says. The joints are
        weighted with one before.
        """
        blocks = self.blocks(settings)
        weights = self.weights(blocks, choices, prior)
        picks = self.picks(choices)
        scored = [self.scores(blocks, picks, weights, w) for w in PRIOR_WEIGHTS]
        best = int(np.argmin([s.value for s in scored]))
        # An error of few parts is itself unsure.
        freedom = [max(each.shape[1] - 1, 1) for each in scored[best].errors]
        wide = scipy_part("special").stdtrit(freedom, ONE_ERROR).tolist()
        near = [
            k
            for k in range(best, len(scored))
            if all(
                -gain <= w * error
                for w, (gain, error) in zip(wide, scored[k].gains(scored[best]), strict=True)
            )
        ]
        return tuple(PRIOR_WEIGHTS[k] for k in near), scored[near[-1]]

    def descend(
        self,
        settings: ProcessingSettings,
        choices: tuple[JointChoice, ...],
        prior: float,
        joints: Sequence[int] | None = None,
    ) -> tuple[tuple[JointChoice, ...], Scores]:
        """Improve one joint at a time until nothing is clearly better on every partition.

        Of all joints, or of some.
        """
        blocks = self.blocks(settings)
        weights = self.weights(blocks, choices, prior)
        now = self.scores(blocks, self.picks(choices), weights, prior)
        for _ in range(PASSES):
            before = choices
            for j in range(self.robot.joints) if joints is None else joints:
                found: tuple[float, JointChoice, Scores] | None = None
                for trial in self.columns.moves(choices[j], j in coupled_motors(self.robot)):
                    moved = (*choices[:j], trial, *choices[j + 1 :])
                    scored = self.scores(blocks, self.picks(moved), weights, prior)
                    price = GAIN_OF_TERM * (trial.size - choices[j].size)
                    # A motion that is repeated needs no proof that a term transfers.
                    doubt = float(price > 0 and self.anywhere)
                    gain = min(g - doubt * e for g, e in scored.gains(now)) - price
                    if gain > LEAST_GAIN and (found is None or gain > found[0]):
                        found = (gain, trial, scored)
                if found is not None:
                    choices, now = (*choices[:j], found[1], *choices[j + 1 :]), found[2]
            if choices == before:
                break
        return choices, now

    def friction(
        self,
        settings: ProcessingSettings,
        choices: tuple[JointChoice, ...],
        prior: float,
    ) -> FrictionTerms:
        """The friction terms of the choices, without those that no positive parameter explains."""
        found = candidates.chosen_friction(choices, self.columns, self.given)
        if self.given is not None:
            return found
        blocks = self.blocks(settings)
        picks, weights = self.picks(choices), self.weights(blocks, choices, prior)
        system = gram.NormalEquations(blocks.all, picks, weights)
        values = system.whole(self.prior.times(prior * blocks.rows))[0]
        model = self.base.model
        dropped = {
            model.names[k]
            for value, k in zip(values, self.base.independent, strict=False)
            if not_negative(model)[k] and value <= 0
        }
        for j, pick in enumerate(picks):
            # The Coulomb column stands first among a joint's own.
            if len(pick.unknowns) > self.base.rank and values[pick.unknowns[self.base.rank]] <= 0:
                dropped.add(f"Fc{j + 1}")
        # Of a joint that stands still they would be made of noise.
        reach = np.ptp(np.concatenate([r.q for r in self.recordings]), axis=0)
        still = np.flatnonzero(standing(self.robot, reach)) + 1
        dropped |= {f"{term.capitalize()}{j}" for term in (*TERMS, candidates.LOAD) for j in still}
        return found.without(dropped, self.robot.joints)
