"""The result of an identification, complete enough to prove itself and to predict."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dynid.core.arrays import Array, frozen, read_only
from dynid.core.errors import InputError
from dynid.core.notices import Notice
from dynid.core.provenance import Provenance
from dynid.identification.statistics import relative_std_percent
from dynid.regressor.model import InverseDynamicModel
from dynid.signals.samples import ProcessingSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionRange:
    """What the identification record covered; beyond it a prediction extrapolates."""

    lower: Array
    """(n) smallest position [rad or m]."""
    upper: Array
    """(n) largest position [rad or m]."""
    speed: Array
    """(n) largest speed [rad/s or m/s]."""
    acceleration: Array
    """(n) largest acceleration [rad/s^2 or m/s^2]."""


ORIGINS = ("data", "prior")


@dataclass(frozen=True, slots=True, kw_only=True)
class StandardParameters:
    """All standard parameters, of bodies that can exist, each with where it comes from.

    Raises:
        InputError: Shapes that disagree, or an unknown origin.
    """

    values: Array
    """(p) standard parameters."""
    std: Array
    """(p) standard deviations from the data; those of the prior's words mean nothing."""
    prior_share: Array
    """(p) 0: the data's word alone, to 1: the prior's alone."""
    prior: Array
    """(p) the prior, CAD or completed; NaN where there is none."""
    origins: tuple[str, ...]
    """(p) `data` or `prior`."""

    def __post_init__(self) -> None:
        p = len(self.origins)
        for name in ("values", "std", "prior_share", "prior"):
            value = frozen(getattr(self, name), shape=(p,), name=name, finite=name != "prior")
            object.__setattr__(self, name, value)
        if not set(self.origins) <= set(ORIGINS):
            raise InputError("unknown origin", value=set(self.origins), limit=ORIGINS)

    def to_json(self, names: tuple[str, ...], units: tuple[str, ...]) -> list[dict[str, Any]]:
        """One JSON object a parameter; no deviation where the prior speaks."""
        return [
            {
                "name": name,
                "value": float(self.values[k]),
                "unit": unit,
                "from": self.origins[k],
                "prior_share": float(self.prior_share[k]),
                "std": float(self.std[k]),
                "prior": float(self.prior[k]) if np.isfinite(self.prior[k]) else None,
            }
            for k, (name, unit) in enumerate(zip(names, units, strict=True))
        ]


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """Base parameters with their uncertainty.

    Raises:
        InputError: Shapes that disagree.
    """

    model: InverseDynamicModel
    independent: tuple[int, ...]
    """(r) base columns of the model."""
    expressions: tuple[str, ...]
    """(r) each base parameter in standard parameters."""
    values: Array
    """(r) base parameters, units in `units`."""
    covariance: Array
    """(r, r) covariance that allows for correlated residuals (HAC)."""
    naive_std: Array
    """(r) standard deviations if the residuals were white."""
    noise: Array
    """(n) residual standard deviation of each joint [N.m or N]."""
    condition_number: float
    """Of W with first-come columns, unscaled, as the paper's."""
    scaled_condition_number: float
    """Of W with columns of unit norm, whatever the choice of base columns."""
    motion_condition_number: float
    """The same for the motion without its noise and the paper's terms: how good the motion is."""
    samples: int
    """N, samples that entered the fit."""
    estimator: str
    preset: str
    settings: ProcessingSettings
    """How the record was processed; validation uses the same."""
    essential: tuple[int, ...]
    """Base parameters that the data really speak about."""
    motion: MotionRange
    choices: tuple[str, ...] = ()
    """What `--preset best` chose, in words."""
    warnings: tuple[Notice, ...] = ()
    provenance: Provenance
    residual_autocorrelation: Array = field(default_factory=lambda: np.zeros(0))
    """(n) autocorrelation of the residuals at one sample."""
    standard: StandardParameters | None = None
    """Consistent standard parameters, from estimators that find them (`sdp`)."""

    def __post_init__(self) -> None:
        r, n = len(self.independent), self.model.robot.joints
        shapes: dict[str, tuple[int, ...]] = {
            "values": (r,),
            "covariance": (r, r),
            "naive_std": (r,),
            "noise": (n,),
        }
        for name, shape in shapes.items():
            object.__setattr__(self, name, frozen(getattr(self, name), shape=shape, name=name))
        if len(self.expressions) != r:
            raise InputError("one expression a parameter", value=len(self.expressions), limit=r)
        if self.standard is not None and len(self.standard.values) != len(self.model.columns):
            raise InputError(
                "standard parameters do not fit the model",
                value=len(self.standard.values),
                limit=len(self.model.columns),
            )
        if max(self.independent, default=0) >= len(self.model.columns):
            raise InputError("base columns do not fit the model", value=max(self.independent))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the base parameters."""
        return tuple(self.model.names[i] for i in self.independent)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the base parameters."""
        return tuple(self.model.columns[i].unit for i in self.independent)

    @property
    def std(self) -> Array:
        """(r) standard deviations."""
        return read_only(np.sqrt(np.diag(self.covariance)))

    @property
    def relative_std_percent(self) -> Array:
        """(r) standard deviations as a share of the values [%]."""
        return relative_std_percent(self.values, self.std)

    @property
    def degrees_of_freedom(self) -> int:
        """Rows of W less parameters."""
        return self.samples * self.model.robot.joints - len(self.values)

    def standard_parameters(self) -> Array:
        """(p) standard parameters with these torques: consistent, or zero outside the base."""
        if self.standard is not None:
            return self.standard.values
        parameters = np.zeros(len(self.model.columns))
        parameters[list(self.independent)] = self.values
        return read_only(parameters)

    def predict(self, q: Array, dq: Array, ddq: Array, state: Array | None = None) -> Array:
        """Joint torques (N, n) [N.m or N], each argument (N, n).

        Samples stand for themselves. Those of a motion, in the order of time, show presliding
        friction as well, with `state` (n, N) from `InverseDynamicModel.friction_state`.
        """
        values = self.standard_parameters()
        torque = self.model.inverse_dynamics(q, dq, ddq, values, state)
        return read_only(torque - self.model.known_torque(q))

    def standard_table(self) -> list[dict[str, Any]] | None:
        """One JSON object a standard parameter, where the estimator finds them."""
        if self.standard is None:
            return None
        units = tuple(column.unit for column in self.model.columns)
        return self.standard.to_json(self.model.names, units)

    def parameter_table(self) -> list[dict[str, Any]]:
        """One JSON object a base parameter."""
        relative = self.relative_std_percent
        return [
            {
                "name": name,
                "value": float(self.values[k]),
                "unit": unit,
                "std": float(self.std[k]),
                "relative_std_percent": float(relative[k]) if np.isfinite(relative[k]) else None,
                "std_naive": float(self.naive_std[k]),
                "essential": k in self.essential,
                "expression": self.expressions[k],
            }
            for k, (name, unit) in enumerate(zip(self.names, self.units, strict=True))
        ]
