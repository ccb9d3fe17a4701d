import numpy as np
import pytest
from urscript_player import play

from dynid.core import InputError
from dynid.trajectory import (
    FAMILY_NAMES,
    FourierQuintic,
    FourierSeries,
    JointMotion,
    MotionSequence,
    Quintic,
    Repetition,
    Trajectory,
    motion_family,
    pieces,
    ur_program,
)
from rest_motions import rest_series
from urtwin.functions import BUILTINS
from urtwin.urscript import compile_script

# Targets on the controller against `evaluate` [rad].
SAME = 1e-12


def member(name: str, duration: float = 2.0, seed: int = 0) -> Trajectory:
    family, generator = motion_family(name, duration, 4), np.random.default_rng(seed)
    return family.trajectory(
        generator.normal(size=6), 0.3 * generator.normal(size=(6, family.free_count))
    )


def others() -> dict[str, Trajectory]:
    series, pose = member("fourier"), np.arange(6.0) / 3
    start = series.evaluate([0.0]).q[0]
    return {
        "quintic": Quintic(start=pose, goal=-pose, travel_time=2.0),
        "carried": FourierQuintic(
            period=2.0, start=pose, goal=-pose, a=np.full((6, 2), 0.1), b=np.full((6, 2), -0.2)
        ),
        "sequence": MotionSequence(
            parts=(
                Quintic(start=pose, goal=start, travel_time=1.237),
                Repetition(part=series, times=2),
                Quintic(start=start, goal=pose, travel_time=0.763),
            )
        ),
    }


EVERY = {name: member(name) for name in FAMILY_NAMES} | others()
RETURNING = {name: EVERY[name] for name in (*FAMILY_NAMES, "sequence")}


@pytest.mark.parametrize("name", EVERY)
def test_targets_are_the_trajectory(name: str) -> None:
    index, targets = play(ur_program(EVERY[name])).motion()
    total = round(125.0 * EVERY[name].duration)
    np.testing.assert_array_equal(index, np.arange(total))
    expected = EVERY[name].evaluate(np.arange(total) / 125.0)
    np.testing.assert_allclose(targets, expected.q, rtol=0, atol=SAME)


@pytest.mark.parametrize("name", RETURNING)
@pytest.mark.parametrize("rate", [125.0, 500.0])
def test_periods_have_exactly_the_same_targets(name: str, rate: float) -> None:
    program = ur_program(RETURNING[name], repeats=3, settle=1, rate_hz=rate)
    index, targets = play(program).motion()
    cycles = round(RETURNING[name].duration * rate)
    np.testing.assert_array_equal(index, np.arange(4 * cycles))
    periods = targets.reshape(4, cycles, 6)
    for period in periods[1:]:
        np.testing.assert_array_equal(period, periods[0])


def test_the_papers_ten_seconds() -> None:
    series = rest_series(10.0, np.zeros(6), np.random.default_rng(5).normal(size=(6, 8)) / 5)
    index, targets = play(ur_program(series, repeats=3)).motion()
    assert len(index) == 3750
    np.testing.assert_allclose(targets, series.sample(125.0, periods=3).q, rtol=0, atol=SAME)


@pytest.mark.parametrize("name", EVERY)
def test_pieces_are_the_trajectory(name: str) -> None:
    start = 0.0
    for piece in pieces(EVERY[name]):
        s = np.linspace(0.0, 1.0, 23)
        phase = 2 * np.pi * np.outer(s, np.arange(1, piece.harmonics + 1))
        q = np.array([np.polynomial.polynomial.polyval(s, row) for row in piece.polynomial]).T
        q = q + np.sin(phase) @ piece.a.T - np.cos(phase) @ piece.b.T
        expected = EVERY[name].evaluate(start + s * piece.duration)
        np.testing.assert_allclose(q, expected.q, rtol=0, atol=SAME)
        dq, ddq = piece.slope().values(s), piece.slope().slope().values(s)
        # Between two motions accelerations jump.
        inner = slice(1, -1)
        for found, true in (
            (dq / piece.duration, expected.dq),
            (ddq / piece.duration**2, expected.ddq),
        ):
            np.testing.assert_allclose(found[inner], true[inner], rtol=1e-9, atol=1e-9)
        start += piece.duration
    assert start == pytest.approx(EVERY[name].duration, abs=1e-12)


