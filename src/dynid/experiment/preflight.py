"""What is checked before a real robot moves, and the way to the start pose.

The way is straight where that is free, else searched in joint space.
"""

from collections.abc import Collection
from dataclasses import dataclass
from itertools import pairwise
from threading import Event

import numpy as np

from dynid import protocol, robot, trajectory
from dynid.constraints import DISTANCES, Certificate, MotionConstraints, certify
from dynid.core import Array, InputError, JobError, Progress
from dynid.drivers import WATCHDOG_HZ, ControllerState, mode_name
from dynid.experiment.plan import ExperimentPlan

SPACING = 0.03
"""Largest joint motion between two looks at a way [rad or m]."""
STEP = 0.8
"""Longest growth of a tree at once [rad or m]."""
SHORTCUTS = 40
"""Attempts to leave out a piece of the way that was found."""
_SHARE = 0.02
"""Of each limit that is no distance, kept free."""
_WANDER = np.pi
"""How far the search goes beyond both ends [rad or m]."""
_ROUNDING = 1e-6


class FreeSpace:
    """The poses and straight ways that a judge lets pass.

    Args:
        constraints: The judge.
        q: (n) where the way begins [rad or m].
        goal: (n) where it ends [rad or m].
        speed: Joint speed at which it is taken [rad/s or m/s].
        room: Distance to keep beyond the clearance, where both ends have it too [m].
    """

    def __init__(
        self, constraints: MotionConstraints, q: Array, goal: Array, *, speed: float, room: float
    ) -> None:
        self.q, self.goal = np.array(q, dtype=np.float64), np.array(goal, dtype=np.float64)
        bounds = constraints.settings.bounds
        ends = np.stack([self.q, self.goal])
        self.lower = np.maximum(bounds.lower, ends.min(axis=0) - _WANDER)
        self.upper = np.minimum(bounds.upper, ends.max(axis=0) + _WANDER)
        self._constraints, self._speed = constraints, speed
        # An end that is near something must not lock the robot in.
        at_ends = self._rooms(ends, np.zeros(ends.shape))
        wish = {kind: room if kind in DISTANCES else _SHARE for kind in at_ends}
        self._least = {k: min(wish[k], max(at_ends[k] - _ROUNDING, 0.0)) for k in at_ends}

    def free(self, a: Array, b: Array) -> bool:
        """Whether the straight way from a (n) to b (n) passes in its samples."""
        step = b - a
        way = float(np.abs(step).max())
        if way == 0.0:
            return True
        count = int(np.ceil(way / SPACING)) + 1
        q = a + np.linspace(0.0, 1.0, count)[:, None] * step
        dq = np.broadcast_to(self._speed / way * step, q.shape).copy()
        # What is in the way is most often near the far end: a look there may spare the rest.
        return self._passes(q[-1:], dq[-1:]) and self._passes(q, dq)

    def _passes(self, q: Array, dq: Array) -> bool:
        return all(room >= self._least[kind] for kind, room in self._rooms(q, dq).items())

    def _rooms(self, q: Array, dq: Array) -> dict[str, float]:
        worst = self._constraints.usage(q, dq, np.zeros(q.shape))
        return {kind: item.room for kind, item in worst.items()}


class _Tree:
    """Poses that can be reached from the first one."""

    def __init__(self, root: Array) -> None:
        self.poses, self.parents = [root], [-1]

    def grow(self, space: FreeSpace, towards: Array) -> int | None:
        """The number of a new pose one step nearer to another pose; None if it is blocked."""
        base = int(np.argmin(np.linalg.norm(np.array(self.poses) - towards, axis=1)))
        a = self.poses[base]
        away = towards - a
        way = float(np.abs(away).max())
        b = towards if way <= STEP else a + STEP / way * away
        if not space.free(a, b):
            return None
        self.poses.append(b)
        self.parents.append(base)
        return len(self.poses) - 1

    def way(self, number: int) -> list[Array]:
        """The poses from the root to one."""
        found: list[Array] = []
        while number >= 0:
            found.append(self.poses[number])
            number = self.parents[number]
        return found[::-1]


