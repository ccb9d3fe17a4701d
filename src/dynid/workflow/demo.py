"""`dynid demo`: the main job on the simulated UR5, beside what the paper reports."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core.arrays import Array
from dynid.core.errors import InputError, JobError
from dynid.core.provenance import provenance
from dynid.identification.estimate_file import write_estimate, write_json
from dynid.recording.parquet import write_record
from dynid.recording.record import ExperimentRecord
from dynid.robot.load import load_robot
from dynid.robot.model import RobotModel
from dynid.simulation.library import simulated_arm
from dynid.simulation.run import simulate
from dynid.trajectory.files import write_trajectory
from dynid.trajectory.random_excitation import random_excitation
from dynid.workflow.analyze import Analysis, analyze
from dynid.workflow.demo_table import Row, comparison
from dynid.workflow.identify import Identification, identify
from dynid.workflow.identify_settings import IdentifySettings
from dynid.workflow.simulating import record_of, truth_to_json

PERIOD, HARMONICS, REPETITIONS, RATE_HZ = 10.0, 5, 3, 125.0
"""The paper's: seconds, harmonics, repetitions of the trajectory, samples a second."""
RECORDS = (("identification", 1), ("validation", 2))
"""Name and seed of the two recordings."""

Progress = Callable[[str, float], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Demo:
    """What the demo found and wrote."""

    analysis: Analysis
    best: Identification
    paper: Identification
    table: tuple[Row, ...]
    files: tuple[Path, ...]
    wall_s: float

    def to_json(self) -> dict[str, Any]:
        """The table paper / ours, the warnings of both presets, and the files."""
        return {
            "robot": "ur5",
            "table": [row.to_json() for row in self.table],
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
    """Analyze the UR5, record two motions of the simulated one, identify, validate, compare.

    The simulated arm is MuJoCo's, with friction richer than the model's; its currents become
    torques by the drive gains. The trajectories are random, not optimised.

    Args:
        directory: Where the files go; it is made.
        quick: One repetition of the trajectory in place of three.
        progress: Told what is being done and how far it is (0 to 1).

    Raises:
        InputError: The directory cannot be made or written to.
        JobError: The simulated arm ran away, the problem is singular, or a file cannot be written.
        MissingExtraError: MuJoCo is not installed.
    """
    started = time.perf_counter()
    tell: Progress = progress or _silent
    folder = _directory(Path(directory))
    robot = load_robot("ur5")
    tell("analyze the UR5", 0.0)
    analysis = analyze(robot)
    repetitions = 1 if quick else REPETITIONS
    records: list[ExperimentRecord] = []
    files: list[Path] = []
    for k, (name, seed) in enumerate(RECORDS):
        tell(f"simulate the {name} recording", 0.1 + 0.15 * k)
        record, written = _recording(robot, folder, name, seed, repetitions)
        records.append(record)
        files += written
    results: dict[str, Identification] = {}
    for k, preset in enumerate(("paper", "best")):
        tell(f"identify, preset {preset}", 0.4 + 0.1 * k)
        results[preset] = identify(
            records[:1],
            robot,
            IdentifySettings(preset=preset),
            validation=records[1],
            progress=lambda what, share: tell(f"identify, {what}", 0.5 + 0.45 * share),
        )
        path = folder / f"estimate_{preset}.json"
        write_estimate(results[preset].estimate, path)
        files.append(path)
    tell("done", 1.0)
    table = comparison(analysis, results["paper"], results["best"])
    demo = Demo(
        analysis=analysis,
        best=results["best"],
        paper=results["paper"],
        table=table,
        files=(*files, folder / "demo.json"),
        wall_s=time.perf_counter() - started,
    )
    write_json(demo.to_json(), folder / "demo.json")
    return demo


def _recording(
    robot: RobotModel, folder: Path, name: str, seed: int, repetitions: int
) -> tuple[ExperimentRecord, list[Path]]:
    """Simulate, write and hand back one recording, with its trajectory and truth beside it."""
    series = random_excitation(robot.limits, harmonics=HARMONICS, period=PERIOD, seed=seed)
    arm = simulated_arm(robot)
    run = simulate(arm, series, rate_hz=RATE_HZ, periods=repetitions, seed=seed)
    record = record_of(run)
    paths = [folder / f"{name}{end}" for end in (".parquet", "_trajectory.json", "_truth.json")]
    write_record(record, paths[0])
    made = provenance(settings={"harmonics": HARMONICS, "period": PERIOD}, seed=seed)
    try:
        write_trajectory(paths[1], series, robot=robot.name, limits=robot.limits, provenance=made)
    except OSError as error:
        raise JobError(
            "the trajectory cannot be written", where=str(paths[1]), value=error.strerror
        ) from error
    truth = truth_to_json(robot, arm.truth, run)
    write_json({**truth, "torque_rms": _rms(run.truth.torque)}, paths[2])
    return record, paths


def _silent(_what: str, _share: float) -> None:
    """Nobody is watching."""


def _rms(torque: Array) -> list[float]:
    return np.sqrt(np.square(torque).mean(axis=0)).tolist()


def _directory(path: Path) -> Path:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"cannot make the directory: {error.strerror or error}", where=str(path)
        ) from error
    return path
