"""Methods side by side, on arms whose truth is known."""

from dynid.bench.estimators import compare_estimators, summary, to_json
from dynid.bench.plants import Motion, Plant, arm, motion, plant
from dynid.bench.verdicts import (
    Case,
    Judged,
    Recorded,
    cases,
    markdown,
    rates,
    recorded,
    run_verdicts,
    summarise,
)

__all__ = [
    "Case",
    "Judged",
    "Motion",
    "Plant",
    "Recorded",
    "arm",
    "cases",
    "compare_estimators",
    "markdown",
    "motion",
    "plant",
    "rates",
    "recorded",
    "run_verdicts",
    "summarise",
    "summary",
    "to_json",
]
