"""Headers of other recorders: what is read from them is compared with the known motion."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_motions import ALPHABETICAL, UR_JOINTS, Motion

from dynid.core import RecordError
from dynid.recording import open_record, read_recording
from dynid.robot import load_robot

MOTION = Motion(samples=400)
EPOCH = 1_600_000_000
BY_LETTER = [UR_JOINTS.index(name) for name in ALPHABETICAL]
GAINS = np.array([13.0, 14, 11, 9, 8, 7])
"""Torque for a unit of the motion's current, so that effort and current are not the same."""
SIX, ONE_TO_SIX = range(6), range(1, 7)


def truth(motion: Motion = MOTION) -> tuple[np.ndarray, ...]:
    t = motion.t
    return t, motion.position(t), motion.velocity(t), motion.current(t) * GAINS[: motion.joints]


def named(*patterns: str, joints: Sequence[object] = SIX) -> list[str]:
    return [pattern.format(joint) for pattern in patterns for joint in joints]


def write(path: Path, names: list[str], *columns: np.ndarray | list[str], by: str = ",") -> Path:
    flat: list[Sequence[object]] = []
    for column in columns:
        flat += list(np.transpose(column)) if np.ndim(column) == 2 else [column]
    rows = [
        by.join(x if isinstance(x, str) else f"{x:.17g}" for x in row)
        for row in zip(*flat, strict=True)
    ]
    path.write_text("\n".join([*([by.join(names)] if names else []), *rows]) + "\n")
    return path


def check(path: Path, **options) -> None:
    """The file gives the motion, in the robot's joint order, without a word of complaint."""
    record = read_recording(path, robot=load_robot("ur5"), **options)
    _, q, qd, effort = truth()
    suspect = [p.message for p in record.problems if "by their size" not in p.message]
    assert suspect == []
    assert record.samples == MOTION.samples
    np.testing.assert_allclose(record.t, MOTION.t - MOTION.t[0], atol=1e-6)
    np.testing.assert_allclose(record.signals["q"], q, atol=1e-9)
    np.testing.assert_allclose(record.signals["effort"], effort, atol=1e-6)
    if "qd" in record.signals:
        np.testing.assert_allclose(record.signals["qd"], qd, atol=1e-9)


NUMBERED = {
    "underscores": ("time", named("position_{}", "velocity_{}", "effort_{}")),
    "brackets": ("t", named("q[{}]", "dq[{}]", "tau[{}]")),
    "from one": ("Time (s)", named("q{}", "dq{}", "tau{}", joints=ONE_TO_SIX)),
    "words": (
        "Time (s)",
        named(
            "Joint {} Position (rad)",
            "Joint {} Velocity (rad/s)",
            "Joint {} Torque (Nm)",
            joints=ONE_TO_SIX,
        ),
    ),
    "number within": ("t", named("q{}_act", "q{}_dot", "tau{}_meas", joints=ONE_TO_SIX)),
    "PlotJuggler": (
        "__time",
        named(*(f"/joint_states/{x}[{{}}]" for x in ("position", "velocity", "effort"))),
    ),
    "PlotJuggler with dots": (
        "__time",
        named(*(f"/joint_states/{x}.{{}}" for x in ("position", "velocity", "effort"))),
    ),
    "measured and wanted": (
        "time",
        [
            *named("/ctl/actual/positions[{}]", "/ctl/actual/velocities[{}]"),
            *named("/joint_states/effort[{}]"),
        ],
    ),
    "struct": ("t", named("robot.joints[{}].pos", "robot.joints[{}].vel", "robot.joints[{}].tau")),
    "axes": ("t", named("AIPos.A{}", "Vel.A{}", "MsrJntTrq_A{}[Nm]", joints=ONE_TO_SIX)),
    "libfranka": ("time", named("state.q[{}]", "state.dq[{}]", "state.tau_J[{}]")),
    "upper case": ("TIME", named("POS{}", "VEL{}", "TORQUE{}", joints=ONE_TO_SIX)),
    "a prismatic joint": (
        "time [s]",
        [
            *named("J{}_pos", "J{}_vel", joints=ONE_TO_SIX),
            *(f"J{k}_{'force [N]' if k == 3 else 'torque [Nm]'}" for k in ONE_TO_SIX),
        ],
    ),
    "letters of DH tables": (
        "t",
        [
            "q1",
            "q2",
            "d3",
            *named("q{}", joints=(4, 5, 6)),
            *named("dq{}", joints=ONE_TO_SIX),
            *named("tau{}", joints=(1, 2)),
            "f3",
            *named("tau{}", joints=(4, 5, 6)),
        ],
    ),
    "KRL": (
        "t",
        named("$AXIS_ACT.A{}", "$VEL_AXIS_ACT[{}]", "$TORQUE_AXIS_ACT[{}]", joints=ONE_TO_SIX),
    ),
    "German": (
        "Zeit in s",
        named(
            "Achse {} Istposition",
            "Achse {} Istgeschwindigkeit",
            "Ist-Moment A{} [Nm]",
            joints=ONE_TO_SIX,
        ),
    ),
    "French": (
        "Temps [s]",
        named("Position axe {}", "Vitesse axe {}", "Couple axe {} [N.m]", joints=ONE_TO_SIX),
    ),
    "scripts": ("sample_time_s", named("th{}", "dth{}", "tau{}", joints=ONE_TO_SIX)),
    "dots": ("t", named("theta{}", "theta_dot{}", "tau{}", joints=ONE_TO_SIX)),
    "units behind blanks": ("t s", named("q{} rad", "qd{} rad/s", "tau{} N.m", joints=ONE_TO_SIX)),
    "units in letters": (
        "t",
        named("JointPos_{}_rad", "JointVel_{}_radps", "JointTorque_{}_Nm", joints=ONE_TO_SIX),
    ),
    "joint within": ("ros_time", named("pos_j{}_rad", "vel_j{}_rad_s", "trq_j{}_Nm")),
    "angular": (
        "t",
        named("angular position {} rad", "angular velocity {} rad/s", "torque {} Nm"),
    ),
    "short": ("t", named("J{}_ANG", "vel_J{}", "tor_J{}", joints=ONE_TO_SIX)),
    "camel case": ("Timestamp", named("JointPos{}", "JointVel{}", "JointTorque{}")),
}


