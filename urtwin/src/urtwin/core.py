"""What the parts of the controller share: registers, signals, messages, payload, watchdogs."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from dynid import core, protocol, simulation
from urtwin import interpreter, kinematics, network, urscript
from urtwin.arm import PROTECTIVE_STOP, ControlledArm, ForceMode, Rest
from urtwin.safety import Safety

COUNT = 48
"""Integer and double registers in each direction."""
BITS = 128
"""Boolean registers in each direction."""
FLAGS = 32
"""Flags that programs set and read, nobody else."""
_INT_MIN, _INT_MAX = -(2**31), 2**31 - 1
_STORED: dict[str, Callable[[float], float]] = {
    "int": lambda value: min(max(int(value), _INT_MIN), _INT_MAX),
    "double": float,
    "bit": bool,
}
"""What a register of each kind keeps of a value."""
PROGRAM_STARTED, PROGRAM_STOPPED = "PROGRAM_XXX_STARTED", "PROGRAM_XXX_STOPPED"
"""Titles by which clients know that a program began or ended."""
MESSAGES_KEPT = 1000
START_CYCLES_S = 60
"""Controller time at the start [s]: clients take less than 40 s for a robot that just booted."""
_HISTORY_S = 1.0
_LONGEST = 2_000
_SCALING_RATE = 4.0


class Registers:
    """Registers of one direction, as scripts and RTDE see them: `int`, `double` and `bit`.

    They are counted from zero; who reads or writes one has checked that it exists.
    """

    def __init__(self) -> None:
        self.banks: dict[str, list[Any]] = {
            "int": [0] * COUNT,
            "double": [0.0] * COUNT,
            "bit": [False] * BITS,
        }

    def write(self, kind: str, index: int, value: float) -> None:
        """Store a value in a register; integers are cut to 32 bits."""
        self.banks[kind][index] = _STORED[kind](value)

    def word(self, first: int) -> int:
        """Thirty-two boolean registers from `first` on, as one number."""
        return sum(1 << k for k in range(32) if self.banks["bit"][first + k])

    def set_word(self, first: int, value: float) -> None:
        """Thirty-two boolean registers from `first` on, from one whole number."""
        for k in range(32):
            self.banks["bit"][first + k] = bool(int(value) >> k & 1)


class Signals:
    """Digital and analog signals; bits: 8 standard, 8 configurable, 2 of the tool."""

    def __init__(self) -> None:
        self.digital_in = 0
        self.digital_out = 0
        self.analog_in: list[float] = [0.0, 0.0]
        self.analog_out: list[float] = [0.0, 0.0]
        """Share of the range, 0 to 1."""
        self.analog_types = 0
        self.tool_voltage = 0
        self.modbus: dict[str, Any] = {}
        """Modbus signals by name: a number, or a list where the signal has several registers."""
        self.flags = [False] * FLAGS
        """What programs remember between runs."""

    def masked(self, mask: int, value: int, shift: int) -> None:
        """Set the outputs that a mask names to bits of a value; the first is bit `shift`."""
        keep = self.digital_out & ~(mask << shift)
        self.digital_out = keep | (value & mask) << shift


class MessageKind(Enum):
    """What sort of message it is."""

    TEXT = "a text"
    KEY = "the beginning or the end of a program; the title tells which"
    POPUP = "a window on the screen"
    EXCEPTION = "what is wrong with a script; the title is UR's name for it"
    STOP = "a stop by the safety system"
    NOTE = "what a real controller would not say; for people beside the simulated one"


@dataclass(frozen=True, slots=True)
class Message:
    """Something for the screen or the log of the controller."""

    text: str
    source: str
    """`program`, `safety` or `controller`."""
    level: int
    """As in RTDE: 0 exception, 1 error, 2 warning, 3 information."""
    timestamp: float
    """Controller time [s]."""
    kind: MessageKind = MessageKind.TEXT
    title: str = ""
    """What stands above the text."""
    line: int = 0
    """Of an exception: the line of the script, from one; 0 where it has none."""
    blocking: bool = False
    """Of a window: whether the program waits until it is closed."""

    @property
    def words(self) -> str:
        """All of it in one line, for people."""
        return f"{self.title}: {self.text}" if self.title and not self.line else self.text


@dataclass(slots=True)
class ToolPayload:
    """What the controller believes the tool carries."""

    mass: float = 0.0
    """[kg]"""
    cog: list[float] = field(default_factory=lambda: [0.0] * 3)
    """(3) centre of gravity in the flange [m]."""
    inertia: list[float] = field(default_factory=lambda: [0.0] * 6)
    """(6) Ixx, Iyy, Izz, Ixy, Ixz, Iyz [kg.m^2]."""


@dataclass(slots=True)
class InputWatchdog:
    """An input that a client must keep writing."""

    variable: str
    period: float
    """Longest silence [s]; infinite for none."""
    action: str
    """`ignore`, `pause` or `stop`."""
    fed: float
    """Controller time of the last write [s]."""


class Core:
    """The state of a controller: arm, registers, signals, safety, tool and messages."""

    def __init__(
        self, arm: ControlledArm, safety: Safety, rate_hz: float, version: tuple[int, int, int, int]
    ) -> None:
        self.arm, self.safety, self.rate_hz, self.version = arm, safety, rate_hz, version
        self.cycles = 0
        self.inputs, self.outputs, self.signals = Registers(), Registers(), Signals()
        self.mode = protocol.RobotMode.RUNNING
        self.messages: deque[Message] = deque(maxlen=MESSAGES_KEPT)
        self.network = network.Network(network.on_this_machine)
        self.interpreter = interpreter.Interpreter()
        self.payload = ToolPayload()
        self.tcp = [0.0] * 6
        self.tcp_matrix: core.Array = np.eye(4)
        self.gravity: list[float] = (-arm.plant.arm.robot.gravity).tolist()
        """(3) as in `set_gravity`: the acceleration that keeps the base from falling."""
        self.speed_fraction = 1.0
        """The speed slider."""
        self.scaling = 1.0
        """Share of the trajectory time that passes: follows the slider. `servoj` ignores it."""
        self.lacking: set[str] = set()
        self.random = np.random.default_rng(0)
        self._mover: object = None
        self._tuning = (arm.servo.lookahead, arm.servo.gain)
        self.watchdogs: dict[str, InputWatchdog] = {}
        self.paused = False
        self.playing = False
        self.teaching = False
        self.blocking_popup = False
        self.force: ForceMode | None = None
        """The force mode that is on."""
        self.force_gain = 1.0
        """How much the tool gives way in the next one."""
        self.rest: Rest | None = None
        """What a move has left to the next one, in a blend."""
        self.history: deque[list[float]] = deque(maxlen=round(_HISTORY_S * rate_hz))
        """Joint positions of the last second, newest first."""

    @property
    def now(self) -> float:
        """Controller time [s]."""
        return (START_CYCLES_S * self.rate_hz + self.cycles) / self.rate_hz

    @property
    def runtime(self) -> protocol.RuntimeState:
        """Whether a program plays, is paused, or neither."""
        if not self.playing:
            return protocol.RuntimeState.STOPPED
        return protocol.RuntimeState.PAUSED if self.paused else protocol.RuntimeState.PLAYING

    def scale(self) -> None:
        """Let the speed scaling follow the slider, without a jump."""
        wanted = 0.0 if self.safety.stopped else self.speed_fraction
        most = _SCALING_RATE * self.arm.cycle
        self.scaling += min(max(wanted - self.scaling, -most), most)

    def move(self, q: list[float], mover: object) -> None:
        """Send the arm to joint positions (6) in this cycle [rad].

        Where somebody else moves it in the same cycle, that is a `ScriptFault`.
        """
        if self.arm.pending is not None and self._mover is not mover:
            raise urscript.ScriptFault("another thread moves the robot in the same cycle")
        self._mover, self.rest = mover, None
        self.arm.pending = q

    def tune(self, lookahead: float, gain: float) -> None:
        """The servo's lookahead [s] and gain from now on; `InputError` for impossible ones."""
        if (lookahead, gain) != self._tuning:
            self.arm.plant.tune(simulation.Servo(lookahead=lookahead, gain=gain))
            self._tuning = (lookahead, gain)

    def untune(self) -> None:
        """Back to the servo's own lookahead and gain."""
        self.tune(self.arm.servo.lookahead, self.arm.servo.gain)

    def tell_payload(self) -> None:
        """Tell the controller's model of the payload and the mounting."""
        payload, flange = self.payload, self.arm.plant.arm.robot.flange
        cog = flange[:3, :3] @ np.array(payload.cog) + flange[:3, 3]
        gravity = -np.array(self.gravity)
        self.arm.plant.tracker.set_payload(payload.mass, cog, gravity)

    def lacks(self, what: str) -> None:
        """Say, once a program, that something is not simulated."""
        if what not in self.lacking:
            self.lacking.add(what)
            words = f"{what} is not simulated: it does nothing"
            self.say(words, level=2, kind=MessageKind.NOTE)

    def say(
        self,
        text: str,
        source: str = "program",
        level: int = 3,
        kind: MessageKind = MessageKind.TEXT,
        *,
        title: str = "",
        line: int = 0,
        blocking: bool = False,
    ) -> None:
        """Put a message out; the oldest is dropped when nobody takes them."""
        text, title = text[:_LONGEST], title[:_LONGEST]
        message = Message(text, source, level, self.now, kind, title, line, blocking)
        self.messages.append(message)

    def protective_stop(self, reason: str) -> None:
        """Stop the arm hard and lock it; the program ends."""
        if self.safety.stopped:
            return
        self.safety.stop(reason, self.now)
        self.arm.pending = None
        self.arm.braking = PROTECTIVE_STOP
        self.say(reason, "safety", 1, MessageKind.STOP)

    def set_tcp(self, pose: Sequence[float]) -> None:
        """The tool in the flange: x, y, z, rx, ry, rz [m, rad]."""
        self.tcp = [float(value) for value in pose]
        self.tcp_matrix = kinematics.to_matrix(self.tcp)

    def feed(self, variable: str) -> None:
        """An input was written."""
        watchdog = self.watchdogs.get(variable)
        if watchdog is not None:
            watchdog.fed = self.now

    def starved(self) -> InputWatchdog | None:
        """The first watchdog that has waited too long."""
        for watchdog in self.watchdogs.values():
            if watchdog.action != "ignore" and self.now - watchdog.fed > watchdog.period + 1e-9:
                return watchdog
        return None
