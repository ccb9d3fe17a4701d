"""What UR controllers say on the wire: codecs without sockets, for both sides."""

from dynid.protocol.dashboard import (
    JointMode,
    RobotMode,
    RobotStatus,
    RuntimeState,
    SafetyMode,
    SafetyStatus,
    value,
)
from dynid.protocol.fields import (
    IN_USE,
    INPUTS,
    NOT_FOUND,
    OUTPUTS,
    DataType,
    Field,
    Numbers,
    Recipe,
    Value,
    Version,
)
from dynid.protocol.rtde import HEADER, Framer, Kind, Packet, ProtocolError

__all__ = [
    "HEADER",
    "INPUTS",
    "IN_USE",
    "NOT_FOUND",
    "OUTPUTS",
    "DataType",
    "Field",
    "Framer",
    "JointMode",
    "Kind",
    "Numbers",
    "Packet",
    "ProtocolError",
    "Recipe",
    "RobotMode",
    "RobotStatus",
    "RuntimeState",
    "SafetyMode",
    "SafetyStatus",
    "Value",
    "Version",
    "value",
]
