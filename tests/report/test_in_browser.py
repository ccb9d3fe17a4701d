"""The page in headless Chromium, as a reader has it: once on a screen, a telephone and paper."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from dynid.report import ReportContents

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium (make test installs it)")
SCREEN, TELEPHONE = (1400, 900), (390, 844)
SCREENS = {SCREEN: 3, TELEPHONE: 6}
"""Screens that decide; what follows is the appendix."""
MAX_PDF = 3_000_000


@pytest.fixture(scope="module")
def address(page: tuple[Path, ReportContents]) -> str:
    return page[0].as_uri()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield running
        running.close()


@pytest.fixture
def opened(browser: Any, address: str) -> Iterator[Any]:
    """Opens the page at a size; no complaint and no request may come of it."""
    said: list[str] = []
    pages: list[Any] = []

    def opening(size: tuple[int, int], **options: Any) -> Any:
        page = browser.new_page(viewport={"width": size[0], "height": size[1]}, **options)
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("request", lambda request: said.extend([request.url] * (request.url != address)))
        page.goto(address)
        pages.append(page)
        return page

    yield opening
    for page in pages:
        page.close()
    assert said == []


@pytest.mark.parametrize("size", [SCREEN, TELEPHONE])
def test_it_decides_within_few_screens_and_nothing_is_cut_off(
    opened: Any, size: tuple[int, int]
) -> None:
    page = opened(size)
    deciding = page.evaluate("document.getElementById('appendix').offsetTop")
    assert deciding <= SCREENS[size] * size[1]
    page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
    # Every plot is drawn without scrolling, and its texts stay on the page.
    assert page.evaluate(
        "[...document.querySelectorAll('svg.plot')].every(p => p.querySelector('path[d]'))"
    )
    outside = page.evaluate(
        """[...document.querySelectorAll('svg.plot text')].filter(t => {
            const b = t.getBoundingClientRect();
            return b.width && (b.left < 0 || b.right > innerWidth);
        }).map(t => t.textContent)"""
    )
    assert outside == []


@pytest.mark.parametrize("scheme", ["light", pytest.param("dark", marks=pytest.mark.long)])
def test_axe_finds_no_serious_fault(opened: Any, scheme: str) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="needs axe-core")
    page = opened(SCREEN, color_scheme=scheme)
    if scheme == "light":
        page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    # Colours are all that the dark page has of its own.
    options = {} if scheme == "light" else {"runOnly": ["color-contrast"]}
    found = axe.Axe().run(page, options=options).response["violations"]
    serious = [
        (v["id"], v["nodes"][0]["html"][:200])
        for v in found
        if v["impact"] in ("serious", "critical")
    ]
    assert serious == []


def test_one_cursor_and_one_zoom_for_all_time_plots(opened: Any) -> None:
    page = opened(SCREEN)
    plots = page.locator("svg.plot[data-link=time]")
    first = page.locator(".row.worst svg.plot").first
    first.scroll_into_view_if_needed()
    box = first.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 20)
    assert page.locator("svg.plot[data-link=time] > line.cursor").count() == plots.count()
    low, high = map(float, first.get_attribute("data-x").split(","))
    cursor = page.locator("span[data-cursor=time]").text_content()
    assert float(cursor) == pytest.approx((low + high) / 2, abs=0.1)
    values = page.locator(".row.worst dd").all_text_contents()
    numbers = [float(value.replace("\N{MINUS SIGN}", "-")) for value in values]
    assert numbers[0] - numbers[1] == pytest.approx(numbers[2], abs=0.2)
    # Drag from a quarter to a half: every plot shows that stretch.
    page.mouse.move(box["x"] + box["width"] / 4, box["y"] + 20)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 20, steps=3)
    page.mouse.up()
    boxes = page.locator("svg.plot[data-link=time] > svg.in").evaluate_all(
        "all => all.map(s => s.viewBox.baseVal.x + ' ' + s.viewBox.baseVal.width)"
    )
    assert len(set(boxes)) == 1
    start, width = map(float, boxes[0].split())
    assert start == pytest.approx(5000, abs=60)
    assert width == pytest.approx(5000, abs=60)
    page.locator("button[data-zoom='0']").click()
    assert page.locator("svg.in").first.evaluate("s => s.viewBox.baseVal.width") == 20000


def test_the_button_changes_the_ground(opened: Any) -> None:
    page = opened(SCREEN, color_scheme="dark")
    ground = "getComputedStyle(document.body).backgroundColor"
    dark = page.evaluate(ground)
    page.click("#ground")
    assert (dark, page.evaluate(ground)) == ("rgb(17, 19, 23)", "rgb(255, 255, 255)")


def test_paper_holds_the_whole_page(opened: Any) -> None:
    page = opened(SCREEN, color_scheme="dark")
    start = time.monotonic()
    paper = page.pdf(prefer_css_page_size=True, print_background=False)
    assert time.monotonic() - start < 60
    assert len(paper) < MAX_PDF
    assert paper.count(b"/Type /Page\n") + paper.count(b"/Type /Page ") >= 3
