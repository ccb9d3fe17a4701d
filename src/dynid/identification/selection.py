"""`--preset best`: choose cut-off, velocities, delays and friction inside the record.

Every choice is scored by block cross-validation against the measured torque of the
identification record alone. A variant that is not clearly better than a simpler one loses.

The search behind `--preset best`: one joint's choice at a time, scored by cross-validation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.core import Array, InputError, Progress, silent
from dynid.identification.candidates import (
    DISPLACEMENTS,
    EXTRA_TERMS,
    EXTRA_WIDTH,
    GAIN_OF_SHAPE,
    LOAD,
    WIDTHS,
    CandidateColumns,
    JointChoice,
    Moves,
    chosen_friction,
    load_size,
)
from dynid.identification.crossvalidation import BLOCKS, Candidates, Variant, accumulate_candidates
from dynid.identification.least_squares import PRIOR_GAIN
from dynid.identification.problem import ILL_CONDITIONED, motion_condition_number
from dynid.reduction import reduce_model
from dynid.regressor import FrictionTerms, InverseDynamicModel
from dynid.robot import RobotModel
from dynid.signals import (
    NYQUIST_SHARE,
    ORDERS,
    ProcessingSettings,
    TorqueFilter,
    UniformSignals,
    delayed,
    rest_share,
    samples_from,
    torque_end,
)

MOST_REST = 0.005
"""Share of a record at rest above which `PAIR` is not tried."""
DELAY_STEPS = (-3, -2, -1, 0, 1, 2, 3)
"""Of a joint, from what all joints have in common."""
COMMON_STEPS = 6
"""Such steps between common delays that are tried: the joints' own reach half as far."""
LONGEST_COMMON_DELAY_S = 0.08
SHORTEST_DELAY_STEP_S = 0.002
PASSES = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Descent:
    """Where a descent ended."""

    score: float
    """Sum over joints of log RMS of the held-out error [log N.m]."""
    choices: tuple[JointChoice, ...]
    noise: Array
    """(n) held-out RMS error [N.m or N]."""