@pytest.mark.parametrize("case", NUMBERED)
def test_numbered_columns(tmp_path: Path, case: str) -> None:
    time, names = NUMBERED[case]
    t, q, qd, effort = truth()
    path = write(tmp_path / "x.csv", [time, *names], t, q, qd, effort)
    check(path)
    assert "qd" in read_recording(path).signals


def test_numbers_go_before_the_order_of_columns(tmp_path: Path) -> None:
    t, q, qd, effort = truth()
    back = [5, 4, 3, 2, 1, 0]
    names = ["t", *named("q{}", "dq{}", "tau{}", joints=back)]
    check(write(tmp_path / "x.csv", names, t, q[:, back], qd[:, back], effort[:, back]))


JOINT_NAMES = {
    "brackets": "{what}[{joint}]",
    "PlotJuggler": "/joint_states/{joint}/{what}",
    "name first": "{joint}_{what}",
    "name last": "{what}_{joint}",
    "dot": "{joint}.{what}",
    "blank": "{joint} {what}",
    "actual": "actual {what} {joint}",
}


@pytest.mark.parametrize("case", JOINT_NAMES)
@pytest.mark.parametrize("gripper", [False, True])
def test_joint_names_anywhere_in_the_header(tmp_path: Path, case: str, gripper: bool) -> None:
    t, q, qd, effort = truth()
    joints = [*ALPHABETICAL, "robotiq_finger_joint"] if gripper else list(ALPHABETICAL)
    more = np.full((len(t), 1), 0.01) if gripper else np.empty((len(t), 0))
    names = [
        JOINT_NAMES[case].format(what=what, joint=joint)
        for what in ("position", "velocity", "effort")
        for joint in joints
    ]
    columns = [np.hstack([value[:, BY_LETTER], more]) for value in (q, qd, effort)]
    check(write(tmp_path / "x.csv", ["time", *names], t, *columns))


def test_joint_names_without_a_robot(tmp_path: Path) -> None:
    t, q, _, effort = truth()
    names = [f"{joint}_{x}" for x in ("position", "effort") for joint in ALPHABETICAL]
    path = write(tmp_path / "x.csv", ["time", *names], t, q[:, BY_LETTER], effort[:, BY_LETTER])
    record = read_recording(path)
    assert record.metadata.joint_names == UR_JOINTS
    np.testing.assert_allclose(record.signals["q"], q)


def test_columns_called_as_the_joints_are_positions(tmp_path: Path) -> None:
    t, q, _, effort = truth()
    names = [*ALPHABETICAL, *(f"{joint}_torque" for joint in ALPHABETICAL)]
    check(write(tmp_path / "x.csv", ["time", *names], t, q[:, BY_LETTER], effort[:, BY_LETTER]))


def test_named_columns_are_ordered_even_where_the_user_gives_a_range(tmp_path: Path) -> None:
    t, q, _, effort = truth()
    names = [f"{x}[{joint}]" for x in ("position", "effort") for joint in ALPHABETICAL]
    path = write(tmp_path / "x.csv", ["time", *names], t, q[:, BY_LETTER], effort[:, BY_LETTER])
    check(path, columns="t=0,q=1:7,effort=7:13")


@pytest.mark.parametrize("columns", [None, "t=0,q=1:7,effort=7:13"])
def test_each_column_keeps_its_unit_where_they_are_put_in_order(
    tmp_path: Path, columns: str | None
) -> None:
    """The torques stand in another order than the positions, and one of them in mN.m."""
    t, q, _, effort = truth()
    scale = np.ones(6)
    scale[0] = 1e3
    torques = [f"/joint_states/{joint}/effort" for joint in ALPHABETICAL]
    torques[0] += " [mNm]"
    names = ["t", *named("/joint_states/{}/position", joints=UR_JOINTS), *torques]
    path = write(tmp_path / "x.csv", names, t, q, effort[:, BY_LETTER] * scale)
    check(path, columns=columns)


def test_units_behind_joint_names_without_a_robot(tmp_path: Path) -> None:
    t, q, _, effort = truth()
    names = ["t", *named("position[{}] [deg]", "effort[{}] [mNm]", joints=UR_JOINTS)]
    record = read_recording(write(tmp_path / "x.csv", names, t, np.degrees(q), effort * 1e3))
    assert record.problems == ()
    np.testing.assert_allclose(record.signals["q"], q, atol=1e-9)
    np.testing.assert_allclose(record.signals["effort"], effort, atol=1e-6)


