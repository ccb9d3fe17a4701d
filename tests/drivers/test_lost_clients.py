"""Clients that die, freeze or lose the network, in real time: the controller's watchdog stops the
robot, and what was recorded can be read."""

from __future__ import annotations

import json
import os
import selectors
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest
from controllers import Observer
from gentle_motion import write_gentle

from dynid.drivers.driver import WATCHDOG_HZ
from dynid.drivers.ur.link import SILENCE_S
from dynid.recording import read_record
from urtwin import RunningController, controller_process, own_address

pytestmark = pytest.mark.realtime

STOP_S = 0.1
"""Controller time from the program's end to standstill, at most [s]."""
CYCLE_S = 0.008
STILL = 0.01
"""[rad/s]"""
AT = 100
"""Index at which things happen."""
PORTS = (29999, 30002, 30003, 30004)


@pytest.fixture(scope="module")
def controller() -> Iterator[RunningController]:
    with controller_process("ur5", host=own_address()) as running:
        yield running


@contextmanager
def client(host: str, folder: Path, *more: str) -> Iterator[subprocess.Popen[str]]:
    design = write_gentle(folder / "design.json")
    words = ["run", design, "--on", f"ur://{host}", "-o", folder / "run.parquet", "--yes"]
    process = subprocess.Popen(
        [sys.executable, "-m", "dynid", *map(str, words), "--repeat", "20", *more],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    except AssertionError as error:
        process.kill()
        error.add_note(f"the client said: {process.communicate()[1][-2000:]}")
        raise
    finally:
        process.kill()
        process.communicate()


def check_stop(observer: Observer) -> None:
    """The program ended one watchdog period after the last feed; the arm stood still soon after."""
    observer.wait_for(lambda package: observer.number(package, "runtime_state") == 1)
    end = float(observer.column("timestamp")[-1]) + 3 * STOP_S
    observer.wait_for(lambda package: observer.number(package, "timestamp") > end)
    t, state, qd = observer.columns("timestamp", "runtime_state", "actual_qd")
    playing, speed = state == 2, np.abs(qd).max(axis=1)
    stopped = float(t[playing][-1]) + CYCLE_S
    assert speed[playing][-20:].max() > STILL, "it moved when the program ended"
    assert float(t[speed >= STILL][-1]) + CYCLE_S - stopped <= STOP_S


def check_record(folder: Path, least: int = AT - 70) -> None:
    # Rows reach the file twice a second.
    record = read_record(folder / "run.parquet")
    assert record.samples >= least
    np.testing.assert_array_equal(np.diff(record.channels["index"])[: least - 1], 1.0)
    assert record.problems


def test_the_client_is_killed(controller: RunningController, tmp_path: Path) -> None:
    with Observer(controller.host) as observer, client(controller.host, tmp_path) as process:
        observer.wait_for_index(AT)
        process.send_signal(signal.SIGKILL)
        process.wait()
        at = float(observer.column("timestamp")[-1])
        check_stop(observer)
        t, state = observer.columns("timestamp", "runtime_state")
        assert float(t[state == 2][-1]) - at <= 1.0 / WATCHDOG_HZ + 2 * CYCLE_S
    assert not (tmp_path / "run.parquet").exists()
    check_record(tmp_path)


def test_the_client_freezes_and_the_watchdog_starves(
    controller: RunningController, tmp_path: Path
) -> None:
    with Observer(controller.host) as observer, client(controller.host, tmp_path) as process:
        observer.wait_for_index(AT)
        process.send_signal(signal.SIGSTOP)
        check_stop(observer)
        process.send_signal(signal.SIGCONT)
        _, said = process.communicate(timeout=30)
    assert process.returncode == 1
    assert "watchdog was not fed in time" in said
    assert "input_int_register_24" in said, "the controller's own words are passed on"
    check_record(tmp_path, AT - 5)


class Cable:
    """A network between client and controller that can be cut."""

    def __init__(self, host: str, to: str) -> None:
        self.silent, self._end = threading.Event(), threading.Event()
        self._servers = [socket.create_server((host, port)) for port in PORTS]
        self._to = to
        self._pairs: dict[socket.socket, socket.socket] = {}
        self._selector = selectors.DefaultSelector()
        for server in self._servers:
            self._selector.register(server, selectors.EVENT_READ)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._end.is_set():
            for key, _ in self._selector.select(0.05):
                source = key.fileobj
                assert isinstance(source, socket.socket)
                if source.fileno() < 0:
                    continue
                if source in self._servers:
                    self._join(source)
                elif not self.silent.is_set():
                    self._pass(source)
                else:
                    self._selector.unregister(source)

    def _join(self, server: socket.socket) -> None:
        near, _ = server.accept()
        far = socket.create_connection((self._to, server.getsockname()[1]))
        for one, other in ((near, far), (far, near)):
            one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._pairs[one] = other
            self._selector.register(one, selectors.EVENT_READ)

    def _pass(self, source: socket.socket) -> None:
        try:
            data = source.recv(65536)
            if data:
                self._pairs[source].sendall(data)
                return
        except OSError:
            pass
        for one in (source, self._pairs[source]):
            if one.fileno() >= 0:
                # Not there any more if it spoke in the silence.
                with suppress(KeyError):
                    self._selector.unregister(one)
                one.close()

    def close(self) -> None:
        """Pull the plug: both sides are told."""
        self._end.set()
        self._thread.join()
        for one in (*self._pairs, *self._servers):
            one.close()


@pytest.mark.parametrize(
    ("way", "words"),
    [("silence", "sends nothing any more"), ("closed", "connection")],
)
def test_the_network_is_cut(
    controller: RunningController, tmp_path: Path, way: str, words: str
) -> None:
    host = own_address()
    cable = Cable(host, controller.host)
    try:
        with Observer(controller.host) as observer, client(host, tmp_path) as process:
            observer.wait_for_index(AT)
            cable.silent.set() if way == "silence" else cable.close()
            check_stop(observer)
            _, said = process.communicate(timeout=30)
    finally:
        cable.close()
    assert process.returncode == 1
    assert words in said
    check_record(tmp_path, AT - 20)
    problems = read_record(tmp_path / "run.parquet").problems
    assert "aborted" in [problem.kind for problem in problems]


def test_the_network_comes_back_under_a_stream(
    controller: RunningController, tmp_path: Path
) -> None:
    """ur_rtde reconnects by itself: its process crashed, its program was started again."""
    pytest.importorskip("rtde_control")
    host = own_address()
    cable = Cable(host, controller.host)
    try:
        with (
            Observer(controller.host) as observer,
            client(host, tmp_path, "--method", "servoj", "--json") as process,
        ):
            speeds = observer.layout.places["actual_qd"]
            # ur_rtde may take 20 s for its connection, and for each call.
            observer.wait_for(lambda package: max(map(abs, package[speeds])) > 10 * STILL, 60.0)
            cable.silent.set()
            over = float(observer.column("timestamp")[-1]) + SILENCE_S + 0.3
            observer.wait_for(lambda package: observer.number(package, "timestamp") > over)
            cable.silent.clear()
            printed, said = process.communicate(timeout=30)
            end = float(observer.column("timestamp")[-1]) + 1.0
            observer.wait_for(lambda package: observer.number(package, "timestamp") > end)
            t, state = observer.columns("timestamp", "runtime_state")
    finally:
        cable.close()
    assert process.returncode == 1
    assert json.loads(printed)["cause"]["code"] == "connection"
    assert "sends nothing any more" in said
    assert (state[t > float(t[-1]) - 1.0] == 1).all()


def test_ctrl_c_in_the_terminal(controller: RunningController, tmp_path: Path) -> None:
    with Observer(controller.host) as observer, client(controller.host, tmp_path) as process:
        observer.wait_for_index(AT)
        at = float(observer.column("timestamp")[-1])
        os.kill(process.pid, signal.SIGINT)
        check_stop(observer)
        _, said = process.communicate(timeout=30)
        t, qd = observer.columns("timestamp", "actual_qd")
        stood = float(t[np.abs(qd).max(axis=1) >= STILL][-1]) + CYCLE_S
    assert process.returncode == 1
    assert "it was interrupted" in said
    assert stood - at <= 2 * STOP_S, "wall time of the signal included"
    check_record(tmp_path, AT - 5)
