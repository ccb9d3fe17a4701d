from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_motions import Motion, write_rtde_csv

from dynid.core import RecordError
from dynid.recording import (
    ExperimentRecord,
    RawTable,
    ReadOptions,
    at_limit,
    read_recording,
    repair,
)
from dynid.robot import Drives, load_robot
from dynid.signals.resample import GAP_STEPS

MOTION = Motion(samples=1500)
COUNTED_ANEW = np.zeros(0, dtype=np.int64)


def raw(motion: Motion = MOTION, noise: float = 0.0, **changes) -> RawTable:
    rng = np.random.default_rng(3)
    t = motion.t
    signals = {
        "q": motion.position(t) + noise * 1e-5 * rng.standard_normal((len(t), motion.joints)),
        "qd": motion.velocity(t) + noise * 1e-2 * rng.standard_normal((len(t), motion.joints)),
        "current": motion.current(t) + noise * 0.1 * rng.standard_normal((len(t), motion.joints)),
    }
    rows = np.arange(1, len(t) + 1, dtype=np.int64)
    table = RawTable(source="x.csv", format="csv", rows=rows, signals=signals, t=t)
    return replace(table, **changes)


def run(table: RawTable, **settings) -> ExperimentRecord:
    robot = settings.pop("robot", None)
    return repair(table, ReadOptions(**settings), robot)


def codes(record: ExperimentRecord) -> list[str]:
    return [problem.code for problem in record.problems]


def times(record: ExperimentRecord) -> np.ndarray:
    return record.t + float(record.metadata.extra["t0"])


def signals(table: RawTable, **changes) -> RawTable:
    return replace(table, signals={**table.signals, **changes})


@pytest.mark.parametrize("noise", [0, 1])
def test_sound_recordings_have_no_problems(noise: int) -> None:
    for seed in range(6):
        record = run(raw(Motion(samples=1500, seed=seed), noise))
        assert codes(record) == []
        assert record.samples == 1500


