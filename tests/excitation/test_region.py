from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from design_arms import Floats, arm, problem
from scipy.optimize import approx_fprime

from dynid.core import InputError, MotionBounds
from dynid.excitation import MotionRegion, random_numbers, region_of
from dynid.trajectory import FAMILY_NAMES, motion_family

DENSE = 4001
SLOPE = 1e-5
"""Of central differences."""


def bounds() -> MotionBounds:
    limits = arm().limits
    return MotionBounds(
        lower=limits.lower,
        upper=limits.upper,
        velocity=limits.velocity,
        acceleration=np.array([10.0, np.inf, 10.0]),
    )


def uses(region: MotionRegion, family: str, x: Floats) -> Floats:
    """(3, n) the largest share of the bounds of q, dq, ddq, seen densely."""
    made = motion_family(family, 6.0, 4)
    t = np.linspace(0.0, made.duration, DENSE)
    seen = made.trajectory(x[:, 0], x[:, 1:]).evaluate(t)
    b = bounds()
    middle, half = (b.lower + b.upper) / 2, (b.upper - b.lower) / 2
    return np.stack(
        [
            (np.abs(seen.q - middle) / half).max(axis=0),
            (np.abs(seen.dq) / b.velocity).max(axis=0),
            (np.abs(seen.ddq) / b.acceleration).max(axis=0),
        ]
    )


@pytest.mark.parametrize("family", [name for name in FAMILY_NAMES if name != "points"])
def test_random_motions_meet_every_bound_and_touch_one(family: str) -> None:
    region = MotionRegion(motion_family(family, 6.0, 4), bounds())
    for x in random_numbers(region, 20, np.random.default_rng(1), fill=1.0):
        share = uses(region, family, x).max(axis=0)
        assert (share <= 1.0).all()
        assert (share > 0.97).all()


def test_motions_from_a_pose_start_there_and_stay_inside() -> None:
    pose = np.array([1.0, -1.5, 2.0])
    region = MotionRegion(motion_family("modified-fourier", 6.0, 4), bounds(), pose)
    for x in random_numbers(region, 20, np.random.default_rng(1), fill=1.0):
        np.testing.assert_array_equal(x[:, 0], pose)
        assert uses(region, "modified-fourier", x).max() <= 1.0


def test_barrier_has_the_derivatives_of_its_value() -> None:
    region = MotionRegion(motion_family("fourier", 6.0, 4), bounds())
    x = random_numbers(region, 1, np.random.default_rng(3), fill=0.7)[0]
    gradient, curvature = region.barrier_slopes(region.slack(x))

    def value(flat: Floats) -> float:
        return region.barrier_value(region.slack(flat.reshape(x.shape)))

    def slope(flat: Floats) -> Floats:
        return region.barrier_slopes(region.slack(flat.reshape(x.shape)))[0].ravel()

    numeric = approx_fprime(x.ravel(), value, 1e-7).reshape(x.shape)
    np.testing.assert_allclose(gradient, numeric, rtol=SLOPE, atol=1e-3)
    curved = approx_fprime(x.ravel(), slope, 1e-7)
    for j, block in enumerate(curvature):
        part = slice(j * x.shape[1], (j + 1) * x.shape[1])
        np.testing.assert_allclose(block, curved[part, part], rtol=1e-4, atol=1e-2)


@pytest.mark.parametrize("pose", [None, np.array([1.0, -1.5, 2.0])])
def test_outside_the_barrier_is_infinite_and_pulling_inside_helps(pose: Floats | None) -> None:
    family = "fourier" if pose is None else "modified-fourier"
    region = region_of(problem(family=family, start_pose=pose))
    x = 3.0 * random_numbers(region, 1, np.random.default_rng(3), fill=1.0)[0]
    assert region.barrier_value(region.slack(x)) == np.inf
    inside = region.pulled_inside(x)
    assert (region.slack(inside) > 0).all()
    if pose is not None:
        np.testing.assert_array_equal(inside[:, 0], pose)
    # The shapes stay; only size and place change.
    turned = inside[:, 1:] / np.linalg.norm(inside[:, 1:], axis=1, keepdims=True)
    before = x[:, 1:] / np.linalg.norm(x[:, 1:], axis=1, keepdims=True)
    np.testing.assert_allclose(turned, before, atol=1e-12)


def test_the_longest_step_stays_inside() -> None:
    region = region_of(problem())
    random = np.random.default_rng(5)
    for _ in range(20):
        x = random_numbers(region, 1, random, fill=0.8)[0]
        step = random.normal(size=x.shape) * 10.0
        length = region.longest_step(region.slack(x), step)
        assert length < 1.0
        assert (region.slack(x + length * step) > 0).all()
        assert (region.slack(x + 1.02 * length * step) < 0).any()


def test_joints_that_turn_without_end_are_refused_in_words_alone() -> None:
    endless = replace(bounds(), lower=np.full(3, -np.inf), upper=np.full(3, np.inf))
    with pytest.raises(InputError, match="no limit bounds the motion"):
        MotionRegion(motion_family("fourier", 6.0, 4), endless)


def test_a_start_pose_outside_is_refused() -> None:
    b = bounds()
    with pytest.raises(InputError, match="joint 1: the start pose is outside"):
        MotionRegion(motion_family("fourier", 6.0, 4), b, np.array([4.0, 0.0, 0.0]))
