"""The UR driver against a simulated controller in a process of its own, in virtual time."""

from __future__ import annotations

import gc
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from controllers import Observer
from gentle_motion import CYCLES, MIDDLE, RATE, ListRecorder, gentle, gentle_execution

from dynid.core import InputError, JobError
from dynid.drivers import Cycle, Outcome, ServojDriver, UrDriver, inspect
from dynid.drivers.ur.driver import APPROACH, SLACK, Stream, Way
from dynid.drivers.ur.link import (
    CONNECT_S,
    SILENCE_S,
    STOP_PROGRAM,
    Dashboard,
    RtdeLink,
    ScriptPort,
)
from dynid.drivers.ur.pump import Refused
from dynid.drivers.ur.variables import recorded
from dynid.protocol import OUTPUTS, Framer, Kind, Recipe, rtde
from urtwin import RunningController, controller_process, own_address

SAME = 1e-12
"""Between periods [rad]."""
SAME_PLACE = 1e-4
"""[rad]"""
SLOW = 0.01
"""[rad/s]"""
STILL = 1e-6
"""[rad/s]"""
FOLLOWS = 0.004
"""Distance of the target from the motion, delayed [rad]."""
LATEST_S = 0.08
"""The longest delay: lookahead, and the cycles that a stream takes."""

STALL_CYCLES = 1000
"""Control cycles of a stall of the disk: 8 s of controller time."""


@pytest.fixture(scope="module")
def controller() -> Iterator[RunningController]:
    with controller_process("ur5", host=own_address(), virtual_time=True) as running:
        yield running


def test_the_state_is_what_the_controller_is(controller: RunningController) -> None:
    state = inspect(controller.host)
    assert state.model == "UR5"
    assert ".".join(map(str, state.version)) == controller.version
    assert (state.rate_hz, state.robot_mode, state.safety_mode) == (125.0, 7, 1)
    assert state.remote is None
    assert (state.temperature > 20).all()


def test_old_software_is_not_asked_for_its_model() -> None:
    """That it does not understand the question was taken for the name of its model."""
    with controller_process("ur5", host=own_address(), software="3.11.0") as old:
        state = inspect(old.host)
    assert (state.version[:2], state.model, state.remote) == ((3, 11), "", None)


@pytest.fixture(scope="module")
def three(controller: RunningController) -> tuple[Outcome, ListRecorder]:
    recorder = ListRecorder()
    driver = UrDriver(inspect(controller.host))
    outcome = driver.execute(gentle_execution(3, settle=1), recorder)
    return outcome, recorder


def test_every_index_is_there_once(three: tuple[Outcome, ListRecorder]) -> None:
    outcome, recorder = three
    assert (outcome.samples, outcome.periods, outcome.gaps) == (3 * CYCLES, 3, 0)
    assert outcome.abort is None
    index = recorder.channel("index")
    np.testing.assert_array_equal(index, np.arange(CYCLES, 4 * CYCLES))
    steps = np.diff(recorder.channel("timestamp"))
    np.testing.assert_allclose(steps, 0.008, rtol=0, atol=1e-9)


def follows(recorder: ListRecorder) -> tuple[float, float]:
    """The delay [s] at which the target is closest to the motion, and how close that is [rad]."""
    t, target = recorder.channel("index") / RATE, recorder.array("target_q")
    inside = t > LATEST_S

    def error(delay: float) -> float:
        return float(np.abs(target - gentle().evaluate(t - delay).q)[inside].max())

    best = min(np.arange(0.0, LATEST_S, 0.001), key=error)
    return best, error(best)


def test_the_periods_have_the_same_targets(three: tuple[Outcome, ListRecorder]) -> None:
    targets = three[1].array("target_q").reshape(3, CYCLES, 6)
    assert np.abs(targets - targets[0]).max() <= SAME
    delay, error = follows(three[1])
    # What `servoj` was asked for: lookahead_time=0.03, set points joined a cycle late.
    assert 0.03 <= delay <= 0.05
    assert error < FOLLOWS
    assert np.abs(three[1].array("q") - three[1].array("target_q")).max() < FOLLOWS


def test_the_packages_are_recorded_whole(three: tuple[Outcome, ListRecorder]) -> None:
    recorder = three[1]
    assert (recorder.channel("robot_mode") == 7).all()
    assert (recorder.channel("speed_scaling") == 1).all()
    assert (recorder.channel("runtime_state") == 2).all()
    for joint in range(1, 7):
        assert np.isfinite(recorder.channel(f"joint_control_output_{joint}")).all()
    assert np.abs(recorder.array("current")).max() > 0
    assert (np.abs(recorder.array("temperature") - 24) < 5).all()


