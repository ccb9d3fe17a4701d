"""The server: sockets, clients and clocks around one machine."""

from urtwin.server.clock import LEAD_S as LEAD_S
from urtwin.server.loop import ControllerServer as ControllerServer
from urtwin.server.loop import Log as Log
from urtwin.server.serve import serve as serve
