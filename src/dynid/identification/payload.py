"""The payload of a robot, from runs with and without it.

Runs without the payload pin the arm; in runs with it the columns of the last link appear once
more, for the payload alone (Khalil, Gautier, Lemoine 2007). What both runs get wrong alike is
in the arm's parameters of both, and leaves the payload alone.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynid import robot
from dynid.core import Array, Finding, Value, freeze, solve_upper, table, told, upper_triangle
from dynid.identification import bayesian
from dynid.identification.shared import PAYLOAD, UNKNOWN, SharedFit, SharedProblem

_START = 1e-3
"""Smallest eigenvalue of the first body, over the largest."""
_BARRIERS = 4.0 ** -np.arange(0, 24)
"""Weights of the barrier, over the misfit of the first body: each body starts the next."""
_NEWTON = 50
"""Most steps with one of them; a few are enough."""
_WHOLE, _STILL = 0.25, 1e-3
"""Steps that are taken whole, and last ones, as the barrier measures them: the digits double."""


def nearest_body(free: Array, covariance: Array) -> Array:
    """Minimise (p - p0)' C^-1 (p - p0) over parameters whose pseudo-inertia is not negative.

    p0 (10) is the free estimate, C (10, 10) its covariance. This is the constrained least-squares
    answer of the whole problem, with all else already eliminated. The logarithm of the determinant
    keeps bodies inside, with a weight that goes to zero (Boyd and Vandenberghe 2004, chapter 11).
    """
    values, vectors = np.linalg.eigh(robot.to_pseudo_inertia(free))
    if values[0] >= 0:
        return free.copy()
    white = np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)), dtype=np.float64)
    root = vectors * np.sqrt(np.maximum(values, _START * float(np.abs(values).max())))
    white = white / float(np.linalg.norm(white @ (_body(root) - free)))
    for weight in _BARRIERS.tolist():
        for _ in range(_NEWTON):
            root, long = _step(root, white, free, weight)
            if long < _STILL:
                break
    return _body(root)


def _body(root: Array) -> Array:
    return np.asarray(robot.from_pseudo_inertia(root @ root.T), dtype=np.float64)


def _step(root: Array, white: Array, free: Array, weight: float) -> tuple[Array, float]:
    """Newton's step of a body by a root (4, 4), and how long it was, as the barrier measures it.

    The body before the step is the unit matrix, of which the barrier bends every direction alike,
    and the step is by least squares: deviations of 1e-5 and 1e2 go together so.
    """
    slope = robot.from_pseudo_inertia(root @ bayesian.ORTHONORMAL @ root.T).T
    near = np.column_stack([white @ slope, white @ (free - _body(root))])
    bent = np.column_stack([np.eye(10), np.trace(bayesian.ORTHONORMAL, axis1=1, axis2=2)])
    upper = upper_triangle(np.vstack([near, np.sqrt(weight) * bent]))[:10]
    step = solve_upper(upper[:, :10], upper[:, 10])
    long = float(np.linalg.norm(upper[:, 10])) / np.sqrt(weight)
    # Damped so, no step leaves the bodies that can exist: the barrier is self-concordant.
    step = step / (1.0 if long < _WHOLE else 1.0 + long)
    turned = np.linalg.cholesky(np.eye(4) + np.tensordot(step, bayesian.ORTHONORMAL, axes=1))
    return root @ np.asarray(turned, dtype=np.float64), long


NORMAL_95 = 1.959964
"""Half a 95 % interval, in standard deviations."""
SWAPPED = 5.0
"""A mass so many standard deviations below zero is no chance: recordings were swapped."""
GAINS_OFF = 0.02
"""Standard deviation of a joint's drive gain, alike in all recordings (share)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Payload(Value):
    """A physically consistent payload with its uncertainty, in the flange frame.

    Raises:
        InputError: Shapes that disagree.
    """

    parameters: Array
    """(10) m, mx, my, mz, Jxx, Jyy, Jzz, Jyz, Jxz, Jxy about the flange, of the nearest body
    that can exist."""
    free: Array
    """(10) the same by least squares alone."""
    covariance: Array
    """(10, 10) of `free`, drive gains included; the body's own is no larger."""
    noise: Array
    """(R, n) residual standard deviations of the records, unloaded first [N.m or N]."""
    samples: int
    """Rows a joint, all records."""
    warnings: tuple[Finding, ...] = ()
    """Findings: a payload that is not significant, or not physical."""

    def __post_init__(self) -> None:
        freeze(self, parameters=(10,), free=(10,), covariance=(10, 10), noise=(None, None))

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        return float(self.parameters[0])

    @property
    def mass_std(self) -> float:
        """Standard deviation of the mass [kg]."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def centre(self) -> Array:
        """(3) centre of mass in the flange frame [m]."""
        return self.parameters[1:4] / max(self.mass, 1e-12)

    @property
    def centre_std(self) -> Array:
        """(3) its standard deviations [m]."""
        slope = np.zeros((3, 10))
        mass = max(self.mass, 1e-12)
        slope[:, 0] = -self.centre / mass
        slope[:, 1:4] = np.eye(3) / mass
        return np.sqrt(np.diag(slope @ self.covariance @ slope.T))

    @property
    def inertia(self) -> Array:
        """(3, 3) tensor about the centre of mass, along the flange's axes [kg.m^2]."""
        lever = self.centre
        steiner = lever @ lever * np.eye(3) - np.outer(lever, lever)
        return robot.tensor(self.parameters) - self.mass * steiner

    @property
    def std(self) -> Array:
        """(10) standard deviations of `parameters`."""
        return np.sqrt(np.diag(self.covariance))

    def to_json(self) -> dict[str, Any]:
        """A JSON object; intervals hold with 95 %."""
        half, half_centre = NORMAL_95 * self.mass_std, NORMAL_95 * self.centre_std
        centre, centre_std = self.centre, self.centre_std
        if self.mass < half:
            # Of what may be nothing there is no centre: null.
            centre = centre_std = half_centre = np.full(3, np.nan)
        return {
            "frame": "flange",
            "mass": self.mass,
            "mass_std": self.mass_std,
            "mass_interval": [self.mass - half, self.mass + half],
            "centre": centre.tolist(),
            "centre_std": centre_std.tolist(),
            "centre_interval": np.stack([centre - half_centre, centre + half_centre], 1).tolist(),
            "inertia_about_centre": self.inertia.tolist(),
            "parameters": table(
                name=robot.PARAMETERS,
                unit=robot.PARAMETER_UNITS,
                value=self.parameters,
                std=self.std,
                least_squares=self.free,
            ),
            "noise": self.noise.tolist(),
            "samples": self.samples,
            **told(self.warnings),
        }


