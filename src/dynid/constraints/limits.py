"""How much of every limit a motion uses: joints, speeds of points, momentum."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynid.constraints.arm import ArmGeometry, arm_geometry, place_joints, place_point, samples_of
from dynid.constraints.scene import ConstraintSettings
from dynid.core import Array, Indices, Mask, MotionBounds, compiled, plain, read_only
from dynid.robot import STANDARD_GRAVITY, UNLIMITED, RobotModel


@dataclass(frozen=True, slots=True, kw_only=True)
class MovingPoints:
    """Points on links whose weighted velocities are summed.

    One point of weight 1 gives its velocity; the centres of mass, weighted with the masses,
    give the momentum.
    """

    arm: ArmGeometry
    link: Indices
    """(M) the link of each point."""
    points: Array
    """(M, 3) in the links' joint frames [m]."""
    weights: Array
    """(M)"""

    def norms(self, q: Array, dq: Array) -> Array:
        """Length (N) of the sum at q, dq (N, n) [m/s or kg.m/s]."""
        found = np.empty((1, len(q)))
        _speeds([self], np.array([-1.0]), q, dq, found, np.zeros((2, 1, 1)))
        return found[0]

    def reach(self, travel: Array) -> Array:
        """(n) bounds of |d sum / d dq_k|; see `ArmGeometry.reach`."""
        total = np.zeros(self.arm.count)
        for link, point, weight in zip(self.link, self.points, self.weights, strict=True):
            total += abs(float(weight)) * self.arm.reach(int(link), point, travel)
        return total


def speed_violation(
    held: Sequence[tuple[MovingPoints, float]], q: Array, dq: Array, share: float
) -> tuple[float, Array, Array]:
    """Sum over limits and samples of (length / limit - 1)^2 where that is positive.

    Of points of one arm, each sum with its limit, at q and dq (N, n), for a share of every limit;
    with the derivatives (N, n) by q and dq.
    """
    limits = share * np.array([limit for _, limit in held])
    slopes = np.zeros((2, *q.shape))
    found = np.empty((len(held), len(q)))
    total = _speeds([points for points, _ in held], limits, q, dq, found, slopes)
    return total, slopes[0], slopes[1]


def _speeds(
    sums: Sequence[MovingPoints], limits: Array, q: Array, dq: Array, found: Array, slopes: Array
) -> float:
    arm = sums[0].arm
    return float(
        _norms(
            arm.joints,
            arm.prismatic,
            np.concatenate([points.link for points in sums]),
            np.concatenate([points.points for points in sums]),
            np.concatenate([points.weights for points in sums]),
            np.cumsum([0, *(len(points.link) for points in sums)]),
            limits,
            samples_of(q),
            samples_of(dq),
            found,
            slopes,
        )
    )


