"""The variables of RTDE, and recipes that pack them into data packages."""

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from enum import Enum

from dynid.protocol.rtde import HEADER, Kind, ProtocolError

Version = tuple[int, int, int]
"""Major, minor and bugfix number of a controller's software."""


class DataType(Enum):
    """Types of variables: the name on the wire, the `struct` code, how many numbers."""

    BOOL = ("BOOL", "?", 1)
    UINT8 = ("UINT8", "B", 1)
    UINT32 = ("UINT32", "I", 1)
    UINT64 = ("UINT64", "Q", 1)
    INT32 = ("INT32", "i", 1)
    DOUBLE = ("DOUBLE", "d", 1)
    VECTOR3D = ("VECTOR3D", "d", 3)
    VECTOR6D = ("VECTOR6D", "d", 6)
    VECTOR6INT32 = ("VECTOR6INT32", "i", 6)
    VECTOR6UINT32 = ("VECTOR6UINT32", "I", 6)

    @property
    def code(self) -> str:
        """The `struct` code of one number."""
        return self.value[1]

    @property
    def count(self) -> int:
        """How many numbers it holds."""
        return self.value[2]


TYPES: dict[str, DataType] = {kind.name: kind for kind in DataType}
NOT_FOUND, IN_USE = "NOT_FOUND", "IN_USE"
"""What the controller answers in the place of a type: no such variable; another client has it."""


@dataclass(frozen=True, slots=True)
class Field:
    """One variable."""

    name: str
    """Its name in recipes."""
    type: DataType
    """What it holds."""
    since_cb: Version | None
    """The first software with it on CB-Series controllers (major 3); None: none has it."""
    since_e: Version | None
    """The first software with it on e-Series controllers (major 5 and later); None: none."""

    def exists_in(self, version: Version) -> bool:
        """Whether software of this version has the variable."""
        since = self.since_cb if version[0] < _FIRST_E_SERIES else self.since_e
        if since is not None and version[0] >= _POLYSCOPE_X:
            since = _IN_X.get(since, since)
        return since is not None and version >= since


