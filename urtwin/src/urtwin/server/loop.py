"""The loop of the controller: sockets, compiling and broadcasts around the machine's cycles."""

import select
import socket
import time
import traceback
from collections import Counter
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import TextIO

from dynid.protocol import rtde
from urtwin.core import Message
from urtwin.dashboard import obey
from urtwin.machine import ControllerMachine, compile_program
from urtwin.network import Network, on_this_machine
from urtwin.primary import packets, realtime_state, robot_state, version_message
from urtwin.server.clients import Client, LeavingClient, Reception, RtdeClient, WatchingClient
from urtwin.server.clock import COMPILER_PRIORITY, TOGETHER_S, Pace, VirtualPace, first_in_first_out
from urtwin.server.connection import Connection, open_listeners
from urtwin.settings import PORTS, PRIMARY, READ_ONLY, REALTIME, ControllerSettings
from urtwin.urscript import CompiledProgram, ScriptError

_PER_SECOND = 100
_SAME_PER_SECOND = 3
WAITING = 8
"""Programs that may wait to be compiled."""
_STATES_HZ = 10
_EVENTS = 4
_IDLE_S = 0.5
STALLED_S = 2.0
"""How long a client may read nothing before it is given up, in real time [s]."""
_FAREWELL_S = 1.0
CLIENTS = 128
"""Clients of one port at the same time."""
_NEWCOMER_S = 1.0
"""How long a client may be silent before its place can be given to another [s]."""


class Log:
    """Writes lines that begin with a name.

    What comes too fast, or again and again, is counted, not written.
    """

    def __init__(self, stream: TextIO, name: str) -> None:
        self._stream, self._name = stream, name
        self._second, self._dropped = 0, 0
        self._written: Counter[str] = Counter()

    def say(self, words: str) -> None:
        """Write a line."""
        second = int(time.monotonic())
        if second != self._second:
            if self._dropped:
                self._write(f"{self._dropped} more lines were not printed")
            self._second, self._dropped = second, 0
            self._written.clear()
        if self._written[words] >= _SAME_PER_SECOND or self._written.total() >= _PER_SECOND:
            self._dropped += 1
            return
        self._written[words] += 1
        self._write(words)

    def _write(self, words: str) -> None:
        line = " ".join(words.split())
        clean = "".join(c if c.isprintable() else "?" for c in line)[:500]
        try:
            print(f"{self._name}: {clean}", file=self._stream, flush=True)
        except OSError:
            # Nobody reads any more; the robot does not stop for that.
            self._second = int(time.monotonic())


class ScriptCompiler:
    """A thread that compiles, and a socket that becomes readable when it has.

    Compiling takes tens of milliseconds, many control cycles. In real time the thread has a
    real-time priority, as the loop has. Nobody waits for it at the end of the process.
    """

    def __init__(self, *, real_time: bool) -> None:
        self._texts: SimpleQueue[str] = SimpleQueue()
        self._compiled: SimpleQueue[CompiledProgram | ScriptError] = SimpleQueue()
        self._pending = 0
        self.signal, self._wake = socket.socketpair()
        self.signal.setblocking(False)
        Thread(target=self._work, args=(real_time,), name="urscript", daemon=True).start()

    @property
    def busy(self) -> bool:
        """Whether a script has been taken that did not come back yet."""
        return self._pending > 0

    def submit(self, text: str) -> bool:
        """Take a script; whether there was room for it."""
        if self._pending >= WAITING:
            return False
        self._pending += 1
        self._texts.put(text)
        return True

    def take(self) -> Generator[CompiledProgram | ScriptError]:
        """Scripts that were compiled since the last call, oldest first, or why they were not."""
        with suppress(BlockingIOError):
            self.signal.recv(WAITING)
        while not self._compiled.empty():
            self._pending -= 1
            yield self._compiled.get()

    def _work(self, real_time: bool) -> None:
        if real_time:
            first_in_first_out(COMPILER_PRIORITY)
        while True:
            try:
                self._compiled.put(compile_program(self._texts.get()))
            except ScriptError as error:
                self._compiled.put(error)
            self._wake.send(b"!")