@compiled(error_model="numpy")
def _norms(
    joints: Array,
    prismatic: Indices,
    link: Indices,
    points: Array,
    weights: Array,
    ends: Indices,
    limits: Array,
    q: Array,
    dq: Array,
    found: Array,
    slopes: Array,
) -> float:
    """Write the lengths of sums (G, N) of points ends[g] to ends[g + 1]; add the slopes."""
    n = q.shape[1]
    turn, origin, axis = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty((n, 3))
    column, before = np.empty((n, len(link), 3)), np.empty((n + 1, len(link), 3))
    place, spin, whole = np.empty(3), np.empty((n + 1, 3)), np.empty(3)
    total = 0.0
    for k in range(len(q)):
        place_joints(joints, q[k], turn, origin, axis)
        spin[0] = 0.0
        for i in range(n):
            turns = 0.0 if prismatic[i] else dq[k, i]
            for r in range(3):
                spin[i + 1, r] = spin[i, r] + turns * axis[i, r]
        for m in range(len(link)):
            place_point(turn[link[m]], origin[link[m]], points[m], place)
            before[0, m, 0] = before[0, m, 1] = before[0, m, 2] = 0.0
            for i in range(link[m]):
                if prismatic[i]:
                    for r in range(3):
                        column[i, m, r] = axis[i, r]
                else:
                    x = place[0] - origin[i + 1, 0]
                    y = place[1] - origin[i + 1, 1]
                    z = place[2] - origin[i + 1, 2]
                    column[i, m, 0] = axis[i, 1] * z - axis[i, 2] * y
                    column[i, m, 1] = axis[i, 2] * x - axis[i, 0] * z
                    column[i, m, 2] = axis[i, 0] * y - axis[i, 1] * x
                for r in range(3):
                    before[i + 1, m, r] = before[i, m, r] + dq[k, i] * column[i, m, r]
        for g in range(len(limits)):
            limit = limits[g]
            whole[0] = whole[1] = whole[2] = 0.0
            for m in range(ends[g], ends[g + 1]):
                for r in range(3):
                    whole[r] += weights[m] * before[link[m], m, r]
            size = math.sqrt(whole[0] ** 2 + whole[1] ** 2 + whole[2] ** 2)
            found[g, k] = size
            if limit <= 0.0 or size <= limit:
                continue
            over = size / limit - 1.0
            total += over * over
            scale = 2.0 * over / limit / size
            for m in range(ends[g], ends[g + 1]):
                by = scale * weights[m]
                speed = before[link[m], m]
                for i in range(link[m]):
                    c = column[i, m]
                    # The column turns with the joints before it; those after it turn with joint i.
                    d0 = spin[i, 1] * c[2] - spin[i, 2] * c[1]
                    d1 = spin[i, 2] * c[0] - spin[i, 0] * c[2]
                    d2 = spin[i, 0] * c[1] - spin[i, 1] * c[0]
                    if not prismatic[i]:
                        v0 = speed[0] - before[i, m, 0]
                        v1 = speed[1] - before[i, m, 1]
                        v2 = speed[2] - before[i, m, 2]
                        d0 += axis[i, 1] * v2 - axis[i, 2] * v1
                        d1 += axis[i, 2] * v0 - axis[i, 0] * v2
                        d2 += axis[i, 0] * v1 - axis[i, 1] * v0
                    slopes[0, k, i] += by * (whole[0] * d0 + whole[1] * d1 + whole[2] * d2)
                    slopes[1, k, i] += by * (whole[0] * c[0] + whole[1] * c[1] + whole[2] * c[2])
    return total


@dataclass(frozen=True, slots=True, kw_only=True)
class Unjudged:
    """Something asked for that could not be judged."""

    kind: str
    """One of `RATIOS` or `DISTANCES`."""
    causes: tuple[str, ...]
    """What is missing; notes of the certificate may be among them."""
    next_step: str
    """What to give."""

    @property
    def message(self) -> str:
        """What is missing, in one line."""
        return "; ".join(self.causes)

    def to_json(self) -> dict[str, Any]:
        """The form that `--json` prints."""
        said = {"kind": self.kind, "message": self.message, "causes": list(self.causes)}
        return said | {"next_step": self.next_step}


def judged_points(
    robot: RobotModel, settings: ConstraintSettings, unjudged: list[Unjudged]
) -> dict[str, tuple[MovingPoints, float]]:
    """Kind to its points and the limit they are held to [m/s or kg.m/s], where one is known."""
    arm, safety = arm_geometry(robot), robot.safety
    found: dict[str, tuple[MovingPoints, float]] = {}

    def hold(kind: str, links: list[int], points: Array, weights: Array, limit: float) -> None:
        moving = MovingPoints(
            arm=arm,
            link=np.array(links, dtype=np.intp),
            points=read_only(np.array(points)),
            weights=read_only(np.array(weights)),
        )
        found[kind] = moving, (1.0 - settings.margin) * limit

    if settings.tcp_speed and not math.isnan(safety.tcp_speed):
        tool = robot.flange[:3, :3] @ robot.tool.tcp + robot.flange[:3, 3]
        hold("tcp_speed", [robot.joints], tool[None], np.ones(1), safety.tcp_speed)
    if settings.elbow_speed and not math.isnan(safety.elbow_speed) and safety.elbow:
        place = robot.parameter_frames["urdf"][safety.elbow - 1, :3, 3]
        hold("elbow_speed", [safety.elbow], place[None], np.ones(1), safety.elbow_speed)
    if settings.momentum and not math.isnan(safety.momentum):
        known = robot.inertias[:, :4]
        if np.isnan(known).any():
            unjudged.append(unknown_masses("momentum"))
            return found
        heavy = np.flatnonzero(known[:, 0] > 0)
        if len(heavy):
            centres, masses = known[heavy, 1:] / known[heavy, :1], known[heavy, 0]
            hold("momentum", (heavy + 1).tolist(), centres, masses, safety.momentum)
    return found


def unknown_masses(kind: str) -> Unjudged:
    """That a kind needs masses which the robot does not give."""
    return Unjudged(
        kind=kind,
        causes=("a mass or centre of mass is unknown",),
        next_step="Give [inertia] in a robot file.",
    )


