"""What is expected of the links of a robot before anything was measured."""

import numpy as np

from dynid.constraints import prior_link
from dynid.core import Array
from dynid.identification import CENTRE_SPREAD_M, MASS_SPREAD, TENSOR_SPREAD, inertial_prior
from dynid.robot import RobotModel, from_pseudo_inertia, inverse, move, to_pseudo_inertia

DRAWS = 300
UNKNOWN_LENGTH_M = 0.5
UNKNOWN_MASS, UNKNOWN_CENTRE, UNKNOWN_THICK, UNKNOWN_TENSOR = 1.0, 0.3, 0.1, 0.5
"""Of guessed links: log of the mass; centre, least thickness (of the longest link); log of size."""
BALL_M = 0.03
"""Published tensors may be rough: a body is at least as thick as a ball of this radius."""

ROUNDING = 1e-11
"""Least variance of a link's parameters, over the square of the links' mean mass."""


def link_prior(robot: RobotModel) -> tuple[Array, Array]:
    """(10 n) inertial parameters and (10 n, 10 n) their covariance, from what is published.

    Bodies are drawn about the published ones, so that the covariance knows that a heavier link
    has larger moments. Published tensors are turned, too: many leave out the products of inertia.
    Where a mass is unpublished, they are drawn about a uniform rod along the link whose mass is
    unknown: its centre is still beside the link, not anywhere.
    """
    n = robot.joints
    steps = np.concatenate([robot.placements[1:, :3, 3], robot.flange[None, :3, 3]])
    longest = float(np.linalg.norm(steps, axis=1).max()) or UNKNOWN_LENGTH_M
    draw = np.random.default_rng(0)
    mean, covariance = np.zeros(10 * n), np.zeros((10 * n, 10 * n))
    frames = robot.parameter_frames[robot.default_frames]
    guessed = inertial_prior(robot, robot.default_frames).parameters
    usual = float(guessed[:, 0].mean())
    for k in range(n):
        part, place = slice(10 * k, 10 * k + 10), inverse(frames[k])
        if robot.published[k]:
            guess = np.isnan(robot.inertias[k]).any()
            tensor = (UNKNOWN_TENSOR, 0.0) if guess else (TENSOR_SPREAD, TENSOR_SPREAD)
            row, spreads = prior_link(robot, k), (MASS_SPREAD, CENTRE_SPREAD_M, *tensor)
            thick = BALL_M / np.sqrt(5)
        else:
            # Axes of wrists meet, where no length tells a mass: too much is safer than too little.
            row = move(guessed[k], frames[k]) * max(1.0, usual / guessed[k, 0])
            spreads = (UNKNOWN_MASS, UNKNOWN_CENTRE * longest, UNKNOWN_TENSOR, 0.0)
            thick = UNKNOWN_THICK * longest
        drawn = from_pseudo_inertia(place @ _drawn(draw, row, thick, *spreads) @ place.T)
        mean[part] = move(row, place)
        covariance[part, part] = np.cov(drawn.T) + ROUNDING * usual**2 * np.eye(10)
    return mean, covariance


def _drawn(
    draw: np.random.Generator,
    row: Array,
    thick_m: float,
    mass_log: float,
    centre_m: float,
    tensor_log: float,
    turn_rad: float,
) -> Array:
    """The pseudo-inertias (DRAWS, 4, 4) of bodies near another."""
    normal = draw.normal(size=(DRAWS, 7))
    pseudo = to_pseudo_inertia(row)
    centre = pseudo[:3, 3] / row[0]
    size, axes = np.linalg.eigh(pseudo[:3, :3] - row[0] * np.outer(centre, centre))
    sizes = np.maximum(size, row[0] * thick_m**2) * np.exp(tensor_log * normal[:, :3])
    factor = np.exp(mass_log * normal[:, 3])
    levers = np.ones((DRAWS, 4))
    levers[:, :3] = centre + centre_m * normal[:, 4:]
    half = np.cross(np.eye(3), turn_rad * draw.spawn(1)[0].normal(size=(DRAWS, 1, 3))) / 2
    turned = axes @ np.linalg.solve(np.eye(3) - half, np.eye(3) + half)
    bodies = (row[0] * factor)[:, None, None] * levers[:, :, None] * levers[:, None]
    bodies[:, :3, :3] += (turned * (factor[:, None] * sizes)[:, None]) @ turned.swapaxes(1, 2)
    return bodies


def with_payload(
    prior: tuple[Array, Array], robot: RobotModel, values: Array, width: Array
) -> tuple[Array, Array]:
    """A prior by which the last link carries a payload (10) that was found, or one like it."""
    mean, covariance = (part.copy() for part in prior)
    moves = of_the_last_link(robot)
    mean[-10:] += values @ moves
    covariance[-10:, -10:] += moves.T @ (np.square(width)[:, None] * moves)
    return mean, covariance


def of_the_last_link(robot: RobotModel) -> Array:
    """(10, 10) the last link's parameters (columns) of a body that it carries at the flange.

    Of a point there of 1 kg; then of what its first and second moments differ by.
    """
    place = np.append(robot.flange[:3, 3], 1.0)
    out = np.eye(10)
    out[0] = from_pseudo_inertia(np.outer(place, place))
    return out
