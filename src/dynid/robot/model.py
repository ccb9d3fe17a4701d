"""The robot as a value: a serial chain with mounting, limits, drives and collision bodies."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from dynid.core import SMALLEST, Array, Mask, MotionBounds, RobotError, Value, freeze, frozen
from dynid.robot import body, transforms


@dataclass(frozen=True, slots=True, kw_only=True)
class Drives(Value):
    """Gear ratios, drive gains and transmission coupling.

    The motors turn by `q_motor = N (q - offset)`, so joint torques are `tau = N' tau_motor`
    (power is the same on both sides). Without coupling, N is diagonal: the gear ratios.

    Raises:
        RobotError: Coupling that cannot be inverted, or a gain of zero.
    """

    gain: Array
    """(n) joint torque per motor current [N.m/A], NaN if unknown."""
    gear_ratio: Array
    """(n) motor turns per joint turn, NaN if unknown."""
    coupling: Array | None = None
    """(n, n) N, motor positions per joint positions; None where each motor drives one joint."""
    offset: Array | None = None
    """(n) joint position at motor position zero [rad]; None for zero."""
    position_side: str = "joint"
    """`joint` or `motor`: the side on which this robot's recordings give q, qd, qdd."""
    torque_side: str = "joint"
    """`joint` or `motor`: the side on which this robot's recordings give effort."""

    def __post_init__(self) -> None:
        n = len(np.atleast_1d(self.gain))
        freeze(self, "drives", finite=False, gain=(n,), gear_ratio=(n,))
        for name in ("gain", "gear_ratio"):
            value = getattr(self, name)
            if (value == 0).any() or np.isinf(value).any():
                raise RobotError(f"drives {name} must be finite and not zero", value=value.tolist())
        for name in ("position_side", "torque_side"):
            if getattr(self, name) not in ("joint", "motor"):
                raise RobotError(
                    f"drives {name}", value=getattr(self, name), limit="joint or motor"
                )
        if self.offset is not None:
            freeze(self, "drives", offset=(n,))
        if self.coupling is not None:
            freeze(self, "drives", coupling=(n, n))
            if np.linalg.matrix_rank(self.coupling) < n or (np.diag(self.coupling) == 0).any():
                raise RobotError("the coupling matrix cannot be inverted or has a zero diagonal")
        uses_motor_side = "motor" in (self.position_side, self.torque_side)
        if uses_motor_side and self.coupling is None and np.isnan(self.gear_ratio).any():
            raise RobotError(
                "recordings on the motor side need gear_ratio or coupling for every joint"
            )

    @property
    def motor_from_joint(self) -> Array:
        """(n, n) N: the coupling, or the diagonal of the gear ratios."""
        return np.diag(self.gear_ratio) if self.coupling is None else self.coupling


UNLIMITED = 1e4
"""Files write such positions and velocities, or larger ones, where they know no limit [SI]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointLimits(MotionBounds):
    """Bounds of each joint, joint side; see `MotionBounds`.

    Finite positions and velocities of `UNLIMITED` or more are unknown.
    """

    torque: Array
    """(n) largest torque or force [N.m or N], NaN if unknown."""

    def __post_init__(self) -> None:
        MotionBounds.__post_init__(self)
        for name in ("lower", "upper", "velocity"):
            value: Array = getattr(self, name)
            known = (np.abs(value) < UNLIMITED) | np.isinf(value)
            value = frozen(np.where(known, value, math.nan), shape=None, name=name, finite=False)
            object.__setattr__(self, name, value)

    @property
    def rated_torque(self) -> Array:
        """(n) what the drives are made for [N.m or N], from the torque limits, NaN if unknown.

        One limit for three joints or more is a placeholder, as motors of an arm differ: it is
        checked, but tells nothing of the motors.
        """
        same = len(self.torque) > 2 and np.ptp(self.torque) == 0
        return np.full(len(self.torque), math.nan) if same else self.torque


@dataclass(frozen=True, slots=True, kw_only=True)
class SafetyLimits:
    """Limits of the whole arm; NaN where a number is not published.

    Raises:
        RobotError: A limit that is not positive, or an elbow that is no joint.
    """

    tcp_speed: float = math.nan
    """Largest speed of the tool's point [m/s]."""
    elbow_speed: float = math.nan
    """Largest speed of the elbow [m/s]."""
    momentum: float = math.nan
    """Largest linear momentum of the arm [kg.m/s]."""
    power: float = math.nan
    """Largest mechanical power of the arm [W]."""
    payload: float = math.nan
    """Rated payload: the largest mass at the flange [kg]."""
    elbow: int = 0
    """The joint at whose `urdf` frame the elbow is, counted from 1; 0 where there is none."""

    def __post_init__(self) -> None:
        for name in ("tcp_speed", "elbow_speed", "momentum", "power", "payload"):
            value = getattr(self, name)
            if value < SMALLEST or math.isinf(value):
                raise RobotError(
                    f"the safety limit {name} must be positive",
                    value=value,
                    limit=f"{SMALLEST:g} or more",
                )
        if self.elbow < 0:
            raise RobotError("the elbow is a joint, counted from 1", value=self.elbow)


