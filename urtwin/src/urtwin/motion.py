"""Motions of the arm: generators that give one set point a control cycle.

Moves of the tool (straight lines, arcs, tool speeds) are solved for the joints cycle by cycle.
Functions that scripts call have the parameters of the script manual:

- a goal is joint positions (6) [rad], or a pose x, y, z, rx, ry, rz [m, rad];
- `a` and `v` are acceleration and speed of the joint with the longest way [rad/s^2, rad/s], or of
  the tool [m/s^2, m/s; rad/s^2, rad/s where it only turns];
- `t` is, if positive, how long it takes, in moves in place of the two [s];
- `r` is the blend radius [m].

Numbers that make no motion are an `InputError` (`ScriptFault` where they are not as many as they
should be, or no numbers), a pose on the way that the arm cannot reach is a `JobError`.
"""

import math
from collections.abc import Callable, Generator, Sequence

import numpy as np

from dynid.core import Array, InputError
from urtwin.arm import Rest, Trapezoid, hands_over, trapezoid
from urtwin.core import Core
from urtwin.kinematics import arc_through, joint_speeds, rotation_matrix, rotation_vector, to_matrix
from urtwin.urscript import Pose, Value, number, numbers

Motion = Generator[None, None, None]
_Place = Callable[[float], list[float]]
"""Joint positions (6) [rad] at a share of the way."""
_Plan = Callable[[list[float]], tuple[Trapezoid, _Place]]
"""Gives, for a start (6) [rad], the profile and the path."""
_SETTLED = 1e-5
_PATIENCE_S = 0.5
_NO_WAY = 1e-9


def move_joints(
    core: Core, q: Value, a: Value = 1.4, v: Value = 1.05, t: Value = 0, r: Value = 0
) -> Motion:
    """`movej`: all joints start and end together, the one with the longest way sets the pace."""
    end = numbers(q, 6, "joint positions")
    if isinstance(q, Pose):
        end = core.arm.kinematics.inverse(
            to_matrix(end), core.arm.setpoint, core.tcp_matrix
        ).tolist()
    a, v, t, r = map(number, (a, v, t, r))
    core.untune()

    def plan(start: list[float]) -> tuple[Trapezoid, _Place]:
        ways = [b - c for b, c in zip(end, start, strict=True)]
        profile = trapezoid(max(map(abs, ways)), v, a, t)

        def place(share: float) -> list[float]:
            if share >= 1.0:
                return end
            return [c + share * way for c, way in zip(start, ways, strict=True)]

        return profile, place

    yield from _follow(core, plan, r)


def move_tool(
    core: Core, pose: Value, a: Value = 1.2, v: Value = 0.25, t: Value = 0, r: Value = 0
) -> Motion:
    """`movel`: the tool moves on a straight line and turns evenly."""
    a, v, t, r = map(number, (a, v, t, r))
    core.untune()
    end = _tool_at(core, pose)

    def plan(start: list[float]) -> tuple[Trapezoid, _Place]:
        first = core.arm.kinematics.forward(start, core.tcp_matrix)
        way = end[:3, 3] - first[:3, 3]
        turn = rotation_vector(end[:3, :3] @ first[:3, :3].T)
        length = float(np.linalg.norm(way))
        profile = trapezoid(length if length > _NO_WAY else float(np.linalg.norm(turn)), v, a, t)

        def place(share: float) -> list[float]:
            turned = rotation_matrix(share * turn) @ first[:3, :3]
            return _joints_at(core, first[:3, 3] + share * way, turned)

        return profile, place

    yield from _follow(core, plan, r)


def move_circle(
    core: Core,
    pose_via: Value,
    pose_to: Value,
    a: Value = 1.2,
    v: Value = 0.25,
    r: Value = 0,
    mode: Value = 0,
) -> Motion:
    """`movec`: along the arc from where the tool is, through a point, to a goal.

    With `mode` 1 the tool turns with the arc; else it turns evenly to the goal's orientation.
    """
    a, v, r = map(number, (a, v, r))
    fixed = number(mode) == 1
    core.untune()
    point, end = _tool_at(core, pose_via)[:3, 3], _tool_at(core, pose_to)

    def plan(start: list[float]) -> tuple[Trapezoid, _Place]:
        first = core.arm.kinematics.forward(start, core.tcp_matrix)
        arc = arc_through(first[:3, 3], point, end[:3, 3])
        turn = rotation_vector(end[:3, :3] @ first[:3, :3].T)

        def place(share: float) -> list[float]:
            turned = arc.turn(share) if fixed else rotation_matrix(share * turn)
            return _joints_at(core, arc.point(share), turned @ first[:3, :3])

        return trapezoid(arc.length, v, a), place

    yield from _follow(core, plan, r)


