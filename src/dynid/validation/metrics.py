"""How far prediction and measurement lie apart: the METRICS of the design."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dynid.core.arrays import Array, Mask

MOVING_SPEED = 0.02
"""A joint moves above this speed [rad/s or m/s]; below it friction hides the torque."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Metrics:
    """Errors of a prediction, a joint and overall."""

    samples: int
    """N; in a split, joint samples over joints."""
    normalized_error: float
    """The paper's e_N = (1/N) sqrt(e'e) over all joints [N.m]; falls as 1/sqrt(N)."""
    rmse: Array
    """(n) root mean square error [N.m or N]; NaN for a joint without samples."""
    nrmse: Array
    """(n) RMS error over the range of the measured torque."""
    relative_error_percent: Array
    """(n) 100 ||e|| / ||tau|| [%]."""
    relative_error_overall_percent: float
    """The same over all joints [%]."""
    r2: Array
    """(n) 1 - ||e||^2 / ||tau - mean||^2."""

    def to_json(self) -> dict[str, Any]:
        """A JSON object; null where there is nothing to measure."""
        return {
            "samples": self.samples,
            "normalized_error": _number(self.normalized_error),
            "rmse": [_number(x) for x in self.rmse],
            "nrmse": [_number(x) for x in self.nrmse],
            "relative_error_percent": [_number(x) for x in self.relative_error_percent],
            "relative_error_overall_percent": _number(self.relative_error_overall_percent),
            "r2": [_number(x) for x in self.r2],
        }


def metrics(measured: Array, predicted: Array, mask: Mask | None = None) -> Metrics:
    """Metrics of a prediction.

    Args:
        measured: (N, n) measured torques [N.m or N].
        predicted: (N, n) predicted torques.
        mask: (N, n) True where a joint's sample counts; None for all.

    Returns:
        The metrics of the samples that count.
    """
    counted = np.ones(measured.shape, dtype=bool) if mask is None else mask.astype(bool)
    joints = measured.shape[1]
    columns: list[tuple[float, float, float, float]] = []
    square = energy = 0.0
    for j in range(joints):
        torque, error = measured[counted[:, j], j], (measured - predicted)[counted[:, j], j]
        squares = float(np.square(error).sum())
        norm = float(np.square(torque).sum())
        square, energy = square + squares, energy + norm
        if len(torque) == 0:
            columns.append((np.nan, np.nan, np.nan, np.nan))
            continue
        rms = np.sqrt(squares / len(torque))
        reach = float(np.ptp(torque))
        # Rounding of the mean would give a constant torque a spread.
        spread = float(np.square(torque - torque.mean()).sum()) if reach > 0 else 0.0
        columns.append(
            (
                rms,
                _ratio(rms, reach),
                100 * np.sqrt(_ratio(squares, norm)),
                1 - _ratio(squares, spread),
            )
        )
    table = np.array(columns)
    samples = counted.sum() / joints
    return Metrics(
        samples=round(samples),
        normalized_error=_ratio(np.sqrt(square), samples),
        rmse=table[:, 0],
        nrmse=table[:, 1],
        relative_error_percent=table[:, 2],
        relative_error_overall_percent=100 * np.sqrt(_ratio(square, energy)),
        r2=table[:, 3],
    )


def _ratio(above: float, below: float) -> float:
    return above / below if below > 0 else np.nan


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
