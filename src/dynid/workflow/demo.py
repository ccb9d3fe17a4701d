"""`dynid demo`: the whole paper on the simulated UR5, beside what the paper reports."""

import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid import core, experiment, identification, recording, simulation
from dynid.excitation import ExcitationDesign
from dynid.robot import load_robot
from dynid.settings import DesignSettings, IdentifySettings, RunSettings
from dynid.validation import ParameterComparison, ValidationResult, compare
from dynid.workflow.analyze import Analysis, analyze
from dynid.workflow.designing import design
from dynid.workflow.files import UNFINISHED
from dynid.workflow.identify import Identification, identify
from dynid.workflow.reporting import report
from dynid.workflow.running import run_design, truth_path, write_truth

PAPER_CONDITION = 153.0
PAPER_WARMING = -35.0
"""Largest change of viscous friction from a cold to a warm robot [%]."""
PAPER_ERROR = 0.0550
"""e_N of the paper's validation [N.m]; its N is not given."""


@dataclass(frozen=True, slots=True)
class DemoRow:
    """One quantity; None where it does not apply or is not given."""

    quantity: str
    paper: float | None
    preset_paper: float | None
    preset_best: float | None
    unit: str = ""
    note: str = ""


def _comparison(
    analysis: Analysis, design: ExcitationDesign, paper: Identification, best: Identification
) -> Iterator[DemoRow]:
    """Structure, excitation and prediction on the other motion, with the settings of both."""
    counts = analysis.to_json()
    frames = f"{counts['frames']} frames; the split depends on the frames"
    for quantity, known, key, note in (
        ("standard parameters", 78, "standard_parameters", ""),
        ("base parameters", 52, "base_parameters", ""),
        ("identifiable alone", 30, "identifiable_alone", frames),
        ("identifiable in combination", 39, "identifiable_combined", frames),
        ("not identifiable", 9, "unidentifiable", ""),
    ):
        yield DemoRow(quantity, known, counts[key], counts[key], note=note)
    number = design.condition_number
    note = "ours inside every safety limit: tool speed, power, torque, self-collision"
    yield DemoRow("condition number, designed", PAPER_CONDITION, number, number, note=note)
    ran, chosen = paper.estimate.condition_number, best.estimate.condition_number
    note = "the servo follows with a delay; preset best may have more columns"
    yield DemoRow("condition number, as executed", None, ran, chosen, note=note)
    ours, others = (item.validation or item.training for item in (paper, best))

    def row(
        quantity: str, of: Callable[[ValidationResult], float], unit: str = "", note: str = ""
    ) -> DemoRow:
        return DemoRow(quantity, None, of(ours), of(others), unit, note)

    note = "e_N falls as 1/sqrt(N); compare RMS where N differs"
    error = row("e_N on the other motion", lambda x: x.metrics.normalized_error, "N.m", note)
    yield replace(error, paper=PAPER_ERROR)
    note = "the paper does not give its N"
    yield row("N, samples of that motion", lambda x: x.metrics.samples, note=note)
    yield row("RMS error, all joints", _rms, "N.m")
    yield row(
        "relative error, moving joints", lambda x: x.moving.relative_error_overall_percent, "%"
    )


def _rms(result: ValidationResult) -> float:
    return float(np.sqrt(np.mean(np.square(result.metrics.rmse))))


def _warming(change: ParameterComparison, joints: int) -> Iterator[DemoRow]:
    """What warming up changed, with the paper's settings (paper 3.2, Fig. 4)."""
    found = dict(zip(change.names, change.change_percent, strict=True))
    for j in range(1, joints + 1):
        known, note = (PAPER_WARMING, "paper: by up to 35 % down") if j == 1 else (None, "")
        what = f"viscous friction of joint {j}, cold to warm"
        yield DemoRow(what, known, float(found[f"Fv{j}"]), None, "%", note)
    for group in change.groups:
        if group.members:
            what = f"{group.name} parameters, largest |z| cold to warm"
            note = f"above {group.limit_z:.1f} something moved"
            yield DemoRow(what, None, group.largest_z, None, note=note)


ROBOT = "ur5"
PERIOD_S, HARMONICS, REPETITIONS = 10.0, 5, 3
"""The paper's: length and harmonics of the trajectory, and how often it is repeated."""
PURPOSES = (("design", 1), ("validation_design", 2))
"""Name and seed of the two motions: one to identify from, one to check with."""
RECORDED = ("identification", "validation")
"""What each motion is recorded for."""
THERMAL = ("cold", "warm")
STARTS = 2
"""Starts of the search for a motion; more would find a slightly better one."""
Records = dict[tuple[str, str], recording.ExperimentRecord]
"""By thermal state and what they are recorded for."""


def _make_recordings(
    folder: Path, quick: bool, tell: core.Progress
) -> tuple[ExcitationDesign, Records]:
    """Design two motions, the first to identify from, and run them on a simulated controller.

    Raises:
        JobError: No feasible motion was found, or a run was stopped.
    """
    designs: list[ExcitationDesign] = []
    starts = 1 if quick else STARTS
    for k, (name, seed) in enumerate(PURPOSES):
        tell(f"search motion {k + 1} of {len(PURPOSES)}", 0.3 * k)
        settings = DesignSettings(
            purpose="cond",
            harmonics=HARMONICS,
            period_s=PERIOD_S,
            starts=starts,
            seed=seed,
            jobs=starts,
        )
        designs.append(design(ROBOT, settings, output=folder / f"{name}.json"))
        if designs[-1].interrupted:
            raise KeyboardInterrupt
        if not designs[-1].feasible:
            raise core.JobError("the search found no motion within the limits", where=str(folder))
    records: Records = {}
    for k, thermal in enumerate(THERMAL):
        for (name, seed), what in zip(PURPOSES, RECORDED, strict=True):
            tell(f"run on the simulated robot, {thermal}", 0.6 + 0.1 * len(records))
            path = folder / f"{thermal}_{what}.parquet"
            _record(folder / f"{name}.json", path, thermal, 10 * seed + k, quick)
            records[thermal, what] = recording.read_record(path)
    return designs[0], records


