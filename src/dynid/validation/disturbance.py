"""Stretches of a record whose torques are not those of its motion: a contact, a helping hand."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from dynid.core.arrays import Array
from dynid.core.notices import Notice
from dynid.validation.prediction import ValidationResult
from dynid.validation.trimmed import WINDOW_S

RAISED = 4.0
"""Error of a joint in a window over that of its median window."""
STRUCK = 8.0
"""... of the hardest hit joint: friction that turns over stays below, or comes back often."""
LEAST_JOINTS = 2
"""A touch loads several joints, a friction that is not understood one at a time."""
APART = 2.0
"""A contact's error over the largest elsewhere: what comes back often is friction."""
LONGEST_SHARE = 0.1
"""Of the record, for all contacts together."""
LONGEST_TRIMMED = 0.2
"""... where the fit did without them."""
MOST = 3
"""Contacts that are told from a wrong model."""
LEAST_WINDOWS = 20
DISTURBED = "do not belong to the motion"


def disturbed(
    result: ValidationResult,
    names: tuple[str, ...],
    trimmed: tuple[Array, Array] | None = None,
) -> tuple[Notice, ...]:
    """Say where a few windows stand far above all others in several joints.

    Args:
        result: Prediction against measurement.
        names: (n) joint names.
        trimmed: Errors by window from `trimmed_errors`; None to take those of the result.
    """
    starts, ratio = trimmed or _raised_errors(result)
    longest = LONGEST_SHARE if trimmed is None else LONGEST_TRIMMED
    if len(starts) < LEAST_WINDOWS:
        return ()
    found: list[str] = []
    for first, stop in _contacts(ratio, longest):
        part = ratio[first:stop]
        worst = np.unravel_index(int(np.argmax(part)), part.shape)
        found.append(
            f"{starts[first]:.1f} to {starts[stop - 1] + WINDOW_S:.1f} s "
            f"({names[int(worst[1])]}, {part[worst]:.0f} times the usual error)"
        )
    if not found:
        return ()
    text = (
        f"torques {DISTURBED} at {'; '.join(found)}: a contact? They bend every parameter; "
        "leave them out with --from and --to, or record again"
    )
    return (Notice("corrupt_rows", text),)


def _contacts(ratio: Array, longest: float) -> list[tuple[int, int]]:
    """Windows (first, one past last) of the stretches that stand apart from all others."""
    largest = ratio.max(axis=1)
    raised = np.flatnonzero(largest > RAISED)
    groups = np.split(raised, np.flatnonzero(np.diff(raised) > 1) + 1)
    groups = sorted((g for g in groups if len(g)), key=lambda g: -float(largest[g].max()))
    for count in range(1, min(MOST, len(groups)) + 1):
        chosen = np.concatenate(groups[:count])
        rest = np.delete(largest, chosen)
        weakest = min(float(largest[g].max()) for g in groups[:count])
        short = len(chosen) <= max(MOST, longest * len(largest))
        if short and weakest > max(STRUCK, APART * float(rest.max(initial=0.0))):
            several = [g for g in groups[:count] if _joints_hit(ratio[g]) >= LEAST_JOINTS]
            return sorted((int(g[0]), int(g[-1]) + 1) for g in several)
    return []


def _joints_hit(ratio: Array) -> int:
    return int((ratio > RAISED).sum(axis=1).max())


def _raised_errors(result: ValidationResult) -> tuple[Array, Array]:
    """(w) start of each window [s], and (w, n) its RMS error over the joint's median."""
    t = result.t - result.t[0]
    edges = np.searchsorted(t, np.arange(0.0, float(t[-1]), WINDOW_S))
    square = np.square(result.measured - result.predicted)
    kept = [(a, b) for a, b in pairwise(edges.tolist()) if b > a]
    if not kept:
        return np.zeros(0), np.zeros((0, square.shape[1]))
    rms = np.array([np.sqrt(square[a:b].mean(axis=0)) for a, b in kept])
    usual = np.maximum(np.median(rms, axis=0), 1e-300)
    return np.array([result.t[a] for a, _ in kept]), rms / usual
