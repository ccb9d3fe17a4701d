"""The controller's side of RTDE: sessions, data packages, inputs that have not acted yet."""

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping

from dynid import core, protocol
from dynid.protocol import rtde
from urtwin.machine import ControllerMachine

LONGEST = 64
"""Packages that may wait; of a client that writes more than one a cycle the oldest act at once."""
PATIENCE_S = 1.0
"""How long virtual time waits for the next set point of a client that streams them [s]: longer than
a pause of its garbage collector."""
MEMORY_S = 2.0
"""How long what clients write keeps its order after numbers that may be set points [s]."""
_SETPOINTS, _STREAM = "input_double_register", 3
LARGEST_REQUEST = 12_300
"""The largest packet of a client [bytes]; inputs need less than 3000."""
_RECIPES = 255
_FIRST_PROTOCOL_HZ = 125.0
_COMPLAINTS = 100


class InputQueue:
    """Lets one package of each recipe act in each cycle while set points are streamed.

    Packages act in the order in which they came; without a stream all act at once.
    """

    def __init__(self, write: Callable[[str, protocol.Value], None]) -> None:
        self._write = write
        self._waiting: deque[tuple[int, Mapping[str, protocol.Value]]] = deque()
        self._last = -PATIENCE_S
        self._streak = 0
        self._steered, self._guide = -MEMORY_S, False
        self.asked = False
        """Whether the client was sent a package since it wrote."""

    def put(self, recipe: int, values: Mapping[str, protocol.Value], now: float) -> None:
        """Take what the client wrote by a recipe, at a time of the monotonic clock [s]."""
        self._waiting.append((recipe, values))
        self._last, self.asked = now, False
        # Commands that are answered, such as ur_rtde's moveJ, are followed by one without numbers.
        steers = _steers(values)
        self._streak = self._streak + 1 if steers else 0
        if steers:
            self._steered, self._guide = now, True
        while len(self._waiting) > LONGEST:
            self._act()

    def apply_all(self) -> None:
        """Let everything act."""
        while self._waiting:
            self._act()

    def apply_next(self, guided: bool) -> None:
        """Let act what belongs to this cycle.

        Where a client writes set points (`guided`), what others say belongs to one of them; its
        own signs of life, equal packages, act together: set points would stay late behind them.
        Otherwise all acts, a wish to stop not behind signs of life in a bunch.
        """
        if not guided:
            self.apply_all()
            return
        seen: set[int] = set()
        last = None
        while self._waiting and (self._waiting[0][0] not in seen or self._waiting[0] == last):
            last = self._waiting[0] if self._guide and not _steers(self._waiting[0][1]) else None
            seen.add(self._waiting[0][0])
            self._act()

    def guided(self, now: float) -> bool:
        """Whether the client wrote numbers that may be set points not long ago."""
        return now - self._steered < MEMORY_S

    def steers(self, now: float) -> bool:
        """Whether the client streams numbers that may be set points."""
        return self._streak >= _STREAM and now - self._last < PATIENCE_S

    def awaited(self, now: float) -> bool:
        """Whether the client, which wrote a moment ago, owes an answer to its last package."""
        return self.asked and not self._waiting and now - self._last < PATIENCE_S

    def _act(self) -> None:
        _, values = self._waiting.popleft()
        for name, value in values.items():
            self._write(name, value)


def _steers(values: Iterable[str]) -> bool:
    """Whether inputs may be a set point."""
    return any(name.startswith(_SETPOINTS) for name in values)


class Owners:
    """Who writes which input: one client each."""

    def __init__(self) -> None:
        self._owner: dict[str, object] = {}

    def claim(self, names: Iterable[str], client: object, version: protocol.Version) -> list[str]:
        """The types of inputs; a client gets all of them or none.

        A client may name a variable again in another recipe.
        """
        names = list(names)
        types = [self._type(name, client, version) for name in names]
        if not {protocol.NOT_FOUND, protocol.IN_USE}.intersection(types):
            self._owner.update(dict.fromkeys(names, client))
        return types

    def release(self, client: object) -> None:
        """Free the inputs of a client that has left."""
        self._owner = {name: owner for name, owner in self._owner.items() if owner is not client}

    def _type(self, name: str, client: object, version: protocol.Version) -> str:
        kind = type_of(protocol.INPUTS, name, version)
        if kind != protocol.NOT_FOUND and self._owner.get(name, client) is not client:
            return protocol.IN_USE
        return kind


def type_of(table: Mapping[str, protocol.Field], name: str, version: protocol.Version) -> str:
    """The type of a variable as the controller answers it."""
    field = table.get(name)
    return field.type.name if field is not None and field.exists_in(version) else protocol.NOT_FOUND


