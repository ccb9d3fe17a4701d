"""The page in headless Chromium, as a reader has it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from dynid.workflow import report

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium (make test installs it)")


@pytest.fixture(scope="module")
def address(finished_run: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    path, _ = report(finished_run, tmp_path_factory.mktemp("page") / "report.html")
    return path.as_uri()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield running
        running.close()


@pytest.mark.parametrize("width", [390, 1400])
def test_figures_are_drawn_without_a_complaint(browser: Any, address: str, width: int) -> None:
    page = browser.new_page(viewport={"width": width, "height": 900})
    complaints: list[str] = []
    requests: list[str] = []
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: requests.append(request.url))
    page.goto(address)
    page.wait_for_function("window.Plotly !== undefined")
    for k in range(page.locator("figure.plot").count()):
        figure = page.locator("figure.plot").nth(k)
        figure.scroll_into_view_if_needed()
        figure.locator(".main-svg").first.wait_for()
    assert complaints == []
    assert requests == [address]
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.close()


def test_dark_and_light_change_page_and_figures(browser: Any, address: str) -> None:
    page = browser.new_page(color_scheme="dark")
    page.goto(address)
    page.wait_for_function("window.Plotly !== undefined")
    page.locator("figure.plot").first.scroll_into_view_if_needed()
    page.locator("figure.plot .main-svg").first.wait_for()
    ground = "getComputedStyle(document.body).backgroundColor"
    drawn = "document.querySelector('figure.plot').layout.paper_bgcolor"
    page.wait_for_function(f"{drawn} === '#14181d'")
    dark = page.evaluate(ground)
    page.click("#ground")
    page.wait_for_function(f"{drawn} === '#ffffff'")
    assert page.evaluate(ground) != dark
    page.close()