@dataclass(frozen=True, slots=True, kw_only=True)
class Counterbalance:
    """A gas-hydraulic cylinder between link and base (heavy KUKA, ABB and Fanuc arms).

    The cylinder's ends sit `outer` and `inner` from the joint axis; its length is
    x = sqrt(outer^2 + inner^2 - 2 outer inner cos(q + offset)) and the gas pressure is
    gas_work / (gas_volume - (x - rest_length) piston_area): the gas is pressed by pulling the
    cylinder longer, so the arm is drawn to where the cylinder is shortest, q = -offset.

    Raises:
        RobotError: A length, area, volume or work that is not positive and finite, or a gas
            volume that the longest cylinder would use up.
    """

    joint: int
    """Index of the joint, from 0."""
    outer: float
    """Distance from the axis to the far anchor [m]."""
    inner: float
    """Distance from the axis to the near anchor [m]."""
    rest_length: float
    """Cylinder length at the filling pressure [m]."""
    offset: float
    """Angle between the anchors at q = 0 [rad]."""
    piston_area: float
    """Effective area [m^2]."""
    gas_work: float
    """Pressure times volume of the gas [J]."""
    gas_volume: float
    """Gas volume at rest length [m^3]."""

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            positive = item.name not in ("joint", "offset")
            if not math.isfinite(value) or (positive and value <= 0):
                raise RobotError(
                    f"counterbalance {item.name} must be a positive number", value=value
                )
        if math.isclose(self.outer, self.inner):
            raise RobotError("counterbalance outer and inner must differ", value=self.outer)
        longest = self.outer + self.inner
        if self.gas_volume <= (longest - self.rest_length) * self.piston_area:
            raise RobotError(
                "counterbalance: the longest cylinder would use up the gas volume",
                value=self.gas_volume,
                limit=f"above {(longest - self.rest_length) * self.piston_area:.3g} m^3",
            )

    def torque(self, q: Array) -> Array:
        """The torque of the cylinder on the joint [N.m] at its positions q (...) [rad].

        It relieves the motor: the measured torque is Y p - torque(q). It is minus the slope
        of the gas's energy over q, so it draws the arm to where the cylinder is shortest.
        """
        delta = q + self.offset
        length = np.sqrt(
            self.outer**2 + self.inner**2 - 2 * self.outer * self.inner * np.cos(delta)
        )
        arm = self.outer * self.inner * np.sin(delta) / length
        volume = self.gas_volume - (length - self.rest_length) * self.piston_area
        return -arm * self.gas_work / volume * self.piston_area


