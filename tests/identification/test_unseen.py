"""Torque intervals grow where a recording showed nothing of friction and motor inertia."""

import numpy as np
import pytest

from dynid.identification import MotionRange
from dynid.identification.selection.unseen import Unseen, unseen
from dynid.robot import load_robot

EACH = np.ones(6)


def known(still: int | None = None) -> Unseen:
    """Of a UR5 that moved at 0.5 rad/s and 2 rad/s^2, but for one joint."""
    parameters = {"Fc1": 12.0, "Fv1": 6.0, "Fc2": 12.0, "Fv2": 6.0, "Im3": 1.5}
    reach = EACH.copy()
    if still is not None:
        reach[still] = 1e-4
    motion = MotionRange(lower=0 * EACH, upper=reach, speed=0.5 * EACH, acceleration=2 * EACH)
    return unseen(load_robot("ur5"), parameters, motion)


def deviation(of: Unseen, speed: float, acceleration: float) -> np.ndarray:
    shape = np.ones((6, 1))
    return of.deviation(speed * shape, acceleration * shape, 10 * shape, 0.3 * EACH)[:, 0]


def test_nothing_is_added_within_the_recorded_motion() -> None:
    np.testing.assert_array_equal(deviation(known(), 0.5, 2.0), 0.0)


def test_the_power_of_speed_is_unknown_beyond_it() -> None:
    """Friction of 10 N.m at twice the speed: 2^0.1 of it."""
    np.testing.assert_allclose(deviation(known(), 1.0, 2.0), 10 * np.log(2) / 10)


def test_what_stayed_below_the_error_grows_with_the_acceleration() -> None:
    np.testing.assert_allclose(deviation(known(), 0.5, 6.0), 2 * 0.3)


def test_a_joint_that_stood_has_the_friction_of_the_others() -> None:
    """15 of 150 N.m, 1.5 kg.m^2 of 150: of wrists with 28 N.m."""
    found = deviation(known(still=5), 3.0, 10.0)
    assert found[5] == pytest.approx(np.hypot(2.8, 0.28 * 10))
    np.testing.assert_allclose(found[:5], deviation(known(), 3.0, 10.0)[:5])
