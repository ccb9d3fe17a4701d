"""Power and brakes: the way from switched off to running takes its time."""

from __future__ import annotations

from dynid.protocol import RobotMode, SafetyMode
from dynid.simulation.controller.machine_core import Core

_BOOT_S, _RELEASE_S = 1.0, 0.5


class Power:
    """Robot modes from `POWER_OFF` to `RUNNING`.

    Args:
        core: The controller.
    """

    def __init__(self, core: Core) -> None:
        self._core = core
        self._wanted: RobotMode | None = None
        self._ready = 0.0

    def on(self) -> bool:
        """Switch on, up to closed brakes; not in a fault or an emergency stop."""
        if self._core.safety.mode > SafetyMode.RECOVERY:
            return False
        if self._core.mode == RobotMode.POWER_OFF:
            self._start(RobotMode.IDLE)
        return True

    def off(self) -> bool:
        """Close the brakes and switch off, at once."""
        self._wanted = None
        self._core.mode = RobotMode.POWER_OFF
        return True

    def release(self) -> bool:
        """Open the brakes, switching on first if need be."""
        if not self.on() or self._core.safety.stopped:
            return False
        if self._core.mode != RobotMode.RUNNING:
            self._start(RobotMode.RUNNING)
        return True

    def step(self) -> None:
        """One control cycle."""
        core = self._core
        if self._wanted is None or core.now < self._ready:
            return
        if core.mode == RobotMode.POWER_ON:
            core.mode = RobotMode.IDLE
            self._ready = core.now + _RELEASE_S
        elif self._wanted == RobotMode.RUNNING:
            core.mode = RobotMode.RUNNING
            core.arm.release()
        if core.mode == self._wanted:
            self._wanted = None

    def _start(self, wanted: RobotMode) -> None:
        core = self._core
        self._wanted = wanted
        if core.mode == RobotMode.POWER_OFF:
            core.mode = RobotMode.POWER_ON
            self._ready = core.now + _BOOT_S
        elif core.mode == RobotMode.IDLE:
            self._ready = core.now + _RELEASE_S