_FIRST_E_SERIES, _POLYSCOPE_X = 5, 10
_IN_X: dict[Version, Version] = {(5, 23, 0): (10, 11, 0)}
"""Software of the e-Series, and the release of PolyScope X that came with it."""
_RTDE: tuple[Version, Version] = ((3, 0, 0), (5, 0, 0))
_REGISTERS, _UPPER = ((3, 4, 0), (5, 0, 0)), ((3, 9, 0), (5, 3, 0))
_ALWAYS: dict[DataType, str] = {
    DataType.DOUBLE: """timestamp actual_execution_time speed_scaling target_speed_fraction
        actual_momentum actual_main_voltage actual_robot_voltage actual_robot_current
        standard_analog_input0 standard_analog_input1 standard_analog_output0
        standard_analog_output1 io_current euromap67_24V_voltage euromap67_24V_current
        tool_analog_input0 tool_analog_input1 tool_output_current tool_temperature
        tcp_force_scalar""",
    DataType.VECTOR6D: """target_q target_qd target_qdd target_current target_moment actual_q
        actual_qd actual_current joint_control_output actual_TCP_pose actual_TCP_speed
        actual_TCP_force target_TCP_pose target_TCP_speed joint_temperatures
        actual_joint_voltage actual_current_window tcp_offset""",
    DataType.VECTOR3D: "actual_tool_accelerometer",
    DataType.VECTOR6INT32: "joint_mode",
    DataType.INT32: "robot_mode safety_mode tool_output_voltage",
    DataType.UINT32: """runtime_state robot_status_bits safety_status_bits analog_io_types
        euromap67_input_bits euromap67_output_bits tool_mode tool_analog_input_types""",
    DataType.UINT64: "actual_digital_input_bits actual_digital_output_bits",
}
_LATER: tuple[tuple[str, DataType, Version | None, Version | None], ...] = (
    ("elbow_position", DataType.VECTOR3D, (3, 5, 0), (5, 0, 0)),
    ("elbow_velocity", DataType.VECTOR3D, (3, 5, 0), (5, 0, 0)),
    ("safety_status", DataType.INT32, (3, 10, 0), (5, 4, 0)),
    ("payload", DataType.DOUBLE, (3, 11, 0), (5, 5, 1)),
    ("payload_cog", DataType.VECTOR3D, (3, 11, 0), (5, 5, 1)),
    ("payload_inertia", DataType.VECTOR6D, (3, 15, 0), (5, 11, 0)),
    ("script_control_line", DataType.UINT32, (3, 14, 0), (5, 9, 0)),
    ("ft_raw_wrench", DataType.VECTOR6D, None, (5, 9, 0)),
    ("joint_position_deviation_ratio", DataType.DOUBLE, None, (5, 0, 0)),
    ("collision_detection_ratio", DataType.DOUBLE, None, (5, 15, 0)),
    ("time_scale_source", DataType.INT32, None, (5, 17, 0)),
    ("tool_output_mode", DataType.UINT8, None, (5, 2, 0)),
    ("tool_digital_output0_mode", DataType.UINT8, None, (5, 2, 0)),
    ("tool_digital_output1_mode", DataType.UINT8, None, (5, 2, 0)),
    ("actual_current_as_torque", DataType.VECTOR6D, None, (5, 23, 0)),
)
# In the lists of UR's client library of 2026 (Universal_Robots_Client_Library,
# tests/resources/exhaustive_rtde_output_recipe.txt, types in tests/fake_rtde_server.cpp), not in
# guides before 5.23, with which the energies came (tests/test_rtde_client.cpp); no source found
# names the version of the others.
_NEWEST: tuple[Version | None, Version | None] = (None, (5, 23, 0))
_NEW: dict[DataType, str] = {
    DataType.VECTOR6D: """actual_TCP_acceleration target_TCP_acceleration
        wrench_calc_from_currents target_base_acceleration target_base_wrench""",
    DataType.VECTOR3D: "target_gravity",
    DataType.DOUBLE: """target_execution_time actual_robot_energy_consumed
        actual_robot_braking_energy_dissipated""",
    DataType.UINT64: """actual_configurable_digital_input_bits
        actual_configurable_digital_output_bits control_step""",
    DataType.INT32: "encoder0_raw encoder1_raw",
}
_INPUTS: dict[DataType, str] = {
    DataType.UINT32: "speed_slider_mask",
    DataType.DOUBLE: "speed_slider_fraction standard_analog_output_0 standard_analog_output_1",
    DataType.UINT8: """standard_digital_output_mask standard_digital_output
        configurable_digital_output_mask configurable_digital_output
        standard_analog_output_mask standard_analog_output_type
        tool_digital_output_mask tool_digital_output""",
    DataType.VECTOR6D: "external_force_torque",
}
_COUNT, _LOWER = 48, 24


def _registers(side: str) -> list[Field]:
    """The general purpose registers of one side, `input` or `output`."""
    words = (f"{side}_bit_registers{bits}" for bits in ("0_to_31", "32_to_63"))
    found = [Field(word, DataType.UINT32, *_RTDE) for word in words]
    found += [Field(f"{side}_bit_register_{k}", DataType.BOOL, *_UPPER) for k in range(64, 128)]
    for kind, type_ in (("int", DataType.INT32), ("double", DataType.DOUBLE)):
        for k in range(_COUNT):
            since = _REGISTERS if k < _LOWER else _UPPER
            found.append(Field(f"{side}_{kind}_register_{k}", type_, *since))
    return found


def _same(
    table: dict[DataType, str], since: tuple[Version | None, Version | None] = _RTDE
) -> list[Field]:
    """Fields of the same age: by default those that every controller with RTDE has."""
    return [Field(name, type_, *since) for type_, names in table.items() for name in names.split()]


OUTPUTS: dict[str, Field] = {
    field.name: field
    for field in (
        *_same(_ALWAYS),
        *(Field(*row) for row in _LATER),
        *_same(_NEW, _NEWEST),
        *_registers("output"),
        *_registers("input"),
    )
}
"""What a client can ask the controller to send, by name. Input registers can be read back."""
INPUTS: dict[str, Field] = {field.name: field for field in (*_same(_INPUTS), *_registers("input"))}
"""What a client can write, by name."""