class Broadcast:
    """Sends data packages, states and messages; who is too slow for one misses it.

    Data packages of `together_s` of controller time leave at once: in virtual time, to wake a
    client for each costs more than to simulate it.
    """

    def __init__(self, machine: ControllerMachine, together_s: float = 0.0) -> None:
        self._machine = machine
        self._together = together_s / machine.cycle
        self._states, self._due = 0, False
        self._messages: Sequence[Message] = ()
        self._news = b""
        self._packed: dict[object, bytes] = {}

    def greet(self, client: Client) -> None:
        """What a client reads before it says anything."""
        if isinstance(client, WatchingClient) and _stream(client) != REALTIME:
            core = self._machine.core
            client.connection.send(version_message(core.version, core.now))
        else:
            client.connection.send(client.greeting)

    def next_cycle(self, messages: Sequence[Message]) -> None:
        """A control cycle is over, in which the machine has said some messages."""
        machine = self._machine
        self._packed.clear()
        # Ten states a second, also where 10 Hz is no whole number of cycles.
        states = int(machine.core.cycles * machine.cycle * _STATES_HZ + 1e-9)
        self._due, self._states = states != self._states, states
        self._messages = messages
        self._news = b"".join(packets(message) for message in messages)

    def tell(self, client: Client) -> None:
        """Send a client what it gets in this cycle."""
        if isinstance(client, RtdeClient):
            self._tell_rtde(client)
        elif isinstance(client, WatchingClient):
            stream = _stream(client)
            if stream == PRIMARY and self._news:
                client.connection.offer(self._news)
            # Whoever never reads this port (ur_rtde does not) costs nothing.
            if (self._due or stream == REALTIME) and not client.connection.still_full():
                first = not client.introduced
                if client.connection.offer(self._state(stream, first=first)):
                    client.introduced = True

    def _tell_rtde(self, client: RtdeClient) -> None:
        session = client.session
        if not session.streaming:
            return
        for message in self._messages:
            if message.level < rtde.MessageLevel.WARNING:
                client.connection.offer(session.text(message.words, message.source, message.level))
        recipe = session.outputs
        if recipe is not None and self._machine.core.cycles % session.every == 0:
            together = int(self._together / session.every + 1e-9)
            package = self._packed_once(
                recipe, lambda: recipe.packet(self._machine.numbers(*recipe.names))
            )
            client.connection.offer(package, together)
            session.queue.asked = True

    def _state(self, stream: int, *, first: bool) -> bytes:
        """What a port sends in this cycle."""
        if stream == REALTIME:
            return self._packed_once(REALTIME, lambda: realtime_state(self._machine))
        return self._packed_once(first, lambda: robot_state(self._machine, first=first))

    def _packed_once(self, key: object, pack: Callable[[], bytes]) -> bytes:
        """What all get who ask for the same in a cycle."""
        if key not in self._packed:
            self._packed[key] = pack()
        return self._packed[key]


def _stream(client: Client) -> int:
    """The port whose packets a client gets."""
    return READ_ONLY.get(client.port, client.port)


