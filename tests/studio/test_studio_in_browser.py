"""The studio in headless Chromium, as a visitor has it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gentle import CYCLES, write_motion

from dynid.core import JsonFields
from dynid.recording import read_record
from dynid.robot import joint_poses
from dynid.studio.facts import encoded
from dynid.studio.page import Page
from dynid.studio.server import Server, access_policy
from dynid.studio.session import open_path
from urtwin import controller_process, own_address

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
# Pages are drawn in software: beside other tests a click waits for seconds.
pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium (make test installs it)"),
    pytest.mark.realtime,
]

PATIENCE_MS = 40_000
DRAWN = 3e-4
"""The page plays straight lines between 60 poses a second of a design [m]."""
STOP = "rgb(200, 32, 26)"
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
    policy = access_policy("127.0.0.1", None)
    page = Page(open_path(str(folder)))
    page.session.choose("motion.json")
    server = Server(policy, 0, page)
    server.start()
    stop = threading.Event()
    loop = threading.Thread(target=page.run, args=(stop,))
    loop.start()
    yield page, policy.url(server.port)
    stop.set()
    loop.join()
    page.close()
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

    def __init__(self, browser: Any, url: str, width: int = 1400) -> None:
        # Fewer pixels than points: what counts is the layout, and software draws every pixel.
        self.page = browser.new_page(
            viewport={"width": width, "height": 844}, device_scale_factor=0.5
        )
        self.page.set_default_timeout(PATIENCE_MS)
        self.errors: list[str] = []
        self.elsewhere: list[str] = []
        self.page.on("console", self._said)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("dialog", lambda dialog: self.errors.append(dialog.message))
        self.page.on("request", lambda request: self._asked(request.url, url))
        self.page.goto(url)
        self.page.locator("#play").wait_for()

    def check(self) -> None:
        assert (self.errors, self.elsewhere) == ([], [])

    def _said(self, message: Any) -> None:
        if message.type == "error":
            self.errors.append(message.text)

    def _asked(self, asked: str, url: str) -> None:
        if not asked.startswith((url.split("?")[0], "data:")):
            self.elsewhere.append(asked)

    def step(self, name: str) -> None:
        self.page.locator("#steps").get_by_role("button", name=name).click()

    def primary(self, name: str) -> None:
        self.page.locator("#primary", has_text=name).click()

    def app(self, expression: str) -> Any:
        return self.page.evaluate(f"import('/studio.js').then(({{ app }}) => {expression})")


Visited = Callable[[int], Visit]


@pytest.fixture(scope="module")
def visited(browser: Any, studio: tuple[Page, str]) -> Iterator[Visited]:
    """The page at a width, opened once: to draw it for the first time takes seconds."""
    visits: dict[int, Visit] = {}

    def visit(width: int) -> Visit:
        if width not in visits:
            visits[width] = Visit(browser, studio[1], width)
        visits[width].page.bring_to_front()
        return visits[width]

    yield visit
    for opened in visits.values():
        opened.page.close()


def until(reached: Callable[[], bool], visit: Visit) -> None:
    deadline = time.monotonic() + PATIENCE_MS / 1000
    while not reached():
        assert time.monotonic() < deadline
        # Playwright handles the page's events only while it is called.
        visit.page.wait_for_timeout(20)


@pytest.mark.parametrize("width", [1400, 390])
def test_a_visitor_plays_pauses_and_scrubs(
    visited: Visited, studio: tuple[Page, str], width: int
) -> None:
    page, _ = studio
    motion = page.session.motions["motion.json"]
    visit = visited(width)
    assert visit.page.title() == "dynid studio"
    visit.page.get_by_text("Every limit holds over the whole motion").wait_for()
    visit.page.get_by_role("button", name="Play", exact=True).click()
    until(lambda: visit.app("app.at") > 0.05, visit)
    visit.page.get_by_role("button", name="Pause", exact=True).click()
    assert visit.app("app.playing") is False
    slider = visit.page.get_by_role("slider", name="Time")
    slider.focus()
    slider.press("Home")
    assert visit.app("app.at") == 0
    for _ in range(7):
        slider.press("ArrowRight")
    at = visit.app("app.at")
    assert at == pytest.approx(7 * motion.duration / 200)
    expected = joint_poses(page.session.robot, motion.at(at)[0])

    def drawn() -> np.ndarray:
        return np.array(visit.app("app.view.poses")[1:]).reshape(-1, 4, 4).transpose(0, 2, 1)

    until(lambda: bool(np.abs(drawn() - expected).max() < DRAWN), visit)
    # There is a picture: not all of its points are alike.
    picture = visit.page.locator("#stage").screenshot()
    assert len(picture) > 8_000
    for name in ("Design", "Identify", "Use", "Run"):
        visit.step(name)
        assert visit.page.locator("#panel").get_attribute("aria-label") == name
        stop = visit.page.locator("#stop")
        assert stop.is_visible()
        # What else is there lies under it.
        stop.click(trial=True)
        assert stop.evaluate("e => getComputedStyle(e).backgroundColor") == STOP
    assert visit.page.evaluate("document.documentElement.scrollWidth") <= width
    visit.check()


def test_keys_do_what_buttons_do(visited: Visited) -> None:
    visit = visited(1400)
    keyboard = visit.page.keyboard
    visit.page.locator("#over").focus()
    keyboard.press("1")
    assert visit.page.locator("#panel").get_attribute("aria-label") == "Design"
    keyboard.press("Space")
    until(lambda: visit.app("app.playing"), visit)
    # What runs may be unknown here: STOP is sent always, and where nothing runs it is no error.
    with visit.page.expect_response("**/do/stop") as told:
        keyboard.press("Escape")
    assert told.value.ok
    assert visit.app("app.playing") is False
    visit.page.locator("#stop").hover()
    with visit.page.expect_response("**/do/stop") as told:
        visit.page.mouse.down()
    assert told.value.ok
    visit.page.mouse.up()
    # A button that was pressed last takes the keys that press it, no others.
    visit.page.locator("#play").focus()
    keyboard.press("2")
    assert visit.page.locator("#panel").get_attribute("aria-label") == "Run"
    visit.page.locator("#over").focus()
    turn = visit.app("app.view.camera.turn")
    keyboard.press("ArrowRight")
    assert visit.app("app.view.camera.turn") > turn
    keyboard.press("0")
    # Every control has a name, and can be reached.
    names = visit.page.evaluate(
        """() => [...document.querySelectorAll('button, input, select')].filter((e) =>
        !(e.textContent || e.getAttribute('aria-label') || (e.labels && e.labels.length)))
        .map((e) => e.outerHTML)"""
    )
    assert names == []
    visit.check()


def test_nothing_fails_before_the_server_has_answered(
    browser: Any, studio: tuple[Page, str]
) -> None:
    page = browser.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.route("**/api/state*", lambda route: None)
    with page.expect_request("**/api/state*"):
        page.goto(studio[1])
    page.locator("#primary").dispatch_event("click")
    with page.expect_response("**/do/stop"):
        page.keyboard.press("Escape")
    assert errors == []
    page.close()


def test_a_run_is_shown_while_no_motion_is_chosen(visited: Visited) -> None:
    visit = visited(1400)
    kept = "window.kept = { state: app.state, motion: app.motion }"
    job = "{ id: 1, kind: 'run', what: 'the arm moves', share: 0, repeat: 3, ended: false }"
    live = "{ id: 1, t: [0, 1], q: Array(12).fill(0), values: {}, at: 0, samples: 2 }"
    state = f"app.state = {{ ...app.state, job: {job} }}"
    visit.app(f"{{ {kept}; {state}; app.motion = app.group = null; app.live = {live}; }}")
    visit.page.locator("#title", has_text="the arm moves").wait_for()
    visit.app("{ Object.assign(app, window.kept, { live: null }); app.render(); }")
    visit.check()


def test_no_motion_may_be_chosen(visited: Visited, studio: tuple[Page, str]) -> None:
    visit = visited(1400)
    visit.step("Design")
    shown = visit.page.locator("#f-motion")
    before = shown.input_value()
    assert before
    shown.select_option("")
    visit.page.locator("#title", has_text="no motion yet").wait_for()
    until(lambda: visit.page.locator("#plothead button").count() == 0, visit)
    shown.select_option(before)
    visit.page.locator("#title", has_text=before).wait_for()
    assert studio[0].session.motion.name == before
    visit.check()


@pytest.mark.parametrize(
    ("found", "labels"),
    [
        ([0.00294, 0.00081], ["8.1e-4", "2.9e-3"]),
        ([75.63, 12.345], ["12.3", "75.6"]),
        ([-460.48, -560.39], ["-560", "-460"]),
    ],
)
def test_the_criterion_of_a_search_is_labelled_as_it_is(
    visited: Visited, found: list[float], labels: list[str]
) -> None:
    history = [[k, value] for k, value in enumerate(found)]
    said = visited(1400).page.evaluate(
        """async (history) => {
          const { Plots } = await import("/plots.js"), said = [];
          const plots = new Plots(document.createElement("canvas"), document.createElement("ul"));
          plots.canvas.getContext = () => new Proxy({}, {
            get: (_, name) => (name === "fillText" ? (text) => said.push(text) : () => {}),
            set: () => true,
          });
          plots.drawSearch(history, {});
          return said;
        }""",
        history,
    )
    assert set(labels) <= {text.replace("\N{MINUS SIGN}", "-") for text in said}


def test_the_button_works_again_after_a_refusal(visited: Visited, studio: tuple[Page, str]) -> None:
    session = studio[0].session
    visit = visited(1400)
    visit.step("Design")
    visit.page.locator("#f-period_s").fill("0")
    refused: list[object] = [None]
    asked: list[Any] = []
    for _ in range(2):
        # A second press, before the first is answered, asks for nothing.
        asked.clear()
        visit.page.route("**/do/design", lambda route: asked.append(route))
        visit.primary("Design a motion")
        until(lambda: bool(asked), visit)
        visit.page.locator("#primary").dispatch_event("click")
        visit.page.wait_for_timeout(100)
        assert len(asked) == 1
        asked[0].continue_()
        visit.page.unroute("**/do/design")
        until(lambda: session.job is not refused[-1] and session.job.state.ended, visit)
        refused.append(session.job)
        visit.page.locator("#job .bad").wait_for()
    visit.check()


def test_an_answer_that_is_late_takes_no_news_back(
    visited: Visited, studio: tuple[Page, str]
) -> None:
    page, _ = studio
    visit = visited(1400)
    visit.step("Design")
    hostile = next(name for name in page.session.motions if name.startswith("<img"))
    late: list[tuple[Any, Any]] = []
    visit.page.route("**/api/state*", lambda route: late.append((route, route.fetch())))
    visit.page.locator("#f-motion").select_option(hostile)
    until(lambda: bool(late), visit)
    page.do("choose", JsonFields({"name": "motion.json"}))
    until(lambda: visit.app("app.state.motion") == "motion.json", visit)
    for route, answer in late:
        assert answer.json()["motion"] == hostile
        with visit.page.expect_response("**/api/state*"):
            route.fulfill(response=answer)
    visit.page.unroute("**/api/state*")
    visit.page.wait_for_timeout(500)
    assert visit.app("app.state.motion") == "motion.json"
    visit.page.locator("#title h2", has_text="motion.json").wait_for()
    visit.check()


def test_names_from_files_are_text(visited: Visited, studio: tuple[Page, str]) -> None:
    page, _ = studio
    visit = visited(1400)
    visit.step("Design")
    shown = visit.page.locator("#f-motion option").all_inner_texts()
    assert any(name.startswith("<img src=x") for name in shown)
    visit.page.get_by_text("Not shown").click()
    assert "<b>broken<b>.json" in visit.page.locator("#content").inner_text()
    hostile = next(name for name in page.session.motions if name.startswith("<img"))
    visit.page.locator("#f-motion").select_option(hostile)
    visit.page.locator("#title h2", has_text="<img src=x").wait_for()
    visit.page.locator("#f-motion").select_option("motion.json")
    until(lambda: page.session.motion.name == "motion.json", visit)
    visit.check()


def test_a_visitor_edits_an_empty_scene(
    visited: Visited, studio: tuple[Page, str], folder: Path
) -> None:
    page, _ = studio
    editor = page.session.editor
    visit = visited(1400)
    visit.step("Design")
    visit.page.locator("#scene summary").click()
    visit.page.get_by_text("The scene has only the floor").wait_for()
    visit.page.get_by_role("button", name="Add", exact=True).click()
    visit.page.get_by_label("x [m]", exact=True).wait_for()
    visit.page.get_by_label("x [m]", exact=True).fill("0.9")
    visit.page.keyboard.press("Tab")
    until(lambda: page.session.editor.items[1]["position"][0] == 0.9, visit)
    # What was refused is not asked for again with the next number.
    visit.page.get_by_label("x [m]", exact=True).fill("1e5")
    visit.page.keyboard.press("Tab")
    visit.page.get_by_text("allowed: 100 m").wait_for()
    visit.page.get_by_label("y [m]", exact=True).fill("0.1")
    visit.page.keyboard.press("Tab")
    until(lambda: page.session.editor.items[1]["position"][:2] == [0.9, 0.1], visit)
    visit.errors.clear()
    # Its arrow is dragged.
    until(lambda: visit.app("app.view.handle && app.view.handle.position[1]") == 0.1, visit)

    def dragged() -> bool:
        # Once more where the picture moved between the look and the press.
        x, y = visit.app("app.view.project(app.view.arrows()[2].to)")
        box = visit.page.locator("#over").bounding_box()
        visit.page.mouse.move(box["x"] + x, box["y"] + y)
        visit.page.mouse.down()
        visit.page.mouse.move(box["x"] + x, box["y"] + y - 30, steps=3)
        visit.page.mouse.up()
        visit.page.wait_for_timeout(500)
        return editor.items[1]["position"][2] > 0.11

    until(dragged, visit)
    assert editor.items[1]["position"][0] == 0.9
    check_that_a_shape_stays_where_it_was_let_go(visit, page)
    # A place that is answered after the scene was saved does not take that news away.
    late: list[tuple[Any, Any]] = []
    visit.page.route("**/do/place*", lambda route: late.append((route, route.fetch())))
    visit.page.get_by_label("y [m]", exact=True).fill("0.2")
    visit.page.keyboard.press("Tab")
    until(lambda: bool(late), visit)
    visit.page.get_by_role("button", name="Save", exact=True).click()
    visit.page.get_by_text("saved: scene.json").wait_for()
    for route, answer in late:
        with visit.page.expect_response("**/do/place*"):
            route.fulfill(response=answer)
    visit.page.wait_for_timeout(500)
    assert visit.page.get_by_text("saved: scene.json").is_visible()
    assert (folder / "scene.json").exists()
    visit.page.get_by_role("button", name="Remove").click()
    until(lambda: not editor.items, visit)
    visit.check()


def check_that_a_shape_stays_where_it_was_let_go(visit: Visit, page: Page) -> None:
    """News of an earlier place come before the last one was sent."""
    late: list[tuple[Any, Any]] = []
    visit.page.route("**/do/place*", lambda route: late.append((route, route.fetch())))
    box = visit.page.locator("#over").bounding_box()
    x, y = visit.app("app.view.project(app.view.arrows()[2].to)")
    mouse = visit.page.mouse
    mouse.move(box["x"] + x, box["y"] + y)
    mouse.down()
    mouse.move(box["x"] + x, box["y"] + y - 20)
    until(lambda: bool(late), visit)
    first = page.session.editor.items[1]["position"][2]
    until(lambda: visit.app("app.scene.shapes[0].position[2]") == first, visit)
    mouse.move(box["x"] + x, box["y"] + y - 40)
    until(lambda: visit.app("app.view.handle.position[2]") > first, visit)
    last = visit.app("app.view.handle.position[2]")
    page.do("add", JsonFields({"kind": "sphere"}))
    until(lambda: visit.app("app.scene.shapes.length") == 2, visit)
    page.do("remove", JsonFields({"number": 2}))
    mouse.up()
    route, answer = late[0]
    route.fulfill(response=answer)
    until(lambda: page.session.editor.items[1]["position"][2] == last, visit)
    visit.page.unroute("**/do/place*")


def test_what_is_near_the_cursor_is_that_of_the_last_place_of_it(
    visited: Visited, studio: tuple[Page, str]
) -> None:
    page, _ = studio
    visit = visited(1400)
    late: list[Any] = []
    visit.page.route("**/do/judge*", lambda route: late.append(route), times=1)
    slider = visit.page.get_by_role("slider", name="Time")
    slider.focus()
    slider.press("Home")
    until(lambda: bool(late), visit)
    slider.press("PageUp")
    # Longer than the page waits before it judges where the cursor has come to rest.
    visit.page.wait_for_timeout(500)
    late[0].continue_()
    found = page.do("judge", JsonFields({"t": visit.app("app.at")}))
    until(lambda: visit.app("app.margins") == found["margins"], visit)
    visit.check()


def test_a_long_run_is_drawn_in_little_time(browser: Any, studio: tuple[Page, str]) -> None:
    """STOP waits for the picture: it took seconds after an hour."""
    page, url = studio
    visit = Visit(browser, url)
    count = 50_001
    t = np.arange(count) / 40
    values = encoded(np.column_stack([t] * 6))
    job = {"id": 1, "kind": "run", "what": "", "share": 0, "repeat": 300, "ended": False}
    tail = {"samples": count, "t": encoded(t), "q": values, "groups": {"Torque": values}}
    state = page.look_up("state", str) | {"version": 1 << 40, "job": job, "tail": tail}
    visit.page.route("**/api/state*", lambda route: route.fulfill(json=state))
    visit.app("app.do('choose', { name: 'motion.json' }).then(() => null)")
    live = visit.app("app.live")
    assert len(live["t"]) <= 4000
    assert live["t"][-1] == t[-1]
    assert live["q"] == live["values"]["Torque"] == np.repeat(live["t"], 6).tolist()
    read = visit.page.evaluate(
        """async () => {
          const { Plots } = await import("/plots.js"), { app } = await import("/studio.js");
          const canvas = document.createElement("canvas");
          document.body.append(canvas);
          const plots = new Plots(canvas, document.createElement("ul"));
          plots.setJoints(app.robot.joints);
          let read = 0;
          const t = new Proxy(app.motion.t, { get: (all, k) => (read++, all[k]) });
          plots.show({ ...app.group, t }, 1000 * app.motion.duration, app.motion.duration, null);
          plots.draw(0, {});
          return read;
        }"""
    )
    assert read < 100_000
    visit.page.close()


def test_a_manual_pose_begins_at_the_shown_one(visited: Visited) -> None:
    visit = visited(1400)
    visit.step("Design")
    before = visit.app("(app.at = 1.2, app.render(), app.poseNow())")
    slider = visit.page.locator("#pose input").nth(5)
    assert float(slider.input_value()) == pytest.approx(before[5], abs=0.01)
    slider.evaluate("e => { e.value = 1; e.dispatchEvent(new Event('input')); }")
    pose = visit.app("app.pose")
    assert pose[:5] == before[:5]
    assert pose[5] == pytest.approx(1, abs=0.01)
    visit.app("app.showPose(null)")
    visit.check()


def test_nothing_of_an_earlier_picture_stays(visited: Visited) -> None:
    """A page that is made smaller in the browser has less than a pixel a pixel."""
    ghosts = """(() => {
      const { view } = app, pen = view.over.getContext("2d"), { width, height } = view.over;
      pen.fillRect(0, 0, 9999, 9999);
      Object.assign(view, { paths: { past: [], next: [] }, near: [], handle: null });
      view.drawOver(false);
      return pen.getImageData(0, 0, width, height).data.some((x) => x > 0);
    })()"""
    assert not visited(1400).app(ghosts)


def test_the_newest_estimate_is_the_one_that_is_exported(visited: Visited) -> None:
    seen = visited(1400).page.evaluate(
        """async (made) => {
          const { app } = await import("/studio.js"), kept = app.state, seen = [];
          app.go("use");
          for (const names of [["a"], ["b", "a"]]) {
            app.state = { ...kept, results: names.map((name) => ({ ...made, name })) };
            app.render();
            seen.push(document.getElementById("f-estimate").value);
          }
          app.state = kept;
          app.render();
          return seen;
        }""",
        {"level": "good", "headline": "", "warnings": [], "parameters": [], "record": ""},
    )
    assert seen == ["a", "b"]


@pytest.mark.parametrize(("width", "height"), [(1366, 600), (390, 844)])
def test_a_small_window_shows_the_question_and_stop(
    browser: Any, studio: tuple[Page, str], width: int, height: int
) -> None:
    session = studio[0].session
    session.choose("motion.json")
    visit = Visit(browser, studio[1], width)
    visit.page.set_viewport_size({"width": width, "height": height})
    visit.step("Run")
    before = session.job
    with controller_process("ur5", host=own_address(), virtual_time=True) as controller:
        visit.page.get_by_label("Robot").fill(f"ur://{controller.host}")
        visit.primary(f"Run on {controller.host}")
        word = visit.page.get_by_label(f"Type {controller.host}")
        word.wait_for()
        for shown in (word, visit.page.locator("#stop"), visit.page.locator("#primary")):
            until(lambda shown=shown: _inside(shown.bounding_box(), width, height), visit)
        button = visit.page.locator("#primary")
        assert button.is_disabled()
        word.fill("another")
        assert button.is_disabled()
        word.fill(controller.host)
        assert button.is_enabled()
        visit.page.locator("#stop").click()
        until(lambda: session.job is not before and session.job.state.ended, visit)
    assert session.job is not None
    assert "stopped" in str(session.job.state.error)
    visit.check()
    visit.page.close()


def _inside(box: Any, width: int, height: int) -> bool:
    return (
        box is not None
        and box["x"] >= 0
        and box["y"] >= 0
        and box["x"] + box["width"] <= width
        and box["y"] + box["height"] <= height
    )


def test_stop_arrives_from_one_of_many_tabs(browser: Any, studio: tuple[Page, str]) -> None:
    context = browser.new_context()
    tabs = [context.new_page() for _ in range(7)]
    for tab in tabs:
        tab.set_default_timeout(PATIENCE_MS)
        tab.goto(studio[1])
        tab.locator("#play").wait_for()
    # Each of them is seen: none has closed its news.
    assert not any(tab.evaluate("document.hidden") for tab in tabs)
    stopped = "import('/studio.js').then(({ app }) => app.do('stop')).then(() => 'stopped')"
    assert tabs[-1].evaluate(stopped) == "stopped"
    context.close()


def test_a_stop_that_is_not_delivered_is_said_and_what_is_old_is_called_old(
    browser: Any, tmp_path: Path
) -> None:
    write_motion(tmp_path / "motion.json", period=4.0)
    command = [sys.executable, "-m", "dynid", "studio", str(tmp_path), "--port", "0", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        try:
            assert process.stdout is not None
            visit = Visit(browser, json.loads(process.stdout.readline())["url"])
            visit.step("Run")
            visit.page.get_by_label("Periods").fill("900")
            visit.primary("Run the simulated robot")
            visit.page.locator("#title h2", has_text="of 900").wait_for()
        finally:
            process.kill()
    visit.page.keyboard.press("Escape")
    alert = visit.page.get_by_role("alert")
    alert.get_by_text("STOP was not delivered: use the emergency stop of the robot").wait_for()
    visit.page.locator("#title h2", has_text="No connection").wait_for()
    title = visit.page.locator("#title p").inner_text()
    assert title.startswith("last known: Period ")
    assert "m/s" not in title
    assert visit.page.locator("#job p").inner_text().startswith("last known: ")
    assert visit.page.locator("#primary").inner_text() == "No connection"
    visit.page.close()


def test_a_run_beside_an_open_page_loses_no_sample_and_can_be_stopped(
    visited: Visited,
    studio: tuple[Page, str],
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    page, _ = studio
    session = page.session
    session.choose("motion.json")
    visit = visited(1400)
    visit.step("Run")
    with controller_process("ur5", host=own_address(), virtual_time=True) as controller:
        visit.page.get_by_label("Robot").fill(f"ur://{controller.host}")
        visit.page.get_by_label("Periods").fill("1")
        visit.primary(f"Run on {controller.host}")
        visit.page.get_by_label(f"Type {controller.host}").fill(controller.host)
        visit.primary("Move the robot")
        until(lambda: session.job is not None and session.job.state.ended, visit)
    job = session.job
    assert job is not None
    assert job.state.error is None
    assert job.state.result is not None
    assert job.state.result["cause"] is None
    visit.page.locator("#job .good", has_text="samples, 0 gaps").wait_for()
    record = read_record(folder / "record.parquet")
    assert record.samples == 2 * CYCLES
    assert np.abs(np.diff(record.t) - 0.008).max() < 1e-6
    # The legend is that of the curves also where another file has the same quantity.
    legend = visit.page.locator("#legend span")
    until(lambda: legend.all_inner_texts() == ["measured"], visit)
    visit.primary("Continue to identify")
    assert visit.page.get_by_label("Recording").input_value() == "record.parquet"
    visit.step("Run")
    # The recording is shown, and the design is still the one to run.
    assert visit.page.locator("#f-motion").input_value() == "motion.json"
    visit.page.get_by_label("Robot").fill("sim")
    visit.page.get_by_label("Periods").fill("900")
    visit.page.get_by_label("File").fill("stopped.parquet")
    visit.page.get_by_role("button", name="Run again").click()
    until(lambda: bool(visit.app("app.live && app.live.t.length")), visit)
    assert session.motion.name == "motion.json"
    # A long recording is opened for a while.
    open_it, take = threading.Event(), page._take_result
    monkeypatch.setattr(page, "_take_result", lambda *of: open_it.wait(PATIENCE_MS) and take(*of))
    # That a STOP is not answered is said until it is.
    held: list[Any] = []
    visit.page.route("**/do/stop", lambda route: held.append(route))
    visit.page.keyboard.press("Escape")
    alert = visit.page.get_by_role("alert")
    alert.get_by_text("STOP is not answered: use the emergency stop of the robot").wait_for()
    held[0].continue_()
    alert.wait_for(state="hidden")
    visit.page.unroute("**/do/stop")
    visit.page.locator("#job p", has_text="stopped: it was interrupted").wait_for()
    assert visit.page.locator("#primary").inner_text() == "The result is opened"
    visit.page.locator("#title h2", has_text="The run is over").wait_for()
    open_it.set()
    until(lambda: session.job is not job and session.job.state.ended, visit)
    visit.page.locator("#job .warn", has_text="stopped: it was interrupted").wait_for()
    assert visit.page.locator("#f-motion").input_value() == "motion.json"
    assert visit.page.locator("#primary").inner_text() == "Run the simulated robot"
    assert visit.page.locator("#primary").is_enabled()
    visit.page.locator("#f-motion").select_option("")
    visit.page.locator("#primary:disabled", has_text="Choose a design").wait_for()
    problems = read_record(folder / "stopped.parquet").problems
    assert "aborted" in [problem.kind for problem in problems]
    visit.check()


def test_what_is_dropped_in_any_step_is_answered(
    visited: Visited,
) -> None:
    visit = visited(1400)

    def drop(name: str, text: str) -> None:
        visit.page.evaluate(
            "([name, text]) => import('/studio.js').then((m) => m.send(new File([text], name)))",
            [name, text],
        )

    visit.step("Use")
    drop("notes.csv", "no recording\n")
    visit.page.locator("#job .bad", has_text="there are no rows of numbers").wait_for()
    arm = (
        '<robot name="two"><link name="base"/><link name="arm"/><joint name="j" type="revolute">'
        '<parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>'
    )
    drop("two.urdf", arm)
    visit.page.locator("#robot", has_text="TWO").wait_for()
    assert visit.page.locator("#panel").get_attribute("aria-label") == "Design"
    visit.check()
