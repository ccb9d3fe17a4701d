"""The robot as a value: a serial chain with its mounting, limits and drives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any

import numpy as np

from dynid.core.arrays import Array, frozen
from dynid.core.errors import RobotError
from dynid.robot.capsule import Capsule
from dynid.robot.counterbalance import Counterbalance
from dynid.robot.drives import Drives
from dynid.robot.limits import JointLimits
from dynid.robot.safety import SafetyLimits

FRAMES = ("dh", "mdh", "urdf")
STANDARD_GRAVITY = 9.80665
"""[m/s^2]"""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotModel:
    """A serial chain of revolute and prismatic joints.

    At q = 0 joint frame i stands at `placements[i]` in joint frame i - 1 (the base for the
    first); the joint turns about, or slides along, `axes[i]` of its own frame. Link i is
    fixed in joint frame i.

    Raises:
        RobotError: No joints, shapes that disagree, transforms or axes that are not valid.
    """

    name: str
    joint_names: tuple[str, ...]
    """n names, base to tip."""
    joint_types: tuple[str, ...]
    """n times `revolute` or `prismatic`."""
    placements: Array
    """(n, 4, 4) joint frame in the previous joint frame at q = 0 [m]."""
    axes: Array
    """(n, 3) unit axis in the joint frame."""
    parameter_frames: Mapping[str, Array]
    """Convention (`dh`, `mdh`, `urdf`) to (n, 4, 4) parameter frame in the joint frame [m]."""
    default_frames: str
    """The convention used when none is asked for."""
    gravity: Array
    """(3) gravity in the base frame [m/s^2]: the mounting."""
    limits: JointLimits
    drives: Drives
    inertias: Array
    """(n, 10) m, mx, my, mz, Jxx, Jyy, Jzz, Jyz, Jxz, Jxy about the joint frame
    [kg, kg.m, kg.m^2]; NaN where unpublished."""
    mount: str = "floor"
    """`floor`, `wall`, `ceiling`, `tilt:DEG`, or `file` where the robot file gives gravity."""
    flange: Array = field(default_factory=lambda: np.eye(4))
    """(4, 4) the chain's end (tool flange) in the last joint frame [m]."""
    counterbalances: tuple[Counterbalance, ...] = ()
    """Springs and cylinders whose torque is known."""
    capsules: tuple[Capsule, ...] = ()
    """Self-collision shapes."""
    apart: tuple[tuple[int, int], ...] = ()
    """Pairs of links (0 the base) that cannot meet, whatever their capsules say."""
    overlap: tuple[tuple[int, int, float], ...] = ()
    """Two links, and how far their capsules may overlap before the links touch [m]."""
    capsule_notes: tuple[str, ...] = ()
    """What a verdict on collisions should say of the capsules, in words."""
    safety: SafetyLimits = field(default_factory=SafetyLimits)
    """Limits of the whole arm, as its controller watches them."""
    locked: Mapping[str, float] = field(default_factory=dict[str, float])
    """Joints frozen into the links, and where [rad or m]."""
    notes: tuple[str, ...] = ()
    """What the reader of the file decided by itself, in words."""
    source: str = ""
    """Where the numbers come from."""

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
        _store(self, "placements", (n, 4, 4))
        _store(self, "axes", (n, 3))
        _store(self, "gravity", (3,))
        _store(self, "flange", (4, 4))
        _store(self, "inertias", (n, 10), finite=False)
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
        for matrices in (self.placements, self.flange[None], *frames.values()):
            _check_transforms(matrices, self.name)
        for name, length in (
            ("limits", len(self.limits.lower)),
            ("drives", len(self.drives.gain)),
        ):
            if length != n:
                raise RobotError(f"{name} for every joint", where=self.name, value=length, limit=n)
        if any(not 0 <= item.joint < n for item in self.counterbalances):
            raise RobotError("a counterbalance acts on no joint of this robot", where=self.name)
        if any(item.link > n for item in self.capsules):
            raise RobotError("a capsule is fixed in no link of this robot", where=self.name)
        named = [*self.apart, *(row[:2] for row in self.overlap)]
        if any(not 0 <= link <= n for pair in named for link in pair):
            raise RobotError("pairs of links that are not of this robot", where=self.name)
        if self.safety.elbow > n:
            raise RobotError("the elbow is no joint of this robot", where=self.name)

    def __reduce__(self) -> tuple[Callable[[dict[str, Any]], RobotModel], tuple[dict[str, Any]]]:
        # Read-only mappings cannot be pickled, and worker processes get robots by pickle.
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        values["parameter_frames"] = dict(self.parameter_frames)
        values["locked"] = dict(self.locked)
        return _rebuild, (values,)

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return len(self.joint_names)

    @property
    def prismatic(self) -> tuple[bool, ...]:
        """For each joint, whether it slides."""
        return tuple(kind == "prismatic" for kind in self.joint_types)


def _rebuild(values: dict[str, Any]) -> RobotModel:
    return RobotModel(**values)


def _store(model: RobotModel, name: str, shape: tuple[int, ...], finite: bool = True) -> None:
    value = frozen(getattr(model, name), shape=shape, name=name, finite=finite)
    object.__setattr__(model, name, value)


def _check_transforms(matrices: Array, where: str) -> None:
    rotations = matrices[:, :3, :3]
    gram = rotations @ rotations.transpose(0, 2, 1)
    rigid = np.allclose(gram, np.eye(3), atol=1e-6, rtol=0) and (np.linalg.det(rotations) > 0).all()
    if not rigid or not np.array_equal(matrices[:, 3], np.tile([0.0, 0, 0, 1], (len(matrices), 1))):
        raise RobotError("a placement is not a rotation and a translation", where=where)
