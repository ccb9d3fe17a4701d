"""The safety system: what it watches, and the state machine of a protective stop."""

import math
from dataclasses import dataclass

import numpy as np

from dynid.core import Array, InputError
from dynid.protocol import SafetyMode, SafetyStatus
from urtwin.arm import ControlledArm

_AT_REST = 1e-4
"""Too slow to break any limit [rad/s]."""
_STOPPED = SafetyStatus.STOPPED_DUE_TO_SAFETY
_BITS = {
    SafetyMode.NORMAL: SafetyStatus.NORMAL,
    SafetyMode.PROTECTIVE_STOP: SafetyStatus.PROTECTIVE_STOPPED | _STOPPED,
    SafetyMode.FAULT: SafetyStatus.FAULT | _STOPPED,
}
"""The modes that the simulated controller knows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchedLimits:
    """What must not be exceeded; the defaults are a UR5's in PolyScope (`safety.conf.UR5`).

    A limit that is negative or no number is an `InputError`.
    """

    beyond_joint_speed: float = 0.2
    """How much faster than the arm says a joint may move: 3.3416 for a UR5's 3.1416 [rad/s]."""
    tool_speed: float = 1.5
    """Largest speed of the tool [m/s]; infinite for none."""
    momentum: float = 25.0
    """Largest momentum [kg.m/s]; infinite for none."""
    power: float = 300.0
    """Largest mechanical power [W]; infinite for none."""
    beyond_joint_range: float = 0.0524
    """How far beyond its range a joint may be sent [rad]."""
    sudden_change: float = 0.1
    """Largest change of a set point from one cycle to the next [rad]."""
    deviation: float = 0.12
    """Largest distance of a joint from its target [rad]."""
    unlock_after: float = 5.0
    """Time before a protective stop can be unlocked [s]."""

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value = getattr(self, name)
            if math.isnan(value) or value < 0:
                raise InputError(f"safety limit {name} must not be negative", value=value)


class Safety:
    """Whether the robot may move."""

    def __init__(self, limits: WatchedLimits) -> None:
        self.limits = limits
        self.mode = SafetyMode.NORMAL
        self.reason = ""
        """Why it stopped last."""
        self.since = -math.inf
        """Controller time of the last stop [s]."""

    @property
    def bits(self) -> int:
        """The RTDE variable `safety_status_bits`."""
        return int(_BITS[self.mode])

    @property
    def stopped(self) -> bool:
        """Whether a stop is in force."""
        return self.mode != SafetyMode.NORMAL

    def stop(self, reason: str, now: float) -> None:
        """Enter the protective stop at a controller time [s]; the screen says the reason."""
        self.mode, self.reason, self.since = SafetyMode.PROTECTIVE_STOP, reason, now

    def fail(self, reason: str, now: float) -> None:
        """Enter the fault, which only a restart of the safety system ends."""
        self.stop(reason, now)
        self.mode = SafetyMode.FAULT

    def restart(self) -> bool:
        """End a fault; whether there was one."""
        if self.mode != SafetyMode.FAULT:
            return False
        self.mode = SafetyMode.NORMAL
        return True

    def unlock(self, now: float) -> bool:
        """Leave the protective stop, if enough time has passed; says whether it did."""
        if self.mode != SafetyMode.PROTECTIVE_STOP:
            return False
        if now - self.since < self.limits.unlock_after - 1e-9:
            return False
        self.mode = SafetyMode.NORMAL
        return True

    def judge(self, arm: ControlledArm, tcp: Array) -> str | None:
        """What is wrong with the new set point or the state of an arm, or None.

        The tool `tcp` (4, 4) is given in the flange [m].
        """
        state, limits = arm.state, self.limits
        beyond = limits.beyond_joint_range
        for k, value in enumerate(arm.pending or ()):
            change = value - arm.setpoint[k]
            if not math.isfinite(value):
                return "C204A5: Path sanity check failed: Invalid setpoint"
            if value < arm.lower[k] - beyond or value > arm.upper[k] + beyond:
                return f"Joint {k}: position limit, set point {value:.4f} rad"
            if abs(change) > limits.sudden_change:
                return (
                    "C204A1: Path sanity check failed: Sudden change in target position "
                    f"of joint {k}: {change:+.4f} rad in one cycle"
                )
        speeds: list[float] = state.target.dq.tolist()
        if max(map(abs, speeds)) < _AT_REST and arm.still > 0:
            return None
        for k, speed in enumerate(map(abs, speeds)):
            if speed > (most := arm.fastest[k] + limits.beyond_joint_speed):
                return (
                    f"C191A{32 + k}: Joint {k} speed violation: {speed:.3f} rad/s, "
                    f"limit {most:.3f} rad/s"
                )
        deviation = float(np.max(np.abs(state.q - state.target.q)))
        if deviation > limits.deviation:
            return f"C153: Position deviates from path: {deviation:.3f} rad"
        speed = arm.plant.tracker.tool_speed(arm.tool_point(tcp))
        if speed > limits.tool_speed:
            return f"Tool speed limit: {speed:.3f} m/s, limit {limits.tool_speed:.3f} m/s"
        momentum = arm.plant.tracker.momentum()
        if momentum > limits.momentum:
            return f"Momentum limit: {momentum:.2f} kg.m/s, limit {limits.momentum:.2f} kg.m/s"
        power = float(np.sum(np.abs(state.torque * state.dq)))
        if power > limits.power:
            return f"Power limit: {power:.0f} W, limit {limits.power:.0f} W"
        return None
