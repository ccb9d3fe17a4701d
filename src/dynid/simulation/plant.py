"""The simulated arm in motion: one control cycle, a whole run, half an hour of warming up."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.core import Array, InputError, JobError, frozen, read_only, require
from dynid.simulation.joints import PlantState, Servo, Target, Thermal
from dynid.simulation.kernel import Tracker, drive, mujoco_model, predict
from dynid.simulation.library import GroundTruth, SimulatedArm
from dynid.trajectory import Repetition, Trajectory

PHYSICS_STEP = 5e-4
"""Longest step of the physics [s]."""
_SETTLING = 0.6
_RUNAWAY = 1e3


class SimulatedPlant:
    """The arm's physics in MuJoCo under its servo; `reset` puts it to a pose, `tick` moves it.

    Args:
        arm: The simulated arm.
        rate_hz: Control cycles a second.
        thermal: `cold`, `warm`, one temperature or one a joint [degC].
        pose: Where it stands first (n) [rad or m]; None for zeros.

    Raises:
        InputError: A rate outside 10 to 1000 Hz, a thermal state or pose that is none, or inertias
            that no rigid body has.
        MissingExtraError: MuJoCo is not installed.
    """

    def __init__(
        self,
        arm: SimulatedArm,
        *,
        rate_hz: float = 125.0,
        thermal: Thermal = "cold",
        pose: ArrayLike | None = None,
    ) -> None:
        if not 10 <= rate_hz <= 1000:
            raise InputError("control rate", value=rate_hz, limit="10 to 1000 Hz")
        self.arm = arm
        self.cycle = 1.0 / rate_hz
        """Length of a control cycle [s]."""
        self.temperature = arm.truth.thermal.start(thermal)
        """(n) joint temperatures now [degC]."""
        self.heat = np.zeros(arm.robot.joints)
        """(n) losses since the reset [J]."""
        steps = math.ceil(self.cycle / PHYSICS_STEP - 1e-9)
        self._step = self.cycle / steps
        self.tracker = Tracker(arm, self.cycle, steps)
        """The controller's side: targets and the arm that it believes in."""
        self._load_physics()
        self._load_constants()
        self.reset(np.zeros(arm.robot.joints) if pose is None else pose)

    def reset(self, q: ArrayLike) -> None:
        """Stand still at a pose (n) [rad or m], servo on, until joints settled under their load.

        Temperatures stay; the time starts at zero.

        Raises:
            InputError: Another number of joints, or a pose that is not finite.
        """
        pose = frozen(q, shape=(self.arm.robot.joints,), name="pose")
        self._q[:] = pose
        for array in (self._qvel, self._motion, self._out, self._dry[5]):
            array[...] = 0.0
        self.tracker.reset(pose)
        temperature = self.temperature
        self._cycles = 0
        for _ in range(round(_SETTLING / self.cycle)):
            self.tick(pose)
        self.temperature = temperature
        self.heat[:] = 0.0
        self._cycles = 0

    def tick(self, setpoint: ArrayLike) -> PlantState:
        """The state now; then one control cycle with a new set point (n) [rad or m].

        Raises:
            InputError: Another number of joints, or a set point that is not finite.
            JobError: The simulated arm ran away.
        """
        command = frozen(setpoint, shape=(self.arm.robot.joints,), name="set point")
        truth, temperature, target = self.arm.truth, self.temperature, self.tracker.now
        references = self.tracker.plan(command)
        self._joint[4] = truth.friction.coulomb_at(temperature)
        self._joint[5] = truth.friction.viscous_at(temperature)
        self._out[3:] = 0.0
        q = self._q.copy()
        self._advance(references[0])
        # Positions lie in the middle between the velocities of two steps (leapfrog).
        before, after = self._motion[0], self._qvel
        dq, ddq = (before + after) / 2.0, (after - before) / self._step
        torque, friction = self._out[0].copy(), self._out[1].copy()
        for reference in references[1:]:
            self._advance(reference)
        self.heat += self._out[3]
        self.temperature = truth.thermal.after(temperature, self._out[3], self.cycle)
        self._cycles += 1
        return PlantState(
            t=(self._cycles - 1) * self.cycle,
            q=q,
            dq=dq,
            ddq=ddq,
            torque=torque,
            friction=friction,
            temperature=temperature,
            target=target,
            saturated=self._out[4] > 0,
        )

    def tune(self, servo: Servo) -> None:
        """Go on with another lookahead and gain, as each `servoj` may ask."""
        self._loop[:] = servo.bandwidth, servo.bandwidth**2
        self.tracker.follow(servo)

    def _load_physics(self) -> None:
        mujoco = require("mujoco", "sim")
        truth = self.arm.truth
        self._model = mujoco_model(self.arm.robot, truth.inertials, truth.motor_inertia, self._step)
        self._data = data = mujoco.MjData(self._model)
        self._first_half, self._second_half = mujoco.mj_step1, mujoco.mj_step2
        # Asking MjData for an array costs as much as the arithmetic on it: ask once.
        self._q, self._qvel = data.qpos, data.qvel
        self._forces = (data.M, data.qfrc_bias, data.qpos, data.qvel, data.qfrc_applied)

    def _load_constants(self) -> None:
        """The arrays that `drive` reads and writes; their rows are named there."""
        robot, truth, servo = self.arm.robot, self.arm.truth, self.arm.servo
        n, friction = robot.joints, truth.friction
        limit = np.where(np.isnan(robot.limits.torque), np.inf, robot.limits.torque)
        winding = truth.thermal.winding / truth.gain**2
        zero = np.zeros(n)
        self._loop = np.array([servo.bandwidth, servo.bandwidth**2])
        self._width = friction.width or 0.0
        self._joint = np.array([limit, zero, truth.motor_inertia, winding, zero, zero])
        self._dry = np.array(
            [
                friction.breakaway,
                friction.stribeck_velocity,
                friction.load_factor,
                friction.stiffness,
                friction.damping,
                zero,
            ]
        )
        if friction.width is not None:
            self._dry[[0, 2]] = 0.0
        self._motion, self._out = np.zeros((2, n)), np.zeros((5, n))

    def _advance(self, reference: Array) -> None:
        """One physics step.

        Raises:
            JobError: The simulated arm ran away.
        """
        predict(self._qvel, self._motion[0], self._motion[1], self._step)
        self._first_half(self._model, self._data)
        if self.arm.robot.counterbalances:
            self._joint[1] = 0.0
        for spring in self.arm.robot.counterbalances:
            joint = spring.joint
            self._joint[1, joint] += spring.torque(self._q[joint : joint + 1])[0]
        fastest = drive(
            *self._forces,
            reference,
            self._loop,
            self._motion,
            self._joint,
            self._dry,
            self._out,
            self._step,
            self._width,
        )
        # Before MuJoCo notices and writes a log file into the working directory.
        if fastest > _RUNAWAY:
            raise JobError(
                "the simulated arm ran away",
                where=self.arm.robot.name,
                value=fastest,
                limit=_RUNAWAY,
                next_step="Ask for a smoother motion or a lower servo gain.",
            )
        self._second_half(self._model, self._data)


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedRun:
    """A recording of the simulated arm."""

    robot: str
    """Name of the robot."""
    rate_hz: float
    """Samples a second."""
    seed: int
    """Seed of the noise."""
    thermal: tuple[float, ...]
    """(n) temperatures at the start [degC]."""
    t: Array
    """(N) time [s]."""
    signals: dict[str, Array]
    """What was recorded, (N, n) each; see `recorded`."""
    truth: PlantState
    """The same without noise, (N, n)."""


