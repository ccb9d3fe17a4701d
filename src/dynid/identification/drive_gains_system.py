"""Records with a payload that is partly known, with the columns of all in one order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.core.arrays import Array
from dynid.identification.shared import PAYLOAD, SharedProblem


@dataclass(frozen=True, slots=True, kw_only=True)
class WeighedSystem:
    """The problem with its columns in one order: own of each record, arm, unknown payload."""

    problem: SharedProblem
    turn: Array
    """(10, 10) payload about the last link's frame from payload about the flange."""
    known: Array
    """(10) payload about the flange, NaN where unknown."""

    @property
    def size(self) -> int:
        """Number of unknowns x, gains apart."""
        records, own = len(self.problem.problems), len(self.problem.own)
        return records * own + len(self.problem.common) + int(np.isnan(self.known).sum())

    def spread(self, record: int, columns: Array) -> tuple[Array, Array]:
        """Columns (w, ...) of a record as (size, ...), and the known payload's torque (...)."""
        problem, unknown = self.problem, np.isnan(self.known)
        own, records = len(problem.own), len(problem.problems)
        arm = columns[own : own + len(problem.common)]
        payload = np.tensordot(self.turn.T, columns[-PAYLOAD:], axes=1)
        wide = np.zeros((self.size, *columns.shape[1:]))
        wide[record * own : (record + 1) * own] = columns[:own]
        wide[records * own : records * own + len(arm)] = arm
        wide[records * own + len(arm) :] = payload[unknown]
        fixed = np.tensordot(self.known[~unknown], payload[~unknown], axes=1)
        return wide, np.asarray(fixed, dtype=np.float64)


def factored(system: WeighedSystem) -> tuple[Array, Array, Array]:
    """Columns (R, n, h, size), known torques and currents (R, n, h), as square roots.

    Args:
        system: The problem.
    """
    columns: list[Array] = []
    fixed: list[Array] = []
    current: list[Array] = []
    for k in range(len(system.problem.problems)):
        factors = system.problem.factors(k)
        wide, torque = system.spread(k, np.moveaxis(factors[:, :, :-1], -1, 0))
        columns.append(np.moveaxis(wide, 0, -1))
        fixed.append(torque)
        current.append(factors[:, :, -1])
    return np.array(columns), np.array(fixed), np.array(current)