def find_way(space: FreeSpace, random: np.random.Generator, growths: int) -> Array | None:
    """(k, n) poses of a free way from the space's first pose to its goal, few of them.

    None if none was found within so many growths of the trees.
    """
    trees = _Tree(space.q), _Tree(space.goal)
    for number in range(growths):
        one, other = trees if number % 2 == 0 else trees[::-1]
        new = one.grow(space, random.uniform(space.lower, space.upper))
        if new is None:
            continue
        target = one.poses[new]
        met = other.grow(space, target)
        while met is not None and not np.array_equal(other.poses[met], target):
            met = other.grow(space, target)
        if met is not None:
            way = one.way(new) + other.way(met)[-2::-1]
            return _shortened(space, np.array(way if one is trees[0] else way[::-1]), random)
    return None


def _shortened(space: FreeSpace, poses: Array, random: np.random.Generator) -> Array:
    """Fewer poses and a shorter way: what lies between two points of it is left out."""
    poses = _pruned(space, poses)
    for _ in range(SHORTCUTS):
        if len(poses) <= 2:
            break
        i, j = np.sort(random.choice(len(poses) - 1, 2, replace=False))
        u, v = random.uniform(size=2)
        a = poses[i] + u * (poses[i + 1] - poses[i])
        b = poses[j] + v * (poses[j + 1] - poses[j])
        if space.free(a, b):
            poses = np.concatenate([poses[: i + 1], [a, b], poses[j + 1 :]])
            poses = _pruned(space, poses)
    return poses


def _pruned(space: FreeSpace, poses: Array) -> Array:
    """From each pose straight to the farthest one along the way that can be reached."""
    kept, last = [poses[0]], 0
    while last < len(poses) - 1:
        nxt = next(
            (k for k in range(len(poses) - 1, last + 1, -1) if space.free(poses[last], poses[k])),
            last + 1,
        )
        kept.append(poses[nxt])
        last = nxt
    return np.array(kept)


APPROACH_SPEED = 0.5
"""Joint speed of the way to the start [rad/s]."""
SEARCHES = (
    *[(0.005, 400)] * 2,
    *[(0.002, 400)] * 4,
    *[(0.001, 400)] * 6,
    *[(0.0003, 400)] * 3,
    (0.0003, 1500),
)
"""Distances kept beyond the clearance in one search after the other [m], and the growths of its
trees: trees that have not met early rarely do, new ones may."""
_NEAR = 1e-3
_PEAK = 15.0 / 8.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Approach:
    """How a robot gets from where it stands to the start of a motion."""

    poses: Array
    """(k, n) where it stands, way points, the start; `movej` takes each straight way between
    two of them and rests at its end [rad or m]."""
    refused: Certificate | None = None
    """Of the straight way, if no way was found; None if the way is certified."""

    @property
    def free(self) -> bool:
        """Whether the way was certified from pose to pose."""
        return self.refused is None

    @property
    def via(self) -> tuple[Array, ...]:
        """Where it stands, and way points, each (n) [rad or m]; what an execution takes."""
        return tuple(self.poses[:-1])

    @property
    def length(self) -> float:
        """Sum over the straight ways of the largest joint motion [rad or m]."""
        return float(np.abs(np.diff(self.poses, axis=0)).max(axis=1).sum())

    def describe(self) -> str:
        """The way in words."""
        if self.length <= _NEAR:
            return "already there"
        points = len(self.poses) - 2
        if points == 0:
            return f"{self.length:.3g} rad"
        return f"{points} way point{'s' if points > 1 else ''}, {self.length:.3g} rad"


def plan_approach(
    q: Array,
    start: Array,
    constraints: MotionConstraints,
    *,
    seed: int = 0,
    cancel: Event | None = None,
    progress: Progress | None = None,
) -> Approach:
    """Find and certify a way to the start.

    Args:
        q: (n) where the robot stands [rad or m].
        start: (n) the start of the motion [rad or m].
        constraints: What the way is held to.
        seed: Of the search; the same seed gives the same way.
        cancel: Ends the search when it is set: nothing was found then.
        progress: Told how much of the search is done (0 to 1).

    Returns:
        The straight way where it passes the certificate, else one through way points, each
        straight piece certified; if none was found, the straight way and its verdict.
    """
    straight = np.stack([q, start])
    if np.abs(start - q).max() <= _NEAR:
        return Approach(poses=straight)
    verdict = certify_straight(q, start, constraints)
    if verdict.holds:
        return Approach(poses=straight)
    still = np.zeros_like(straight)
    # Every way has its ends.
    ends = constraints.holds(straight, still, still)
    for number, (room, growths) in enumerate(SEARCHES if ends else ()):
        if cancel is not None and cancel.is_set():
            break
        if progress is not None:
            progress("search for a way to the start", number / len(SEARCHES))
        space = FreeSpace(constraints, q, start, speed=APPROACH_SPEED, room=room)
        poses = find_way(space, np.random.default_rng([seed, number]), growths)
        if poses is not None and all(
            certify_straight(a, b, constraints).holds for a, b in pairwise(poses)
        ):
            return Approach(poses=poses)
    return Approach(poses=straight, refused=verdict)