@pytest.mark.parametrize("named_ones", ["position", "effort"])
@pytest.mark.parametrize("columns", [None, "t=0,q=1:7,effort=7:13"])
def test_numbers_beside_names_in_another_order_are_refused(
    tmp_path: Path, named_ones: str, columns: str | None
) -> None:
    """Nobody can tell whether the numbers count from the base, or as the names stand."""
    t, q, _, effort = truth()
    for joints, order in ((UR_JOINTS, list(SIX)), (ALPHABETICAL, BY_LETTER)):
        labels = {
            what: named(f"{what}[{{}}]", joints=joints if what == named_ones else SIX)
            for what in ("position", "effort")
        }
        values = {"position": q, "effort": effort}
        values[named_ones] = values[named_ones][:, order]
        names = ["t", *labels["position"], *labels["effort"]]
        path = write(tmp_path / "x.csv", names, t, values["position"], values["effort"])
        if joints is UR_JOINTS:
            check(path, columns=columns)
            continue
        with pytest.raises(RecordError, match=r"names its joints and .* only numbers"):
            read_recording(path, robot=load_robot("ur5"), columns=columns)
    back = "+".join(str(1 + 6 * (named_ones == "effort") + BY_LETTER.index(k)) for k in SIX)
    one, two = (back, "7:13") if named_ones == "position" else ("1:7", back)
    check(path, columns=f"t=0,q={one},effort={two}")


def test_two_topics(tmp_path: Path) -> None:
    t, q, qd, effort = truth()
    names, columns = ["__time"], [t]
    for topic, shift in (("joint_commands", 0.3), ("joint_states", 0.0)):
        names += [
            f"/{topic}/{j}/{x}" for x in ("position", "velocity", "effort") for j in UR_JOINTS
        ]
        columns += [q + shift, qd, effort + shift]
    check(write(tmp_path / "x.csv", names, *columns))
    other = [
        name.replace("joint_states", "left").replace("joint_commands", "right") for name in names
    ]
    with pytest.raises(RecordError, match=r"2 sets of columns can be q.*columns"):
        read_recording(write(tmp_path / "y.csv", other, *columns))


def test_another_rate_of_a_topic(tmp_path: Path) -> None:
    """Every other row holds the torques only, which come between the positions."""
    t, q, _, _ = truth()
    late = t + 0.002
    then = MOTION.current(late) * GAINS
    rows = [",".join(["__time", *named("/js/position[{}]", "/wrench/torque[{}]")])]
    for k in range(len(t)):
        rows.append(",".join([f"{t[k]:.9f}", *map(repr, q[k].tolist()), *[""] * 6]))
        rows.append(",".join([f"{late[k]:.9f}", *[""] * 6, *map(repr, then[k].tolist())]))
    (tmp_path / "x.csv").write_text("\n".join(rows) + "\n")
    record = read_recording(tmp_path / "x.csv", robot=load_robot("ur5"))
    assert record.samples == MOTION.samples - 1
    assert "clock_mismatch" in {problem.code for problem in record.problems}
    np.testing.assert_allclose(record.signals["q"], q[1:], atol=1e-9)
    straight = np.column_stack([np.interp(t[1:], late, x) for x in then.T])
    np.testing.assert_allclose(record.signals["effort"], straight, atol=1e-6)


STAMPS = {
    "header.stamp.sec": ("header.stamp.sec", "header.stamp.nanosec"),
    "secs": ("header.stamp.secs", "header.stamp.nsecs"),
    "path": ("/js/header/stamp/sec", "/js/header/stamp/nanosec"),
    "underscores": ("header_stamp_sec", "header_stamp_nanosec"),
    "alone": ("sec", "nanosec"),
}


@pytest.mark.parametrize("case", STAMPS)
@pytest.mark.parametrize("arrival", [False, True])
def test_stamps_in_two_columns(tmp_path: Path, case: str, arrival: bool) -> None:
    t, q, qd, effort = truth()
    ticks = np.round(t * 1e9).astype(np.int64) + EPOCH * 10**9
    columns = [np.char.mod("%d", part) for part in np.divmod(ticks, 10**9)]
    names = list(STAMPS[case])
    if arrival:
        # The time of arrival jitters; the header's stamps do not.
        late = t + EPOCH + np.random.default_rng(1).uniform(0, 0.006, len(t))
        names, columns = ["Time", *names], [late, *columns]
    names += named("position_{}", "velocity_{}", "effort_{}")
    path = write(tmp_path / "x.csv", names, *columns, q, qd, effort)
    check(path)
    first = float(read_recording(path).metadata.extra["t0"])
    assert first == pytest.approx(EPOCH + t[0], abs=1e-6)
    if not arrival:
        check(path, columns="t=0+1,q=2:8,qd=8:14,effort=14:20")