def payload_of(problem: SharedProblem, fit: SharedFit) -> Payload:
    """The payload of a fit to records, moved to the flange and made physically consistent."""
    model = problem.problems[0].base.model
    arm = model.robot
    link_in_flange = np.linalg.inv(arm.flange) @ arm.parameter_frames[model.frames][-1]
    turn = robot.frame_map(np.asarray(link_in_flange, dtype=np.float64))
    free = turn @ fit.solution.shared[-PAYLOAD:]
    covariance = turn @ fit.covariance[-PAYLOAD:, -PAYLOAD:] @ turn.T
    # The information of the fit weighs the data; the covariance judges what came of it.
    metric = turn @ fit.naive[-PAYLOAD:, -PAYLOAD:] @ turn.T
    off = GAINS_OFF * turn @ fit.shares[-PAYLOAD:]
    covariance = (covariance + covariance.T) / 2 + off @ off.T
    # Beyond doubt below zero: the nearest body is none, and a search for it need not converge.
    taken_off = free[0] < -NORMAL_95 * float(np.sqrt(covariance[0, 0]))
    body = np.zeros(PAYLOAD) if taken_off else nearest_body(free, metric)
    return Payload(
        parameters=body,
        free=free,
        covariance=covariance,
        noise=fit.noise,
        samples=sum(item.blocks for item in problem.problems),
        warnings=tuple(_findings(free, covariance)),
    )


def _findings(free: Array, covariance: Array) -> Iterator[Finding]:
    unseen = np.sqrt(np.diag(covariance)) > UNKNOWN / 2
    if unseen.any():
        names = ", ".join(np.array(robot.PARAMETERS)[unseen])
        text = f"no torque of these motions depends on {names} of the payload"
        yield Finding("low_excitation", text)
    spread = float(np.sqrt(covariance[0, 0]))
    half = NORMAL_95 * spread
    if -SWAPPED * spread < free[0] < half:
        text = f"a payload of {free[0]:.3g} kg +- {half:.2g} kg is not significant"
        yield Finding("low_excitation", text)
    # Of swapped runs the negative is a body.
    held = -free if free[0] < -half else free
    gap = nearest_body(held, covariance) - held
    distance = float(gap @ np.linalg.solve(covariance, gap))
    # Chi-square with ten degrees of freedom passes 29.6 once in a thousand times.
    if distance > 29.6:
        yield Finding(
            "not_physical",
            "no physically consistent body is near the least-squares estimate (distance "
            f"{np.sqrt(distance):.1f} standard deviations): the runs differ in more than "
            "the payload",
        )
    elif free[0] < -SWAPPED * spread:
        yield Finding(
            "not_physical",
            f"the loaded runs carry {-free[0]:.3g} kg less than the unloaded ones: "
            "they may have been swapped",
            next_step="give the recording without the payload first",
        )
