"""A simulated UR controller: the real protocols in front of a simulated arm."""

from __future__ import annotations

import importlib
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from urtwin.functions import BUILTINS
    from urtwin.machine import UPRIGHT, ControllerMachine
    from urtwin.process import RunningController, controller_process, own_address
    from urtwin.server import LEAD_S, ControllerSettings, serve
    from urtwin.urscript import compile_script

__version__ = "0.2.0"

__all__ = [
    "BUILTINS",
    "LEAD_S",
    "UPRIGHT",
    "ControllerMachine",
    "ControllerSettings",
    "RunningController",
    "__version__",
    "compile_script",
    "controller_process",
    "own_address",
    "serve",
]

_MODULE_OF = {
    "BUILTINS": "urtwin.functions",
    "LEAD_S": "urtwin.server",
    "UPRIGHT": "urtwin.machine",
    "ControllerMachine": "urtwin.machine",
    "ControllerSettings": "urtwin.server",
    "RunningController": "urtwin.process",
    "compile_script": "urtwin.urscript",
    "controller_process": "urtwin.process",
    "own_address": "urtwin.process",
    "serve": "urtwin.server",
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
