"""The families by name."""

from __future__ import annotations

from collections.abc import Callable

from dynid.core.errors import InputError
from dynid.trajectory.bspline import BSplineFamily
from dynid.trajectory.family import MotionFamily
from dynid.trajectory.fourier_family import FourierFamily, ModifiedFourierFamily
from dynid.trajectory.fourier_quintic import FourierQuinticFamily
from dynid.trajectory.poses import PosesFamily

_MAKERS: dict[str, Callable[[float, int], MotionFamily]] = {
    FourierFamily.name: lambda duration, order: FourierFamily(period=duration, harmonics=order),
    ModifiedFourierFamily.name: lambda duration, order: ModifiedFourierFamily(
        period=duration, harmonics=order
    ),
    FourierQuinticFamily.name: lambda duration, order: FourierQuinticFamily(
        period=duration, harmonics=order
    ),
    BSplineFamily.name: lambda duration, order: BSplineFamily(
        travel_time=duration, points=2 * order
    ),
    PosesFamily.name: lambda duration, order: PosesFamily(travel_time=duration, poses=order),
}

FAMILY_NAMES = tuple(_MAKERS)
"""Names that `motion_family` knows."""


def motion_family(name: str, duration: float, harmonics: int) -> MotionFamily:
    """A family by its name.

    Args:
        name: One of `FAMILY_NAMES`.
        duration: Time from start to end, the period [s].
        harmonics: Number of harmonics H. A B-spline gets 2H free points, as many as the series
            has sines and cosines; a motion through poses rests in H of them.

    Raises:
        InputError: An unknown name, or a duration or number of harmonics that is not allowed.
    """
    if name not in _MAKERS:
        raise InputError("unknown family of motions", value=name, limit=", ".join(FAMILY_NAMES))
    return _MAKERS[name](duration, harmonics)
