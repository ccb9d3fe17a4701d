"""The studio in headless Chromium, as a visitor has it."""

from __future__ import annotations

import os
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gentle import CYCLES, write_motion

from dynid.recording import read_record
from dynid.robot import joint_poses
from dynid.studio.opening import open_path
from dynid.studio.page import Page
from dynid.studio.server import make_door, open_server
from dynid.studio.session import Session
from dynid.studio.solids import arm_meshes
from urtwin import controller_process, own_address

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium (make test installs it)")

PATIENCE_MS = 60_000
DRAWN = 1e-5
"""Positions travel as they are; the slider counts hundredths of a second."""
SLIDER = 0.0051
SOFTWARE = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
HOSTILE = "<img src=x onerror=alert(1)>" + "x" * 80 + ".json"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("studio")
    write_motion(made / "motion.json", period=4.0)
    write_motion(made / HOSTILE)
    # A name that is no text at all.
    os.rename(write_motion(made / "x.json"), os.fsencode(made) + b"/bad\xff.json")
    (made / "<b>broken<b>.json").write_text('{"kind": "dynid.<script>alert(2)<script>"}')
    return made


@pytest.fixture(scope="module")
def studio(folder: Path) -> Iterator[tuple[Page, str]]:
    door = make_door("127.0.0.1", None)
    opened = open_path(str(folder))
    server = open_server(door, 0)
    session = Session(opened)
    notes = [f"{name}: {why}" for name, why in opened.skipped]
    page = Page(server, session, arm_meshes(opened.robot), notes)
    session.choose("motion.json")
    page.motion.refresh()
    stop = threading.Event()
    loop = threading.Thread(target=page.run, args=(stop,))
    loop.start()
    yield page, door.url(server.get_port())
    stop.set()
    loop.join()
    session.close()
    server.stop()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        running = playwright.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", *SOFTWARE]
        )
        yield running
        running.close()


class Visit:
    """A visitor's page, and what its console complained of."""

    def __init__(self, browser: Any, url: str, width: int) -> None:
        # Fewer pixels than points: what counts is the layout, and software draws every pixel.
        self.page = browser.new_page(
            viewport={"width": width, "height": 600}, device_scale_factor=0.5
        )
        self.page.set_default_timeout(PATIENCE_MS)
        self.errors: list[str] = []
        self.elsewhere: list[str] = []
        self.page.on("console", self._said)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("dialog", lambda dialog: self.errors.append(dialog.message))
        self.page.on("request", lambda request: self._asked(request.url, url))
        self.page.goto(url)
        self.page.get_by_role("tab", name="Motion").wait_for()

    def _said(self, message: Any) -> None:
        if message.type == "error":
            self.errors.append(message.text)

    def _asked(self, asked: str, url: str) -> None:
        if not asked.startswith((url, f"blob:{url}", "data:")):
            self.elsewhere.append(asked)

    def click(self, name: str) -> None:
        self.page.get_by_role("button", name=name, exact=True).click()

    def field(self, name: str) -> Any:
        """The input beside a label that is to be seen."""
        label = self.page.locator(f"label:visible:text-is('{name}')")
        return label.locator("xpath=following::input[1]")

    def tab(self, name: str) -> None:
        self.page.get_by_role("tab", name=name).click()


def until(reached: Callable[[], bool], visit: Visit) -> None:
    deadline = time.monotonic() + PATIENCE_MS / 1000
    while not reached():
        assert time.monotonic() < deadline
        # Playwright handles the page's events only while it is called.
        visit.page.wait_for_timeout(20)