def test_what_is_recorded_is_what_another_client_saw(controller: RunningController) -> None:
    recorder = ListRecorder()
    with Observer(controller.host) as observer:
        UrDriver(inspect(controller.host)).execute(gentle_execution(), recorder)
        seen = observer.column("timestamp")
        rows = np.searchsorted(seen, recorder.channel("timestamp") - 1e-4)
        np.testing.assert_array_equal(seen[rows], recorder.channel("timestamp"))
        for name, field in (("q", "actual_q"), ("current", "actual_current")):
            np.testing.assert_array_equal(observer.column(field)[rows], recorder.array(name))


def test_a_disk_that_stalls_loses_nothing_and_stops_nobody(controller: RunningController) -> None:
    class Stalled(ListRecorder):
        def append(self, t, signals, channels=None) -> None:
            if not self.t:
                observer.wait_for_index(STALL_CYCLES)
            super().append(t, signals, channels)

    recorder = Stalled()
    with Observer(controller.host) as observer:
        outcome = UrDriver(inspect(controller.host)).execute(gentle_execution(5), recorder)
    assert outcome.abort is None
    assert (outcome.samples, outcome.gaps, len(recorder.t)) == (5 * CYCLES, 0, 5 * CYCLES)


def test_a_stop_is_wished_and_the_robot_stands_still(controller: RunningController) -> None:
    cancel, recorder = threading.Event(), ListRecorder()
    with Observer(controller.host) as observer:

        def wish() -> None:
            observer.wait_for_index(120)
            cancel.set()

        thread = threading.Thread(target=wish)
        thread.start()
        outcome = UrDriver(inspect(controller.host)).execute(
            gentle_execution(2), recorder, cancel=cancel
        )
        thread.join()
        speeds = observer.layout.places["target_qd"]
        observer.wait_for(lambda package: max(map(abs, package[speeds])) < STILL)
    assert outcome.abort is not None
    assert outcome.abort.code == "interrupted"
    assert 100 < outcome.samples < 2 * CYCLES


@pytest.mark.parametrize("driver", [UrDriver, ServojDriver])
def test_a_wish_from_before_keeps_the_robot_from_moving(
    controller: RunningController, driver: type[UrDriver | ServojDriver]
) -> None:
    if driver is ServojDriver:
        pytest.importorskip("rtde_control")
    cancel = threading.Event()
    cancel.set()
    with Observer(controller.host) as observer:
        outcome = driver(inspect(controller.host)).execute(
            gentle_execution(), ListRecorder(), cancel=cancel
        )
        assert outcome.abort is not None
        assert outcome.abort.code == "interrupted"
        assert outcome.samples == 0
        assert np.abs(observer.column("target_qd")).max() < STILL


@pytest.mark.parametrize("driver", [UrDriver, ServojDriver])
def test_a_program_that_was_started_between_two_passes_runs_on(
    controller: RunningController, driver: type[UrDriver | ServojDriver]
) -> None:
    """Ours took its place, and told nothing of it."""
    if driver is ServojDriver:
        pytest.importorskip("rtde_control")
    state = inspect(controller.host)
    with closing(ScriptPort(controller.host)) as port, Observer(controller.host) as seen:
        port.send("def other():\n  while True:\n    sync()\n  end\nend\n")
        seen.wait_for(lambda row: seen.number(row, "runtime_state") == 2)
        with pytest.raises(JobError, match=r"another program runs.*playing"):
            driver(state).execute(gentle_execution(), None)
        assert seen.number(seen.packages[-1], "runtime_state") == 2
        port.send(STOP_PROGRAM)
        seen.wait_for(lambda row: seen.number(row, "runtime_state") == 1)


def test_what_is_loaded_is_not_collected_while_the_arm_moves(controller: RunningController) -> None:
    """A collection of all objects took 0.09 s, the watchdog waits for 0.1 s."""
    loaded: list[list[int]] = [[] for _ in range(200_000)]
    looked_at: list[int] = []

    class Counting(ListRecorder):
        def append(self, t, signals, channels=None) -> None:
            if not looked_at:
                looked_at.append(len(gc.get_objects()))

    UrDriver(inspect(controller.host)).execute(gentle_execution(1), Counting())
    assert looked_at[0] < len(loaded)
    assert len(gc.get_objects()) > len(loaded)


