"""How a long job tells where it is.

Warnings and problems: a code that programs read, a sentence that people read.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

CODES = frozenset(
    {
        "ill_conditioned",
        "low_excitation",
        "over_fitted",
        "not_physical",
        "non_white_residuals",
        "at_rest",
        "clock_jitter",
        "clock_mismatch",
        "dropped_rows",
        "corrupt_rows",
        "truncated_file",
        "saturated",
        "unit_suspect",
        "extrapolated",
    }
)


@dataclass(frozen=True, slots=True)
class Notice:
    """One finding about the data or the result.

    Raises:
        ValueError: The code is not one of `CODES`.
    """

    code: str
    """One of `CODES`."""
    message: str
    """What was found, in words, with its numbers."""

    def __post_init__(self) -> None:
        if self.code not in CODES:
            raise ValueError(f"unknown notice code {self.code!r}")

    def to_json(self) -> dict[str, str]:
        """The form that `--json` prints."""
        return {"code": self.code, "message": self.message}


Progress = Callable[[str, float], None]
"""Told what is being done, and how far the job is (0 to 1)."""


def silent(what: str, share: float) -> None:
    """Progress that nobody watches.

    Args:
        what: What is being done.
        share: How far the job is (0 to 1).
    """
    del what, share