RATIOS = (
    "position", "velocity", "acceleration", "torque",
    "tcp_speed", "elbow_speed", "momentum", "power",
)  # fmt: skip
"""Kinds whose margin is the share of the limit that is left."""
DISTANCES = ("self_collision", "environment")
"""Kinds whose margin is a signed distance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Worst:
    """Where a limit is nearest to being broken."""

    margin: float
    """Share of the limit that is left, or signed distance [m]; NaN where not judged."""
    t: float | None = None
    """When [s], or the sample's number where no times are known."""
    what: str = ""
    """The joint or the two bodies."""
    value: float = math.nan
    """The quantity itself [SI]."""
    limit: float = math.nan
    """Its limit [SI]."""
    required: float = 0.0
    """What the margin must not fall below: the clearance of a distance [m], else a share."""
    distance: bool = False
    """Whether it is a distance, which must not fall below its limit."""

    @property
    def room(self) -> float:
        """The margin less what it must be; infinite if not judged."""
        return math.inf if math.isnan(self.margin) else self.margin - self.required

    def to_json(self) -> dict[str, Any]:
        """The form that `--json` prints."""
        key = "bodies" if self.distance else "joint"
        return {
            "t": self.t,
            **({key: self.what} if self.what else {}),
            "value": plain(self.value),
            "limit": plain(self.limit),
            "required": self.required,
        }


def left_over(ratio: float, free: float) -> float:
    """The share left of a limit of which `free` is kept free, where `ratio` of the rest is used."""
    return 1.0 - (1.0 - free) * ratio


def bound_ratios(bounds: MotionBounds, q: Array, dq: Array, ddq: Array) -> tuple[Array, ...]:
    """What each bound is used, three (N, n) arrays; 1 is the bound.

    Positions count from the middle of their range; a bound that is infinite is used 0.
    """
    middle, half = _range(bounds)
    return (
        np.abs(q - middle) / half,
        np.abs(dq) / bounds.velocity,
        np.abs(ddq) / bounds.acceleration,
    )


def bound_violation(
    bounds: MotionBounds, q: Array, dq: Array, ddq: Array, share: float
) -> tuple[float, Array, Array, Array]:
    """Sum of squared excesses over `share` of each bound, and its derivatives (N, n)."""
    middle, half = _range(bounds)
    total = 0.0
    slopes: list[Array] = []
    for value, limit in (
        (q - middle, share * half),
        (dq, share * bounds.velocity),
        (ddq, share * bounds.acceleration),
    ):
        over = np.abs(value) / limit - 1.0
        if not (over > 0).any():
            slopes.append(np.zeros_like(over))
            continue
        over = np.maximum(over, 0.0)
        total += float(np.vdot(over, over))
        slopes.append(2.0 * over * np.sign(value) / limit)
    return total, slopes[0], slopes[1], slopes[2]


def bound_notes(robot: RobotModel, bounds: MotionBounds, unjudged: list[Unjudged]) -> list[str]:
    """What was assumed of the bounds, in words; what is unknown does not bind and is `unjudged`."""
    free = np.isinf(bounds.velocity)
    if free.any():
        unjudged.append(unknown_limit(robot, "velocity", free))
    unknown = np.isnan(robot.limits.lower) | np.isnan(robot.limits.upper)
    taken = unknown & np.isfinite(bounds.lower) & np.isfinite(bounds.upper)
    if not taken.any():
        return []
    low, high = float(bounds.lower[taken].min()), float(bounds.upper[taken].max())
    names = _joints(robot, taken)
    slides = taken & np.array(robot.prismatic)
    if slides.any():
        # A turn either way is a guess for what turns alone.
        unjudged.append(unknown_limit(robot, "position", slides))
    return [f"no position limits are known of {names}: taken as {low:.4g} to {high:.4g}"]


def acceleration_notes(
    robot: RobotModel, bounds: MotionBounds, torque: Mask, unjudged: list[Unjudged]
) -> list[str]:
    """How accelerations without a limit of their own are held: by the torque limits, or not.

    `torque` (n) says whether a joint's torque is judged; `unjudged` is told of joints where nothing
    limits the acceleration.
    """
    free = np.isinf(bounds.acceleration)
    if (free & ~torque).any():
        unjudged.append(unknown_limit(robot, "acceleration", free & ~torque))
    if not (free & torque).any():
        return []
    names = _joints(robot, free & torque)
    return [f"no acceleration limit is known of {names}: only the torque limits hold there"]


