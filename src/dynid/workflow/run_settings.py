"""How to run a design, the files of a run, and what happens before a real robot moves."""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid.constraints import DISTANCES, RATIOS
from dynid.core import (
    Array,
    DynidError,
    Finding,
    InputError,
    JobError,
    check_word,
    file_hash,
    write_json,
)
from dynid.drivers import Abort, ControllerState, inspect
from dynid.experiment import ExperimentPlan, check_design, check_robot, plan_approach, require_ready
from dynid.recording import read_record, write_record
from dynid.robot import RobotLike, RobotModel
from dynid.simulation import SimulatedArm, Thermal
from dynid.trajectory import Trajectory
from dynid.workflow.analyze import unit_notes
from dynid.workflow.design_files import StoredDesign, read_design
from dynid.workflow.design_settings import DesignLimits, given_limits
from dynid.workflow.recordings import robot_reference

METHODS = ("program", "servoj")
DEGC = (-40, 120)
"""Joint temperatures that are believed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSettings:
    """How to run a design; what is None is not asked for.

    Raises:
        InputError: An unknown method, or a number that makes no sense.
    """

    repeat: int = 3
    """Periods to record."""
    settle: bool = False
    """Move one period before them that is not recorded."""
    slow: float | None = None
    """Speed of a first pass, as a share."""
    warm_up_s: float = 0.0
    """Time to repeat the motion before the recording [s]."""
    thermal: Thermal = "cold"
    """Thermal state: set on the simulated arm, noted down for a real one."""
    seed: int = 0
    """Seed of the simulated noise."""
    method: str = "program"
    """`program`: the controller evaluates the motion; `servoj`: set points are streamed."""
    robot: RobotLike | None = None
    """The robot, or its name or file, where the design's has moved."""
    mount: str | None = None
    """Mounting, where it is not the design's."""
    scene: str | Path | None = None
    """Scene file, where the surroundings are not the design's."""
    mesh_dirs: tuple[str | Path, ...] | None = None
    """Folders where meshes of a URDF are looked for; None for the design's."""
    floor: float | str | None = None
    """Height of the floor [m], `mount` or `none`; None for the design's."""
    tool: tuple[float, ...] | None = None
    """(3) the tool's point in the flange's frame [m]; None for the design's."""
    payload: tuple[float, ...] | None = None
    """(4) mass that the flange carries [kg] and its centre [m]; None for the design's."""
    accept_unjudged: tuple[str, ...] = ()
    """Kinds of limits that need not be judged before a real robot moves."""
    force: bool = False
    """Replace a recording that exists, once the new one is complete."""

    def __post_init__(self) -> None:
        kinds = tuple(kind.replace("-", "_") for kind in self.accept_unjudged)
        object.__setattr__(self, "accept_unjudged", kinds)
        check_word(self.method, METHODS, "--method")
        for kind in kinds:
            check_word(kind, (*RATIOS, *DISTANCES), "--accept-unjudged")
        time_s, slow = self.warm_up_s, 1.0 if self.slow is None else self.slow
        for holds, what, where, value, limit in (
            (self.repeat >= 1, "needs a period to record", "--repeat", self.repeat, "1 or more"),
            (0 <= time_s < math.inf, "the time to warm up", "--warm-up", time_s, "0 s or more"),
            (0 < slow <= 1, "the share of the speed", "--slow", slow, "above 0, at most 1"),
        ):
            if not holds:
                raise InputError(what, where=where, value=value, limit=limit)


def parse_thermal(text: str) -> Thermal:
    """Read `--thermal`: `cold`, `warm` or degC.

    Raises:
        InputError: Another word.
    """
    if text in ("cold", "warm"):
        return text
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not DEGC[0] <= value <= DEGC[1]:
        raise InputError(
            "unknown thermal state",
            where="--thermal",
            value=text,
            limit=f"cold, warm, or {DEGC[0]} to {DEGC[1]} degC",
        )
    return value


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadedDesign:
    """What a run needs of a design."""

    stored: StoredDesign
    """As it was read, its robot with the tool."""
    reference: str
    """Built-in name or path of that robot."""
    limits: DesignLimits
    """All that is safe, in the surroundings that it was made for."""
    sha256: str
    """Of the file."""

    @property
    def robot(self) -> RobotModel:
        """The robot it was made for, as mounted, with its tool."""
        return self.stored.robot

    @property
    def trajectory(self) -> Trajectory:
        """One period."""
        return self.stored.stored.trajectory


