"""`movec`: the tool moves on an arc from where it is, through one point, to another."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dynid.core import Array, InputError
from dynid.simulation.controller.machine_core import Core
from dynid.simulation.controller.motion_joint import Motion, follow, six
from dynid.simulation.controller.motion_poses import rotation_matrix, rotation_vector, to_matrix
from dynid.simulation.controller.motion_profile import Trapezoid, trapezoid
from dynid.simulation.controller.urscript.values import Pose

_FLAT = 1e-9


@dataclass(frozen=True, slots=True)
class Arc:
    """A part of a circle; a straight line where the three points are in line."""

    centre: Array
    """(3) [m]."""
    first: Array
    """(3) from the centre to the start [m]."""
    axis: Array
    """(3) the unit vector about which it turns."""
    angle: float
    """How far it turns [rad]."""

    @property
    def length(self) -> float:
        """How long the way is [m]."""
        return self.angle * float(np.linalg.norm(self.first))

    def turn(self, share: float) -> Array:
        """(3, 3) how the way has turned at a share of it."""
        return rotation_matrix((share * self.angle * self.axis).tolist())

    def point(self, share: float) -> Array:
        """(3) the point at a share of the way [m]."""
        return self.centre + self.turn(share) @ self.first


def arc_through(start: Array, via: Array, end: Array) -> Arc:
    """The arc from a point (3) through another to a third [m].

    Raises:
        InputError: The points are in line, or two are the same: there is no circle.
    """
    b, c = via - start, end - start
    normal = np.cross(b, c)
    area = float(normal @ normal)
    if area < _FLAT * max(float(b @ b) * float(c @ c), _FLAT):
        raise InputError("movec needs three points that are not in line", value=end.tolist())
    across = float(b @ b) * np.cross(c, normal) + float(c @ c) * np.cross(normal, b)
    centre = start - across / (-2.0 * area)
    first, axis = start - centre, normal / math.sqrt(area)
    side = np.cross(axis, first)
    last = end - centre
    angle = math.atan2(float(last @ side), float(last @ first)) % (2.0 * math.pi)
    return Arc(centre, first, axis, angle)


def move_circle(
    core: Core,
    via: Sequence[float],
    goal: Sequence[float],
    a: float,
    v: float,
    *,
    blend: float = 0.0,
    fixed: bool = False,
) -> Motion:
    """`movec`: along the arc from where the tool is, through a point, to a pose.

    Args:
        core: The controller.
        via: A pose, of which the position counts, or joint positions (6) [rad].
        goal: A pose, or joint positions (6) [rad].
        a: Tool acceleration [m/s^2].
        v: Tool speed [m/s].
        blend: Blend radius [m].
        fixed: Whether the tool turns with the arc; else it turns evenly to the goal's orientation.

    Raises:
        InputError: Numbers that make no arc.
        JobError: A point of it cannot be reached.
    """
    kinematics = core.arm.kinematics
    core.untune()

    def pose(target: Sequence[float]) -> Array:
        values = six(target, "numbers")
        if isinstance(target, Pose):
            return to_matrix(values)
        return kinematics.forward(values, core.tcp_matrix)

    point, end = pose(via)[:3, 3], pose(goal)

    def plan(start: list[float]) -> tuple[Trapezoid, Callable[[float], list[float]]]:
        first = kinematics.forward(start, core.tcp_matrix)
        arc = arc_through(first[:3, 3], point, end[:3, 3])
        turn = rotation_vector(end[:3, :3] @ first[:3, :3].T)

        def place(share: float) -> list[float]:
            tool = np.eye(4)
            tool[:3, 3] = arc.point(share)
            turned = arc.turn(share) if fixed else rotation_matrix((share * turn).tolist())
            tool[:3, :3] = turned @ first[:3, :3]
            return kinematics.inverse(
                tool,
                core.arm.setpoint,
                core.tcp_matrix,
                position_error=1e-9,
                orientation_error=1e-9,
            ).tolist()

        return trapezoid(arc.length, v, a), place

    yield from follow(core, plan, blend)
