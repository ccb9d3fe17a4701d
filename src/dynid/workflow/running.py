"""`dynid run`: a design executed on a robot, simulated or real, and recorded.

Recordings of the simulated arm, in the form of a real one.
"""

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np

from dynid.core import InputError, JobError, Progress, require_absent
from dynid.drivers import Abort, Driver, ServojDriver, SimulatedDriver, UrDriver, inspect
from dynid.experiment import ExperimentPlan, RunResult, run
from dynid.recording import ExperimentRecord, RecordMetadata, RecordWriter, partial_path
from dynid.robot import RobotLike, RobotModel, load_robot
from dynid.simulation import (
    SERIAL,
    SimulatedArm,
    SimulatedRun,
    Thermal,
    simulate,
    simulated_arm,
    warm_up,
    with_payload,
)
from dynid.workflow.design_files import (
    DesignLike,
    StoredDesign,
    TrajectoryLike,
    design_file,
    open_trajectory,
)
from dynid.workflow.identify import PROMISED
from dynid.workflow.run_settings import (
    Confirm,
    LoadedDesign,
    RunSettings,
    load_design,
    made_ready,
    mark_aborted,
    truth_path,
    write_truth,
)


def simulate_recording(
    robot: RobotLike,
    trajectory: TrajectoryLike,
    *,
    rate_hz: float = 125.0,
    periods: int = 1,
    thermal: Thermal = "cold",
    seed: int = 0,
) -> ExperimentRecord:
    """Run a trajectory on the simulated arm of a robot; MuJoCo moves it, not our regressor.

    Args:
        robot: The robot, or its name or file; the UR5, or any with known masses. It carries its
            tool.
        trajectory: What to command: a trajectory, a design, or the file of either.
        rate_hz: Control cycles, and samples, a second.
        periods: How many times the trajectory's duration.
        thermal: `cold`, `warm`, one temperature or one a joint [degC], at the start.
        seed: Seed of the measurement noise.

    Raises:
        InputError: A robot that cannot be simulated, or a trajectory that does not fit it.
        JobError: The simulated arm ran away.
        MissingExtraError: MuJoCo is not installed.
    """
    robot, motion = load_robot(robot), open_trajectory(trajectory)
    arm = _equipped_arm(robot)
    run = simulate(arm, motion, rate_hz=rate_hz, periods=periods, thermal=thermal, seed=seed)
    record = record_of(run)
    return replace(record, metadata=replace(record.metadata, joint_names=robot.joint_names))


def record_of(run: SimulatedRun) -> ExperimentRecord:
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


SIMULATED = "sim"
RATE_HZ = 125.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """What became of a run."""

    result: RunResult
    """How it ended."""
    record: Path | None
    """The recording, or what is left of it; None if there is none."""
    design: StoredDesign
    """What was executed."""

    @property
    def abort(self) -> Abort | None:
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
        kept, step = "nothing is kept", None
        if self.record is not None:
            kept = f"{self.result.outcome.samples} samples are kept in {self.record}"
            if self.record.suffix != ".parquet":
                step = f"Read it: dynid import {self.record} -o OTHER.parquet"
        where = f"the robot was stopped in the pass '{self.result.stopped_in}'"
        raise JobError(f"{where}: {abort.message}; {kept}", next_step=step)


def run_design(
    design: DesignLike,
    output: str | Path,
    *,
    on: str = SIMULATED,
    settings: RunSettings | None = None,
    confirm: Confirm | None = None,
    cancel: Event | None = None,
    progress: Progress | None = None,
) -> Run:
    """Execute a design and record it.

    Args:
        design: A design or its file, or any trajectory file.
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
    if on == SIMULATED and asked.method != RunSettings().method:
        raise InputError(
            "the simulated arm takes no streamed set points",
            where="--method",
            value=asked.method,
            next_step="Leave it out, or stream to a controller: dynid controller, --on ur://HOST.",
        )
    with design_file(design, asked.robot) as file:
        loaded = load_design(file, asked)
    written = (path, truth_path(path)) if on == SIMULATED else (path,)
    require_absent(*written, force=asked.force)
    state = None if on == SIMULATED else inspect(_host(on))
    plan = ExperimentPlan(
        robot=loaded.robot,
        trajectory=loaded.trajectory,
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
    plan = made_ready(plan, state, loaded, asked.accept_unjudged, confirm)
    driver = ServojDriver(state) if asked.method == "servoj" else UrDriver(state)
    return _execute(plan, driver, loaded, asked, path, cancel, progress)


def _host(on: str) -> str:
    scheme, found, host = on.partition("://")
    if (scheme, found) != ("ur", "://") or not host or "/" in host:
        raise InputError("unknown robot to run on", where="--on", value=on, limit="sim, ur://HOST")
    return host


def _equipped_arm(robot: RobotModel) -> SimulatedArm:
    arm = simulated_arm(robot, serial=SERIAL)
    if robot.tool.mass > 0:
        # Of its size nothing is said: all of it is where its centre is.
        arm = with_payload(arm, robot.tool.mass, robot.tool.com, np.zeros((3, 3)))
    return arm


def _simulated(loaded: LoadedDesign, asked: RunSettings) -> SimulatedDriver:
    arm = _equipped_arm(loaded.robot)
    thermal = asked.thermal
    if asked.warm_up_s > 0:
        # Heat flows far more slowly than the arm moves: no need to simulate every second.
        thermal = warm_up(arm, loaded.trajectory, asked.warm_up_s, thermal=thermal)
    return SimulatedDriver(arm, thermal=thermal, seed=asked.seed)


def _execute(
    plan: ExperimentPlan,
    driver: Driver,
    loaded: LoadedDesign,
    asked: RunSettings,
    path: Path,
    cancel: Event | None,
    progress: Progress | None,
) -> Run:
    opened: list[RecordWriter] = []

    def open_recorder() -> RecordWriter:
        source = driver.source
        metadata = RecordMetadata(
            robot=loaded.reference,
            origin=source.origin,
            format=source.format,
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
                **_promise(loaded, plan.periods),
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

    result = run(plan, driver, open_recorder, cancel=cancel, progress=progress)
    if not opened:
        return Run(result=result, record=None, design=loaded.stored)
    # What was appended need not have been written: the disk is what counts.
    samples, record = opened[0].saved_samples, opened[0].record_path
    abort, outcome = result.outcome.abort, result.outcome
    if abort is not None:
        if samples < 2:
            # One row is no recording: nothing is kept, and nothing lies about.
            partial_path(path).unlink(missing_ok=True)
        elif record.suffix == path.suffix:
            mark_aborted(record, abort)
        whole = int(samples / (plan.trajectory.duration * plan.rate_hz))
        outcome = replace(outcome, samples=samples, periods=min(outcome.periods, whole))
    return Run(
        result=replace(result, outcome=outcome),
        record=record if samples >= 2 else None,
        design=loaded.stored,
    )


def _promise(loaded: LoadedDesign, periods: int) -> dict[str, str]:
    """What the design promises for so many periods, where it does."""
    facts = loaded.stored.facts
    value = facts.get(PROMISED)
    if not isinstance(value, float):
        return {}
    return {PROMISED: repr(value * math.sqrt(facts.get("repetitions", 1) / periods))}
