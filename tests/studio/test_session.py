from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from gentle import MIDDLE, PERIOD, write_motion

from dynid.constraints import Worst
from dynid.core import InputError
from dynid.recording import ExperimentRecord, RecordMetadata, read_record, write_record
from dynid.robot import joint_poses
from dynid.studio.jobs import Job
from dynid.studio.session import JOB_SCENE, REST, Session, kind_of, open_path, recorded

BOX = {"shapes": [{"type": "box", "size": [0.2, 0.2, 0.2], "position": [1.5, 1.5, 0.5]}]}


def look(session: Session) -> dict[str, Worst]:
    return session.look(*session.motion.at(0.0))[0]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_motion(tmp_path / "motion.json")
    t = np.arange(50) / 125.0
    q = MIDDLE + 0.1 * t[:, None]
    record = ExperimentRecord(
        t=t + 3.0, signals={"q": q}, metadata=RecordMetadata(robot="ur5", origin="test")
    )
    write_record(record, tmp_path / "record.parquet")
    (tmp_path / "scene.json").write_text(json.dumps(BOX))
    (tmp_path / "broken.json").write_text('{"kind": "dynid.fourier"}')
    (tmp_path / "other.json").write_text("[1, 2]")
    (tmp_path / "log.CSV").write_text("t,q1\n0,0\n")
    return tmp_path


def test_a_directory_is_opened_with_all_that_lies_in_it(folder: Path) -> None:
    opened = open_path(str(folder))
    assert [item.name for item in opened.motions] == ["motion.json", "record.parquet"]
    assert [item.trajectory is not None for item in opened.motions] == [True, False]
    assert opened.scene == BOX
    assert [name for name, _ in opened.skipped] == ["broken.json", "log.CSV"]
    assert "drop it" in dict(opened.skipped)["log.CSV"]
    assert (opened.robot.name, opened.reference) == ("ur5", "ur5")
    assert kind_of(folder / "scene.json") == "scene"
    assert kind_of(folder / "other.json") == ""


def test_a_design_a_recording_and_a_robot_can_be_opened_alone(folder: Path) -> None:
    assert len(open_path(str(folder / "motion.json")).motions) == 1
    assert open_path(str(folder / "record.parquet")).motions[0].trajectory is None
    assert open_path("ur3e").robot.name == "ur3e"
    for name in ("nobody", str(folder / "none.json"), str(folder / "other.json")):
        with pytest.raises(InputError):
            open_path(name)
    with pytest.raises(InputError):
        open_path(str(folder / "broken.json"))


def test_motions_of_other_robots_are_left_out(folder: Path) -> None:
    record = ExperimentRecord(t=np.arange(3.0), signals={"q": np.zeros((3, 7))})
    write_record(record, folder / "seven.parquet")
    opened = open_path(str(folder), robot="ur5")
    assert "seven.parquet" in dict(opened.skipped)
    assert "7 joints" in dict(opened.skipped)["seven.parquet"]


def test_a_motion_is_chosen_and_judged_where_it_is(folder: Path) -> None:
    session = Session(open_path(str(folder)))
    motion = session.motions["motion.json"]
    worst, _ = session.look(*motion.at(0.5))
    assert worst["velocity"].margin < 1.0
    session.choose("")
    assert session.motion.name == REST
    np.testing.assert_array_equal(look(session)["velocity"].margin, 1.0)
    with pytest.raises(InputError):
        session.choose("none")
    for wrong in (np.zeros(5), np.full(6, np.nan)):
        with pytest.raises(InputError, match="no pose"):
            session.look(wrong, wrong, wrong)


