"""Gravity parameters, and what friction holds, from poses at rest.

Without motion the torques are those of gravity, plus any torque within the band that friction
can hold. A prior on the published inertias bears what the poses do not show.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dynid import reduction, regressor, signals
from dynid.core import Array, Finding, InputError, Mask, Value, freeze, frozen, table, told
from dynid.identification import bayesian, least_squares
from dynid.identification.problem import IdentificationProblem, base_mapping, joint_factors
from dynid.recording import ExperimentRecord, RecordLike, are_poses, open_record
from dynid.robot import RobotLike, RobotModel, load_robot, with_carried

STILL_HZ = 1.0
"""Rate and cut-off that samples without time are given."""
BAND_SHARE = 0.95
"""Share of the poses whose residuals lie within the band."""
FROM_PRIOR = 0.7
"""Standard deviation over the prior's from which the poses show little of a parameter."""
LEAST_SPREAD = 1e-6
"""Of the prior in any direction, over its largest."""


STILL = 2e-3
"""Displacement within twice `BESIDE_S` below which a joint rests [rad or m]."""
BESIDE_S = 0.15
STOP_S = 0.3
"""Shortest stop whose mean is a pose [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GravityEstimate(Value):
    """Gravity parameters of a robot with their uncertainty, from poses at rest.

    Raises:
        InputError: Shapes that disagree.
    """

    base: reduction.BaseParametrization
    """The model without motion: its base parameters are those of gravity."""
    values: Array
    """(r) base parameters."""
    covariance: Array
    """(r, r) of the values."""
    prior_std: Array
    """(r) standard deviations of the same parameters before any pose was measured."""
    poses: int
    """Number of poses."""
    left_out: Array
    """(n) RMS errors at each pose of the parameters of all others [N.m or N]."""
    published: Array | None
    """(n) RMS errors of the published masses and centres; None where links have none."""
    band: Array
    """(n) half-width that holds 95 % of those errors: what friction may hold [N.m or N]."""
    band_std: Array
    """(n) its standard deviation."""
    warnings: tuple[Finding, ...] = ()
    """Joints whose torques are not those of published inertias at rest."""

    def __post_init__(self) -> None:
        r, n = self.base.rank, self.base.model.robot.joints
        freeze(self, values=(r,), covariance=(r, r), prior_std=(r,))
        freeze(self, left_out=(n,), band=(n,), band_std=(n,))

    @property
    def std(self) -> Array:
        """(r) standard deviations of the values."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def unseen(self) -> tuple[str, ...]:
        """Standard parameters that no torque at rest depends on."""
        names = self.base.model.names
        return tuple(names[k] for k in self.base.classes.unidentifiable)

    @property
    def from_prior(self) -> tuple[bool, ...]:
        """(r) whether these poses say little of a parameter beside the published inertias."""
        return tuple((self.std > FROM_PRIOR * self.prior_std).tolist())

    def predict(self, q: ArrayLike) -> Array:
        """Torques (N, n) of gravity [N.m or N] at positions q (N, n) [rad or m].

        Raises:
            InputError: Not numbers, or a shape that does not fit the robot.
        """
        model = self.base.model
        q = frozen(q, shape=(None, model.robot.joints), name="q", finite=False)
        still, values = np.zeros_like(q), self.base.to_standard(self.values)
        return model.inverse_dynamics(q, still, still, values) - model.known_torque(q)

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        model = self.base.model
        parameters = self.base.to_standard(self.values)
        links = parameters[: 10 * model.robot.joints].reshape(-1, 10)[:, :4]
        return {
            "robot": model.robot.name,
            "frames": model.frames,
            "poses": self.poses,
            "parameters": table(
                name=self.base.names,
                expression=self.base.expressions,
                unit=self.base.units,
                value=self.values,
                std=self.std,
                from_prior=self.from_prior,
            ),
            "links": table(m=links[:, 0], mx=links[:, 1], my=links[:, 2], mz=links[:, 3]),
            "left_out_rms": self.left_out.tolist(),
            "published_rms": None if self.published is None else self.published.tolist(),
            "stiction_band": self.band.tolist(),
            "stiction_band_std": self.band_std.tolist(),
            "unseen": list(self.unseen),
            **told(self.warnings),
        }


def identify_gravity(record: RecordLike, robot: RobotLike, *, frames: str = "") -> GravityEstimate:
    """Gravity parameters, and what friction may hold, of an arm at rest.

    Each row is a pose where rows are unrelated; of a motion, each stop of all joints is one. What
    friction holds has a mean only if poses are approached from both sides.

    Args:
        record: The recording or its file.
        robot: The robot, or its name or file.
        frames: Parameter frames; the default is the robot's own.

    Raises:
        InputError: A recording without poses at rest, without torques, or of another robot.
    """
    robot = with_carried(load_robot(robot, collision=False))
    record = open_record(record, robot)
    torque, q = signals.measured_torque(record, robot), record.signals["q"]
    if not are_poses(q):
        q, torque = _stops(record, torque)
    return gravity_of(robot, q, torque, frames=frames)