def load_design(path: Path, asked: RunSettings) -> LoadedDesign:
    """Read a design, or any trajectory file, for the robot and surroundings asked for.

    Raises:
        InputError: Not a design, or one for a robot that cannot be read.
    """
    found = read_design(path, robot=asked.robot, mount=asked.mount, mesh_dirs=asked.mesh_dirs)
    # A design for the paper's limits may still not run on a robot: safe ones hold there.
    limits = given_limits(
        "safe",
        True,
        asked.scene,
        found.limits,
        floor=asked.floor,
        tool=asked.tool,
        payload=asked.payload,
    )
    return LoadedDesign(
        stored=replace(found, robot=limits.equipped(found.robot)),
        reference=found.stored.robot if asked.robot is None else robot_reference(asked.robot),
        limits=limits,
        sha256=file_hash(path),
    )


def mark_aborted(path: Path, abort: Abort) -> None:
    """Write the cause of a stop into a recording, as metadata and as a finding."""
    # The disk that refused the rows refuses this too; the rows themselves stay readable.
    with suppress(DynidError):
        record = read_record(path)
        if not any(problem.kind == "aborted" for problem in record.problems):
            said = Finding("aborted", f"aborted after {record.samples} samples: {abort.message}")
            record = replace(record, problems=(*record.problems, said))
        extra = {**record.metadata.extra, "aborted": abort.message, "abort": abort.code}
        write_record(replace(record, metadata=replace(record.metadata, extra=extra)), path)


def truth_path(recording: Path) -> Path:
    """Where the truth of a simulated recording stands: beside it."""
    return recording.with_name(f"{recording.stem}_truth.json")


def write_truth(
    recording: Path, arm: SimulatedArm, temperature_degC: Array, **more: object
) -> None:
    """Write what a simulated arm was made of beside its recording; reports draw it.

    Fc and Fv are those at (n) mean joint temperatures of the recording.

    Raises:
        InputError: A place where no such file can be.
        JobError: The disk does not take it.
    """
    truth = arm.truth
    data: dict[str, Any] = {
        "robot": arm.robot.name,
        "label": truth.label,
        "mean_degC": temperature_degC.tolist(),
        "parameters": [
            *("m", "mx", "my", "mz", "Jxx", "Jyy", "Jzz", "Jyz", "Jxz", "Jxy"),
            *("Fc", "Fv", "Im"),
        ],
        "frame": "joint frames, tensors about their origins; Fc and Fv at mean_degC",
        "links": truth.standard_parameters_at(temperature_degC).tolist(),
        "drive_gain": truth.gain.tolist(),
        "friction_beyond_the_paper": {
            name: getattr(truth.friction, name).tolist()
            for name in ("breakaway", "stribeck_velocity", "load_factor")
        },
        **more,
    }
    write_json(truth_path(recording), data)


Confirm = Callable[[str, str], None]
"""Shown what is about to move and the word that agrees to it; raises where nobody agrees."""
MOVED = 0.01
"""Joint motion between check and start that calls for another check [rad]."""


def made_ready(
    plan: ExperimentPlan,
    state: ControllerState,
    loaded: LoadedDesign,
    accepted: tuple[str, ...],
    confirm: Confirm | None,
) -> ExperimentPlan:
    """The plan with its way to the start: check the design, then the robot, then ask.

    Kinds of limits that are `accepted` need not be judged.

    Raises:
        InputError: A design that must not run, or nobody agrees.
        JobError: The robot is not ready, or has moved since it was checked.
    """
    constraints = loaded.limits.constraints(loaded.robot)
    certificate = check_design(plan, constraints, accepted)
    approach = plan_approach(state.q, plan.start, constraints)
    checks = check_robot(plan, state, approach)
    require_ready(checks, state.host)
    if confirm is not None:
        lines = [f"{check.name}: {check.finding}" for check in checks]
        lines += [f"mounted as: {plan.robot.mount} (the robot cannot tell; look)"]
        lines += [f"NOT JUDGED: {item.kind}: {item.message}" for item in certificate.unjudged]
        lines += [*unit_notes(plan.robot), *certificate.notes]
        if (said := loaded.stored.describe_digest()) is not None:
            lines.append(said)
        lines += [
            f"{step.name}: {step.execution.settle + step.execution.periods} x "
            f"{step.execution.trajectory.duration:g} s"
            for step in plan.passes()
        ]
        confirm("\n".join(f"- {line}" for line in lines), state.host)
        # The way was planned from where the robot stood before a person thought it over.
        away = float(np.abs(inspect(state.host).q - state.q).max())
        if away > MOVED:
            raise JobError(
                "the robot has moved since it was checked",
                where=state.host,
                value=f"{away:.3g} rad",
                limit=f"{MOVED:g} rad",
                next_step="Start again.",
            )
    return replace(plan, via=approach.via)
