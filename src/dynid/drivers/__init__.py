"""Whatever moves a robot along a motion and records it: simulated, replayed, real."""

from dynid.drivers.driver import (
    Abort,
    Cycle,
    Driver,
    Execution,
    Outcome,
    Recorder,
    Source,
    Watchdog,
    WatchLimits,
    mode_name,
)
from dynid.drivers.simulated import SimulatedDriver
from dynid.drivers.ur.driver import ServojDriver, UrDriver
from dynid.drivers.ur.state import ControllerState, inspect

__all__ = [
    "Abort",
    "ControllerState",
    "Cycle",
    "Driver",
    "Execution",
    "Outcome",
    "Recorder",
    "ServojDriver",
    "SimulatedDriver",
    "Source",
    "UrDriver",
    "WatchLimits",
    "Watchdog",
    "inspect",
    "mode_name",
]
