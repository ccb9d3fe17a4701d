import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.core import InputError
from dynid.trajectory import (
    FAMILY_NAMES,
    FourierFamily,
    ModifiedFourierFamily,
    MotionFamily,
    PointsFamily,
    motion_family,
)

# The asked boundary conditions: 1e-12 in rad, rad/s and rad/s^2, relative to how large they get.
AT_THE_ENDS = 1e-12


def families(duration: float = 7.0) -> list[MotionFamily]:
    return [motion_family(name, duration, 5) for name in FAMILY_NAMES]


@pytest.mark.parametrize("family", families(), ids=lambda family: family.name)
class TestEveryFamily:
    def test_basis_is_the_trajectory(self, family: MotionFamily) -> None:
        generator = np.random.default_rng(1)
        free, offset = generator.normal(size=(3, family.free_count)), generator.normal(size=3)
        t = np.linspace(0.0, family.duration, 83)
        motion = family.trajectory(offset, free).evaluate(t)
        q, dq, ddq = family.basis(t)
        assert q.shape == (83, family.free_count)
        np.testing.assert_allclose(motion.q, offset + q @ free.T, rtol=0, atol=1e-12)
        np.testing.assert_allclose(motion.dq, dq @ free.T, rtol=0, atol=1e-11)
        np.testing.assert_allclose(motion.ddq, ddq @ free.T, rtol=0, atol=1e-10)

    def test_rests_at_both_ends_at_one_pose(self, family: MotionFamily) -> None:
        generator = np.random.default_rng(2)
        free, offset = generator.normal(size=(4, family.free_count)), generator.normal(size=4)
        trajectory = family.trajectory(offset, free)
        inside = trajectory.evaluate(np.linspace(0, family.duration, 200))
        ends = trajectory.evaluate([0.0, family.duration])
        np.testing.assert_allclose(ends.q[0], ends.q[1], rtol=0, atol=AT_THE_ENDS)
        for name in ("dq", "ddq"):
            largest = max(1.0, np.abs(getattr(inside, name)).max())
            assert np.abs(getattr(ends, name)).max() < AT_THE_ENDS * largest

    def test_no_free_number_is_wasted(self, family: MotionFamily) -> None:
        q, _, _ = family.basis(np.linspace(0.0, family.duration, 400))
        assert np.linalg.matrix_rank(np.column_stack([q, np.ones(400)])) == family.free_count + 1

    def test_derivatives_agree_with_central_differences(self, family: MotionFamily) -> None:
        t, step = np.linspace(0.0531, family.duration - 0.05, 61), 1e-5
        before, now, after = (family.basis(t + k * step) for k in (-1, 0, 1))
        scale = np.abs(now[2]).max()
        np.testing.assert_allclose(now[1], (after[0] - before[0]) / (2 * step), atol=1e-8 * scale)
        np.testing.assert_allclose(now[2], (after[1] - before[1]) / (2 * step), atol=1e-7 * scale)

    def test_refuses_numbers_that_do_not_fit(self, family: MotionFamily) -> None:
        k = family.free_count
        for offset, free in (
            (np.zeros(2), np.zeros((2, k + 1))),
            (np.zeros(2), np.zeros((3, k))),
            (np.zeros(2), np.full((2, k), np.nan)),
            (np.full(2, np.inf), np.zeros((2, k))),
        ):
            with pytest.raises(InputError):
                family.trajectory(offset, free)


@given(st.integers(0, 10_000), st.integers(3, 12), st.floats(1.0, 60.0))
@settings(max_examples=40)
def test_a_modified_series_starts_at_the_pose_asked_for(
    seed: int, harmonics: int, period: float
) -> None:
    family = ModifiedFourierFamily(duration=period, order=harmonics)
    generator = np.random.default_rng(seed)
    pose = generator.normal(size=3)
    ends = family.trajectory(pose, generator.normal(size=(3, family.free_count))).evaluate(
        [0.0, period]
    )
    np.testing.assert_allclose(ends.q, [pose, pose], rtol=0, atol=AT_THE_ENDS)


@pytest.mark.parametrize(
    "bad", [{"duration": 0.0}, {"duration": np.nan}, {"order": 1}, {"order": 4.5}]
)
def test_fourier_families_refuse_nonsense(bad: dict[str, float]) -> None:
    for kind in (FourierFamily, ModifiedFourierFamily):
        with pytest.raises(InputError):
            kind(**({"duration": 10.0, "order": 5} | bad))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="harmonics"):
        ModifiedFourierFamily(duration=10.0, order=2)


def test_names_lead_to_their_families() -> None:
    for name in FAMILY_NAMES:
        family = motion_family(name, 12.0, 4)
        assert (family.name, family.duration) == (name, 12.0)
    with pytest.raises(InputError, match="unknown family"):
        motion_family("chirp", 10.0, 5)
    with pytest.raises(InputError):
        motion_family("bspline", 10.0, 0)


@pytest.mark.parametrize("duration", [0.0, -1.0, float("inf"), float("nan")])
@pytest.mark.parametrize("name", FAMILY_NAMES)
def test_no_family_lasts_no_time_or_for_ever(name: str, duration: float) -> None:
    with pytest.raises(InputError, match="must be positive"):
        motion_family(name, duration, 5)


def test_motions_through_points_need_a_point() -> None:
    with pytest.raises(InputError, match="free points"):
        PointsFamily(duration=1.0, order=0)
