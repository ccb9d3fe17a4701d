"""What an optimiser found so far."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field

from dynid.excitation.candidate import Candidate
from dynid.excitation.problem import ExcitationProblem

KEPT = 5
"""Candidates kept for the certificate, best first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HistoryEntry:
    """When the best motion changed."""

    wall_s: float
    """Since the search began [s]."""
    evaluations: int
    """Motions evaluated by then, as far as they were reported."""
    value: float
    """The criterion of the new best one."""
    feasible: bool
    """Whether it kept every limit on the search grid."""


@dataclass(slots=True, kw_only=True)
class Search:
    """The candidates of a search, and how they were found."""

    problem: ExcitationProblem
    began: float = field(default_factory=time.monotonic)
    candidates: list[tuple[Candidate, int]] = field(default_factory=list[tuple[Candidate, int]])
    """The best ones with the number of their start or individual, best first."""
    history: list[HistoryEntry] = field(default_factory=list[HistoryEntry])
    evaluations: int = 0
    starts: int = 0
    """Starts that ended."""
    ended_by: str = ""
    """`starts`, `generations`, `stagnation`, `budget` or `interrupt`; empty while it runs."""

    @property
    def best(self) -> Candidate | None:
        """The best candidate so far."""
        return self.candidates[0][0] if self.candidates else None

    @property
    def wall_s(self) -> float:
        """Since the search began [s]."""
        return time.monotonic() - self.began

    def add(self, candidate: Candidate, number: int) -> None:
        """Take a candidate in, and note when it is the best.

        Args:
            candidate: The candidate.
            number: Its start: the order of equals, whoever finished first.
        """
        before = self.best
        worst = self.candidates[-1][0].key if len(self.candidates) == KEPT else None
        if worst is not None and candidate.key > worst:
            return
        self.candidates.append((candidate, number))
        self.candidates.sort(key=lambda item: (*item[0].key, item[1]))
        del self.candidates[KEPT:]
        if before is None or candidate.key < before.key:
            self.history.append(
                HistoryEntry(
                    wall_s=self.wall_s,
                    evaluations=self.evaluations,
                    value=reported(self.problem, candidate),
                    feasible=candidate.key[0] == 0.0,
                )
            )

    def words(self) -> str:
        """The state of the search for a progress bar."""
        best = self.best
        if best is None:
            return "no motion yet"
        value = f"{self.problem.criterion.name} {reported(self.problem, best):.4g}"
        return value if best.key[0] == 0.0 else f"{value}, limits not met yet"


def reported(problem: ExcitationProblem, candidate: Candidate) -> float:
    """The criterion of a candidate as it is reported, not as optimisers see it."""
    if not problem.criterion.positive:
        return candidate.objective
    return math.exp(min(candidate.objective, 700.0))
