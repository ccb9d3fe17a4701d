"""Every built-in function that a script can call on the controller."""

from collections.abc import Callable, Generator
from typing import Any

from urtwin import motion
from urtwin.core import Core
from urtwin.functions.io import ABSENT, IO
from urtwin.functions.sockets import SOCKETS
from urtwin.functions.state import STATE
from urtwin.urscript import LIBRARY, Builtin, Routine, Value, builtins, truth, within

_LONGEST_SLEEP_S = 1e6


def _movep(core: Core, pose: Value, a: Value = 1.2, v: Value = 0.25, r: Value = 0) -> motion.Motion:
    yield from motion.move_tool(core, pose, a, v, 0, r)


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
    seconds = within("time to sleep [s]", t, 0, _LONGEST_SLEEP_S)
    for _ in range(max(1, round(seconds / core.arm.cycle))):
        yield


def _interpreter_mode(
    core: Core, clearQueueOnEnter: Value = True, clearOnEnd: Value = True
) -> Routine:
    yield from core.interpreter.run(truth(clearQueueOnEnter), truth(clearOnEnd))


_INTERPRETER: dict[str, Callable[[Core], None]] = {
    "end_interpreter": lambda core: core.interpreter.end(),
    "clear_interpreter": lambda core: core.interpreter.clear(),
}
_SLOW: dict[str, Any] = {
    "movej": motion.move_joints,
    "optimovej": motion.move_joints,
    "movel": motion.move_tool,
    "optimovel": motion.move_tool,
    "movep": _movep,
    "movec": motion.move_circle,
    "servoj": motion.servo_joints,
    "servoc": motion.servo_tool,
    "speedj": motion.speed_joints,
    "speedl": motion.speed_tool,
    "stopj": motion.stop_joints,
    "stopl": motion.stop_tool,
    "direct_torque": _direct_torque,
    "sync": _sync,
    "sleep": _sleep,
    "interpreter_mode": _interpreter_mode,
}
BUILTINS: dict[str, Builtin] = {
    **builtins({**LIBRARY, **IO, **STATE, **SOCKETS, **_SLOW, **_INTERPRETER}),
    **ABSENT,
}
"""The functions that every script may call."""
