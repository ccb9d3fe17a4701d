"""How much later each joint's torque was recorded than the motion.

A delay and friction that builds up over a displacement look alike where a joint turns back, and
not elsewhere. So a delay is measured beside all friction that is known, at once and without a
choice; and when friction is chosen, it has to pay beside the friction that its joint would have
without it, and is measured again with the displacement, of which the best one is taken for each
delay. Then the motion is moved by fractions of a sample, the torque by whole ones: the motion is
smooth between samples, the torque of friction is not. Rows in motion alone count then: where a
joint comes to rest slowly, a displacement of 1e-6 rad takes as long as a delay.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.core import Array, Indices, Mask
from dynid.identification.selection.candidates import LOAD, WIDTHS, CandidateColumns, JointChoice
from dynid.identification.selection.gram import RIDGE, GramBlocks, joint_weights
from dynid.identification.selection.scoring import LEAST_GAIN, Scores, ScoreSearch
from dynid.signals import ProcessingSettings

LONGEST_DELAY_S = 0.08
DELAY_STEP_S, FINE_STEP_S = 0.008, 0.002
"""Between delays that are tried, and between those beside the best where the rate allows."""
LEAST_SURE, CERTAIN = 1.5, 4.0
"""Size of a delay over its standard deviation from which it may pay, and is taken in any case."""
AWAY_S = 0.012
"""How far from what was measured a delay is looked for again."""
FINER = tuple(3.0 ** (k / 5) for k in range(-2, 3))
"""Displacements that are tried about each of `DISPLACEMENTS`, over it."""
FINEST = tuple(1.09**k for k in range(-4, 5))
"""Those that are tried about the best of them, over it."""
WEIGHTINGS, SWEEPS = 2, 12
"""Weights from the errors of the fit, and each time all joints in turn, at most so often."""
UNSEEN = 1e-12
"""Of unit columns: for parameters that no row shows, those of a joint at rest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Delays:
    """How much later torques were recorded than the motion."""

    taken_s: tuple[float, ...] | None = None
    """(n) delays that pay, in whole samples, 0 for the others; None where none does [s]."""
    std_s: tuple[float, ...] | None = None
    """(n) their standard deviations, from leaving parts out; None where none was measured [s]."""


Options = Sequence[tuple[int, ...]]
"""Columns that may stand for the friction of a joint, one choice each."""


def measured_delays(search: ScoreSearch, settings: ProcessingSettings) -> Delays:
    """Measure each joint's delay.

    A delay is taken that is sure from leaving parts out, or that is likely and lowers the errors
    on these by more than their standard error, on every partition: so many columns foretell parts
    left out poorly, and a delay of the size of its standard deviation is as well none.

    Args:
        search: The recordings.
        settings: Without delays.
    """
    smooth = settings.torque_filter
    if smooth is not None and smooth.cutoff_hz * LONGEST_DELAY_S < 0.5:
        # The filter has spread every reversal over more time than any delay.
        return Delays()
    rate, n = search.recordings[0].rate_hz, search.robot.joints
    extras = tuple(term for term in search.columns.extras if term != LOAD)
    columns = replace(search.columns, extras=extras, with_step=())
    places = [tuple(range(len(columns.positive)))] * n
    options = [[place] for place in places]
    sums = _DelayedSums.of(search, settings, columns, np.zeros(n), LONGEST_DELAY_S, DELAY_STEP_S)
    found, _ = sums.best(search, options, [0] * n)
    sums = _DelayedSums.of(search, settings, columns, found, 2 * DELAY_STEP_S, FINE_STEP_S)
    found, _ = sums.best(search, options, [0] * n)
    each = np.array([part.best(search, options, [0] * n)[0] for part in sums.without_parts()])
    std = np.sqrt((len(each) - 1) * each.var(axis=0))
    seen = (LEAST_SURE * std < np.abs(found)) & (np.abs(found) < LONGEST_DELAY_S)
    near = np.where(seen, np.round(found * rate) / rate, 0.0)
    taken = _taken(search, settings, columns, places, near, np.abs(found) < CERTAIN * std)
    late = tuple(np.where(taken, near, 0.0).tolist()) if any(taken) else None
    return Delays(taken_s=late, std_s=tuple(std.tolist()))


