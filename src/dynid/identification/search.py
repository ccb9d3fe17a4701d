"""The search behind `--preset best`: one joint's choice at a time, scored by cross-validation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import InputError
from dynid.identification.candidate_columns import (
    EXTRA_WIDTH,
    LOAD,
    WIDTHS,
    CandidateColumns,
)
from dynid.identification.chosen_friction import chosen_friction
from dynid.identification.crossvalidation import (
    BLOCKS,
    Candidates,
    Variant,
    accumulate_candidates,
)
from dynid.identification.joint_choice import EXTRA_TERMS, JointChoice, Moves
from dynid.identification.loading import load_size
from dynid.reduction.base import reduce_model
from dynid.regressor.model import InverseDynamicModel
from dynid.regressor.terms import FrictionTerms
from dynid.robot.model import RobotModel
from dynid.signals.process import delayed, samples_from
from dynid.signals.resample import UniformSignals
from dynid.signals.samples import ProcessingSettings
from dynid.signals.standstill import rest_share

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
