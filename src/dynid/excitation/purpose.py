"""What a model is for, as numbers: the second moment of the regressor on the purpose's motions.

The expected torque error of an estimate with covariance C on motions whose regressor rows of
joint j are Y_j is the root of tr(C M_j), M_j = mean Y_j' Y_j: no recording is needed to know what
a design is worth.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.constraints import MotionConstraints, prior_dynamics
from dynid.core import Array, InputError, Value
from dynid.excitation.criteria import AOptimal, inverse
from dynid.excitation.evaluation import DesignEvaluation, ExcitationProblem
from dynid.excitation.region import free_poses, grown_motion, region_of, tightest
from dynid.reduction import BaseParametrization
from dynid.robot import RobotModel, joints_by_kind
from dynid.trajectory import JointMotion, motion_family

NOISE_SHARE = 0.014
"""Noise of a joint's torque over its limit where none is given: that of current-sensed arms (UR5:
2, 2.5, 1.5, 0.4, 0.4, 0.3 N.m)."""
LIMIT_OVER_TORQUE = 4.0
"""Torque limit over the RMS torque of rigid links on safe motions, where no limit tells: 2.3 to 6
for the most loaded joint of seven arms, over whose RMS torque wrists have limits of 0.4 to 1.4."""
MOTIONS = 24
"""Random motions that stand for the whole workspace."""
ANYWHERE = "safe random motions of the whole workspace"
RATE_HZ = 25.0
"""At which they are sampled."""
_NO_ERROR = 1e-300
CONFIDENCE = 1.645
"""Of the upper bound of the error, one-sided 95 %, as a normal quantile."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Purpose:
    """The motions that a model is for."""

    source: str
    """Where the motions come from, in words."""
    moments: Array
    """(n, b, b) mean of Y_j' Y_j over their samples."""
    torque: Array
    """(n) RMS torque that the prior expects there [N.m or N]; NaN where no prior is known."""
    prismatic: tuple[bool, ...]
    """(n) whether a joint slides."""

    def moment(self, noise: Array) -> Array:
        """(b, b) of the criterion: the mean over the joints of M_j over the variance (n)."""
        return np.asarray(np.tensordot(1 / np.square(noise), self.moments, axes=1) / len(noise))


@dataclass(frozen=True, slots=True, kw_only=True)
class Expected(Value):
    """What an identification from a design is expected to know, for the robot's torque noise."""

    noise: Array
    """(n) standard deviation of each joint's torque [N.m or N]."""
    torque_error: Array
    """(n) RMS error of the predicted torque on the purpose's motions [N.m or N]."""
    torque_error_percent: float
    """All joints together, over the RMS torque that the prior expects; NaN without a prior.

    Of an arm that turns and slides, of the kind of joints that errs more.
    """
    bound_percent: float
    """What it stays below with 95 % probability."""
    parameter_std: Array
    """(b) standard deviations of the base parameters, SI units."""

    @property
    def largest_parameter_std(self) -> float:
        """The worst of them."""
        return float(self.parameter_std.max())


def assumed_noise(robot: RobotModel, torque: Array | None = None) -> Array:
    """(n) torque noise of a robot of which none is known; 1 where nothing tells a joint's size.

    Where no torque limit does, the RMS torques (n) do that are expected of it [N.m or N].
    """
    size = robot.limits.rated_torque
    if torque is not None:
        typical = np.maximum(LIMIT_OVER_TORQUE * torque, torque.max())
        size = np.where(np.isfinite(size), size, typical)
    noise = NOISE_SHARE * size
    return np.where(np.isfinite(noise) & (noise > 0), noise, 1.0)


def purpose_of(base: BaseParametrization, motions: Sequence[JointMotion], source: str) -> Purpose:
    """The purpose that motions stand for; each counts alike, however long it is.

    Where they come from is given in words.

    Raises:
        InputError: Motions of another robot.
    """
    robot, n = base.model.robot, base.model.robot.joints
    # Friction is assumed as a share of rated torques.
    robot = replace(robot, limits=replace(robot.limits, torque=robot.limits.rated_torque))
    moments, squares = np.zeros((n, base.rank, base.rank)), np.zeros(n)
    prior = prior_dynamics(robot)
    for motion in motions:
        stack = base.model.stack(motion.q, motion.dq, motion.ddq)[list(base.independent)]
        rows = stack.transpose(1, 0, 2)
        moments += rows @ rows.transpose(0, 2, 1) / (len(motion.q) * len(motions))
        if prior is not None:
            torque = prior.torque(motion.q, motion.dq, motion.ddq)
            torque = torque + prior.coulomb * np.sign(motion.dq)
            squares += np.square(torque).mean(axis=0) / len(motions)
    torque = np.full(n, math.nan) if prior is None else np.sqrt(squares)
    return Purpose(source=source, moments=moments, torque=torque, prismatic=tuple(robot.prismatic))


