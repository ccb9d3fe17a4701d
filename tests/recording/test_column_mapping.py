from __future__ import annotations

import pytest

from dynid.core import RecordError
from dynid.recording import match_headers, parse_name, says_degrees
from dynid.recording.columns import parse_columns, select


def test_mapping_is_taken_apart() -> None:
    spec = parse_columns(" t=0, q=1:7 ,qd = 7:13,current=13+15 ")
    assert spec == {"t": "0", "q": "1:7", "qd": "7:13", "current": "13+15"}


def test_mapping_may_hold_matrix_columns() -> None:
    assert parse_columns("q=data[:,1:7],t=data[0]") == {"q": "data[:,1:7]", "t": "data[0]"}


@pytest.mark.parametrize(
    ("spec", "item"),
    [
        ("q", "'q'"),
        ("q=1:3,x=4", "x=4"),
        ("q=1:3,q=4:6", "q=4:6"),
        ("q=", "q="),
        ("t=0", "positions q"),
        ("", "positions q"),
        ("q=0:6,,effort", "'effort'"),
    ],
)
def test_bad_mappings_name_the_item(spec: str, item: str) -> None:
    with pytest.raises(RecordError) as caught:
        parse_columns(spec)
    assert item in str(caught.value)
    assert "\n" not in str(caught.value)


def test_selectors() -> None:
    assert select("q", "3", 10, None) == [3]
    assert select("q", "1:4", 10, None) == [1, 2, 3]
    assert select("q", "1:3+7+5", 10, None) == [1, 2, 7, 5]
    names = ["time", "q_0", "q_1", "tau_1", "tau_2"]
    assert select("t", "time", 5, names) == [0]
    assert select("q", "q", 5, names) == [1, 2]
    assert select("effort", "tau", 5, names) == [3, 4]
    assert select("q", "q_1+q_0", 5, names) == [2, 1]


@pytest.mark.parametrize(
    "selector",
    ["10", "0:11", "4:4", "7:3", "a", "-1", "1:2:3", "1.5", "", "1+1", "9" * 30, ":", "q"],
)
def test_bad_selectors_are_one_error(selector: str) -> None:
    with pytest.raises(RecordError):
        select("q", selector, 10, None)


def test_time_is_one_column() -> None:
    with pytest.raises(RecordError, match="one column"):
        select("t", "0:2", 10, None)


@pytest.mark.parametrize(
    ("text", "base", "index"),
    [
        ("actual_q_3", "actual_q", 3),
        ("Position1", "position", 1),
        ("q0", "q", 0),
        ("tau_J[6]", "tau_j", 6),
        ("tau_Nm 2", "tau", 2),
        ("Torque 2 [Nm]", "torque", 2),
        ("j1_pos", "pos", 1),
        ("joint_2_velocity", "velocity", 2),
        ("q_joint_4", "q", 4),
        ("TorqueSm7", "torque_sm", 7),
        ("timestamp", "timestamp", None),
        ("/joint_states/position[2]", "position", 2),
        ("Joint_1", "", 1),
        ("/rtde/actual_q[0]", "actual_q", 0),
        ("robot.state.position.3", "position", 3),
        ("dq1", "dq", 1),
        ("MeasuredJointPosition_0", "measured_joint_position", 0),
        ("", "", None),
    ],
)
def test_names_are_taken_apart(text: str, base: str, index: int | None) -> None:
    name = parse_name(text)
    assert (name.base, name.index) == (base, index)


def test_names_tell_units() -> None:
    assert parse_name("Time (ms)").time_scale == 1e-3
    assert parse_name("time_us").time_scale == 1e-6
    assert parse_name("time").time_scale is None
    assert parse_name("q_1 [deg]").unit == "deg"
    assert parse_name("position_deg_1").unit == "deg"
    assert parse_name("q_1 [rad]").unit == "rad"
    assert says_degrees("rec.act_pos_mot_deg")


def ur(names: str, joints: int = 6) -> list[str]:
    return [f"{name}_{k}" for name in names.split() for k in range(joints)]


def test_ur_header() -> None:
    names = [
        "timestamp",
        *ur("target_q target_qd actual_q actual_qd actual_current"),
        *ur("joint_temperatures target_moment"),
        "robot_mode",
        *ur("actual_TCP_pose"),
    ]
    match = match_headers(names)
    assert match.columns["t"] == [0]
    assert match.columns["q"] == list(range(13, 19))
    assert match.columns["temperature"] == list(range(31, 37))
    assert set(match.columns) == {
        "t",
        "target_q",
        "target_qd",
        "q",
        "qd",
        "current",
        "temperature",
        "target_moment",
    }


