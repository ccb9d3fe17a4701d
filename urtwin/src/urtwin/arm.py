"""The simulated arm under the controller: set points, measurements, profiles, blends, force mode.

Blends: a move with a blend radius hands over when it brakes and its tool is within the radius of
the way point. From there on the rest of its way is added to the next move, joint by joint: the arm
rounds the way point within the radius and keeps its speed on a straight way. Where no move follows,
the rest is moved alone.

Force mode: the controller lets the tool give way along chosen axes until the force there is the
one asked for. The simulated arm touches nothing: the force at its tool is zero, and along those
axes the tool moves on, in the direction of the force, as fast as force and limits allow. Where a
program moves the arm at the same time, that motion is the whole of it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.core import Array, InputError
from dynid.simulation import PlantState, SimulatedArm, SimulatedPlant, Thermal
from urtwin.kinematics import ToolKinematics, joint_speeds, rotation_matrix, to_matrix

PROGRAM_STOP = 80.0
"""How the arm brakes when nobody moves it any more [rad/s^2]."""
PROTECTIVE_STOP = 120.0
"""How it brakes in a protective stop [rad/s^2]."""
_AXES = 6
_OVERSHOOT, _MOVED = 1e-3, 0.1


class ControlledArm:
    """Holds the set point; without a command in a cycle it brakes to standstill.

    It begins at a pose (6) [rad], its joints as warm as `thermal` says; `rate_hz` is control cycles
    a second, `seed` that of the noise.

    Raises:
        InputError: Another number of joints than six, or what `SimulatedPlant` refuses.
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
        self.fastest = np.nan_to_num(self.limits.velocity, nan=np.inf).tolist()
        self.kinematics = ToolKinematics(arm.robot)
        self.plant = SimulatedPlant(arm, rate_hz=rate_hz, thermal=thermal, pose=pose)
        self.cycle = self.plant.cycle
        self._seed = seed
        self._generator = np.random.default_rng(seed)
        self.braking = PROGRAM_STOP
        self.setpoint: list[float] = [float(value) for value in pose]
        self.speed: list[float] = [0.0] * _AXES
        """Speed of the set point [rad/s]."""
        self.pending: list[float] | None = None
        """The set point of this cycle (6) [rad], if there is one; without, the arm brakes."""
        self._stopping: list[float] | None = None
        self.still = 0
        """Cycles for which the set point has not moved."""
        self.state: PlantState = self.plant.tick(self.setpoint)
        self._measure()

    def tick(self, *, powered: bool) -> None:
        """One control cycle; the arm stands still unless it is powered, its brakes open."""
        if not powered:
            self._stand()
            return
        if self.pending is None:
            self._rest()
        else:
            self._stopping = None
        last = self.setpoint
        target = self.pending if self.pending is not None else self._brake()
        self.pending = None
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
        """(6) what the sensors say of `position`, `velocity`, `current` or `temperature`."""
        state = self.state
        row, true = {
            "position": (0, state.q),
            "velocity": (1, state.dq),
            "current": (2, state.torque / self.truth.gain),
            "temperature": (3, state.temperature),
        }[quantity]
        return self.truth.sensors.seen(quantity, true, self._noise[row]).tolist()

    def draw_anew(self, number: int) -> None:
        """Begin the noise of the program of a number: it does not depend on when that was sent."""
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
        self.pending = None
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


@dataclass(frozen=True, slots=True)
class Trapezoid:
    """From rest to rest with constant acceleration, constant speed, constant deceleration."""

    length: float
    """Way to go [m or rad]."""
    peak: float
    """Largest speed reached [m/s or rad/s]."""
    acceleration: float
    """[m/s^2 or rad/s^2]."""

    @property
    def duration(self) -> float:
        """Time from rest to rest [s]."""
        if self.length == 0.0:
            return 0.0
        return self.length / self.peak + self.peak / self.acceleration

    def share(self, t: float) -> float:
        """Share of the way done at a time [s], 0 to 1."""
        total = self.duration
        if t >= total or self.length == 0.0:
            return 1.0
        ramp = self.peak / self.acceleration
        if t < ramp:
            way = 0.5 * self.acceleration * t * t
        elif t > total - ramp:
            way = self.length - 0.5 * self.acceleration * (total - t) ** 2
        else:
            way = self.peak * (t - 0.5 * ramp)
        return way / self.length


def trapezoid(length: float, speed: float, acceleration: float, time: float = 0.0) -> Trapezoid:
    """The profile of a move over a length, in m or rad and s; `InputError` for impossible numbers.

    A positive time takes the place of speed and acceleration, which have to be positive else.
    """
    if not all(map(math.isfinite, (length, speed, acceleration, time))):
        raise InputError("a move needs finite numbers", value=(length, speed, acceleration, time))
    if time > 0.0:
        # A quarter of the time each to speed up and to slow down.
        peak = length / (0.75 * time)
        return Trapezoid(length, peak, peak / (0.25 * time))
    if speed <= 0.0 or acceleration <= 0.0:
        raise InputError(
            "speed and acceleration of a move must be positive", value=(speed, acceleration)
        )
    return Trapezoid(length, min(speed, math.sqrt(length * acceleration)), acceleration)


