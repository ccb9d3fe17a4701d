"""The server: sockets, clients and clocks around one machine."""

from urtwin.server.clock import LEAD_S as LEAD_S
from urtwin.server.serve import serve as serve
