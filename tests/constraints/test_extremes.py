"""Bounds over all time, against motions looked at far more finely, and against hidden spikes."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from dynid.constraints import certify, paper_constraints, safe_constraints
from dynid.constraints.certificate import Judge, Least, dense_times, extremes, least_value
from dynid.core import InputError
from dynid.robot import load_robot
from dynid.trajectory import (
    BSpline,
    FourierQuintic,
    FourierSeries,
    JointMotion,
    MotionSequence,
    PointToPoint,
    Quintic,
    Repetition,
    Trajectory,
    pieces,
)

FINE = 200_001
LOOSE = 2e-3
"""Share of its size by which a bound may lie beyond the truth."""
ROUNDING = 1e-9
HOME = np.array([0.0, -1.2, 0.9, -1.2, -1.5, 0.0])


def numbers(seed: int, *shape: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(shape)


def hidden_spike(reach: float) -> MotionSequence:
    """At rest for 10 s but for 0.6 ms, which fall between samples a millisecond apart."""
    tiny = 3e-4
    out = HOME + np.array([reach, 0, 0, 0, 0, 0])
    before, after = 5.0002, 10.0 - 5.0002 - 2 * tiny
    return MotionSequence(
        parts=(
            Quintic(start=HOME, goal=HOME, travel_time=before),
            Quintic(start=HOME, goal=out, travel_time=tiny),
            Quintic(start=out, goal=HOME, travel_time=tiny),
            Quintic(start=HOME, goal=HOME, travel_time=after),
        )
    )


def motions(seed: int) -> dict[str, Trajectory]:
    a, b = 0.3 * numbers(seed, 2, 2, 7)
    quintic = Quintic(start=numbers(seed, 2), goal=numbers(seed + 1, 2), travel_time=0.7)
    back = Quintic(start=quintic.goal, goal=quintic.start, travel_time=1.3)
    there = MotionSequence(parts=(quintic, back))
    return {
        "fourier": FourierSeries(period=3.0, offset=numbers(seed, 2), a=a, b=b),
        "fourier-quintic": FourierQuintic(
            period=3.0, start=numbers(seed, 2), goal=numbers(seed + 1, 2), a=a, b=b
        ),
        "bspline": BSpline(travel_time=2.0, degree=5, control=numbers(seed, 2, 30)),
        "cubic": BSpline(travel_time=2.0, degree=3, control=numbers(seed, 2, 9)),
        "quintic": quintic,
        "sequence": there,
        "repetition": Repetition(part=there, times=3),
    }


@pytest.mark.parametrize("kind", motions(0))
@pytest.mark.parametrize("seed", range(3))
def test_bounds_hold_and_are_tight(kind: str, seed: int) -> None:
    motion = motions(seed)[kind]
    found = extremes(motion)
    dense = motion.evaluate(np.linspace(0.0, motion.duration, FINE))
    low, high = dense.q.min(axis=0), dense.q.max(axis=0)
    loose = LOOSE * (high - low)
    assert found.proven
    assert (found.lower <= low + ROUNDING).all()
    assert (found.lower >= low - loose).all()
    assert (found.upper >= high - ROUNDING).all()
    assert (found.upper <= high + loose).all()
    for bound, values in ((found.velocity, dense.dq), (found.acceleration, dense.ddq)):
        most = np.abs(values).max(axis=0)
        assert (bound >= most * (1 - ROUNDING)).all()
        assert (bound <= most * (1 + LOOSE)).all()


@dataclass(frozen=True, slots=True)
class Foreign(Trajectory):
    """A motion of which nothing but samples are known."""

    hidden: Trajectory

    @property
    def duration(self) -> float:
        return self.hidden.duration

    @property
    def joints(self) -> int:
        return self.hidden.joints

    def evaluate(self, t: ArrayLike) -> JointMotion:
        return self.hidden.evaluate(t)


class Detour(Quintic):
    """Another way between the poses of a quintic."""

    def profile(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        sine, cosine = np.sin(np.pi * s), np.cos(np.pi * s)
        place, speed, push = super().profile(s)
        bend = 12 * sine**2 * cosine**2 - 4 * sine**4
        return (
            place + 0.9 * sine**4,
            speed + 3.6 * np.pi * sine**3 * cosine,
            push + 0.9 * np.pi**2 * bend,
        )


class Doubled(FourierSeries):
    """Twice as large as its coefficients say."""

    def evaluate(self, t: ArrayLike) -> JointMotion:
        half = super().evaluate(t)
        return JointMotion(t=half.t, q=2 * half.q, dq=2 * half.dq, ddq=2 * half.ddq)


@pytest.mark.parametrize(
    "motion",
    [
        Detour(start=np.zeros(6), goal=np.ones(6), travel_time=6.0),
        Doubled(period=6.0, offset=np.ones(6), a=np.ones((6, 1)), b=np.ones((6, 1))),
    ],
)
def test_a_class_that_builds_on_a_known_one_is_bounded_by_its_own_samples(
    motion: Trajectory,
) -> None:
    found, dense = extremes(motion), motion.evaluate(np.linspace(0.0, 6.0, FINE // 10))
    assert not found.proven
    assert (found.upper >= dense.q.max(axis=0)).all()
    assert (found.velocity >= np.abs(dense.dq).max(axis=0)).all()
    assert (found.acceleration >= np.abs(dense.ddq).max(axis=0)).all()
    with pytest.raises(InputError, match="no formula"):
        pieces(motion)


@pytest.mark.parametrize("kind", ["fourier", "bspline"])
def test_bounds_of_samples_alone_hold_are_not_proven_and_leave_little_room(kind: str) -> None:
    motion = Foreign(motions(0)[kind])
    found = extremes(motion)
    assert not found.proven
    count = FINE // 10
    dense = motion.evaluate(np.linspace(0.0, motion.duration, count))
    step = motion.duration / (len(np.concatenate(dense_times(motion))) - 1)
    jerk = np.abs(np.diff(dense.ddq, axis=0)).max(axis=0) * (count - 1) / motion.duration
    # Twice what neighbouring samples show may happen within half a step of them.
    most = np.abs(dense.ddq).max(axis=0)
    assert (found.acceleration >= most).all()
    assert (found.acceleration <= most + 1.001 * jerk * step).all()
    rooms = (
        (found.velocity, np.abs(dense.dq).max(axis=0), 2 * jerk * step**2 / 8),
        (found.upper, dense.q.max(axis=0), found.acceleration * step**2 / 8),
        (-found.lower, -dense.q.min(axis=0), found.acceleration * step**2 / 8),
    )
    for bound, true, room in rooms:
        assert (bound >= true).all()
        assert (bound <= true + 1.001 * room + ROUNDING).all()


@dataclass(frozen=True, slots=True)
class Table(Trajectory):
    """Positions at 125 Hz joined by lines: speeds jump, and no acceleration is ever seen."""

    rows: np.ndarray
    still: bool
    """Whether its class forgot the speeds as well."""

    @property
    def duration(self) -> float:
        return (len(self.rows) - 1) / 125.0

    @property
    def joints(self) -> int:
        return self.rows.shape[1]

    def evaluate(self, t: ArrayLike) -> JointMotion:
        times = np.asarray(t, dtype=np.float64)
        k = np.clip((125.0 * times).astype(int), 0, len(self.rows) - 2)
        slope = 125.0 * np.diff(self.rows, axis=0)[k]
        q = self.rows[k] + (times - k / 125.0)[:, None] * slope
        return JointMotion(t=times, q=q, dq=slope * (not self.still), ddq=0 * slope)


@pytest.mark.parametrize(
    ("step", "still", "broken"),
    [
        (0.0, False, set()),
        (0.0, True, set()),
        (0.005, False, {"acceleration"}),
        (0.05, True, {"velocity"}),
    ],
)
def test_a_sample_out_of_line_is_seen_where_the_derivatives_hide_it(
    step: float, still: bool, broken: set[str]
) -> None:
    rows = HOME + 0.2 * np.sin(np.arange(0, 5, 0.008))[:, None] * np.ones(6)
    rows[300, 4] += step
    judge = paper_constraints(load_robot("ur5"))
    assert set(certify(Table(rows, still), judge).broken) == broken


def test_a_spike_between_milliseconds_is_seen() -> None:
    robot = load_robot("ur5")
    spike = hidden_spike(0.3)
    regular = spike.evaluate(np.linspace(0.0, 10.0, 10_001))
    assert np.abs(regular.q - HOME).max() < 1e-12  # no sample of a millisecond shows it
    certificate = certify(spike, paper_constraints(robot))
    assert set(certificate.broken) == {"velocity", "acceleration"}
    assert certificate.worst["velocity"].t == pytest.approx(5.0005, abs=1e-3)
    broken = set(certify(spike, safe_constraints(robot, collision=False)).broken)
    assert {"velocity", "acceleration", "torque", "tcp_speed"} <= broken


def test_the_period_of_a_long_repetition_is_looked_at_as_closely_as_alone() -> None:
    once = FourierSeries(period=1.0, offset=HOME, a=np.full((6, 1), 0.1), b=np.zeros((6, 1)))
    often = Repetition(part=once, times=300)
    assert len(np.concatenate(dense_times(often))) == len(np.concatenate(dense_times(once)))
    judge = safe_constraints(load_robot("ur5"))
    one, many = certify(once, judge), certify(often, judge)
    assert many.margins == one.margins
    assert many.broken == one.broken


def test_long_parts_of_a_sequence_share_the_samples_that_memory_allows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    there = PointToPoint(start=HOME, goal=HOME + 0.1, travel_time=200.0)
    back = PointToPoint(start=HOME + 0.1, goal=HOME, travel_time=200.0)
    few, many = (len(np.concatenate(dense_times(MotionSequence(parts=(there, back) * k))))
                 for k in (1, 200))  # fmt: skip
    assert few == pytest.approx(120_000, rel=1e-3)
    assert many < 1.3e6
    monkeypatch.setattr("dynid.constraints.certificate._MOST_OF_ALL", 12_000)
    with pytest.raises(InputError, match="too many parts to be judged"):
        dense_times(MotionSequence(parts=(there, back) * 200))


def test_a_motion_of_hours_is_looked_at_no_more_often_than_memory_allows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    hours = FourierSeries(period=7200.0, offset=HOME, a=np.full((6, 1), 0.1), b=np.zeros((6, 1)))
    assert len(np.concatenate(dense_times(hours))) == 60_001
    began: list[int] = []

    def counted(judge: Judge, duration: float, **asked: Any) -> Least:
        began.append(asked["first"])
        return least_value(judge, duration, **asked)

    monkeypatch.setattr("dynid.constraints.certificate.least_value", counted)
    certify(hours, safe_constraints(load_robot("ur5"), collision=False))
    assert began
    assert max(began) == 30_000


def test_of_equally_low_places_the_first_is_named() -> None:
    found = least_value(
        lambda t, half: (np.ones(len(t)), np.ones(len(t)) - half),
        1e4,
        first=8192,
        threshold=0.0,
        tolerance=0.2,
    )
    assert found.value == 1.0
    assert found.t == pytest.approx(1e4 / 8192 / 2)


def test_a_joint_without_position_limits_is_used_nowhere() -> None:
    robot = load_robot("ur5")
    lower, upper = robot.limits.lower.copy(), robot.limits.upper.copy()
    lower[2], upper[2] = -np.inf, np.inf
    free = replace(robot, limits=replace(robot.limits, lower=lower, upper=upper))
    once = FourierSeries(period=3.0, offset=HOME, a=np.full((6, 1), 0.1), b=np.zeros((6, 1)))
    margins = [certify(once, paper_constraints(arm)).margins["position"] for arm in (robot, free)]
    assert margins[0] == margins[1]


def test_a_joint_that_is_limited_on_one_side_alone_is_refused() -> None:
    limits = load_robot("ur5").limits
    with pytest.raises(InputError, match="joint 3"):
        replace(limits, upper=np.where(np.arange(6) == 2, np.inf, limits.upper))
