"""Methods side by side, on arms whose truth is known."""

from dynid.bench.estimators import compare_estimators, summary, to_json

__all__ = [
    "compare_estimators",
    "summary",
    "to_json",
]
