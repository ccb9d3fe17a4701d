"""The simulated arm in motion, one control cycle at a time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from dynid.core.arrays import Array, frozen
from dynid.core.errors import InputError, JobError
from dynid.core.optional import require
from dynid.simulation.kernel import drive, predict
from dynid.simulation.mjcf import mujoco_model
from dynid.simulation.servo import Servo
from dynid.simulation.state import PlantState
from dynid.simulation.thermal import Thermal
from dynid.simulation.tracking import Tracker
from dynid.simulation.truth import SimulatedArm

PHYSICS_STEP = 5e-4
"""Longest step of the physics [s]."""
_SETTLING = 0.6
_RUNAWAY = 1e3


class Plant:
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
        self._tracker = Tracker(arm, self.cycle, steps)
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
        self._tracker.reset(pose)
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
        truth, temperature, target = self.arm.truth, self.temperature, self._tracker.now
        references = self._tracker.plan(command)
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
        self._tracker.follow(servo)

    @property
    def tracker(self) -> Tracker:
        """The controller's side: targets and the arm that it believes in."""
        return self._tracker

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
