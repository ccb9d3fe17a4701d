"""The friction columns that model selection may give each joint."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from dynid import regressor
from dynid.core import Array, Mask
from dynid.identification.bayesian import NOT_NEGATIVE, TowardPublished, symbol_of
from dynid.identification.least_squares import Estimator
from dynid.identification.problem import IdentificationProblem
from dynid.reduction import reduce_model
from dynid.signals import Samples, joined

LOAD = "fl"
WITH_STEP = ("fs", LOAD)
"""Terms that a joint may take whose columns are those of its step times something."""
WIDTHS = (0.001, 0.003, 0.01, 0.02, 0.04, 0.07, 0.12, 0.2)
"""Widths of the Coulomb step that are tried [rad/s]."""
DISPLACEMENTS = (2e-4, 6e-4, 2e-3, 6e-3, 2e-2)
"""Displacements over which presliding friction builds up that are tried [rad]."""
LEVER = 0.1
"""What one radian of the numbers above is to a joint that slides [m]."""
EXTRA_WIDTH = 0.01
"""Width inside candidate columns that have a step, until the joint's own is known [rad/s]."""


@dataclass(frozen=True, slots=True)
class JointChoice:
    """What one joint has been given; indices into the lists of candidates."""

    width: int
    terms: frozenset[int]
    displacement: int | None = None
    """Of presliding friction, which then takes the place of the step; None without."""

    @property
    def step(self) -> int:
        """Index into the steps of `CandidateColumns`."""
        return self.width if self.displacement is None else len(WIDTHS) + self.displacement

    @property
    def size(self) -> int:
        """Terms beside the paper's; presliding counts as one."""
        return len(self.terms) + (self.displacement is not None)


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateColumns:
    """One step a width for each stepped term, then the extra terms, those with one a step last.

    Steps of presliding friction stand behind those with a width.
    """

    stepped: tuple[tuple[str, tuple[int, ...] | None], ...]
    """Terms with a step that all choices have, and their joints from 0; None for all."""
    extras: tuple[str, ...]
    """Terms that a joint may take besides; those `with_step` last."""
    stribeck_velocity: tuple[float, ...]
    """Of each joint [rad/s or m/s]."""
    levers: Array
    """(n) 1 for joints that turn, `LEVER` for those that slide."""
    displacements: tuple[float, ...] = ()
    """Over which a joint's friction may build up, over `unit`: where any, `fc` alone is stepped."""
    with_step: tuple[str, ...] = WITH_STEP
    """Extra terms that have a column a step; of the others each has one."""
    unit: Array
    """(n) [rad or m]"""

    @property
    def steps(self) -> int:
        """Steps a term: widths, then displacements."""
        return len(WIDTHS) + len(self.displacements)

    def states(self, samples: Samples) -> Array:
        """(n, d, N) states of presliding friction, one a displacement; d = 0 without."""
        states = np.zeros((samples.joints, len(self.displacements), samples.count))
        for k, over in enumerate(self.displacements):
            for run in samples.runs:
                states[:, k, run] = regressor.friction_state(
                    samples.friction_q[run].T, over * self.unit, periodic=samples.noise is not None
                )
        return states

    def values(self, joint: int, dq: Array, load: Array, states: Array) -> Array:
        """(c, N) the columns of one joint.

        Of its velocities (N), the size of its load (N) and its states of presliding friction
        (d, N).
        """
        lever, speed = float(self.levers[joint]), self.stribeck_velocity[joint]
        widths = [lever * width for width in WIDTHS]
        stepped: list[Array] = []
        for term, _ in self.stepped:
            stepped += [*(_column(term, dq, width, speed) for width in widths), *states]
        within = lever * EXTRA_WIDTH
        extra = [_column(t, dq, within, speed) for t in self.extras if t not in self.with_step]
        steps = np.array([*(regressor.smooth_sign(dq, width) for width in widths), *states])
        times = {"fs": regressor.stribeck(dq, speed), LOAD: load}
        grown = [
            times[term] * step for term in self.extras if term in self.with_step for step in steps
        ]
        return np.array([*stepped, *extra, *grown])

    @property
    def positive(self) -> Mask:
        """(c) columns whose parameters cannot be negative."""
        words = [word for word, _ in self.stepped for _ in range(self.steps)]
        words += [word for word in self.extras if word not in self.with_step]
        words += [word for word in self.extras if word in self.with_step for _ in range(self.steps)]
        return np.array([word.capitalize() in NOT_NEGATIVE for word in words], dtype=bool)

    def places(self, joint: int, step: int, terms: frozenset[int]) -> tuple[int, ...]:
        """Where the columns of one choice of a joint stand; terms are indices into `extras`.

        The step is an index into `WIDTHS`, or behind them into the displacements.
        """
        steps = [
            k * self.steps + step
            for k, (_, joints) in enumerate(self.stepped)
            if joints is None or joint in joints
        ]
        first = len(self.stepped) * self.steps
        plain = sum(term not in self.with_step for term in self.extras)
        for k in sorted(terms):
            behind = (k - plain) * self.steps + step if k >= plain else 0
            steps.append(first + min(k, plain) + behind)
        return tuple(steps)

    def moves(self, now: JointChoice, coupled: bool) -> list[JointChoice]:
        """The choices one move away from one; widths differ where a term has a step.

        Two terms may change at once: of a torque at rest that motion does not have, an offset or an
        asymmetry alone explains nothing, and one term that hides it keeps both out.
        Presliding of a joint whose motor is coupled to others is that of the motor, and stays.
        """
        widths = range(len(WIDTHS) if self.stepped else 1)
        found = [replace(now, width=k) for k in widths]
        if not coupled:
            found = [replace(move, displacement=None) for move in found]
            found += [replace(now, displacement=k) for k in range(len(self.displacements))]
        extras = range(len(self.extras))
        changed = [set(some) for count in (1, 2) for some in combinations(extras, count)]
        found += [replace(now, terms=now.terms ^ some) for some in changed]
        return [move for move in found if move != now]


