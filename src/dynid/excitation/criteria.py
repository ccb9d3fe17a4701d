"""What makes a motion informative: numbers of its Gram matrix, and their derivatives.

All are functions of G = W_B' Omega^-1 W_B alone, smaller is better. The noise of the joints is in
G already (`GramKernel`); every criterion can add the information of earlier records, G + G_0, and
scale the parameters by their magnitudes, D (G + G_0) D. See methods.md 2.3.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dynid import reduction, regressor
from dynid.core import Array, check_word, read_only
from dynid.robot import RobotModel

SPREAD = 1e-7
"""Below this ratio of the extreme eigenvalues, rounding shows in the smallest one."""
SINGULAR = 1e-13
"""A column of which this share is independent of those before it is a combination of them."""


def eigenvectors(matrix: Array) -> tuple[Array, Array] | None:
    """Eigenvalues (b), smallest first, and vectors in columns (b, b); None if it is singular."""
    if not _is_usable(matrix):
        return None
    values, vectors = np.linalg.eigh(matrix)
    if values[0] > SPREAD * values[-1]:
        return values, vectors
    factor = _factor(matrix)
    if factor is None:
        return None
    # Singular values of the triangle keep the digits that squaring loses.
    left, singular, _ = np.linalg.svd(factor)
    return np.square(singular[::-1]), left[:, ::-1]


def normalised(matrix: Array) -> tuple[Array, Array] | None:
    """The Gram matrix of the columns scaled to unit norm, and the norms (b); None if one is 0."""
    if not _is_usable(matrix):
        return None
    norms = np.sqrt(np.diag(matrix))
    return matrix / norms[:, None] / norms, norms


def inverse(matrix: Array) -> tuple[Array, float] | None:
    """The inverse (b, b) and the logarithm of the determinant; None if it is singular."""
    unit = normalised(matrix)
    factor = None if unit is None else _factor(unit[0])
    if unit is None or factor is None:
        return None
    whole = np.linalg.inv(unit[0])
    log_det = 2.0 * float(np.log(np.diag(factor)).sum() + np.log(unit[1]).sum())
    return (whole + whole.T) / 2 / unit[1][:, None] / unit[1], log_det


def _is_usable(matrix: Array) -> bool:
    return bool(np.isfinite(matrix).all()) and bool((np.diag(matrix) > 0).all())


def _factor(matrix: Array) -> Array | None:
    """The lower Cholesky factor; None if a column is a combination of those before it."""
    try:
        factor = np.asarray(np.linalg.cholesky(matrix), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
    left = np.square(np.diag(factor)) > SINGULAR * np.diag(matrix)
    return factor if left.all() else None


FRICTION_SHARE = 0.1
"""Of a joint's torque limit that Coulomb friction takes; viscous friction at full speed alike."""
FULL_SPEED_AFTER = 0.2
"""[s] at the acceleration where a motor's inertia takes the same share, if no limit is known."""
LEAST_SHARE = 0.01
"""No parameter is taken for smaller than this share of the largest with its unit."""


def prior_scale(base: reduction.BaseParametrization) -> Array:
    """(b) magnitudes D of the base parameters, in their units.

    Where the robot gives masses, a first moment is as large as the mass times the largest of the
    distance to the centre of mass and the radius of gyration, an inertia as the mass times its
    square. Where it gives torque and speed limits, friction takes a tenth of the torque at any
    speed and at full speed, motor inertia at the largest acceleration. Anything else is 1. A base
    parameter is as large as what is regrouped into it, added as if unrelated.
    """
    standard = np.concatenate([_inertial(base.model.robot), _beside(base.model)])
    parts = base.regrouping * standard[list(base.dependent)]
    scale = np.hypot(standard[list(base.independent)], np.linalg.norm(parts, axis=1))
    units = np.array(base.units)
    for unit in set(base.units):
        same = units == unit
        scale[same] = np.maximum(scale[same], LEAST_SHARE * scale[same].max())
    return read_only(scale)


def _inertial(robot: RobotModel) -> Array:
    out = np.ones((robot.joints, 10))
    for link, given in zip(out, robot.inertias, strict=True):
        mass = given[0]
        if not (np.isfinite(mass) and mass > 0):
            continue
        moment, inertia = np.nan_to_num(given[1:4]), np.nan_to_num(given[4:7])
        squares = (float(moment @ moment) / mass**2, float(inertia.max()) / mass)
        length = np.sqrt(max(squares))
        if length > 0:
            link[0], link[1:4], link[4:] = mass, mass * length, mass * length**2
    return out.ravel()


def _beside(model: regressor.InverseDynamicModel) -> Array:
    limits = model.robot.limits
    torque = FRICTION_SHARE * limits.torque
    acceleration = np.where(
        np.isfinite(limits.acceleration), limits.acceleration, limits.velocity / FULL_SPEED_AFTER
    )
    sizes = {"": torque, "speed": torque / limits.velocity, "acceleration": torque / acceleration}
    columns = model.columns[10 * model.robot.joints :]
    found = np.array([sizes[_multiplies(column.unit)][column.joint] for column in columns])
    return np.where(np.isfinite(found), found, 1.0)