def test_a_recording_plays_between_its_samples(folder: Path) -> None:
    record = read_record(folder / "record.parquet")
    played = recorded("x", record)
    assert played.duration == pytest.approx(49 / 125)
    q, dq, ddq = played.at(10.5 / 125)
    np.testing.assert_allclose(q, MIDDLE + 0.1 * 10.5 / 125, rtol=0, atol=1e-12)
    np.testing.assert_allclose(dq, 0.1, rtol=0, atol=1e-9)
    np.testing.assert_allclose(ddq, 0.0, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(played.at(99.0)[0], record.signals["q"][-1])


def test_the_certificate_follows_the_scene(folder: Path) -> None:
    session = Session(open_path(str(folder)))
    found = session.certify().certificate
    assert found is not None
    assert found.feasible
    assert not session.stale
    number = session.editor.add("box")
    session.judge()
    assert session.stale
    # In the way of the arm: its flange passes here.
    tip = joint_poses(session.robot, session.motion.at(0.0)[0])[-1][:3, 3]
    pose = np.eye(4)
    pose[:3, 3] = tip
    session.editor.place(number, pose)
    session.judge()
    assert look(session)["environment"].room < 0
    again = session.certify().certificate
    assert again is not None
    assert not again.feasible
    assert "environment" in again.broken
    session.editor.remove(number)
    session.judge()
    assert look(session)["environment"].room > 0


def test_a_scene_without_room_is_said_and_the_arm_still_shown(folder: Path) -> None:
    session = Session(open_path(str(folder)))
    number = session.editor.add("box")
    pose = np.eye(4)
    pose[:3, 3] = [0.0, 0.0, 0.1]
    session.editor.place(number, pose)
    session.judge()
    assert "no room" in session.scene_error
    assert "no room" in session.certify().error
    with pytest.raises(InputError, match="no room"):
        session.save_scene("scene.json")
    assert json.loads((folder / "scene.json").read_text()) == BOX
    assert look(session)["position"].room > 0


def test_jobs_get_the_scene_of_the_page_and_leave_the_persons_file_alone(folder: Path) -> None:
    session = Session(open_path(str(folder)))
    session.editor.add("floor")
    path = session.surroundings_for_jobs()["scene"]
    assert path == str(folder / JOB_SCENE)
    assert len(json.loads(Path(path).read_text())["shapes"]) == 2
    assert json.loads((folder / "scene.json").read_text()) == BOX
    assert Session(open_path("ur5")).surroundings_for_jobs()["scene"] is None


def test_one_job_at_a_time(folder: Path) -> None:
    session = Session(open_path(str(folder)))
    job = Job(
        kind="run",
        source=str(folder / "motion.json"),
        output=str(folder / "run.parquet"),
        options={"repeat": 1000},
    )
    try:
        session.start(job)
        with pytest.raises(InputError, match="still running"):
            session.start(job)
    finally:
        session.close()
    assert session.job is not None
    assert session.job.state.ended
    assert session.motions["motion.json"].duration == PERIOD


def test_a_save_replaces_scenes_alone(folder: Path) -> None:
    session = Session(open_path(str(folder)))
    before = (folder / "motion.json").read_bytes()
    session.editor.add("floor")
    for name in ("motion.json", "other.json"):
        with pytest.raises(InputError, match="no scene"):
            session.save_scene(name)
    assert (folder / "motion.json").read_bytes() == before
    assert len(json.loads(session.save_scene("scene.json").read_text())["shapes"]) == 2


def test_the_scene_of_a_folder_is_the_persons_own(folder: Path) -> None:
    (folder / JOB_SCENE).write_text('{"shapes": []}')
    (folder / "a_bad.json").write_text('{"shapes": [{"type": "box"}]}')
    (folder / "z.json").write_text('{"shapes": []}')
    opened = open_path(str(folder))
    assert (opened.scene, Path(opened.scene_file).name) == (BOX, "scene.json")
    skipped = dict(opened.skipped)
    assert "size" in skipped["a_bad.json"]
    assert "scene.json" in skipped["z.json"]
    assert {"scene.json", JOB_SCENE}.isdisjoint(skipped)
    (folder / "scene.json").unlink()
    (folder / "z.json").unlink()
    assert open_path(str(folder)).scene is None


def test_data_of_another_built_in_robot_are_left_out(folder: Path) -> None:
    q = np.zeros((50, 6))
    own = RecordMetadata(robot="ur10e", origin="test")
    write_record(
        ExperimentRecord(t=np.arange(50) / 125, signals={"q": q}, metadata=own),
        folder / "ten.parquet",
    )
    assert dict(open_path(str(folder)).skipped)["ten.parquet"] == "of ur10e, not ur5"
    session = Session(open_path(str(folder)))
    with pytest.raises(InputError, match="another robot"):
        session.open(folder / "ten.parquet")


def test_a_verdict_is_that_of_the_scene_and_motion_as_they_are(folder: Path) -> None:
    write_motion(folder / "second.json")
    session = Session(open_path(str(folder)))
    assert session.unjudged
    session.certify()
    assert not session.unjudged
    session.editor.add("floor")
    assert session.unjudged
    session.judge()
    session.certify()
    session.choose("second.json")
    assert session.unjudged
    session.choose("")
    assert not session.unjudged
