"""The paper's genetic algorithm: 300 individuals, 5 generations, operators of our own.

An individual holds, for each joint, the shape of its motion (its direction in the space of free
numbers), the place of the motion in the position range and how much of the tightest limit it
uses. It is decoded by scaling each joint onto its tightest bound of position, velocity and
acceleration, so these are met by every individual. Other constraints (torque, speed of the tool,
collisions) are handled feasibility first (Deb, 2000): of two individuals the feasible one wins,
of two infeasible ones the one that violates less, of two feasible ones the better criterion.
"""

from collections.abc import Callable

import numpy as np

from dynid.core import Array
from dynid.excitation.problem import Candidate, Stop
from dynid.excitation.region import MotionRegion, shape_basis

TOURNAMENT = 3
"""Individuals that compete to become a parent."""
ELITE = 0.02
"""Share of the population that survives unchanged."""
EXCHANGE = 0.5
"""Chance of a child to take whole joints from both parents; the others are blended."""
BLEND = 0.3
"""How far blending goes beyond the parents (BLX-alpha)."""
MUTATED_JOINTS = 0.25
"""Chance of a joint to be mutated."""
MUTATION = 0.3
"""Spread of a mutation, genes having a spread of one."""
LEAST_FILL = 0.3
"""Least share of the tightest limit, where other constraints can make smaller motions better."""

# Genes of a population are (P, n, k + 2): the shape in k coordinates with a spread of one, the
# place within 0 and 1, the share of the tightest limit within `LEAST_FILL` and 1.


def evolve(
    judge: Callable[[Array], Candidate],
    region: MotionRegion,
    *,
    population: int,
    generations: int,
    seed: int,
    full: bool,
    stop: Stop,
) -> int:
    """Evolve a random population; whoever judges keeps the best.

    Args:
        judge: Judges the numbers (n, 1 + k) of one motion.
        region: Bounds of position, velocity and acceleration.
        population: Individuals of a generation.
        generations: Generations after the random one.
        seed: Of all random numbers.
        full: Every joint uses all of its tightest limit.
        stop: Asked before each individual.

    Returns:
        How many generations were finished.
    """
    random = np.random.default_rng(seed)
    basis = shape_basis(region).T
    size = (population, len(region.middle), 1)
    shape, place = random.standard_normal((*size[:2], len(basis))), random.uniform(size=size)
    fill = np.ones(size) if full else random.uniform(LEAST_FILL, 1.0, size=size)
    genes = np.concatenate([shape, place, fill], axis=2)
    elite = elite_count(population)
    scores: list[Candidate] = []
    for generation in range(generations + 1):
        new = genes if generation == 0 else _children(genes, population - elite, random, full)
        fresh: list[Candidate] = []
        for x in _decoded(new, region, basis):
            if stop():
                return max(generation - 1, 0)
            fresh.append(judge(x))
        if generation > 0:
            genes = np.concatenate([genes[:elite], new])
        scores = scores[:elite] + fresh
        order = sorted(range(population), key=lambda i: scores[i].key)
        genes, scores = genes[order], [scores[i] for i in order]
    return generations


def elite_count(population: int) -> int:
    """How many survive a generation unchanged."""
    return max(1, round(ELITE * population))


def _decoded(genes: Array, region: MotionRegion, basis: Array) -> Array:
    fill = genes[..., -1]
    numbers = region.onto_limits(genes[..., :-2] @ basis, genes[..., -2])
    if (fill == 1.0).all():
        return numbers
    # Smaller about its own middle: it stays where it fits.
    swing = numbers[..., 1:] @ region.columns[0][:, 1:].T
    middle = (swing.max(axis=-1) + swing.min(axis=-1)) / 2
    if region.pose is None:
        numbers[..., 0] += (1.0 - fill) * middle
    numbers[..., 1:] *= fill[..., None]
    return numbers


def _children(genes: Array, count: int, random: np.random.Generator, full: bool) -> Array:
    """Children of a population sorted best first."""
    population, joints, width = genes.shape
    # The smallest rank of a few wins the tournament.
    parents = random.integers(population, size=(2, count, TOURNAMENT)).min(axis=2)
    swap = random.uniform(size=(count, 1)) < EXCHANGE
    from_other = (random.uniform(size=(count, joints)) < 0.5).astype(np.float64)
    blended = random.uniform(-BLEND, 1.0 + BLEND, size=(count, joints))
    share = np.where(swap, from_other, blended)[..., None]
    mutated = random.uniform(size=(count, joints, 1)) < MUTATED_JOINTS
    kinds = [random.standard_normal((count, joints, k)) for k in (width - 2, 1, 1)]
    noise = MUTATION * mutated * np.concatenate(kinds, axis=2)
    children = (1.0 - share) * genes[parents[0]] + share * genes[parents[1]] + noise
    # Only directions count; unit spread keeps mutations of one size through the generations.
    shape = children[..., :-2]
    shape /= np.sqrt(np.mean(np.square(shape), axis=-1, keepdims=True)) + 1e-300
    children[..., -2] = np.clip(children[..., -2], 0.0, 1.0)
    children[..., -1] = 1.0 if full else np.clip(children[..., -1], LEAST_FILL, 1.0)
    return children