@pytest.mark.parametrize(("unit", "scale"), [("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)])
@pytest.mark.parametrize("with_velocity", [True, False])
def test_time_units_are_found_and_reported(unit: str, scale: float, with_velocity: bool) -> None:
    table = raw(t=MOTION.t / scale)
    if not with_velocity:
        table = table.without("qd")
    record = run(table)
    assert codes(record) == ["unit_suspect"]
    assert f"in {unit} " in record.problems[0].message
    np.testing.assert_allclose(record.t, MOTION.t - MOTION.start, atol=1e-6)


@pytest.mark.parametrize(("rate", "scale"), [(4000.0, 1e-3), (0.5, 1.0)])
def test_velocities_tell_a_unit_that_the_size_of_the_steps_does_not(
    rate: float, scale: float
) -> None:
    """A quarter of a millisecond looks like seconds, two seconds like milliseconds."""
    motion = Motion(samples=2000, rate=4000.0)
    slowed = rate / motion.rate
    t = (motion.t - motion.start) / slowed
    table = raw(motion, t=t / scale)
    table = signals(table, qd=table.signals["qd"] * slowed)
    np.testing.assert_allclose(run(table).t, t, atol=1e-9 * t[-1])


def test_named_time_units_are_taken_without_a_word() -> None:
    record = run(raw(t=MOTION.t * 1e3, time_scale=1e-3))
    assert codes(record) == []
    np.testing.assert_allclose(record.t, MOTION.t - MOTION.start, atol=1e-6)


def test_slow_log_in_seconds_stays_in_seconds() -> None:
    motion = Motion(samples=400, rate=1.0)
    record = run(raw(motion).without("qd"))
    assert record.rate_hz == pytest.approx(1.0)


def test_degrees_are_converted_on_request() -> None:
    table = raw()
    degrees = signals(table, q=np.degrees(table.signals["q"]), qd=np.degrees(table.signals["qd"]))
    record = run(degrees, degrees=True)
    assert codes(record) == []
    np.testing.assert_allclose(record.signals["q"], table.signals["q"])
    np.testing.assert_allclose(record.signals["qd"], table.signals["qd"])


def test_degrees_without_the_flag_are_refused_for_a_robot() -> None:
    table = raw()
    degrees = signals(table, q=np.degrees(table.signals["q"]), qd=np.degrees(table.signals["qd"]))
    with pytest.raises(RecordError, match="degrees=True"):
        run(degrees, robot=load_robot("ur5"))
    assert codes(run(degrees)) == ["unit_suspect"]


def test_positions_beyond_the_limits_are_reported() -> None:
    table, robot = raw(), load_robot("ur5")
    q = table.signals["q"]
    limits = replace(
        robot.limits, lower=q.min(axis=0) - 1, upper=q.max(axis=0) - 0.3 * np.eye(6)[2]
    )
    told = [problem.message for problem in run(table, robot=replace(robot, limits=limits)).problems]
    assert any("goes 0.3 beyond the limits of ur5 (1 joints do)" in text for text in told), told


def test_radians_with_the_flag_are_suspected() -> None:
    assert "unit_suspect" in codes(run(raw(), degrees=True))


def test_positions_in_degrees_beside_velocities_in_radians() -> None:
    table = raw()
    record = run(signals(table, q=np.degrees(table.signals["q"])))
    assert any("57.3" in problem.message for problem in record.problems)


def test_velocities_in_degrees_are_left_out() -> None:
    table = raw()
    record = run(signals(table, qd=np.degrees(table.signals["qd"])))
    assert codes(record) == ["unit_suspect"]
    assert "qd" not in record.signals


def test_prismatic_joints_are_never_converted() -> None:
    ur5 = load_robot("ur5")
    robot = replace(ur5, joint_types=("prismatic", *ur5.joint_types[1:]))
    table = raw()
    record = run(table, robot=robot, degrees=True)
    np.testing.assert_array_equal(record.signals["q"][:, 0], table.signals["q"][:, 0])
    np.testing.assert_allclose(record.signals["q"][:, 1], np.radians(table.signals["q"][:, 1]))


def test_prismatic_joints_in_millimetres_are_refused() -> None:
    """Degrees were refused, and millimetres identified as metres."""
    ur5 = load_robot("ur5")
    limits = replace(ur5.limits, lower=np.full(6, -4.0), upper=np.full(6, 4.0))
    robot = replace(ur5, joint_types=("prismatic", *ur5.joint_types[1:]), limits=limits)
    table = raw()
    scale = np.array([1e3, 1, 1, 1, 1, 1])
    table = signals(table, q=table.signals["q"] * scale, qd=table.signals["qd"] * scale)
    with pytest.raises(RecordError, match=r"q1 \[mm\]") as refused:
        run(table, robot=robot)
    assert refused.value.limit == "4 m"


def test_motor_side_becomes_joint_side() -> None:
    ur5 = load_robot("ur5")
    coupling = np.diag([32.0, 32, 45, -48, 45, 32])
    coupling[5, 4] = 32
    offset = np.array([0.0, -1.5, 1.5, 0, 0, 0])
    drives = Drives(
        gain=np.ones(6),
        gear_ratio=np.full(6, np.nan),
        coupling=coupling,
        offset=offset,
        position_side="motor",
        torque_side="motor",
    )
    robot = replace(ur5, drives=drives)
    table = raw()
    q, qd = table.signals["q"], table.signals["qd"]
    effort = 20 * table.signals["current"]
    motor = signals(
        table.without("current"),
        q=(q - offset) @ coupling.T,
        qd=qd @ coupling.T,
        effort=effort @ np.linalg.inv(coupling),
    )
    record = run(motor, robot=robot)
    assert [c for c in codes(record) if c != "unit_suspect"] == []
    np.testing.assert_allclose(record.signals["q"], q, atol=1e-9)
    np.testing.assert_allclose(record.signals["qd"], qd, atol=1e-9)
    np.testing.assert_allclose(record.signals["effort"], effort, atol=1e-9)


def test_wraps_are_undone_and_reported() -> None:
    table = raw()
    q = table.signals["q"].copy()
    q[:, 4] += np.linspace(0, 14, len(q))
    wrapped = (q + np.pi) % (2 * np.pi) - np.pi
    record = run(signals(table.without("qd"), q=wrapped))
    assert set(codes(record)) == {"unit_suspect"}
    assert "whole turn" in record.problems[0].message
    turns = (record.signals["q"] - q) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns[0]) + 0 * turns, atol=1e-9)


def test_spikes_are_dropped_whatever_their_size() -> None:
    table = raw(noise=1)
    rng = np.random.default_rng(5)
    for size in (0.02, 0.3, 5.0, -1e4, 1e9):
        q = table.signals["q"].copy()
        rows = rng.choice(np.arange(5, 1495, 10), 8, replace=False)
        q[rows, rng.integers(0, 6, 8)] += size
        record = run(signals(table, q=q))
        assert codes(record) == ["corrupt_rows"], size
        assert record.metadata.dropped_rows == 8
        np.testing.assert_allclose(record.signals["q"], MOTION.position(times(record)), atol=1e-4)


def test_spikes_of_torques_that_reach_beyond_their_range_are_dropped_though_many() -> None:
    """Smaller ones, as many, may be torques that are rough by nature."""
    rng = np.random.default_rng(5)
    rows = rng.choice(np.arange(5, 1495, 10), 45, replace=False)
    for size, dropped in ((0.5, 0), (20.0, 45)):
        current = raw().signals["current"].copy()
        current[rows, rng.integers(0, 6, 45)] += size * rng.choice([-1.0, 1.0], 45)
        record = run(signals(raw(), current=current))
        assert record.metadata.dropped_rows == dropped
        assert codes(record) == ["corrupt_rows"] * bool(dropped)


@pytest.mark.parametrize("row", [0, 1, 2, 1497, 1498, 1499])
def test_spikes_at_the_ends_are_dropped(row: int) -> None:
    table = raw()
    q = table.signals["q"].copy()
    q[row, 2] += 0.5
    record = run(signals(table, q=q))
    assert "corrupt_rows" in codes(record)
    np.testing.assert_allclose(record.signals["q"], MOTION.position(times(record)), atol=1e-9)


@pytest.mark.parametrize("error", [-1e6, -20.0, 20.0, 1e9])
@pytest.mark.parametrize("rows", [[0], [0, 1], [-1], [-2, -1]])
def test_stray_stamps_at_an_end_cost_no_time(rows: list[int], error: float) -> None:
    t = raw().t.copy()
    t[rows] += error
    record = run(raw(t=t))
    assert {"clock_jitter", "clock_mismatch", "corrupt_rows", "dropped_rows"} & set(codes(record))
    assert record.samples >= 1498
    assert record.duration_s < 2 * 1500 / 125 + 20


@pytest.mark.parametrize("seed", [64, 81, 136])
def test_the_last_row_of_rough_torques_stays(seed: int) -> None:
    """Its five neighbours lie on a line by chance, with these seeds."""
    rough = np.random.default_rng(seed).normal(size=(MOTION.samples, 6))
    record = run(signals(raw(), effort=rough))
    assert record.samples == MOTION.samples


@pytest.mark.parametrize("length", [2, 3, 4, 10, 40])
@pytest.mark.parametrize("value", [0.0, 7.0])
def test_stretches_of_nonsense_are_dropped(length: int, value: float) -> None:
    table = raw()
    q = table.signals["q"].copy()
    q[700 : 700 + length, 1] = value
    record = run(signals(table, q=q))
    assert "corrupt_rows" in codes(record)
    np.testing.assert_allclose(record.signals["q"], MOTION.position(times(record)), atol=1e-9)


@pytest.mark.parametrize("rows", [slice(0, 5), slice(600, 640), slice(1480, 1500), slice(0, 400)])
def test_rows_of_zeros_are_dropped(rows: slice) -> None:
    table = raw()
    changed = {name: value.copy() for name, value in table.signals.items()}
    for value in changed.values():
        value[rows] = 0.0
    record = run(signals(table, **changed))
    assert "corrupt_rows" in codes(record)
    assert record.samples == 1500 - (rows.stop - rows.start)
    np.testing.assert_allclose(record.signals["q"], MOTION.position(times(record)), atol=1e-9)


def test_jump_without_return_is_reported() -> None:
    table = raw()
    keep = np.r_[0:500, 900:1500]
    left = table.keep(np.isin(np.arange(1500), keep))
    cut = replace(left, dropped=0, t=None, index=COUNTED_ANEW)
    record = run(cut, rate_hz=125.0)
    assert "corrupt_rows" in codes(record) or "clock_mismatch" in codes(record)


@pytest.mark.parametrize("lost", [1, 2, 3])
def test_lost_rows_show_where_time_is_counted(lost: int) -> None:
    table = replace(raw(), t=None)
    kept = table.keep(~np.isin(np.arange(1500), np.arange(700, 700 + lost)))
    kept = replace(kept, dropped=0, index=COUNTED_ANEW)
    assert "clock_mismatch" in codes(run(kept, rate_hz=125.0))
    assert codes(run(table, rate_hz=125.0)) == []


def test_repeated_stamps_are_dropped() -> None:
    table = raw(noise=1)
    t = table.t.copy()
    t[100] = t[99]
    t[500:503] = t[499]
    record = run(replace(table, t=t))
    assert "dropped_rows" in codes(record)
    assert record.metadata.dropped_rows == 4


def test_rows_written_twice_are_dropped_without_limit() -> None:
    table = raw(noise=1)
    index = np.repeat(np.arange(1500), 3)
    tripled = RawTable(
        source="x",
        format="csv",
        rows=index + 1,
        t=table.t[index],
        signals={name: value[index] for name, value in table.signals.items()},
    )
    record = run(tripled)
    assert codes(record) == ["dropped_rows"]
    assert record.samples == 1500


def test_rows_held_between_updates_are_dropped() -> None:
    table = raw(noise=1)
    index = np.repeat(np.arange(1500), 2)
    t = 5.0 + np.arange(3000) / 250
    held = RawTable(
        source="x",
        format="csv",
        rows=np.arange(1, 3001),
        t=t,
        signals={name: value[index] for name, value in table.signals.items()},
    )
    record = run(held)
    assert codes(record) == ["dropped_rows"]
    assert record.rate_hz == pytest.approx(125)


def test_standstill_of_a_perfect_simulation_is_kept() -> None:
    table = raw()
    rest = {name: value.copy() for name, value in table.signals.items()}
    for name, value in rest.items():
        value[:400] = 0.0 if name == "qd" else value[400]
    record = run(signals(table, **rest))
    assert record.samples == 1500
    assert codes(record) == ["at_rest"]
    assert "3.2 s at the start" in record.problems[0].message
    assert "brakes" not in record.problems[0].message


def test_standstill_without_torque_may_be_that_of_brakes() -> None:
    table = raw()
    rest = {name: value.copy() for name, value in table.signals.items()}
    noise = np.random.default_rng(1).normal(size=(300, table.joints))
    for name, value in rest.items():
        value[:400] = 0.0 if name == "qd" else value[400]
        if name in ("current", "effort"):
            value[:300] = 0.01 * noise * np.abs(value).max()
    record = run(signals(table, **rest))
    assert codes(record) == ["at_rest"]
    assert "brakes" in record.problems[0].message


@pytest.mark.parametrize("error", [-5.0, -0.02, 0.003, 0.5, 1e6])
def test_wrong_stamps_are_dropped(error: float) -> None:
    table = raw(noise=1)
    t = table.t.copy()
    t[[200, 900]] += error
    record = run(replace(table, t=t))
    assert "dropped_rows" in codes(record)
    assert record.metadata.dropped_rows == 2
    np.testing.assert_allclose(record.signals["q"], MOTION.position(times(record)), atol=1e-4)


def test_time_that_runs_backwards_is_refused() -> None:
    table = raw()
    with pytest.raises(RecordError, match=r"does not increase.*Sort the rows"):
        run(replace(table, t=table.t[::-1]))
    with pytest.raises(RecordError, match="does not increase"):
        run(replace(table, t=np.zeros(1500)))
    # A clock that is set back now and then leaves nothing to hold on to at rest.
    t = table.t - 0.3 * (np.arange(1500) // 40)
    still = {**table.signals, "q": np.repeat(table.signals["q"][:1], 1500, axis=0)}
    with pytest.raises(RecordError, match=r"repeat or decrease.*rate_hz"):
        run(replace(table, t=t, signals=still))


@pytest.mark.parametrize("digits", [1, 2])
def test_coarse_stamps_are_spread_over_the_rows(digits: int) -> None:
    record = run(raw(noise=1, t=np.round(MOTION.t, digits)))
    assert codes(record) == ["clock_jitter"]
    assert record.samples == 1500
    np.testing.assert_allclose(record.t, MOTION.t - MOTION.t[0], atol=2e-3)
    assert record.rate_hz == pytest.approx(125, rel=1e-4)


def test_coarse_stamps_of_uneven_rows_are_not_spread() -> None:
    # Every third row is missing in the second half: rows do not count time.
    table = raw(t=np.round(MOTION.t, 2))
    keep = (np.arange(1500) < 750) | (np.arange(1500) % 3 > 0)
    holes = replace(
        table,
        rows=table.rows[keep],
        t=table.t[keep],
        signals={name: value[keep] for name, value in table.signals.items()},
    )
    record = run(holes)
    assert {"clock_jitter", "dropped_rows"} & set(codes(record))
    assert not any("spread" in problem.message for problem in record.problems)


def test_one_odd_row_is_no_coarse_clock(tmp_path: Path) -> None:
    path = write_rtde_csv(MOTION, tmp_path / "x.csv")
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:500], "event: pause", *lines[500:]]) + "\n")
    record = read_recording(path)
    assert codes(record) == ["corrupt_rows"]
    np.testing.assert_allclose(record.t, MOTION.t - MOTION.t[0], atol=1e-6)


