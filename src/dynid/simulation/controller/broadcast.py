"""What every client is told in a cycle, without having asked again."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial

from dynid.protocol import rtde
from dynid.simulation.controller.clients import Client, RtdeClient, WatchingClient
from dynid.simulation.controller.doors import PRIMARY, READ_ONLY, REALTIME
from dynid.simulation.controller.machine import ControllerMachine
from dynid.simulation.controller.machine_messages import Message
from dynid.simulation.controller.packages import Packer
from dynid.simulation.controller.primary import robot_state
from dynid.simulation.controller.primary_messages import packets, version_message
from dynid.simulation.controller.realtime import realtime_state

_STATES_HZ = 10


class Broadcast:
    """Sends data packages, states and messages; who is too slow for one misses it.

    Args:
        machine: The controller behind.
        together_s: Data packages of this much controller time leave at once [s]; in virtual
            time, to wake a client for each costs more than to simulate it.
    """

    def __init__(self, machine: ControllerMachine, together_s: float = 0.0) -> None:
        self._machine, self._packer = machine, Packer(machine)
        self._together = together_s / machine.cycle
        self._states = 0

    def greet(self, client: Client) -> None:
        """What a client reads before it says anything."""
        if isinstance(client, WatchingClient) and _stream(client) != REALTIME:
            core = self._machine.core
            client.connection.send(version_message(core.version, core.now))
        else:
            client.connection.send(client.greeting)

    def cycle(self, clients: Iterable[Client], messages: Sequence[Message]) -> None:
        """After a control cycle.

        Args:
            clients: Everybody.
            messages: What the machine has said in it.
        """
        machine = self._machine
        self._packer.next_cycle()
        # Ten states a second, also where 10 Hz is no whole number of cycles.
        states = int(machine.core.cycles * machine.cycle * _STATES_HZ + 1e-9)
        due, self._states = states != self._states, states
        states_due = _States(machine)
        news = b"".join(packets(message) for message in messages) if messages else b""
        for client in clients:
            if isinstance(client, RtdeClient):
                self._tell(client, messages)
            elif isinstance(client, WatchingClient):
                stream = _stream(client)
                if stream == PRIMARY and news:
                    client.connection.offer(news)
                # Whoever never reads this port (ur_rtde does not) costs nothing.
                if (due or stream == REALTIME) and not client.connection.still_full():
                    first = not client.introduced
                    if client.connection.offer(states_due.of(stream, first=first)):
                        client.introduced = True

    def _tell(self, client: RtdeClient, messages: Sequence[Message]) -> None:
        session = client.session
        if not session.streaming:
            return
        for message in messages:
            if message.level < rtde.Level.WARNING:
                client.connection.offer(session.text(message.words, message.source, message.level))
        recipe = session.outputs
        if recipe is not None and self._machine.core.cycles % session.every == 0:
            together = int(self._together / session.every + 1e-9)
            client.connection.offer(self._packer.package(recipe), together)
            session.queue.asked = True


class _States:
    """The states of one cycle, each packed once."""

    def __init__(self, machine: ControllerMachine) -> None:
        self._machine = machine
        self._packed: dict[tuple[bool, bool], bytes] = {}

    def of(self, stream: int, *, first: bool) -> bytes:
        """What a port sends in this cycle."""
        realtime = stream == REALTIME
        key = (realtime, first and not realtime)
        packed = self._packed.get(key)
        if packed is None:
            state = realtime_state if realtime else partial(robot_state, first=first)
            packed = self._packed[key] = state(self._machine)
        return packed


def _stream(client: Client) -> int:
    """The port whose packets a client gets."""
    return READ_ONLY.get(client.port, client.port)
