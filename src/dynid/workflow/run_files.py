"""The files of a run: the design it starts from, the mark of a stop, the truth of a simulation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core.errors import DynidError
from dynid.core.files import write_json
from dynid.core.provenance import file_hash
from dynid.drivers.simulated import SimulatedDriver
from dynid.drivers.watchdog import Abort
from dynid.recording.parquet import read_record, write_record
from dynid.robot.model import RobotModel
from dynid.trajectory.trajectory import Trajectory
from dynid.workflow.design_files import read_design
from dynid.workflow.design_limits import DesignLimits, given_limits
from dynid.workflow.recordings import robot_reference
from dynid.workflow.run_settings import RunSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedDesign:
    """What a run needs of a design."""

    trajectory: Trajectory
    """One period."""
    robot: RobotModel
    """The robot it was made for, as mounted."""
    reference: str
    """Built-in name or path of that robot."""
    limits: DesignLimits
    """All that is safe, in the surroundings that it was made for."""
    sha256: str
    """Of the file."""


def load_design(path: Path, asked: RunSettings) -> LoadedDesign:
    """Read a design, or any trajectory file.

    Args:
        path: The file.
        asked: Another robot, mounting or scene than the design's.

    Raises:
        InputError: Not a design, or one for a robot that cannot be read.
    """
    found = read_design(path, robot=asked.robot, mount=asked.mount)
    limits = given_limits("safe", True, None if asked.scene is None else Path(asked.scene))
    if asked.scene is None and found.limits is not None:
        # A design for the paper's limits may still not run on a robot: safe ones hold there.
        limits = replace(found.limits, preset="safe", collision=True)
    return LoadedDesign(
        trajectory=found.stored.trajectory,
        robot=found.robot,
        reference=found.stored.robot if asked.robot is None else robot_reference(asked.robot),
        limits=limits,
        sha256=file_hash(path),
    )


def mark_aborted(path: Path, abort: Abort) -> bool:
    """Write the cause of a stop into the metadata of a recording.

    Args:
        path: The recording; only its partial file may be there.
        abort: The cause.

    Returns:
        Whether there is a recording with at least two samples.
    """
    try:
        record = read_record(path)
        if path.exists():
            extra = {**record.metadata.extra, "aborted": abort.message, "abort": abort.code}
            write_record(replace(record, metadata=replace(record.metadata, extra=extra)), path)
    except DynidError:
        # The disk that refused the rows refuses this too; the rows themselves stay readable.
        return path.exists()
    return True


def truth_path(recording: Path) -> Path:
    """Where the truth of a simulated recording stands: beside it."""
    return recording.with_name(f"{recording.stem}_truth.json")


def write_truth(recording: Path, driver: SimulatedDriver) -> None:
    """Write what the simulated arm was made of; nothing but tests reads it.

    Raises:
        InputError: A place where no such file can be.
        JobError: The disk does not take it.
    """
    if not driver.states:
        return
    truth = driver.arm.truth
    temperature = np.mean([state.temperature for state in driver.states], axis=0)
    torque = np.stack([state.torque for state in driver.states])
    data: dict[str, Any] = {
        "robot": driver.arm.robot.name,
        "label": truth.label,
        "seed": driver.seed,
        "mean_degC": temperature.tolist(),
        "parameters": [
            *("m", "mx", "my", "mz", "Jxx", "Jyy", "Jzz", "Jyz", "Jxz", "Jxy"),
            *("Fc", "Fv", "Im"),
        ],
        "frame": "joint frames, tensors about their origins; Fc and Fv at mean_degC",
        "links": truth.standard_parameters_at(temperature).tolist(),
        "drive_gain": truth.gain.tolist(),
        "torque_rms": np.sqrt(np.square(torque).mean(axis=0)).tolist(),
        "friction_beyond_the_paper": {
            "breakaway": truth.friction.breakaway.tolist(),
            "stribeck_velocity": truth.friction.stribeck_velocity.tolist(),
            "load_factor": truth.friction.load_factor.tolist(),
        },
    }
    write_json(truth_path(recording), data)