def test_efforts_of_zero_give_way_to_currents() -> None:
    table = raw()
    record = run(signals(table, effort=np.zeros((1500, 6))))
    assert codes(record) == ["dead_channel"]
    assert set(record.signals) == {"q", "qd", "current"}
    alone = {name: table.signals[name] for name in ("q", "qd")}
    silent = replace(table, signals={**alone, "effort": np.zeros((1500, 6))})
    (found,) = run(silent, robot=load_robot("ur5")).problems
    assert (found.kind, found.joints) == ("dead_channel", tuple(range(6)))


def runs_in_one(*pieces: slice, restart: bool = True) -> RawTable:
    table = raw()
    t = np.concatenate(
        [table.t[piece] - (table.t[piece][0] if restart else 0.0) for piece in pieces]
    )
    parts = {
        name: np.concatenate([value[piece] for piece in pieces])
        for name, value in table.signals.items()
    }
    return replace(table, rows=np.arange(1, len(t) + 1), t=t, signals=parts)


def test_runs_in_one_file_are_put_behind_each_other() -> None:
    record = run(runs_in_one(slice(0, 600), slice(700, 1400)))
    assert codes(record) == ["clock_mismatch"]
    assert record.samples == 1300
    steps = np.diff(record.t)
    # The pause is longer than any step that is bridged when signals are put on a grid.
    assert steps[599] > GAP_STEPS * 0.008
    np.testing.assert_allclose(np.delete(steps, 599), 0.008, atol=1e-6)
    np.testing.assert_array_equal(record.signals["q"][600:], raw().signals["q"][700:1400])