class Search:
    """Scores joint choices on one record; caches the products of the current settings."""

    def __init__(
        self,
        robot: RobotModel,
        frames: str,
        signals: UniformSignals,
        terms: FrictionTerms | None,
        *,
        presliding: bool = True,
    ) -> None:
        self.robot = robot
        self.frames = frames
        self.signals = signals
        self.given = terms
        self.delay_step = max(1.0 / signals.rate_hz, SHORTEST_DELAY_STEP_S)
        self.delays = tuple(k * self.delay_step for k in DELAY_STEPS)
        self.no_delay = DELAY_STEPS.index(0)
        fixed = terms or FrictionTerms()
        shared = tuple(
            (term, joints) for term, joints in fixed.terms if term not in ("fc", "fca", "fs")
        )
        self.stepped = tuple(t for t in fixed.terms if t[0] in ("fc", "fca", "fs"))
        self.extras = EXTRA_TERMS if terms is None else ()
        self.presliding = presliding and terms is None
        # Designs that are repeated start and end at rest.
        self.restless = signals.noise is None and rest_share(signals) < MOST_REST
        self.base = reduce_model(
            InverseDynamicModel(
                robot=robot,
                frames=frames,
                friction=FrictionTerms(terms=shared or (("fv", None),), width=EXTRA_WIDTH),
            )
        )
        self.speed = fixed.stribeck_velocity
        self._cache: tuple[ProcessingSettings, Candidates] | None = None

    def candidates(self, settings: ProcessingSettings) -> Candidates:
        """Products for one choice of cut-off and velocity source."""
        if self._cache is None or self._cache[0] != settings:
            self._cache = (settings, self._products(settings, self.columns, self.delays))
        return self._cache[1]

    def plain_scores(
        self, settings: ProcessingSettings, delays: tuple[float, ...] = (0.0,)
    ) -> list[float]:
        """`score` of the paper's friction, from its own columns alone, one a common delay [s]."""
        columns = CandidateColumns(
            stepped=self.stepped, extras=(), stribeck_velocity=self.speed, presliding=False
        )
        candidates = self._products(settings, columns, delays)
        places = [columns.places(j, 0, frozenset()) for j in range(self.robot.joints)]
        return [
            _balanced(candidates, tuple(Variant(columns=p, torque=k) for p in places), None)[0]
            for k in range(len(delays))
        ]

    def common_delay(self, settings: ProcessingSettings) -> float:
        """What all torques are late by [s], judged by the paper's friction."""
        step = COMMON_STEPS * self.delay_step
        most = int(LONGEST_COMMON_DELAY_S / step)
        late = tuple(k * step for k in range(-most, most + 1))
        return late[int(np.argmin(self.plain_scores(settings, late)))]

    def look_about(self, late: float) -> None:
        """Let the joints' delays lie about what all have in common [s]."""
        self.delays = tuple(late + k * self.delay_step for k in DELAY_STEPS)
        self._cache = None

    def at_an_end(self, choices: tuple[JointChoice, ...]) -> bool:
        """Whether half of the joints want to be later, or earlier, than is tried."""
        ends = (0, len(self.delays) - 1)
        return any(2 * sum(c.delay == end for c in choices) >= len(choices) for end in ends)

    def _products(
        self, settings: ProcessingSettings, columns: CandidateColumns, delays: tuple[float, ...]
    ) -> Candidates:
        samples = samples_from(self.signals, replace(settings, decimate=True))
        if samples.count < 4 * BLOCKS * samples.block:
            raise InputError(
                "the record is too short to choose settings from",
                value=samples.count,
                limit=f"at least {4 * BLOCKS} samples",
                next_step="Use --preset paper, or a longer record.",
            )
        rate = self.signals.rate_hz
        kept = np.round(samples.t * rate).astype(int)
        circular = settings.period_s is not None
        torques = [
            delayed(self.signals.torque, rate, (delay,) * self.robot.joints, circular)[kept].T
            for delay in delays
        ]
        load = np.zeros(samples.q.T.shape)
        if LOAD in columns.extras:
            load = load_size(self.robot, self.frames, samples, EXTRA_WIDTH)
        states = columns.states(samples)
        joints = zip(samples.dq.T, load, states, strict=True)
        own = np.stack([columns.values(*joint) for joint in joints])
        return accumulate_candidates(
            self.base, samples, own, np.stack(torques, axis=1), columns.positive
        )

    @property
    def columns(self) -> CandidateColumns:
        """The columns that a joint may be given."""
        return CandidateColumns(
            stepped=self.stepped,
            extras=self.extras,
            stribeck_velocity=self.speed,
            presliding=self.presliding,
        )

    def score(
        self,
        candidates: Candidates,
        choices: tuple[JointChoice, ...],
        weights: Array | None = None,
    ) -> tuple[float, Array, Array]:
        """Sum of log RMS, held-out RMS (n), and the weights used (n)."""
        return _balanced(candidates, self.variants(choices), weights)

    def variants(self, choices: tuple[JointChoice, ...]) -> tuple[Variant, ...]:
        """The candidate columns and torques that choices stand for."""
        places = self.columns.places
        return tuple(
            Variant(columns=places(j, choice.step, choice.terms), torque=choice.delay)
            for j, choice in enumerate(choices)
        )

    def descend(
        self,
        settings: ProcessingSettings,
        choices: tuple[JointChoice, ...],
        *,
        presliding: bool = True,
    ) -> Descent:
        """Improve one joint at a time until nothing is clearly better."""
        candidates = self.candidates(settings)
        moves = self.moves(settings, presliding=presliding and self.presliding)
        score, noise, weights = self.score(candidates, choices)
        for _ in range(PASSES):
            before = choices
            for j in range(self.robot.joints):
                for trial in moves.after(choices[j]):
                    moved = (*choices[:j], trial, *choices[j + 1 :])
                    value = self.score(candidates, moved, weights)[0]
                    if value < score - moves.price(choices[j], trial):
                        score, choices = value, moved
            score, noise, weights = self.score(candidates, choices)
            if choices == before:
                break
        return Descent(score=score, choices=choices, noise=noise)

    def moves(self, settings: ProcessingSettings, *, presliding: bool) -> Moves:
        """Which choices a joint has under settings."""
        return Moves(
            extras=self.extras,
            widths=len(WIDTHS) if self.stepped else 1,
            delays=len(self.delays) if settings.delays_s is None else 0,
            no_delay=self.no_delay,
            presliding=presliding,
            pair=self.restless,
        )

    def settings(
        self, trial: ProcessingSettings, choices: tuple[JointChoice, ...]
    ) -> ProcessingSettings:
        """The settings with the delays of the choices."""
        delays = tuple(self.delays[choice.delay] for choice in choices)
        if trial.delays_s is not None or not any(delays):
            return trial
        return replace(trial, delays_s=delays)

    def friction(self, choices: tuple[JointChoice, ...]) -> FrictionTerms:
        """The friction terms of the choices."""
        return chosen_friction(choices, self.extras, self.given, self.speed)


