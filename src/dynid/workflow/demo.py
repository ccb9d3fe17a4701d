"""`dynid demo`: the whole paper on the simulated UR5, beside what the paper reports."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dynid.core.errors import InputError
from dynid.core.files import write_json
from dynid.core.optional import require
from dynid.core.progress import Progress, silent
from dynid.identification.estimate_file import write_estimate
from dynid.robot.load import load_robot
from dynid.validation.comparison import ParameterComparison, compare
from dynid.workflow.analyze import Analysis, analyze
from dynid.workflow.demo_recordings import Recordings, make_recordings
from dynid.workflow.demo_table import Row, comparison, warming
from dynid.workflow.identify import Identification, identify
from dynid.workflow.identify_settings import IdentifySettings
from dynid.workflow.reporting import report

ROBOT = "ur5"
ESTIMATES = (
    ("paper", "cold", "estimate_paper_cold"),
    ("paper", "warm", "estimate_paper_warm"),
    ("best", "cold", "estimate_best_cold"),
)
"""Preset, thermal state and file name of each identification."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Demo:
    """What the demo found and wrote."""

    analysis: Analysis
    recordings: Recordings
    best: Identification
    paper: Identification
    warm: Identification
    """With the paper's settings, on the warm robot."""
    change: ParameterComparison
    """From cold to warm, with the paper's settings."""
    table: tuple[Row, ...]
    files: tuple[Path, ...]
    wall_s: float

    def to_json(self) -> dict[str, Any]:
        """The table paper / ours, the warnings of both presets, and the files."""
        return {
            "robot": ROBOT,
            "table": [row.to_json() for row in self.table],
            "design": self.recordings.design.to_json(),
            "comparison": self.change.to_json(),
            "choices": list(self.best.estimate.choices),
            "warnings": {
                "best": [notice.to_json() for notice in self.best.warnings],
                "paper": [notice.to_json() for notice in self.paper.warnings],
            },
            "files": [str(path) for path in self.files],
            "wall_s": self.wall_s,
        }


def run_demo(
    directory: str | Path, *, quick: bool = False, progress: Progress | None = None
) -> Demo:
    """The paper from end to end on the simulated UR5.

    Analyze the arm, design two motions inside every safety limit, run them three times each on
    the simulated controller (its own process, UR's protocols, virtual time), cold and warm,
    identify, validate on the other motion, compare cold with warm, write a report.

    Args:
        directory: Where the files go; it is made.
        quick: One repetition of the motions in place of three, and a shorter search for them.
        progress: Told what is being done and how far it is (0 to 1).

    Raises:
        InputError: The directory cannot be made or written to.
        JobError: No motion was found, a run was stopped, the problem is singular, or a file
            cannot be written.
        MissingExtraError: MuJoCo is not installed.
    """
    started = time.perf_counter()
    # Said now, not after minutes of search by the process that needs it.
    require("mujoco", "sim")
    tell: Progress = progress or silent
    folder = _directory(directory)
    robot = load_robot(ROBOT)
    tell("analyze the UR5", 0.0)
    analysis = analyze(robot)
    made = make_recordings(
        ROBOT, folder, quick, lambda what, share: tell(what, 0.02 + 0.68 * share)
    )
    files = list(made.files)
    results: dict[str, Identification] = {}
    for k, (preset, thermal, name) in enumerate(ESTIMATES):
        tell(f"identify, {thermal}, preset {preset}", 0.7 + 0.05 * k)
        results[name] = identify(
            made.identification[thermal],
            robot,
            IdentifySettings(preset=preset),
            validation=made.validation[thermal],
        )
        path = folder / f"{name}.json"
        write_estimate(results[name].estimate, path)
        files.append(path)
    paper, warm, best = (results[name] for _, _, name in ESTIMATES)
    change = compare(paper.estimate, warm.estimate)
    tell("write the report", 0.9)
    page, _ = report(folder, folder / "report.html")
    tell("done", 1.0)
    demo = Demo(
        analysis=analysis,
        recordings=made,
        best=best,
        paper=paper,
        warm=warm,
        change=change,
        table=(*comparison(analysis, made.design, paper, best), *warming(change, robot.joints)),
        files=(*files, page, folder / "demo.json"),
        wall_s=time.perf_counter() - started,
    )
    write_json(folder / "demo.json", demo.to_json())
    return demo


def _directory(directory: str | Path) -> Path:
    if not str(directory).strip():
        raise InputError("the directory has no name", where="-o")
    path = Path(directory)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"cannot make the directory: {error.strerror or error}", where=str(path)
        ) from error
    return path