def certify_straight(a: Array, b: Array, constraints: MotionConstraints) -> Certificate:
    """Certify the straight way in joint space from a (n) to b (n), as `movej` takes it."""
    way = float(np.abs(b - a).max())
    travel = max(_PEAK * way / APPROACH_SPEED, 0.1)
    return certify(trajectory.Quintic(start=a, goal=b, travel_time=travel), constraints)


_E_SERIES = 5
_SLIDER = 1e-3
_STILL = 1e-3
_MASS, _COG, _TCP = 0.01, 0.005, 0.005
_STEPS = {
    "model": "Design for the robot that is there; a robot file of your own says which UR it is by "
    'its name, such as name = "ur5e".',
    "rate": "Design for the robot that is there.",
    "robot mode": "Switch it on and release its brakes at the pendant.",
    "safety mode": "Clear its cause: release a stop, or leave reduced mode, at the pendant.",
    "program": "Stop the program at the pendant.",
    "speed slider": "Set the speed slider to 100 %.",
    "at rest": "Wait until nobody moves it.",
    "freedrive": "Let go of the teach button, and of the arm.",
    "network": "The program's watchdog would stop it where the network, or this computer, is so "
    "slow: connect it to the robot by cable, and end other work on it.",
}
"""What to do about each thing that is not as it must be, where its finding does not say it."""
_ANSWER_S = 1 / WATCHDOG_HZ
"""A lost packet costs a round trip at least, which must not starve the watchdog [s]."""


@dataclass(frozen=True, slots=True)
class PreflightCheck:
    """One thing that was looked at."""

    name: str
    """What, in a word or two."""
    passed: bool
    """Whether the robot may move."""
    finding: str
    """What was found, in words."""


def check_design(
    plan: ExperimentPlan, constraints: MotionConstraints, accepted: Collection[str] = ()
) -> Certificate:
    """Certify the motion of a plan, and its slow pass; accepted kinds need not be judged.

    Raises:
        InputError: A motion breaks a limit or touches something, or that cannot be judged.
    """
    certificate = certify(plan.trajectory, constraints)
    missing = [item for item in certificate.unjudged if item.kind not in accepted]
    if certificate.holds and missing:
        raise InputError(
            f"the design must not run on {plan.robot.name}: "
            + "; ".join(f"{item.kind} cannot be judged: {item.message}" for item in missing),
            next_step=f"{missing[0].next_step} Or pass "
            + " ".join(f"--accept-unjudged {item.kind}" for item in missing)
            + ".",
        )
    if not certificate.holds:
        raise InputError(
            f"the design must not run on {plan.robot.name}: {_broken(certificate)}",
            next_step="Design again, with --limits safe, for this robot, tool, payload, mounting "
            "and scene; dynid check with the same options shows every margin.",
        )
    if plan.slow is not None:
        # Gravity acts on it alone: an acceleration may take torque off the fast motion.
        slow = certify(plan.passes()[0].execution.trajectory, constraints)
        if not slow.holds:
            raise InputError(
                f"the slow pass must not run on {plan.robot.name}: {_broken(slow)}",
                next_step="Run it with a larger share than --slow, or without a slow pass.",
            )
    return certificate


