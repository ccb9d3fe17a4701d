"""The friction columns that model selection may give each joint."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.core import Array, Mask
from dynid.identification.bayesian import NOT_NEGATIVE
from dynid.identification.least_squares import PRIOR_GAIN, WeightedLeastSquares
from dynid.identification.problem import IdentificationProblem
from dynid.reduction import reduce_model
from dynid.regressor import (
    TERMS,
    FrictionTerms,
    InverseDynamicModel,
    LoadFriction,
    friction_block,
    friction_state,
    smooth_sign,
)
from dynid.robot import RobotModel
from dynid.signals import Samples

LOAD = "fl"
WIDTHS = (0.001, 0.003, 0.01, 0.02, 0.04, 0.07, 0.12, 0.2)
"""Widths of the Coulomb step that are tried [rad/s]."""
DISPLACEMENTS = (2e-4, 6e-4, 2e-3, 6e-3, 2e-2)
"""Displacements over which presliding friction builds up that are tried [rad or m]."""
EXTRA_WIDTH = 0.01
"""Width inside candidate columns that have a step, until the joint's own is known [rad/s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateColumns:
    """One step a width for each stepped term, then the extra terms, load-dependent ones last.

    Steps of presliding friction stand behind those with a width.
    """

    stepped: tuple[tuple[str, tuple[int, ...] | None], ...]
    """Terms with a step that all choices have, and their joints from 0; None for all."""
    extras: tuple[str, ...]
    """Terms that a joint may take besides; load-dependent friction has the step's width."""
    stribeck_velocity: float
    """[rad/s or m/s]"""
    presliding: bool = False
    """Whether a joint's friction may build up over a displacement: then `fc` alone is stepped."""

    @property
    def steps(self) -> int:
        """Steps a term: widths, then displacements."""
        return len(WIDTHS) + (len(DISPLACEMENTS) if self.presliding else 0)

    def states(self, samples: Samples) -> Array:
        """(n, d, N) states of presliding friction, one a displacement; d = 0 without."""
        q = samples.q.T
        if not self.presliding:
            return np.zeros((len(q), 0, samples.count))
        periodic = samples.noise is not None
        every = [friction_state(q, np.full(len(q), d), periodic=periodic) for d in DISPLACEMENTS]
        return np.stack(every, axis=1)

    def values(self, dq: Array, load: Array, states: Array) -> Array:
        """(c, N) the columns of one joint.

        Args:
            dq: (N) its velocities.
            load: (N) size of its load.
            states: (d, N) its states of presliding friction.
        """
        stepped: list[Array] = []
        for term, _ in self.stepped:
            stepped += [*(self._column(term, dq, width) for width in WIDTHS), *states]
        extra = [self._column(term, dq, EXTRA_WIDTH) for term in self.extras if term != LOAD]
        loaded: list[Array] = []
        if LOAD in self.extras:
            steps = (*(smooth_sign(dq, width) for width in WIDTHS), *states)
            loaded = [load * step for step in steps]
        return np.array([*stepped, *extra, *loaded])

    @property
    def positive(self) -> Mask:
        """(c) columns whose parameters cannot be negative."""
        words = [word for word, _ in self.stepped for _ in range(self.steps)]
        words += [word for word in self.extras if word != LOAD]
        words += [LOAD for _ in range(self.steps) if LOAD in self.extras]
        return np.array([word.capitalize() in NOT_NEGATIVE for word in words], dtype=bool)

    def places(self, joint: int, step: int, terms: frozenset[int]) -> tuple[int, ...]:
        """Where the columns of one choice stand.

        Args:
            joint: Whose choice, from 0.
            step: Index into `WIDTHS`, or behind them into `DISPLACEMENTS`.
            terms: Indices into `extras`.
        """
        steps = [
            k * self.steps + step
            for k, (_, joints) in enumerate(self.stepped)
            if joints is None or joint in joints
        ]
        first = len(self.stepped) * self.steps
        return (
            *steps,
            *(first + k + (step if self.extras[k] == LOAD else 0) for k in sorted(terms)),
        )

    def _column(self, term: str, dq: Array, width: float) -> Array:
        shape = FrictionTerms(width=width, stribeck_velocity=self.stribeck_velocity)
        velocity = dq[None]
        return friction_block(term, shape).values(velocity, velocity)[0]


EXTRA_TERMS = ("fo", "fca", "fva", "fs", "fr", LOAD)
"""Terms that a joint may take beside the paper's; load-dependent friction has the step's width."""
ALIKE = frozenset({"fs", "fr"})
"""Both bend the curve below some speed: together they cancel, inside the record only."""
PAIR = frozenset({"fo", "fca"})
"""Together an offset that stops at rest; alone neither helps. Where the arm rests, so does
stiction, which is another one each time."""
GAIN_OF_TERM = 0.03
"""An extra column, or presliding, must lower the sum over joints of log RMS by this much."""
GAIN_OF_SHAPE = 0.01
"""So must a change of width, delay, cut-off or velocity source."""


@dataclass(frozen=True, slots=True)
class JointChoice:
    """What one joint has been given; indices into the lists of candidates."""

    width: int
    terms: frozenset[int]
    delay: int
    displacement: int | None = None
    """Of presliding friction, which then takes the place of the step; None without."""

    @property
    def step(self) -> int:
        """Index into the steps of `CandidateColumns`."""
        return self.width if self.displacement is None else len(WIDTHS) + self.displacement