@dataclass(frozen=True, slots=True, kw_only=True)
class Tool(Value):
    """What the flange carries, in the flange's frame.

    Raises:
        RobotError: A mass or radius that makes no sense.
        InputError: A place that is not three finite numbers.
    """

    tcp: Array = field(default_factory=lambda: np.zeros(3))
    """(3) the tool's point [m]."""
    mass: float = 0.0
    """All that the flange carries, as the controller is told [kg]."""
    com: Array = field(default_factory=lambda: np.zeros(3))
    """(3) its centre of mass [m]."""
    radius: float = 0.03
    """Of the rods from the flange to the tool's point and to the centre of mass that stand for its
    body [m]."""

    def __post_init__(self) -> None:
        freeze(self, "tool", tcp=(3,), com=(3,))
        for name, value in (("tcp", self.tcp), ("com", self.com)):
            if not (np.abs(value) < _FARTHEST).all():
                raise RobotError(f"the tool's {name}", value=value.tolist(), limit="10 m")
        if not (math.isfinite(self.mass) and 0 <= self.mass < _HEAVIEST):
            raise RobotError("the payload's mass", value=self.mass, limit=f"0 to {_HEAVIEST:g} kg")
        if not (math.isfinite(self.radius) and 0 < self.radius < 1):
            raise RobotError("the tool's radius", value=self.radius, limit="0 to 1 m")


_FARTHEST, _HEAVIEST = 10.0, 1000.0

FRAMES = ("dh", "mdh", "urdf")
STANDARD_GRAVITY = 9.80665
"""[m/s^2]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotModel(Value):
    """A serial chain of revolute and prismatic joints.

    At q = 0 joint frame i stands at `placements[i]` in joint frame i - 1 (the base for the
    first); the joint turns about, or slides along, `axes[i]` of its own frame. Link i is
    fixed in joint frame i.

    Raises:
        RobotError: No joints, shapes that disagree, transforms or axes that are not valid.
    """

    name: str
    """Built-in name, or that of the file."""
    joint_names: tuple[str, ...]
    """n names, base to tip."""
    joint_types: tuple[str, ...]
    """n times `revolute` or `prismatic`."""
    placements: Array
    """(n, 4, 4) joint frame in the previous joint frame at q = 0 [m]."""
    axes: Array
    """(n, 3) unit axis in the joint frame."""
    parameter_frames: Mapping[str, Array] = field(repr=False)
    """Convention (`dh`, `mdh`, `urdf`) to (n, 4, 4) parameter frame in the joint frame [m]."""
    default_frames: str
    """The convention used when none is asked for."""
    gravity: Array
    """(3) gravity in the base frame [m/s^2]: the mounting."""
    limits: JointLimits
    """Of positions, velocities, accelerations and torques of the joints."""
    drives: Drives
    """Drive gains, gear ratios, coupling."""
    inertias: Array
    """(n, 10) m, mx, my, mz, Jxx, Jyy, Jzz, Jyz, Jxz, Jxy about the joint frame
    [kg, kg.m, kg.m^2]; NaN where unpublished."""
    mount: str = "floor"
    """`floor`, `wall`, `ceiling`, `tilt:DEG`, or `file` where the robot file gives gravity."""
    flange: Array = field(default_factory=lambda: np.eye(4))
    """(4, 4) the chain's end (tool flange) in the last joint frame [m]."""
    counterbalances: tuple[Counterbalance, ...] = ()
    """Springs and cylinders whose torque is known."""
    bodies: tuple[body.Body, ...] = field(default=(), repr=False)
    """Collision bodies."""
    body_notes: tuple[str, ...] = ()
    """Notes on the bodies for the certificate of collisions."""
    safety: SafetyLimits = field(default_factory=SafetyLimits)
    """Limits of the whole arm, as its controller watches them."""
    tool: Tool = field(default_factory=Tool)
    """Tool at the flange; included in limits and collisions, not in identification."""
    locked: Mapping[str, float] = field(default_factory=dict[str, float])
    """Joints frozen into the links, and where [rad or m]."""
    notes: tuple[str, ...] = ()
    """What the reader of the file decided by itself, in words."""
    source: str = ""
    """Where the numbers come from."""
    urdf: str = ""
    """Absolute path of the URDF with its joints and links; empty where there is none."""
    file: str = ""
    """Absolute path of the file that it was read from; empty where there is none."""

    def __post_init__(self) -> None:
        n = len(self.joint_names)
        if n == 0:
            raise RobotError("a robot needs at least one joint", where=self.name)
        if len(set(self.joint_names)) != n:
            raise RobotError("joint names repeat", where=self.name, value=self.joint_names)
        if len(self.joint_types) != n or not set(self.joint_types) <= {"revolute", "prismatic"}:
            raise RobotError(
                "joint types", where=self.name, value=self.joint_types, limit="revolute, prismatic"
            )
        freeze(self, placements=(n, 4, 4), axes=(n, 3), gravity=(3,), flange=(4, 4))
        freeze(self, inertias=(n, 10), finite=False)
        frames = {
            key: frozen(value, shape=(n, 4, 4), name=f"{key} frames")
            for key, value in self.parameter_frames.items()
        }
        object.__setattr__(self, "parameter_frames", MappingProxyType(frames))
        object.__setattr__(self, "locked", MappingProxyType(dict(self.locked)))
        if self.default_frames not in frames:
            raise RobotError("unknown frames", value=self.default_frames, limit=tuple(frames))
        if not np.allclose(np.linalg.norm(self.axes, axis=1), 1.0, atol=1e-9, rtol=0):
            raise RobotError("joint axes must have unit length", where=self.name)
        # All at once: a robot file makes a robot a table, and each is checked.
        poses = (self.placements, self.flange[None], *frames.values())
        transforms.require_rigid(np.concatenate(poses), self.name)
        for name, length in (("limits", len(self.limits.lower)), ("drives", len(self.drives.gain))):
            if length != n:
                raise RobotError(f"{name} for every joint", where=self.name, value=length, limit=n)
        if any(not 0 <= item.joint < n for item in self.counterbalances):
            raise RobotError("a counterbalance acts on no joint of this robot", where=self.name)
        if any(item.link > n for item in self.bodies):
            raise RobotError("a body is fixed in no link of this robot", where=self.name)
        if self.safety.elbow > n:
            raise RobotError("the elbow is no joint of this robot", where=self.name)

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return len(self.joint_names)

    @property
    def prismatic(self) -> tuple[bool, ...]:
        """For each joint, whether it slides."""
        return tuple(kind == "prismatic" for kind in self.joint_types)

    @property
    def published(self) -> Mask:
        """(n) whether mass and centre of mass of each link are published."""
        return np.isfinite(self.inertias[:, :4]).all(axis=1) & (self.inertias[:, 0] > 0)


