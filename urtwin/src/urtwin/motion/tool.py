"""Moves of the tool: straight lines, arcs and tool speeds, solved for the joints cycle by cycle."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dynid.core import Array, InputError
from urtwin.arm import Trapezoid, trapezoid
from urtwin.core import Core
from urtwin.kinematics import rotation_matrix, rotation_vector, to_matrix
from urtwin.motion.joint import Motion, ahead, brake, follow, settle, six
from urtwin.urscript import Pose

_DAMPING = 1e-6
_NO_WAY = 1e-9


def goal_joints(core: Core, goal: Sequence[float]) -> list[float]:
    """Joint positions (6) [rad] of a goal: a pose by inverse kinematics, or these themselves.

    Raises:
        InputError: Not six numbers.
        JobError: The pose cannot be reached.
    """
    values = six(goal, "numbers")
    if not isinstance(goal, Pose):
        return values
    found = core.arm.kinematics.inverse(to_matrix(values), core.arm.setpoint, core.tcp_matrix)
    return found.tolist()


def move_tool(
    core: Core, goal: Sequence[float], a: float, v: float, time: float, blend: float = 0.0
) -> Motion:
    """`movel`: the tool moves on a straight line and turns evenly.

    Args:
        core: The controller.
        goal: A pose, or joint positions (6) [rad].
        a: Tool acceleration [m/s^2]; of the turn [rad/s^2] where the tool only turns.
        v: Tool speed [m/s]; [rad/s] where the tool only turns.
        time: If positive, how long it takes, in place of the two [s].
        blend: Blend radius [m].

    Raises:
        InputError: Numbers that make no move.
        JobError: A point of the line cannot be reached.
    """
    kinematics = core.arm.kinematics
    values = six(goal, "numbers")
    core.untune()
    end = (
        to_matrix(values) if isinstance(goal, Pose) else kinematics.forward(values, core.tcp_matrix)
    )

    def plan(start: list[float]) -> tuple[Trapezoid, Callable[[float], list[float]]]:
        first = kinematics.forward(start, core.tcp_matrix)
        way = end[:3, 3] - first[:3, 3]
        turn = rotation_vector(end[:3, :3] @ first[:3, :3].T)
        length = float(np.linalg.norm(way))
        profile = trapezoid(length if length > _NO_WAY else float(np.linalg.norm(turn)), v, a, time)

        def place(share: float) -> list[float]:
            pose = np.eye(4)
            pose[:3, 3] = first[:3, 3] + share * way
            pose[:3, :3] = rotation_matrix((share * turn).tolist()) @ first[:3, :3]
            return kinematics.inverse(
                pose,
                core.arm.setpoint,
                core.tcp_matrix,
                position_error=1e-9,
                orientation_error=1e-9,
            ).tolist()

        return profile, place

    yield from follow(core, plan, blend)


def speed_tool(core: Core, goal: Sequence[float], a: float, time: float) -> Motion:
    """`speedl`: the tool speeds up to a velocity and keeps it.

    Args:
        core: The controller.
        goal: (6) linear [m/s] and angular [rad/s] velocity in the base frame.
        a: Acceleration [m/s^2].
        time: How long; without it, until the velocity is reached [s].

    Raises:
        InputError: Not six numbers.
    """
    wanted = np.array(six(goal, "speeds"))
    core.untune()
    mover, arm = object(), core.arm
    cycles = max(1, round(time / arm.cycle)) if time > 0.0 else None
    while cycles is None or cycles > 0:
        jacobian = arm.kinematics.jacobian(arm.setpoint, core.tcp_matrix)[1]
        now = jacobian @ arm.speed
        change = core.scaling * wanted - now
        most = float(np.linalg.norm(change))
        share = min(1.0, a * arm.cycle / most) if most > 0.0 else 1.0
        core.move(ahead(core, _joint_speeds(jacobian, now + share * change).tolist()), mover)
        yield
        if cycles is not None:
            cycles -= 1
        elif share == 1.0:
            return


def stop_tool(core: Core, a: float) -> Motion:
    """`stopl`: bring the tool to rest along its way with a deceleration [m/s^2].

    Raises:
        InputError: A deceleration that is not positive.
    """
    arm, mover = core.arm, object()
    jacobian = arm.kinematics.jacobian(arm.setpoint, core.tcp_matrix)[1]
    tool = float(np.linalg.norm((jacobian @ arm.speed)[:3]))
    fastest = max(map(abs, arm.speed))
    # The joints keep their ratio; a tool that hardly moves must not make them stop at once.
    joints = a * fastest / tool if tool > 1e-3 else a
    yield from brake(core, mover, min(joints, arm.braking) if a > 0.0 else a)
    yield from settle(core, mover)


def servo_tool(core: Core, goal: Sequence[float], a: float, v: float) -> Motion:
    """`servoc`: one cycle towards a pose, no faster than asked and able to stop at it.

    Args:
        core: The controller.
        goal: The pose.
        a: Tool acceleration [m/s^2].
        v: Tool speed [m/s].

    Raises:
        InputError: Not six numbers.
    """
    end = to_matrix(six(goal, "numbers"))
    core.untune()
    arm = core.arm
    tool, jacobian = arm.kinematics.jacobian(arm.setpoint, core.tcp_matrix)
    way = end[:3, 3] - tool[:3, 3]
    turn = rotation_vector(end[:3, :3] @ tool[:3, :3].T)
    left = max(float(np.linalg.norm(way)), float(np.linalg.norm(turn)))
    before = float(np.linalg.norm(jacobian @ arm.speed))
    speed = min(v, before + a * arm.cycle, math.sqrt(2.0 * a * left), left / arm.cycle)
    twist = np.concatenate([way, turn]) * (speed / left if left > 0.0 else 0.0)
    core.move(ahead(core, _joint_speeds(jacobian, twist).tolist()), object())
    yield


def _joint_speeds(jacobian: Array, twist: Array) -> Array:
    """(n) joint speeds for a tool velocity (6), damped where the arm is singular."""
    gram = jacobian @ jacobian.T + _DAMPING * np.eye(6)
    return jacobian.T @ np.linalg.solve(gram, twist)


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