def test_another_run_follows_a_stop(controller: RunningController) -> None:
    outcome = UrDriver(inspect(controller.host)).execute(gentle_execution(), ListRecorder())
    assert outcome.abort is None
    assert outcome.samples == CYCLES


POINTS = tuple(MIDDLE + np.array(by) for by in ([0.2] * 6, [0.2, -0.1, 0.1, 0.3, 0.0, -0.4]))


def test_it_rests_at_every_way_point(controller: RunningController) -> None:
    state = inspect(controller.host)
    execution = replace(gentle_execution(1), via=(state.q, *POINTS))
    with Observer(controller.host) as observer:
        outcome = UrDriver(state).execute(execution, None)
        q, qd = observer.columns("target_q", "target_qd")
    assert outcome.abort is None
    away = np.stack([np.abs(q - point).max(axis=1) for point in POINTS])
    reached = away.argmin(axis=1)
    assert away.min(axis=1).max() < SAME_PLACE
    # A blend would pass at half a rad/s; one cycle of braking is 0.004 rad/s.
    assert np.abs(qd[reached]).max() < SLOW
    assert reached[0] < reached[1]


class _Control:
    """Stands for ur_rtde's: a move takes two looks."""

    def __init__(self, reach: float = 1.0, *, runs: bool = True) -> None:
        self.moves: list[list[float]] = []
        self.kicked, self.served = threading.Event(), threading.Event()
        self.q, self._reach, self._runs, self._left = [0.0] * 6, reach, runs, 0

    def setWatchdog(self, least_hz: float) -> bool:
        return self._runs

    def kickWatchdog(self) -> bool:
        self.kicked.set()
        return self._runs

    def moveJ(self, q: list[float], speed: float, acceleration: float, wait: bool) -> bool:
        assert self._left == 0, "the last move has not ended"
        self.moves.append(q)
        self.q, self._left = [self._reach * value for value in q], 2
        return True

    def getAsyncOperationProgress(self) -> int:
        self._left = max(self._left - 1, 0)
        return 0 if self._left > 0 else -1

    def servoJ(self, q: list[float], *_: float) -> bool:
        self.served.set()
        return True


def _stream(control: _Control, packages: int) -> list[bytes | None]:
    """What is answered to packages that arrive at the end of the way to the start."""
    execution = gentle_execution()
    layout, feed = recorded((3, 15, 8)), Recipe.of(["input_int_register_24"], ["INT32"], 1)
    way = Way(control, (*POINTS, execution.setpoints()[0]))
    port: Any = None
    stream = Stream(control, layout, feed, port, execution, way)
    # A register that nobody has written holds the number of the first set point.
    still = dict.fromkeys(("q", "qd", "target_q"), np.zeros(6))
    assert not stream.begun(Cycle(timestamp=0.0, index=0, **still), ())
    assert stream.begun(Cycle(timestamp=0.0, index=-1, **still), ())
    try:
        while not way.arrived.wait(0.01) and way.is_alive():
            pass
        # Until packages arrive, by a slow network for instance, its watchdog needs something too.
        for _ in range(3):
            control.kicked.clear()
            assert not way.arrived.is_set() or control.kicked.wait(10.0)
        numbers = [0.0] * max(place.stop for place in layout.places.values())
        numbers[layout.places["target_q"]] = control.q
        answers: list[bytes | None] = []
        for index in range(packages):
            numbers[layout.places[layout.index]] = [index]
            answers.append(stream.answer(numbers))
        return answers
    finally:
        way.leave()


def test_streaming_starts_after_the_same_way_and_its_watchdog_is_always_fed() -> None:
    control = _Control()
    assert all(_stream(control, 3))
    np.testing.assert_array_equal(control.moves, [*POINTS, gentle_execution().setpoints()[0]])


def test_no_set_point_is_sent_to_an_arm_that_is_elsewhere() -> None:
    control = _Control(reach=0.9)
    with pytest.raises(Refused, match="ended elsewhere"):
        _stream(control, 40)
    ended = _Control(runs=False)
    with pytest.raises(Refused, match="ended on the way"):
        _stream(ended, 1)
    assert not control.served.is_set()
    assert not ended.served.is_set()