def _tool_at(core: Core, goal: Sequence[float]) -> Array:
    """(4, 4) the tool in the base frame at a pose or at joint positions (6) [rad]."""
    values = numbers(goal, 6, "a pose or joint positions")
    if isinstance(goal, Pose):
        return to_matrix(values)
    return core.arm.kinematics.forward(values, core.tcp_matrix)


def _joints_at(core: Core, point: Array, rotation: Array) -> list[float]:
    """(6) joint positions [rad] that put the tool at a point (3) [m], turned (3, 3)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, point
    return core.arm.kinematics.inverse(
        pose, core.arm.setpoint, core.tcp_matrix, position_error=1e-9, orientation_error=1e-9
    ).tolist()


def _follow(core: Core, plan: _Plan, blend: float) -> Motion:
    """Move along a path from rest to rest; the speed slider scales its time.

    When something else has moved the arm meanwhile (a pause), the rest is planned anew. A move
    that hands over within the blend radius [m] is done when the next can begin.
    """
    mover = object()
    core.interpreter.take_abort()
    before, core.rest = core.rest, None
    if before is None:
        yield from _brake(core, mover, 2.0)
    while not (yield from _try(core, mover, plan, before, blend)):
        before = None
        yield from _brake(core, mover, 2.0)
    if core.rest is None:
        yield from _settle(core, mover)


def _try(
    core: Core, mover: object, plan: _Plan, before: Rest | None, blend: float
) -> Generator[None, None, bool]:
    """Move along a path; whether that was the end of it, or something has moved the arm."""
    arm = core.arm
    profile, place = plan(arm.setpoint if before is None else before.end)
    t, total = 0.0, profile.duration
    while True:
        step = arm.cycle * core.scaling
        t = min(t + step, total)
        expected = place(profile.share(t))
        offset = None if before is None else before.next(step)
        if offset is None:
            before = None
        else:
            expected = [q + d for q, d in zip(expected, offset, strict=True)]
        core.move(expected, mover)
        yield
        if core.interpreter.take_abort():
            yield from _brake(core, mover, 2.0)
            return True
        if arm.setpoint != expected:
            return False
        if before is not None:
            continue
        if t >= total:
            return True
        if hands_over(lambda: _apart(core, place(1.0)), profile, t, blend):
            core.rest = Rest(profile, place, place(1.0), t, expected)
            return True


def _apart(core: Core, end: list[float]) -> float:
    """How far the tool is from where it is at joint positions (6) [rad], in metres."""
    forward, tool = core.arm.kinematics.forward, core.tcp_matrix
    return math.dist(forward(core.arm.setpoint, tool)[:3, 3], forward(end, tool)[:3, 3])


def _settle(core: Core, mover: object) -> Motion:
    """Wait until the servo's target stands at the set point."""
    arm = core.arm
    for _ in range(round(_PATIENCE_S / arm.cycle)):
        target = arm.state.target
        off = max(abs(a - b) for a, b in zip(arm.setpoint, target.q.tolist(), strict=True))
        if off < _SETTLED and float(np.max(np.abs(target.dq))) < _SETTLED:
            return
        core.move(arm.setpoint, mover)
        yield


def _brake(core: Core, mover: object, a: float) -> Motion:
    """Bring the set point to rest; a: deceleration of the fastest joint [rad/s^2]."""
    if not a > 0.0:
        raise InputError("deceleration must be positive", value=a)
    arm = core.arm
    while True:
        fastest = max(map(abs, arm.speed))
        if fastest < 1e-9:
            return
        share = max(0.0, 1.0 - a * arm.cycle / fastest)
        core.move(_ahead(core, [share * speed for speed in arm.speed]), mover)
        yield


def stop_joints(core: Core, a: Value) -> Motion:
    """`stopj`: bring the arm to rest with a deceleration [rad/s^2]."""
    mover = object()
    yield from _brake(core, mover, number(a))
    yield from _settle(core, mover)


def stop_tool(core: Core, a: Value, aRot: Value = 0) -> Motion:
    """`stopl`: bring the tool to rest along its way with a deceleration [m/s^2]."""
    arm, mover, a = core.arm, object(), number(a)
    jacobian = arm.kinematics.jacobian(arm.setpoint, core.tcp_matrix)[1]
    tool = float(np.linalg.norm((jacobian @ arm.speed)[:3]))
    fastest = max(map(abs, arm.speed))
    # The joints keep their ratio; a tool that hardly moves must not make them stop at once.
    joints = a * fastest / tool if tool > 1e-3 else a
    yield from _brake(core, mover, min(joints, arm.braking) if a > 0.0 else a)
    yield from _settle(core, mover)


