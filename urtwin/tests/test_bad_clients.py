"""Bad clients: one good client is served at rate through all of it, and memory stays bounded."""

import contextlib
import random
import socket
import threading
from pathlib import Path

import numpy as np
import pytest

from dynid.protocol import Kind, rtde
from dynid.protocol.rtde import frame
from rtde_client import TIMEOUT_S, RtdeClient, ask_dashboard, send_script, wait_for
from urtwin import controller_process
from urtwin.server.loop import CLIENTS
from urtwin.settings import PORTS, READ_ONLY

STEP_ERROR = 1e-12
GROWTH_MB = 150
"""What the controller may grow by: one bomb alone would bring more if it were kept."""


@pytest.fixture(scope="module")
def host():
    with controller_process("ur5") as controller:
        yield controller


@pytest.fixture
def good(host):
    """A recorder that must not miss a package while the test lasts."""
    client = RtdeClient(host.host)
    client.read_outputs(["timestamp", "runtime_state", "output_int_register_24"])
    client.start()
    times, over, failure = [], threading.Event(), []

    def record():
        try:
            while not over.is_set():
                times.append(client.row()["timestamp"])
        except (OSError, AssertionError) as error:
            failure.append(error)

    thread = threading.Thread(target=record)
    thread.start()
    wait_for(lambda: len(times) > 2, "the good client is served")
    yield times
    count = len(times)
    wait_for(lambda: len(times) > count + 25, "the good client is still served")
    over.set()
    thread.join(TIMEOUT_S)
    client.__exit__()
    assert not failure
    np.testing.assert_allclose(np.diff(times), 0.008, rtol=0, atol=STEP_ERROR)