class ControllerServer:
    """Listens on the ports of a UR controller and serves its clients.

    Raises:
        InputError: There is no such folder.
        JobError: A port is taken.
    """

    def __init__(self, machine: ControllerMachine, settings: ControllerSettings, log: Log) -> None:
        self._machine, self._log = machine, log
        # A socket of the loop's waits in this one: its time-outs are not rounded up to 1 ms.
        self._epoll = select.epoll()
        self._listeners = {
            sock.fileno(): sock
            for sock in open_listeners(settings.host, (*PORTS.values(), *READ_ONLY))
        }
        self._clients: dict[int, Client] = {}
        self._rtde: list[RtdeClient] = []
        self._reception = Reception(machine, settings, self._submit)
        self._compiler = ScriptCompiler(real_time=not settings.virtual_time)
        self._broadcast = Broadcast(machine, TOGETHER_S if settings.virtual_time else 0.0)
        if not on_this_machine(settings.host):
            machine.core.network = Network(lambda _: True)
        self._virtual = VirtualPace(machine) if settings.virtual_time else None
        self._held = settings.hold
        for fd in (*self._listeners, self._compiler.signal.fileno()):
            self._epoll.register(fd, select.EPOLLIN)
        self.pace = Pace(machine.cycle, time.monotonic())

    def run(self, stop: Callable[[], bool]) -> None:
        """Serve until told to stop, which is asked twice a second or more often."""
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

    @contextmanager
    def _isolated(self, client: Client | None = None) -> Generator[None]:
        """A fault of ours ends the connection that met it, never the server."""
        try:
            yield
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            words = f"internal fault: {type(error).__name__}: {error}"
            self._log.say(f"{words} ({Path(place.filename).name}:{place.lineno})")
            if client is not None:
                client.connection.lost = client.connection.lost or words

    def close(self) -> None:
        """Close all connections and free the ports."""
        for client in list(self._clients.values()):
            self._close(client)
        for listener in self._listeners.values():
            listener.close()
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
        busy = bool(self._clients) or self._machine.core.playing
        if self._compiler.busy or self._virtual.unused(now, busy=busy):
            self.pace.restart(now)
            return _IDLE_S
        paced = self.pace.wait(now) if self._machine.core.network.listening else 0.0
        return max(paced, self._virtual.wait(started, now)) if started else self.pace.wait(now)

    def _started(self) -> Sequence[RtdeClient]:
        return [client for client in self._rtde if client.session.streaming]

    def _serve(self) -> None:
        for fd, _ in self._epoll.poll(0, _EVENTS):
            client = self._clients.get(fd)
            with self._isolated(client):
                if fd in self._listeners:
                    self._welcome(self._listeners[fd])
                elif client is not None:
                    client.readable()
                else:
                    self._run_compiled()

    def _cycle(self, now: float) -> None:
        network = self._machine.core.network
        network.late = False
        if self._virtual is None or not self._started():
            network.late = self.pace.wait(now) < -self._machine.cycle
            self.pace.advance(now)
        else:
            self.pace.restart(now)
        guided = any(client.session.queue.guided(now) for client in self._rtde)
        for client in self._rtde:
            with self._isolated(client):
                client.session.queue.apply_next(guided)
        with self._isolated():
            self._machine.tick()
            self._broadcast.next_cycle(self._news())
        for client in self._clients.values():
            with self._isolated(client):
                self._broadcast.tell(client)

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
            if isinstance(compiled, ScriptError):
                self._machine.refuse(compiled)
            else:
                self._machine.run_program(compiled)

    def _submit(self, text: str) -> None:
        if obey(text, self._machine):
            return
        if not self._compiler.submit(text):
            words = "a program was refused: too many are waiting to be compiled"
            self._machine.core.say(words, "controller", rtde.MessageLevel.ERROR)

    def _welcome(self, listener: socket.socket) -> None:
        port, now = listener.getsockname()[1], time.monotonic()
        try:
            accepted, (host, peer, *_) = listener.accept()
        except OSError:
            return
        try:
            connection = Connection(accepted, f"{host}:{peer}")
            client = self._reception.client(connection)
        except OSError:
            # It has left while it waited to be let in.
            accepted.close()
            return
        if not self._make_room(port, now):
            client.refuse("too many clients on this port")
            self._log.say(f"{connection.peer} refused: too many clients on port {port}")
            connection.close()
            return
        self._clients[connection.socket.fileno()] = client
        if isinstance(client, RtdeClient):
            self._rtde.append(client)
        self._epoll.register(connection.socket.fileno(), select.EPOLLIN)
        self._broadcast.greet(client)

    def _make_room(self, port: int, now: float) -> bool:
        """Whether one more client of a port may come in.

        A full port gives up the client that has been connected for longest without a word.
        """
        present = [client.connection for client in self._clients.values() if client.port == port]
        if len(present) < CLIENTS:
            return True
        silent = [each for each in present if each.silent and now - each.since > _NEWCOMER_S]
        if silent:
            leaver = min(silent, key=lambda connection: connection.since)
            client = self._clients[leaver.socket.fileno()]
            client.refuse("another client needs this place: you have been silent")
            self._part(client, now)
        return bool(silent)

    def _part(self, client: Client, now: float) -> None:
        """Say goodbye: at once to who has left, politely to who is sent away."""
        connection = client.connection
        with self._isolated():
            client.left()
        if isinstance(client, RtdeClient):
            self._rtde.remove(client)
        if connection.skipped and client.port == rtde.PORT:
            self._log.say(f"{connection.peer} was too slow, packages skipped: {connection.skipped}")
        if client.regret:
            self._log.say(f"{connection.peer} on port {client.port}: {client.regret}")
        if connection.gone or isinstance(client, LeavingClient):
            self._close(client)
            return
        self._log.say(f"{connection.peer} on port {client.port} closed: {connection.lost}")
        leaving = LeavingClient(connection, now + _FAREWELL_S)
        self._clients[connection.socket.fileno()] = leaving

    def _close(self, client: Client) -> None:
        fd = client.connection.socket.fileno()
        self._epoll.unregister(fd)
        del self._clients[fd]
        client.connection.close()