def test_empty_header_stamps_give_way_to_the_time_of_arrival(tmp_path: Path) -> None:
    t, q, qd, effort = truth()
    zeros = np.zeros(len(t))
    names = ["Time", "header.stamp.sec", "header.stamp.nanosec"]
    names += named("position_{}", "velocity_{}", "effort_{}")
    check(write(tmp_path / "x.csv", names, t + EPOCH, zeros, zeros, q, qd, effort))


WRITTEN = {
    "ISO": lambda moment: moment.isoformat(timespec="microseconds") + "Z",
    "ISO with a zone": lambda moment: moment.isoformat(timespec="milliseconds") + "+02:00",
    "blank": lambda moment: moment.strftime("%Y-%m-%d %H:%M:%S.%f"),
    "day first": lambda moment: moment.strftime("%d.%m.%Y %H:%M:%S.%f"),
    "time of day": lambda moment: moment.strftime("%H:%M:%S.%f"),
    "twelve hours": lambda moment: moment.strftime("%I:%M:%S.%f %p"),
    "month first": lambda moment: moment.strftime("%m/%d/%Y %I:%M:%S.%f %p"),
    "blank, twelve hours": lambda moment: moment.strftime("%Y-%m-%d %I:%M:%S.%f %p"),
}


@pytest.mark.parametrize("case", WRITTEN)
def test_written_stamps_over_midnight(tmp_path: Path, case: str) -> None:
    t, q, qd, effort = truth()
    start = datetime.datetime(2024, 2, 28, 23, 59, 58)
    moments = [start + datetime.timedelta(seconds=float(x - t[0])) for x in t]
    names = ["timestamp", *named("q{}", "qd{}", "tau{}")]
    check(write(tmp_path / "x.csv", names, list(map(WRITTEN[case], moments)), q, qd, effort))


def test_rostopic_echo_takes_the_joints_from_the_rows(tmp_path: Path) -> None:
    t, q, qd, effort = truth()
    stamps = [str(EPOCH * 10**9 + round(x * 1e9)) for x in t]
    cells = [[name] * len(t) for name in ALPHABETICAL]
    names = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id"]
    names += named("field.name{}", "field.position{}", "field.velocity{}", "field.effort{}")
    columns = [value[:, BY_LETTER] for value in (q, qd, effort)]
    frame = [""] * len(t)
    path = write(
        tmp_path / "x.csv", names, stamps, np.arange(len(t)), stamps, frame, *cells, *columns
    )
    check(path)
    # A second publisher of other joints on the same topic.
    header, *rows = path.read_text().splitlines()
    strange = rows[0].replace("elbow_joint", "finger_joint")
    path.write_text("\n".join([header, *(x for row in rows for x in (row, strange))]) + "\n")
    record = read_recording(path, robot=load_robot("ur5"))
    np.testing.assert_allclose(record.signals["q"], q, atol=1e-9)
    assert "name other joints" in record.problems[0].message


def test_ros2_topic_echo_has_no_header(tmp_path: Path) -> None:
    t, q, qd, effort = truth()
    whole, rest = np.divmod(np.round(t * 1e9).astype(np.int64), 10**9)
    cells = [[name] * len(t) for name in ALPHABETICAL]
    columns = [value[:, BY_LETTER] for value in (q, qd, effort)]
    base = ["base_link"] * len(t)
    check(write(tmp_path / "x.csv", [], whole, rest, base, *cells, *columns))


@pytest.mark.parametrize("style", ['"[{}]"', "[{}]", '"({})"', "\"array('d', [{}])\""])
def test_lists_in_cells(tmp_path: Path, style: str) -> None:
    t, q, qd, effort = truth()
    rows = ["time,name,position,velocity,effort"]
    joints = (
        style.replace("array('d', ", "")
        .replace("])", "]")
        .format(", ".join(f"'{name}'" for name in ALPHABETICAL))
    )
    for k in range(len(t)):
        lists = [
            style.format(", ".join(map(repr, value[k, BY_LETTER].tolist())))
            for value in (q, qd, effort)
        ]
        rows.append(",".join([f"{t[k]:.6f}", joints, *lists]))
    (tmp_path / "x.csv").write_text("\n".join(rows) + "\n")
    check(tmp_path / "x.csv")


def test_degrees_over_the_full_circle_come_back_into_the_limits(tmp_path: Path) -> None:
    t, q, qd, effort = truth()
    names = ["time", *named("q{} [deg]", "qd{} [deg/s]", "tau{}")]
    path = write(tmp_path / "x.csv", names, t, np.degrees(q) % 360, np.degrees(qd), effort)
    robot = load_robot("ur5")
    half = np.full(6, np.pi)
    narrow = replace(robot, limits=replace(robot.limits, lower=-half, upper=half))
    record = read_recording(path, robot=narrow)
    np.testing.assert_allclose(record.signals["q"], q, atol=1e-9)
    assert "whole turns" in record.metadata.extra["notes"]


@pytest.mark.parametrize("sign", ["{}", "[{}]", '"({})"'])
@pytest.mark.parametrize("degrees", ["deg", "°"])
def test_units_of_a_line_of_their_own(tmp_path: Path, degrees: str, sign: str) -> None:
    t, q, qd, effort = truth()
    names = ["time", *named("pos{}", "vel{}", "torque{}")]
    units = ["ms", *[degrees] * 6, *[f"{degrees}/s"] * 6, *["mNm"] * 6]
    units = list(map(sign.format, units))
    rows = write(
        tmp_path / "x.csv", units, t * 1e3, np.degrees(q), np.degrees(qd), effort * 1e3
    ).read_text()
    (tmp_path / "x.csv").write_text(",".join(names) + "\n" + rows)
    check(tmp_path / "x.csv")