def _multiplies(unit: str) -> str:
    """What a parameter of this unit multiplies to give a torque or a force."""
    if unit in ("kg.m^2", "kg"):
        return "acceleration"
    return "speed" if "s/" in unit else ""


SIGMA_WEIGHT = 100.0
"""Of 1 / sigma_min beside cond, as BIRDy takes it."""
GUARD = 0.3
"""Measured on the UR5: worst parameter as known as by `cond`, torque error 1 % above guard 0."""
GUARD_NORM = 8.0


@dataclass(frozen=True, kw_only=True)
class Criterion(ABC):
    """A function of the Gram matrix. Infinite, with a gradient of zero, where G is singular."""

    name: ClassVar[str]
    """As `--criterion` takes it."""
    positive: ClassVar[bool] = True
    """Whether optimisers see the logarithm."""
    scale: Array | None = None
    """(b) D, magnitudes of the base parameters; None for parameters in SI units."""
    previous: Array | None = None
    """(b, b) G_0, the Gram matrix of what is recorded already."""

    @abstractmethod
    def evaluate(self, matrix: Array) -> tuple[float, Array] | None:
        """The criterion of a scaled matrix (b, b); None if that is singular.

        Returns:
            The value, and S (b, b) with d value = tr(S d matrix).
        """

    def value(self, gram: Array) -> float:
        """The criterion, in the unit in which it is reported."""
        return self.value_and_gradient(gram)[0]

    def value_and_gradient(self, gram: Array) -> tuple[float, Array]:
        """The criterion, and S (b, b), symmetric, with d value = tr(S dG)."""
        scales = 1.0 if self.scale is None else np.outer(self.scale, self.scale)
        matrix = gram if self.previous is None else gram + self.previous
        found = self.evaluate(matrix * scales)
        if found is None or not np.isfinite(found[1]).all():
            return math.inf, np.zeros_like(gram)
        return found[0], found[1] * scales

    def objective(self, gram: Array) -> float:
        """What optimisers minimise: the logarithm of a positive criterion, else its value."""
        return self.objective_and_gradient(gram)[0]

    def objective_and_gradient(self, gram: Array) -> tuple[float, Array]:
        """The objective, and S (b, b), symmetric, with d objective = tr(S dG)."""
        value, slope = self.value_and_gradient(gram)
        if not self.positive:
            return value, slope
        return math.log(value), slope / value


Extreme = tuple[float, Array]
"""Logarithm of an extreme, and its derivative (b) by the logarithms of the eigenvalues."""


@dataclass(frozen=True, kw_only=True)
class OfExtremes(Criterion):
    """A function of the largest and the smallest eigenvalue.

    Where several eigenvalues share the smallest place, as they do near every optimum, the smallest
    one has a kink and a gradient method stops there. With a sharpness p norms take the place of
    both: (sum lambda^p)^(1/p) for the largest and (sum lambda^-p)^(-1/p) for the smallest, which
    are smooth, bound the true ones, and meet them as p grows. p = 1 for the smallest is
    A-optimality.
    """

    sharpness: float = math.inf
    """p; infinite for the eigenvalues themselves."""

    @abstractmethod
    def combine(self, high: Extreme, low: Extreme) -> tuple[float, Array]:
        """The value, and its derivative (b) by the logarithms of the eigenvalues."""

    def evaluate(self, matrix: Array) -> tuple[float, Array] | None:
        """See `Criterion`."""
        found = eigenvectors(matrix)
        if found is None:
            return None
        values, vectors = found
        logs = np.log(values)
        value, slopes = self.combine(self._extreme(logs, -1), self._extreme(logs, 0))
        return value, (vectors * (slopes / values)) @ vectors.T

    def _extreme(self, logs: Array, place: int) -> Extreme:
        """The last (-1) or the first (0) of ascending logarithms (b), softened."""
        p = self.sharpness
        if math.isinf(p):
            shares = np.zeros(len(logs))
            shares[place] = 1.0
            return float(logs[place]), shares
        sign = 1.0 if place else -1.0
        powers = np.exp(sign * p * (logs - logs[place]))
        total = powers.sum()
        return float(logs[place] + sign * math.log(total) / p), powers / total


def smoothed(criterion: Criterion, sharpness: float) -> Criterion:
    """The smooth relative of a criterion; criteria that are smooth come back as they are."""
    if isinstance(criterion, OfExtremes):
        return replace(criterion, sharpness=sharpness)
    return criterion


@dataclass(frozen=True, kw_only=True)
class Condition(OfExtremes):
    """The paper's: condition number of W_B, sigma_max / sigma_min."""

    name: ClassVar[str] = "cond"

    def combine(self, high: Extreme, low: Extreme) -> tuple[float, Array]:
        """See `OfExtremes`."""
        value = math.exp((high[0] - low[0]) / 2)
        return value, value / 2 * (high[1] - low[1])


