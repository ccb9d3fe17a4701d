"""The free numbers whose motion stays within bounds, random starts, and poses that are free.

The region is a polytope, with a barrier. In a tight cell hardly any random motion is free, and
descents from those that are not end in corners. Poses are far easier to find: many are tried, and
where none is free the roomiest are moved to where more room is. A random shape about a free pose is
made smaller until it is free.
"""

import math

import numpy as np

from dynid.constraints import MotionConstraints
from dynid.core import Array, InputError, MotionBounds
from dynid.excitation.evaluation import DesignEvaluation, ExcitationProblem
from dynid.trajectory import MotionFamily, require_inside

POINTS_PER_NUMBER = 16
"""Grid points for each free number of a joint; for the Fourier series, 32 a harmonic."""
SHARE = math.cos(math.pi / 32) * math.cos(math.pi / 64)
"""Of the bounds, to be met on the grid. The first factor is what a trigonometric polynomial can
rise between 32 points a harmonic (Ehlich and Zeller, 1964), the second what the certificate's
own grid of 64 adds; for other families it is a margin, and the certificate decides."""

INSIDE = 0.98
"""Of a bound, what a motion uses that is pulled inside."""


class MotionRegion:
    """Numbers x = [offset, y] (n, 1 + k) whose motion stays within the bounds on a dense grid.

    Positions, velocities and accelerations are linear in x, so the region is a polytope.

    Args:
        family: The motions.
        bounds: Bounds as of `ConstraintSettings`, without NaN; infinite ones do not bind.
        pose: (n) the offset that every motion has; None where it may be chosen.

    Raises:
        InputError: A joint without position bounds, or a pose outside.
    """

    def __init__(
        self, family: MotionFamily, bounds: MotionBounds, pose: Array | None = None
    ) -> None:
        count = POINTS_PER_NUMBER * (family.free_count + 2)
        t = np.arange(count, dtype=np.float64) * (family.duration / count)
        b0, b1, b2 = family.basis(t)
        one, zero = np.ones((count, 1)), np.zeros((count, 1))
        self.columns = (np.hstack([one, b0]), np.hstack([zero, b1]), np.hstack([zero, b2]))
        half = (bounds.upper - bounds.lower) / 2
        if not np.isfinite(half).all():
            raise InputError("no limit bounds the motion", next_step="Give position limits.")
        self.middle = middle = (bounds.lower + bounds.upper) / 2
        self.reach = (SHARE * half, SHARE * bounds.velocity, SHARE * bounds.acceleration)
        self.pose = pose
        if pose is not None:
            require_inside("start pose", pose, middle - self.reach[0], middle + self.reach[0])

    def slack(self, x: Array) -> Array:
        """(6, g, n) what is left to the upper and lower bounds of q, dq, ddq; negative outside."""
        parts: list[Array] = []
        for k, (columns, reach) in enumerate(zip(self.columns, self.reach, strict=True)):
            value = columns @ x.T
            if k == 0:
                value = value - self.middle
            parts += [reach - value, reach + value]
        return np.stack(parts)

    def barrier_value(self, slack: Array) -> float:
        """The barrier - sum log(slack); infinite outside."""
        if not (slack > 0).all():
            return math.inf
        return float(-np.log(slack[np.isfinite(slack)]).sum())

    def barrier_slopes(self, slack: Array) -> tuple[Array, Array]:
        """Gradient (n, 1 + k) and Hessian (n, 1 + k, 1 + k) of the barrier at a point inside.

        Joints do not share bounds, so the Hessian has a block a joint.
        """
        inverse = 1.0 / slack
        pull = inverse[0::2] - inverse[1::2]
        weight = np.square(inverse[0::2]) + np.square(inverse[1::2])
        width = self.columns[0].shape[1]
        gradient = np.zeros((slack.shape[2], width))
        curvature = np.zeros((slack.shape[2], width, width))
        for k, columns in enumerate(self.columns):
            gradient += pull[k].T @ columns
            curvature += (columns.T[None] * weight[k].T[:, None, :]) @ columns
        return gradient, curvature

    def longest_step(self, slack: Array, step: Array) -> float:
        """The largest factor on a step, at most 1, that keeps a hundredth of each slack."""
        use = 0.0
        for k, columns in enumerate(self.columns):
            change = columns @ step.T
            # Bounds that are not there leave infinite slack: nothing of it is used.
            use = max(use, float((change / slack[2 * k]).max()))
            use = max(use, float((-change / slack[2 * k + 1]).max()))
        return 1.0 if use <= 0.99 else 0.99 / use

    def onto_limits(self, free: Array, place: Array, fill: float = 1.0) -> Array:
        """(..., n, 1 + k) shapes scaled onto their tightest bound and put where they fit.

        Args:
            free: (..., n, k) shapes; only their directions count.
            place: (..., n) where in the room left the motion lies, 0 to 1.
            fill: The share of the largest scale, in (0, 1]; on the edge of the region at 1.
        """
        swing, dq, ddq = (free @ c[:, 1:].T for c in self.columns)
        above, below = np.maximum(swing.max(axis=-1), 0.0), np.minimum(swing.min(axis=-1), 0.0)
        if self.pose is None:
            room = _over(2 * self.reach[0], above - below)
        else:
            room = np.minimum(
                _over(self.middle + self.reach[0] - self.pose, above),
                _over(self.pose - self.middle + self.reach[0], -below),
            )
        limited = np.minimum(
            _over(self.reach[1], np.abs(dq).max(axis=-1)),
            _over(self.reach[2], np.abs(ddq).max(axis=-1)),
        )
        scale = fill * np.minimum(room, limited)
        first = self.middle - self.reach[0] - scale * below
        last = self.middle + self.reach[0] - scale * above
        offset = first + place * np.maximum(last - first, 0.0)
        if self.pose is not None:
            offset = np.broadcast_to(self.pose, offset.shape)
        return np.concatenate([offset[..., None], free * scale[..., None]], axis=-1)

    def pulled_inside(self, x: Array) -> Array:
        """The motion `x` (n, 1 + k), smaller and shifted as far as it takes to lie inside."""
        free, swing = x[:, 1:], self.columns[0][:, 1:] @ x[:, 1:].T
        largest = self.onto_limits(free, np.full(len(x), 0.5), INSIDE)[:, 1:]
        scale = np.minimum(1.0, _over(np.abs(largest).max(axis=1), np.abs(free).max(axis=1)))
        if self.pose is not None:
            offset = self.pose
        else:
            room = INSIDE * self.reach[0]
            offset = np.clip(
                x[:, 0],
                self.middle - room - scale * swing.min(axis=0),
                self.middle + room - scale * swing.max(axis=0),
            )
        return np.concatenate([offset[:, None], free * scale[:, None]], axis=1)