@pytest.mark.parametrize("late", [1.0, 1000.0])
def test_a_run_may_end_in_a_wrong_stamp(late: float) -> None:
    """All rows of the file were refused for it."""
    table = runs_in_one(slice(0, 600), slice(700, 1400))
    t = table.stamps.copy()
    t[599] += late
    record = run(replace(table, t=t))
    assert codes(record)[0] == "clock_mismatch"
    steps = np.diff(record.t)
    np.testing.assert_allclose(np.delete(steps, [598, 599]), 0.008, atol=1e-6)
    np.testing.assert_array_equal(record.signals["q"], table.signals["q"])


def test_runs_with_coarse_stamps_are_two_runs() -> None:
    table = runs_in_one(slice(0, 600), slice(700, 1400))
    record = run(replace(table, t=np.round(table.stamps, 2)))
    assert codes(record) == ["clock_mismatch", "dropped_rows"]
    # What repeats a stamp is dropped; the others are within half a digit.
    first = record.t < 600 * 0.008
    assert record.samples > 0.79 * table.samples
    q = table.signals["q"][np.round(record.t[first] / 0.008).astype(int)]
    step = np.abs(np.diff(table.signals["q"], axis=0)).max()
    assert np.abs(record.signals["q"][first] - q).max() < 1.5 * step


