"""Whatever moves a robot along a motion and records it: simulated or real."""

from dynid.drivers.driver import INTERRUPTED as INTERRUPTED
from dynid.drivers.driver import WATCHDOG_HZ as WATCHDOG_HZ
from dynid.drivers.driver import Abort as Abort
from dynid.drivers.driver import Cycle as Cycle
from dynid.drivers.driver import Driver as Driver
from dynid.drivers.driver import Execution as Execution
from dynid.drivers.driver import Outcome as Outcome
from dynid.drivers.driver import Recorder as Recorder
from dynid.drivers.driver import Source as Source
from dynid.drivers.driver import Watchdog as Watchdog
from dynid.drivers.driver import WatchLimits as WatchLimits
from dynid.drivers.driver import mode_name as mode_name
from dynid.drivers.simulated import SimulatedDriver as SimulatedDriver
from dynid.drivers.ur.driver import ServojDriver as ServojDriver
from dynid.drivers.ur.driver import UrDriver as UrDriver
from dynid.drivers.ur.variables import ControllerState as ControllerState
from dynid.drivers.ur.variables import inspect as inspect
