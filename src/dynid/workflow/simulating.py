"""Recordings of the simulated arm, in the form of a real one."""

from __future__ import annotations

import json
from dataclasses import replace

from dynid.recording.record import ExperimentRecord, RecordMetadata
from dynid.robot.model import RobotModel
from dynid.simulation.library import simulated_arm
from dynid.simulation.run import SimulatedRun, simulate
from dynid.simulation.thermal import Thermal
from dynid.trajectory.trajectory import Trajectory


def simulate_recording(
    robot: RobotModel,
    trajectory: Trajectory,
    *,
    rate_hz: float = 125.0,
    periods: int = 1,
    thermal: Thermal = "cold",
    seed: int = 0,
) -> ExperimentRecord:
    """Run a trajectory on the simulated arm of a robot; MuJoCo moves it, not our regressor.

    Args:
        robot: The robot; the UR5, or any with known masses.
        trajectory: What to command.
        rate_hz: Control cycles, and samples, a second.
        periods: How many times the trajectory's duration.
        thermal: `cold`, `warm`, one temperature or one a joint [degC], at the start.
        seed: Seed of the measurement noise.

    Raises:
        InputError: A robot that cannot be simulated, or a trajectory that does not fit it.
        JobError: The simulated arm ran away.
        MissingExtraError: MuJoCo is not installed.
    """
    run = simulate(
        simulated_arm(robot),
        trajectory,
        rate_hz=rate_hz,
        periods=periods,
        thermal=thermal,
        seed=seed,
    )
    record = record_of(run)
    return replace(record, metadata=replace(record.metadata, joint_names=robot.joint_names))


def record_of(run: SimulatedRun) -> ExperimentRecord:
    """What a recorder would have seen of a simulated run: no truth in it."""
    return ExperimentRecord(
        t=run.t,
        signals={
            "q": run.q_measured,
            "qd": run.qd_measured,
            "current": run.current,
            "target_q": run.target_q,
            "target_qd": run.target_qd,
            "target_qdd": run.target_qdd,
            "target_current": run.target_current,
            "target_moment": run.target_moment,
            "temperature": run.temperature,
        },
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