class RtdeSession:
    """What the controller knows of one client.

    Where inputs are `orderly` they act one after another, a cycle each, however they arrive: in
    virtual time many may come between two cycles. Else the newest acts.
    """

    def __init__(
        self, machine: ControllerMachine, owners: Owners, *, orderly: bool = False
    ) -> None:
        self._machine, self._owners, self._orderly = machine, owners, orderly
        self.queue = InputQueue(machine.set_input)
        self._version: protocol.Version = machine.core.version[:3]
        self._framer = protocol.Framer(LARGEST_REQUEST)
        self._inputs: list[protocol.Recipe] = []
        self._written: dict[int, float] = {}
        self._complaints = 0
        self.protocol = 1
        self.outputs: protocol.Recipe | None = None
        """What the client asked for; None before it did, or when it was refused."""
        self.every = 1
        """Cycles from one package to the next."""
        self.started = False
        """Whether it wants packages."""

    def receive(self, data: bytes) -> bytes:
        """Take what the client sent; the answers. A `ProtocolError` says that it was no RTDE."""
        return b"".join([self._answer(packet) for packet in self._framer.feed(data)])

    @property
    def streaming(self) -> bool:
        """Whether the client gets packages."""
        return self.started and self.outputs is not None

    def text(
        self, words: str, source: str = "controller", level: int = rtde.MessageLevel.ERROR
    ) -> bytes:
        """A text message for the client."""
        message = rtde.TextMessage(words, source, rtde.MessageLevel(level))
        return rtde.text_message(message, self.protocol)

    def wrote(self, name: str) -> float:
        """When it last wrote an input, by the monotonic clock [s]; minus infinity for never."""
        times = (
            self._written.get(number, -math.inf)
            for number, recipe in enumerate(self._inputs, start=1)
            if name in recipe.names
        )
        return max(times, default=-math.inf)

    def close(self) -> None:
        """The client has left: what it wrote still acts, and others may write its inputs."""
        self.queue.apply_all()
        self._owners.release(self)

    def _answer(self, packet: protocol.Packet) -> bytes:
        kind, payload = packet
        match kind:
            case protocol.Kind.DATA_PACKAGE:
                return self._write(payload)
            case protocol.Kind.REQUEST_PROTOCOL_VERSION:
                return self._choose_protocol(rtde.read_protocol_request(payload))
            case protocol.Kind.GET_URCONTROL_VERSION:
                return rtde.answer_software_version(*self._machine.core.version)
            case protocol.Kind.SETUP_OUTPUTS:
                return self._set_up_outputs(*rtde.read_output_setup(payload, self.protocol))
            case protocol.Kind.SETUP_INPUTS:
                return self._set_up_inputs(rtde.read_names(payload))
            case protocol.Kind.START | protocol.Kind.PAUSE:
                self.started = kind is protocol.Kind.START
                return rtde.answer(kind, True)
            case protocol.Kind.TEXT_MESSAGE:
                rtde.read_text_message(payload, 2)
                return b""

    def _choose_protocol(self, version: int) -> bytes:
        accepted = version in rtde.PROTOCOLS
        if accepted:
            self.protocol = version
        return rtde.answer(protocol.Kind.REQUEST_PROTOCOL_VERSION, accepted)

    def _set_up_outputs(self, names: tuple[str, ...], asked_hz: float | None) -> bytes:
        _check_length(names)
        types = [type_of(protocol.OUTPUTS, name, self._version) for name in names]
        rate = 1.0 / self._machine.cycle
        frequency = _FIRST_PROTOCOL_HZ if asked_hz is None else asked_hz
        number = None if self.protocol == 1 else 1
        self.outputs = None
        complaint = b""
        if not (math.isfinite(frequency) and frequency > 0):
            complaint = self._complain(f"{frequency} is no frequency; allowed: 1 to {rate:g} Hz")
        elif types and protocol.NOT_FOUND not in types:
            self.outputs = protocol.Recipe.of(names, types, number)
            self.every = max(1, math.floor(rate / max(frequency, 1.0) + 1e-9))
        accepted = number if self.outputs is not None or number is None else 0
        return complaint + rtde.answer_setup(protocol.Kind.SETUP_OUTPUTS, types, accepted)

    def _set_up_inputs(self, names: tuple[str, ...]) -> bytes:
        _check_length(names)
        if len(self._inputs) == _RECIPES:
            refused = self._complain(f"no more than {_RECIPES} input recipes")
            return refused + rtde.answer_setup(
                protocol.Kind.SETUP_INPUTS, [protocol.NOT_FOUND] * len(names), 0
            )
        types = self._owners.claim(names, self, self._version)
        if not types or {protocol.NOT_FOUND, protocol.IN_USE}.intersection(types):
            return rtde.answer_setup(protocol.Kind.SETUP_INPUTS, types, 0)
        number = len(self._inputs) + 1
        self._inputs.append(protocol.Recipe.of(names, types, number))
        return rtde.answer_setup(protocol.Kind.SETUP_INPUTS, types, number)

    def _write(self, payload: bytes) -> bytes:
        number = payload[0] if payload else 0
        if not 1 <= number <= len(self._inputs):
            return self._complain(f"there is no input recipe {number}")
        recipe = self._inputs[number - 1]
        values: dict[str, protocol.Value] = {}
        try:
            # More than the recipe is no mistake: ur_rtde's getForwardKinematics(q, tcp) does so.
            for name, value in recipe.unpack(payload[: recipe.size]).items():
                # A register may hold what a program wants; a speed slider may not.
                if value != value and "register" not in name:
                    return self._complain(f"{name} is not a number")
                values[name] = value
            now = self._written[number] = time.monotonic()
            self.queue.put(number, values, now)
            if not self._orderly:
                self.queue.apply_all()
        except core.DynidError as error:
            return self._complain(str(error))
        return b""

    def _complain(self, words: str) -> bytes:
        """Tell the client what is wrong; a `ProtocolError` for one that never learns."""
        self._complaints += 1
        if self._complaints > _COMPLAINTS:
            raise protocol.ProtocolError(f"too many mistakes, the last: {words}")
        return self.text(words)


def _check_length(names: tuple[str, ...]) -> None:
    size = sum(len(name) + 1 for name in names) - 1
    if size > rtde.NAMES_LIMIT:
        raise protocol.ProtocolError(
            "the list of names is too long",
            value=f"{size} bytes",
            limit=f"{rtde.NAMES_LIMIT} bytes",
        )