def region_of(problem: ExcitationProblem) -> MotionRegion:
    """The region of a problem's bounds."""
    return MotionRegion(problem.family, problem.constraints.settings.bounds, problem.start_pose)


def _over(room: Array, use: Array) -> Array:
    """`room / use`, very large where nothing is used."""
    return room / np.maximum(use, 1e-300)


def shape_basis(region: MotionRegion) -> Array:
    """(k, k) L with y = L z: independent standard normal z give velocities of one variance.

    In these coordinates no harmonic, and no spline knot, stands out before the search begins.
    """
    speed = region.columns[1][:, 1:]
    gram = speed.T @ speed / len(speed)
    # The ridge keeps numbers that hardly move the arm from being drawn very large.
    gram += 1e-6 * np.trace(gram) / len(gram) * np.eye(len(gram))
    factor = np.asarray(np.linalg.cholesky(gram), dtype=np.float64)
    return np.asarray(np.linalg.inv(factor).T, dtype=np.float64)


def random_numbers(
    region: MotionRegion, count: int, random: np.random.Generator, *, fill: float
) -> Array:
    """(count, n, 1 + k) random motions that use a share `fill` of each joint's tightest bound."""
    width = region.columns[0].shape[1]
    joints = len(region.middle)
    free = random.standard_normal((count, joints, width - 1)) @ shape_basis(region).T
    return region.onto_limits(free, random.uniform(size=(count, joints)), fill)


POSES = 20_000
"""Random poses that are tried where few are free."""
FEW = 300
"""Poses that are tried first."""
_KEPT = 3
"""Of many, those that are moved to where more room is."""
_STEPS = (0.3, 0.1, 0.03, 0.01, 0.003)
"""Spread of the steps towards more room [rad or m]."""
_TRIES = 300
"""Of each step."""
_SHRINK = 0.7
_SHRINKS = 28
_FAR = 0.1
"""Distance that counts as much as a whole torque limit [m]."""

_NEXT = {
    "self_collision": "Check the payload's size and place (metres, in the flange's frame), the"
    " bodies of the robot and --clearance.",
    "environment": "Check the scene: metres, in the robot's base frame; shapes are solid. The"
    " floor is at the mounting plane unless --floor says otherwise. Or lower --clearance.",
    "torque": "Check the torque limits, the masses and the payload; the prediction counts doubt and"
    " friction in.",
}