GROUPED = {
    "a quantity": (
        [
            "Time",
            *(x for name in ("Position", "Velocity", "Torque [Nm]") for x in [name] + [""] * 5),
        ],
        ["", *named("J{}", joints=ONE_TO_SIX) * 3],
    ),
    "repeated": (
        ["Time", *["Position [rad]"] * 6, *["Velocity"] * 6, *["Torque"] * 6],
        ["[s]", *UR_JOINTS * 3],
    ),
}


@pytest.mark.parametrize("case", GROUPED)
def test_names_under_a_line_of_groups(tmp_path: Path, case: str) -> None:
    groups, names = GROUPED[case]
    t, q, qd, effort = truth()
    path = write(tmp_path / "x.csv", names, t, q, qd, effort)
    table = path.read_text()
    # Workbooks with merged cells have no empty ones at the end of the line.
    for line in (",".join(groups), ",".join(groups).rstrip(",")):
        path.write_text(line + "\n" + table)
        check(path)


def test_names_under_groups_of_joints(tmp_path: Path) -> None:
    t, *signals = truth()
    groups = ["Time", *(x for k in ONE_TO_SIX for x in (f"Axis {k}", "", ""))]
    names = ["s", *["Position", "Velocity", "Torque"] * 6]
    by_joint = np.stack(signals, axis=2).reshape(len(t), 18)
    path = write(tmp_path / "x.csv", names, t, by_joint)
    path.write_text(",".join(groups) + "\n" + path.read_text())
    check(path)


LONG = {
    "numbers": ([str(k) for k in ONE_TO_SIX], "joint"),
    "names": (list(UR_JOINTS), "joint_name"),
}


@pytest.mark.parametrize("case", LONG)
@pytest.mark.parametrize("by_joint", [False, True])
def test_a_row_a_joint(tmp_path: Path, case: str, by_joint: bool) -> None:
    labels, word = LONG[case]
    t, q, qd, effort = truth()
    places = [(i, k) for i in range(len(t)) for k in SIX]
    if by_joint:
        places.sort(key=lambda place: place[1])
    i, k = np.array(places).T
    names = ["time", word, "q", "dq", "tau"]
    columns = t[i], [labels[joint] for joint in k], q[i, k], qd[i, k], effort[i, k]
    check(write(tmp_path / "x.csv", names, *columns))


def test_a_row_a_signal(tmp_path: Path) -> None:
    t, q, _, effort = truth()
    names = named("J{}.position", "J{}.torque", joints=ONE_TO_SIX)
    values = np.hstack([q, effort])
    columns = np.repeat(t, 12), names * len(t), values.ravel()
    check(write(tmp_path / "x.csv", ["timestamp", "signal", "value"], *columns))


@pytest.mark.parametrize("own_times", [False, True])
def test_a_row_a_joint_without_rows_of_one_time_is_refused(tmp_path: Path, own_times: bool) -> None:
    """Each joint's rows have other times than the others', or a joint has two rows of a time."""
    t, q, _, effort = truth()
    labels = [str(k) for k in ONE_TO_SIX] * len(t)
    times = np.repeat(t, 6)
    times = times + np.tile(np.arange(6) * 1e-4, len(t)) if own_times else np.repeat(t[::2], 12)
    columns = times, labels, q.ravel(), effort.ravel()
    path = write(tmp_path / "x.csv", ["time", "joint", "q", "tau"], *columns)
    with pytest.raises(RecordError) as refused:
        read_recording(path)
    given = 6 * len(t)
    times = given if own_times else len(t) // 2
    assert refused.value.value == f"{given} rows of 6 at {times} times"


def test_pairs_of_time_and_value(tmp_path: Path) -> None:
    """As TwinCAT Scope exports them."""
    t, q, qd, effort = truth()
    names = named("Axis{}.ActPos", "Axis{}.ActVelo", "Axis{}.ActTorque", joints=ONE_TO_SIX)
    values = np.hstack([q, qd, effort])
    pairs = np.stack([np.repeat(1e3 * t[:, None], 18, axis=1), values], axis=2)
    path = write(tmp_path / "x.csv", [], pairs.reshape(len(t), 36), by="\t")
    rows = path.read_text()

    lines = [("Name", names), ("Port", ["851"] * 18), ("SampleTime[ms]", ["8"] * 18)]
    head = ["\t".join(x for value in line for x in (word, value)) for word, line in lines]
    path.write_text("\n".join(["Name\tYT Scope", "", *head, "", rows]))
    check(path)


def test_a_measurement_of_labview(tmp_path: Path) -> None:
    t, q, qd, effort = truth()
    names = ["X_Value", *named("q{}", "dq{}", "tau{}", joints=ONE_TO_SIX), "Comment"]
    path = write(tmp_path / "x.lvm", names, t, q, qd, effort, by="\t")
    head = [
        *("LabVIEW Measurement", "Separator\tTab", "***End_of_Header***\t", "Channels\t18"),
        *("Date" + "\t2026/03/01" * 18, "Time" + "\t08:00:00.0" * 18, "X0" + "\t0.0" * 18),
        "***End_of_Header***" + "\t" * 18,
    ]
    path.write_text("\n".join(head) + "\n" + path.read_text())
    check(path)


