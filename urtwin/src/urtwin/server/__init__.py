"""The server: sockets, clients and clocks around one machine."""

from urtwin.server.clock import LEAD_S
from urtwin.server.serve import serve
from urtwin.server.settings import ControllerSettings

__all__ = [
    "LEAD_S",
    "ControllerSettings",
    "serve",
]