def speed_joints(core: Core, qd: Value, a: Value = 1.4, t: Value = 0) -> Motion:
    """`speedj`: speed up to joint speeds (6) [rad/s] and keep them; without `t` until then.

    `a` is that of the joint that changes most; with none and a time the arm keeps its speeds, as
    in the constant parts of the splines of UR's drivers.
    """
    a, t = number(a), number(t)
    wanted = numbers(qd, 6, "joint speeds")
    if not (a > 0.0 or (a == 0.0 and t > 0.0)):
        raise InputError("acceleration must be positive", value=a)
    mover, arm = object(), core.arm
    core.untune()
    cycles = _cycles(core, t)
    while cycles is None or cycles > 0:
        change = [core.scaling * b - c for b, c in zip(wanted, arm.speed, strict=True)]
        most = max(map(abs, change))
        share = min(1.0, a * arm.cycle / most) if most > 0.0 else 1.0
        speeds = [c + share * d for c, d in zip(arm.speed, change, strict=True)]
        core.move(_ahead(core, speeds), mover)
        yield
        if cycles is not None:
            cycles -= 1
        elif share == 1.0:
            return


def speed_tool(core: Core, xd: Value, a: Value = 1.2, t: Value = 0, aRot: Value = 0) -> Motion:
    """`speedl`: the tool speeds up to a velocity and keeps it; without `t` until then.

    `xd` is linear [m/s] and angular [rad/s] velocity (6) in the base frame; `aRot` is not used.
    """
    a, t = number(a), number(t)
    wanted = np.array(numbers(xd, 6, "speeds"))
    if not a > 0.0:
        raise InputError("acceleration must be positive", value=a)
    core.untune()
    mover, arm = object(), core.arm
    cycles = _cycles(core, t)
    while cycles is None or cycles > 0:
        jacobian = arm.kinematics.jacobian(arm.setpoint, core.tcp_matrix)[1]
        now = jacobian @ arm.speed
        change = core.scaling * wanted - now
        most = float(np.linalg.norm(change))
        share = min(1.0, a * arm.cycle / most) if most > 0.0 else 1.0
        core.move(_ahead(core, joint_speeds(jacobian, now + share * change)), mover)
        yield
        if cycles is not None:
            cycles -= 1
        elif share == 1.0:
            return


def servo_joints(
    core: Core,
    q: Value,
    a: Value = 0,
    v: Value = 0,
    t: Value = 0.002,
    lookahead_time: Value = 0.1,
    gain: Value = 300,
) -> Motion:
    """`servoj`: a set point (6) [rad] now, reached on a straight line in the given time.

    The speed slider does not act on it; `a` and `v` are not used. `lookahead_time` is the delay
    from set point to target [s], `gain` the stiffness of the position loop.
    """
    end = numbers(q, 6, "joint positions")
    core.tune(float(number(lookahead_time)), float(number(gain)))
    mover, start = object(), core.arm.setpoint
    cycles = _cycles(core, number(t)) or 1
    for k in range(1, cycles):
        share = k / cycles
        core.move([b + share * (c - b) for b, c in zip(start, end, strict=True)], mover)
        yield
    core.move(end, mover)
    yield


def servo_tool(core: Core, pose: Value, a: Value = 1.2, v: Value = 0.25, r: Value = 0) -> Motion:
    """`servoc`: one cycle towards a pose, no faster than asked and able to stop at it.

    `r` is not used.
    """
    a, v = number(a), number(v)
    if not (a > 0.0 and v > 0.0):
        raise InputError("speed and acceleration of a move must be positive", value=(v, a))
    end = to_matrix(numbers(pose, 6, "a pose"))
    core.untune()
    arm = core.arm
    tool, jacobian = arm.kinematics.jacobian(arm.setpoint, core.tcp_matrix)
    way = end[:3, 3] - tool[:3, 3]
    turn = rotation_vector(end[:3, :3] @ tool[:3, :3].T)
    left = max(float(np.linalg.norm(way)), float(np.linalg.norm(turn)))
    before = float(np.linalg.norm(jacobian @ arm.speed))
    speed = min(v, before + a * arm.cycle, math.sqrt(2.0 * a * left), left / arm.cycle)
    twist = np.concatenate([way, turn]) * (speed / left if left > 0.0 else 0.0)
    core.move(_ahead(core, joint_speeds(jacobian, twist)), object())
    yield


def _ahead(core: Core, speed: Sequence[float]) -> list[float]:
    """The set point after one more cycle at joint speeds (6) [rad/s]."""
    cycle = core.arm.cycle
    return [q + cycle * dq for q, dq in zip(core.arm.setpoint, speed, strict=True)]


def _cycles(core: Core, t: float) -> int | None:
    """The control cycles of a time [s], one at least; None for a time that is not positive."""
    return max(1, round(t / core.arm.cycle)) if t > 0.0 else None