def test_units_are_converted_where_the_user_names_the_columns(tmp_path: Path) -> None:
    t, q, qd, effort = truth()
    names = ["time_ms", *named("a{}_deg", "v{} [rpm]", "m{} [Nmm]")]
    path = write(tmp_path / "x.csv", names, t * 1e3, np.degrees(q), qd * 30 / np.pi, effort * 1e3)
    header, rest = path.read_text().split("\n", 1)
    path.write_text(header.replace("_deg", " [deg]") + "\n" + rest)
    check(path, columns="t=0,q=1:7,qd=7:13,effort=13:19")


def test_more_numbered_columns_than_joints_are_refused(tmp_path: Path) -> None:
    t, q, qd, effort = truth()
    more = np.zeros((len(t), 1))
    names = ["time", *named("q{}", "dq{}", "tau{}", joints=range(7))]
    path = write(tmp_path / "x.csv", names, t, *(np.hstack([x, more]) for x in (q, qd, effort)))
    with pytest.raises(RecordError, match=r"7 joints but ur5 has 6.*columns"):
        read_recording(path, robot=load_robot("ur5"))
    check(path, columns="t=0,q=1:7,qd=8:14,effort=15:21")


def test_a_clock_that_is_worth_nothing_says_what_to_type(tmp_path: Path) -> None:
    _, q, qd, effort = truth()
    names = ["time", *named("q{}", "dq{}", "tau{}")]
    path = write(tmp_path / "x.csv", names, np.full(len(q), 1.6e9), q, qd, effort)
    with pytest.raises(RecordError, match="does not increase") as caught:
        read_recording(path)
    option = str(caught.value.next_step).partition("--columns ")[2].partition(" ")[0]
    check(path, columns=option, rate_hz=125)


def test_a_table_without_header_asks_for_its_columns(tmp_path: Path) -> None:
    t, q, qd, effort = truth()
    path = write(tmp_path / "x.csv", [], t, q, qd, effort)
    with pytest.raises(RecordError, match=r"no header.*19 columns.*columns"):
        read_recording(path, robot=load_robot("ur5"))
    check(path, columns="t=0,q=1:7,qd=7:13,effort=13:19")


@pytest.mark.parametrize("what", ["torque_raw torque_filtered", "tau_ext", "torque_error"])
def test_columns_that_may_be_no_measured_torque_are_not_taken(tmp_path: Path, what: str) -> None:
    t, q, _, effort = truth()
    words = what.split()
    names = ["t", *named("q{}"), *named(*(f"{word}_{{}}" for word in words))]
    path = write(tmp_path / "x.csv", names, t, q, *[effort] * len(words))
    with pytest.raises(RecordError, match=r"more than one set|neither current nor effort"):
        read_recording(path, robot=load_robot("ur5"))


def test_a_word_behind_the_number_keeps_the_joints_of_a_torque_together(tmp_path: Path) -> None:
    t, q, qd, effort = truth()
    names = ["t", *named("q{}", "dq{}", "tau{}_raw", joints=ONE_TO_SIX)]
    check(write(tmp_path / "x.csv", names, t, q, qd, effort))
    names += named("tau{}_cal", joints=ONE_TO_SIX)
    path = write(tmp_path / "x.csv", names, t, q, qd, effort, effort)
    with pytest.raises(RecordError, match=r"more than one set.*got tau_raw, tau_cal") as refused:
        read_recording(path)
    told = str(refused.value).rpartition("columns ")[2]
    assert told == "t=0,q=1:7,qd=7:13,effort=13:19"
    check(path, columns=told)


DISTRACTORS = {
    "wanted": (
        "desired_position_{}",
        "actual_position_{}",
        "desired_torque_{}",
        "actual_torque_{}",
    ),
    "commanded": ("q_cmd_{}", "q_meas_{}", "tau_cmd_{}", "tau_meas_{}"),
    "of the tool": ("tcp_pos_{}", "joint_pos_{}", "tcp_force_{}", "joint_torque_{}"),
    "errors": ("pos_error_{}", "pos_{}", "torque_error_{}", "torque_{}"),
    "of the motor": ("motor_position_{}", "link_position_{}", "motor_torque_{}", "link_torque_{}"),
    "measured by name": ("position_{}", "actual_position_{}", "torque_{}", "actual_torque_{}"),
    "measured of the motor": ("q_cmd_{}", "q_{}", "motor_torque_actual_{}", "joint_torque_{}"),
    "of the motor first": ("motor_pos{}", "joint_pos{}", "motor_torque{}", "joint_torque{}"),
}


@pytest.mark.parametrize("case", DISTRACTORS)
def test_columns_beside_the_measured_ones(tmp_path: Path, case: str) -> None:
    t, q, _, effort = truth()
    names = ["time", *named(*DISTRACTORS[case])]
    check(write(tmp_path / "x.csv", names, t, 9 * q + 1, q, effort * 7 + 2, effort))