def delays_that_pay(
    search: ScoreSearch,
    settings: ProcessingSettings,
    choices: tuple[JointChoice, ...],
    now: Scores,
    prior: float,
) -> tuple[ProcessingSettings, tuple[JointChoice, ...], Scores]:
    """Leave out delays that do not pay beside the friction that a joint would have without.

    Args:
        search: The recordings.
        settings: With delays in whole samples: means of two samples have less noise.
        choices: The friction that was chosen with them.
        now: Its left-out errors.
        prior: Weight of the published inertias.
    """
    for j in np.argsort(np.abs(settings.delays_s or ())).tolist():
        late = list(settings.delays_s or ())
        if late[j] == 0.0:
            continue
        late[j] = 0.0
        plain = replace(settings, delays_s=tuple(late) if any(late) else None)
        found, without = search.descend(plain, choices, prior, [j])
        if min(gain for gain, _ in now.gains(without)) < LEAST_GAIN:
            settings, choices, now = plain, found, without
    return settings, choices, now


def refined_delays(
    search: ScoreSearch, settings: ProcessingSettings, choices: tuple[JointChoice, ...]
) -> tuple[float, ...] | None:
    """The delays of the settings, measured again beside the friction that was chosen.

    With each step of a late joint, and with load friction: a displacement that is a little off
    looks like a delay, and so does what it leaves.
    """
    if settings.delays_s is None:
        return None
    late, plain = np.array(settings.delays_s), replace(settings, delays_s=None)
    over = tuple(d * f for d in search.columns.displacements for f in FINER)
    columns = replace(search.columns, displacements=over)
    first = len(WIDTHS)
    load = frozenset(k for k, t in enumerate(columns.extras) if t == LOAD)
    steps = [
        choice.width
        if choice.displacement is None
        else first + len(FINER) * choice.displacement + len(FINER) // 2
        for choice in choices
    ]
    free = late != 0

    def again(near: Array, reach_s: float, which: Mask, every: range) -> tuple[Array, list[int]]:
        """The delays, and the steps of friction with them: of `which` joints any of `every`."""
        tried = [every if by else (now,) for by, now in zip(which, steps, strict=True)]
        options = [
            [
                columns.places(j, step, choice.terms | load if free[j] else choice.terms)
                for step in mine
            ]
            for j, (choice, mine) in enumerate(zip(choices, tried, strict=True))
        ]
        start = [mine.index(now) for mine, now in zip(tried, steps, strict=True)]
        sums = _DelayedSums.of(
            search, plain, columns, near, reach_s, FINE_STEP_S, free, between=True
        )
        found, chosen = sums.best(search, options, start)
        return found, [mine[k] for mine, k in zip(tried, chosen, strict=True)]

    near, steps = again(late, AWAY_S, free, range(columns.steps))
    finer = free & (np.array(steps) >= first)
    if finer.any():
        # Beside each joint's own displacement.
        lengths = [over[step - first] if step >= first else 1.0 for step in steps]
        columns = replace(columns, displacements=FINEST, unit=columns.unit * np.array(lengths))
        steps = [first + len(FINEST) // 2 if step >= first else step for step in steps]
        near, _ = again(near, AWAY_S / 2, finer, range(first, columns.steps))
    return tuple(np.round(near, 4).tolist())


def _taken(
    search: ScoreSearch,
    settings: ProcessingSettings,
    columns: CandidateColumns,
    places: list[tuple[int, ...]],
    near: Array,
    unsure: Mask,
) -> list[int]:
    """1 for each joint whose delay (n) near [s] is sure or pays on parts left out, else 0."""
    blocks = search.summed(settings, columns, np.stack([np.zeros(len(near)), near]))
    prior = search.prior.times(search.plain_prior)

    def scored(which: list[int]) -> Scores:
        picks = search.picks_at(places, columns, which)
        weights = joint_weights(blocks.all, picks, prior)
        return search.scores(blocks, picks, weights, search.plain_prior)

    taken: list[int] = (near != 0).astype(int).tolist()
    for j in np.argsort(np.abs(near)):
        if taken[j]:
            without = [*taken[:j], 0, *taken[j + 1 :]]
            gains = scored(taken).gains(scored(without))
            if unsure[j] and min(gain - error for gain, error in gains) < LEAST_GAIN:
                taken = without
    return taken


@dataclass(frozen=True, slots=True, kw_only=True)
class _DelayedSums:
    """Sums with the torques moved by whole samples and the motion by fractions of one."""

    columns: CandidateColumns
    near: Array
    """(n) delays about which others are tried, whole samples [s]."""
    whole: Array
    """(V) added to them by moving the torques [s]."""
    fractions: Array
    """(F) added by moving the motion, less than one of these steps [s]."""
    free: Mask
    """(n) joints whose delay is looked for; that of the others stays."""
    blocks: tuple[GramBlocks, ...]
    """(F)"""
    left_out: tuple[GramBlocks, ...]
    """(F) a cell a region of the workspace or stretch of time."""

    @staticmethod
    def of(
        search: ScoreSearch,
        settings: ProcessingSettings,
        columns: CandidateColumns,
        near: Array,
        reach_s: float,
        step_s: float,
        free: Mask | None = None,
        *,
        between: bool = False,
    ) -> "_DelayedSums":
        """The sums about delays (n), as far as so much away, in such steps [s].

        Joints that are not free keep theirs; all are by default. `between` samples: with motions
        moved by fractions of a step, and rows in motion alone.
        """
        rate = search.recordings[0].rate_hz
        step = max(1, round(step_s * rate)) / rate
        count = max(2, round(reach_s / step))
        near = np.round(near * rate) / rate
        whole = np.arange(-count, count + 1) * step
        shares = max(1, round(step / step_s)) if between else 1
        fractions = step / shares * (np.arange(shares) - shares // 2)
        free = np.ones(len(near), dtype=bool) if free is None else free
        versions = near + whole[:, None] * free
        sums = [search.summed(settings, columns, versions, by) for by in fractions.tolist()]
        return _DelayedSums(
            columns=columns,
            near=near,
            whole=np.asarray(whole, dtype=np.float64),
            fractions=np.asarray(fractions, dtype=np.float64),
            free=free,
            blocks=tuple(each.moving if between else each.all for each in sums),
            left_out=tuple(each.parts[0][0] for each in sums),
        )

    def without_parts(self) -> "Iterator[_DelayedSums]":
        """The sums of all parts of the recordings but one, in turn."""
        cells: Indices = np.arange(int(self.left_out[0].rows.shape[1]))
        for cell in cells:
            groups = np.where(cells == cell, -1, 0)
            yield replace(self, blocks=tuple(each.merged(groups) for each in self.left_out))

    def best(
        self, search: ScoreSearch, options: Sequence[Options], start: Sequence[int]
    ) -> tuple[Array, list[int]]:
        """(n) delays that fit best, and which of each joint's options does, beginning at some.

        One joint at a time, all of its delays and options; before that all joints together.
        """
        rank = search.base.rank
        first, middle = rank + len(self.columns.positive), len(self.blocks) // 2
        joints = [
            _eliminated([sums.products[j].sum(axis=0) for sums in self.blocks], own, rank, first)
            for j, own in enumerate(options)
        ]
        shrinkage = search.prior.times(search.plain_prior)
        prior = shrinkage.times(float(self.blocks[0].rows.sum(axis=1).mean()))
        known = prior.precision @ prior.mean
        states = [(k, middle, len(self.whole) // 2) for k in start]
        found = self.near.copy()
        tried = (self.whole[:, None] + self.fractions).ravel()
        for _ in range(WEIGHTINGS):
            places = [own[k] for own, (k, _, _) in zip(options, states, strict=True)]
            picks = search.picks_at(places, self.columns, [version for *_, version in states])
            squares = np.square(joint_weights(self.blocks[middle], picks, shrinkage))
            weighted = [square * joint for square, joint in zip(squares, joints, strict=True)]
            every = np.sum([weighted[j][k, middle] for j, (k, *_) in enumerate(states)], axis=0)
            version = int(np.argmin(_costs(every, prior.precision, known)))
            states = [(k, middle, version) for k, *_ in states]
            for _ in range(SWEEPS):
                before = list(states)
                for j in np.flatnonzero(self.free):
                    matrix, vector = prior.precision.copy(), known.copy()
                    for i, (k, fraction, version) in enumerate(states):
                        if i != j:
                            matrix += weighted[i][k, fraction, :rank, :rank]
                            vector += weighted[i][k, fraction, :rank, rank + version]
                    costs = _costs(weighted[j], matrix, vector)
                    k, fraction, version = np.unravel_index(int(np.argmin(costs)), costs.shape)
                    states[j] = (int(k), int(fraction), int(version))
                    # From the earliest delay to the latest.
                    found[j] = self.near[j] + _lowest(tried, costs.min(axis=0).T.ravel())
                if states == before:
                    break
        return found, [k for k, *_ in states]


def _eliminated(products: Sequence[Array], options: Options, rank: int, first: int) -> Array:
    """(S, F, r + V, r + V) a joint's products of shared columns (r) and torques (V).

    What the columns (S) of its own friction explain of them is taken away, in each of its sums of
    products (F).
    """
    shared = np.delete(np.arange(len(products[0])), np.arange(rank, first))
    left = np.empty((len(options), len(products), *2 * shared.shape))
    for k, option in enumerate(options):
        own = rank + np.array(option, dtype=np.intp)
        for f, product in enumerate(products):
            scale = np.sqrt(np.maximum(np.diagonal(product)[own], 1e-300))
            cross = product[np.ix_(own, shared)] / scale[:, None]
            square = product[np.ix_(own, own)] / np.outer(scale, scale) + RIDGE * np.eye(len(own))
            left[k, f] = product[np.ix_(shared, shared)] - cross.T @ np.linalg.solve(square, cross)
    return left


def _costs(products: Array, matrix: Array, vector: Array) -> Array:
    """(..., V) squared errors that the best shared parameters leave of each torque.

    Of products (..., r + V, r + V), to which other joints and the prior add a matrix (r, r) and a
    vector (r).
    """
    rank = len(vector)
    square, target = products[..., :rank, :rank] + matrix, products[..., :rank, rank:]
    energy = np.diagonal(products, axis1=-2, axis2=-1)[..., rank:]
    scale = np.sqrt(np.maximum(np.diagonal(square, axis1=-2, axis2=-1), 1e-300))
    square = square / (scale[..., :, None] * scale[..., None, :]) + UNSEEN * np.eye(rank)
    target = (target + vector[:, None]) / scale[..., None]
    return energy - (target * np.linalg.solve(square, target)).sum(axis=-2)


def _lowest(delays: Array, costs: Array) -> float:
    """The vertex of the parabola through the lowest of the costs of delays in even steps."""
    k = int(np.clip(np.argmin(costs), 1, len(costs) - 2))
    left, middle, right = costs[k - 1 : k + 2]
    bend = max(float(left - 2.0 * middle + right), 1e-300)
    between = float(np.clip(0.5 * (left - right) / bend, -0.5, 0.5))
    return float(delays[k] + between * (delays[1] - delays[0]))