def _stops(record: ExperimentRecord, torque: Array) -> tuple[Array, Array]:
    """Mean positions and torques (P, n) of the times at which all joints rest."""
    q = record.signals["q"]
    beside = max(round(BESIDE_S * record.rate_hz), 1)
    still: Mask = np.zeros(len(q) + 2, dtype=np.bool_)
    moved = np.abs(q[2 * beside :] - q[: -2 * beside]).max(axis=1, initial=0.0)
    still[1 + beside : 1 + beside + len(moved)] = moved < STILL
    edges = np.flatnonzero(still[1:] != still[:-1]).reshape(-1, 2)
    long = [slice(a, b) for a, b in edges if b - a >= STOP_S * record.rate_hz]
    if len(long) < 2:
        raise InputError(
            "the recording has no poses at rest",
            where=record.metadata.origin or None,
            value=len(long),
            limit=f"2 stops of {STOP_S + 2 * BESIDE_S:g} s at least",
            next_step="Let the arm rest for a second at many poses, or give a row a pose.",
        )
    means = [(q[part].mean(axis=0), torque[part].mean(axis=0)) for part in long]
    places, efforts = zip(*means, strict=True)
    return np.array(places), np.array(efforts)


def gravity_of(robot: RobotModel, q: Array, torque: Array, *, frames: str = "") -> GravityEstimate:
    """The gravity parameters that torques at rest show.

    Joints are weighted by their own scatter, which is friction and noise. The prior is that of
    published inertias and their spread (`deviations`), of plausible bodies where there are none,
    with a spread as large as the torques make likely.

    Args:
        robot: The robot.
        q: (P, n) positions at rest [rad or m].
        torque: (P, n) torques there [N.m or N].
        frames: Parameter frames; the default is the robot's own.

    Raises:
        InputError: Too few poses, or shapes that do not fit.
    """
    model = regressor.InverseDynamicModel(robot=robot, frames=frames)
    base = reduction.reduce_model(model, static=True)
    still = np.zeros_like(q)
    samples = signals.Samples(
        t=np.arange(len(q)) / STILL_HZ, q=q, dq=still, ddq=still, tau=torque,
        rate_hz=STILL_HZ, cutoff_hz=STILL_HZ,
    )  # fmt: skip
    problem = IdentificationProblem(base=base, samples=samples)
    inertial, mapping = 10 * robot.joints, base_mapping(base)
    mean = mapping[:, :inertial] @ bayesian.inertial_prior(robot, model.frames).parameters.ravel()
    spread = mapping[:, :inertial] @ bayesian.deviations(robot, model.frames)
    turn, sizes, _ = np.linalg.svd(spread, full_matrices=False)
    sizes = np.maximum(sizes, LEAST_SPREAD * sizes[0])
    root = turn.T / sizes[:, None]
    factors, scales = joint_factors(problem), [1.0]

    def solved(weights: Array) -> tuple[Array, Array]:
        if not robot.published.any():
            scales.append(bayesian.likely_scale(factors, weights, mean, root))
        return bayesian.posterior(factors, weights, base, mean, root / scales[-1])

    fit = least_squares.reweighted(problem, factors, None, solved)
    inverse = np.linalg.inv(fit.information)
    covariance = inverse @ inverse.T
    columns = model.stack(q, still, still)[list(base.independent)].transpose(2, 1, 0)
    left = torque + model.known_torque(q) - columns @ fit.values
    # Leaving a pose out changes its own residuals by the share that it has in the fit.
    share = columns @ covariance @ (columns * np.square(fit.weights)[:, None]).transpose(0, 2, 1)
    others = np.asarray(np.linalg.inv(np.eye(robot.joints) - share), dtype=np.float64)
    errors = np.einsum("pij,pj->pi", others, left)
    expected = columns @ mean - model.known_torque(q)
    given = torque - expected
    band, band_std = _band(errors)
    return GravityEstimate(
        base=base,
        values=fit.values,
        covariance=covariance,
        prior_std=scales[-1] * np.linalg.norm(turn * sizes, axis=1),
        poses=len(q),
        left_out=_rms(errors),
        published=_rms(given) if robot.published.all() else None,
        band=band,
        band_std=band_std,
        warnings=tuple(_doubts(torque, expected)) if robot.published.all() else (),
    )


def _doubts(torque: Array, expected: Array) -> Iterator[Finding]:
    """Torques (P, n) that are nearer to the negative of what is expected, or to none of it."""
    ways = np.array([_rms(torque - expected), _rms(torque + expected), _rms(torque)])
    nearest = np.where(ways.min(axis=0) < ways[0] / 2, ways.argmin(axis=0), 0)
    for way, kind, what, step in (
        (1, "reversed", "are nearer to their negative", "check the signs of torque and position"),
        (2, "gravity_compensated", "contain no gravity", "record the whole torque"),
    ):
        joints = tuple(np.flatnonzero(nearest == way).tolist())
        if joints:
            which = " ".join(str(j + 1) for j in joints)
            text = f"beside those of published inertias, torques of joint {which} {what}"
            yield Finding(kind, text, joints=joints, next_step=step)


def _rms(errors: Array) -> Array:
    return np.sqrt(np.square(errors).mean(axis=0))


def _band(errors: Array) -> tuple[Array, Array]:
    """(n) half-width that holds `BAND_SHARE` of errors (P, n), and its standard deviation."""
    size, beside = np.abs(errors), np.sqrt(BAND_SHARE * (1 - BAND_SHARE) / len(errors))
    shares = [BAND_SHARE - beside, BAND_SHARE, min(BAND_SHARE + beside, 1.0)]
    # The k-th of P errors holds k / (P + 1) of those to come, whatever their distribution.
    low, middle, high = np.quantile(size, shares, axis=0, method="weibull")
    # Beside the largest of few errors nothing is larger: the wider side then tells.
    return middle, np.maximum(high - middle, middle - low)
