"""Errors of predicted torques: the METRICS of the design."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, Mask, Value, plain
from dynid.robot import joints_by_kind


@dataclass(frozen=True, slots=True, kw_only=True)
class Metrics(Value):
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
    """The same over all joints; of turning and sliding ones, over the kind that errs more [%]."""
    r2: Array
    """(n) 1 - ||e||^2 / ||tau - mean||^2."""

    def to_json(self) -> dict[str, Any]:
        """A JSON object; null where there is nothing to measure."""
        return plain(self)


def metrics(
    measured: Array,
    predicted: Array,
    mask: Mask | None = None,
    prismatic: Sequence[bool] | None = None,
) -> Metrics:
    """Metrics of predicted torques (N, n) [N.m or N], of the samples that a mask (N, n) marks.

    Joints (n) are of one kind unless `prismatic` says which of them slide.
    """
    # Joint by joint in memory: sums then do not depend on how the rows lie there.
    torque, error = (np.array(x.T, order="C") for x in (measured, measured - predicted))
    counted = np.ones(torque.shape, dtype=bool) if mask is None else mask.T.astype(bool, order="C")
    number, joints = counted.sum(axis=1), len(torque)
    energy, square = ((np.square(x) * counted).sum(axis=1) for x in (torque, error))
    highest = np.max(torque, axis=1, where=counted, initial=-np.inf)
    reach = highest - np.min(torque, axis=1, where=counted, initial=np.inf)
    apart = torque - _ratio((torque * counted).sum(axis=1), number)[:, None]
    # Rounding of the mean would give a constant torque a spread.
    spread = np.where(reach > 0, (np.square(apart) * counted).sum(axis=1), 0.0)
    rmse = np.sqrt(_ratio(square, number))
    kinds = joints_by_kind(prismatic or [False] * joints).values()
    overall = [_ratio(square[j].sum(), energy[j].sum()) for j in kinds]
    samples = number.sum() / joints
    return Metrics(
        samples=round(samples),
        normalized_error=float(_ratio(np.sqrt(square.sum()), samples)),
        rmse=rmse,
        nrmse=_ratio(rmse, reach),
        relative_error_percent=100 * np.sqrt(_ratio(square, energy)),
        relative_error_overall_percent=float(100 * np.sqrt(np.fmax.reduce(overall))),
        r2=1 - _ratio(square, spread),
    )


def _ratio(above: ArrayLike, below: ArrayLike) -> Array:
    """NaN where there is nothing below."""
    known = np.asarray(below, dtype=np.float64)
    return np.divide(above, known, out=np.full(known.shape, np.nan), where=known > 0)


def errors_by_kind(
    measured: Array, predicted: Array, moves: Mask, prismatic: Sequence[bool]
) -> dict[str, tuple[Metrics, Metrics]]:
    """Errors of all rows and of those in motion, of all joints or of turning and sliding ones.

    Torques (N, n) [N.m or N] of an arm some of whose joints (n) slide have `turning` and
    `sliding` in place of `all`: newton metres and newtons do not add.
    """
    found: dict[str, tuple[Metrics, Metrics]] = {}
    for kind, j in joints_by_kind(prismatic).items():
        torques = measured[:, j], predicted[:, j]
        found[kind] = metrics(*torques), metrics(*torques, moves[:, j])
    return found


ONE_SIDED = 1.645
"""Standard deviations below which 95 % of a normal error lies."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DecidingErrors:
    """Errors that decide whether a model predicts, as shares of the torque [%]."""

    moving: float
    """Of moving joints."""
    whole: float
    """Of all samples."""
    noise: float
    """What of `moving` no model predicts."""
    resolution: float
    """Errors of the model up to this are not told from such noise (with 95 % confidence)."""


def deciding_errors(
    measured: Array, predicted: Array, moves: Mask, prismatic: Sequence[bool]
) -> DecidingErrors:
    """Errors of all joints; of an arm with both kinds, of the kind that errs more beyond noise.

    Torques (N, n) [N.m or N]. The noise comes from differences of the error from sample to sample,
    so that a slow error is none. What the noise leaves of the mean square error is the mean product
    of neighbouring errors: its deviation, of white noise, bounds what noise hides.
    """
    found: list[DecidingErrors] = []
    kinds = joints_by_kind(prismatic)
    for kind, (whole, moving) in errors_by_kind(measured, predicted, moves, prismatic).items():
        counted = moves[1:] & kinds[kind]
        error = measured - predicted
        steps = np.square(np.diff(error, axis=0))[counted].sum()
        products = np.linalg.norm((error[1:] * error[:-1])[counted])
        torque = np.square(measured[1:])[counted].sum()
        found.append(
            DecidingErrors(
                moving=moving.relative_error_overall_percent,
                whole=whole.relative_error_overall_percent,
                noise=float(100 * np.sqrt(steps / 2 / torque)) if torque > 0 else 0.0,
                resolution=float(100 * np.sqrt(ONE_SIDED * products / torque)) if torque > 0 else 0,
            )
        )
    return max(found, key=lambda one: np.nan_to_num(one.moving**2 - one.noise**2, nan=-np.inf))
