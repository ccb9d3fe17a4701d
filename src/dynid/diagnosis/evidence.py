"""How likely a rival explanation is.

It is judged by the likelihood of blocks that were left out, and by how far it moves the parameters
from what is published.
"""

from dataclasses import dataclass, replace

import numpy as np

from dynid.core import Array
from dynid.diagnosis.hypotheses import Hypothesis
from dynid.diagnosis.residual import BLOCKS, LEAST_ERROR, Fits, solution

ARBITRARY = frozenset({"spring", "mounting"})
"""Kinds whose sizes refer to an arbitrary basis: combinations are judged, those that the motion
tells apart."""
WIDENINGS = 3
"""Solutions until the spread of a fault's sizes holds those that were found."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scored:
    """How well a hypothesis explains what is left."""

    hypothesis: Hypothesis
    value: float
    """Its size, one number."""
    std: float
    values: Array
    """(m) its sizes."""
    score: float
    """Drop of the negative log likelihood of left-out blocks and of the prior [nats]."""
    evidence: float
    """Log of the Bayes factor over the reference [nats]."""
    covariance: Array
    """(m, m) of its sizes."""
    surest: Array
    """(m) the combination of its sizes that is largest over its standard deviation."""
    certainty: float
    """That ratio."""

    def combined(self, weights: Array) -> tuple[float, float]:
        """A combination of its sizes, by weights (m), and its standard deviation."""
        return float(weights @ self.values), float(np.sqrt(weights @ self.covariance @ weights))


def drops(found: Fits, rivals: list[Hypothesis]) -> list[float]:
    """Drop of the negative log likelihood and prior by each rival alone [nats].

    Every row counts as independent, whatever the errors of the reference look like: where a rival
    is true, they are those of the fault.
    """
    length = found.rows / found.counts
    every = replace(found, weights=found.weights * length)
    normal, vector = _eliminated(every, every.weighted())[:2]
    out: list[float] = []
    first = 0
    for rival in rivals:
        part = slice(first, first + len(rival.columns))
        first = part.stop
        own = normal[part, part] + np.diag(1 / np.square(rival.width))
        out.append(0.5 * float(vector[part] @ np.linalg.solve(own, vector[part])))
    return out


def _eliminated(found: Fits, blocks: Array) -> tuple[Array, Array, Array]:
    """What its weighted sums leave for added columns without its own parameters, p = p0 - Z x.

    Returns:
        (m, m) normal matrix, (m) right side; (p, m + 1) Z and p0.
    """
    p = found.own
    total = blocks.sum(axis=0)
    right = total[:p, p:].copy()
    right[:, -1] += found.precision @ found.mean
    solved = solution(total[:p, :p] + found.precision, right)
    left: Array = np.asarray(total[p:-1, p:] - total[p:-1, :p] @ solved, dtype=np.float64)
    return left[:, :-1], left[:, -1], solved


def score(found: Fits, rival: Hypothesis, alone: Fits, parts: float) -> Scored:
    """Score a rival against the reference.

    Args:
        found: Sums of the reference's columns, then the rival's.
        rival: The rival.
        alone: Those of the reference without it, with the spread of inertias that it has then.
        parts: How many of the blocks are independent.
    """
    p, m, blocks = found.own, len(rival.columns), found.weighted()
    normal, vector, solved = _eliminated(found, blocks)
    # Sizes far beyond the usual are not pulled toward it: theirs is the spread that they show.
    prior, inverse, x = normal, normal, np.zeros(m)
    for _ in range(WIDENINGS):
        prior = np.diag(1 / np.square(rival.holding(x)))
        inverse = np.asarray(np.linalg.inv(normal + prior), dtype=np.float64)
        x = inverse @ vector
    values = solved[:, -1] - solved[:, :-1] @ x
    widened = np.zeros((p + m, p + m))
    widened[:p, :p], widened[p:, p:] = found.precision, prior
    mean = np.append(found.mean, np.zeros(m))
    precision, links = found.precision.copy(), len(alone.inertial)
    precision[:links, :links] = alone.precision[:links, :links]
    without = replace(found, precision=precision, widening=alone.widening)
    before, _ = left_out(without, blocks)
    after, each = left_out(replace(found, own=p + m, mean=mean, precision=widened), blocks)
    away = each[:, p:] - each[:, p:].mean(axis=0)
    covariance = inverse + (BLOCKS - 1) / parts * away.T @ away
    value, std = _one_number(rival.kind, x, np.sqrt(np.diag(covariance)))
    combinations = np.linalg.eigh(normal)[1].T if rival.kind in ARBITRARY else np.eye(m)
    spread = np.sqrt(np.einsum("ij,jk,ik->i", combinations, covariance, combinations))
    ratios = np.abs(combinations @ x) / spread
    gain = 0.5 * float(found.counts @ np.log(before / after))
    normal, vector, solved = _eliminated(without, blocks)
    unlikely = without.penalty(solved[:, -1]) - found.penalty(values)
    within: Array = np.asarray(np.linalg.inv(normal + prior), dtype=np.float64)
    occam = float(np.linalg.slogdet(within)[1]) + float(np.log(np.diag(prior)).sum())
    chosen = rival.told * float(np.log(rival.columns.shape[-1]))
    return Scored(
        hypothesis=rival,
        value=value,
        std=std,
        values=x,
        score=gain + unlikely - 0.5 * float(x @ prior @ x) - chosen,
        evidence=0.5 * (float(vector @ within @ vector) + occam) - chosen,
        covariance=covariance,
        surest=combinations[int(ratios.argmax())],
        certainty=float(ratios.max()),
    )


def left_out(found: Fits, blocks: Array) -> tuple[Array, Array]:
    """Squared errors (n) that a reference leaves in blocks left out, and its parameters then.

    The parameters are (BLOCKS, p), a row for each block that was left out. `blocks` are the
    weighted sums.
    """
    p = found.own
    total = blocks.sum(axis=0)
    errors, each = np.zeros(found.sums.shape[1]), np.empty((BLOCKS, p))
    for k, block in enumerate(found.sums):
        weighted = total - blocks[k]
        right = weighted[:p, -1:] + (found.precision @ found.mean)[:, None]
        each[k] = solution(weighted[:p, :p] + found.precision, right)[:, 0]
        way = np.zeros(len(total))
        way[:p], way[-1] = -each[k], 1.0
        errors += (block @ way) @ way
    least = LEAST_ERROR * found.sums[:, :, -1, -1].sum(axis=0) + 1e-18 * found.rows
    return np.maximum(errors, least), each


def _one_number(kind: str, values: Array, std: Array) -> tuple[float, float]:
    """Size of an explanation with several sizes, and its standard deviation."""
    if kind.startswith("payload") or len(values) == 1:
        return float(values[0]), float(std[0])
    if kind == "friction_drift":
        weight = 1 / np.square(std)
        return float(weight @ values / weight.sum()), float(1 / np.sqrt(weight.sum()))
    norm = float(np.linalg.norm(values))
    return norm, float(np.sqrt(np.square(values / max(norm, 1e-300)) @ np.square(std)))
