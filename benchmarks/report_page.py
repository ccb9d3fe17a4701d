"""A report in headless Chromium: size, opening, deciding screens, PDF and accessibility.

    python benchmarks/report_page.py [REPORT.html] [--pictures FOLDER]

The time to open runs from the request to the second frame after the load event, the fastest of
three. Screens count down to the appendix, at 1400 x 900 and 390 x 844. axe-core looks at the whole
page, appendix unfolded, light and dark. Exits 1 where an asked figure is missed.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import time
from pathlib import Path
from typing import Any

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import sync_playwright

SIZES = {"screen": (1400, 900, 3.0), "telephone": (390, 844, 6.0)}
"""Width, height [px] and the most screens that decide."""
OPEN_S, PAGE_MB, PDF_S, PDF_MB = 1.5, 3.0, 20.0, 3.0
OPENINGS = 3
DRAWN = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"


def opened(browser: Any, address: str, size: tuple[int, int], scheme: str) -> tuple[Any, float]:
    """A page with the report, and how long it took to open [s]."""
    page = browser.new_page(viewport={"width": size[0], "height": size[1]}, color_scheme=scheme)
    page.said = []
    page.on("console", lambda message: page.said.append(message.text))
    page.on("pageerror", lambda error: page.said.append(str(error)))
    started = time.perf_counter()
    page.goto(address)
    page.evaluate(DRAWN)
    return page, time.perf_counter() - started


def serious(page: Any) -> list[str]:
    """Serious and critical faults that axe-core finds, and the first place of each."""
    found = Axe().run(page).response["violations"]
    return [
        f"{fault['id']}: {fault['nodes'][0]['html'][:120]}"
        for fault in found
        if fault["impact"] in ("serious", "critical")
    ]


def main() -> int:
    """Print a line a figure."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("report", type=Path, nargs="?", help="without it nothing is measured")
    parser.add_argument("--pictures", type=Path, help="folder for a picture of each page")
    asked = parser.parse_args()
    if asked.report is None:
        print("nothing measured: name a report.html")
        return 0
    missed = 0

    def told(what: str, value: float, most: float, unit: str) -> None:
        nonlocal missed
        missed += value > most
        print(f"{what:28}{value:8.2f} {unit:8} asked: {most:g}", flush=True)

    address = asked.report.resolve().as_uri()
    told("size", 1e-6 * asked.report.stat().st_size, PAGE_MB, "MB")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        said: list[str] = []
        for name, (width, height, most) in SIZES.items():
            for scheme in ("light", "dark"):
                times: list[float] = []
                for _ in range(OPENINGS):
                    page, taken = opened(browser, address, (width, height), scheme)
                    times.append(taken)
                    said += page.said
                    if len(times) < OPENINGS:
                        page.close()
                told(f"opening, {name}, {scheme}", min(times), OPEN_S, "s")
                deciding = page.evaluate("document.getElementById('appendix').offsetTop") / height
                told(f"deciding, {name}, {scheme}", deciding, most, "screens")
                if asked.pictures is not None:
                    asked.pictures.mkdir(parents=True, exist_ok=True)
                    path = asked.pictures / f"{name}-{scheme}.png"
                    page.screenshot(path=path, full_page=True)
                page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
                faults = serious(page)
                told(f"axe-core, {name}, {scheme}", len(faults), 0, " ".join(faults) or "faults")
                page.close()
        page, _ = opened(browser, address, SIZES["screen"][:2], "light")
        started = time.perf_counter()
        paper = page.pdf(prefer_css_page_size=True)
        told("PDF", time.perf_counter() - started, PDF_S, "s")
        told("PDF", 1e-6 * len(paper), PDF_MB, "MB")
        told("messages on the console", len(said + page.said), 0, "")
        browser.close()
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