def test_it_rests_at_the_way_points_before_the_start() -> None:
    points = [np.full(6, 0.1), np.linspace(-1.0, 1.0, 6)]
    motion = member("fourier")
    played = play(ur_program(motion, via=points))
    ways = [call for call in played.calls if call[0] == "movej"]
    assert len(ways) == 3
    for way, pose in zip(ways, [*points, motion.evaluate([0.0]).q[0]], strict=True):
        np.testing.assert_allclose(way[1][0], pose, rtol=0, atol=SAME)  # type: ignore[call-overload]
        # No blend radius: the certified ways are straight to the end.
        assert way[2] == {"a": 0.5, "v": 0.5}
    index, _ = play(ur_program(motion)).motion()
    np.testing.assert_array_equal(played.motion()[0], index)
    with pytest.raises(InputError, match="way point"):
        ur_program(motion, via=[np.zeros(5)])


@pytest.mark.parametrize("name", EVERY)
def test_the_simulated_controller_takes_it(name: str) -> None:
    program = ur_program(EVERY[name], comment="robot: ur5")
    assert compile_script(program, BUILTINS).name == "dynid_excitation"


def test_what_the_program_does_besides() -> None:
    series = member("fourier")
    made = ur_program(series, repeats=2, comment="robot: ur5\n\x00 Größe")
    played, total = play(made), 500
    assert made.isascii()
    assert "# robot: ur5\n" in made
    calls = [call for call in played.calls if call[0] != "servoj"]
    assert [name for name, *_ in calls] == ["rtde_set_watchdog", "movej", "sleep", "stopj"]
    assert calls[0][1] == ("input_int_register_24", 10.0, "stop")
    assert calls[1][2] == {"a": 0.5, "v": 0.5}
    start = series.evaluate([0.0]).q[0]
    np.testing.assert_allclose(calls[1][1][0], start, atol=SAME)  # type: ignore[call-overload]
    assert calls[2][1] == (1.0,)
    servo = next(call for call in played.calls if call[0] == "servoj")
    assert servo[1:] == ((0, 0), {"t": 0.008, "lookahead_time": 0.03, "gain": 500.0})
    # On the way, in motion, done: and the index waits at -1, ends at the total.
    assert [value for register, value in played.registers if register == 25] == [0, 1, 2]
    indices = [value for register, value in played.registers if register == 24]
    assert indices == [-1, *range(total), total]
    # Held for 0.2 s at the end, so that the arm catches up with its targets.
    held = np.array(played.targets[total:])
    assert len(held) == 25
    np.testing.assert_array_equal(held, np.tile(held[0], (25, 1)))
    np.testing.assert_allclose(held[0], series.evaluate([series.duration]).q[0], atol=SAME)


def test_awkward_numbers_survive() -> None:
    series = FourierSeries(
        period=0.8,
        offset=[1e-17, -1e-9, 0.1 + 0.2, -np.pi, 123456.789, 0.0],
        a=np.zeros((6, 1)),
        b=np.zeros((6, 1)),
    )
    np.testing.assert_array_equal(play(ur_program(series)).targets[7], series.offset)


class Wobble(Trajectory):
    joints = 6
    duration = 1.0

    def evaluate(self, t: object) -> JointMotion:
        zeros = np.zeros((np.size(t), 6))  # type: ignore[arg-type]
        return JointMotion(t=t, q=zeros, dq=zeros, ddq=zeros)  # type: ignore[arg-type]


def test_what_a_plan_takes_as_rest_is_written() -> None:
    # Accelerations of 4e-5 rad/s^2 were refused, after the slow pass, which had a 25th of them.
    tiny = np.full((6, 1), 1e-6)
    still = FourierSeries(period=1.0, offset=np.zeros(6), a=0 * tiny, b=tiny)
    assert "servoj" in ur_program(still)


def test_refuses_what_the_controller_cannot_do() -> None:
    moving = FourierSeries(period=1.0, offset=np.zeros(6), a=np.ones((6, 1)), b=np.ones((6, 1)))
    with pytest.raises(InputError, match="at rest"):
        ur_program(moving)
    with pytest.raises(InputError, match="joints of a UR robot"):
        ur_program(rest_series(1.0, np.zeros(7), np.zeros((7, 4))))
    with pytest.raises(InputError, match="whole number of control cycles"):
        ur_program(member("fourier", duration=2.003))
    with pytest.raises(InputError, match="position jumps"):
        ur_program(EVERY["quintic"], settle=1)
    with pytest.raises(InputError, match="no formula"):
        ur_program(Wobble())


@pytest.mark.parametrize(
    "change",
    [{"rate_hz": 0.0}, {"repeats": 0}, {"settle": -1}, {"repeats": 1.5}, {"settle": 0.5}],
)
def test_options_are_checked(change: dict[str, float]) -> None:
    """Of half a period the program jumped to the end of the motion."""
    with pytest.raises(InputError, match=r"must be positive|a whole number"):
        ur_program(member("fourier"), **change)  # type: ignore[arg-type]