def safe_motions(
    base: BaseParametrization, constraints: MotionConstraints, *, seed: int = 0
) -> list[JointMotion]:
    """Random motions about free poses of the whole workspace that keep the constraints.

    Raises:
        InputError: No motion was found that keeps the limits.
    """
    problem = ExcitationProblem(
        base=base,
        criterion=AOptimal(),
        family=motion_family("fourier", 10.0, 5),
        constraints=constraints,
    )
    evaluation, region = DesignEvaluation(problem), region_of(problem)
    random = np.random.default_rng([seed, 1])
    poses = free_poses(evaluation.constraints, region, random)
    times = np.arange(0.0, problem.family.duration, 1 / RATE_HZ)
    found: list[JointMotion] = []
    for _ in range(MOTIONS if len(poses) else 0):
        pose = poses[random.integers(len(poses))]
        x = grown_motion(evaluation, region, pose, random, fill=0.9)
        if x is not None:
            found.append(problem.family.trajectory(x[:, 0], x[:, 1:]).evaluate(times))
    if not found:
        what = "no motion was found that keeps the limits"
        if len(poses):
            raise tightest(constraints, poses[0], f"{what}, not even a small one")
        doubts = [f"Unjudged: {item.message}." for item in constraints.unjudged]
        raise InputError(what, next_step=" ".join(["Check the scene and the limits.", *doubts]))
    return found


def without_friction(gram: Array, base: BaseParametrization) -> Array:
    """The information of a Gram matrix (b, b) where its friction is not that of other records.

    Friction of another day is another: it is estimated beside the parameters that last, which keep
    the Schur complement; nothing is known of the new friction.
    """
    names = base.model.names
    own = np.array([names[c][0] == "F" for c in base.independent])
    out = np.zeros_like(gram)
    across = gram[np.ix_(~own, own)]
    inner = np.linalg.pinv(gram[np.ix_(own, own)], hermitian=True)
    out[np.ix_(~own, ~own)] = gram[np.ix_(~own, ~own)] - across @ inner @ across.T
    return (out + out.T) / 2


def expected(
    gram: Array, purpose: Purpose, noise: Array, previous: Array | None = None
) -> Expected:
    """What an identification is worth, by the Gram matrix (b, b) of rows over the noise.

    Args:
        gram: Of all that will be recorded.
        purpose: What the model is for.
        noise: (n) that the rows are divided by [N.m or N].
        previous: (b, b) of what is recorded already.
    """
    found = inverse(gram if previous is None else gram + previous)
    size = len(gram)
    covariance = np.full((size, size), math.inf) if found is None else found[0]
    if found is None:
        variances, percent, bound = np.full(len(noise), math.inf), math.inf, math.inf
    else:
        variances = np.einsum("ij,kij->k", covariance, purpose.moments)
        told: list[tuple[float, float]] = []
        for joints in joints_by_kind(purpose.prismatic).values():
            if not purpose.torque[joints].any():
                # No motion of the purpose moves or loads them.
                continue
            share = math.sqrt(variances[joints].sum() / np.square(purpose.torque[joints]).sum())
            # The squared error is a sum of chi-squares: as many as share it (Satterthwaite), whose
            # quantile is Wilson and Hilferty's.
            image = covariance @ purpose.moments[joints].sum(axis=0)
            sizes = float((image * image.T).sum()), max(float(np.trace(image)), _NO_ERROR)
            # Between one and all of them share it: rounding may say otherwise.
            spread = 2 / 9 * min(max(sizes[0] / sizes[1] ** 2, 1 / size), 1.0)
            most = (1 - spread + CONFIDENCE * math.sqrt(spread)) ** 1.5
            told.append((100 * share, 100 * share * most))
        told = told or [(math.nan, math.nan)]
        percent, bound = (float(max(each)) for each in zip(*told, strict=True))
    return Expected(
        noise=noise,
        torque_error=np.sqrt(variances),
        torque_error_percent=percent,
        bound_percent=bound,
        parameter_std=np.sqrt(np.diag(covariance)),
    )
