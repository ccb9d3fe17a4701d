"""What visitors ask for, without a browser: actions are done, and the loop's step is called."""

from __future__ import annotations

import gzip
import io
import json
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from gentle import CYCLES, write_motion

from dynid import read_estimate
from dynid.core import DynidError, InputError, JsonFields
from dynid.recording import ExperimentRecord, read_record
from dynid.robot import joint_poses
from dynid.studio.jobs import Job, JobState
from dynid.studio.page import Page
from dynid.studio.session import free_name, open_path, recorded
from dynid.trajectory import FourierSeries
from dynid.workflow import read_design

PATIENCE = 90.0
DESIGN = {"criterion": "prediction", "period_s": 10.0, "harmonics": 3, "budget_s": 1.0, "seed": 0}
URDF = """<robot name="two"><link name="base"/><link name="arm"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><geometry><box size="1 1 1"/></geometry></visual></link>
<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""


@pytest.fixture
def page(tmp_path: Path) -> Iterator[Page]:
    write_motion(tmp_path / "motion.json", size=0.1)
    made = Page(open_path(str(tmp_path)))
    yield made
    made.close()


def do(page: Page, action: str, **fields: object) -> dict[str, object]:
    return page.do(action, JsonFields(fields))


def until(page: Page, reached: Callable[[], bool]) -> None:
    deadline, pause = time.monotonic() + PATIENCE, threading.Event()
    while not reached():
        assert time.monotonic() < deadline, page.state()["job"]
        page.step(time.monotonic())
        pause.wait(0.02)


def ended(page: Page) -> bool:
    job = page.state()["job"]
    return job is not None and job["ended"]


def drop(page: Page, name: str, content: bytes) -> str:
    return str(page.take_file(name, io.BytesIO(content), len(content))["words"])


def test_what_the_flange_carries_is_drawn_as_it_is_judged(tmp_path: Path) -> None:
    write_motion(tmp_path / "motion.json", size=0.1)
    box = {"type": "box", "name": "gripper", "size": [0.1, 0.1, 0.2], "position": [0, 0, 0.15]}
    (tmp_path / "cell.json").write_text(json.dumps({"shapes": [], "payload": [box]}))
    page = Page(open_path(str(tmp_path)))
    told = page.look_up("robot", lambda name: "")
    page.close()
    for kind in ("meshes", "bodies"):
        assert [x["link"] for x in told[kind] if x["name"] == "gripper"] == [6]


def test_run_then_identify_then_export_and_report(page: Page) -> None:
    folder = page.session.folder
    do(page, "run", target="sim", repeat=3, slow=False, file="record.parquet")
    until(page, lambda: ended(page))
    state = page.state()
    assert state["job"]["words"] == f"{3 * CYCLES} samples, 0 gaps"
    assert (state["motion"], state["files"]["run"]) == ("record.parquet", "record_2.parquet")
    fields = {"record": "record.parquet", "validate": "", "preset": "paper"}
    do(page, "identify", file="estimate.json", **fields)
    until(page, lambda: ended(page) and bool(page.state()["results"]))
    state = page.state()
    (shown,) = state["results"]
    assert shown["name"] == "estimate.json"
    assert "this result" in shown["headline"].lower()
    told = read_estimate(folder / "estimate.json").warnings
    assert {finding.message[:200] for finding in told} <= {text[:200] for text in shown["warnings"]}
    assert [item["name"] for item in shown["joints"]] == page.look_up("robot", str)["joints"]
    assert (
        json.dumps(page.look_up("curves", {"name": "record.parquet", "opened": ""}.get)).count(
            "predicted"
        )
        == 1
    )
    (folder / "report.html").write_text("mine")
    assert "report_2.html" in str(do(page, "report"))
    assert (folder / "report.html").read_text() == "mine"
    assert (folder / "report_2.html").stat().st_size > 50_000
    with pytest.raises(InputError, match="nothing is replaced"):
        do(page, "identify", file="estimate.json", **fields)
    assert "written: estimate.py" in str(do(page, "export", estimate="estimate.json", to="python"))
    assert (folder / "estimate.py").exists()


def test_a_design_is_run_again_while_its_recording_is_shown(page: Page) -> None:
    for name in ("record.parquet", "again.parquet"):
        assert page.state()["design"] == "motion.json"
        do(page, "run", target="sim", repeat=900, slow=False, file=name)
        assert page.state()["motion"] == "motion.json"
        until(page, lambda: page.state()["tail"] is not None)
        do(page, "stop")
        until(page, lambda: ended(page))
        assert page.state()["motion"] == name
    # Where nothing runs a STOP is no error.
    assert do(page, "stop") == {}


def test_a_design_from_the_page_is_played_and_certified(page: Page) -> None:
    session = page.session
    do(page, "add", kind="floor")
    do(page, "design", file="design.json", **{**DESIGN, "harmonics": None})
    until(page, lambda: ended(page))
    state = page.state()
    assert state["job"]["level"] in ("good", "warn"), state["job"]
    assert state["job"]["words"].startswith("Expected torque error ")
    assert (state["motion"], state["files"]["design"]) == ("design.json", "design_2.json")
    verdict = session.verdict.certificate
    assert verdict is not None
    motion = read_design(session.folder / "design.json").stored.trajectory
    # As many as the command line takes: up to 1 Hz.
    assert isinstance(motion, FourierSeries)
    assert motion.a.shape[1] == 10
    stored = json.loads((session.folder / "design.json").read_text())["design"]
    assert verdict.feasible == stored["feasible"]
    assert verdict.worst["environment"].margin == pytest.approx(
        stored["margins"]["environment_m"], abs=1e-3
    )
    assert stored["limits"]["scene"]["shapes"][0]["type"] == "floor"


def test_what_is_there_is_overwritten_only_when_its_name_is_typed(tmp_path: Path) -> None:
    assert free_name(tmp_path, "design.json") == "design.json"
    for taken in ("design.json", "design_2.json"):
        (tmp_path / taken).write_text("mine")
    assert free_name(tmp_path, "design.json") == "design_3.json"
    (tmp_path / "record_truth.json").touch()
    assert free_name(tmp_path, "record.parquet") == "record_2.parquet"


def test_what_cannot_be_started_says_why(page: Page) -> None:
    for action, fields in (
        ("run", {"target": "sim", "repeat": 1}),
        ("design", DESIGN),
        ("identify", {"record": "motion.json", "validate": "", "preset": "best"}),
    ):
        with pytest.raises(InputError):
            do(page, action, file="../out", **fields)
    do(page, "choose", name="")
    with pytest.raises(InputError, match="choose a design"):
        do(page, "run", target="sim", repeat=1, file="record.parquet")
    with pytest.raises(InputError, match="cannot be done"):
        do(page, "unlink")
    assert page.session.job is None


def test_a_moved_shape_is_where_it_was_let_go_and_is_judged(page: Page) -> None:
    number = do(page, "add", kind="box")["number"]
    before = page.session.constraints
    do(page, "place", number=number, position=[0.5, 0.25, 0.75], rpy_deg=[0, 0, 90])
    item = page.session.editor.items[1]
    assert item["position"] == [0.5, 0.25, 0.75]
    assert item["rpy"][2] == pytest.approx(np.pi / 2, abs=1e-4)
    assert page.session.constraints is not before
    do(page, "resize", number=number, name="size x", value=0.3)
    (shape,) = page.look_up("scene", str)["shapes"]
    assert (shape["sizes"]["size x"], shape["rpy_deg"]) == (0.3, [0.0, 0.0, 90.0])
    assert "saved" in str(do(page, "save", file="scene.json"))
    do(page, "remove", number=number)
    assert page.look_up("scene", str)["shapes"] == []


def test_a_place_that_is_none_is_told_in_plain_numbers(page: Page) -> None:
    number = do(page, "add", kind="box")["number"]
    with pytest.raises(InputError, match=r"no pose; got \[1\.0, 2\.0, 0\.0"):
        do(page, "place", number=number, position=[1.0, 2.0])


def test_news_come_when_something_changes(page: Page) -> None:
    page.step(0.0)
    told, seen = page.news(-1, 0.0)
    assert json.loads(told)["motion"] == "motion.json"
    assert page.news(seen, 0.0) == ("", seen)
    do(page, "add", kind="box")
    told, later = page.news(seen, 5.0)
    assert later > seen
    assert json.loads(told)["scene"]["changes"] == 1


def test_a_dropped_log_is_read_by_a_job_and_played(page: Page) -> None:
    t = np.arange(200) / 125.0
    rows = ["t," + ",".join(f"q{k}" for k in range(6)) + "," + ",".join(f"i{k}" for k in range(6))]
    rows += [
        f"{at:.4f}," + ",".join(f"{0.1 * np.sin(3 * at + k):.6f}" for k in range(12)) for at in t
    ]
    # Half a second at rest, which is told in words.
    rows[1:1] = [f"{(k - 63) / 125:.4f}," + rows[1].partition(",")[2] for k in range(63)]
    drop(page, "log.csv.gz", gzip.compress("\n".join(rows).encode()))
    until(page, lambda: ended(page))
    state = page.state()
    assert "263 samples at 125 Hz" in state["job"]["words"]
    assert "{" not in state["job"]["words"]
    assert state["job"]["level"] != "bad", state["job"]
    assert state["motion"] == "log.parquet"
    assert read_record(page.session.folder / "log.parquet").samples == 263


def test_a_dropped_urdf_design_and_scene_are_opened(page: Page, tmp_path: Path) -> None:
    scene = {"shapes": [{"type": "sphere", "radius": 0.1, "position": [2, 2, 0.5]}]}
    drop(page, "around.json", json.dumps(scene).encode())
    assert page.state()["scene"]["changes"] == 1
    assert [shape["kind"] for shape in page.look_up("scene", str)["shapes"]] == ["sphere"]
    drop(page, "other.json", write_motion(tmp_path / "x.json").read_bytes())
    assert page.state()["motion"] == "other.json"
    opened = page.state()["opened"]
    drop(page, "two.urdf", URDF.encode())
    state = page.state()
    assert (state["robot"], state["opened"] != opened) == ("two", True)
    assert len(page.look_up("robot", str)["meshes"]) == 1
    with pytest.raises(DynidError):
        drop(page, "bad.urdf", b"<robot")
    assert not (tmp_path / "bad.urdf").exists()
    with pytest.raises(InputError, match="whole"):
        page.take_file("short.csv", io.BytesIO(b"1"), 9)
    assert not list(tmp_path.glob("*.partial"))
    with pytest.raises(DynidError):
        drop(page, "estimate.json", b'{"format": "dynid-estimate"}')
    assert not (tmp_path / "estimate.json").exists()
    assert page.state()["estimates"] == []


def test_a_motion_is_judged_anew_once_the_scene_is_left_alone(page: Page) -> None:
    until(page, lambda: page.state()["verdict"] is not None)
    assert page.state()["verdict"]["level"] == "good"
    number = do(page, "add", kind="box")["number"]
    wrist = joint_poses(page.session.robot, page.session.motion.at(0.0)[0])[4, :3, 3]
    do(page, "place", number=number, position=wrist.tolist())
    until(page, lambda: page.state()["verdict"]["level"] == "bad")
    do(page, "remove", number=number)
    until(page, lambda: page.state()["verdict"]["level"] == "good")


class AskingJob:
    """A run that waits for its word."""

    pid = 0

    def __init__(self, page: Page) -> None:
        output = str(page.session.folder / "run.parquet")
        self.job = Job(kind="run", source="motion.json", output=output, options={})
        self.state = JobState(ask="Move?", word="host")
        self.heard: list[str] = []

    def answer(self, word: str) -> None:
        self.heard.append(word)

    def stop(self) -> None:
        self.heard.append("STOP")

    def close(self) -> None:
        """Nothing runs."""


def test_no_robot_moves_in_a_scene_that_was_changed_after_the_question(
    page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = AskingJob(page)
    monkeypatch.setattr("dynid.studio.session.Supervisor", lambda _: job)
    asked = {"target": "sim", "repeat": 1, "slow": False, "file": "run.parquet"}
    do(page, "run", **asked)
    do(page, "answer", id=job.pid, word="host")
    do(page, "add", kind="box")
    with pytest.raises(InputError, match="scene has changed"):
        do(page, "answer", id=job.pid, word="host")
    assert job.heard == ["host", "STOP"]


def test_a_word_for_another_question_moves_nothing(
    page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = AskingJob(page)
    monkeypatch.setattr("dynid.studio.session.Supervisor", lambda _: job)
    do(page, "run", target="sim", repeat=1, slow=False, file="run.parquet")
    with pytest.raises(InputError, match="nothing moves"):
        do(page, "answer", id=job.pid + 1, word="host")
    # It has not asked yet, or somebody else has answered.
    job.state = JobState()
    with pytest.raises(InputError, match="nothing moves"):
        do(page, "answer", id=job.pid, word="host")
    assert job.heard == []


class Meanwhile(io.BytesIO):
    """A file that arrives slowly: something else happens before its first bytes are there."""

    def __init__(self, content: bytes, happens: Callable[[], object]) -> None:
        super().__init__(content)
        self._happens: list[Callable[[], object]] = [happens]

    def read(self, size: int | None = -1) -> bytes:
        if self._happens:
            self._happens.pop()()
        return super().read(size)


def test_stop_reaches_a_run_that_began_while_another_robot_was_dropped(
    page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = AskingJob(page)
    monkeypatch.setattr("dynid.studio.session.Supervisor", lambda _: job)
    asked = {"target": "sim", "repeat": 1, "slow": False, "file": "run.parquet"}
    arriving = Meanwhile(URDF.encode(), lambda: do(page, "run", **asked))
    with pytest.raises(InputError, match="another job"):
        page.take_file("two.urdf", arriving, len(URDF))
    do(page, "stop")
    assert job.heard == ["STOP"]


def test_two_files_of_one_name_that_are_dropped_at_once_are_both_kept(
    page: Page, tmp_path: Path
) -> None:
    first = json.dumps({"shapes": [{"type": "sphere", "radius": 0.1, "position": [1, 0, 0]}]})
    second = json.dumps({"shapes": []})
    both: list[threading.Thread] = []

    def drop_other() -> None:
        both.append(threading.Thread(target=drop, args=(page, "cell.json", second.encode())))
        both[0].start()
        both[0].join()

    page.take_file("cell.json", Meanwhile(first.encode(), drop_other), len(first))
    kept = [(tmp_path / name).read_text() for name in ("cell.json", "cell_2.json")]
    assert kept == [second, first]


def test_a_disc_that_fails_ends_a_job_and_not_the_page(
    page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = AskingJob(page)
    monkeypatch.setattr("dynid.studio.session.Supervisor", lambda _: job)
    do(page, "run", target="sim", repeat=1, slow=False, file="run.parquet")
    job.state = JobState(ended=True, result={"words": "", "level": "good", "record": "gone"})
    monkeypatch.setattr(page.session, "open", lambda path: path.read_bytes())
    page.step(time.monotonic())
    assert ended(page)
    assert page.state()["job"]["level"] == "bad"
    assert "No such file" in page.state()["job"]["words"]


def test_a_page_that_has_not_heard_of_another_robot_is_told_nothing_about_it(page: Page) -> None:
    opened = page.state()["opened"]
    assert opened < 2**53
    asked = {"q": [0.1] * page.session.robot.joints, "opened": opened}
    assert page.do("judge", JsonFields(asked))["margins"]
    assert page.do("judge", JsonFields({"q": [0.1, 0.2], "opened": opened - 1})) == {}
    of = {"name": page.session.motion.name, "opened": str(opened)}
    assert page.look_up("curves", of.__getitem__)["groups"]
    assert page.look_up("curves", {"name": "gone", "opened": "1"}.__getitem__) == {}


def test_who_asks_while_another_robot_is_opened_asks_for_the_one_before(
    page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its meshes take seconds; a pose of six joints was then one too many for it."""
    opened, answers = page.state()["opened"], []

    def slow(*given: object) -> list[object]:
        answers.append(do(page, "judge", opened=opened, q=[0.0] * 6))
        return []

    monkeypatch.setattr("dynid.studio.solids.robot_meshes", slow)
    drop(page, "two.urdf", URDF.encode())
    assert answers[0]["margins"]
    assert do(page, "judge", opened=opened, q=[0.0] * 6) == {}


def test_a_prediction_takes_the_place_of_the_measured_torque_alone(
    page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Its torque follows from currents by gains that only the estimate has: none is shown before.
    signals = {"q": np.zeros((50, 6)), "temperature": np.full((50, 6), 30.0)}
    record = ExperimentRecord(t=np.arange(50) / 125.0, signals=signals)
    page.session.motions["record"] = recorded("record", record)
    found = [{"record": "record", "prediction": {"title": "Torque"}}]
    monkeypatch.setattr("dynid.studio.facts.judged_estimates", lambda *_: found)
    do(page, "results")
    shown = page.look_up("curves", {"name": "record", "opened": ""}.__getitem__)["groups"]
    assert [group["title"] for group in shown] == ["Torque", "Position", "Temperature"]