def _record(motion: Path, path: Path, thermal: str, seed: int, quick: bool) -> None:
    """Record a motion on a controller of its own: each recording starts at its temperature."""
    settings = RunSettings(
        repeat=1 if quick else REPETITIONS, thermal=thermal, seed=seed, force=True
    )
    with _simulated_robot(thermal, seed) as on, experiment.stop_on_signals() as cancel:
        run_design(motion, path, on=on, settings=settings, cancel=cancel).raise_if_aborted()
    warm = np.mean(recording.read_record(path).signals["temperature"], axis=0)
    write_truth(path, simulation.simulated_arm(load_robot(ROBOT), serial=simulation.SERIAL), warm)


@contextmanager
def _simulated_robot(thermal: str, seed: int) -> Generator[str]:
    """Where to run: on urtwin's controller, or where that is missing on the arm in this process."""
    try:
        from urtwin import controller_process
    except ImportError:
        yield "sim"
        return
    with controller_process(ROBOT, thermal=thermal, virtual_time=True, seed=seed) as controller:
        yield f"ur://{controller.host}"


ESTIMATES = (
    ("paper", "cold", "estimate_paper_cold"),
    ("paper", "warm", "estimate_paper_warm"),
    ("best", "cold", "estimate_best_cold"),
)
"""Preset, thermal state and file name of each identification."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Demo:
    """What the demo found and wrote."""

    design: ExcitationDesign
    """The motion that is identified from."""
    best: Identification
    paper: Identification
    change: ParameterComparison
    """From cold to warm, with the paper's settings."""
    table: tuple[DemoRow, ...]
    files: tuple[Path, ...]
    wall_s: float

    def to_json(self) -> dict[str, Any]:
        """The table paper / ours, the warnings of both presets, and the files."""
        return {
            "robot": ROBOT,
            "table": [asdict(row) for row in self.table],
            "design": self.design.to_json(),
            "comparison": self.change.to_json(),
            "choices": list(self.best.estimate.choices),
            "warnings": {
                name: core.told(one.warnings)["warnings"]
                for name, one in (("best", self.best), ("paper", self.paper))
            },
            "files": [str(path) for path in self.files],
            "wall_s": self.wall_s,
        }


def run_demo(
    directory: str | Path,
    *,
    quick: bool = False,
    force: bool = False,
    progress: core.Progress | None = None,
) -> Demo:
    """The paper from end to end on the simulated UR5.

    Analyze the arm, design two motions inside every safety limit, run them three times each on
    the simulated controller (its own process, UR's protocols, virtual time), cold and warm,
    identify, validate on the other motion, compare cold with warm, write a report.

    `quick` is one repetition of the motions, and a shorter search for them; `force` replaces the
    files of an earlier demo, as happens unasked to one that was interrupted.

    Raises:
        InputError: The directory cannot be made or written to, or holds such files.
        JobError: No motion was found, a run was stopped, the problem is singular, or a file
            cannot be written.
        MissingExtraError: MuJoCo is not installed.
    """
    started = time.perf_counter()
    # Said now, not after minutes of search by the process that needs it.
    core.require("mujoco", "sim")
    tell: core.Progress = progress or core.silent
    if not str(directory).strip():
        raise core.InputError("the directory has no name", where="-o")
    folder = core.make_folder(directory)
    unfinished = folder / UNFINISHED
    files = tuple(folder / name for name in _names())
    core.require_absent(*files, force=force or unfinished.exists())
    core.write_text(
        unfinished, "The demo that wrote these files has not ended: the next replaces them.\n"
    )
    robot = load_robot(ROBOT)
    motion, records = _make_recordings(folder, quick, lambda what, share: tell(what, 0.7 * share))
    tell("analyze the UR5", 0.7)
    analysis = analyze(robot)
    results: dict[str, Identification] = {}
    for k, (preset, thermal, name) in enumerate(ESTIMATES):
        tell(f"identify, {thermal}, preset {preset}", 0.7 + 0.05 * k)
        results[name] = identify(
            records[thermal, RECORDED[0]],
            robot,
            IdentifySettings(preset=preset),
            validation=records[thermal, RECORDED[1]],
        )
        identification.write_estimate(results[name].estimate, folder / f"{name}.json")
    paper, warm, best = (results[name] for _, _, name in ESTIMATES)
    change = compare(paper.estimate, warm.estimate)
    tell("write the report", 0.9)
    report(folder, folder / "report.html")
    tell("done", 1.0)
    demo = Demo(
        design=motion,
        best=best,
        paper=paper,
        change=change,
        table=(*_comparison(analysis, motion, paper, best), *_warming(change, robot.joints)),
        files=files,
        wall_s=time.perf_counter() - started,
    )
    core.write_json(files[-1], demo.to_json())
    unfinished.unlink(missing_ok=True)
    return demo


def _names() -> Generator[str]:
    """The files of a demo, its own last."""
    yield from (f"{name}.json" for name, _ in PURPOSES)
    for thermal in THERMAL:
        for what in RECORDED:
            yield f"{thermal}_{what}.parquet"
            yield truth_path(Path(f"{thermal}_{what}.parquet")).name
    yield from (f"{name}.json" for _, _, name in ESTIMATES)
    yield from ("report.html", "demo.json")