def test_an_arm_that_another_program_holds_is_streamed_to_no_more() -> None:
    """The numbers of the set points, which are our own, went on to the last one."""
    control = _Control()
    with pytest.raises(Refused, match="another program"):
        _stream(control, CYCLES)


def test_no_program_of_ur_rtde_is_left_where_the_recording_cannot_begin(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It played on without a watchdog, and the next run was refused because of it."""
    called = list[str]()

    class Begun:
        def __init__(self, host: str) -> None: ...

        def __getattr__(self, name: str) -> Callable[[], None]:
            return lambda: called.append(name)

    monkeypatch.setattr("dynid.drivers.ur.driver.UrRtde", Begun)
    for name in ("driver.require", "variables.require_free"):
        monkeypatch.setattr(f"dynid.drivers.ur.{name}", lambda *_: None)
    connected(monkeypatch, Line(ANSWERS))
    driver = ServojDriver(inspect("127.9.9.9"))
    connected(monkeypatch, Line({}))
    with pytest.raises(JobError, match="closed the connection"):
        driver.execute(gentle_execution(), None)
    assert called == ["stopScript", "close"]


# Where it stands after 45 s, if the arm does not move.
APPROACHES = """
import faulthandler, sys
faulthandler.dump_traceback_later(45)
from dataclasses import replace
from gentle_motion import MIDDLE, gentle_execution
from dynid.drivers import ServojDriver, inspect
state = inspect(sys.argv[1])
via = (state.q, MIDDLE + 2.0)
ServojDriver(state).execute(replace(gentle_execution(1), via=via), None)
"""


@pytest.mark.realtime
def test_the_way_to_the_start_ends_with_the_process() -> None:
    """It went on to the next way point, with nobody watching."""
    pytest.importorskip("rtde_control")
    with controller_process("ur5", host=own_address()) as running, Observer(running.host) as seen:
        words = [sys.executable, "-c", APPROACHES, running.host]
        with subprocess.Popen(words, cwd=Path(__file__).parent) as process:
            # ur_rtde may take 20 s for its connection, and for each call.
            seen.wait_for(lambda row: abs(seen.number(row, "target_qd")) > 0.9 * APPROACH, 60.0)
            process.kill()
        seen.wait_for(lambda row: abs(seen.number(row, "target_qd")) < STILL)
        q = seen.column("target_q")
        assert np.abs(q[-1] - (MIDDLE + 2.0)).max() > 0.5


@pytest.mark.realtime
def test_the_way_to_the_start_ends_where_a_stop_is_not_obeyed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The program of ur_rtde was kept alive for 3 s, in which the arm went on by 1.5 rad."""
    pytest.importorskip("rtde_control")
    monkeypatch.setattr("dynid.drivers.ur.driver.STOP_PROGRAM", "")
    cancel = threading.Event()
    with controller_process("ur5", host=own_address()) as running, Observer(running.host) as seen:
        state = inspect(running.host)
        far = replace(gentle_execution(1), via=(state.q, MIDDLE + 2.0))
        driver = ServojDriver(state)
        run = threading.Thread(target=driver.execute, args=(far, None), kwargs={"cancel": cancel})
        run.start()
        seen.wait_for(lambda row: abs(seen.number(row, "target_qd")) > 0.9 * APPROACH, 60.0)
        before = seen.packages[-1]
        cancel.set()
        run.join()
    place = seen.layout.places["target_q"]
    way = np.subtract(seen.packages[-1][place], before[place])
    assert np.abs(way).max() < 0.5


@pytest.mark.realtime
def test_set_points_can_be_streamed_by_ur_rtde(controller: RunningController) -> None:
    pytest.importorskip("rtde_control")
    recorder = ListRecorder()
    driver = ServojDriver(inspect(controller.host))
    outcome = driver.execute(gentle_execution(2), recorder)
    assert outcome.abort is None
    index = recorder.channel("index")
    assert 2 * CYCLES - 1 - index[-1] <= SLACK
    # Virtual time waits for each set point: none is skipped, none used twice.
    assert set(np.diff(index)) == {1}
    np.testing.assert_allclose(np.diff(recorder.channel("timestamp")), 0.008, rtol=0, atol=1e-9)
    assert follows(recorder)[1] < FOLLOWS


def test_another_client_on_our_register_is_named(controller: RunningController) -> None:
    with closing(RtdeLink(controller.host)) as other:
        other.ask_inputs(["input_int_register_24"])
        with pytest.raises(JobError, match="IN_USE"):
            UrDriver(inspect(controller.host)).execute(gentle_execution(), None)


def test_another_rate_is_refused(controller: RunningController) -> None:
    with pytest.raises(InputError, match="another rate"):
        UrDriver(inspect(controller.host)).execute(replace(gentle_execution(), rate_hz=500.0), None)


ANSWERS = {
    Kind.REQUEST_PROTOCOL_VERSION: b"\x01",
    Kind.GET_URCONTROL_VERSION: struct.pack(">4I", 3, 15, 8, 0),
    Kind.START: b"\x01",
}


class Line:
    """Both a clock and a socket to somebody who answers, and talks when nothing was asked."""

    def __init__(self, answers: Mapping[Kind, bytes], talk: bytes = b"") -> None:
        self.now, self._answers, self._talk = 0.0, answers, talk
        self._waiting, self.times = b"", [0.0] * 4
        """Of the first answers; the others take 0.1 s."""
        self.closed = False

    def monotonic(self) -> float:
        return self.now

    def sendall(self, request: bytes) -> None:
        for kind, payload in Framer().feed(request):
            if kind is Kind.SETUP_OUTPUTS:
                names = payload[8:].decode().split(",")
                types = ",".join(OUTPUTS[name].type.name for name in names)
                self._waiting += rtde.frame(kind, b"\x01" + types.encode())
                size = Recipe.of(names, types.split(",")).size
                package = rtde.frame(Kind.DATA_PACKAGE, b"\x01" + bytes(size - 1))
                self._talk = self._talk or package
            elif kind in self._answers:
                self._waiting += rtde.frame(kind, self._answers[kind])

    def recv(self, _: int) -> bytes:
        self.now += self.times.pop(0) if self.times else 0.1
        said, self._waiting = self._waiting or self._talk, b""
        return said

    def settimeout(self, _: float) -> None: ...

    def gettimeout(self) -> float:
        return SILENCE_S

    def close(self) -> None:
        self.closed = True


def connected(monkeypatch: pytest.MonkeyPatch, line: Line) -> None:
    monkeypatch.setattr("dynid.drivers.ur.link.connect", lambda *_: line)
    monkeypatch.setattr("dynid.drivers.ur.link.time", line)


TEXT = rtde.frame(Kind.TEXT_MESSAGE, b"\x01a\x00\x00")


@pytest.mark.parametrize(
    ("answers", "talk", "words"),
    [
        ({}, TEXT, "no answer"),
        (ANSWERS, TEXT, "no package"),
        ({}, b"HTTP/1.1 400 Bad Request\r\n\r\n", "no RTDE packet"),
    ],
)
def test_what_talks_and_is_no_controller_is_given_up(
    monkeypatch: pytest.MonkeyPatch, answers: Mapping[Kind, bytes], talk: bytes, words: str
) -> None:
    """Each text began the wait for an answer anew, and that for a package had no end."""
    line = Line(answers, talk)
    connected(monkeypatch, line)
    with pytest.raises(JobError, match=f"127.9.9.9: .*{words}.* is it a UR controller"):
        inspect("127.9.9.9")
    assert line.now < 3 * CONNECT_S


@pytest.mark.parametrize("talk", [b"x", b"x" * 5000])
def test_a_dashboard_whose_line_never_ends_is_given_up(
    monkeypatch: pytest.MonkeyPatch, talk: bytes
) -> None:
    line = Line({}, talk)
    connected(monkeypatch, line)
    with pytest.raises(
        JobError, match=r"127\.9\.9\.9: .* without an end.*4096 bytes within 3 s\. Check"
    ):
        Dashboard("127.9.9.9")
    assert line.now < 2 * CONNECT_S
    assert line.closed


@pytest.mark.parametrize(("late", "told"), [(3, 0.0), (7, 0.3)])
def test_the_usual_answer_counts(monkeypatch: pytest.MonkeyPatch, late: int, told: float) -> None:
    """One that was late passed for a slow network, one that was not for a fast one."""
    line = Line(ANSWERS)
    line.times += [0.3] * late + [0.0] * (10 - late)
    connected(monkeypatch, line)
    state = inspect("127.9.9.9")
    assert state.round_trip_s == pytest.approx(told)
    assert (state.model, state.freedrive) == ("", False)


def test_a_name_that_no_host_can_have_is_told() -> None:
    with pytest.raises(JobError, match=r"a\.\.b: no connection to the controller.*empty"):
        inspect("a..b")
