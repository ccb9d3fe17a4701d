"""What `dynid identify` can be asked for, and the estimator that answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dynid.core.errors import InputError
from dynid.core.optional import installed
from dynid.identification.least_squares import Estimator, WeightedLeastSquares
from dynid.identification.physical import PhysicallyConsistent
from dynid.identification.registry import ESTIMATORS, estimator_of
from dynid.regressor.terms import FrictionTerms
from dynid.robot.model import RobotModel

PRESETS = ("best", "paper")
WEIGHTINGS = ("joint", "size")


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifySettings:
    """What the user asked for; None means: as the preset says.

    Raises:
        InputError: An unknown preset, estimator or weighting.
    """

    preset: str = "best"
    estimator: str | None = None
    terms: FrictionTerms | None = None
    cutoff_hz: float | None = None
    """Low-pass cut-off [Hz]."""
    start_s: float | None = None
    stop_s: float | None = None
    weighting: str = "joint"
    """`joint`: one noise a joint; `size`: joints with equal torque limit share one."""
    frames: str = ""

    def __post_init__(self) -> None:
        for value, allowed, where in (
            (self.preset, PRESETS, "--preset"),
            (self.estimator or "ols", ESTIMATORS, "--estimator"),
            (self.weighting, WEIGHTINGS, "--weighting"),
        ):
            if value not in allowed:
                raise InputError("unknown", where=where, value=value, limit=", ".join(allowed))

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {
            "preset": self.preset,
            "estimator": self.estimator,
            "terms": None if self.terms is None else self.terms.to_json(),
            "cutoff_hz": self.cutoff_hz,
            "start_s": self.start_s,
            "stop_s": self.stop_s,
            "weighting": self.weighting,
            "frames": self.frames,
        }


def chosen_estimator(
    settings: IdentifySettings,
    robot: RobotModel,
    prior: float | None,
    *,
    ill_conditioned: bool = False,
) -> Estimator:
    """The estimator that settings ask for.

    Where nothing is asked for and the motion does not tell the parameters apart, only bodies
    that can exist are fitted, if the extra `sdp` is installed: what they predict elsewhere is
    bounded.

    Args:
        settings: What the user asked for.
        robot: The robot.
        prior: Strength of the weak prior, see `WeightedLeastSquares`.
        ill_conditioned: Whether the motion does not tell the parameters apart.

    Raises:
        InputError: Weighting by joint size without torque limits.
    """
    word = settings.estimator or ("ols" if settings.preset == "paper" else "wls")
    consistent = word == "sdp" or (
        settings.estimator is None and settings.weighting == "joint" and installed("clarabel")
    )
    if ill_conditioned and consistent:
        return PhysicallyConsistent(prior_gain=prior, by_regions=True)
    if word != "wls":
        return estimator_of(word, prior)
    groups = None
    if settings.weighting == "size":
        torque = robot.limits.torque
        if not np.isfinite(torque).all():
            raise InputError(
                "joint sizes are told by torque limits, and this robot has none",
                where="--weighting size",
                value=robot.name,
            )
        groups = tuple(int(k) for k in np.unique(torque, return_inverse=True)[1])
    return WeightedLeastSquares(groups=groups, prior_gain=prior)