def check_room(constraints: MotionConstraints, region: MotionRegion) -> None:
    """Refuse limits and bodies that leave no pose free, before minutes are spent on a search.

    Raises:
        InputError: No pose was found that keeps every clearance and that the joints can hold.
    """
    best = _roomiest(constraints, region, np.random.default_rng(0))
    pose, room = max(best, key=lambda item: item[1])
    if room <= 0:
        raise tightest(constraints, pose, "no free pose of the arm was found")


def tightest(constraints: MotionConstraints, pose: Array, what: str) -> InputError:
    """The error of a pose (n) that leaves too little room: the limit that is nearest at rest."""
    still = np.zeros((1, len(pose)))
    worst = constraints.usage(pose[None], still, still)
    kind, item = min(worst.items(), key=lambda pair: pair[1].room)
    unit = " m" if item.distance else ""
    return InputError(
        f"{what}: {kind.replace('_', ' ')}",
        where=item.what,
        value=f"{item.value:.4g}{unit} at best",
        limit=f"{item.limit:.4g}{unit}",
        next_step=_NEXT.get(kind),
    )


def free_poses(
    constraints: MotionConstraints, region: MotionRegion, random: np.random.Generator
) -> Array:
    """(m, n) poses at which the arm can stand, from all of its range; none if none was found.

    Where the region has a pose, only that one is tried.
    """
    return np.array([pose for pose, room in _roomiest(constraints, region, random) if room > 0])


def grown_motion(
    evaluation: DesignEvaluation,
    region: MotionRegion,
    pose: Array,
    random: np.random.Generator,
    *,
    fill: float,
    tighten: float = 0.0,
) -> Array | None:
    """Numbers (n, 1 + k) of a random motion about a pose, as large as the limits let it be.

    The pose (n) is its mean, or its start for families that begin there. It may use the share
    `fill` of the bounds, other limits shrunk by `tighten`. None where even a tiny motion breaks a
    limit.
    """
    x = random_numbers(region, 1, random, fill=fill)[0]
    x[:, 0] = pose
    for _ in range(_SHRINKS):
        inside = bool((region.slack(x) > 0).all())
        if inside and evaluation.search_violation(x, tighten, 0.0) == 0.0:
            return x
        x[:, 1:] *= _SHRINK
    return None


def _poses(
    constraints: MotionConstraints, region: MotionRegion, random: np.random.Generator, count: int
) -> Array:
    if region.pose is not None:
        return region.pose[None]
    half = 0.99 * region.reach[0]
    turning = ~np.array(constraints.robot.prismatic)
    reach = np.where(turning, np.minimum(half, np.pi), half)
    return region.middle + random.uniform(-reach, reach, (count, len(half)))


def _roomiest(
    constraints: MotionConstraints, region: MotionRegion, random: np.random.Generator
) -> list[tuple[Array, float]]:
    """A few random poses and their room; if none is free, the best of many, moved to more room."""
    poses = _poses(constraints, region, random, FEW)
    room = _room(constraints, poses)
    if (room > 0).any():
        return list(zip(poses, room.tolist(), strict=True))
    poses = _poses(constraints, region, random, POSES)
    middle, half = region.middle, 0.99 * region.reach[0]
    room = _room(constraints, poses)
    found: list[tuple[Array, float]] = []
    for pose in poses[np.argsort(-room, kind="stable")[:_KEPT]]:
        near = pose[None]
        for spread in _STEPS if region.pose is None else ():
            step = spread * random.standard_normal((_TRIES, len(middle)))
            near = np.vstack([near[:1], np.clip(near[:1] + step, middle - half, middle + half)])
            near = near[[int(np.argmax(_room(constraints, near)))]]
        found.append((near[0], float(_room(constraints, near)[0])))
    return found


def _room(constraints: MotionConstraints, poses: Array) -> Array:
    """(N) the least of what is left of clearances and of torques at rest; negative if missed."""
    room = np.full(len(poses), 1.0)
    around = constraints.surroundings
    if around is not None:
        for pairs in around.pairs.values():
            room = np.minimum(room, around.bodies.nearest(poses, pairs).room / _FAR)
    if constraints.torque is not None:
        still = np.zeros(poses.shape)
        torque, _ = constraints.torque.largest(poses, still, still)
        share = np.nan_to_num(torque / constraints.torque.limits)
        room = np.minimum(room, 1.0 - share.max(axis=1))
    return room
