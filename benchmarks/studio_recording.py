"""Does a page that draws cost a recording samples? The same run at 125 Hz, without and with it.

    python benchmarks/studio_recording.py [SECONDS]

The simulated controller keeps real time in its own process; the run is a process of its own, as
the studio starts it; the page is open in headless Chromium, which draws in software.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import threading
from pathlib import Path

import numpy as np

from dynid.core import provenance
from dynid.recording import read_record
from dynid.robot import load_robot
from dynid.studio.jobs import Job, Supervisor
from dynid.studio.opening import open_path
from dynid.studio.page import Page
from dynid.studio.server import Server, make_door
from dynid.studio.session import Session
from dynid.trajectory import rest_series, write_trajectory
from urtwin import controller_process, own_address

PERIOD = 5.0
SOFTWARE = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader"]
SOFTWARE += ["--enable-unsafe-swiftshader"]


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
    folder = Path(tempfile.mkdtemp(prefix="dynid-studio-"))
    middle = np.array([0.1, -1.4, 0.3, -2.1, 0.2, 0.1])
    series = rest_series(PERIOD, middle, 0.1 * np.random.default_rng(0).normal(size=(6, 4)))
    limits = load_robot("ur5").limits
    motion = folder / "motion.json"
    write_trajectory(motion, series, robot="ur5", limits=limits, provenance=provenance(seed=0))
    periods = max(1, round(seconds / PERIOD))
    try:
        report("without a page", run(motion, folder / "alone.parquet", periods, None))
        page = Page(open_path(str(motion)))
        door = make_door("127.0.0.1", None)
        server = Server(door, 0, page)
        server.start()
        stop = threading.Event()
        loop = threading.Thread(target=page.run, args=(stop,))
        loop.start()
        with visitor(door.url(server.port)):
            report("page open", run(motion, folder / "watched.parquet", periods, page.session))
        stop.set()
        loop.join()
        server.stop()
    finally:
        shutil.rmtree(folder)


class visitor:
    """A browser with the page open."""

    def __init__(self, url: str) -> None:
        self._url = url

    def __enter__(self) -> None:
        from playwright.sync_api import sync_playwright

        self._context = sync_playwright()
        playwright = self._context.__enter__()
        chromium = shutil.which("chromium")
        self._browser = playwright.chromium.launch(executable_path=chromium, args=SOFTWARE)
        page = self._browser.new_page(viewport={"width": 1400, "height": 900})
        page.goto(self._url)
        page.locator("#play").wait_for(timeout=120_000)

    def __exit__(self, *_: object) -> None:
        self._browser.close()
        self._context.__exit__(None, None, None)


def run(motion: Path, output: Path, periods: int, session: Session | None) -> Path:
    with controller_process("ur5", host=own_address()) as controller:
        job = Job(
            kind="run",
            source=str(motion),
            output=str(output),
            options={"repeat": periods},
            target=f"ur://{controller.host}",
        )
        made = Supervisor(job) if session is None else session.start(job)
        while made.state.ask is None and not made.state.ended:
            made.wait(0.05)
        made.answer(controller.host)
        state = made.wait()
        print("  ", state.error or state.result)
    return output


def report(name: str, path: Path) -> None:
    record = read_record(path)
    steps = np.diff(record.t)
    lost = int(np.round(steps / 0.008).sum()) - len(steps)
    print(
        f"{name}: {record.samples} samples, {lost} lost, longest step {1000 * steps.max():.1f} ms"
    )


if __name__ == "__main__":
    main()
