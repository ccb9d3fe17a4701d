"""When the next control cycle is due: by the wall clock, or in virtual time.

Virtual time never looks at the wall clock; it goes as fast as the clients read:

- a cycle begins once every client that has started RTDE has read what it was sent but for the
  last 24 ms, so that nobody misses a package or sees the robot late;
- while a script is being compiled, time stands still;
- what clients write acts in the order in which it came, one package of each recipe a cycle; while
  one of them streams set points (double registers), the next cycle waits for those who have
  written until just now, so that no set point is skipped or used twice;
- an RTDE watchdog of a script starves when its time is over by both clocks: a client that
  writes often enough in real time is never too slow for virtual time;
- without a client that has started RTDE, and while a program waits for a socket, time goes at the
  pace of the wall clock;
- where no client has been connected for a while and no program plays, time stops: an idle
  controller takes no processor time.
"""

import gc
import os
import resource
import sys
from array import array
from collections.abc import Sequence

from dynid.protocol import HEADER
from urtwin.machine import ControllerMachine
from urtwin.server.clients import RtdeClient
from urtwin.server.connection import UnreadBytes

CATCH_UP_S = 0.1
"""How far behind the wall clock the controller may run before it gives the time up [s]."""
_KEPT = 1 << 20
STALLED_S = 10.0
"""How long a client may read nothing before it is given up [s]."""
LEAD_S = 0.024
"""How far the controller may be ahead of its slowest client [s of controller time]."""
TOGETHER_S = 0.012
"""Packages of this much controller time are sent at once [s]."""
UNUSED_S = 10.0
"""How long no client is connected before virtual time stops [s]: enough to brake and boot."""
_ROUNDING = 1e-9
_SOON, _LATER, _PATIENCE = 50e-6, 1e-3, 20
_SWITCH_S = 0.0005
_PRIORITY, COMPILER_PRIORITY = 10, 9
"""Of the loop; of the compiler, which may hold the interpreter lock that the loop waits for."""
_FILES = 4096
_YOUNG, _OLD, _OLDEST = 20_000, 20, 50


class Pace:
    """The rhythm of the control cycles of a length [s], from wall times [s] that it is told.

    In real time cycle k is due at start + k dt. A late cycle is run at once and the next ones
    keep their times, so no cycle is lost; after a longer standstill than `CATCH_UP_S` (a
    suspended computer) the rhythm starts anew and the controller's time has simply stood still.
    """

    def __init__(self, cycle: float, now: float) -> None:
        self._cycle = cycle
        self._start, self._cycles = now, 0
        self.slips = 0
        """How often time was given up."""
        self._late = array("f")

    def wait(self, now: float) -> float:
        """Seconds until the next cycle is due; not positive when it is."""
        return self._start + (self._cycles + 1) * self._cycle - now

    def advance(self, now: float) -> None:
        """A cycle begins."""
        late = -self.wait(now)
        self._cycles += 1
        if len(self._late) < _KEPT:
            self._late.append(late)
        if late > CATCH_UP_S:
            self.slips += 1
            self.restart(now)

    def restart(self, now: float) -> None:
        """Begin the rhythm anew."""
        self._start, self._cycles = now, 0

    def lateness_us(self, *percentiles: float) -> list[float]:
        """How late cycles began [us], at percentiles from 0 to 100."""
        if not self._late:
            return [0.0] * len(percentiles)
        ordered = sorted(self._late)
        last = len(ordered) - 1
        return [1e6 * ordered[round(last * share / 100)] for share in percentiles]


class VirtualPace:
    """Decides when the next cycle begins."""

    def __init__(self, machine: ControllerMachine) -> None:
        self._machine = machine
        self._unread = UnreadBytes()
        self._asked = 0
        self._stuck: dict[RtdeClient, tuple[int, float]] = {}
        self._busy_at: float | None = None

    def wait(self, clients: Sequence[RtdeClient], now: float) -> float:
        """Seconds after which to ask again; nought when the next cycle may begin.

        The clients are those that have started, at least one; `now` is the monotonic clock [s].
        """
        if any(self._behind(client, now) for client in clients):
            self._asked += 1
            return _SOON if self._asked < _PATIENCE else _LATER
        queues = [client.session.queue for client in clients]
        if any(queue.steers(now) for queue in queues) and any(
            queue.awaited(now) for queue in queues
        ):
            return _SOON
        self._asked = 0
        self._stuck.clear()
        return self._watchdogs(clients, now)

    def unused(self, now: float, *, busy: bool) -> bool:
        """Whether neither client nor program was there for `UNUSED_S`; asked every cycle."""
        if busy or self._busy_at is None:
            self._busy_at = now
        return now - self._busy_at > UNUSED_S

    def close(self) -> None:
        """Let the kernel go."""
        self._unread.close()

    def _behind(self, client: RtdeClient, now: float) -> bool:
        """Whether a client has too much left to read; one that never reads is given up."""
        connection, unread = client.connection, self._unread.of(client.question)
        if not connection.still_full() and unread <= self._allowed(client):
            return False
        known, since = self._stuck.get(client, (-1, now))
        self._stuck[client] = (unread, since if unread == known else now)
        if unread == known and now - since > STALLED_S:
            client.refuse(
                f"the client has read nothing for {STALLED_S:g} s, and virtual time waits for all "
                "that have started: read each in a thread of its own"
            )
        return not connection.lost

    def _allowed(self, client: RtdeClient) -> int:
        """Bytes that a client may have left to read when the next cycle begins."""
        recipe = client.session.outputs
        if recipe is None:
            return 0
        ahead = LEAD_S - TOGETHER_S
        packages = round(ahead / (self._machine.cycle * client.session.every))
        return max(1, packages) * (HEADER.size + recipe.size)

    def _watchdogs(self, clients: Sequence[RtdeClient], now: float) -> float:
        """Seconds of real time that a watchdog still has, when its virtual time is over."""
        core = self._machine.core
        if not core.playing:
            return 0.0
        wait = 0.0
        for watchdog in core.watchdogs.values():
            if core.now + self._machine.cycle - watchdog.fed <= watchdog.period + _ROUNDING:
                continue
            written = max((c.session.wrote(watchdog.variable) for c in clients), default=now)
            left = written + watchdog.period - now
            if 0.0 < left <= watchdog.period:
                wait = max(wait, min(left, _LATER))
        return wait


def keep_time(*, real_time: bool) -> bool:
    """Prepare the process for a loop of control cycles; whether it got a real-time priority.

    Other threads of the process (the compiler) hand over within half a millisecond, the garbage
    collector forgets what will live for ever, and in real time SCHED_FIFO is asked for: without
    it a loaded machine delays cycles by tens of milliseconds, with it by a tenth of one.
    """
    sys.setswitchinterval(_SWITCH_S)
    gc.collect()
    gc.freeze()
    gc.set_threshold(_YOUNG, _OLD, _OLDEST)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = _FILES if hard == resource.RLIM_INFINITY else min(_FILES, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    return real_time and first_in_first_out(_PRIORITY)


def first_in_first_out(priority: int) -> bool:
    """Ask for a real-time priority of this thread; whether it was given."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except OSError:
        return False
    return True
