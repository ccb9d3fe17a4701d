"""Whatever goes wrong in the middle of `dynid run`: the robot stops, the record stays readable,
the message names the cause, the exit code is 1.

A second client watches the simulated robot all the while.
"""

from __future__ import annotations

import errno
import inspect
import io
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from controllers import Observer
from gentle_motion import CYCLES, write_gentle

from dynid.cli.app import main
from dynid.drivers.ur.link import Dashboard, RtdeLink, ScriptPort
from dynid.experiment import check_robot
from dynid.recording import ExperimentRecord, read_record
from urtwin import RunningController, controller_process, own_address
from urtwin.server import LEAD_S

STOP_S = 0.1
"""Controller time within which the robot must stop [s]."""
CYCLE_S = 0.008
TOGETHER_S = 2 * CYCLE_S
"""Virtual time sends two packages at once: what the first brings is seen so much later [s]."""
STILL = 0.01
"""Speed of a joint that stands still, sensor noise included [rad/s]."""
REPEAT = 2
RANDOM_TIMES, MORE_TIMES = range(2), range(2, 8)
UNLOCK_S = 5.5


@pytest.fixture(scope="module")
def controller() -> Iterator[RunningController]:
    with controller_process("ur5", host=own_address(), virtual_time=True) as running:
        yield running


def said_of_the_stop(record: ExperimentRecord) -> str:
    """What the recording says of why it ended; empty for nothing."""
    return "; ".join(found.text for found in record.problems if found.kind == "aborted")