def _column(term: str, dq: Array, width: float, stribeck_velocity: float) -> Array:
    shape = regressor.FrictionTerms(width=width, stribeck_velocity=stribeck_velocity)
    return regressor.JointColumns(term=term, shape=shape).values(dq[None], dq[None])[0]


EXTRA_TERMS = ("fo", "fca", "fva", "fr", *WITH_STEP)
"""Terms that a joint may take beside the paper's."""
PLAIN_WIDTH = WIDTHS.index(0.01)
"""Where every joint begins."""


def chosen_friction(
    choices: tuple[JointChoice, ...],
    columns: CandidateColumns,
    given: regressor.FrictionTerms | None,
) -> regressor.FrictionTerms:
    """The friction terms of the choices, one a joint, and of those given by the user."""
    joints_of = dict((given or regressor.FrictionTerms()).terms)
    load = None
    for k, term in enumerate(columns.extras):
        joints = tuple(j for j, choice in enumerate(choices) if k in choice.terms)
        if joints and term == LOAD:
            # What the load is, the fit will find.
            load = regressor.LoadFriction(joints=joints, parameters=(0.0,) * (10 * len(choices)))
        elif joints:
            joints_of[term] = joints if len(joints) < len(choices) else None
    speeds = columns.stribeck_velocity
    pairs = list(zip(choices, columns.levers.tolist(), strict=True))
    over = tuple(
        0.0 if choice.displacement is None else lever * DISPLACEMENTS[choice.displacement]
        for choice, lever in pairs
    )
    return regressor.FrictionTerms(
        terms=tuple((term, joints_of[term]) for term in regressor.TERMS if term in joints_of),
        width=tuple(lever * WIDTHS[choice.width] for choice, lever in pairs),
        stribeck_velocity=speeds if len(set(speeds)) > 1 else speeds[0],
        presliding=over if any(over) else (),
        load=load,
    )


ITERATIONS = 3
"""Fits of parameters and load in turn; the load changes by a per mille after two."""


def with_load(
    model: regressor.InverseDynamicModel, samples: Samples, estimator: Estimator
) -> regressor.InverseDynamicModel:
    """The model with the load of its load-dependent friction as these samples show it.

    Args:
        model: A model; one without load-dependent friction is returned as it is.
        samples: The samples that it will be fitted to.
        estimator: What it will be fitted with.
    """
    load = model.friction.load
    if load is None:
        return model
    for _ in range(ITERATIONS):
        inertial = _inertial_parameters(model, samples, estimator)
        found = regressor.LoadFriction(joints=load.joints, parameters=tuple(inertial.tolist()))
        model = replace(model, friction=replace(model.friction, load=found))
    return model


def without_negative(
    model: regressor.InverseDynamicModel, samples: Samples, estimator: Estimator
) -> regressor.InverseDynamicModel:
    """The model without friction that the fit makes negative, which would drive its joint.

    Candidates are scored with parameters that are not; beside the load that the fit finds, or with
    another weighting, they may become so. Arguments as for `with_load`.
    """
    while True:
        base = reduce_model(model)
        values = estimator.checked_fit(IdentificationProblem(base=base, samples=samples)).values
        driving = {
            name
            for name, value in zip(base.names, values, strict=True)
            if value < 0 and name[0] == "F" and symbol_of(name) in NOT_NEGATIVE
        }
        friction = model.friction.without(driving, model.robot.joints)
        if friction == model.friction:
            return model
        model = with_load(replace(model, friction=friction), samples, estimator)


def _inertial_parameters(
    model: regressor.InverseDynamicModel, samples: Samples, estimator: Estimator
) -> Array:
    """(10 n) inertial parameters of a fit, zero outside the base."""
    base = reduce_model(model)
    fit = estimator.checked_fit(IdentificationProblem(base=base, samples=samples))
    return base.to_standard(fit.values)[: 10 * model.robot.joints]


def load_inertias(
    model: regressor.InverseDynamicModel, parts: Sequence[Samples], width: float, weight: float
) -> Array:
    """(10 n) inertial parameters of a plain fit: `width` of its Coulomb step, prior `weight`."""
    plain = replace(model, friction=regressor.FrictionTerms(width=width))
    samples = parts[0] if len(parts) == 1 else joined(parts)
    return _inertial_parameters(plain, samples, TowardPublished(weight=weight))


def load_size(model: regressor.InverseDynamicModel, samples: Samples, inertias: Array) -> Array:
    """(n, N) size of each gear's load [N.m or N] with inertial parameters (10 n)."""
    parameters = np.append(inertias, np.zeros(len(model.columns) - len(inertias)))
    carried = model.inverse_dynamics(samples.q, samples.dq, samples.ddq, parameters)
    return np.abs(carried - model.known_torque(samples.q)).T
