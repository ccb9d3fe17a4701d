"""`--preset best`: choose cut-off, velocities, delays and friction inside the record.

Every choice is scored by block cross-validation against the measured torque of the
identification record alone. A variant that is not clearly better than a simpler one loses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.identification.crossvalidation import (
    BLOCKS,
    Candidates,
    Variant,
    accumulate_candidates,
)
from dynid.identification.least_squares import PRIOR_GAIN
from dynid.reduction.base import reduce_model
from dynid.regressor.blocks import smooth_sign
from dynid.regressor.model import InverseDynamicModel
from dynid.regressor.terms import TERMS, FrictionTerms
from dynid.robot.model import RobotModel
from dynid.signals.filters import NYQUIST_SHARE
from dynid.signals.process import delayed, samples_from
from dynid.signals.resample import UniformSignals
from dynid.signals.samples import ProcessingSettings

WIDTHS = (0.001, 0.003, 0.01, 0.02, 0.04, 0.07, 0.12, 0.2)
"""Widths of the Coulomb step that are tried [rad/s]."""
EXTRA_TERMS = ("fo", "fca", "fva", "fs", "fr")
"""Terms that a joint may take beside the paper's."""
EXTRA_WIDTH = 0.01
"""Width inside candidate columns that have a step, until the joint's own is known [rad/s]."""
CUTOFFS_HZ = (2.0, 3.0, 4.5, 7.0, 10.0, 15.0, 22.0, 33.0, 50.0, 75.0)
"""Cut-offs that are tried, as far as the record's length and rate allow."""
ILL_CONDITIONED = 1000.0
"""Condition number of the scaled problem above which friction stays plain: blocks of such a
record do not show how a richer model will do on another motion."""
PRIOR_GAINS = (PRIOR_GAIN, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
"""Priors that are tried on such a record."""
DELAY_STEPS = (-3, -2, -1, 1, 2, 3)
SHORTEST_DELAY_STEP_S = 0.002
GAIN_OF_TERM = 0.03
"""An extra column must lower the sum over joints of log RMS by this much."""
GAIN_OF_SHAPE = 0.01
"""So must a change of width, delay, cut-off or velocity source."""
PASSES = 3

Progress = Callable[[str, float], None]


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


@dataclass(frozen=True, slots=True)
class _JointChoice:
    width: int
    terms: frozenset[int]
    delay: int


def select(
    robot: RobotModel,
    frames: str,
    signals: UniformSignals,
    settings: ProcessingSettings,
    *,
    terms: FrictionTerms | None = None,
    progress: Progress | None = None,
) -> Selection:
    """Choose settings and friction terms by cross-validation inside one record.

    Args:
        robot: The robot.
        frames: Parameter frames.
        signals: The identification record on a uniform grid, folded if it is periodic.
        settings: Settings given by the user: what is set there stays.
        terms: Terms given by the user; None to choose them.
        progress: Told what is being tried and how far it is (0 to 1).

    Raises:
        InputError: The record is too short to leave blocks out.
    """
    search = _Search(robot, frames, signals, terms)
    plain = (_JointChoice(0, frozenset(), search.no_delay),) * robot.joints
    tell = progress or _silent
    trials = _settings_to_try(signals, settings)
    scored: list[tuple[float, int]] = []
    for index, trial in enumerate(trials):
        tell("cut-off", 0.4 * index / len(trials))
        scored.append((search.score(search.candidates(trial), plain)[0], index))
    best = min(scored)[1]
    choices = plain
    ill = search.candidates(trials[best]).condition(search.variants(plain)) > ILL_CONDITIONED
    if ill:
        search.extras = ()
    tell("friction and delays", 0.4)
    score, choices, noise = search.descend(trials[best], choices)
    # Friction chosen, the cut-off may move to a neighbour.
    for near in _neighbours(trials, best):
        tell("cut-off", 0.75)
        candidates = search.candidates(trials[near])
        if search.score(candidates, choices)[0] < score - GAIN_OF_SHAPE * robot.joints:
            better, moved, spread = search.descend(trials[near], choices)
            if better < score:
                score, choices, noise, best = better, moved, spread, near
    gain = PRIOR_GAIN
    if ill:
        gain, score, noise = search.prior(trials[best], choices)
    tell("done", 1.0)
    return Selection(
        settings=search.settings(trials[best], choices),
        friction=search.friction(choices),
        score=score,
        noise=noise,
        prior_gain=gain,
    )


def _silent(_what: str, _share: float) -> None:
    """Progress that nobody watches."""


class _Search:
    """Scores joint choices on one record; caches the products of the current settings."""

    def __init__(
        self, robot: RobotModel, frames: str, signals: UniformSignals, terms: FrictionTerms | None
    ) -> None:
        self.robot = robot
        self.signals = signals
        self.given = terms
        step = max(1.0 / signals.rate_hz, SHORTEST_DELAY_STEP_S)
        self.delays = tuple(sorted(k * step for k in (*DELAY_STEPS, 0)))
        self.no_delay = self.delays.index(0.0)
        fixed = terms or FrictionTerms()
        shared = tuple(
            (term, joints) for term, joints in fixed.terms if term not in ("fc", "fca", "fs")
        )
        self.stepped = tuple(t for t in fixed.terms if t[0] in ("fc", "fca", "fs"))
        self.extras = EXTRA_TERMS if terms is None else ()
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
        if self._cache is not None and self._cache[0] == settings:
            return self._cache[1]
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
            for delay in self.delays
        ]
        own = np.stack([self._own_columns(column) for column in samples.dq.T])
        result = accumulate_candidates(
            self.base,
            (samples.q, samples.dq, samples.ddq),
            own,
            np.stack(torques, axis=1),
            samples.block,
        )
        self._cache = (settings, result)
        return result

    def _own_columns(self, dq: Array) -> Array:
        """(c, N): one step a width for each stepped term, then the extra terms."""
        stepped = [
            _term_column(term, dq, width, self.speed)
            for term, _ in self.stepped
            for width in WIDTHS
        ]
        extra = [_term_column(term, dq, EXTRA_WIDTH, self.speed) for term in self.extras]
        return np.array([*stepped, *extra])

    def variants(self, choices: tuple[_JointChoice, ...]) -> tuple[Variant, ...]:
        """The candidate columns and torques that choices stand for."""
        return tuple(self._variant(j, choice) for j, choice in enumerate(choices))

    def _variant(self, joint: int, choice: _JointChoice) -> Variant:
        steps = [
            k * len(WIDTHS) + choice.width
            for k, (_, joints) in enumerate(self.stepped)
            if joints is None or joint in joints
        ]
        first = len(self.stepped) * len(WIDTHS)
        extras = [first + k for k in sorted(choice.terms)]
        return Variant(columns=(*steps, *extras), torque=choice.delay)

    def score(
        self,
        candidates: Candidates,
        choices: tuple[_JointChoice, ...],
        weights: Array | None = None,
    ) -> tuple[float, Array, Array]:
        """Sum of log RMS, held-out RMS (n), and the weights used (n)."""
        variants = self.variants(choices)
        if weights is None:
            weights = np.ones(len(choices))
            for _ in range(4):
                _, training = candidates.score(variants, weights)
                weights = 1.0 / np.sqrt(training)
        held_out, _ = candidates.score(variants, weights)
        return float(np.log(held_out).sum() / 2), np.sqrt(held_out), weights

    def descend(
        self, settings: ProcessingSettings, choices: tuple[_JointChoice, ...]
    ) -> tuple[float, tuple[_JointChoice, ...], Array]:
        """Improve one joint at a time until nothing is clearly better."""
        candidates = self.candidates(settings)
        score, noise, weights = self.score(candidates, choices)
        for _ in range(PASSES):
            before = choices
            for j in range(self.robot.joints):
                for trial in self._moves(choices[j], settings):
                    moved = (*choices[:j], trial, *choices[j + 1 :])
                    value = self.score(candidates, moved, weights)[0]
                    if value < score - _price(choices[j], trial, self.no_delay):
                        score, choices = value, moved
            score, noise, weights = self.score(candidates, choices)
            if choices == before:
                break
        return score, choices, noise

    def prior(
        self, settings: ProcessingSettings, choices: tuple[_JointChoice, ...]
    ) -> tuple[float, float, Array]:
        """The best prior for choices, its score and held-out RMS (n)."""
        candidates = self.candidates(settings)
        weights = self.score(candidates, choices)[2]
        variants = self.variants(choices)
        errors = [candidates.score(variants, weights, gain)[0] for gain in PRIOR_GAINS]
        scores = [float(np.log(error).sum() / 2) for error in errors]
        best = int(np.argmin(scores))
        return PRIOR_GAINS[best], scores[best], np.sqrt(errors[best])

    def _moves(self, now: _JointChoice, settings: ProcessingSettings) -> list[_JointChoice]:
        widths = range(len(WIDTHS)) if self.stepped else range(1)
        moves = [replace(now, width=k) for k in widths]
        if settings.delays_s is None:
            moves += [replace(now, delay=k) for k in range(len(self.delays))]
        for term in range(len(self.extras)):
            toggled = now.terms ^ {term}
            moves += [replace(now, terms=toggled, width=k) for k in widths]
        return [move for move in moves if move != now]

    def settings(
        self, trial: ProcessingSettings, choices: tuple[_JointChoice, ...]
    ) -> ProcessingSettings:
        """The settings with the delays of the choices."""
        delays = tuple(self.delays[choice.delay] for choice in choices)
        if trial.delays_s is not None or not any(delays):
            return trial
        return replace(trial, delays_s=delays)

    def friction(self, choices: tuple[_JointChoice, ...]) -> FrictionTerms:
        """The friction terms of the choices."""
        given = dict((self.given or FrictionTerms()).terms)
        for k, term in enumerate(self.extras):
            joints = tuple(j for j, choice in enumerate(choices) if k in choice.terms)
            if joints:
                given[term] = joints if len(joints) < len(choices) else None
        widths = tuple(WIDTHS[choice.width] for choice in choices)
        return FrictionTerms(
            terms=tuple((term, given[term]) for term in TERMS if term in given),
            width=widths,
            stribeck_velocity=self.speed,
        )


def _price(now: _JointChoice, trial: _JointChoice, no_delay: int) -> float:
    """What a move must gain; going back to simpler is nearly free."""
    terms = GAIN_OF_TERM * (len(trial.terms) - len(now.terms))
    delay = GAIN_OF_SHAPE * (
        (abs(trial.delay - no_delay) > 0) * 1.0 - (abs(now.delay - no_delay) > 0) * 1.0
    )
    width = GAIN_OF_SHAPE * (float(trial.width > 0) - float(now.width > 0))
    return terms + delay + width + 1e-4


def _term_column(term: str, dq: Array, width: float, speed: float) -> Array:
    match term:
        case "fc":
            return smooth_sign(dq, width)
        case "fca":
            return np.abs(smooth_sign(dq, width))
        case "fs":
            return np.exp(-np.square(dq / speed)) * smooth_sign(dq, width)
        case "fo":
            return np.ones_like(dq)
        case "fva":
            return np.abs(dq)
        case _:
            return np.cbrt(dq)


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