def test_gaps_are_reported() -> None:
    table = raw()
    keep = ~np.isin(np.arange(1500), [300, 301, 302, 800])
    holes = RawTable(
        source="x",
        format="csv",
        rows=np.arange(1, 1497),
        t=table.t[keep],
        signals={name: value[keep] for name, value in table.signals.items()},
    )
    record = run(holes)
    assert codes(record) == ["clock_jitter"]
    assert "gaps: 2, samples missing: about 4, the largest 32 ms" in record.problems[0].message


def test_jitter_is_no_gap() -> None:
    table = raw()
    assert table.t is not None
    by = np.random.default_rng(0).uniform(-3e-3, 3e-3, len(table.t))
    (told,) = run(replace(table, t=table.t + by)).problems
    assert told.code == "clock_jitter"
    assert "gap" not in told.message
    steps = 1e3 * np.diff(table.t + by)
    assert f"between {steps.min():.4g} and {steps.max():.4g} ms" in told.message


def test_rate_that_contradicts_velocities_is_reported() -> None:
    record = run(replace(raw(), t=None), rate_hz=120.0)
    assert codes(record) == ["clock_mismatch"]
    assert "125" in record.problems[0].message
    assert record.rate_hz == pytest.approx(120)
    assert codes(run(replace(raw(), t=MOTION.t * 1.05))) == ["clock_mismatch"]