Value = bool | int | float | Sequence[float] | Sequence[int]
"""One variable: a number, or a sequence of three or six of them."""
Numbers = tuple[float | int | bool, ...]
"""The numbers of a whole package, vectors laid out flat."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """The layout of the data packages of one connection.

    Protocol 2 puts the recipe's number before the values; protocol 1 does so for inputs alone.
    """

    names: tuple[str, ...]
    """Variables, in the order of the package; a name may stand there twice."""
    types: tuple[DataType, ...]
    """Their types."""
    number: int | None = 1
    """The recipe's number on the wire; None where the packages carry none."""
    layout: struct.Struct = field(init=False, compare=False, repr=False)
    """The values alone, big-endian."""

    def __post_init__(self) -> None:
        codes = "".join(f"{kind.count}{kind.code}" for kind in self.types)
        object.__setattr__(self, "layout", struct.Struct(">" + codes))

    @classmethod
    def of(cls, names: Iterable[str], types: Iterable[str], number: int | None = 1) -> "Recipe":
        """A recipe from the names asked for and the types answered.

        Raises:
            ProtocolError: A type that is none (`NOT_FOUND`, `IN_USE`), or not one for each name.
        """
        names, types = tuple(names), tuple(types)
        if len(names) != len(types):
            raise ProtocolError(
                "the controller's answer does not name one type for each variable",
                value=f"{len(types)} types",
                limit=f"{len(names)} variables",
            )
        pairs = zip(names, types, strict=True)
        bad = [f"{name} {kind}" for name, kind in pairs if kind not in TYPES]
        if bad:
            raise ProtocolError(
                "the controller refuses variables",
                value=", ".join(bad),
                next_step="NOT_FOUND: its software has no such variable; "
                "IN_USE: another client writes it",
            )
        return cls(names, tuple(TYPES[kind] for kind in types), number)

    @property
    def size(self) -> int:
        """Bytes of a payload."""
        return self.layout.size + (self.number is not None)

    def pack_numbers(self, numbers: Iterable[float | int | bool]) -> bytes:
        """The payload of a data package, from its numbers laid out flat.

        Raises:
            ProtocolError: Too few or too many numbers, or one that its type cannot hold.
        """
        try:
            body = self.layout.pack(*numbers)
        except struct.error as error:
            raise ProtocolError(f"the numbers do not fit the recipe ({error})") from error
        return body if self.number is None else bytes((self.number,)) + body

    def packet(self, numbers: Iterable[float | int | bool]) -> bytes:
        """A whole data package with its header."""
        return HEADER.pack(HEADER.size + self.size, Kind.DATA_PACKAGE) + self.pack_numbers(numbers)

    def numbers(self, payload: bytes) -> Numbers:
        """The numbers of a payload, laid out flat.

        Raises:
            ProtocolError: A payload of another size or another recipe.
        """
        if len(payload) != self.size:
            given, size = f"{len(payload)} bytes", f"{self.size} bytes"
            what = "a data package has not the size of its recipe"
            raise ProtocolError(what, value=given, limit=size)
        if self.number is not None and payload[0] != self.number:
            raise ProtocolError(
                "a data package belongs to another recipe", value=payload[0], limit=self.number
            )
        return self.layout.unpack_from(payload, self.number is not None)

    def unpack(self, payload: bytes) -> dict[str, Value]:
        """The values of a payload by name; vectors are tuples.

        Raises:
            ProtocolError: A payload of another size or another recipe.
        """
        return self.by_name(self.numbers(payload))

    def by_name(self, numbers: Numbers) -> dict[str, Value]:
        """The values of a payload's numbers by name; vectors are tuples."""
        values: dict[str, Value] = {}
        start = 0
        for name, kind in zip(self.names, self.types, strict=True):
            end = start + kind.count
            values[name] = numbers[start:end] if kind.count > 1 else numbers[start]
            start = end
        return values
