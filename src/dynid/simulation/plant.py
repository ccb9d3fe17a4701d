"""The simulated arm in motion: one control cycle, a whole run, half an hour of warming up."""

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.core import Array, InputError, JobError, frozen, read_only, require
from dynid.simulation.joints import PlantState, Servo, Thermal
from dynid.simulation.kernel import Tracker, drive, mujoco_model, predict
from dynid.simulation.truth import SimulatedArm
from dynid.trajectory import Trajectory

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

    Raises:
        InputError: A rate outside 10 to 1000 Hz, a thermal state that is none, or inertias that
            no rigid body has.
        MissingExtraError: MuJoCo is not installed.
    """

    def __init__(
        self, arm: SimulatedArm, *, rate_hz: float = 125.0, thermal: Thermal = "cold"
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
        self.reset(np.zeros(arm.robot.joints))

    def reset(self, q: ArrayLike) -> None:
        """Stand still at a pose, servo on, until the joints have settled under their load.

        Temperatures stay; the time starts at zero.

        Args:
            q: (n) pose [rad or m].

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
        """The state now; then one control cycle with a new set point.

        Args:
            setpoint: (n) commanded positions [rad or m].

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
        self._motion, self._out = np.zeros((2, n)), np.zeros((5, n))

    def _advance(self, reference: Array) -> None:
        """One physics step.

        Raises:
            JobError: The simulated arm ran away.
        """
        predict(self._qvel, self._motion[0], self._motion[1], self._step)
        self._first_half(self._model, self._data)
        for spring in self.arm.robot.counterbalances:
            joint = spring.joint
            self._joint[1, joint] = spring.torque(self._q[joint : joint + 1])[0]
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
    plant = SimulatedPlant(arm, rate_hz=rate_hz, thermal=thermal)
    count = max(round(trajectory.duration * periods * rate_hz), 2)
    command = trajectory.evaluate(np.arange(count) / rate_hz)
    if command.q.shape[1] != arm.robot.joints:
        raise InputError(
            "joints of the trajectory", value=command.q.shape[1], limit=arm.robot.joints
        )
    start = plant.temperature
    plant.reset(command.q[0])
    states = [plant.tick(setpoint) for setpoint in command.q]

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
        t=command.t,
        command_q=command.q,
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
