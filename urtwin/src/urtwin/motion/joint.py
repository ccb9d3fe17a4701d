"""Moves in joint space: generators that give one set point a control cycle."""

import math
from collections.abc import Callable, Generator, Sequence

import numpy as np

from dynid.core import InputError
from urtwin.arm import Rest, Trapezoid, hands_over, trapezoid
from urtwin.core import Core

Motion = Generator[None, None, None]
_SETTLED = 1e-5
_PATIENCE_S = 0.5


def move_joints(
    core: Core, goal: Sequence[float], a: float, v: float, time: float, blend: float = 0.0
) -> Motion:
    """`movej`: all joints start and end together, the one with the longest way sets the pace.

    Args:
        core: The controller.
        goal: (6) where to go [rad].
        a: Acceleration [rad/s^2].
        v: Speed [rad/s].
        time: If positive, how long it takes, in place of the two [s].
        blend: Blend radius [m].

    Raises:
        InputError: Numbers that make no move.
    """
    end = six(goal, "joint positions")
    core.untune()

    def plan(start: list[float]) -> tuple[Trapezoid, Callable[[float], list[float]]]:
        ways = [b - c for b, c in zip(end, start, strict=True)]
        profile = trapezoid(max(map(abs, ways)), v, a, time)

        def place(share: float) -> list[float]:
            if share >= 1.0:
                return end
            return [c + share * way for c, way in zip(start, ways, strict=True)]

        return profile, place

    yield from follow(core, plan, blend)


def follow(
    core: Core,
    plan: Callable[[list[float]], tuple[Trapezoid, Callable[[float], list[float]]]],
    blend: float = 0.0,
) -> Motion:
    """Move along a path from rest to rest; the speed slider scales its time.

    When something else has moved the arm meanwhile (a pause), the rest is planned anew. A move
    that hands over in a blend is done when the next can begin.

    Args:
        core: The controller.
        plan: Gives, for a start (6) [rad], the profile and the path: share done to set point.
        blend: Blend radius [m].
    """
    mover = object()
    core.interpreter.take_abort()
    before, core.rest = core.rest, None
    if before is None:
        yield from brake(core, mover, 2.0)
    while not (yield from _try(core, mover, plan, before, blend)):
        before = None
        yield from brake(core, mover, 2.0)
    if core.rest is None:
        yield from settle(core, mover)


def _try(
    core: Core,
    mover: object,
    plan: Callable[[list[float]], tuple[Trapezoid, Callable[[float], list[float]]]],
    before: Rest | None,
    blend: float,
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
            yield from brake(core, mover, 2.0)
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


def settle(core: Core, mover: object) -> Motion:
    """Wait until the servo's target stands at the set point."""
    arm = core.arm
    for _ in range(round(_PATIENCE_S / arm.cycle)):
        target = arm.state.target
        off = max(abs(a - b) for a, b in zip(arm.setpoint, target.q.tolist(), strict=True))
        if off < _SETTLED and float(np.max(np.abs(target.dq))) < _SETTLED:
            return
        core.move(arm.setpoint, mover)
        yield


def brake(core: Core, mover: object, a: float) -> Motion:
    """Bring the set point to rest.

    Args:
        core: The controller.
        mover: Who brakes.
        a: Deceleration of the fastest joint [rad/s^2].

    Raises:
        InputError: A deceleration that is not positive.
    """
    if not a > 0.0:
        raise InputError("deceleration must be positive", value=a)
    arm = core.arm
    while True:
        fastest = max(map(abs, arm.speed))
        if fastest < 1e-9:
            return
        share = max(0.0, 1.0 - a * arm.cycle / fastest)
        core.move(ahead(core, [share * speed for speed in arm.speed]), mover)
        yield


def stop_joints(core: Core, a: float) -> Motion:
    """`stopj`: bring the arm to rest with a deceleration [rad/s^2].

    Raises:
        InputError: A deceleration that is not positive.
    """
    mover = object()
    yield from brake(core, mover, a)
    yield from settle(core, mover)


def speed_joints(core: Core, goal: Sequence[float], a: float, time: float) -> Motion:
    """`speedj`: speed up to joint speeds and keep them.

    Args:
        core: The controller.
        goal: (6) speeds [rad/s].
        a: Acceleration of the joint that changes most [rad/s^2]; with none and a time the arm
            keeps its speeds, as in the constant parts of the splines of UR's drivers.
        time: How long; without it, until the speeds are reached [s].

    Raises:
        InputError: Numbers that make no motion.
    """
    wanted = six(goal, "joint speeds")
    if not (a > 0.0 or (a == 0.0 and time > 0.0)):
        raise InputError("acceleration must be positive", value=a)
    mover, arm = object(), core.arm
    core.untune()
    cycles = max(1, round(time / arm.cycle)) if time > 0.0 else None
    while cycles is None or cycles > 0:
        change = [core.scaling * b - c for b, c in zip(wanted, arm.speed, strict=True)]
        most = max(map(abs, change))
        share = min(1.0, a * arm.cycle / most) if most > 0.0 else 1.0
        core.move(
            ahead(core, [c + share * d for c, d in zip(arm.speed, change, strict=True)]), mover
        )
        yield
        if cycles is not None:
            cycles -= 1
        elif share == 1.0:
            return


def servo_joints(
    core: Core, goal: Sequence[float], time: float, lookahead: float, gain: float
) -> Motion:
    """`servoj`: a set point now, reached on a straight line in the given time.

    The speed slider does not act on it.

    Args:
        core: The controller.
        goal: (6) set point [rad].
        time: How long the call lasts [s].
        lookahead: Delay from set point to target [s].
        gain: Stiffness of the position loop.

    Raises:
        InputError: A lookahead or gain that `servoj` does not take.
    """
    end = six(goal, "joint positions")
    core.tune(float(lookahead), float(gain))
    mover, arm = object(), core.arm
    cycles = max(1, round(time / arm.cycle))
    if cycles == 1:
        core.move(end, mover)
        yield
        return
    start = arm.setpoint
    for k in range(1, cycles + 1):
        share = k / cycles
        core.move(
            end if k == cycles else [b + share * (c - b) for b, c in zip(start, end, strict=True)],
            mover,
        )
        yield


def ahead(core: Core, speed: Sequence[float]) -> list[float]:
    """The set point after one more cycle at joint speeds (6) [rad/s]."""
    cycle = core.arm.cycle
    return [q + cycle * dq for q, dq in zip(core.arm.setpoint, speed, strict=True)]


def six(values: Sequence[float], what: str) -> list[float]:
    """Six numbers.

    Raises:
        InputError: Another number of them.
    """
    if not isinstance(values, list) or len(values) != 6:
        raise InputError(f"six {what} expected", value=values)
    return [float(value) for value in values]