def memory_mb(controller):
    status = Path(f"/proc/{controller.process.pid}/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0]) / 1024


def drained(sock):
    """What comes until the controller hangs up."""
    sock.settimeout(TIMEOUT_S)
    found = b""
    with contextlib.suppress(ConnectionError):
        while piece := sock.recv(65536):
            found += piece
    return found


def pour(host, port, data):
    """Send without reading, as far as the controller lets us."""
    address = (host, port)
    with (
        socket.create_connection(address, timeout=TIMEOUT_S) as sock,
        contextlib.suppress(ConnectionError),
    ):
        sock.sendall(data)
        sock.shutdown(socket.SHUT_WR)


@pytest.mark.parametrize("seed", range(4))
def test_garbage_on_every_port(host, good, seed):
    junk = random.Random(seed).randbytes(20_000)
    for port in (*PORTS.values(), *READ_ONLY):
        pour(host.host, port, junk)
    assert ask_dashboard(host.host, "robotmode") == ["Robotmode: RUNNING"]


def test_rtde_garbage_is_refused_in_words(host, good):
    with socket.create_connection((host.host, rtde.PORT), timeout=TIMEOUT_S) as sock:
        sock.sendall(b"GET / HTTP/1.1\r\n\r\n")
        said = drained(sock)
    assert said[2:3] == b"M"
    assert b"no RTDE packet" in said


def test_half_packets_wait_and_are_completed(host, good):
    with RtdeClient(host.host) as client:
        for byte in rtde.frame(rtde.Kind.GET_URCONTROL_VERSION)[:-1]:
            client.socket.sendall(bytes((byte,)))
        with RtdeClient(host.host) as other:
            other.read_outputs(["timestamp"])
        client.socket.sendall(rtde.frame(rtde.Kind.GET_URCONTROL_VERSION)[-1:])
        assert len(client.reply(Kind.GET_URCONTROL_VERSION)) == 16


@pytest.mark.realtime
def test_a_thousand_connections(host, good):
    before = memory_mb(host)
    with contextlib.ExitStack() as crowd:
        socks = []
        for _ in range(1000):
            sock = socket.create_connection((host.host, rtde.PORT), timeout=TIMEOUT_S)
            socks.append(crowd.enter_context(sock))
        heard = dict.fromkeys(socks, b"")
        ended = set()

        def only_so_many_left():
            for sock in set(socks) - ended:
                sock.setblocking(False)
                with contextlib.suppress(BlockingIOError):
                    try:
                        piece = sock.recv(65536)
                    except ConnectionError:
                        piece = b""
                    heard[sock] += piece
                    if not piece:
                        ended.add(sock)
            return len(socks) - len(ended) <= CLIENTS

        # Some come when the port is full, some give way to others: all others were told.
        wait_for(only_so_many_left, "the crowd is sent away")
        words = (b"too many clients", b"needs this place")
        assert all(any(word in heard[sock] for word in words) for sock in ended)
        # Who has been silent for a second makes room for a client that speaks.

        def let_in():
            try:
                with RtdeClient(host.host) as client:
                    client.read_outputs(["timestamp"])
                    client.start()
                    return client.row()
            except OSError:
                return None

        wait_for(let_in, "a client that speaks is let in")
    assert memory_mb(host) - before < GROWTH_MB
    assert CLIENTS < 1000


def test_a_client_that_never_reads_is_given_up(host, good):
    with RtdeClient(host.host) as client:
        client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        client.read_outputs(["timestamp", *["actual_q"] * 200])
        client.start()
        wait_for(lambda: "has read nothing for" in host.said(), "the slow client is given up")


def test_floods_of_requests_and_of_mistakes(host, good):
    pour(host.host, rtde.PORT, rtde.frame(rtde.Kind.PAUSE) * 50_000)
    with socket.create_connection((host.host, rtde.PORT), timeout=TIMEOUT_S) as sock:
        sock.sendall(rtde.request_protocol(2) + frame(Kind.DATA_PACKAGE, b"\x09abc") * 200)
        assert b"too many mistakes" in drained(sock)
    with socket.create_connection((host.host, 29999), timeout=TIMEOUT_S) as sock:
        sock.sendall(b"x" * 10_000)
        assert b"no command is longer" in drained(sock)


@pytest.mark.parametrize("port", [30001, 30002, 30003])
def test_ten_megabytes_of_script_are_refused(host, good, port):
    before = memory_mb(host)
    bomb = b"def bomb():\n" + b"  x = 1 + 2 + 3\n" * 650_000
    pour(host.host, port, bomb)
    wait_for(lambda: "the program is too long" in host.said(), "the refusal")
    assert memory_mb(host) - before < GROWTH_MB


@pytest.mark.parametrize(
    "script",
    [
        "def bomb():\n  while True:\n    x = 1\n  end\nend\n",
        "def bomb():\n  def f(n):\n    return f(n + 1)\n  end\n  f(0)\nend\n",
        "def bomb():\n  x = " + "(" * 20_000 + "1" + ")" * 20_000 + "\nend\n",
        "def bomb():\n" + "if True:\n" * 5_000 + "end\n" * 5_000 + "end\n",
        'def bomb():\n  x = "aaaaaaaa"\n  while True:\n    x = str_cat(x, x)\n  end\nend\n',
        "def bomb():\n" + "  textmsg(1)\n" * 10_000 + "end\n",
    ],
    ids=["endless", "recursion", "parentheses", "blocks", "text", "messages"],
)
def test_script_bombs(host, good, script):
    before = memory_mb(host)
    lines = len(host.said().splitlines())
    send_script(host.host, script)
    wait_for(lambda: len(host.said().splitlines()) > lines, "the controller says what is wrong")
    ask_dashboard(host.host, "stop")
    assert memory_mb(host) - before < GROWTH_MB


def test_a_flood_of_programs(host, good):
    with socket.create_connection((host.host, 30002), timeout=TIMEOUT_S) as sock:
        sock.sendall(b"textmsg(1)\n" * 2000)
    wait_for(lambda: "too many are waiting" in host.said(), "programs are refused")
    assert ask_dashboard(host.host, "robotmode") == ["Robotmode: RUNNING"]


def test_a_program_cut_off_is_told(host, good):
    send_script(host.host, "def half():\n  x = 1\n")
    wait_for(lambda: "in the middle of a program" in host.said(), "the regret")


def test_floods_of_statements_for_the_interpreter(host, good):
    def interpreted():
        with socket.create_connection((host.host, 30020), timeout=TIMEOUT_S) as sock:
            sock.sendall(b"x = 1\n")
            return sock.recv(4096).startswith(b"ack: ")

    send_script(host.host, "interpreter_mode()\n")
    # Programs of the tests before may run first.
    wait_for(interpreted, "the mode")
    before = memory_mb(host)
    with socket.create_connection((host.host, 30020), timeout=TIMEOUT_S) as sock:
        # A line without an end is no statement.
        with contextlib.suppress(OSError):
            sock.sendall(b"x = " + b"1 + " * 1_000_000)
        with contextlib.suppress(OSError):
            assert b"no statement is that long" in sock.recv(4096)
    for _ in range(3):
        with socket.create_connection((host.host, 30020), timeout=TIMEOUT_S) as sock:
            # It never reads an answer, and leaves while most of them are still to come.
            sock.settimeout(0.5)
            with contextlib.suppress(OSError):
                sock.sendall(b"def f(a): return [a, a, a, a] end x = f([1, 2, 3])\n" * 5_000)
    with socket.create_connection((host.host, 30020), timeout=TIMEOUT_S) as sock:
        sock.sendall(b"skipbuffer\nend_interpreter()\n")
        assert sock.recv(4096).startswith(b"ack: ")
        wait_for(lambda: ask_dashboard(host.host, "running")[0].endswith("false"), "its end")
    assert memory_mb(host) < before + GROWTH_MB
