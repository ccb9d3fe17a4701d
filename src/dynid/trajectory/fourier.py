"""Finite Fourier series, the excitation trajectory of the paper, at rest at both ends."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import Array, InputError, frozen, read_only
from dynid.trajectory.trajectory import JointMotion, MotionFamily, Trajectory


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


def rest_basis(harmonics: int) -> Array:
    """An orthonormal basis of the coefficients with no velocity and acceleration at the ends.

    dq(0) = 0 means sum_l l a_l = 0, and ddq(0) = 0 means sum_l l^2 b_l = 0 (by periodicity also
    at the end). With Z the basis of both null spaces, [a; b] = Z y for free numbers y: the
    conditions hold exactly and an optimiser needs no equality constraints.

    Args:
        harmonics: Number of harmonics H, at least 2.

    Returns:
        (2H, 2H - 2) Z, the a rows first.

    Raises:
        InputError: Fewer than two harmonics.
    """
    if harmonics < 2:
        raise InputError("a motion from rest to rest needs two harmonics", value=harmonics)
    order = np.arange(1.0, harmonics + 1)
    basis = np.zeros((2 * harmonics, 2 * harmonics - 2))
    basis[:harmonics, : harmonics - 1] = _orthogonal_complement(order)
    basis[harmonics:, harmonics - 1 :] = _orthogonal_complement(order**2)
    return read_only(basis)


def held_basis(harmonics: int) -> Array:
    """An orthonormal basis of the coefficients that also start and end at the offset.

    To the conditions of `rest_basis`, q(0) = q0 adds sum_l b_l = 0.

    Args:
        harmonics: Number of harmonics H, at least 3.

    Returns:
        (2H, 2H - 3) basis, the a rows first.

    Raises:
        InputError: Fewer than three harmonics.
    """
    if harmonics < 3:
        raise InputError("a motion held at both ends needs three harmonics", value=harmonics)
    order = np.arange(1.0, harmonics + 1)
    cosines = _orthogonal_complement(order**2)
    # Within the cosines that have no acceleration at the ends, those that add up to zero.
    cosines = cosines @ _orthogonal_complement(cosines.sum(axis=0))
    basis = np.zeros((2 * harmonics, 2 * harmonics - 3))
    basis[:harmonics, : harmonics - 1] = _orthogonal_complement(order)
    basis[harmonics:, harmonics - 1 :] = cosines
    return read_only(basis)


def rest_series(period: float, offset: ArrayLike, free: ArrayLike) -> FourierSeries:
    """The series from the free numbers of each joint.

    Args:
        period: Period [s].
        offset: (n) mean positions [rad or m].
        free: (n, 2H - 2) coordinates in `rest_basis(H)` [rad or m].

    Raises:
        InputError: Shapes that disagree, or a number of columns that is odd or zero.
    """
    numbers = frozen(free, shape=(np.size(offset), None), name="free coefficients")
    columns = numbers.shape[1]
    if columns == 0 or columns % 2:
        raise InputError("each joint needs 2H - 2 free coefficients", value=columns)
    harmonics = columns // 2 + 1
    coefficients = numbers @ rest_basis(harmonics).T
    return FourierSeries(
        period=period,
        offset=frozen(offset, shape=(None,), name="offset"),
        a=coefficients[:, :harmonics],
        b=coefficients[:, harmonics:],
    )


def _orthogonal_complement(direction: Array) -> Array:
    # A Householder reflection takes `direction` to the first axis, so its other columns are an
    # orthonormal basis of the rest: no factorisation whose signs depend on the LAPACK at hand.
    mirror = direction / np.linalg.norm(direction)
    mirror[0] += 1.0 if mirror[0] >= 0.0 else -1.0
    reflection = np.eye(len(mirror)) - 2.0 * np.outer(mirror, mirror) / (mirror @ mirror)
    return reflection[:, 1:]


@dataclass(frozen=True, slots=True, kw_only=True)
class FourierFamily(MotionFamily):
    """The paper's series with no velocity and acceleration at the ends; the offset is q0.

    Raises:
        InputError: A period that is not positive, or fewer than two harmonics.
    """

    name: ClassVar[str] = "fourier"
    period: float
    """Period [s]."""
    harmonics: int
    """Number of harmonics H, at least 2."""

    def __post_init__(self) -> None:
        check_period(self.period)
        self._coefficients()

    @property
    def duration(self) -> float:
        """The period [s]."""
        return self.period

    @property
    def free_count(self) -> int:
        """2H - 2 free numbers of each joint."""
        return self._coefficients().shape[1]

    def basis(self, t: Array) -> tuple[Array, Array, Array]:
        """The harmonics' columns in the coordinates of `rest_basis`.

        Args:
            t: (N) times [s].
        """
        free = self._coefficients()
        q, dq, ddq = harmonic_basis(np.mod(t, self.period), self.period, self.harmonics)
        return q @ free, dq @ free, ddq @ free

    def trajectory(self, offset: ArrayLike, free: ArrayLike) -> FourierSeries:
        """The series with these numbers.

        Args:
            offset: (n) mean positions q0 [rad or m].
            free: (n, k) free numbers, a row a joint [rad or m].

        Raises:
            InputError: Shapes that disagree, or numbers that are not finite.
        """
        middle = frozen(offset, shape=(None,), name="offset")
        numbers = frozen(free, shape=(len(middle), self.free_count), name="free numbers")
        coefficients = numbers @ self._coefficients().T
        return FourierSeries(
            period=self.period,
            offset=middle,
            a=coefficients[:, : self.harmonics],
            b=coefficients[:, self.harmonics :],
        )

    def _coefficients(self) -> Array:
        """(2H, k) [a; b] of one joint is this matrix times its free numbers."""
        return rest_basis(self.harmonics)


@dataclass(frozen=True, slots=True, kw_only=True)
class ModifiedFourierFamily(FourierFamily):
    """A periodic series that also starts and ends at a given pose: the offset.

    Meets what Wu et al. (2012), doi 10.5772/45818, ask of their modified Fourier series: periodic,
    with position, velocity and acceleration given at the ends. Their own formula was not at hand;
    this one is the whole space of series of H harmonics that meets the conditions.

    Raises:
        InputError: A period that is not positive, or fewer than three harmonics.
    """

    name: ClassVar[str] = "modified-fourier"

    def __post_init__(self) -> None:
        if self.harmonics < 3:
            raise InputError(
                "a series that starts at a given pose needs three harmonics", value=self.harmonics
            )
        check_period(self.period)

    def _coefficients(self) -> Array:
        return held_basis(self.harmonics)
