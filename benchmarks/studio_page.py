"""First picture, frames a second and accessibility of the studio, in headless Chromium.

    python benchmarks/studio_page.py

`dynid studio` is a process of its own; the page is 1400 x 900 and drawn in software. The first
picture is the first draw call after the address was opened; a frame counts in which anything was
drawn. axe-core looks at each step, light and dark. Exits 1 above 3 s, below 8 frames a second, or
with a serious fault.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import sync_playwright
from report_page import serious

from dynid.core import provenance
from dynid.robot import load_robot
from dynid.trajectory import rest_series, write_trajectory

FIRST_S, FRAMES_HZ = 3.0, 8.0
SOFTWARE = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader"]
SOFTWARE += ["--enable-unsafe-swiftshader"]
WATCHED_S = 8.0
STEPS = ("Design", "Run", "Identify", "Use")
COUNT = """
for (const Context of [WebGLRenderingContext, WebGL2RenderingContext]) {
  const draw = Context.prototype.drawArrays;
  Context.prototype.drawArrays = function (...words) {
    window.firstDrawn ??= performance.now();
    window.lastDrawn = performance.now();
    return draw.apply(this, words);
  };
}
window.drawnFrames = 0;
let seen;
const count = () => {
  if (window.lastDrawn !== seen) { window.drawnFrames += 1; seen = window.lastDrawn; }
  requestAnimationFrame(count);
};
requestAnimationFrame(count);
"""


def moving_ur5(folder: Path) -> Path:
    """A motion of ten seconds."""
    middle = np.array([0.1, -1.4, 0.3, -2.1, 0.2, 0.1])
    series = rest_series(10.0, middle, 0.1 * np.random.default_rng(0).normal(size=(6, 4)))
    path = folder / "motion.json"
    limits = load_robot("ur5").limits
    write_trajectory(series, path, robot="ur5", limits=limits, provenance=provenance(seed=0))
    return path


def visit(page: Any, url: str) -> tuple[float, float]:
    """Seconds to the first picture, and frames a second while the motion plays."""
    page.add_init_script(COUNT)
    page.goto(url)
    deadline = time.monotonic() + 60
    while page.evaluate("window.firstDrawn === undefined") and time.monotonic() < deadline:
        page.wait_for_timeout(20)
    first = page.evaluate("window.firstDrawn") / 1000
    page.get_by_role("button", name="Play", exact=True).click()
    page.wait_for_timeout(1000)
    before, start = page.evaluate("window.drawnFrames"), time.perf_counter()
    page.wait_for_timeout(1000 * WATCHED_S)
    drawn = page.evaluate("window.drawnFrames") - before
    page.keyboard.press("Escape")
    return first, drawn / (time.perf_counter() - start)


def faults(page: Any) -> list[str]:
    """What axe-core calls serious or critical, in each step."""
    found: list[str] = []
    for name in STEPS:
        page.locator("#steps").get_by_role("button", name=name).click()
        page.wait_for_timeout(500)
        found += [f"{name}: {fault}" for fault in serious(page)]
    return found


def main() -> int:
    """Print the figures; 1 if one is missed."""
    wrong = 0
    with tempfile.TemporaryDirectory(prefix="dynid-studio-") as made:
        words = ["-m", "dynid", "studio", str(moving_ur5(Path(made))), "--port", "0"]
        studio = subprocess.Popen([sys.executable, *words], stderr=subprocess.PIPE, text=True)
        try:
            assert studio.stderr is not None
            url = next(m[0] for line in studio.stderr if (m := re.search(r"http://\S+", line)))
            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(
                    executable_path="/usr/bin/chromium", args=SOFTWARE
                )
                for scheme in ("light", "dark"):
                    page = browser.new_page(
                        viewport={"width": 1400, "height": 900}, color_scheme=scheme
                    )
                    first, rate = visit(page, url)
                    print(f"{scheme}: first picture {first:.2f} s, {rate:.1f} frames a second")
                    serious = faults(page)
                    print(*(serious or ["no serious fault"]), sep="\n")
                    wrong += (first > FIRST_S) + (rate < FRAMES_HZ) + len(serious)
                    page.close()
                browser.close()
        finally:
            studio.terminate()
            studio.wait(timeout=30)
    return min(wrong, 1)


if __name__ == "__main__":
    sys.exit(main())
