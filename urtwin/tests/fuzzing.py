"""Hostile clients by the thousand beside a good one: `python fuzzing.py --lines 20000 --rate 500`.

Dashboard lines, scripts, statements of interpreter mode and RTDE packets, random and mutated, NUL
bytes included. The suite runs a sample; the long run is a step of `make proof`.
"""

import argparse
import contextlib
import random
import socket
import struct
import threading
import time

import numpy as np

from rtde_client import RtdeClient, ask_dashboard
from urtwin import controller_process

STEP_ERROR = 1e-12
SCRIPT_PORTS = (30001, 30002, 30003)
PAUSE_S = 0.1
PATIENCE_S = 5.0
"""How long the controller may leave a connection open whose sender has ended."""
DASHBOARD = (
    *("load x.urp", "load \0.urp", "load /programs/../../etc/passwd", "play", "pause", "stop"),
    *("power on", "power off", "brake release", "robotmode", "popup \0", "addToLog x", "running"),
    *("set operational mode manual", "unlock protective stop", "restart safety", "close popup"),
    *("get serial number", "polyscopeVersion", "programState", "safetystatus", "quit", "shutdown"),
)
STATEMENTS = (
    "movej([0,-1.5,1,-1,0,0], a=5, v=3)",
    "movel(p[0.3,0.3,0.3,0,3,0], r=0.1)",
    "servoj([0,0,0,0,0,0], t=0.002, lookahead_time=0.03, gain=500)",
    "speedl([1e300,0,0,0,0,0], 1, 0.1)",
    "force_mode(p[0,0,0,0,0,0],[1,1,1,1,1,1],[1e9,0,0,0,0,0],2,[1,1,1,1,1,1])",
    "x = [1,2,3]",
    "x[7] = 1 / 0",
    'textmsg("a\0b", 1e308 * 10)',
    "while True: y = 1 end",
    "enter_critical",
    "exit_critical",
    "kill h",
    "join h",
    "h = run t()",
    "sync()",
    'socket_open("127.0.0.1", 1, "s")',
    'socket_read_binary_integer(1000000, "s", 0)',
    "interpreter_mode()",
    "halt",
    "set_payload(-1, [0,0,0])",
    "p = get_inverse_kin(p[9,9,9,0,0,0])",
    "set_gravity([0,0,1e200])",
    "write_output_integer_register(99, 2)",
    "s = str_cat(to_str(x), to_str(x))",
)
COMMANDS = ("power on", "power off", "set robotmode run", "stop program", "set speed 1e99")


def mangled(random_: random.Random, data: bytes) -> bytes:
    """Some bytes changed, cut or doubled."""
    found = bytearray(data)
    for _ in range(random_.randrange(4)):
        at = random_.randrange(len(found) + 1)
        if random_.random() < 0.5:
            found[at : at + random_.randrange(3)] = random_.randbytes(random_.randrange(4))
        else:
            found[at:at] = b"\0"
    return bytes(found)


def script(random_: random.Random) -> bytes:
    """A program with a thread, of statements that fit badly."""
    body = [random_.choice(STATEMENTS) for _ in range(random_.randrange(1, 6))]
    thread = [random_.choice(STATEMENTS) for _ in range(random_.randrange(1, 4))]
    word = random_.choice(("def", "def", "sec"))
    text = f"{word} f():\n h = 0\n x = [1]\n thread t():\n  " + "\n  ".join(thread)
    return (text + "\n end\n h = run t()\n " + "\n ".join(body) + "\nend\n").encode()


def packet(random_: random.Random) -> bytes:
    """An RTDE packet of any kind with anything in it."""
    names = random_.choice((b"timestamp,actual_q", b"\0", b"speed_slider_mask", b"", b"nothing"))
    payload = random_.choice((names, struct.pack(">d", 125.0) + names, random_.randbytes(12)))
    length = len(payload) + 3 if random_.random() < 0.9 else random_.randrange(65536)
    return struct.pack(">HB", length, random_.choice(b"VvSPIOUM\0\xff")) + payload


