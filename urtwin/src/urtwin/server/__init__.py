"""The server: sockets, clients and clocks around one machine."""

from urtwin.server.clock import LEAD_S
from urtwin.server.listeners import ControllerSettings
from urtwin.server.serve import serve

__all__ = [
    "LEAD_S",
    "ControllerSettings",
    "serve",
]
