from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynid.core import RecordError
from dynid.recording import factor_of, match_headers, read_recording
from dynid.robot import load_robot

JOINTS = range(1, 7)


def write(path: Path, *, time: str = "t", q: str = "", torque: str = "tau{} [Nm]") -> Path:
    t = np.arange(400) / 125
    motion = np.sin(np.outer(t, np.arange(1, 7) / 2))
    table = np.column_stack([t, motion, 5 * np.cos(np.outer(t, np.arange(1, 7)))])
    header = [time, *(f"q{k}{q}" for k in JOINTS), *(torque.format(k) for k in JOINTS)]
    np.savetxt(path, table, delimiter=",", header=",".join(header), comments="", fmt="%.6f")
    return path


@pytest.mark.parametrize(
    "names",
    [
        {},
        {"time": "time [s]", "q": " [rad]", "torque": "effort{} (N.m)"},
        {"torque": "current{} [A]"},
    ],
)
def test_si_units_pass(tmp_path: Path, names: dict[str, str]) -> None:
    record = read_recording(write(tmp_path / "x.csv", **names), robot=load_robot("ur5"))
    assert record.samples == 400
    assert record.rate_hz == pytest.approx(125.0, rel=1e-3)


@pytest.mark.parametrize(
    ("position", "target", "torque"),
    [
        ("J{} [deg]", "J{} target [deg]", "J{} [Nm]"),
        ("A{} Ist [deg]", "A{} Soll [deg]", "A{} [kNm]"),
        ("Axis {} [°]", "Axis {} ref [°]", "Axis {} [A]"),
        ("j{}_rad", "j{}_cmd_rad", "j{}_nm"),
    ],
)
def test_a_unit_says_what_a_column_of_a_joint_holds(
    position: str, target: str, torque: str
) -> None:
    columns = [text.format(k) for text in (position, target, torque) for k in JOINTS]
    found = match_headers(["t", *columns]).columns
    source = "current" if "[A]" in torque else "effort"
    every = [found[name] for name in ("q", "target_q", source)]
    assert every == [list(range(first, first + 6)) for first in (1, 7, 13)]


@pytest.mark.parametrize(
    ("position", "torque"),
    [
        ("q{} / deg", "tau{} / mNm"),
        ("q{}, °", "tau{}, mN m"),
        ("q{} in °", "tau{} mN·m"),
        ("q{}.deg", "tau{}.mNm"),
        ("q[{}]_deg", "tau[{}]_mNm"),
        ("/robot/q({}) deg", "/robot/tau({}) mNm"),
        ("theta_{}_(°)", "torque_{}_(mNm)"),
        ("position [deg][J{}]", "effort [mNm][J{}]"),
        ("position_deg[elbow_{}]", "effort_mNm[elbow_{}]"),
        ("q[0][{}] [deg]", "tau[0][{}] [mNm]"),
        ("q:{} deg", "tau:{} mNm"),
        ("J{}ActPos [deg]", "J{}Torque [mNm]"),
        ("{}_position_value [deg]", "{}_torque_value [mNm]"),
    ],
)
def test_units_and_numbers_stand_in_any_form(position: str, torque: str) -> None:
    # Names of joints keep their order, numbers do not.
    order = [1, 2, 3] if re.search(r"elbow|\[J", position) else [3, 1, 2]
    columns = [text.format(k) for text in (position, torque) for k in order]
    found = match_headers(["time / ms", *columns])
    assert found.columns["q"] == [1 + order.index(k) for k in (1, 2, 3)]
    assert found.columns["effort"] == [4 + order.index(k) for k in (1, 2, 3)]
    assert found.factors["q"] == pytest.approx([np.pi / 180] * 3)
    assert found.factors["effort"] == pytest.approx([1e-3] * 3)
    assert found.clocks[0].scale == 1e-3


def test_values_of_motors_are_not_in_thousandths_or_metres() -> None:
    with pytest.raises(RecordError, match="no columns of positions"):
        match_headers(["t", *(f"q_m{k}_rad" for k in JOINTS), *(f"tau_m{k}_Nm" for k in JOINTS)])
    columns = [x.format(k) for x in ("q [rad]_m{}", "tau [N.m]_m{}") for k in JOINTS]
    found = match_headers(["t", *columns])
    assert (found.columns["q"], found.columns["effort"]) == ([*JOINTS], [*range(7, 13)])


@pytest.mark.parametrize("name", ["J{} [%]", "J{} [-]", "J{} error [deg]", "tool {} [deg]"])
def test_no_unit_that_says_it_is_guessed(name: str) -> None:
    with pytest.raises(RecordError, match="no columns of positions"):
        match_headers(["t", *(name.format(k) for k in JOINTS), *(f"tau{k}" for k in JOINTS)])


@pytest.mark.parametrize(
    ("names", "quantity", "factor"),
    [
        ({"torque": "current{} [mA]"}, "current", 1e-3),
        ({"torque": "tau{} [mNm]"}, "effort", 1e-3),
        ({"torque": "tau{}_kNm"}, "effort", 1e3),
        ({"torque": "torque_{} (N.cm)"}, "effort", 1e-2),
        ({"q": " [rev]"}, "q", 2 * np.pi),
        ({"q": "_deg"}, "q", np.pi / 180),
        ({"q": " [mrad]"}, "q", 1e-3),
        ({"time": "Time [min]"}, "t", 60.0),
        ({"time": "time_ms"}, "t", 1e-3),
        # What brackets, an attribute or a column's type say precedes the name.
        ({"time": "time_ns [ms]"}, "t", 1e-3),
        ({"q": "_deg [mrad]"}, "q", 1e-3),
    ],
)
def test_known_units_are_converted(
    tmp_path: Path, names: dict[str, str], quantity: str, factor: float
) -> None:
    plain = read_recording(write(tmp_path / "plain.csv"))
    record = read_recording(write(tmp_path / "x.csv", **names))
    was = plain.t if quantity == "t" else plain.signals.get(quantity, plain.signals["effort"])
    now = record.t if quantity == "t" else record.signals[quantity]
    np.testing.assert_allclose(now, factor * was, rtol=1e-12)


