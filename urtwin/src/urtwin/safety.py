"""The safety system: what it watches, and the state machine of a protective stop."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from dynid.core import InputError
from dynid.protocol import SafetyMode, SafetyStatus

_EMERGENCY = SafetyStatus.EMERGENCY_STOPPED
_BITS = {
    SafetyMode.NORMAL: SafetyStatus.NORMAL,
    SafetyMode.REDUCED: SafetyStatus.REDUCED,
    SafetyMode.PROTECTIVE_STOP: SafetyStatus.PROTECTIVE_STOPPED,
    SafetyMode.RECOVERY: SafetyStatus.RECOVERY,
    SafetyMode.SAFEGUARD_STOP: SafetyStatus.SAFEGUARD_STOPPED,
    SafetyMode.SYSTEM_EMERGENCY_STOP: SafetyStatus.SYSTEM_EMERGENCY_STOPPED | _EMERGENCY,
    SafetyMode.ROBOT_EMERGENCY_STOP: SafetyStatus.ROBOT_EMERGENCY_STOPPED | _EMERGENCY,
    SafetyMode.VIOLATION: SafetyStatus.VIOLATION,
    SafetyMode.FAULT: SafetyStatus.FAULT,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchedLimits:
    """What must not be exceeded; the defaults are a UR5's in PolyScope (`safety.conf.UR5`).

    Raises:
        InputError: A limit that is not positive.
    """

    joint_speed: float = 3.3416
    """Largest joint speed [rad/s]."""
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
    """Whether the robot may move.

    Args:
        limits: What is watched.
    """

    def __init__(self, limits: WatchedLimits) -> None:
        self.limits = limits
        self.mode = SafetyMode.NORMAL
        self.reason = ""
        """Why it stopped last."""
        self.since = -math.inf
        """Controller time of the last stop [s]."""
        self.popup = False
        """Whether the stop's message is still on the screen."""

    @property
    def bits(self) -> int:
        """The RTDE variable `safety_status_bits`."""
        stopped = self.mode not in (SafetyMode.NORMAL, SafetyMode.REDUCED)
        bit = _BITS[self.mode]
        return int(bit | SafetyStatus.STOPPED_DUE_TO_SAFETY if stopped else bit)

    @property
    def stopped(self) -> bool:
        """Whether a stop is in force."""
        return self.mode != SafetyMode.NORMAL

    def stop(self, reason: str, now: float) -> None:
        """Enter the protective stop.

        Args:
            reason: What the screen says.
            now: Controller time [s].
        """
        self.mode, self.reason, self.since = SafetyMode.PROTECTIVE_STOP, reason, now
        self.popup = True

    def fail(self, reason: str, now: float) -> None:
        """Enter the fault, which only a restart of the safety system ends."""
        self.stop(reason, now)
        self.mode = SafetyMode.FAULT

    def restart(self) -> bool:
        """End a fault; whether there was one."""
        if self.mode != SafetyMode.FAULT:
            return False
        self.mode, self.popup = SafetyMode.NORMAL, False
        return True

    def unlock(self, now: float) -> bool:
        """Leave the protective stop, if enough time has passed; says whether it did."""
        if self.mode != SafetyMode.PROTECTIVE_STOP:
            return False
        if now - self.since < self.limits.unlock_after - 1e-9:
            return False
        self.mode, self.popup = SafetyMode.NORMAL, False
        return True

    def judge_setpoint(
        self,
        new: Sequence[float],
        old: Sequence[float],
        lower: Sequence[float],
        upper: Sequence[float],
    ) -> str | None:
        """What is wrong with a set point [rad], or None."""
        limits = self.limits
        for k, value in enumerate(new):
            if not math.isfinite(value):
                return "C204A5: Path sanity check failed: Invalid setpoint"
            beyond = limits.beyond_joint_range
            if value < lower[k] - beyond or value > upper[k] + beyond:
                return f"Joint {k}: position limit, set point {value:.4f} rad"
            if abs(value - old[k]) > limits.sudden_change:
                return (
                    "C204A1: Path sanity check failed: Sudden change in target position "
                    f"of joint {k}: {value - old[k]:+.4f} rad in one cycle"
                )
        return None