def _balanced(
    candidates: Candidates, variants: tuple[Variant, ...], weights: Array | None
) -> tuple[float, Array, Array]:
    """See `Search.score`; weights that are not given are those of the fit's own residuals."""
    if weights is None:
        weights = np.ones(len(variants))
        for _ in range(4):
            _, training = candidates.score(variants, weights)
            weights = 1.0 / np.sqrt(training)
    held_out, _ = candidates.score(variants, weights)
    return float(np.log(held_out).sum() / 2), np.sqrt(held_out), weights


CUTOFFS_HZ = (2.0, 3.0, 4.5, 7.0, 10.0, 15.0, 22.0, 33.0, 50.0, 75.0)
"""Cut-offs that are tried, as far as the record's length and rate allow."""
PRIOR_GAINS = (PRIOR_GAIN, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
"""Priors that are tried on an ill-conditioned record."""
SHORTEST_RECORD = 10.0
"""Periods of the torque filter's cut-off that a record must hold."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """What was chosen, and its score."""

    settings: ProcessingSettings
    friction: FrictionTerms
    score: float
    """Sum over joints of log RMS of the held-out error [log N.m]."""
    noise: Array
    """(n) held-out RMS error [N.m or N]."""
    prior_gain: float
    """Strength of the weak prior; the default unless the record is ill-conditioned."""
    ill_conditioned: bool
    """Whether the motion does not tell the parameters apart."""


def select(
    robot: RobotModel,
    frames: str,
    signals: UniformSignals,
    settings: ProcessingSettings,
    *,
    terms: FrictionTerms | None = None,
    smoothed: bool = False,
    presliding: bool = True,
    progress: Progress | None = None,
) -> Selection:
    """Choose settings and friction terms by cross-validation inside one record.

    Args:
        robot: The robot.
        frames: Parameter frames.
        signals: The identification record on a uniform grid, folded if it is periodic.
        settings: Settings given by the user: what is set there stays.
        terms: Terms given by the user; None to choose them.
        smoothed: Whether the torque was smoothed before it was written: what did it is found.
        presliding: Whether friction may build up over a displacement.
        progress: Told what is being tried and how far it is (0 to 1).

    Raises:
        InputError: The record is too short to leave blocks out.
    """
    search = Search(robot, frames, signals, terms, presliding=presliding)
    plain = (JointChoice(0, frozenset(), search.no_delay),) * robot.joints
    tell = progress or silent
    trials = _settings_to_try(signals, settings)
    scored: list[tuple[float, int]] = []
    for index, trial in enumerate(trials):
        tell("cut-off", 0.4 * index / len(trials))
        scored.append((search.plain_scores(trial)[0], index))
    best = min(scored)[1]
    if smoothed and settings.torque_filter is None:
        tell("what smoothed the torque", 0.3)
        passed = _passed_by(search, trials[best])
        trials = tuple(replace(trial, torque_filter=passed) for trial in trials)
    # Blocks of an ill-conditioned record do not show how a richer model does on another motion.
    ill = motion_condition_number(robot, frames, signals, settings) > ILL_CONDITIONED
    if ill:
        search.extras, search.presliding = (), False
    tell("friction and delays", 0.4)
    found = _best_descent(search, trials[best], plain)
    if settings.delays_s is None and search.at_an_end(found.choices):
        found = _aligned(search, trials[best], plain, found)
    # Friction chosen, the cut-off may move to a neighbour.
    for near in _neighbours(trials, best):
        tell("cut-off", 0.75)
        candidates = search.candidates(trials[near])
        clear = found.score - GAIN_OF_SHAPE * robot.joints
        if search.score(candidates, found.choices)[0] < clear:
            other = search.descend(trials[near], found.choices)
            if other.score < found.score:
                found, best = other, near
    choices, score, noise = found.choices, found.score, found.noise
    gain = PRIOR_GAIN
    if ill:
        gain, score, noise = _prior(search, trials[best], choices)
    tell("done", 1.0)
    return Selection(
        settings=search.settings(trials[best], choices),
        friction=search.friction(choices),
        score=score,
        noise=noise,
        prior_gain=gain,
        ill_conditioned=ill,
    )


def _best_descent(
    search: Search, settings: ProcessingSettings, plain: tuple[JointChoice, ...]
) -> Descent:
    """The best of three descents.

    Presliding and the terms that stand in for it hide each other: one joint at a time, none gives
    way. So joints begin without it; then with it beside what was found; then with it alone.
    """
    price = search.moves(settings, presliding=False).price

    def cost(way: Descent) -> float:
        return way.score + sum(map(price, plain, way.choices))

    best = search.descend(settings, plain, presliding=False)
    if not search.presliding:
        return best
    start = tuple(replace(choice, displacement=0) for choice in best.choices)
    best = min(best, search.descend(settings, start), key=cost)
    if all(choice.displacement is None for choice in best.choices):
        return best
    start = tuple(replace(choice, displacement=len(DISPLACEMENTS) // 2) for choice in plain)
    other = search.descend(settings, start)
    return other if cost(other) < cost(best) - GAIN_OF_SHAPE * len(plain) else best


def _aligned(
    search: Search, settings: ProcessingSettings, plain: tuple[JointChoice, ...], found: Descent
) -> Descent:
    """The descent with delays about what all torques are late by, where it is clearly better.

    Friction that builds up looks late too: so this is tried only where delays came to an end.
    """
    late = search.common_delay(settings)
    if late == 0.0:
        return found
    search.look_about(late)
    other = _best_descent(search, settings, plain)
    if other.score < found.score - GAIN_OF_SHAPE * len(plain):
        return other
    search.look_about(0.0)
    return found


def _prior(
    search: Search, settings: ProcessingSettings, choices: tuple[JointChoice, ...]
) -> tuple[float, float, Array]:
    """The best prior for choices, its score and held-out RMS (n)."""
    candidates = search.candidates(settings)
    weights = search.score(candidates, choices)[2]
    variants = search.variants(choices)
    errors = [candidates.score(variants, weights, gain)[0] for gain in PRIOR_GAINS]
    scores = [float(np.log(error).sum() / 2) for error in errors]
    best = int(np.argmin(scores))
    return PRIOR_GAINS[best], scores[best], np.sqrt(errors[best])


def _passed_by(search: Search, trial: ProcessingSettings) -> TorqueFilter | None:
    """The filter that the torque has passed, if one explains it better than none.

    Cut-offs up to where the torque ends, then finer beside the best, then orders: an error in
    the cut-off costs more than one in the order.
    """
    known: dict[TorqueFilter | None, float] = {}

    def score(passed: TorqueFilter | None) -> float:
        if passed not in known:
            known[passed] = search.plain_scores(replace(trial, torque_filter=passed))[0]
        return known[passed]

    highest = torque_end(search.signals)
    lowest = max(highest / 8, SHORTEST_RECORD / float(np.ptp(search.signals.t)))
    cutoffs = np.geomspace(min(lowest, highest / 2), highest, 6)
    found = min((TorqueFilter(cutoff_hz=float(f), order=2) for f in cutoffs), key=score)
    step = float(cutoffs[1] / cutoffs[0])
    for _ in range(3):
        step = step**0.5
        beside = (replace(found, cutoff_hz=found.cutoff_hz * r) for r in (1.0, step, 1 / step))
        found = min(beside, key=score)
        near = (k for k in ORDERS if abs(k - found.order) <= 1)
        found = min((replace(found, order=order) for order in near), key=score)
    if score(found) > score(None) - GAIN_OF_SHAPE * search.robot.joints:
        return None
    return found


def _settings_to_try(
    signals: UniformSignals, settings: ProcessingSettings
) -> tuple[ProcessingSettings, ...]:
    highest = NYQUIST_SHARE * signals.rate_hz / 2
    if settings.cutoff_hz is not None:
        cutoffs = [settings.cutoff_hz]
    else:
        lowest = 10.0 / (signals.t[-1] - signals.t[0])
        cutoffs = [f for f in CUTOFFS_HZ if lowest <= f <= highest] or [highest]
    exact = signals.qd is None or settings.period_s is not None
    sources = ["position"] if exact else ["position", "measured"]
    return tuple(
        replace(settings, cutoff_hz=cutoff, velocity=source)
        for source in sources
        for cutoff in cutoffs
    )


def _neighbours(trials: tuple[ProcessingSettings, ...], index: int) -> list[int]:
    return [
        k
        for k in (index - 1, index + 1)
        if 0 <= k < len(trials) and trials[k].velocity == trials[index].velocity
    ]