@pytest.mark.parametrize("scope", ["trial_1/", "robot_0.", "log[2]."])
def test_a_number_of_the_run_is_no_joint_of_its_time(scope: str) -> None:
    names = [f"{scope}time", *(f"{scope}{name}" for name in ur("q tau"))]
    assert match_headers(names).columns["t"] == [0]
    # A time each is one of the joints, if not a temperature.
    each = [f"{scope}t_{k}" for k in range(6)]
    assert "t" not in match_headers([*each, *names[1:]]).columns


@pytest.mark.parametrize("torque", ["current_effort", "current_joint_torques", "current_tau"])
def test_a_present_torque_is_no_current(torque: str) -> None:
    columns = match_headers(["time", *ur(f"current_position current_velocity {torque}")]).columns
    assert columns["effort"] == list(range(13, 19))
    assert "current" not in columns


def test_plain_torque_wins_and_a_note_says_so() -> None:
    names = [
        "Time",
        *(f"{n}{k}" for n in ("Position", "TorqueSm", "Torque", "TorqueCur") for k in (1, 2, 3)),
    ]
    match = match_headers(names)
    assert match.columns["effort"] == [7, 8, 9]
    assert "torque_cur" in " ".join(match.notes)


def test_the_only_torque_is_taken() -> None:
    match = match_headers(["t", "q1", "q2", "torque_sensor_1", "torque_sensor_2"])
    assert match.columns["effort"] == [3, 4]


def test_one_joint_needs_no_index() -> None:
    match = match_headers(["t", "q", "qd", "tau"])
    assert match.columns == {"t": [0], "q": [1], "qd": [2], "effort": [3]}


def test_plotjuggler_paths_give_joint_names() -> None:
    names = [
        "__time",
        *(
            f"/joint_states/{joint}/{what}"
            for joint in ("elbow", "base")
            for what in ("position", "velocity", "effort")
        ),
    ]
    match = match_headers(names)
    assert match.joint_names == ("elbow", "base")
    assert match.columns["effort"] == [3, 6]
    assert match.columns["t"] == [0]


@pytest.mark.parametrize(
    ("header", "q", "torque"),
    [
        ("time J{} Torque{}", 1, 3),
        ("time finger_joint_0 finger_joint_1 joint_{} joint_{}_velocity joint_{}_effort", 3, 7),
        ("present_position_{} present_velocity_{} present_current_{} ts", 0, 4),
        ("t pos_err q_cmd_{} q_current_{} dq_{} tau_{}", 4, 8),
        ("t j{}_pos_enc j{}_pos_cmd j{}_vel j{}_current", 1, 7),
        ("t q{} qv{} tau{} q_des{} qv_des{}", 1, 5),
        ("PLC_TIMESTAMP A{}_Position A{}_Torque", 1, 3),
        ("time τ{} θ{} ω{}", 3, 1),
        ("timestamp actual_q_{} measured_tq_{} external_tq_{}", 1, 3),
    ],
)
def test_headers_of_other_recorders(header: str, q: int, torque: int) -> None:
    words = header.split()
    match = match_headers([w.format(k) for w in words for k in ((1, 2) if "{}" in w else (0,))])
    assert match.columns["q"] == [q, q + 1]
    assert (match.columns.get("effort") or match.columns["current"]) == [torque, torque + 1]
    assert match.clocks
    assert ("qd" in match.columns) == any(word in header for word in ("dq", "qv", "vel", "ω"))


@pytest.mark.parametrize(
    "names",
    [
        ["t", "q_0", "q_1", "q_3"],
        ["t", "j0", "j1", "vel0", "vel1"],
        ["t", "q_0", "q_1", "q_1"],
        ["t", "q_2", "q_3"],
        ["t", "time", "x_0", "x_1"],
        ["t", "q_0", "q_1", "q_2", "tau_0", "tau_1"],
        ["t", "t", "q_0", "q_1"],
        ["q", "q", "q"],
        ["", "", ""],
    ],
)
def test_damaged_headers_are_refused(names: list[str]) -> None:
    with pytest.raises(RecordError):
        match_headers(names)
