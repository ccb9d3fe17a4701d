"""How a long job tells where it is."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Told what is being done, and how far the job is (0 to 1)."""


def silent(what: str, share: float) -> None:
    """Progress that nobody watches.

    Args:
        what: What is being done.
        share: How far the job is (0 to 1).
    """
    del what, share