@pytest.mark.parametrize(
    ("names", "torque_factor"),
    [
        (("q [°] {}", "qd [°/s] {}", "tau [N.m] {}"), 1.0),
        (("pos(deg)_{}", "vel(deg/s)_{}", "tau(kN.m)_{}"), 1e3),
        (("pos [deg] J{}", "vel [deg/s] J{}", "tau [mNm] J{}"), 1e-3),
    ],
)
def test_a_unit_may_stand_before_the_number(names: tuple[str, ...], torque_factor: float) -> None:
    found = match_headers(["t", *(name.format(k) for name in names for k in JOINTS)])
    assert found.columns["effort"] == list(range(13, 19))
    degree = np.pi / 180
    for quantity, factor in (("q", degree), ("qd", degree), ("effort", torque_factor)):
        assert found.factors[quantity] == pytest.approx([factor] * 6), quantity


def test_an_unknown_unit_before_the_number_is_refused() -> None:
    columns = [name.format(k) for name in ("q{}", "tau [%] {}") for k in JOINTS]
    with pytest.raises(RecordError, match="does not convert"):
        match_headers(["t", *columns])


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        ("rpm", 2 * np.pi / 60),
        ("1/min", 2 * np.pi / 60),
        ("1_min", 2 * np.pi / 60),
        ("rev/s", 2 * np.pi),
        ("deg/s", np.pi / 180),
        ("°/s", np.pi / 180),
        ("deg_per_s", np.pi / 180),
        ("rad/s", 1.0),
        ("rad s^-1", 1.0),
        ("rad·s⁻¹", 1.0),
        ("mm/s", 1e-3),
    ],
)
def test_units_of_velocities(unit: str, factor: float) -> None:
    assert factor_of("qd", unit) == pytest.approx(factor)


@pytest.mark.parametrize("unit", ["rad/s^2", "rad/s²", "rad/s/s", "rad/s2", "rad s^-2"])
def test_units_of_accelerations(unit: str) -> None:
    assert factor_of("qdd", unit) == 1.0
    assert factor_of("qd", unit) is None


@pytest.mark.parametrize(
    ("names", "unit"),
    [
        ({"torque": "tau{} [%]"}, "%"),
        ({"torque": "tau{} [rad]"}, "rad"),
        ({"torque": "current{} [Nm]"}, "nm"),
        ({"q": " [counts]"}, "counts"),
        ({"q": " [Nm]"}, "nm"),
    ],
)
def test_other_units_are_refused_by_name(tmp_path: Path, names: dict[str, str], unit: str) -> None:
    path = write(tmp_path / "x.csv", **names)
    with pytest.raises(RecordError, match="does not convert") as caught:
        read_recording(path, robot=load_robot("ur5"))
    assert str(caught.value.value) == unit
    # What the refusal tells to do works.
    record = read_recording(
        path, robot=load_robot("ur5"), columns="t=0,q=1:7,current=7:13", gains=[0.5] * 6
    )
    assert record.samples == 400
    assert "unit_suspect" in {notice.code for notice in record.problems}


@pytest.mark.parametrize("rate", [0.0, -5.0, float("nan"), float("inf")])
def test_a_rate_is_positive_even_where_stamps_win(tmp_path: Path, rate: float) -> None:
    with pytest.raises(RecordError, match="rate must be positive"):
        read_recording(write(tmp_path / "x.csv"), robot=load_robot("ur5"), rate_hz=rate)


def test_all_factors_of_mixed_units_are_noted(tmp_path: Path) -> None:
    path = write(tmp_path / "x.csv", q=" [deg]")
    path.write_text(path.read_text().replace("q2 [deg]", "q2 [mrad]", 1))
    note = read_recording(path).metadata.extra["notes"]
    assert "q (times 0.0174533, 0.001, 0.0174533, 0.0174533, 0.0174533, 0.0174533)" in note


@pytest.mark.parametrize(("unit", "which"), [("deg", 0), ("mm", 5)])
def test_units_of_the_other_kind_of_joint_are_told(tmp_path: Path, unit: str, which: int) -> None:
    """Programs label all axes alike, slides too."""
    ur5 = load_robot("ur5")
    kinds = ["prismatic" if (k == which) == (unit == "deg") else "revolute" for k in range(6)]
    robot = replace(ur5, joint_types=tuple(kinds))
    record = read_recording(write(tmp_path / "x.csv", q=f" [{unit}]"), robot=robot)
    (told,) = [problem for problem in record.problems if "was converted" in problem.text]
    assert told.kind == "unit_suspect"
    assert told.joints == (which,)


def test_temperatures_may_end_in_a_letter() -> None:
    names = [
        "t",
        *(f"{word}_{k}{end}" for word, end in (("q", ""), ("temp", "_C")) for k in (1, 2)),
    ]
    assert match_headers(names).columns["temperature"] == [3, 4]