class Fault:
    """One run with something that happens in it."""

    def __init__(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.design = write_gentle(tmp_path / "design.json")
        self.record = tmp_path / "run.parquet"
        self._capsys = capsys
        self.at = 0.0
        """Controller time of the fault [s]."""
        self.code, self.err = -1, ""

    def run(
        self, host: str, happen: Callable[[Observer], None] | None, index: int = 200
    ) -> Observer:
        """Run, let something happen at an index, and see the robot come to rest."""
        with Observer(host) as observer:

            def work() -> None:
                observer.wait_for_index(index)
                self.at = float(observer.column("timestamp")[-1])
                if happen is not None:
                    happen(observer)

            thread = threading.Thread(target=work)
            thread.start()
            self._capsys.readouterr()
            words = ["run", self.design, "--on", f"ur://{host}", "-o", self.record, "--yes"]
            self.code = main([*map(str, words), "--repeat", str(REPEAT)])
            thread.join()
            observer.wait_for(lambda package: observer.number(package, "runtime_state") == 1)
            rest = float(observer.column("timestamp")[-1]) + 2 * STOP_S
            observer.wait_for(lambda package: observer.number(package, "timestamp") > rest)
        self.err = self._capsys.readouterr().err
        return observer

    def stopped_after(self, observer: Observer) -> float:
        """Controller time from the fault until the simulated robot stood still for good [s]."""
        t, qd = observer.columns("timestamp", "actual_qd")
        speed = np.abs(qd).max(axis=1)
        assert speed[-1] < STILL
        assert speed[t <= self.at][-50:].max() > STILL, "it moved when the fault came"
        return float(t[speed >= STILL][-1]) + CYCLE_S - self.at

    def check_record(self) -> ExperimentRecord:
        record = read_record(self.record)
        assert 10 < record.samples < REPEAT * CYCLES
        np.testing.assert_allclose(np.diff(record.t), CYCLE_S, rtol=0, atol=1e-9)
        # The motion alone, none of the braking.
        np.testing.assert_array_equal(record.channels["index"], np.arange(record.samples))
        assert record.metadata.extra["period_s"] == "2.0"
        assert said_of_the_stop(record)
        return record

    def check(self, observer: Observer, name: str, normal: float, *words: str) -> None:
        """All that a fault must end in, from the cycle on in which a variable leaves its norm."""
        t, value = observer.columns("timestamp", name)
        self.at = float(t[(t >= self.at) & (value != normal)][0])
        assert self.code == 1
        for word in words:
            assert word in self.err
        assert len(self.err.strip().splitlines()) == 1
        assert self.stopped_after(observer) <= STOP_S
        assert words[0] in said_of_the_stop(self.check_record())


@pytest.fixture
def fault(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Fault:
    return Fault(tmp_path, capsys)


def move_slider(host: str, to: float) -> None:
    with closing(RtdeLink(host)) as link:
        slider = link.ask_inputs(["speed_slider_mask", "speed_slider_fraction"])
        link.write(slider.packet([1, to]))
        # Answered after the slider was set: the connection must not end before.
        link.ask_outputs(["timestamp"])


def test_the_speed_slider_moves(controller: RunningController, fault: Fault) -> None:
    try:
        observer = fault.run(controller.host, lambda _: move_slider(controller.host, 0.5))
    finally:
        move_slider(controller.host, 1.0)
    fault.check(observer, "target_speed_fraction", 1.0, "speed slider was moved to 50 %")


def test_somebody_stops_the_program(controller: RunningController, fault: Fault) -> None:
    def stop(_: Observer) -> None:
        board = Dashboard(controller.host)
        board.ask("stop")
        board.close()

    observer = fault.run(controller.host, stop)
    fault.check(observer, "runtime_state", 2, "the program on the controller is stopped")


def test_the_disk_is_full(
    controller: RunningController, fault: Fault, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, watching = os.write, list[Observer]()

    def refuse(file: int, data: bytes) -> int:
        if watching and "run.parquet" in os.readlink(f"/proc/self/fd/{file}"):
            if fault.code == -1:
                fault.at = float(watching[0].column("timestamp")[-1]) + LEAD_S
                fault.code = 0
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(file, data)

    monkeypatch.setattr(os, "write", refuse)
    observer = fault.run(controller.host, watching.append)
    monkeypatch.undo()
    assert fault.code == 1
    assert "No space left on device" in fault.err
    # The recording is there: no command is needed to read it.
    assert "dynid import" not in fault.err
    assert fault.stopped_after(observer) <= STOP_S
    record = read_record(fault.record)
    assert record.samples > 50
    assert not fault.record.exists() or said_of_the_stop(record)


@pytest.mark.parametrize(
    "seed", [*RANDOM_TIMES, *(pytest.param(k, marks=pytest.mark.long) for k in MORE_TIMES)]
)
def test_ctrl_c_at_a_random_time(controller: RunningController, fault: Fault, seed: int) -> None:
    index = int(np.random.default_rng(seed).integers(20, REPEAT * CYCLES - 50))

    def interrupt(observer: Observer) -> None:
        handler = signal.getsignal(signal.SIGINT)
        wish: threading.Event = inspect.getclosurevars(handler).nonlocals["event"]  # pyright: ignore[reportArgumentType]
        # Signals take wall time, of which virtual time knows nothing: it waits.
        with observer.time_stands_still():
            os.kill(os.getpid(), signal.SIGINT)
            assert wish.wait(10.0)
            fault.at = float(observer.column("timestamp")[-1]) + LEAD_S + TOGETHER_S

    observer = fault.run(controller.host, interrupt, index)
    assert fault.code == 1
    assert "it was interrupted" in fault.err
    t = observer.column("timestamp")
    after = t > fault.at + STOP_S
    assert np.abs(observer.column("actual_qd"))[after].max() < STILL
    assert fault.check_record().samples >= index - 5


def test_a_protective_stop(controller: RunningController, fault: Fault) -> None:
    def bump(_: Observer) -> None:
        port = ScriptPort(controller.host)
        port.send("sec bump():\n  protective_stop()\nend\n")
        port.close()

    observer = fault.run(controller.host, bump)
    fault.check(observer, "safety_mode", 1, "safety mode became protective stop")
    # And while it lasts, the preflight lets nothing move.
    again = fault.record.with_name("again.parquet")
    words = ["run", fault.design, "--on", f"ur://{controller.host}", "-o", again, "--yes"]
    assert main([str(word) for word in words]) == 1
    assert not again.exists()
    with Observer(controller.host) as waiting:
        unlock = fault.at + UNLOCK_S
        waiting.wait_for(lambda package: waiting.number(package, "timestamp") > unlock)
    board = Dashboard(controller.host)
    assert board.ask("unlock protective stop") == "Protective stop releasing"
    board.close()


def test_the_controller_dies(fault: Fault) -> None:
    with (
        controller_process("ur5", host=own_address(), virtual_time=True) as running,
        Observer(running.host) as observer,
    ):

        def kill() -> None:
            observer.wait_for_index(200)
            running.kill()

        thread = threading.Thread(target=kill)
        thread.start()
        words = ["run", fault.design, "--on", f"ur://{running.host}", "-o", fault.record]
        code = main([*map(str, words), "--yes"])
        thread.join()
    assert code == 1
    record = fault.check_record()
    assert "connection" in said_of_the_stop(record)
    assert record.samples >= 190


def test_another_program_takes_over_on_the_way_to_the_start(
    fault: Fault, capsys: pytest.CaptureFixture[str]
) -> None:
    with (
        controller_process("ur5", host=own_address(), virtual_time=True) as running,
        Observer(running.host) as observer,
    ):

        def take_over() -> None:
            speeds = observer.layout.places["actual_qd"]
            observer.wait_for(lambda package: max(map(abs, package[speeds])) > 10 * STILL)
            with closing(ScriptPort(running.host)) as port:
                port.send("def other():\n  movej([2, -1.6, 0, -1.6, 1, 0], a=0.5, v=0.5)\nend\n")

        thread = threading.Thread(target=take_over)
        thread.start()
        words = ["run", fault.design, "--on", f"ur://{running.host}", "-o", fault.record]
        code = main([*map(str, words), "--yes"])
        thread.join()
        assert code == 1
        assert "another program" in capsys.readouterr().err
        # The other motion would take seconds.
        observer.wait_for(lambda package: observer.number(package, "runtime_state") == 1)
        assert np.abs(observer.column("actual_q")[-1] - [2, -1.6, 0, -1.6, 1, 0]).max() > 1.0
    assert not list(fault.record.parent.glob("run*"))


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_run_that_is_refused_leaves_no_file(
    controller: RunningController, fault: Fault, capsys: pytest.CaptureFixture[str]
) -> None:
    with closing(RtdeLink(controller.host)) as other:
        other.ask_inputs(["input_int_register_24"])
        words = ["run", fault.design, "--on", f"ur://{controller.host}", "-o", fault.record]
        assert main([*map(str, words), "--yes"]) == 1
    assert "IN_USE" in capsys.readouterr().err
    assert not list(fault.record.parent.glob("run*"))


def test_nothing_moves_without_a_typed_word(
    controller: RunningController,
    fault: Fault,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    words = ["run", fault.design, "--on", f"ur://{controller.host}", "-o", fault.record]
    with Observer(controller.host) as observer:
        for typed in (io.StringIO(), Terminal("yes\n"), Terminal("\n")):
            monkeypatch.setattr(sys, "stdin", typed)
            assert main([str(word) for word in words]) == 2
        said = capsys.readouterr().err
        assert "Pass --yes" in said
        assert "was not confirmed" in said
        assert (observer.column("runtime_state") == 1).all()
        assert np.abs(observer.column("actual_qd")).max() < STILL
    assert not fault.record.exists()
    monkeypatch.setattr(sys, "stdin", Terminal(f"{controller.host}\n"))
    assert main([*map(str, words), "--repeat", "1"]) == 0
    said = capsys.readouterr().err
    for fact in ("payload: 0 kg set", "mounted as: floor", "UR5, software", "1 x 2 s"):
        assert fact in said


def test_no_progress_is_drawn_over_the_question(
    controller: RunningController, fault: Fault, monkeypatch: pytest.MonkeyPatch
) -> None:
    err, drawn = Terminal(), list[str]()

    def think(*_: object, **__: object) -> str:
        before = len(err.getvalue())
        time.sleep(0.3)
        drawn.append(err.getvalue()[before:])
        return controller.host

    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stdin", Terminal())
    monkeypatch.setattr(sys, "stderr", err)
    monkeypatch.setattr("typer.prompt", think)
    words = ["run", fault.design, "--on", f"ur://{controller.host}", "-o", fault.record]
    assert main([*map(str, words), "--repeat", "1"]) == 0
    assert drawn == [""]
    assert "run: run" in err.getvalue()


def test_the_state_of_the_robot_is_told_before_a_way_is_searched(
    controller: RunningController,
    fault: Fault,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def searched(*_: object, **__: object) -> None:
        raise AssertionError

    monkeypatch.setattr("dynid.experiment.plan_approach", searched)
    words = ["run", fault.design, "--on", f"ur://{controller.host}", "-o", fault.record, "--yes"]
    try:
        move_slider(controller.host, 0.5)
        assert main([*map(str, words)]) == 1
        assert "speed slider: 50 %" in capsys.readouterr().err
    finally:
        move_slider(controller.host, 1.0)


@pytest.mark.parametrize("yes", [(), ("--yes",)])
def test_ctrl_c_before_the_question_ends_the_run(
    yes: tuple[str, ...],
    controller: RunningController,
    fault: Fault,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def interrupted(*given: Any) -> Any:
        signal.raise_signal(signal.SIGINT)
        return check_robot(*given)

    monkeypatch.setattr("dynid.experiment.check_robot", interrupted)
    monkeypatch.setattr(sys, "stdin", Terminal(f"{controller.host}\n"))
    words = ["run", fault.design, "--on", f"ur://{controller.host}", "-o", fault.record]
    assert main([*map(str, words), *yes]) == 130
    assert "Type" not in capsys.readouterr().err
    assert not fault.record.exists()


def test_nobody_is_there(fault: Fault, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["run", fault.design, "--on", f"ur://{own_address()}", "-o", fault.record, "--yes"]
    assert main([str(word) for word in words]) == 1
    assert "no connection to the controller" in capsys.readouterr().err
    assert not fault.record.exists()


def test_somebody_else_than_a_robot_answers(fault: Fault) -> None:
    host = own_address()
    with socket.create_server((host, 30004)) as server:

        def answer() -> None:
            client, _ = server.accept()
            client.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")
            client.recv(100)
            client.close()

        thread = threading.Thread(target=answer)
        thread.start()
        words = ["run", fault.design, "--on", f"ur://{host}", "-o", fault.record, "--yes"]
        assert main([str(word) for word in words]) == 1
        thread.join()