def unknown_limit(robot: RobotModel, kind: str, which: Mask) -> Unjudged:
    """That the robot gives no limit of a kind for some joints."""
    keys = "lower, upper" if kind == "position" else kind
    return Unjudged(
        kind=kind,
        causes=(f"no {kind} limit is known of {_joints(robot, which)}",),
        next_step=f"Give [limits] {keys} in a robot file.",
    )


MOST_TURNS = 4.0
"""No joint with cables through it makes more, to either side."""
FASTEST = 30.0
"""[rad/s or m/s] Faster than the joints of any arm that carries its own weight."""
LONGEST = 20.0
"""[m] Longer than any arm with serial joints, and than the way of one that slides."""
DENSEST = 1000.0
"""[kg/m^3] Mass over the cube of the length: five times that of any arm."""
THINNEST = 0.01
"""Size of a link's bodies over the arm's length: a fifth of that of the smallest wrist."""
WEIGHTLESS = 0.02
"""Weight times length over the largest torque limit: a quarter of that of any arm."""
LIGHTEST = 100.0
"""[kg] A mass below this is no doubt, however short the arm."""


def doubted_units(robot: RobotModel) -> list[Unjudged]:
    """What in a robot's description is probably not in SI units: a limit that does not hold."""
    limits, turning = robot.limits, ~np.array(robot.prismatic)
    reach = arm_geometry(robot).length
    mass = float(np.nansum(robot.inertias[:, 0]))
    strongest = float(limits.torque.max(initial=0.0, where=turning & (limits.torque < UNLIMITED)))
    found: list[Unjudged] = []

    def doubt(kind: str, cause: str, unit: str) -> None:
        step = f"Give it in {unit} in the robot file or URDF."
        found.append(Unjudged(kind=kind, causes=(cause,), next_step=step))

    position = np.fmax(np.abs(limits.lower), np.abs(limits.upper))
    for kind, unit, values, which, most, given in (
        ("position", "rad", position, turning, MOST_TURNS * 2 * math.pi, "degrees"),
        ("position", "m", position, ~turning, LONGEST, "millimetres"),
        ("velocity", "rad/s", limits.velocity, turning, FASTEST, "degrees a second"),
        ("velocity", "m/s", limits.velocity, ~turning, FASTEST, "millimetres a second"),
    ):
        # A comparison with an unknown limit (NaN) is false.
        joints = np.flatnonzero((values > most) & np.isfinite(values) & which).tolist()
        if joints:
            names = ", ".join(str(j + 1) for j in joints)
            reached = f"reach {values[joints].max():.4g} {unit}, and look like {given}"
            doubt(kind, f"the {kind} limits of joint {names} {reached}", unit)
    if reach > LONGEST:
        said = f"the arm is {reach:.4g} m long: its lengths look like millimetres"
        doubt("self_collision", said, "m")
    elif mass > max(DENSEST * reach**3, LIGHTEST) and turning.all():
        said = f"the arm of {reach:.3g} m has {mass:.4g} kg: its masses look like grams"
        doubt("torque", said, "kg")
    elif 0 < STANDARD_GRAVITY * mass * reach < WEIGHTLESS * strongest:
        said = f"the arm of {reach:.3g} m has {mass:.3g} kg and torques of {strongest:.4g} N.m"
        doubt("torque", f"{said}: its masses or limits look like placeholders", "kg")
    size = np.full(robot.joints + 1, -math.inf)
    for body in robot.bodies:
        extent = float(np.ptp(body.points, axis=0).max()) + 2 * body.radius
        size[body.link] = max(size[body.link], extent)
    small = (size[1:] >= 0) & (size[1:] < THINNEST * reach)
    if small.any():
        widest = 1000 * size[1:][small].max()
        said = f"the shapes of what {_joints(robot, small)} moves are {widest:.2g} mm large"
        for kind in ("self_collision", "environment"):
            doubt(kind, f"{said}: their scale looks wrong", "m")
    return found


def _joints(robot: RobotModel, which: Mask) -> str:
    if which.all():
        return "any joint"
    return ", ".join(name for name, one in zip(robot.joint_names, which, strict=True) if one)


def _range(bounds: MotionBounds) -> tuple[Array, Array]:
    lower, upper = bounds.lower, bounds.upper
    middle = np.add(lower, upper, where=np.isfinite(upper), out=np.zeros(len(upper))) / 2
    return middle, (upper - lower) / 2
