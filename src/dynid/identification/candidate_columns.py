"""The friction columns that one joint may be given, side by side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array, Mask
from dynid.identification.plausible_signs import NOT_NEGATIVE
from dynid.regressor.blocks import smooth_sign
from dynid.regressor.layout import friction_block
from dynid.regressor.presliding import friction_state
from dynid.regressor.terms import FrictionTerms
from dynid.signals.samples import Samples

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