def test_torques_of_motors_taken_for_the_joints_are_told(tmp_path: Path) -> None:
    t, q, _, effort = truth()
    path = write(tmp_path / "x.csv", ["t", *named("q{}", "motor_torque{}")], t, q, effort)
    messages = [p.message for p in read_recording(path, robot=load_robot("ur5")).problems]
    assert any("torque_side" in message for message in messages)


def test_a_unit_alone_tells_no_torques(tmp_path: Path) -> None:
    t, q, _, effort = truth()
    path = write(tmp_path / "x.csv", ["t", *named("q{}", "M{} [mNm]")], t, q, effort * 1e3)
    with pytest.raises(RecordError, match="neither current nor effort") as refused:
        read_recording(path)
    assert "M1 [mNm], M2 [mNm]" in str(refused.value)
    assert "t=COLUMN,q=1:7,effort=FIRST:END" in str(refused.value)
    check(path, columns="t=0,q=1:7,effort=7:13")


def test_exponents_of_fortran(tmp_path: Path) -> None:
    t, q, _, effort = truth()
    path = write(tmp_path / "x.csv", ["t", *named("q{}", "tau{}")], t, q, effort)
    header, *rows = path.read_text().splitlines()
    numbers = [[f"{float(x):.16E}".replace("E", "D") for x in row.split(",")] for row in rows]
    path.write_text("\n".join([header, *(",".join(row) for row in numbers)]) + "\n")
    check(path)


@pytest.mark.parametrize("origin", [45_000, 738_000])
def test_days_of_spreadsheets_and_matlab(tmp_path: Path, origin: int) -> None:
    t, q, _, effort = truth()
    days = origin + np.round((t - t[0]) * 1e4) / 1e4 / 86400
    path = write(tmp_path / "x.csv", ["t", *named("q{}", "tau{}")], days, q, effort)
    record = read_recording(path)
    assert record.rate_hz == pytest.approx(125, rel=0.01)
    assert "days by their size" in record.problems[0].message


@pytest.mark.parametrize("thousands", [1, 2, 3])
def test_a_unit_that_the_rate_says_is_no_warning(tmp_path: Path, thousands: int) -> None:
    t, q, _, effort = truth()
    stamps = np.round((t - t[0]) * 1000.0**thousands)
    path = write(tmp_path / "x.csv", ["IPOC", *named("q{}", "tau{}")], stamps, q, effort)
    record = read_recording(path)
    assert record.rate_hz == pytest.approx(125, rel=0.01)
    (told,) = record.problems
    assert (told.kind, told.severity) == ("time_unit", "info")


def test_gains_of_a_recording_of_torques_are_told(tmp_path: Path) -> None:
    t, q, _, effort = truth()
    path = write(tmp_path / "x.csv", ["t", *named("q{}", "tau{}")], t, q, effort)
    (told,) = open_record(path, load_robot("ur5"), [1.0] * 6).problems
    assert (told.kind, told.severity) == ("gains_unused", "info")
    path = write(tmp_path / "y.csv", ["t", *named("q{}", "current{}")], t, q, 0.01 * effort)
    assert open_record(path, load_robot("ur5"), [1.0] * 6).problems == ()


def test_files_that_both_have_the_time(tmp_path: Path) -> None:
    t, q, _, effort = truth()
    files = [
        write(tmp_path / "pos.csv", ["time", *named("q{}")], t, q),
        write(tmp_path / "tau.csv", ["time", *named("tau{}")], t, effort),
    ]
    record = read_recording(files, robot=load_robot("ur5"))
    np.testing.assert_allclose(record.signals["effort"], effort)
    np.testing.assert_allclose(record.t, t - t[0], atol=1e-9)
    # Rows of one file are missing, and its clock is another one.
    kept = np.delete(np.arange(len(t)), [40, 41, 42])[5:]
    write(files[1], ["time", *named("tau{}")], t[kept] + 0.003, effort[kept])
    record = read_recording(files, robot=load_robot("ur5"))
    start = float(record.metadata.extra["t0"]) - t[0]
    true = np.column_stack([np.interp(record.t + start, t - t[0] + 0.003, x) for x in effort.T])
    np.testing.assert_allclose(record.signals["effort"], true, atol=1e-9)
    assert len(t) - 12 <= record.samples <= len(t) - 8
    write(files[1], ["time", *named("tau{}")], t + 100.0, effort)
    with pytest.raises(RecordError, match="do not overlap"):
        read_recording(files, robot=load_robot("ur5"))


@pytest.mark.parametrize("clocks", [("time [s]", "time [ms]"), ("time_us", "Time (s)")])
def test_times_of_files_in_units_of_their_own(tmp_path: Path, clocks: tuple[str, str]) -> None:
    t, q, _, effort = truth()
    t = t - t[0]
    ticks = {"[s]": t, "[ms]": 1e3 * t, "time_us": 1e6 * t, "(s)": t}
    first, second = (ticks[clock.split()[-1]] for clock in clocks)
    files = [
        write(tmp_path / "pos.csv", [clocks[0], *named("q{}")], first, q),
        write(tmp_path / "tau.csv", [clocks[1], *named("tau{}")], second, effort),
    ]
    record = read_recording(files, robot=load_robot("ur5"))
    np.testing.assert_allclose(record.signals["effort"], effort, atol=1e-6)
    np.testing.assert_allclose(record.t, t, atol=1e-9)
    # Where neither says its unit, the lengths do.
    write(files[0], ["time", *named("q{}")], t, q)
    write(files[1], ["time", *named("tau{}")], 1e3 * t, effort)
    with pytest.raises(RecordError, match="different units"):
        read_recording(files, robot=load_robot("ur5"))


