"""`dynid run`: a design executed on a robot, simulated or real, and recorded.

Recordings of the simulated arm, in the form of a real one.
"""

import json
import math
import shlex
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np

from dynid import core, drivers, experiment, simulation
from dynid.recording import ExperimentRecord, RecordMetadata, RecordWriter
from dynid.robot import PARAMETERS, RobotLike, RobotModel, load_robot
from dynid.settings import RunSettings
from dynid.workflow import design_files, design_limits, recordings
from dynid.workflow.identify import PROMISED


def simulate_recording(
    robot: RobotLike,
    trajectory: design_files.DesignLike,
    *,
    rate_hz: float = 125.0,
    periods: int = 1,
    thermal: simulation.Thermal = "cold",
    seed: int = 0,
) -> ExperimentRecord:
    """Run a trajectory on the simulated arm of a robot; MuJoCo moves it, not our regressor.

    Args:
        robot: The robot, or its name or file; the UR5, or any with known masses. It carries its
            tool.
        trajectory: What to command: a trajectory, a design, or the file of either.
        rate_hz: Control cycles, and samples, a second.
        periods: How many times; more than once it must end as it starts.
        thermal: `cold`, `warm`, one temperature or one a joint [degC], at the start.
        seed: Seed of the measurement noise.

    Raises:
        InputError: A robot that cannot be simulated, or a trajectory that does not fit it.
        JobError: The simulated arm ran away.
        MissingExtraError: MuJoCo is not installed.
    """
    robot, motion = load_robot(robot), design_files.open_trajectory(trajectory)
    arm = _equipped_arm(robot)
    run = simulation.simulate(
        arm, motion, rate_hz=rate_hz, periods=periods, thermal=thermal, seed=seed
    )
    record = record_of(run)
    told = replace(
        record.metadata,
        robot=recordings.robot_reference(robot),
        joint_names=robot.joint_names,
        drive_gains=arm.made_up_gains,
    )
    return replace(record, metadata=told)


def record_of(run: simulation.SimulatedRun) -> ExperimentRecord:
    """What a recorder would have seen of a simulated run: no truth in it."""
    return ExperimentRecord(
        t=run.t,
        signals=run.signals,
        metadata=RecordMetadata(
            robot=run.robot,
            origin=f"simulated {run.robot}, seed {run.seed}",
            format="simulation",
            extra={
                "seed": str(run.seed),
                "start_degC": json.dumps([round(value, 2) for value in run.thermal]),
            },
        ),
    )


def truth_path(recording: Path) -> Path:
    """Where the truth of a simulated recording stands: beside it."""
    return recording.with_name(f"{recording.stem}_truth.json")


def write_truth(
    recording: Path, arm: simulation.SimulatedArm, temperature_degC: core.Array, **more: object
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
        "parameters": [*PARAMETERS, "Fc", "Fv", "Im"],
        "frame": "joint frames, tensors about their origins; Fc and Fv at mean_degC",
        "links": truth.standard_parameters_at(temperature_degC).tolist(),
        "drive_gain": truth.gain.tolist(),
        "friction_beyond_the_paper": {
            name: getattr(truth.friction, name).tolist()
            for name in ("breakaway", "stribeck_velocity", "load_factor")
        },
        **more,
    }
    core.write_json(truth_path(recording), data)


