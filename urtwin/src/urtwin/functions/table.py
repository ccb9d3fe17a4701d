"""Every built-in function of the simulated controller."""

from collections.abc import Generator
from typing import Any

from urtwin.core import Core
from urtwin.functions.io import ABSENT, IO
from urtwin.functions.sockets import SOCKETS
from urtwin.functions.state import FORCE, MODEL, STATE
from urtwin.motion import (
    Motion,
    goal_joints,
    move_circle,
    move_joints,
    move_tool,
    servo_joints,
    servo_tool,
    speed_joints,
    speed_tool,
    stop_joints,
    stop_tool,
)
from urtwin.urscript import (
    MATHEMATICS,
    MATRICES,
    POSES,
    Builtin,
    Calling,
    Routine,
    ScriptFault,
    Value,
    builtin,
    number,
    table,
    truth,
)

_MOTION_WEIGHT = 200
_LONGEST_SLEEP_S = 1e6


def _movej(
    core: Core, q: Value, a: Value = 1.4, v: Value = 1.05, t: Value = 0, r: Value = 0
) -> Motion:
    goal = goal_joints(core, q)
    yield from move_joints(core, goal, number(a), number(v), number(t), number(r))


def _movel(
    core: Core, pose: Value, a: Value = 1.2, v: Value = 0.25, t: Value = 0, r: Value = 0
) -> Motion:
    yield from move_tool(core, pose, number(a), number(v), number(t), number(r))


def _movep(core: Core, pose: Value, a: Value = 1.2, v: Value = 0.25, r: Value = 0) -> Motion:
    yield from move_tool(core, pose, number(a), number(v), 0.0, number(r))


def _movec(
    core: Core,
    pose_via: Value,
    pose_to: Value,
    a: Value = 1.2,
    v: Value = 0.25,
    r: Value = 0,
    mode: Value = 0,
) -> Motion:
    fixed = number(mode) == 1
    yield from move_circle(
        core, pose_via, pose_to, number(a), number(v), blend=number(r), fixed=fixed
    )


def _servoj(
    core: Core,
    q: Value,
    a: Value = 0,
    v: Value = 0,
    t: Value = 0.002,
    lookahead_time: Value = 0.1,
    gain: Value = 300,
) -> Motion:
    yield from servo_joints(core, q, number(t), number(lookahead_time), number(gain))


def _servoc(core: Core, pose: Value, a: Value = 1.2, v: Value = 0.25, r: Value = 0) -> Motion:
    yield from servo_tool(core, pose, number(a), number(v))


def _speedj(core: Core, qd: Value, a: Value = 1.4, t: Value = 0) -> Motion:
    yield from speed_joints(core, qd, number(a), number(t))


def _speedl(core: Core, xd: Value, a: Value = 1.2, t: Value = 0, aRot: Value = 0) -> Motion:
    yield from speed_tool(core, xd, number(a), number(t))


def _stopj(core: Core, a: Value) -> Motion:
    yield from stop_joints(core, number(a))


def _stopl(core: Core, a: Value, aRot: Value = 0) -> Motion:
    yield from stop_tool(core, number(a))


def _direct_torque(
    core: Core,
    torque: Value,
    friction_comp: Value = True,
    viscous_scale: Value = None,
    coulomb_scale: Value = None,
) -> Generator[None, None, None]:
    # It lasts a cycle on the robot, and ur_rtde's script counts on that.
    core.lacks("direct_torque")
    yield


def _sync(core: Core) -> Generator[None, None, None]:
    yield


def _sleep(core: Core, t: Value) -> Generator[None, None, None]:
    seconds = number(t)
    if not 0.0 <= seconds <= _LONGEST_SLEEP_S:
        raise ScriptFault("time to sleep [s]", value=seconds, limit=(0, _LONGEST_SLEEP_S))
    for _ in range(max(1, round(seconds / core.arm.cycle))):
        yield


def _interpreter_mode(
    core: Core, clearQueueOnEnter: Value = True, clearOnEnd: Value = True
) -> Routine:
    yield from core.interpreter.run(truth(clearQueueOnEnter), truth(clearOnEnd))


def _end_interpreter(core: Core) -> None:
    core.interpreter.end()


def _clear_interpreter(core: Core) -> None:
    core.interpreter.clear()


_INTERPRETER: dict[str, Any] = {
    "end_interpreter": _end_interpreter,
    "clear_interpreter": _clear_interpreter,
}
_MOTIONS: dict[str, Any] = {
    "movej": _movej,
    "optimovej": _movej,
    "movel": _movel,
    "optimovel": _movel,
    "movep": _movep,
    "movec": _movec,
    "servoj": _servoj,
    "servoc": _servoc,
    "speedj": _speedj,
    "speedl": _speedl,
    "stopj": _stopj,
    "stopl": _stopl,
    "direct_torque": _direct_torque,
    "sync": _sync,
    "sleep": _sleep,
    "interpreter_mode": _interpreter_mode,
}
BUILTINS: dict[str, Builtin] = table(
    MATHEMATICS,
    POSES,
    MATRICES,
    IO,
    STATE,
    MODEL,
    FORCE,
    SOCKETS,
    (
        builtin(function, Calling.BLOCKING, name=name, weight=_MOTION_WEIGHT)
        for name, function in _MOTIONS.items()
    ),
    (builtin(function, Calling.INSTANT, name=name) for name, function in _INTERPRETER.items()),
    ABSENT,
)
"""The functions that every script may call."""
