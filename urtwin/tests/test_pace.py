"""The rhythm of cycles, from wall times that the test makes up."""

import io
import itertools
import threading

import pytest

from rtde_client import RtdeClient
from urtwin import own_address
from urtwin.server import ControllerServer, Log
from urtwin.server.clock import CATCH_UP_S, UNUSED_S, Pace, VirtualPace
from urtwin.settings import ControllerSettings

CYCLE = 0.008


def test_cycles_are_due_at_multiples_of_the_cycle():
    pace = Pace(CYCLE, 100.0)
    assert pace.wait(100.0) == pytest.approx(CYCLE)
    assert pace.wait(100.008) == pytest.approx(0.0, abs=1e-9)
    for k in range(1, 1001):
        pace.advance(100.0 + k * CYCLE)
    assert pace.wait(108.0) == pytest.approx(CYCLE)
    assert pace.slips == 0


def test_a_late_cycle_does_not_delay_the_next():
    pace = Pace(CYCLE, 0.0)
    pace.advance(0.02)
    # The second was due at 0.016: at once, so none is lost.
    assert pace.wait(0.02) < 0
    pace.advance(0.02)
    assert pace.wait(0.02) == pytest.approx(0.004)


def test_after_a_standstill_time_is_given_up_not_made_up_for():
    pace = Pace(CYCLE, 0.0)
    pace.advance(CYCLE + CATCH_UP_S + 1.0)
    assert pace.slips == 1
    assert pace.wait(CYCLE + CATCH_UP_S + 1.0) == pytest.approx(CYCLE)


def test_lateness_is_told_in_percentiles():
    pace = Pace(CYCLE, 0.0)
    for k in range(1, 102):
        pace.advance(k * CYCLE + (k - 1) * 1e-6)
    assert pace.lateness_us(0.0, 50.0, 100.0) == pytest.approx([0.0, 50.0, 100.0], abs=0.1)


def test_virtual_time_stops_without_client_and_program(machine):
    pace = VirtualPace(machine)
    assert not pace.unused(100.0, busy=False)
    assert not pace.unused(100.0 + UNUSED_S, busy=False)
    assert pace.unused(100.1 + UNUSED_S, busy=False)
    assert not pace.unused(200.0, busy=True)
    assert not pace.unused(200.0 + UNUSED_S, busy=False)
    pace.close()


def test_a_server_without_client_and_program_runs_no_cycles(machine, monkeypatch):
    monkeypatch.setattr("urtwin.server.clock.UNUSED_S", -1.0)
    monkeypatch.setattr("urtwin.server.loop._IDLE_S", 0.001)
    settings = ControllerSettings(host=own_address(), virtual_time=True)
    server = ControllerServer(machine, settings, Log(io.StringIO(), "test"))
    try:
        server.run(itertools.chain([False] * 60, [True]).__next__)
    finally:
        server.close()
    assert machine.core.cycles == 0


def test_a_client_that_virtual_time_gives_up_is_told_why(machine, monkeypatch):
    monkeypatch.setattr("urtwin.server.clock.STALLED_S", 0.1)
    settings, over = ControllerSettings(host=own_address(), virtual_time=True), threading.Event()
    server = ControllerServer(machine, settings, Log(io.StringIO(), "test"))
    loop = threading.Thread(target=server.run, args=[over.is_set])
    loop.start()
    try:
        with RtdeClient(settings.host) as idle, RtdeClient(settings.host) as reader:
            for client in (idle, reader):
                client.read_outputs(["timestamp"])
                client.start()
            reader.rows(100)
            with pytest.raises(ConnectionError, match="has read nothing"):
                idle.rows(100)
    finally:
        over.set()
        loop.join()
        server.close()