SIMULATED = "sim"
RATE_HZ = 125.0
Confirm = Callable[[str, str], None]
"""Shown what is about to move and the word that agrees to it; raises where nobody agrees."""
MOVED = 0.01
"""Joint motion between check and start that calls for another check [rad]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """What became of a run."""

    result: experiment.RunResult
    """How it ended."""
    record: Path | None
    """The recording, or what is left of it; None if there is none."""
    design: design_files.StoredDesign
    """What was executed."""
    left: Path | None = None
    """Where the rows of an earlier run are that was interrupted; None if there was none."""

    @property
    def abort(self) -> drivers.Abort | None:
        """Why it ended early; None if it did not."""
        return self.result.outcome.abort

    def to_json(self) -> dict[str, Any]:
        """The keys that `dynid run --json` prints."""
        outcome, abort = self.result.outcome, self.abort
        return {
            "samples": outcome.samples,
            "periods": outcome.periods,
            "gaps": outcome.gaps,
            "aborted": abort is not None,
            "cause": abort and {"code": abort.code, "message": abort.message},
            "record": self.record and str(self.record),
            "left": self.left and str(self.left),
            "digest": self.design.digest,
            "changed": list(self.design.changed),
        }

    def raise_if_aborted(self) -> None:
        """Turn a stop into an error.

        Raises:
            JobError: The robot was stopped; the message names the cause.
        """
        abort = self.abort
        if abort is None:
            return
        kept, step = "nothing is kept", abort.next_step
        if self.record is not None:
            kept = f"{self.result.outcome.samples} samples are kept in {self.record}"
            step = None
            if self.record.suffix != ".parquet":
                step = f"Read it: dynid import {shlex.quote(str(self.record))} -o OTHER.parquet"
        where = f"the robot was stopped in the pass '{self.result.stopped_in}'"
        if self.result.stopped_in is None:
            where = "nothing has moved"
        raise core.JobError(f"{where}: {abort.message}; {kept}", next_step=step)


def run_design(
    design: design_files.DesignLike,
    output: str | Path,
    *,
    on: str = SIMULATED,
    settings: RunSettings | None = None,
    confirm: Confirm | None = None,
    cancel: Event | None = None,
    progress: core.Progress | None = None,
) -> Run:
    """Execute a design and record it.

    Args:
        design: A design or its file, any trajectory file, or a trajectory beside the robot of the
            settings.
        output: The recording, `*.parquet`.
        on: `sim` for the simulated arm, which moves and carries what it is told without a
            certificate; `ur://HOST` for a UR controller.
        settings: How to run it.
        confirm: Shown what is about to move on a real robot; None agrees to everything.
        cancel: Stops the robot when it is set.
        progress: Told what is being done and how far it is (0 to 1).

    Returns:
        How it ended; a stop is no exception, see `Run.raise_if_aborted`.

    Raises:
        InputError: A design, robot or setting that cannot be used.
        JobError: The robot is not ready, cannot be reached, or the recording cannot be written.
        MissingExtraError: A package is missing.
    """
    asked = settings or RunSettings()
    path = Path(output)
    if path.suffix.lower() != ".parquet":
        raise core.InputError("a recording is a file *.parquet", where="output", value=str(path))
    if on == SIMULATED and asked.method != RunSettings().method:
        raise core.InputError(
            "the simulated arm takes no streamed set points",
            where="--method",
            value=asked.method,
            next_step="Leave it out, or stream to a controller: dynid controller, --on ur://HOST.",
        )
    with design_files.design_file(design, asked.robot) as file:
        loaded = load_design(file, asked)
    written = (path, truth_path(path)) if on == SIMULATED else (path,)
    core.require_absent(*written, force=asked.force)
    state = None if on == SIMULATED else drivers.inspect(_host(on))
    plan = experiment.ExperimentPlan(
        robot=loaded.robot,
        trajectory=loaded.stored.trajectory,
        periods=asked.repeat,
        settle=asked.settle,
        slow=asked.slow,
        warm_up_s=0.0 if state is None else asked.warm_up_s,
        rate_hz=RATE_HZ if state is None else state.rate_hz,
    )
    if state is None:
        driver = _simulated(loaded, asked)
        finished = _execute(plan, driver, loaded, asked, path, cancel, progress)
        if finished.record is not None and driver.states:
            torque = np.stack([state.torque for state in driver.states])
            write_truth(
                finished.record,
                driver.arm,
                np.mean([state.temperature for state in driver.states], axis=0),
                seed=driver.seed,
                torque_rms=np.sqrt(np.square(torque).mean(axis=0)).tolist(),
            )
        return finished
    ready = _made_ready(plan, state, loaded, asked, confirm, cancel, progress)
    if ready is None:
        outcome = drivers.Outcome(samples=0, periods=0, gaps=0, abort=drivers.INTERRUPTED)
        return Run(
            result=experiment.RunResult(outcome=outcome, stopped_in=None),
            record=None,
            design=loaded,
        )
    driver = drivers.ServojDriver(state) if asked.method == "servoj" else drivers.UrDriver(state)
    return _execute(ready, driver, loaded, asked, path, cancel, progress)


def load_design(path: Path, asked: RunSettings) -> design_files.StoredDesign:
    """Read a design, or any trajectory file, for the robot and what it carries.

    Raises:
        InputError: Not a design, or one for a robot that cannot be read.
    """
    found = design_files.read_design(
        path, robot=asked.robot, mount=asked.mount, mesh_dirs=asked.mesh_dirs
    )
    robot = design_limits.given_limits(asked, found.limits).equipped(found.robot)
    if asked.robot is None:
        return replace(found, robot=robot)
    stored = replace(found.stored, robot=recordings.robot_reference(asked.robot))
    return replace(found, robot=robot, stored=stored)


def _made_ready(
    plan: experiment.ExperimentPlan,
    state: drivers.ControllerState,
    loaded: design_files.StoredDesign,
    asked: RunSettings,
    confirm: Confirm | None,
    cancel: Event | None,
    progress: core.Progress | None,
) -> experiment.ExperimentPlan | None:
    """The plan with its way to the start: check the design, then the robot, then ask.

    None where `cancel` was set meanwhile.

    Raises:
        InputError: A design that must not run, or nobody agrees.
        JobError: The robot is not ready, or has moved since it was checked.
    """
    _, constraints = design_files.judge_of(loaded, asked)
    certificate = experiment.check_design(plan, constraints, asked.accept_unjudged)
    # What a person has to clear first is told at once, not after the search for a way.
    there = experiment.Approach(poses=np.stack([state.q, plan.start]))
    experiment.require_ready(experiment.check_robot(plan, state, there), state.host)
    approach = experiment.plan_approach(
        state.q, plan.start, constraints, cancel=cancel, progress=progress
    )
    if progress is not None:
        # What the search was told last says nothing of the robot, which comes next.
        progress("run", 0.0)
    if cancel is not None and cancel.is_set():
        return None
    checks = experiment.check_robot(plan, state, approach)
    experiment.require_ready(checks, state.host)
    if confirm is not None:
        lines = [f"{check.name}: {check.finding}" for check in checks]
        lines += [f"mounted as: {plan.robot.mount} (the robot cannot tell; look)"]
        lines += [f"NOT JUDGED: {item.kind}: {item.message}" for item in certificate.unjudged]
        lines += certificate.assumed
        if (said := loaded.describe_digest()) is not None:
            lines.append(said)
        lines += [
            f"{step.name}: {step.execution.settle + step.execution.periods} x "
            f"{step.execution.trajectory.duration:g} s"
            for step in plan.passes()
        ]
        confirm("\n".join(f"- {line}" for line in lines), state.host)
    # Planning and a person who thinks take time, in which others may have used the robot.
    now = drivers.inspect(state.host)
    experiment.require_ready(experiment.check_robot(plan, now, approach), state.host)
    away = float(np.abs(now.q - state.q).max())
    if away > MOVED:
        raise core.JobError(
            "the robot has moved since it was checked",
            where=state.host,
            value=f"{away:.3g} rad",
            limit=f"{MOVED:g} rad",
            next_step="Start again.",
        )
    return replace(plan, via=approach.via)


def _host(on: str) -> str:
    scheme, found, host = on.partition("://")
    # An IPv6 address has several colons.
    if (scheme, found) != ("ur", "://") or not host or "/" in host or host.count(":") == 1:
        limit = "sim, ur://HOST (a name or an address, no port: UR's ports are fixed)"
        raise core.InputError("unknown robot to run on", where="--on", value=on, limit=limit)
    return host.strip("[]")


def _equipped_arm(robot: RobotModel) -> simulation.SimulatedArm:
    arm = simulation.simulated_arm(robot, serial=simulation.SERIAL)
    if robot.tool.mass > 0:
        # Of its size nothing is said: all of it is where its centre is.
        arm = simulation.with_payload(arm, robot.tool.mass, robot.tool.com, np.zeros((3, 3)))
    return arm


def _simulated(loaded: design_files.StoredDesign, asked: RunSettings) -> drivers.SimulatedDriver:
    arm = _equipped_arm(loaded.robot)
    thermal = asked.thermal
    if asked.warm_up_s > 0:
        # Heat flows far more slowly than the arm moves: no need to simulate every second.
        thermal = simulation.warm_up(
            arm, loaded.stored.trajectory, asked.warm_up_s, thermal=thermal
        )
    return drivers.SimulatedDriver(arm, thermal=thermal, seed=asked.seed)


def _execute(
    plan: experiment.ExperimentPlan,
    driver: drivers.Driver,
    loaded: design_files.StoredDesign,
    asked: RunSettings,
    path: Path,
    cancel: Event | None,
    progress: core.Progress | None,
) -> Run:
    opened: list[RecordWriter] = []
    promise: dict[str, str] = {}
    if loaded.expected_percent is not None:
        promise[PROMISED] = repr(loaded.expected_percent / math.sqrt(plan.periods))

    def open_recorder() -> RecordWriter:
        source = driver.source
        metadata = RecordMetadata(
            robot=loaded.stored.robot,
            origin=source.origin,
            format=source.format,
            drive_gains=source.drive_gains,
            extra={
                **source.extra,
                "design_sha256": loaded.sha256,
                "period_s": repr(plan.trajectory.duration),
                "periods": str(plan.periods),
                "mount": plan.robot.mount,
                "thermal": str(asked.thermal),
                "payload_kg": repr(plan.robot.tool.mass),
                "method": asked.method,
                "settled": str(plan.settle),
                "warm_up_s": repr(asked.warm_up_s),
                **promise,
            },
        )
        opened.append(
            RecordWriter(
                path,
                plan.robot.joint_names,
                source.quantities,
                metadata,
                channels=source.channels,
                force=asked.force,
                expected_samples=round(plan.periods * plan.trajectory.duration * plan.rate_hz),
            )
        )
        return opened[0]

    result = experiment.run(plan, driver, open_recorder, cancel=cancel, progress=progress)
    # What was appended need not have been written: the disk is what counts.
    record = opened[0].record_path
    samples = opened[0].saved_samples if record.exists() else 0
    abort, outcome = result.outcome.abort, result.outcome
    if abort is not None:
        whole = samples // round(plan.trajectory.duration * plan.rate_hz)
        outcome = replace(outcome, samples=samples, periods=min(outcome.periods, whole))
    return Run(
        result=replace(result, outcome=outcome),
        record=record if samples >= 2 else None,
        design=loaded,
        left=opened[0].left,
    )