def check_robot(
    plan: ExperimentPlan, state: ControllerState, approach: Approach
) -> tuple[PreflightCheck, ...]:
    """Look at a controller before it gets a plan, and at the way from where it stands."""
    mode = mode_name(protocol.RobotMode, state.robot_mode)
    safety = mode_name(protocol.SafetyMode, state.safety_mode)
    program = mode_name(protocol.RuntimeState, state.runtime_state)
    remote = {None: "it does not say", True: "on", False: "off: switch it on at the pendant"}
    slider, speed = state.speed_fraction, float(np.abs(state.target_qd).max())
    late = state.round_trip_s
    return (
        _model(plan.robot.name, state),
        PreflightCheck("rate", plan.rate_hz == state.rate_hz, f"{state.rate_hz:g} cycles a second"),
        PreflightCheck("robot mode", state.robot_mode == protocol.RobotMode.RUNNING, mode),
        PreflightCheck("safety mode", state.safety_mode == protocol.SafetyMode.NORMAL, safety),
        PreflightCheck("program", state.runtime_state == protocol.RuntimeState.STOPPED, program),
        PreflightCheck("remote control", state.remote is not False, remote[state.remote]),
        PreflightCheck("speed slider", abs(slider - 1.0) <= _SLIDER, f"{100 * slider:.4g} %"),
        PreflightCheck("at rest", speed <= _STILL, f"{speed:.3g} rad/s"),
        PreflightCheck(
            "freedrive", not state.freedrive, "teach button pressed" if state.freedrive else "off"
        ),
        PreflightCheck(
            "network", late <= _ANSWER_S, f"an answer took {late:.3f} s of at most {_ANSWER_S:g} s"
        ),
        _payload(plan.robot.tool, state),
        _tool(plan.robot.tool, state),
        _approach(approach),
    )


def require_ready(checks: tuple[PreflightCheck, ...], where: str) -> None:
    """Refuse a robot that is not ready; its address says which.

    Raises:
        JobError: Something was found; the message names all of it.
    """
    wrong = [check for check in checks if not check.passed]
    if wrong:
        found = "; ".join(f"{check.name}: {check.finding}" for check in wrong)
        steps = " ".join(_STEPS[check.name] for check in wrong if check.name in _STEPS)
        raise JobError(f"the robot is not ready; {found}", where=where, next_step=steps or None)


def _model(name: str, state: ControllerState) -> PreflightCheck:
    """The dashboard calls a UR5e a UR5; the major version tells them apart."""
    version = ".".join(str(part) for part in state.version[:3])
    series = "e" if state.version[0] >= _E_SERIES else "CB"
    finding = f"{state.model or 'unknown model'}, software {version} ({series}-Series)"
    called = name.lower()
    # Without a dashboard there is only the version to go by.
    known = not state.model or state.model.lower().removesuffix("e") == called.removesuffix("e")
    e_series = called.endswith("e")
    fits = not called.startswith("ur") or (state.version[0] >= _E_SERIES) == e_series
    return PreflightCheck("model", known and fits, f"{finding}, design for {name}")


def _payload(asked: robot.Tool, state: ControllerState) -> PreflightCheck:
    if state.payload is None:
        said = f"unknown to RTDE; {asked.mass:g} kg are meant to be set"
        return PreflightCheck("payload", True, said)
    finding = f"{state.payload:.3g} kg set, {asked.mass:.3g} kg asked for"
    fits = abs(state.payload - asked.mass) <= _MASS
    if fits and state.payload_cog is not None and asked.mass > 0:
        away = float(np.abs(state.payload_cog - asked.com).max())
        fits = away <= _COG
        finding += f", centres {1e3 * away:.3g} mm apart"
    return PreflightCheck(
        "payload", fits, finding if fits else f"{finding} (--payload KG,X,Y,Z, or set it there)"
    )


def _tool(asked: robot.Tool, state: ControllerState) -> PreflightCheck:
    if state.tcp_offset is None:
        said = f"unknown to RTDE; {asked.tcp.tolist()} m is meant to be set"
        return PreflightCheck("tool", True, said)
    away = float(np.abs(state.tcp_offset - asked.tcp).max())
    finding = f"the point set is {1e3 * away:.3g} mm from the one asked for"
    # The arm is held to the design's point; the controller will watch its own.
    fits = away <= _TCP
    return PreflightCheck("tool", fits, finding if fits else f"{finding} (--tool X,Y,Z)")


def _approach(approach: Approach) -> PreflightCheck:
    finding = approach.describe()
    if approach.refused is not None:
        start = [round(float(value), 3) for value in approach.poses[-1]]
        finding += f", {_broken(approach.refused)}: jog the robot closer to {start}"
    return PreflightCheck("way to the start", approach.free, finding)


def _broken(certificate: Certificate) -> str:
    found: list[str] = []
    for kind in certificate.broken:
        item = certificate.worst[kind]
        place = f" ({item.what})" if item.what else ""
        free = "" if item.distance else f" less {100 * item.required:g} %"
        found.append(
            f"{kind.replace('_', ' ')}{place}: {item.value:.4g} at {item.t:.3g} s, "
            f"limit {item.limit:.4g}{free}"
        )
    return "; ".join(found)