def attack(host: str, lines: int, seed: int, pause_s: float = 0.0) -> int:
    """Send so many lines, scripts and packets; how many connections the controller ended."""
    random_, ended = random.Random(seed), 0
    ports = {29999: 8, 30001: 3, 30002: 3, 30003: 3, 30004: 8, 30020: 4, 30011: 1}
    while lines > 0:
        (port,) = random_.choices(list(ports), weights=list(ports.values()))
        with contextlib.closing(socket.create_connection((host, port), timeout=30)) as sock:
            sock.settimeout(30)
            for _ in range(min(lines, random_.randrange(1, 40))):
                lines -= 1
                if port == 30004:
                    data = packet(random_)
                elif port == 29999:
                    data = random_.choice(DASHBOARD).encode() + b"\n"
                elif port == 30020:
                    data = random_.choice(STATEMENTS).encode() + b"\n"
                elif random_.random() < 0.1:
                    data = random_.choice(COMMANDS).encode() + b"\n"
                else:
                    data = script(random_)
                try:
                    sock.sendall(mangled(random_, data) if random_.random() < 0.5 else data)
                except OSError:
                    ended += 1
                    break
            drained(sock)
        if port in SCRIPT_PORTS and pause_s:
            # What came last is compiled and runs for a while, on a robot that is switched on.
            ask_dashboard(host, "close safety popup", "power on", "brake release")
            time.sleep(pause_s)
    return ended


def drained(sock: socket.socket) -> None:
    """Read until the controller has taken everything: what a closed socket holds would be lost."""
    with contextlib.suppress(OSError):
        sock.shutdown(socket.SHUT_WR)
        sock.settimeout(PATIENCE_S)
        while sock.recv(65536):
            pass


class GoodClient:
    """Reads every package of a controller in a thread."""

    def __init__(self, host: str) -> None:
        self._client = RtdeClient(host)
        self._client.read_outputs(["timestamp", "actual_q", "runtime_state"])
        self._client.start()
        self._over = threading.Event()
        self.times: list[float] = []
        self.failure: Exception | None = None
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        try:
            while not self._over.is_set():
                self.times.append(self._client.row()["timestamp"])
        except (OSError, AssertionError) as error:
            self.failure = error

    def missing(self, cycle: float) -> int:
        """Stop; the cycles of which no package came."""
        self._over.set()
        self._thread.join(30)
        self._client.__exit__()
        if self.failure is not None:
            raise self.failure
        steps = np.diff(self.times) / cycle
        return int(np.sum(np.round(steps) - 1)) + int(np.sum(np.abs(steps % 1.0 - 0.5) < 0.4))


def run(
    lines: int, rate_hz: float, seed: int, pause_s: float = 0.0
) -> tuple[int, int, list[str], str]:
    """Packages received and missed, what the dashboard answers afterwards, and the log."""
    with controller_process("ur5", rate_hz=rate_hz, seed=seed) as controller:
        good = GoodClient(controller.host)
        attack(controller.host, lines, seed, pause_s)
        answers = ask_dashboard(controller.host, "load \0.urp", "robotmode")
        time.sleep(0.2)
        missed = good.missing(1.0 / rate_hz)
        return len(good.times), missed, answers, controller.said()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lines", type=int, default=20_000)
    parser.add_argument("--rate", type=float, default=500.0)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    begun = time.monotonic()
    received, missed, answers, log = run(asked.lines, asked.rate, asked.seed, PAUSE_S)
    faults = [line for line in log.splitlines() if "internal fault" in line]
    print(*sorted(set(faults)), sep="\n")
    print(
        f"{asked.lines} hostile lines at {asked.rate:g} Hz in {time.monotonic() - begun:.0f} s: "
        f"{received} packages, {missed} missed, {len(faults)} internal faults, then {answers}"
    )
    raise SystemExit(1 if missed or faults or not answers[1].startswith("Robotmode") else 0)


if __name__ == "__main__":
    main()
