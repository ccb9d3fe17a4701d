"""Torque errors: what a design promised, what an identification found, what more time would do.

The error found is that on parts left out, or on recordings left out, without what no model of the
motion explains. It has a part that falls with time, which the covariance of the parameters tells,
and the error of the model, which stays.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynid.identification import Estimate
from dynid.recording import AnyRecording
from dynid.trajectory import JointMotion

PROMISED = "predicted_torque_error_percent"
"""Key of a recording's metadata: what its design promises for the periods recorded."""
CONFIDENCE = 1.645
"""Of the bound of the error found, one-sided 95 %, as a normal quantile."""
UNSURE = 35 / 9 - 2
"""Variance of a mean square less that of second differences, of white noise, times N / sigma^4."""
LONGER = 10.0
"""A run so many times longer is the most that is thought of."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Accuracy:
    """Expected and found torque error of one model, as shares of the RMS torque [%]."""

    expected_percent: float
    """What the designs of its recordings promise together; NaN where none does."""
    found_percent: float
    """On what was left out."""
    bound_percent: float
    """What it stays below with 95 % probability: noise hides errors in short recordings."""
    noise_percent: float
    """The part that falls with time, on the motions that the model is for; NaN if not asked."""
    left_out: str
    """`regions` of the only recording, or `recordings`."""

    @property
    def after_longer_percent(self) -> float:
        """What a run `LONGER` times as long would leave."""
        return math.sqrt(self.model_percent**2 + self.noise_percent**2 / LONGER)

    @property
    def model_percent(self) -> float:
        """What no time takes away."""
        return math.sqrt(max(self.found_percent**2 - self.noise_percent**2, 0.0))

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        values = {
            "expected_percent": self.expected_percent,
            "found_percent": self.found_percent,
            "found_bound_percent": self.bound_percent,
            "noise_percent": self.noise_percent,
        }
        known = {name: x if math.isfinite(x) else None for name, x in values.items()}
        return {**known, "left_out": self.left_out}

    def describe(self) -> str:
        """One sentence."""
        found = f"{self.found_percent:.2g} % on left-out {self.left_out}"
        found += f", below {self.bound_percent:.2g} % with 95 % probability"
        if math.isnan(self.expected_percent):
            return f"Torque error beyond noise: {found}"
        return f"Torque error beyond noise: {found}; by the design: {self.expected_percent:.2g} %"


def accuracy(
    estimate: Estimate,
    records: Sequence[AnyRecording],
    motions: Sequence[JointMotion] = (),
) -> Accuracy | None:
    """Expected beside found; None for an estimate that was not assessed.

    Args:
        estimate: From all of the records.
        records: The recordings, with what their designs promised.
        motions: What the model is for; none to leave the noise's part out.
    """
    told = estimate.assessment
    if told is None:
        return None
    promises = [float(r.metadata.extra.get(PROMISED, "nan")) for r in records]
    left = np.square(told.anywhere).sum() - np.square(told.noise_floor).sum()
    size = max(float(np.linalg.norm(told.torque)), 1e-12)
    spread = math.sqrt(UNSURE * float(np.power(told.noise_floor, 4).sum()) / estimate.samples)
    most = max(float(left), 0.0) + CONFIDENCE * spread
    return Accuracy(
        # Variances of independent recordings add as their inverses.
        expected_percent=float(np.sum(np.power(promises, -2.0)) ** -0.5) if promises else math.nan,
        found_percent=100 * math.sqrt(max(float(left), 0.0)) / size,
        bound_percent=100 * math.sqrt(most) / size,
        noise_percent=_noise_percent(estimate, motions),
        left_out="regions" if len(records) == 1 else "recordings",
    )


def _noise_percent(estimate: Estimate, motions: Sequence[JointMotion]) -> float:
    """RMS deviation of predicted torques by the covariance of the parameters, over the torque."""
    variance, power = 0.0, 0.0
    for motion in motions:
        stack = estimate.model.stack(motion.q, motion.dq, motion.ddq)[list(estimate.independent)]
        spread = np.tensordot(estimate.covariance, stack, axes=1)
        variance += max(float(np.vdot(stack, spread)), 0.0) / len(motion.q)
        torque = estimate.predict(motion.q, motion.dq, motion.ddq)
        power += float(np.square(torque).sum()) / len(motion.q)
    return 100 * math.sqrt(variance / power) if power > 0 else math.nan
