from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io
from recorded_motions import UR_JOINTS, Motion, write_rtde_csv

from dynid.core.errors import InputError, RecordError
from dynid.recording.files import read_recording
from dynid.robot.load import load_robot
from dynid.workflow.importing import import_recording

MOTION = Motion(samples=400)


@pytest.mark.parametrize("output", ["/proc/none.parquet", "x" * 300 + ".parquet"])
def test_an_output_that_cannot_be_written_is_bad_usage(tmp_path: Path, output: str) -> None:
    path = write_rtde_csv(MOTION, tmp_path / "x.csv")
    with pytest.raises(InputError, match="cannot be written") as caught:
        import_recording([path], tmp_path / output)
    assert caught.value.exit_code == 2
    assert [file.name for file in tmp_path.iterdir()] == ["x.csv"]


def test_a_matrix_without_names_says_what_to_type(tmp_path: Path) -> None:
    table = np.column_stack(
        [MOTION.t, MOTION.position(MOTION.t), MOTION.velocity(MOTION.t), MOTION.current(MOTION.t)]
    )
    np.save(tmp_path / "x.npy", table)
    scipy.io.savemat(tmp_path / "x.mat", {"ans": table.T})
    for path in (tmp_path / "x.npy", tmp_path / "x.mat"):
        with pytest.raises(RecordError) as caught:
            read_recording(path)
        option = str(caught.value.next_step).partition("--columns ")[2].partition(" ")[0]
        assert option == "t=0,q=1:7,qd=7:13,current=13:19"
        record = read_recording(path, columns=option)
        np.testing.assert_array_equal(record.signals["current"], MOTION.current(MOTION.t))


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
