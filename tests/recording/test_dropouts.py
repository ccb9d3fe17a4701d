"""Clocks that are set, links that drop out, velocities that are others: told, and repaired."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from recorded_motions import Motion

from dynid.recording import ExperimentRecord, RawTable, ReadOptions, repair
from dynid.signals.resample import GAP_STEPS

MOTION = Motion(samples=1500)
SAME_TIME = 1e-6
COUNTED_ANEW = np.zeros(0, dtype=np.int64)
GEARS = np.array([101.0, 101.0, 101.0, 54.0, 54.0, 54.0])


def raw(**changes) -> RawTable:
    t = MOTION.t
    rows = np.arange(1, len(t) + 1, dtype=np.int64)
    signals = {"q": MOTION.position(t), "qd": MOTION.velocity(t), "current": MOTION.current(t)}
    return replace(
        RawTable(source="x.csv", format="csv", rows=rows, signals=signals, t=t), **changes
    )


def run(table: RawTable, **settings) -> ExperimentRecord:
    robot = settings.pop("robot", None)
    return repair(table, ReadOptions(**settings), robot)


def codes(record: ExperimentRecord) -> list[str]:
    return [problem.code for problem in record.problems]


@pytest.mark.parametrize("by", [3600.0, 0.3, -0.05, -5.0, -1234.0])
def test_a_clock_that_is_set_in_motion_is_set_back(by: float) -> None:
    t = MOTION.t.copy()
    t[700:] += by
    record = run(raw(t=t))
    assert codes(record) == ["clock_mismatch"]
    assert "line 701" in record.problems[0].message
    np.testing.assert_allclose(record.t, MOTION.t - MOTION.start, atol=SAME_TIME)


def test_a_counter_that_wraps() -> None:
    counter = (np.round(MOTION.t * 1e6) + 2**32 - 1.24e9) % 2**32
    assert (np.diff(counter) < 0).sum() == 1
    record = run(raw(t=counter))
    assert codes(record) == ["clock_mismatch", "unit_suspect"]
    np.testing.assert_allclose(record.t, MOTION.t - MOTION.start, atol=SAME_TIME)


@pytest.mark.parametrize("lost", [4, 40, 400])
def test_rows_that_are_missing_are_no_jump_of_the_clock(lost: int) -> None:
    keep = np.ones(1500, dtype=bool)
    keep[700 : 700 + lost] = False
    record = run(replace(raw().keep(keep), index=COUNTED_ANEW))
    assert codes(record) == ["clock_jitter"]
    np.testing.assert_allclose(record.t, MOTION.t[keep] - MOTION.start, atol=SAME_TIME)


def test_a_late_stamp_is_no_jump_of_the_clock() -> None:
    t = MOTION.t.copy()
    # Five rows wait for a busy PC, and are stamped close together when it is back.
    t[700:706] = t[706] - 0.001 * np.arange(6, 0, -1)
    record = run(raw(t=t))
    assert "clock_mismatch" not in codes(record)
    np.testing.assert_allclose(record.t[-100:], MOTION.t[-100:] - MOTION.start, atol=SAME_TIME)


def test_an_hour_of_pause_at_rest_is_shortened() -> None:
    q = MOTION.position(MOTION.t)
    q[690:710] = q[690]
    t = MOTION.t.copy()
    t[700:] += 3600
    table = raw(t=t)
    record = run(table.with_signals({"q": q, "qd": np.gradient(q, axis=0) * 125}))
    assert "clock_jitter" in codes(record)
    steps = np.diff(record.t)
    assert GAP_STEPS / 125 < steps.max() < 2
    assert record.t[-1] < 20


@pytest.mark.parametrize("length", [8, 100, 250])
def test_positions_that_were_held_in_motion_are_left_out(length: int) -> None:
    table = raw()
    q = table.signals["q"].copy()
    q[600 : 600 + length] = q[599]
    record = run(table.with_signals({"q": q}))
    assert codes(record)[0] == "corrupt_rows"
    np.testing.assert_allclose(
        record.signals["q"], MOTION.position(MOTION.start + record.t), atol=1e-9
    )


def test_all_signals_held() -> None:
    table = raw()
    held = {name: value.copy() for name, value in table.signals.items()}
    for value in held.values():
        value[600:700] = value[599]
    record = run(table.with_signals(held))
    assert record.samples == 1400
    assert "line 601" in record.problems[0].message


@pytest.mark.parametrize("value", [None, 0.0])
def test_one_torque_that_was_held_in_motion_is_left_out(value: float | None) -> None:
    table = raw()
    current = table.signals["current"].copy()
    current[600:800, 2] = current[599, 2] if value is None else value
    record = run(table.with_signals({"current": current}))
    assert codes(record) == ["corrupt_rows"]
    assert (record.samples, record.metadata.dropped_rows) == (1300, 200)


def test_coarse_torques_and_joints_at_rest_are_kept() -> None:
    table = raw()
    current = table.signals["current"].copy()
    coarse = np.round(current / 0.8) * 0.8
    assert "corrupt_rows" not in codes(run(table.with_signals({"current": coarse})))
    q, qd = table.signals["q"].copy(), table.signals["qd"].copy()
    q[:, 2], qd[:, 2], current[300:900, 2] = q[0, 2], 0.0, current[300, 2]
    record = run(table.with_signals({"q": q, "qd": qd, "current": current}))
    assert "corrupt_rows" not in codes(record)


def test_coarse_positions_that_start_from_rest_are_kept() -> None:
    table = raw()
    grain = 2 * np.pi / 2**12
    q = np.round(table.signals["q"] / grain) * grain
    q[:300] = q[300]
    record = run(table.with_signals({"q": q}).without("qd"))
    assert "corrupt_rows" not in codes(record)


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (60 / (2 * np.pi), "in rpm"),
        (-1.0, "other sign"),
        (GEARS, "54 to 101 times.*motors"),
        (np.array([1, 1, 1, 180 / np.pi, 1, 1]), r"57\.\d+ times.*joints . and 4"),
        (np.array([1e3, 1e3, 1e3, 1, 1, 1]), "to 1000 times.*joints . and [123]"),
        (1e3, r"999\.9 times.*another unit"),
    ],
)
def test_velocities_that_are_others_are_left_out(factor: object, words: str) -> None:
    table = raw()
    record = run(table.with_signals({"qd": table.signals["qd"] * factor}))
    assert "qd" not in record.signals
    assert [p.code for p in record.problems] == ["unit_suspect"]
    assert pytest.approx(1500) == record.samples
    assert re.search(words, record.problems[0].message)


def test_a_time_that_counts_rows_is_told_where_velocities_say_so() -> None:
    said = [problem.message for problem in run(raw(t=np.arange(1500.0))).problems]
    assert any("the velocities 125 Hz" in message for message in said)
    # At 1 kHz it may as well be milliseconds.
    fast = Motion(samples=4000, rate=1000.0)
    t = fast.t
    table = RawTable(
        source="x.csv",
        format="csv",
        rows=np.arange(1, 4001, dtype=np.int64),
        signals={"q": fast.position(t), "qd": fast.velocity(t), "current": fast.current(t)},
        t=np.arange(4000.0),
    )
    assert run(table).rate_hz == pytest.approx(1000)


@pytest.mark.parametrize("quantity", ["current", "qd", "q"])
@pytest.mark.parametrize("length", [5, 200])
def test_numbers_that_stand_for_no_value_are_left_out(quantity: str, length: int) -> None:
    table = raw()
    value = table.signals[quantity].copy()
    value[600 : 600 + length] = -9999.0
    record = run(table.with_signals({quantity: value}))
    assert codes(record)[0] == "corrupt_rows"
    assert record.samples == 1500 - length
    for name in ("q", "qd", "current"):
        truth = table.signals[name][(record.t * 125 + 0.5).astype(int)]
        np.testing.assert_allclose(record.signals[name], truth, atol=1e-9)


def test_clipped_torques_are_no_placeholders() -> None:
    table = raw()
    current = table.signals["current"]
    current = np.clip(current, *np.quantile(current, [0.1, 0.9], axis=0))
    record = run(table.with_signals({"current": current}))
    assert record.samples == 1500
    assert set(codes(record)) == {"saturated"}


@pytest.mark.parametrize("start", [0, 700, 1480])
def test_zeros_of_all_torques_are_no_torques(start: int) -> None:
    table = raw()
    current = table.signals["current"].copy()
    current[start : start + 20] = 0.0
    record = run(table.with_signals({"current": current}))
    assert codes(record) == ["corrupt_rows"]
    assert record.samples == 1480
    assert (record.signals["current"] != 0).any(axis=1).all()
