"""Friction as a function of joint temperature, from records at several temperatures.

Viscous friction falls with temperature, Fv(T) = Fv exp(-b (T - T0)) or Fv (1 - b (T - T0));
Coulomb friction changes little, Fc(T) = Fc (1 - c (T - T0)). What else a joint has stays as it
is. The laws are fitted joint by joint, by generalised least squares, to the friction of each
record with its covariance; b is the only parameter that is not linear.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynid.core import Array, InputError, JobError, freeze

LAWS = ("exponential", "linear")
LEAST_SPREAD_K = 3.0
"""Temperatures of a joint that differ by less tell nothing of its law [K]."""
VARIES = {"Fv": "law", "Fc": "linear"}
"""Which friction parameters change with temperature, and how."""
ITERATIONS = 50
CONVERGED = 1e-10


@dataclass(frozen=True, slots=True, kw_only=True)
class JointTemperatureLaw:
    """The friction of one joint at any temperature.

    Raises:
        InputError: Shapes that disagree.
    """

    symbols: tuple[str, ...]
    """(f) its friction parameters, e.g. `Fc`, `Fv`."""
    law: str
    """`exponential`, `linear`, or `constant` where temperatures hardly differed."""
    reference: Array
    """(f) values at the reference temperature."""
    slope: Array
    """(f) relative change per degree there, positive for a fall [1/K]."""
    covariance: Array
    """(2 f, 2 f) of `reference`, then `slope`; zero where a slope is fixed at zero."""
    gain: Array
    """(2 f, R f) how both move with the records' own parameters, record by record."""
    reference_degC: float
    """The reference temperature [degC]."""
    range_degC: tuple[float, float]
    """Lowest and highest temperature of the records [degC]."""
    chi_squared: float
    """Weighted residual sum of the fit."""

    def __post_init__(self) -> None:
        f = len(self.symbols)
        freeze(self, "laws:", reference=(f,), slope=(f,), covariance=(2 * f, 2 * f))
        freeze(self, "laws:", gain=(2 * f, None))

    def at(self, temperature_degC: float) -> tuple[Array, Array]:
        """Friction parameters (f) at a temperature [degC].

        And their derivative (f, 2 f) by `reference` and `slope`.
        """
        rise = temperature_degC - self.reference_degC
        return _evaluate(self.law, self.symbols, self.reference, self.slope, rise)


def fit_law(
    values: Array,
    covariance: Array,
    temperature_degC: Array,
    symbols: Sequence[str],
    *,
    law: str = "auto",
) -> JointTemperatureLaw:
    """Fit the laws of one joint.

    Args:
        values: (R, f) its friction parameters in each record.
        covariance: (R f, R f) their covariance, record by record.
        temperature_degC: (R) its temperature in each record [degC].
        symbols: (f) names of the parameters without the joint, e.g. `Fc`, `Fv`.
        law: `exponential`, `linear`, or `auto` for the one that fits better.

    Raises:
        InputError: An unknown law.
        JobError: The exponential law does not converge.
    """
    if law not in (*LAWS, "auto"):
        raise InputError("unknown law", value=law, limit=(*LAWS, "auto"))
    if np.ptp(temperature_degC) < LEAST_SPREAD_K:
        return _fit(values, covariance, temperature_degC, tuple(symbols), "constant")
    tried = [
        _fit(values, covariance, temperature_degC, tuple(symbols), word)
        for word in (LAWS if law == "auto" else (law,))
    ]
    return min(tried, key=lambda one: one.chi_squared)


def _fit(
    values: Array, covariance: Array, temperature: Array, symbols: tuple[str, ...], law: str
) -> JointTemperatureLaw:
    """Gauss-Newton in reference values and slopes, from the linear law's answer."""
    records, count = values.shape
    reference_degC = float(temperature.mean())
    rises = (temperature - reference_degC).tolist()
    varying = [k for k, s in enumerate(symbols) if law != "constant" and s in VARIES]
    free = [*range(count), *(count + k for k in varying)]
    scale = np.sqrt(np.diag(covariance))
    root = np.linalg.cholesky(covariance / np.outer(scale, scale))
    white = np.asarray(np.linalg.inv(root), dtype=np.float64) / scale
    reference, slope = values.mean(axis=0), np.zeros(count)
    inner = np.zeros((len(free), records * count))
    for _ in range(ITERATIONS):
        found = [_evaluate(law, symbols, reference, slope, rise) for rise in rises]
        predicted, turn = np.array([v for v, _ in found]), np.vstack([s[:, free] for _, s in found])
        inner = np.linalg.pinv(white @ turn) @ white
        step = np.zeros(2 * count)
        step[free] = inner @ (values - predicted).ravel()
        reference, slope = reference + step[:count], slope + step[count:]
        if (np.abs(step[:count]) <= CONVERGED * (np.abs(reference) + 1e-12)).all():
            break
    else:
        raise JobError("the temperature law does not converge", value=law)
    gain = np.zeros((2 * count, records * count))
    gain[free] = inner
    predicted = np.array([_evaluate(law, symbols, reference, slope, rise)[0] for rise in rises])
    return JointTemperatureLaw(
        symbols=symbols,
        law=law,
        reference=reference,
        slope=slope,
        covariance=gain @ covariance @ gain.T,
        gain=gain,
        reference_degC=reference_degC,
        range_degC=(float(temperature.min()), float(temperature.max())),
        chi_squared=float(np.square(white @ (values - predicted).ravel()).sum()),
    )


def _evaluate(
    law: str, symbols: tuple[str, ...], reference: Array, slope: Array, rise: float
) -> tuple[Array, Array]:
    """Values (f) at a rise of temperature, and their slopes (f, 2 f) by reference and slope."""
    curved = np.array([law == "exponential" and VARIES.get(s) == "law" for s in symbols])
    decay = np.exp(-slope * rise)
    factor = np.where(curved, decay, 1.0 - slope * rise)
    change = -rise * np.where(curved, decay, 1.0)
    return reference * factor, np.hstack([np.diag(factor), np.diag(reference * change)])