def with_tool(
    robot: RobotModel, *, tcp: ArrayLike | None = None, payload: ArrayLike | None = None
) -> RobotModel:
    """The robot with another tool's point or payload; None leaves what the robot file says.

    Args:
        robot: The robot.
        tcp: (3) the tool's point in the flange's frame [m].
        payload: (4) mass of all that the flange carries [kg], and its centre of mass [m].

    Raises:
        RobotError: Values that make no sense.
    """
    tool = robot.tool
    if tcp is not None:
        tool = replace(tool, tcp=np.asarray(tcp, dtype=np.float64))
    if payload is not None:
        mass, *com = np.asarray(payload, dtype=np.float64).tolist()
        tool = replace(tool, mass=mass, com=np.array(com))
    return robot if tool is robot.tool else replace(robot, tool=tool)


def joints_by_kind(prismatic: Sequence[bool]) -> dict[str, Mask]:
    """Which joints (n) are `turning` and which `sliding`, or `all` where they are of one kind.

    Newtons and newton metres do not add: what is summed over joints is summed over those.
    """
    slides = np.array(prismatic, dtype=bool)
    if slides.all() or not slides.any():
        return {"all": np.ones_like(slides)}
    return {"turning": ~slides, "sliding": slides}


def carried(robot: RobotModel) -> Array:
    """(10) inertial parameters of the mass at the flange, a point, in the last joint's frame."""
    place = robot.flange[:3, :3] @ robot.tool.com + robot.flange[:3, 3]
    return transforms.from_body(robot.tool.mass, place, np.zeros((3, 3)))


def with_carried(robot: RobotModel) -> RobotModel:
    """The robot with the mass at the flange as a part of the last link, if that one's is known."""
    if not robot.tool.mass or not robot.published[-1]:
        return robot
    inertias = np.array(robot.inertias)
    inertias[-1] += carried(robot)
    note = (
        f"link {robot.joints} includes {robot.tool.mass:g} kg at the flange, as the robot file says"
    )
    tool = replace(robot.tool, mass=0.0, com=np.zeros(3))
    return replace(robot, inertias=inertias, tool=tool, notes=(*robot.notes, note))
