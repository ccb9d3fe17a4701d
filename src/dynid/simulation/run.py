"""A whole run of the simulated arm: what it would have recorded, and the truth behind it."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from dynid.core.arrays import Array, read_only
from dynid.core.errors import InputError
from dynid.simulation.plant import Plant
from dynid.simulation.state import PlantState
from dynid.simulation.thermal import Thermal
from dynid.simulation.truth import SimulatedArm
from dynid.trajectory.trajectory import Trajectory


@dataclass(frozen=True, slots=True, kw_only=True)
class RunTruth:
    """What really happened; all arrays (N, n)."""

    q: Array
    """Positions [rad or m]."""
    dq: Array
    """Velocities [rad/s or m/s]."""
    ddq: Array
    """Accelerations [rad/s^2 or m/s^2]."""
    torque: Array
    """Motor torques, joint side [N.m]."""
    friction: Array
    """Friction torques [N.m]."""
    temperature: Array
    """Joint temperatures [degC]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedRun:
    """A recording of the simulated arm, all arrays (N, n) unless said otherwise."""

    robot: str
    """Name of the robot."""
    rate_hz: float
    """Samples a second."""
    seed: int
    """Seed of the noise."""
    thermal: tuple[float, ...]
    """(n) temperatures at the start [degC]."""
    gain: Array
    """(n) joint torque per motor current [N.m/A]."""
    t: Array
    """(N) time [s]."""
    command_q: Array
    """Positions that the trajectory asked for [rad or m]."""
    target_q: Array
    """Positions that the servo aimed at: the command, delayed and smoothed [rad or m]."""
    target_qd: Array
    """Velocities that it aimed at [rad/s or m/s]."""
    target_qdd: Array
    """Accelerations that it aimed at [rad/s^2 or m/s^2]."""
    target_moment: Array
    """Torques of the controller's own point-mass model at the target [N.m]."""
    target_current: Array
    """Currents of that model and its friction [A]."""
    q_measured: Array
    """Positions by the encoders [rad or m]."""
    qd_measured: Array
    """Velocities by the controller [rad/s or m/s]."""
    current: Array
    """Motor currents [A]."""
    temperature: Array
    """Joint temperatures by their sensors [degC]."""
    saturated: NDArray[np.bool_]
    """Whether a joint hit its torque limit in that cycle."""
    truth: RunTruth
    """The same without noise."""


def simulate(
    arm: SimulatedArm,
    trajectory: Trajectory,
    *,
    rate_hz: float = 125.0,
    periods: int = 1,
    thermal: Thermal = "cold",
    seed: int = 0,
) -> SimulatedRun:
    """Run a trajectory on the simulated arm and record it.

    The arm settles at the first pose before the time starts. Then every control cycle records a
    sample and sends the trajectory's position at that time; the servo follows it some
    `lookahead` later, so the first period begins with a transient.

    Args:
        arm: The simulated arm.
        trajectory: What to command.
        rate_hz: Control cycles, and samples, a second.
        periods: How many times the trajectory's duration.
        thermal: `cold`, `warm`, one temperature or one a joint [degC], at the start.
        seed: Seed of the measurement noise.

    Raises:
        InputError: Periods that are not positive, a trajectory for another number of joints, or
            what `Plant` refuses.
        JobError: The simulated arm ran away.
        MissingExtraError: MuJoCo is not installed.
    """
    if periods < 1:
        raise InputError("periods must be positive", value=periods)
    plant = Plant(arm, rate_hz=rate_hz, thermal=thermal)
    count = max(round(trajectory.duration * periods * rate_hz), 2)
    command = trajectory.evaluate(np.arange(count) / rate_hz)
    if command.q.shape[1] != arm.robot.joints:
        raise InputError(
            "joints of the trajectory", value=command.q.shape[1], limit=arm.robot.joints
        )
    start = plant.temperature
    plant.reset(command.q[0])
    states = [plant.tick(setpoint) for setpoint in command.q]
    return _recording(arm, states, command.t, command.q, rate_hz, seed, start)


def _recording(
    arm: SimulatedArm,
    states: list[PlantState],
    t: Array,
    command_q: Array,
    rate_hz: float,
    seed: int,
    start: Array,
) -> SimulatedRun:
    def stack(name: str) -> Array:
        return read_only(np.stack([getattr(state, name) for state in states]))

    def aimed(name: str) -> Array:
        return read_only(np.stack([getattr(state.target, name) for state in states]))

    truth = RunTruth(**{item.name: stack(item.name) for item in fields(RunTruth)})
    gain, generator = arm.truth.gain, np.random.default_rng(seed)

    saturated = np.stack([state.saturated for state in states])
    saturated.setflags(write=False)

    def measured(quantity: str, true: Array) -> Array:
        return read_only(arm.truth.sensors.read(quantity, true, generator))

    return SimulatedRun(
        robot=arm.robot.name,
        rate_hz=rate_hz,
        seed=seed,
        thermal=tuple(float(value) for value in start),
        gain=gain,
        t=t,
        command_q=command_q,
        target_q=aimed("q"),
        target_qd=aimed("dq"),
        target_qdd=aimed("ddq"),
        target_moment=aimed("moment"),
        target_current=read_only(aimed("feedforward") / gain),
        q_measured=measured("position", truth.q),
        qd_measured=measured("velocity", truth.dq),
        current=measured("current", truth.torque / gain),
        temperature=measured("temperature", truth.temperature),
        saturated=saturated,
        truth=truth,
    )