@dataclass(frozen=True, kw_only=True)
class DOptimal(Criterion):
    """D-optimality, -log det G: the volume of the confidence ellipsoid."""

    name: ClassVar[str] = "d-opt"
    positive: ClassVar[bool] = False

    def evaluate(self, matrix: Array) -> tuple[float, Array] | None:
        """See `Criterion`."""
        found = inverse(matrix)
        return None if found is None else (-found[1], -found[0])


@dataclass(frozen=True, kw_only=True)
class AOptimal(Criterion):
    """A-optimality, tr (D G D)^-1: the sum of the variances, relative to D squared."""

    name: ClassVar[str] = "a-opt"

    def evaluate(self, matrix: Array) -> tuple[float, Array] | None:
        """See `Criterion`."""
        found = inverse(matrix)
        if found is None:
            return None
        covariance = found[0]
        return float(np.trace(covariance)), -covariance @ covariance


@dataclass(frozen=True, kw_only=True)
class EOptimal(OfExtremes):
    """E-optimality, 1 / lambda_min: the longest axis of the confidence ellipsoid, squared."""

    name: ClassVar[str] = "e-opt"

    def combine(self, high: Extreme, low: Extreme) -> tuple[float, Array]:
        """See `OfExtremes`."""
        value = math.exp(-low[0])
        return value, -value * low[1]


@dataclass(frozen=True, kw_only=True)
class ConditionAndSigma(OfExtremes):
    """cond + weight / sigma_min, after Presse and Gautier: small parameters count too."""

    name: ClassVar[str] = "cond+sigma"

    def combine(self, high: Extreme, low: Extreme) -> tuple[float, Array]:
        """See `OfExtremes`."""
        condition = math.exp((high[0] - low[0]) / 2)
        sigma = SIGMA_WEIGHT * math.exp(-low[0] / 2)
        return condition + sigma, condition / 2 * (high[1] - low[1]) - sigma / 2 * low[1]


@dataclass(frozen=True, kw_only=True)
class Prediction(Criterion):
    """Expected torque variance over the motions that the model is for, tr(C M), times a guard.

    C = (G + G_0)^-1 is the covariance of the estimate and M the second moment of the purpose's
    regressor over the noise (I-optimality, also called V-optimality). The second factor, the
    largest variance of a parameter to the power `GUARD`, bounds the worst parameter: prediction
    alone leaves it with twice the deviation, and the bound costs 1 % of the torque error.
    """

    name: ClassVar[str] = "prediction"
    moment: Array | None = None
    """(b, b) M; None for the identity, by which every parameter counts alike."""

    def evaluate(self, matrix: Array) -> tuple[float, Array] | None:
        """See `Criterion`."""
        found = inverse(matrix)
        if found is None:
            return None
        covariance = found[0]
        scale = np.ones(len(matrix)) if self.scale is None else self.scale
        moment = np.eye(len(matrix)) if self.moment is None else self.moment
        moment = moment * np.outer(scale, scale)
        spread = float((covariance * moment).sum())
        # A norm of high order stands for the maximum, which has kinks.
        variances = np.diag(covariance) * np.square(scale)
        shares = np.power(variances / variances.max(), GUARD_NORM)
        worst = float(variances.max() * shares.sum() ** (1 / GUARD_NORM))
        value = spread * worst**GUARD
        pull = moment / spread
        pull += np.diag(GUARD * shares / shares.sum() / np.diag(covariance))
        return value, -value * (covariance @ pull @ covariance)


CRITERIA: dict[str, type[Criterion]] = {
    kind.name: kind
    for kind in (Prediction, Condition, DOptimal, AOptimal, EOptimal, ConditionAndSigma)
}


def parse_criterion(
    name: str,
    *,
    scale: Array | None = None,
    previous: Array | None = None,
    moment: Array | None = None,
) -> Criterion:
    """The criterion that `--criterion` names.

    Args:
        name: One of `CRITERIA`.
        scale: (b) magnitudes of the base parameters; None for SI units.
        previous: (b, b) Gram matrix of what is recorded already.
        moment: (b, b) of the purpose, for `prediction`; see `Prediction`.

    Raises:
        InputError: A name that is none of them.
    """
    check_word(name, CRITERIA, "--criterion")
    if name == Prediction.name:
        return Prediction(scale=scale, previous=previous, moment=moment)
    return CRITERIA[name](scale=scale, previous=previous)


def all_criteria(gram: Array, *, scale: Array | None = None) -> dict[str, float]:
    """Every criterion of a Gram matrix (b, b) by name, with the scale (b) of the A-optimal one."""
    return {
        name: parse_criterion(name, scale=scale if name == AOptimal.name else None).value(gram)
        for name in CRITERIA
    }


def scaled_condition_number(gram: Array) -> float:
    """Condition number of W_B with its columns scaled to unit norm; infinite if it is singular."""
    unit = normalised(gram)
    return math.inf if unit is None else Condition().value(unit[0])
