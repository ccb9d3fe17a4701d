"""A simulated UR controller: the real protocols in front of a simulated arm."""

import importlib
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from urtwin.command import RunningController, controller_process, own_address
    from urtwin.machine import ControllerMachine

__version__ = "0.2.0"

__all__ = [
    "ControllerMachine",
    "RunningController",
    "__version__",
    "controller_process",
    "own_address",
]

_MODULE_OF = {
    "ControllerMachine": "urtwin.machine",
    "RunningController": "urtwin.command",
    "controller_process": "urtwin.command",
    "own_address": "urtwin.command",
}

# dynid is no requirement by name: the name belongs to nobody on any package index.
if find_spec("dynid") is None:
    raise ImportError(
        "urtwin simulates with dynid, which is not installed; "
        "in the repository of both: pip install . ./urtwin"
    )


def __getattr__(name: str) -> Any:
    # A client that starts a process loads neither Numba nor MuJoCo.
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULE_OF[name]), name)
