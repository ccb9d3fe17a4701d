import csv
import io
from itertools import pairwise

import numpy as np
import pytest
import yaml
from scipy.interpolate import CubicHermiteSpline

from dynid.core import InputError
from dynid.recording import match_headers
from dynid.trajectory import (
    FAMILY_NAMES,
    MotionSequence,
    PointToPoint,
    Quintic,
    Repetition,
    Trajectory,
    csv_text,
    joint_trajectory_yaml,
    motion_family,
    sampled,
)
from rest_motions import rest_series


def some_motion(name: str = "fourier", joints: int = 3) -> Trajectory:
    family, generator = motion_family(name, 2.0, 3), np.random.default_rng(1)
    return family.trajectory(
        np.zeros(joints), 1e-3 * generator.normal(size=(joints, family.free_count))
    )


@pytest.mark.parametrize("late", [1e-11, 1e-10, 4e-10, 1e-9, 1e-8])
def test_no_two_points_have_the_same_nanosecond(late: float) -> None:
    motion = Quintic(start=np.zeros(1), goal=np.ones(1), travel_time=1.0 + late)
    points = yaml.safe_load(joint_trajectory_yaml(motion, ["a"], 125.0))["points"]
    stamps = [p["time_from_start"]["sec"] * 10**9 + p["time_from_start"]["nanosec"] for p in points]
    assert (np.diff(stamps) > 0).all()


@pytest.mark.parametrize("name", FAMILY_NAMES)
def test_csv_reads_back_exactly(name: str) -> None:
    motion = some_motion(name)
    header, *rows = csv.reader(io.StringIO(csv_text(motion, 50.0)))
    assert header[0] == "t [s]"
    assert header[1::3] == ["q1 [rad]", "dq1 [rad/s]", "ddq1 [rad/s^2]"]
    table = np.array(rows, dtype=float)
    expected = sampled(motion, 50.0)
    assert len(table) == 101
    np.testing.assert_array_equal(table[:, 0], expected.t)
    np.testing.assert_array_equal(table[:, 1:4], expected.q)
    np.testing.assert_array_equal(table[:, 4:7], expected.dq)
    np.testing.assert_array_equal(table[:, 7:], expected.ddq)


def test_the_csv_header_is_known_to_the_importer() -> None:
    header = csv_text(some_motion(), 5.0).splitlines()[0].split(",")
    match = match_headers(header)
    assert match.columns == {"t": [0], "q": [1, 2, 3], "qd": [4, 5, 6], "qdd": [7, 8, 9]}
    assert {factor for factors in match.factors.values() for factor in factors} == {1.0}
    sliding = csv_text(some_motion(), 5.0, units=["rad", "m", "rad"]).splitlines()[0]
    assert "q2 [m],q3 [rad],dq1 [rad/s],dq2 [m/s]" in sliding


@pytest.mark.parametrize("name", [name for name in FAMILY_NAMES if name != "points"])
def test_yaml_is_a_joint_trajectory(name: str) -> None:
    motion = some_motion(name)
    names = ["shoulder", "yes", 'wrist: "3"']
    message = yaml.safe_load(joint_trajectory_yaml(motion, names, 20.0))
    assert set(message) == {"header", "joint_names", "points"}
    assert message["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    assert message["joint_names"] == names
    expected = sampled(motion, 20.0)
    for key, quantity in (("positions", "q"), ("velocities", "dq"), ("accelerations", "ddq")):
        values = [point[key] for point in message["points"]]
        assert all(isinstance(number, float) for row in values for number in row)
        np.testing.assert_array_equal(values, getattr(expected, quantity))
    times = [
        p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"]
        for p in message["points"]
    ]
    np.testing.assert_allclose(times, expected.t, rtol=0, atol=1e-9)
    assert all(0 <= p["time_from_start"]["nanosec"] < 10**9 for p in message["points"])
    assert message["points"][-1]["time_from_start"] == {"sec": 2, "nanosec": 0}


def test_a_controller_that_joins_points_by_splines_keeps_the_acceleration_of_legs() -> None:
    """Where all have accelerations, quintics: 1.37 times the acceleration after each jump."""
    poses = np.array([[0.0, 0.0], [1.0, 0.4], [-0.5, 0.2], [0.0, 0.0]])
    legs = [PointToPoint(start=a, goal=b, travel_time=1.31) for a, b in pairwise(poses)]
    sequence = MotionSequence(parts=tuple(legs))
    for motion in (sequence, Repetition(part=sequence, times=2)):
        points = yaml.safe_load(joint_trajectory_yaml(motion, ["a", "b"]))["points"]
        assert not any("accelerations" in point for point in points)
        stamps = [point["time_from_start"] for point in points]
        times = np.array([1e-9 * stamp["nanosec"] + stamp["sec"] for stamp in stamps])
        assert np.diff(times).min() > 5e-4
        assert times[-1] == pytest.approx(motion.duration, abs=1e-9)
        q, dq = (np.array([p[key] for p in points]) for key in ("positions", "velocities"))
        spline = CubicHermiteSpline(times, q, dq)
        t = np.linspace(0.0, motion.duration, 20_001)
        np.testing.assert_allclose(spline(t), motion.evaluate(t).q, rtol=0, atol=1e-8)
        most = max(float(np.abs(leg.goal - leg.start).max()) for leg in legs) * 4.5 / 1.31**2
        assert np.abs(spline(t, 2)).max() == pytest.approx(most, rel=1e-5)


def test_the_last_step_may_be_shorter() -> None:
    motion = Quintic(start=np.zeros(1), goal=np.ones(1), travel_time=0.25)
    np.testing.assert_allclose(sampled(motion, 10.0).t, [0.0, 0.1, 0.2, 0.25], rtol=0, atol=1e-15)
    np.testing.assert_array_equal(sampled(motion, 10.0).q[-1], [1.0])
    # 0.1 x 3 is a little more than 0.3: no fourth step a rounding error long.
    close = Quintic(start=np.zeros(1), goal=np.ones(1), travel_time=0.1 * 3)
    assert len(sampled(close, 10.0).t) == 4


def test_refuses_nonsense() -> None:
    series = rest_series(1.0, [0.0, 0.0], np.zeros((2, 4)))
    for rate in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(InputError, match="rate"):
            sampled(series, rate)
    with pytest.raises(InputError, match="samples"):
        sampled(series, 1e12)
    for names in (["a"], ["a", "a"], ["a", "b", "c"]):
        with pytest.raises(InputError, match="one name a joint"):
            joint_trajectory_yaml(series, names)
    for units in (["rad"], ["rad", "deg"]):
        with pytest.raises(InputError, match="one unit a joint"):
            csv_text(series, units=units)