@pytest.mark.parametrize("width", [1400, 390])
def test_a_visitor_plays_pauses_and_scrubs(
    browser: Any, studio: tuple[Page, str], width: int
) -> None:
    page, url = studio
    session = page.session
    visit = Visit(browser, url, width)
    assert visit.page.title() == "dynid studio"
    visit.page.get_by_text("Every limit holds over the whole motion").wait_for()
    start = page.stage.link_positions
    visit.click("Play")
    until(lambda: np.abs(page.stage.link_positions - start).max() > 1e-3, visit)
    visit.click("Pause")
    until(lambda: not session.player.playing, visit)
    # The page has the last place that the server knew: from here on the hand moves the slider.
    pause = visit.page.get_by_role("button", name="Pause", exact=True)
    until(pause.is_disabled, visit)
    slider = visit.page.get_by_role("slider").first
    slider.focus()
    slider.press("Home")
    until(lambda: session.player.place(0.0) == 0.0, visit)
    slider.press("ArrowRight")
    until(lambda: abs(session.player.place(0.0) - 0.01) < SLIDER, visit)
    slider.press("End")
    until(lambda: abs(session.player.place(0.0) - 4.0) < SLIDER, visit)
    expected = joint_poses(session.robot, session.now().q)[:, :3, 3]
    until(lambda: np.abs(page.stage.link_positions[1:] - expected).max() < DRAWN, visit)
    for name in ("Scene", "Design", "Run", "Results", "Motion"):
        visit.tab(name)
        visit.page.get_by_role("tab", name=name, selected=True).wait_for()
    assert visit.page.evaluate("document.documentElement.scrollWidth") <= width
    assert (visit.errors, visit.elsewhere) == ([], [])
    visit.page.close()


def test_hostile_names_are_shown_as_text(browser: Any, studio: tuple[Page, str]) -> None:
    page, url = studio
    page.session.choose(HOSTILE)
    page.motion.refresh()
    visit = Visit(browser, url, 1400)
    visit.page.get_by_text("<b>broken<b>.json").first.wait_for()
    assert "bad?.json" in page.motion.motion.options
    assert visit.page.locator("img[src=x]").count() == 0
    page.session.choose("motion.json")
    page.motion.refresh()
    assert (visit.errors, visit.elsewhere) == ([], [])
    visit.page.close()


def test_a_visitor_edits_the_scene(browser: Any, studio: tuple[Page, str], folder: Path) -> None:
    page, url = studio
    session = page.session
    visit = Visit(browser, url, 1400)
    before = session.look(session.now()).worst["environment"].margin
    visit.tab("Scene")
    visit.click("Add")
    until(lambda: len(session.editor.items) == 1, visit)
    until(lambda: session.look(session.now()).worst["environment"].margin != before, visit)
    visit.page.get_by_text("1 shape in the scene").wait_for()
    visit.click("Save the scene")
    visit.page.get_by_text("saved: scene.json").wait_for()
    assert (folder / "scene.json").exists()
    visit.click("Remove")
    until(lambda: not session.editor.items, visit)
    assert (visit.errors, visit.elsewhere) == ([], [])
    visit.page.close()


# The watchdog of the run looks at a clock: two busy workers beside it can starve it.
@pytest.mark.realtime
def test_a_run_beside_an_open_page_loses_no_sample_and_can_be_stopped(
    browser: Any, studio: tuple[Page, str], folder: Path
) -> None:
    page, url = studio
    session = page.session
    visit = Visit(browser, url, 1400)
    with controller_process("ur5", host=own_address(), virtual_time=True) as controller:
        visit.tab("Run")
        visit.field("Robot").fill(f"ur://{controller.host}")
        visit.click("Run")
        visit.page.get_by_text(f"Type {controller.host} to move the robot").wait_for()
        visit.field("Type the word").fill(controller.host)
        visit.click("Move the robot")
        until(lambda: session.job is not None and session.job.state.ended, visit)
    job = session.job
    assert job is not None
    assert job.state.error is None
    assert job.state.result is not None
    assert job.state.result["cause"] is None
    visit.page.get_by_text("samples, 0 gaps").wait_for()
    record = read_record(folder / "record.parquet")
    assert record.samples == 3 * 2 * CYCLES
    assert np.abs(np.diff(record.t) - 0.008).max() < 1e-6
    assert "record.parquet" in session.motions
    visit.field("Robot").fill("sim")
    session.choose("motion.json")
    page.run_panel.repeat.value = 900
    visit.field("File").fill("stopped.parquet")
    until(lambda: page.run_panel.name.value == "stopped.parquet", visit)
    visit.click("Run")
    until(lambda: session.following, visit)
    visit.click("STOP the robot")
    until(lambda: session.job is not job and session.job.state.ended, visit)
    visit.page.get_by_text("stopped: it was interrupted").wait_for()
    assert read_record(folder / "stopped.parquet").metadata.extra["abort"] == "interrupted"
    assert (visit.errors, visit.elsewhere) == ([], [])
    visit.page.close()