def test_stamps_win_over_a_rate_and_say_so() -> None:
    record = run(raw(), rate_hz=500.0)
    assert codes(record) == ["clock_mismatch"]
    assert record.rate_hz == pytest.approx(125)
    assert codes(run(raw(), rate_hz=125.0)) == []


def test_velocities_of_other_joints_or_sign_are_reported() -> None:
    table = raw()
    qd = table.signals["qd"].copy()
    qd[:, 3] *= -1
    assert "joint 4 have the other sign" in run(signals(table, qd=qd)).problems[0].message
    mixed = table.signals["qd"][:, [1, 2, 3, 4, 5, 0]]
    assert "unit_suspect" in codes(run(signals(table, qd=mixed)))


def test_missing_values_cost_the_row_or_the_quantity() -> None:
    table = raw()
    effort = table.signals["current"].copy()
    effort[10:15, 2] = np.nan
    record = run(signals(table, current=effort))
    assert codes(record) == ["corrupt_rows", "clock_jitter"][:1]
    assert record.samples == 1495
    sparse = table.signals["qd"].copy()
    sparse[::2] = np.nan
    record = run(signals(table, qd=sparse))
    assert record.samples == 1500
    assert "qd" not in record.signals
    both = signals(
        table, effort=table.signals["current"] * np.where(np.arange(1500)[:, None] % 3, 1, np.nan)
    )
    record = run(both)
    assert record.samples == 1500
    assert "effort" not in record.signals


def test_sparse_temperatures_are_interpolated() -> None:
    temperature = np.full((1500, 6), np.nan)
    temperature[::125] = 25 + np.arange(12)[:, None] / 10
    record = run(signals(raw(), temperature=temperature))
    assert record.samples == 1500
    assert record.signals["temperature"][62, 0] == pytest.approx(25.05, abs=1e-3)
    assert codes(record) == ["corrupt_rows"]


@pytest.mark.parametrize("quantity", ["q", "current"])
def test_lost_essentials_are_refused_by_name(quantity: str) -> None:
    table = raw(labels={quantity: tuple(f"column {k}" for k in range(6))})
    value = table.signals[quantity].copy()
    value[:1200, 4] = np.nan
    with pytest.raises(RecordError) as caught:
        run(signals(table, **{quantity: value}))
    assert "column 4" in str(caught.value)


def test_infinite_and_absurd_values_cost_the_row() -> None:
    table = raw()
    q, qd = table.signals["q"].copy(), table.signals["qd"].copy()
    q[5, 0], q[6, 1], qd[7, 2], qd[8, 3] = np.inf, -np.inf, 1e300, np.nan
    t = table.t.copy()
    t[9] = np.inf
    record = run(replace(signals(table, q=q, qd=qd), t=t))
    assert record.samples == 1495
    assert codes(record) == ["corrupt_rows"]