@dataclass(slots=True)
class Rest:
    """What is left of a move that has handed over."""

    profile: Trapezoid
    place: Callable[[float], list[float]]
    """Joint positions (6) at a share of the way [rad]."""
    end: list[float]
    """(6) the way point [rad]."""
    t: float
    """Time since the move began [s]."""
    last: list[float]
    """(6) the last set point [rad]."""

    def next(self, step: float) -> list[float] | None:
        """(6) from the way point to the set point [rad], a step [s] later; None at the end."""
        self.t += step
        if self.t >= self.profile.duration:
            return None
        place = self.place(self.profile.share(self.t))
        return [q - e for q, e in zip(place, self.end, strict=True)]

    def alone(self, arm: ControlledArm, step: float) -> bool:
        """Move the arm on by a step [s], where no other move does; whether there is a way to go.

        An arm that was moved or stopped meanwhile is left alone.
        """
        if arm.setpoint != self.last:
            return False
        offset = self.next(step)
        self.last = (
            list(self.end)
            if offset is None
            else [e + d for e, d in zip(self.end, offset, strict=True)]
        )
        arm.pending = self.last
        return offset is not None


def hands_over(distance: Callable[[], float], profile: Trapezoid, t: float, radius: float) -> bool:
    """Whether a move lets the next one begin, at a time t since it began [s].

    It does while it brakes, once the tool is no further from the way point than the radius [m].
    """
    if radius <= 0.0 or not math.isfinite(radius) or profile.length == 0.0:
        return False
    braking = profile.duration - profile.peak / profile.acceleration
    return braking <= t < profile.duration and distance() <= radius


TO_THE_POINT, AS_GIVEN, ALONG_THE_MOTION = 1, 2, 3
"""Types of force mode: what becomes of the task frame."""
_RESISTANCE = np.array([200.0] * 3 + [20.0] * 3)
"""Of the free tool: force per speed [N.s/m], torque per speed [N.m.s/rad]; not published by UR."""
_ACCELERATION = np.array([1.0] * 3 + [4.0] * 3)
_SLOWEST = 1e-6


@dataclass(slots=True)
class ForceMode:
    """A force mode that is on."""

    frame: list[float]
    """(6) pose of the task frame in the base."""
    compliant: list[bool]
    """(6) axes of the task frame that give way."""
    wrench: list[float]
    """(6) force [N] and torque [N.m] asked for, in the task frame."""
    kind: int
    """One of the three types."""
    limits: list[float]
    """(6) largest speeds of compliant axes [m/s, rad/s]."""
    gain: float
    """Scales how the tool gives way."""

    def next(self, arm: ControlledArm, tcp: Array) -> list[float]:
        """(6) the set point of a cycle in which nothing else moves the arm [rad].

        The tool `tcp` (4, 4) is given in the flange [m].
        """
        tool, jacobian = arm.kinematics.jacobian(arm.setpoint, tcp)
        now = jacobian @ np.array(arm.speed)
        axes = self._axes(tool[:3, 3], now[:3])
        twice = np.kron(np.eye(2), axes)
        most = np.abs(np.array(self.limits))
        wish = self.gain * np.array(self.wrench) / _RESISTANCE
        wish = np.where(self.compliant, np.clip(wish, -most, most), 0.0)
        before = twice.T @ now
        change = _ACCELERATION * arm.cycle
        twist = twice @ (before + np.clip(wish - before, -change, change))
        speeds = joint_speeds(jacobian, twist)
        return [q + arm.cycle * dq for q, dq in zip(arm.setpoint, speeds, strict=True)]

    def _axes(self, point: Array, velocity: Array) -> Array:
        """(3, 3) the axes of the task frame in the base."""
        frame = to_matrix(self.frame)
        if self.kind == TO_THE_POINT:
            return _turned_to(1, frame[:3, 3] - point, frame[:3, :3])
        if self.kind == ALONG_THE_MOTION:
            along = frame[:3, :3].T @ velocity
            return _turned_to(0, frame[:3, :3] @ np.array([along[0], along[1], 0.0]), frame[:3, :3])
        return frame[:3, :3]


def _turned_to(axis: int, direction: Array, axes: Array) -> Array:
    """Axes of which one points in a direction, turned no more than that takes."""
    length = float(np.linalg.norm(direction))
    if length < _SLOWEST:
        return axes
    unit, present = direction / length, axes[:, axis]
    normal = np.cross(present, unit)
    sine, cosine = float(np.linalg.norm(normal)), float(present @ unit)
    if sine < _SLOWEST:
        return axes if cosine > 0 else -axes
    angle = math.atan2(sine, cosine)
    return rotation_matrix(normal / sine * angle) @ axes