def stacked(states: Sequence[PlantState]) -> PlantState:
    """Several states as one with arrays (N, n); the time is that of the first."""

    def stack(items: Sequence[object], name: str) -> NDArray[Any]:
        values = np.stack([getattr(item, name) for item in items])
        values.setflags(write=False)
        return values

    targets = [state.target for state in states]
    names = {item.name for item in fields(PlantState)} - {"t", "target"}
    return PlantState(
        t=states[0].t,
        target=Target(**{item.name: stack(targets, item.name) for item in fields(Target)}),
        **{name: stack(states, name) for name in names},
    )


def recorded(
    truth: GroundTruth, state: PlantState, generator: np.random.Generator
) -> dict[str, Array]:
    """What sensors and controller report of states (..., n), by the names of a recording."""
    gain, read, target = truth.gain, truth.sensors.read, state.target
    return {
        "q": read("position", state.q, generator),
        "qd": read("velocity", state.dq, generator),
        "current": read("current", state.torque / gain, generator),
        "target_q": target.q,
        "target_qd": target.dq,
        "target_qdd": target.ddq,
        "target_current": target.feedforward / gain,
        "target_moment": target.moment,
        "temperature": read("temperature", state.temperature, generator),
    }


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
        periods: How many times; more than once it must end as it starts.
        thermal: `cold`, `warm`, one temperature or one a joint [degC], at the start.
        seed: Seed of the measurement noise.

    Raises:
        InputError: What `Repetition` or `SimulatedPlant` refuses, or a trajectory for another
            number of joints.
        JobError: The simulated arm ran away.
        MissingExtraError: MuJoCo is not installed.
    """
    motion = Repetition(part=trajectory, times=periods)
    first = motion.evaluate(np.zeros(1)).q[0]
    if len(first) != arm.robot.joints:
        raise InputError("joints of the trajectory", value=len(first), limit=arm.robot.joints)
    plant = SimulatedPlant(arm, rate_hz=rate_hz, thermal=thermal, pose=first)
    start = plant.temperature
    count = max(round(motion.duration * rate_hz), 2)
    command = motion.evaluate(np.arange(count) / rate_hz)
    truth = stacked([plant.tick(setpoint) for setpoint in command.q])
    signals = recorded(arm.truth, truth, np.random.default_rng(seed))
    return SimulatedRun(
        robot=arm.robot.name,
        rate_hz=rate_hz,
        seed=seed,
        thermal=tuple(float(value) for value in start),
        t=command.t,
        signals={name: read_only(values) for name, values in signals.items()},
        truth=truth,
    )


def warm_up(
    arm: SimulatedArm,
    trajectory: Trajectory,
    seconds: float = 1800.0,
    *,
    thermal: Thermal = "cold",
    looks: int = 12,
) -> Array:
    """The temperatures after repeating a trajectory for a long time.

    Heat flows far more slowly than the arm moves, so one period is simulated `looks` times on
    the way and its mean loss is held in between.

    Args:
        arm: The simulated arm.
        trajectory: What to repeat.
        seconds: For how long [s].
        thermal: `cold`, `warm`, one temperature or one a joint [degC], at the start.
        looks: How often the losses are looked at.

    Returns:
        (n) temperatures [degC].

    Raises:
        InputError: As `simulate`, or a time or number of looks that is not positive.
        JobError: The simulated arm ran away.
    """
    if not (math.isfinite(seconds) and seconds > 0) or looks < 1:
        raise InputError("seconds and looks must be positive", value=(seconds, looks))
    plant = SimulatedPlant(arm, thermal=thermal)
    count = max(round(trajectory.duration / plant.cycle), 2)
    command = trajectory.evaluate(np.arange(count) * plant.cycle).q
    temperature = plant.temperature
    for _ in range(looks):
        plant.temperature = temperature
        plant.reset(command[0])
        for setpoint in command:
            plant.tick(setpoint)
        power = plant.heat / (count * plant.cycle)
        stretch = seconds / looks
        temperature = arm.truth.thermal.after(temperature, power * stretch, stretch)
    return temperature
