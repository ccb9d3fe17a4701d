from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_motions import UR_JOINTS, Motion, write_rtde_csv

from dynid.core import InputError, RecordError
from dynid.recording import read_record, read_recording
from dynid.robot import load_robot
from dynid.workflow import import_recording

MOTION = Motion(samples=400)


@pytest.mark.parametrize("output", ["/proc/none.parquet", "x" * 300 + ".parquet"])
def test_an_output_that_cannot_be_written_is_bad_usage(tmp_path: Path, output: str) -> None:
    path = write_rtde_csv(MOTION, tmp_path / "x.csv")
    with pytest.raises(InputError, match="cannot be written") as caught:
        import_recording([path], tmp_path / output)
    assert caught.value.exit_code == 2
    assert [file.name for file in tmp_path.iterdir()] == ["x.csv"]


def test_nothing_is_replaced_unasked(tmp_path: Path) -> None:
    path, output = write_rtde_csv(MOTION, tmp_path / "x.csv"), tmp_path / "run.parquet"
    output.write_bytes(b"the only recording of a broken arm")
    with pytest.raises(InputError, match="force=True") as caught:
        import_recording([path], output)
    assert caught.value.exit_code == 2
    assert output.read_bytes() == b"the only recording of a broken arm"
    import_recording([path], output, force=True)
    assert read_record(output).samples == MOTION.samples


def test_two_arms_say_what_to_type_for_the_first(tmp_path: Path) -> None:
    q, current = MOTION.position(MOTION.t), MOTION.current(MOTION.t)
    names = [
        f"/joint_states/{side}_{joint}/{what}"
        for side in ("left", "right")
        for what in ("position", "effort")
        for joint in UR_JOINTS
    ]
    table = np.column_stack([MOTION.t, q, current, q + 0.5, -current])
    np.savetxt(
        tmp_path / "x.csv", table, delimiter=",", header=",".join(["__time", *names]), comments=""
    )
    with pytest.raises(RecordError, match="2 sets of columns can be q") as caught:
        read_recording(tmp_path / "x.csv", robot=load_robot("ur5"))
    option = str(caught.value.next_step).partition("--columns ")[2].partition(" ")[0]
    assert option == "t=0,q=1:7,effort=7:13"
    record = read_recording(tmp_path / "x.csv", robot=load_robot("ur5"), columns=option)
    np.testing.assert_allclose(record.signals["q"], q)


@pytest.mark.parametrize("by_names", [True, False])
def test_fingers_beside_joints_of_a_shorter_name(tmp_path: Path, by_names: bool) -> None:
    """A robot file says `joint1`; the driver `panda_joint1`, and `panda_finger_joint1` as well."""
    motion = Motion(samples=400, joints=6)
    q, current = motion.position(motion.t), motion.current(motion.t)
    fingers = np.full((len(q), 2), 0.02)
    joints = [
        *(f"panda_finger_joint{k}" for k in (1, 2)),
        *(f"panda_joint{k}" for k in range(1, 7)),
    ]
    names = [f"{what}[{joint}]" for what in ("position", "effort") for joint in joints]
    table = np.column_stack([motion.t, fingers, q, fingers, current])
    header = ",".join(["t", *names])
    np.savetxt(tmp_path / "x.csv", table, delimiter=",", header=header, comments="")
    ur5 = load_robot("ur5")
    if by_names:
        robot = replace(ur5, joint_names=tuple(f"joint{k}" for k in range(1, 7)))
        record = read_recording(tmp_path / "x.csv", robot=robot)
        assert "finger" in record.metadata.extra["notes"]
    else:
        with pytest.raises(
            RecordError, match=r"8 joints but ur5 has 6.*joint_order panda"
        ) as caught:
            read_recording(tmp_path / "x.csv", robot=ur5)
        assert "panda_joint6" in str(caught.value.value)
        record = read_recording(tmp_path / "x.csv", robot=ur5, joint_order=joints[2:])
    np.testing.assert_allclose(record.signals["q"], q)
    np.testing.assert_allclose(record.signals["effort"], current)


@pytest.mark.parametrize("names", ["current_velocity_{}", "current_mode_{}", "torque_enable_{}"])
def test_words_that_only_begin_like_a_torque(tmp_path: Path, names: str) -> None:
    q = MOTION.position(MOTION.t)
    table = np.column_stack([MOTION.t, q, MOTION.velocity(MOTION.t)])
    header = ",".join(["t", *(f"q_{k}" for k in range(6)), *(names.format(k) for k in range(6))])
    np.savetxt(tmp_path / "x.csv", table, delimiter=",", header=header, comments="")
    with pytest.raises(RecordError, match="neither current nor effort"):
        read_recording(tmp_path / "x.csv")


def test_each_quantity_is_ordered_by_its_own_joint_names(tmp_path: Path) -> None:
    q, current = MOTION.position(MOTION.t), MOTION.current(MOTION.t)
    back = UR_JOINTS[::-1]
    names = [f"position[{joint}]" for joint in UR_JOINTS] + [f"effort[{joint}]" for joint in back]
    table = np.column_stack([MOTION.t, q, current[:, ::-1]])
    header = ",".join(["t", *names])
    np.savetxt(tmp_path / "x.csv", table, delimiter=",", header=header, comments="")
    for robot in (None, load_robot("ur5")):
        for columns in (None, "t=0,q=1:7,effort=7:13"):
            if robot is None and columns:
                continue
            record = read_recording(tmp_path / "x.csv", robot=robot, columns=columns)
            np.testing.assert_allclose(record.signals["q"], q)
            np.testing.assert_allclose(record.signals["effort"], current)


def test_names_of_another_robot_are_put_in_order_and_told(tmp_path: Path) -> None:
    """`joint10` comes after `joint2`, and a UR driver's names sort themselves."""
    q, current = MOTION.position(MOTION.t), MOTION.current(MOTION.t)
    for joints, order in (
        (["a10", "a5", "a6", "a7", "a8", "a9"], [1, 2, 3, 4, 5, 0]),
        (sorted(f"robot_{joint}" for joint in UR_JOINTS), [2, 1, 0, 3, 4, 5]),
    ):
        names = [f"{what}[{joint}]" for what in ("position", "effort") for joint in joints]
        table = np.column_stack([MOTION.t, q, current])
        header = ",".join(["t", *names])
        np.savetxt(tmp_path / "x.csv", table, delimiter=",", header=header, comments="")
        record = read_recording(tmp_path / "x.csv", robot=load_robot("ur5"))
        np.testing.assert_allclose(record.signals["q"], q[:, order])
        told = any("--joint-order" in problem.message for problem in record.problems)
        assert told == joints[0].startswith("a")


def test_it_says_at_once_what_identification_needs(tmp_path: Path) -> None:
    names = ["t", *(f"{what}{j}" for what in ("q", "current") for j in range(1, 7))]
    table = np.column_stack([MOTION.t, MOTION.position(MOTION.t), MOTION.current(MOTION.t)])
    path = tmp_path / "x.csv"
    np.savetxt(path, table, delimiter=",", header=",".join(names), comments="")
    for robot, option in ((None, "--robot"), ("ur10e", "--gains"), ("ur5", None)):
        needs = import_recording([path], tmp_path / f"{robot}.parquet", robot=robot).needs
        assert len(needs) == (option is not None)
        assert option is None or option in needs[0]
