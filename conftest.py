"""What holds for all tests."""

import gc
import importlib
import os
import signal
import sys
from collections.abc import Iterator

import pytest
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
