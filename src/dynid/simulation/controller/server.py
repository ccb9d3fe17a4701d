"""The loop of the simulated controller: sockets on one side, the machine on the other."""

from __future__ import annotations

import select
import time
from collections.abc import Callable, Sequence

from dynid.protocol import rtde
from dynid.simulation.controller.broadcast import Broadcast
from dynid.simulation.controller.clients import Client, LeavingClient, RtdeClient
from dynid.simulation.controller.clock import Pace
from dynid.simulation.controller.commands import obey
from dynid.simulation.controller.compiler import ScriptCompiler
from dynid.simulation.controller.connection import Connection
from dynid.simulation.controller.doors import Door, open_doors, place_for_another
from dynid.simulation.controller.log import Log
from dynid.simulation.controller.machine import ControllerMachine
from dynid.simulation.controller.machine_messages import Message
from dynid.simulation.controller.machine_network import Network, on_this_machine
from dynid.simulation.controller.reception import Reception, ServerSettings
from dynid.simulation.controller.virtual import TOGETHER_S, VirtualPace

_EVENTS = 4
_IDLE_S = 0.5
STALLED_S = 2.0
"""How long a client may read nothing before it is given up, in real time [s]."""
_FAREWELL_S = 1.0


class ControllerServer:
    """Listens on the ports of a UR controller and serves its clients.

    Args:
        machine: The controller.
        settings: How it shows itself.
        log: Where to say what happens.

    Raises:
        JobError: A port is taken.
    """

    def __init__(self, machine: ControllerMachine, settings: ServerSettings, log: Log) -> None:
        self._machine, self._log = machine, log
        # A socket of the loop's waits in this one: its time-outs are not rounded up to 1 ms.
        self._epoll = select.epoll()
        self._doors = {door.socket.fileno(): door for door in open_doors(settings.host)}
        self._clients: dict[int, Client] = {}
        self._rtde: list[RtdeClient] = []
        self._reception = Reception(machine, settings, self._submit)
        self._compiler = ScriptCompiler(machine.compile)
        self._broadcast = Broadcast(machine, TOGETHER_S if settings.virtual else 0.0)
        if not on_this_machine(settings.host):
            machine.core.network = Network(lambda _: True)
        self._virtual = VirtualPace(machine) if settings.virtual else None
        self._held = settings.hold
        for fd in (*self._doors, self._compiler.signal.fileno()):
            self._epoll.register(fd, select.EPOLLIN)
        self.pace = Pace(machine.cycle, time.monotonic())

    def run(self, stop: Callable[[], bool]) -> None:
        """Serve until told to stop.

        Args:
            stop: Asked twice a second or more often.
        """
        self.pace.restart(time.monotonic())
        while not stop():
            now = time.monotonic()
            wait = self._wait(now)
            if wait > 0:
                for client in self._rtde:
                    client.connection.release()
                select.select([self._epoll], [], [], min(wait, _IDLE_S))
            self._serve()
            if wait <= 0:
                self._cycle(now)
            self._sweep(now)

    def close(self) -> None:
        """Hang up on everybody and free the ports."""
        for client in list(self._clients.values()):
            self._close(client)
        for door in self._doors.values():
            door.socket.close()
        self._compiler.close()
        if self._virtual is not None:
            self._virtual.close()
        self._epoll.close()

    def _wait(self, now: float) -> float:
        """Seconds until the next cycle; not positive when it is due."""
        started = self._started()
        if self._held:
            if not started:
                return _IDLE_S
            self._held = False
            self.pace.restart(now)
        if self._virtual is None:
            return self.pace.wait(now)
        if self._compiler.busy:
            return _IDLE_S
        paced = self.pace.wait(now) if self._machine.core.network.listening else 0.0
        return max(paced, self._virtual.wait(started, now)) if started else self.pace.wait(now)

    def _started(self) -> Sequence[RtdeClient]:
        return [client for client in self._rtde if client.session.streaming]

    def _serve(self) -> None:
        for fd, _ in self._epoll.poll(0, _EVENTS):
            if fd in self._doors:
                self._welcome(self._doors[fd])
            elif fd in self._clients:
                self._clients[fd].readable()
            else:
                self._run_compiled()

    def _cycle(self, now: float) -> None:
        if self._virtual is None or not self._started():
            self.pace.advance(now)
        else:
            self.pace.restart(now)
        guided = any(client.session.queue.guided(now) for client in self._rtde)
        for client in self._rtde:
            client.session.queue.apply_next(guided)
        self._machine.tick()
        self._broadcast.cycle(self._clients.values(), self._news())

    def _news(self) -> list[Message]:
        """What the machine has said; people read it too."""
        messages: list[Message] = []
        while self._machine.messages:
            message = self._machine.messages.popleft()
            messages.append(message)
            self._log.say(f"{message.source}: {message.words}")
        return messages

    def _sweep(self, now: float) -> None:
        """Part with everybody whose connection is over."""
        for client in list(self._clients.values()):
            connection = client.connection
            if connection.full and isinstance(client, RtdeClient) and self._virtual is None:
                connection.flush()
                if connection.full_for(now) > STALLED_S:
                    connection.lost = f"the client has read nothing for {STALLED_S:g} s"
            if isinstance(client, LeavingClient) and now > client.until:
                connection.lost = "time is up"
            if connection.lost:
                self._part(client, now)

    def _run_compiled(self) -> None:
        for compiled in self._compiler.take():
            if compiled.program is not None:
                self._machine.run_program(compiled.program)
            elif compiled.problem is not None:
                self._machine.refuse(compiled.problem)

    def _submit(self, text: str) -> None:
        if obey(text, self._machine):
            return
        if not self._compiler.submit(text):
            words = "a program was refused: too many are waiting to be compiled"
            self._machine.core.say(words, "controller", rtde.Level.ERROR)

    def _welcome(self, door: Door) -> None:
        accepted = door.accept()
        if accepted is None:
            return
        now = time.monotonic()
        connection = Connection(*accepted)
        client = self._reception.client(connection, door.port)
        others = [c for c in self._clients.values() if c.port == door.port]
        free, leaver = place_for_another(others, now)
        if leaver is not None:
            leaver.refuse("another client needs this place: you have been silent")
            self._part(leaver, now)
        if not free:
            client.refuse("too many clients on this port")
            self._log.say(f"{connection.peer} refused: too many clients on port {door.port}")
            connection.close()
            return
        self._clients[connection.socket.fileno()] = client
        if isinstance(client, RtdeClient):
            self._rtde.append(client)
        self._epoll.register(connection.socket.fileno(), select.EPOLLIN)
        self._broadcast.greet(client)

    def _part(self, client: Client, now: float) -> None:
        """Say goodbye: at once to who has left, politely to who is sent away."""
        connection = client.connection
        client.left()
        if isinstance(client, RtdeClient):
            self._rtde.remove(client)
        if connection.skipped and client.port == rtde.PORT:
            self._log.say(f"{connection.peer} was too slow for {connection.skipped} packages")
        if client.regret:
            self._log.say(f"{connection.peer} on port {client.port}: {client.regret}")
        if connection.gone or isinstance(client, LeavingClient):
            self._close(client)
            return
        self._log.say(f"{connection.peer} on port {client.port} sent away: {connection.lost}")
        leaving = LeavingClient(connection, client.port, now + _FAREWELL_S)
        self._clients[connection.socket.fileno()] = leaving

    def _close(self, client: Client) -> None:
        fd = client.connection.socket.fileno()
        self._epoll.unregister(fd)
        del self._clients[fd]
        client.connection.close()