# At two and a half rows they are up to a row old when they are written.
@pytest.mark.parametrize(("every", "share"), [(2, 0.1), (2.5, 0.6), (4, 0.1), (10, 0.3)])
def test_positions_that_are_renewed_slowly_are_interpolated(every: float, share: float) -> None:
    table = raw(noise=1)
    # It stands still for two seconds.
    true = table.signals["q"][
        np.minimum(np.arange(1500), 600 + np.maximum(np.arange(1500) - 850, 0))
    ]
    held = true[(np.arange(len(true)) // every * every).astype(int)]
    end, start = 1500 - int(every) - 1, 600 - int(every)
    without = {name: value for name, value in table.signals.items() if name != "qd"}
    record = run(replace(table, signals={**without, "q": held}))
    assert codes(record) == ["clock_jitter"]
    found, away = record.signals["q"], np.abs(held - true)[:end].max()
    moving = np.r_[0:start, 850:end]
    assert np.abs(found - true)[moving].max() < share * away
    np.testing.assert_allclose(found[650:800], true[650:800], rtol=0, atol=1e-4)


def test_coarse_positions_are_kept() -> None:
    table = raw(noise=1)
    without = {name: value for name, value in table.signals.items() if name != "qd"}
    coarse = np.round(table.signals["q"], 2)
    record = run(replace(table, signals={**without, "q": coarse}))
    np.testing.assert_array_equal(record.signals["q"], coarse)


def test_coarse_torques_are_not_clipped() -> None:
    t = np.arange(4000) / 125.0
    torque = np.sin(2 * np.pi * 0.3 * t)[:, None] * np.linspace(1.0, 20.0, 96)
    assert not at_limit(np.round(torque)).any()
    assert not at_limit(torque).any()
    clipped = at_limit(np.clip(np.round(torque[:, 60:]), -9.0, 9.0))
    np.testing.assert_array_equal(clipped, np.abs(np.round(torque[:, 60:])) >= 9.0)


def test_clipped_and_dead_torques_are_reported() -> None:
    table = raw(noise=1)
    current = np.clip(table.signals["current"], -1.2, 1.2)
    record = run(signals(table, current=current))
    assert set(codes(record)) == {"saturated"}
    dead = table.signals["current"].copy()
    dead[:, 3] = 0.0
    record = run(signals(table, current=dead))
    (found,) = record.problems
    assert (found.kind, found.joints, found.value) == ("dead_channel", (3,), 0.0)


def test_a_stopped_end_is_left_out() -> None:
    table = raw()
    qd = table.signals["qd"].copy()
    q = table.signals["q"].copy()
    q[1480:] = q[1480]
    qd[1480:] = 0.0
    record = run(signals(table, q=q, qd=qd))
    assert codes(record) == ["corrupt_rows"]
    assert record.samples == 1480


def test_a_robot_at_rest_is_reported() -> None:
    table = raw()
    still = {name: np.repeat(value[:1], 1500, axis=0) for name, value in table.signals.items()}
    still["current"] = table.signals["current"]
    assert codes(run(signals(table, **still))) == ["at_rest"]


@pytest.mark.parametrize("samples", [2, 3, 5, 10, 25, 60])
def test_short_recordings_pass(samples: int) -> None:
    assert run(raw(Motion(samples=samples))).samples == samples


@pytest.mark.parametrize("joints", [1, 2, 7])
def test_any_number_of_joints(joints: int) -> None:
    record = run(raw(Motion(samples=600, joints=joints)))
    assert record.joints == joints
    assert codes(record) == []


def test_own_recordings_are_read_for_a_robot(tmp_path: Path) -> None:
    from dynid.recording import write_record

    path = tmp_path / "x.parquet"
    write_record(run(raw()), path)
    robot = load_robot("ur5")
    record = read_recording(path, robot=robot, gains=[1, 2, 3, 4, 5, 6])
    assert record.metadata.robot == robot.name
    assert record.metadata.drive_gains == (1, 2, 3, 4, 5, 6)
    names = tuple(robot.joint_names[k] for k in (2, 1, 0, 3, 4, 5))
    stored = run(raw())
    named = replace(stored, metadata=replace(stored.metadata, joint_names=names))
    write_record(named, path, force=True)
    record = read_recording(path, robot=robot)
    np.testing.assert_array_equal(record.signals["q"][:, 0], stored.signals["q"][:, 2])
    with pytest.raises(RecordError, match="complete"):
        read_recording(path, degrees=True)
    with pytest.raises(RecordError, match="one drive gain a joint"):
        read_recording(path, gains=[1.0])


@pytest.mark.parametrize("every", [3, 5, 10, 20])
def test_right_stamps_of_rows_that_are_missing_regularly_stay(every: int) -> None:
    table = raw(noise=1)
    kept = np.arange(1500) % every > 0
    some = {name: value[kept] for name, value in table.signals.items()}
    record = run(replace(table, rows=table.rows[kept], t=table.t[kept], signals=some))
    np.testing.assert_allclose(record.t, MOTION.t[kept] - MOTION.t[kept][0], atol=1e-9)


def test_steps_of_whole_digits_without_repeats_are_spread() -> None:
    # 5 ms digits for rows each 8 ms: steps of 5 and 10 ms.
    record = run(raw(noise=1, t=np.floor(MOTION.t / 0.005) * 0.005))
    np.testing.assert_allclose(record.t, MOTION.t - MOTION.t[0], atol=3e-3)
    assert np.ptp(np.diff(record.t)) < 1e-9
