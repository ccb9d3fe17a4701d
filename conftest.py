"""What holds for all tests."""

import gc
import importlib
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from _pytest.runner import runtestprotocol
from hypothesis import settings

from forked_controllers import fork_controllers

# Two workers on two cores: threads of a linear algebra library would wait for each other, which
# costs small matrices more than half of their time. Set before NumPy is imported; children take
# it over.
for _library in ("OPENBLAS", "OMP", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")
# Nothing is drawn: MuJoCo need not load a window system in each controller.
os.environ.setdefault("MUJOCO_GL", "disable")

# Shells start commands in the background with Ctrl-C ignored, and children take that over: tests
# that interrupt would wait for nothing.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Beside other work an example may take longer than usual: no test of values watches the clock.
settings.register_profile("dynid", deadline=None)
settings.load_profile("dynid")


def pytest_collection_finish() -> None:
    """What was imported and collected stays: the collector of garbage need not look at it again."""
    if "urtwin.command" in sys.modules:
        fork_controllers(sys.modules["urtwin.command"])
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 50)


HELD_UP_S = 0.05
"""A test that fails in real time says nothing if its process stood still for so long [s]."""


@contextmanager
def longest_pause() -> Iterator[list[float]]:
    """For how long this process has stood still meanwhile [s]."""
    longest, end = [0.0], threading.Event()

    def beat() -> None:
        last = time.monotonic()
        while not end.wait(0.005):
            now = time.monotonic()
            longest[0], last = max(longest[0], now - last), now

    thread = threading.Thread(target=beat, daemon=True)
    thread.start()
    try:
        yield longest
    finally:
        end.set()
        thread.join()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """A test that watches a clock is run again if it failed while its process was held up.

    A watchdog of 0.1 s stops the arm of a client that the machine gives no time: as it should.
    """
    if item.get_closest_marker("realtime") is None:
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    with longest_pause() as longest:
        reports = runtestprotocol(item, log=False, nextitem=nextitem)
    if longest[0] > HELD_UP_S and any(report.failed for report in reports):
        terminal = item.config.pluginmanager.get_plugin("terminalreporter")
        terminal.write_line(f" held up for {longest[0]:.2f} s, run again: {item.nodeid}")
        # With controllers of its own.
        item.session._setupstate.teardown_exact(None)
        item._initrequest()
        reports = runtestprotocol(item, log=False, nextitem=nextitem)
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


@pytest.fixture
def undiagnosed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is asked of the diagnosis: it does not take its time, half of an identification's."""
    module = importlib.import_module("dynid.workflow.identify")
    monkeypatch.setattr(module, "diagnose", lambda *_: ())


@pytest.fixture(scope="module")
def undiagnosed() -> Iterator[None]:
    """In no test of a file."""
    module = importlib.import_module("dynid.workflow.identify")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "diagnose", lambda *_: ())
        yield