@dataclass(frozen=True, slots=True, kw_only=True)
class Moves:
    """Which choices a joint has."""

    extras: tuple[str, ...]
    """Terms that may be added."""
    widths: int
    """Number of widths; 1 where no term has a step."""
    delays: int
    """Number of delays."""
    no_delay: int
    """Index of the delay 0."""
    presliding: bool
    """Whether friction may build up over a displacement."""
    pair: bool
    """Whether `PAIR` may be added at once."""

    def after(self, now: JointChoice) -> list[JointChoice]:
        """The choices one move away from a choice."""
        steps = [replace(now, width=k, displacement=None) for k in range(self.widths)]
        moves = [*steps, *(replace(now, delay=k) for k in range(self.delays))]
        if self.presliding:
            moves += [replace(now, displacement=k) for k in range(len(DISPLACEMENTS))]
        # What a term does depends on the width beside it; presliding has none.
        beside = steps if now.displacement is None else [now]
        for term in range(len(self.extras)):
            toggled = now.terms ^ {term}
            if not {self.extras[k] for k in toggled} >= ALIKE:
                moves += [replace(choice, terms=toggled) for choice in beside]
        if self.pair and set(self.extras) >= PAIR:
            both = now.terms | {self.extras.index(term) for term in PAIR}
            moves += [replace(choice, terms=both) for choice in beside]
        return [move for move in moves if move != now]

    def price(self, now: JointChoice, trial: JointChoice) -> float:
        """What a move must gain; going back to simpler is nearly free."""
        terms = GAIN_OF_TERM * (_size(trial) - _size(now))
        delay = GAIN_OF_SHAPE * ((trial.delay != self.no_delay) - (now.delay != self.no_delay))
        width = GAIN_OF_SHAPE * ((trial.width > 0) - (now.width > 0))
        return terms + delay + width + 1e-4


def _size(choice: JointChoice) -> int:
    return len(choice.terms) + (choice.displacement is not None)


def chosen_friction(
    choices: tuple[JointChoice, ...],
    extras: tuple[str, ...],
    given: FrictionTerms | None,
    stribeck_velocity: float,
) -> FrictionTerms:
    """The friction terms of the choices.

    Args:
        choices: One a joint.
        extras: The words that their terms are indices of.
        given: Terms given by the user; None for those of the paper.
        stribeck_velocity: [rad/s or m/s]
    """
    joints_of = dict((given or FrictionTerms()).terms)
    load = None
    for k, term in enumerate(extras):
        joints = tuple(j for j, choice in enumerate(choices) if k in choice.terms)
        if joints and term == LOAD:
            # What the load is, the fit will find.
            load = LoadFriction(joints=joints, parameters=(0.0,) * (10 * len(choices)))
        elif joints:
            joints_of[term] = joints if len(joints) < len(choices) else None
    over = tuple(
        0.0 if choice.displacement is None else DISPLACEMENTS[choice.displacement]
        for choice in choices
    )
    return FrictionTerms(
        terms=tuple((term, joints_of[term]) for term in TERMS if term in joints_of),
        width=tuple(WIDTHS[choice.width] for choice in choices),
        stribeck_velocity=stribeck_velocity,
        presliding=over if any(over) else (),
        load=load,
    )


ITERATIONS = 3
"""Fits of parameters and load in turn; the load changes by a per mille after two."""


def with_load(
    model: InverseDynamicModel, samples: Samples, prior_gain: float | None
) -> InverseDynamicModel:
    """The model with the load of its load-dependent friction as these samples show it.

    Args:
        model: A model; one without load-dependent friction is returned as it is.
        samples: The samples that it will be fitted to.
        prior_gain: See `WeightedLeastSquares`.
    """
    load = model.friction.load
    if load is None:
        return model
    for _ in range(ITERATIONS):
        parameters = tuple(inertial_parameters(model, samples, prior_gain).tolist())
        found = LoadFriction(joints=load.joints, parameters=parameters)
        model = InverseDynamicModel(
            robot=model.robot, frames=model.frames, friction=replace(model.friction, load=found)
        )
    return model


def inertial_parameters(
    model: InverseDynamicModel, samples: Samples, prior_gain: float | None
) -> Array:
    """(10 n) inertial parameters of a weighted fit, zero outside the base."""
    base = reduce_model(model)
    fit = WeightedLeastSquares(prior_gain=prior_gain).fit(
        IdentificationProblem(base=base, samples=samples)
    )
    parameters = np.zeros(len(model.columns))
    parameters[list(base.independent)] = fit.values
    return parameters[: 10 * model.robot.joints]


def load_size(robot: RobotModel, frames: str, samples: Samples, width: float) -> Array:
    """(n, N) size of each gear's load [N.m or N], from a plain fit of the same samples.

    Args:
        robot: The robot.
        frames: Parameter frames.
        samples: The samples.
        width: Of the plain fit's Coulomb step [rad/s or m/s].
    """
    plain = InverseDynamicModel(robot=robot, frames=frames, friction=FrictionTerms(width=width))
    inertial = inertial_parameters(plain, samples, PRIOR_GAIN)
    parameters = np.append(inertial, np.zeros(len(plain.columns) - len(inertial)))
    carried = plain.inverse_dynamics(samples.q, samples.dq, samples.ddq, parameters)
    return np.abs(carried - plain.known_torque(samples.q)).T