def test_qualifiers_are_no_joints(tmp_path: Path) -> None:
    t, q, _, effort = truth()
    names = ["t", "q_raw", "q_filtered", "tau_raw", "tau_filtered"]
    path = write(tmp_path / "x.csv", names, t, q[:, :2], effort[:, :2])
    with pytest.raises(RecordError, match="columns"):
        read_recording(path)


def test_large_torques_are_told(tmp_path: Path) -> None:
    t, q, _, effort = truth()
    names = ["t", *named("q{}", "tau{}")]
    record = read_recording(
        write(tmp_path / "x.csv", names, t, q, effort * 1e3), robot=load_robot("ur5")
    )
    (message,) = (x.message for x in record.problems if "times the torque limit" in x.message)
    # What prints it puts a full stop behind it.
    assert message[-1].isalpha()


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8", "utf-8-sig", "utf-16"])
def test_a_degree_sign_in_any_encoding(tmp_path: Path, encoding: str) -> None:
    t, q, qd, effort = truth()
    names = ["Time [s]", *named("q{} [°]", "dq{} [°/s]", "tau{} [Nm]")]
    path = write(tmp_path / "x.csv", names, t, np.degrees(q), np.degrees(qd), effort)
    path.write_bytes(path.read_text().encode(encoding))
    check(path)


@pytest.mark.parametrize(
    "names",
    [
        ("QActual_{}", "QDActual_{}", "IActual_{}"),
        ("Axis_{}.fActPosition", "Axis_{}.fActVelocity", "Axis_{}.fActTorque"),
        ("GVL.Axis{}.ActPos", "GVL.Axis{}.ActVelo", "GVL.Axis{}.ActTorque"),
        ("joint_actual_position{}", "joint_actual_velocity{}", "instCurrent{}"),
        ("Winkel_{}", "Geschwindigkeit_{}", "Drehmoment_{}"),
        ("q_log_{}", "qd_log_{}", "tau_data_{}"),
    ],
)
def test_names_of_other_makers(tmp_path: Path, names: tuple[str, str, str]) -> None:
    motion = Motion(samples=300)
    head = ["time", *(name.format(k) for name in names for k in range(1, 7))]
    rows = [",".join(map(repr, row)) for row in motion.table().tolist()]
    (tmp_path / "x.csv").write_text("\n".join([",".join(head), *rows]) + "\n")
    record = read_recording(tmp_path / "x.csv")
    assert record.problems == ()
    np.testing.assert_array_equal(record.signals["q"], motion.position(motion.t))
    np.testing.assert_array_equal(record.signals["qd"], motion.velocity(motion.t))
    torque = record.signals.get("effort", record.signals.get("current"))
    np.testing.assert_array_equal(torque, motion.current(motion.t))


def test_torques_that_are_not_measured_are_not_taken(tmp_path: Path) -> None:
    motion = Motion(samples=300)
    head = [f"{name}_{k}" for name in ("q", "tau_gravity", "tau_ext_hat") for k in range(6)]
    rows = [",".join(map(repr, row)) for row in motion.table().tolist()]
    (tmp_path / "x.csv").write_text("\n".join([",".join(["t", *head]), *rows]) + "\n")
    with pytest.raises(RecordError, match="neither current nor effort"):
        read_recording(tmp_path / "x.csv")


@pytest.mark.parametrize("name", ["joint_{}", "axis{}"])
def test_one_file_a_joint(tmp_path: Path, name: str) -> None:
    t, q, qd, effort = truth()
    names = ["time", "position", "velocity", "torque"]
    files = [
        write(tmp_path / f"{name.format(k + 1)}.csv", names, t, q[:, k], qd[:, k], effort[:, k])
        for k in SIX
    ]
    with pytest.raises(RecordError, match=r"6 files.*dynid import [^ ]*1.csv .*6.csv --robot"):
        read_recording(tmp_path)
    record = read_recording(files)
    np.testing.assert_allclose(record.signals["q"], q, atol=1e-9)
    np.testing.assert_allclose(record.signals["effort"], effort, atol=1e-6)
    with pytest.raises(RecordError, match=r"3 columns but q has 6|1 joints|3 joints"):
        read_recording(files[:3], robot=load_robot("ur5"))


@pytest.mark.parametrize("header", [True, False])
@pytest.mark.parametrize(("name", "columns"), [(None, "q=1:7"), ("panda", "q=1:8")])
def test_the_example_of_columns_has_as_many_joints_as_the_robot(
    tmp_path: Path, header: bool, name: str | None, columns: str
) -> None:
    names = [f"x{k}" for k in range(22)] if header else []
    path = write(tmp_path / "log.csv", names, np.random.default_rng(0).normal(size=(50, 22)))
    robot = name and load_robot(Path(__file__).parents[2] / f"examples/robots/{name}.toml")
    with pytest.raises(RecordError, match=f"columns, for example t=0,{columns},"):
        read_recording(path, robot=robot)
