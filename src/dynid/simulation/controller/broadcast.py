"""What every client is told in a cycle, without having asked again."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from dynid.protocol import rtde
from dynid.simulation.controller.clients import Client, RtdeClient, ScriptClient
from dynid.simulation.controller.doors import PRIMARY, REALTIME
from dynid.simulation.controller.machine import ControllerMachine
from dynid.simulation.controller.machine_core import Message
from dynid.simulation.controller.packages import Packer
from dynid.simulation.controller.primary import (
    realtime_state,
    robot_state,
    text_message,
    version_message,
)

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
        if isinstance(client, ScriptClient) and client.port != REALTIME:
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
        packed: dict[int, bytes] = {}
        for client in clients:
            if isinstance(client, RtdeClient):
                self._tell(client, messages)
            elif isinstance(client, ScriptClient):
                realtime = client.port == REALTIME
                if client.port == PRIMARY:
                    for message in messages:
                        client.connection.offer(text_message(message.text, message.timestamp))
                # Whoever never reads this port (ur_rtde does not) costs nothing.
                if (due or realtime) and not client.connection.still_full():
                    if realtime not in packed:
                        packed[realtime] = (realtime_state if realtime else robot_state)(machine)
                    client.connection.offer(packed[realtime])

    def _tell(self, client: RtdeClient, messages: Sequence[Message]) -> None:
        session = client.session
        if not session.streaming:
            return
        for message in messages:
            if message.level < rtde.Level.INFO:
                client.connection.offer(session.text(message.text, message.source, message.level))
        recipe = session.outputs
        if recipe is not None and self._machine.core.cycles % session.every == 0:
            together = int(self._together / session.every + 1e-9)
            client.connection.offer(self._packer.package(recipe), together)
