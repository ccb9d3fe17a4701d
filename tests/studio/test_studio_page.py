"""The page's tabs without a browser: buttons are pressed, and the loop's step is called."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from gentle import CYCLES, write_motion

from dynid.studio.live import Tail
from dynid.studio.opening import open_path
from dynid.studio.page import Page
from dynid.studio.server import make_door, open_server
from dynid.studio.session import Session, free_name
from dynid.studio.solids import arm_meshes

PATIENCE = 90.0


@pytest.fixture
def page(tmp_path: Path) -> Iterator[Page]:
    write_motion(tmp_path / "motion.json", size=0.1)
    server = open_server(make_door("127.0.0.1", None), 0)
    session = Session(open_path(str(tmp_path)))
    yield Page(server, session, arm_meshes(session.robot), ["a note"])
    session.close()
    server.stop()


def until(page: Page, reached: Callable[[], bool]) -> None:
    deadline, pause = time.monotonic() + PATIENCE, threading.Event()
    while not reached():
        assert time.monotonic() < deadline
        page.step(time.monotonic())
        pause.wait(0.02)


def ended(page: Page) -> bool:
    return page.session.job is not None and page.session.job.state.ended


def test_run_then_identify_then_see_the_verdict(page: Page) -> None:
    session, folder = page.session, page.session.folder
    page.run_panel.view.start.value = True
    assert page.run_panel.view.start.disabled
    until(page, lambda: "record.parquet" in session.motions)
    assert page.run_panel.view.stop.disabled
    assert f"{3 * CYCLES} samples, 0 gaps" in page.run_panel.view._words.content
    assert session.motion.name == page.motion.motion.value == "record.parquet"
    assert page.run_panel.name.value == "record_2.parquet"
    assert page.motion.time.max == pytest.approx(3 * CYCLES / 125, abs=0.02)
    assert page.results.record.value == "record.parquet"
    page.results.preset.value = "paper"
    page.results.view.start.value = True
    until(page, lambda: (folder / "estimate.json").exists() and bool(page.results._figures))
    assert "This result" in page.results._verdict.content or (
        "Use this result" in page.results._verdict.content
    )
    assert len(page.results._figures) == 2
    page.results.report.value = True
    assert (folder / "report.html").stat().st_size > 100_000


def test_a_design_from_the_page_is_played_and_certified(page: Page) -> None:
    session = page.session
    page.scene.kind.value = "floor"
    page.scene.add.value = True
    page.design.budget.value = 2.0
    page.design.harmonics.value = 3
    page.design.view.start.value = True
    until(page, lambda: ended(page))
    assert session.job is not None
    assert session.job.state.error is None, session.job.state
    until(page, lambda: "design.json" in session.motions)
    assert session.motion.name == "design.json"
    assert page.design.name.value == "design_2.json"
    verdict = session.verdict.certificate
    assert verdict is not None
    stored = json.loads((session.folder / "design.json").read_text())["design"]
    assert verdict.feasible == stored["feasible"]
    assert verdict.worst["environment"].margin == pytest.approx(
        stored["margins"]["environment_m"], abs=1e-3
    )
    assert stored["limits"]["scene"]["shapes"][0]["type"] == "floor"
    assert "condition number" in page.design.view._words.content


def test_what_is_there_is_overwritten_only_when_its_name_is_typed(tmp_path: Path) -> None:
    assert free_name(tmp_path, "design.json") == "design.json"
    for taken in ("design.json", "design_2.json"):
        (tmp_path / taken).write_text("mine")
    assert free_name(tmp_path, "design.json") == "design_3.json"


def test_signals_are_offered_with_their_units(page: Page) -> None:
    assert page.run_panel.signal.options[:3] == ("current [A]", "q [rad]", "qd [rad/s]")
    t = np.linspace(0.0, 1.0, 5)
    page.run_panel.signal.value = "q [rad]"
    page.run_panel.draw(Tail(t=t, signals={"q": np.outer(t, np.arange(1.0, 7.0))}, samples=5))
    assert page.run_panel._plot.data[6][-1] == 6.0


def test_what_cannot_be_started_says_why(page: Page) -> None:
    for panel in (page.run_panel, page.design, page.results):
        panel.name.value = "../out"
        panel.view.start.value = True
        assert "file name" in panel.view._words.content
    page.run_panel.name.value = "record.parquet"
    page.session.hold(np.zeros(6))
    page.run_panel.view.start.value = True
    assert "choose a design" in page.run_panel.view._words.content
    assert page.session.job is None


def test_a_dragged_shape_is_where_it_was_let_go(page: Page) -> None:
    page.scene.add.value = True
    page.step(0.0)
    pose = np.eye(4)
    pose[:3, 3] = [0.5, 0.25, 0.75]
    page.scene._moved(1, pose, True)
    assert page.scene.position.value == (0.5, 0.25, 0.75)
    assert page.session.editor.items[1]["position"] == [0.5, 0.25, 0.75]
    before = page.session.constraints
    page.step(1.0)
    assert page.session.constraints is not before
    np.testing.assert_allclose(page.stage._shapes[1].position, [0.5, 0.25, 0.75])


def test_the_arm_is_drawn_where_its_links_are(page: Page) -> None:
    page.session.hold(np.full(6, 0.3))
    page.step(0.0)
    poses = page.session.look(page.session.now()).poses
    drawn = page.stage.link_positions
    np.testing.assert_allclose(drawn[1:], poses[:, :3, 3], rtol=0, atol=1e-9)
    np.testing.assert_array_equal(drawn[0], 0.0)
