"""The simulated arm under the controller: one set point a cycle, and what is measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynid.core import Array, InputError
from dynid.simulation.controller.machine_kinematics import ToolKinematics
from dynid.simulation.friction import Thermal
from dynid.simulation.plant import Plant
from dynid.simulation.servo import PlantState
from dynid.simulation.truth import SimulatedArm

PROGRAM_STOP = 80.0
"""How the arm brakes when nobody moves it any more [rad/s^2]."""
PROTECTIVE_STOP = 120.0
"""How it brakes in a protective stop [rad/s^2]."""
_AXES = 6
_OVERSHOOT, _MOVED = 1e-3, 0.1


class ControlledArm:
    """Holds the set point; without a command in a cycle it brakes to standstill.

    Args:
        arm: The simulated arm, six joints.
        rate_hz: Control cycles a second.
        thermal: Temperatures at the start.
        seed: Seed of the noise.
        pose: (6) where it stands at the start [rad].

    Raises:
        InputError: Another number of joints, or what `Plant` refuses.
    """

    def __init__(
        self, arm: SimulatedArm, rate_hz: float, thermal: Thermal, seed: int, pose: Sequence[float]
    ) -> None:
        if arm.robot.joints != _AXES:
            raise InputError(
                "a UR controller moves six joints", where=arm.robot.name, value=arm.robot.joints
            )
        self.truth, self.servo = arm.truth, arm.servo
        self.limits = arm.robot.limits
        self._flange = arm.robot.flange
        self.lower = np.nan_to_num(self.limits.lower, nan=-np.inf).tolist()
        self.upper = np.nan_to_num(self.limits.upper, nan=np.inf).tolist()
        self.kinematics = ToolKinematics(arm.robot)
        self.plant = Plant(arm, rate_hz=rate_hz, thermal=thermal)
        self.cycle = self.plant.cycle
        self._seed = seed
        self._generator = np.random.default_rng(seed)
        self.braking = PROGRAM_STOP
        self.setpoint: list[float] = [float(value) for value in pose]
        self.speed: list[float] = [0.0] * _AXES
        """Speed of the set point [rad/s]."""
        self._next: list[float] | None = None
        self._stopping: list[float] | None = None
        self.still = 0
        """Cycles for which the set point has not moved."""
        self.plant.reset(self.setpoint)
        self.state: PlantState = self.plant.tick(self.setpoint)
        self._measure()

    def command(self, q: list[float]) -> None:
        """The set point of this cycle (6) [rad]."""
        self._next = q

    @property
    def commanded(self) -> bool:
        """Whether this cycle has a set point."""
        return self._next is not None

    def refuse(self) -> None:
        """Forget the set point of this cycle: brake."""
        self._next = None

    @property
    def pending(self) -> list[float] | None:
        """The set point of this cycle (6) [rad], if there is one."""
        return self._next

    def tick(self, *, powered: bool) -> None:
        """One control cycle.

        Args:
            powered: Whether the brakes are open.
        """
        if not powered:
            self._stand()
            return
        if self._next is None:
            self._rest()
        else:
            self._stopping = None
        last = self.setpoint
        target = self._next if self._next is not None else self._brake()
        self._next = None
        self.speed = [(a - b) / self.cycle for a, b in zip(target, last, strict=True)]
        self.still = self.still + 1 if target == last else 0
        self.setpoint = target
        self.state = self.plant.tick(target)
        self._measure()

    def tool_point(self, tcp: Array) -> Array:
        """(3) the tool's point in the last joint frame, for a tool (4, 4) in the flange [m]."""
        return (self._flange @ tcp)[:3, 3]

    def release(self) -> None:
        """Open the brakes: the servo takes over where the arm stands."""
        self.setpoint = self.state.q.tolist()
        self.speed = [0.0] * _AXES
        self.plant.reset(self.setpoint)

    def measured(self, quantity: str) -> list[float]:
        """(6) what the sensors say in this cycle.

        Args:
            quantity: `position`, `velocity`, `current` or `temperature`.
        """
        row, true = self._true(quantity)
        sensors = self.truth.sensors
        noise: Array = getattr(sensors, f"{quantity}_noise")
        step: Array = getattr(sensors, f"{quantity}_step")
        noisy: Array = true + noise * self._noise[row]
        grid: Array = np.where(step > 0, step, 1.0)
        read: Array = np.where(step > 0, grid * np.round(noisy / grid), noisy)
        return read.tolist()

    def _true(self, quantity: str) -> tuple[int, Array]:
        state = self.state
        if quantity == "position":
            return 0, state.q
        if quantity == "velocity":
            return 1, state.dq
        if quantity == "current":
            return 2, state.torque / self.truth.gain
        return 3, state.temperature

    def draw_anew(self, number: int) -> None:
        """Begin the noise of a program: it does not depend on when the program was sent.

        Args:
            number: How many programs were started before, and this one.
        """
        self._generator = np.random.default_rng((self._seed, number))

    def _measure(self) -> None:
        # Drawn every cycle, so that the noise does not depend on who listens.
        self._noise = self._generator.standard_normal((4, _AXES))

    def _rest(self) -> None:
        """Hold a joint where it came to rest.

        A stop that asks for more torque than there is overshoots; the servo must not pull the
        joint back.
        """
        state = self.state
        if self._stopping is None:
            speeds: list[float] = state.dq.tolist()
            self._stopping = speeds if max(map(abs, speeds)) > _MOVED else []
            return
        if not self._stopping:
            return
        setpoint = list(self.setpoint)
        for joint, before in enumerate(self._stopping):
            q, dq, ddq = (float(part[joint]) for part in (state.q, state.dq, state.ddq))
            late = abs(q - state.target.q[joint]) > _OVERSHOOT and abs(before) > _MOVED
            # The state is one cycle old: the joint may come to rest before the next is seen.
            rests = dq * ddq < 0.0 and abs(dq) < 2.0 * self.cycle * abs(ddq)
            if late and (rests or before * dq < 0.0):
                setpoint[joint] = q - dq * dq / (2.0 * ddq) if rests else q
                self.plant.tracker.rest(joint, setpoint[joint])
                self.speed[joint], self._stopping[joint] = 0.0, 0.0
        self.setpoint = setpoint

    def _brake(self) -> list[float]:
        fastest = max(abs(value) for value in self.speed)
        if fastest == 0.0:
            return self.setpoint
        share = max(0.0, 1.0 - self.braking * self.cycle / fastest)
        return [
            q + share * speed * self.cycle
            for q, speed in zip(self.setpoint, self.speed, strict=True)
        ]

    def _stand(self) -> None:
        zero = np.zeros(_AXES)
        plant = self.plant
        plant.temperature = self.truth.thermal.after(plant.temperature, zero, self.cycle)
        target = replace(
            self.state.target, q=self.state.q, dq=zero, ddq=zero, moment=zero, feedforward=zero
        )
        self._next = None
        self.speed = [0.0] * _AXES
        self.state = replace(
            self.state,
            dq=zero,
            ddq=zero,
            torque=zero,
            friction=zero,
            temperature=plant.temperature,
            target=target,
        )
        self._measure()
