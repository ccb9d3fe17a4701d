"""Finite Fourier series, the paper's excitation trajectory."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dynid.core.arrays import Array, frozen
from dynid.core.errors import InputError
from dynid.trajectory.motion import JointMotion
from dynid.trajectory.trajectory import Trajectory


@dataclass(frozen=True, slots=True, kw_only=True)
class FourierSeries(Trajectory):
    """A periodic motion, q = q0 + sum_l a_l sin(w l t) - b_l cos(w l t) with w = 2 pi / period.

    Raises:
        InputError: A period that is not positive, shapes that disagree, no harmonics, or numbers
            that are not finite.
    """

    period: float
    """Time after which the motion repeats [s]."""
    offset: Array
    """(n) q0, the mean positions [rad or m]."""
    a: Array
    """(n, H) sine coefficients, harmonics 1 to H [rad or m]."""
    b: Array
    """(n, H) negated cosine coefficients, harmonics 1 to H [rad or m]."""

    def __post_init__(self) -> None:
        check_period(self.period)
        object.__setattr__(self, "period", float(self.period))
        offset = frozen(self.offset, shape=(None,), name="offset")
        a, b = coefficients(self.a, self.b, len(offset))
        for name, value in (("offset", offset), ("a", a), ("b", b)):
            object.__setattr__(self, name, value)

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return len(self.offset)

    @property
    def harmonics(self) -> int:
        """Number of harmonics H."""
        return self.a.shape[1]

    @property
    def duration(self) -> float:
        """The period [s]."""
        return self.period

    def evaluate(self, t: ArrayLike) -> JointMotion:
        """The motion at any times, from the analytic derivatives.

        Args:
            t: (N) times [s]; the motion repeats outside one period.

        Raises:
            InputError: Times that are not a list of finite numbers.
        """
        times = frozen(t, shape=(None,), name="t")
        # Reducing the time first keeps late periods as exact as the first one.
        basis = harmonic_basis(np.mod(times, self.period), self.period, self.harmonics)
        numbers = np.hstack([self.a, self.b]).T
        q, dq, ddq = (part @ numbers for part in basis)
        return JointMotion(t=times, q=self.offset + q, dq=dq, ddq=ddq)

    def sample(self, rate_hz: float, periods: int = 1) -> JointMotion:
        """The motion on a regular grid that starts at zero and leaves the last end out.

        Args:
            rate_hz: Samples a second.
            periods: How many periods.

        Raises:
            InputError: A rate or a number of periods that is not positive.
        """
        if not (math.isfinite(rate_hz) and rate_hz > 0) or periods < 1:
            raise InputError("rate and periods must be positive", value=(rate_hz, periods))
        return self.evaluate(np.arange(round(self.period * periods * rate_hz)) / rate_hz)


def check_period(period: float) -> None:
    """Refuse what is no period.

    Args:
        period: Period [s].

    Raises:
        InputError: A period that is not a positive finite number.
    """
    if not (math.isfinite(period) and period > 0):
        raise InputError("the period must be positive", value=period)


def coefficients(a: ArrayLike, b: ArrayLike, joints: int) -> tuple[Array, Array]:
    """The coefficients of a series, checked and read-only.

    Args:
        a: (n, H) sine coefficients.
        b: (n, H) negated cosine coefficients.
        joints: n.

    Raises:
        InputError: Shapes that disagree, no joints or harmonics, or numbers that are not finite.
    """
    sines = frozen(a, shape=(joints, None), name="a")
    if sines.size == 0:
        raise InputError("a Fourier series needs a joint and a harmonic", value=sines.shape)
    return sines, frozen(b, shape=sines.shape, name="b")


def harmonic_basis(t: Array, period: float, harmonics: int) -> tuple[Array, Array, Array]:
    """The series' columns and their first two time derivatives.

    With x = [a; b] of one joint (2H), q - q0, dq and ddq are the three matrices times x.

    Args:
        t: (N) times [s].
        period: Period [s].
        harmonics: Number of harmonics H.

    Returns:
        Three (N, 2H) matrices [1, 1/s, 1/s^2].
    """
    rate = np.arange(1, harmonics + 1, dtype=np.float64) * (2.0 * np.pi / period)
    phase = np.multiply.outer(t, rate)
    sine, cosine = np.sin(phase), np.cos(phase)
    return (
        np.hstack([sine, -cosine]),
        np.hstack([cosine * rate, sine * rate]),
        np.hstack([-sine * rate**2, cosine * rate**2]),
    )
