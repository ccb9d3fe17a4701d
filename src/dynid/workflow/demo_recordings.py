"""The demo's designs and recordings: through the simulated controller, in virtual time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dynid.core.errors import JobError
from dynid.core.progress import Progress
from dynid.excitation.design import ExcitationDesign
from dynid.recording.parquet import read_record
from dynid.recording.record import ExperimentRecord
from dynid.simulation.controller.process import controller_process
from dynid.workflow.design_settings import DesignSettings
from dynid.workflow.designing import design
from dynid.workflow.run_settings import RunSettings
from dynid.workflow.running import run_design

PERIOD_S, HARMONICS, REPETITIONS = 10.0, 5, 3
"""The paper's: length and harmonics of the trajectory, and how often it is repeated."""
PURPOSES = (("design", 1), ("validation_design", 2))
"""Name and seed of the two motions: one to identify from, one to check with."""
THERMAL = ("cold", "warm")
STARTS = 2
"""Starts of the search for a motion; more would find a slightly better one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Recordings:
    """Two motions of the UR5, recorded cold and warm."""

    design: ExcitationDesign
    """The motion that is identified from."""
    identification: dict[str, ExperimentRecord]
    """`cold` and `warm`."""
    validation: dict[str, ExperimentRecord]
    """The other motion, `cold` and `warm`."""
    files: tuple[Path, ...]


def make_recordings(robot: str, folder: Path, quick: bool, tell: Progress) -> Recordings:
    """Design two motions and run them on a simulated controller, cold and warm.

    Args:
        robot: A built-in robot with a simulated arm.
        folder: Where the files go.
        quick: One repetition in place of three, and a shorter search.
        tell: Told what is being done and how far it is (0 to 1).

    Raises:
        JobError: No feasible motion was found, or a run was stopped.
        MissingExtraError: MuJoCo is not installed.
    """
    designs: list[ExcitationDesign] = []
    files: list[Path] = []
    for k, (name, seed) in enumerate(PURPOSES):
        tell(f"design a motion ({k + 1} of {len(PURPOSES)})", k / 4)
        settings = DesignSettings(
            harmonics=HARMONICS,
            period_s=PERIOD_S,
            starts=1 if quick else STARTS,
            seed=seed,
            jobs=1,
        )
        path = folder / f"{name}.json"
        designs.append(design(robot, settings, output=path))
        if designs[-1].interrupted:
            raise KeyboardInterrupt
        if not designs[-1].feasible:
            raise JobError("the search found no motion within the limits", where=str(path))
        files.append(path)
    recorded: dict[str, dict[str, ExperimentRecord]] = {name: {} for name, _ in PURPOSES}
    repetitions = 1 if quick else REPETITIONS
    for k, thermal in enumerate(THERMAL):
        # One controller a thermal state and motion: each recording starts at that temperature.
        for name, seed in PURPOSES:
            what = "identification" if name == "design" else "validation"
            tell(f"run on the simulated controller: {thermal}, {what}", 0.5 + k / 4)
            path = folder / f"{thermal}_{what}.parquet"
            with controller_process(
                robot, thermal=thermal, virtual_time=True, seed=10 * seed + k
            ) as controller:
                run_design(
                    folder / f"{name}.json",
                    path,
                    on=f"ur://{controller.host}",
                    settings=RunSettings(repeat=repetitions, thermal=thermal),
                ).raise_if_aborted()
            recorded[name][thermal] = read_record(path)
            files.append(path)
    return Recordings(
        design=designs[0],
        identification=recorded["design"],
        validation=recorded["validation_design"],
        files=tuple(files),
    )
