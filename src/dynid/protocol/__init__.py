"""What UR controllers say on the wire: codecs without sockets, for both sides."""

from dynid.protocol.dashboard import JointMode as JointMode
from dynid.protocol.dashboard import RobotMode as RobotMode
from dynid.protocol.dashboard import RobotStatus as RobotStatus
from dynid.protocol.dashboard import RuntimeState as RuntimeState
from dynid.protocol.dashboard import SafetyMode as SafetyMode
from dynid.protocol.dashboard import SafetyStatus as SafetyStatus
from dynid.protocol.dashboard import known_to as known_to
from dynid.protocol.dashboard import value as value
from dynid.protocol.fields import IN_USE as IN_USE
from dynid.protocol.fields import INPUTS as INPUTS
from dynid.protocol.fields import NOT_FOUND as NOT_FOUND
from dynid.protocol.fields import OUTPUTS as OUTPUTS
from dynid.protocol.fields import DataType as DataType
from dynid.protocol.fields import Field as Field
from dynid.protocol.fields import Numbers as Numbers
from dynid.protocol.fields import Recipe as Recipe
from dynid.protocol.fields import Value as Value
from dynid.protocol.fields import Version as Version
from dynid.protocol.rtde import HEADER as HEADER
from dynid.protocol.rtde import Framer as Framer
from dynid.protocol.rtde import Kind as Kind
from dynid.protocol.rtde import Packet as Packet
from dynid.protocol.rtde import ProtocolError as ProtocolError
