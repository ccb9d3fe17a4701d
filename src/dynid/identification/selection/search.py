"""Model selection: terms, shapes, delays, cut-off and prior, by what is left out.

What fits one motion best is not what transfers. For a model to be used anywhere, choices are
scored on regions of the workspace left out (and on recordings left out where there are several),
rows in motion only: at rest friction hides the torque. For a model of this motion, on stretches
of time left out. A term that does not pay on every partition is not taken. Delays come first: they
are measured, with every friction that is known here beside them.

A delay and friction that builds up late look alike where a joint reverses, and not elsewhere: all
friction that is known stands beside the delays, at once and without a choice.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.core import Array, Indices, Progress, silent
from dynid.identification.selection.columns import (
    LOAD,
    PLAIN_WIDTH,
    WIDTHS,
    CandidateColumns,
    JointChoice,
)
from dynid.identification.selection.gram import RIDGE, GramBlocks, joint_weights
from dynid.identification.selection.scoring import (
    GAIN_OF_SHAPE,
    LEAST_GAIN,
    PRIOR_OF_PLAIN,
    CandidateBlocks,
    Scores,
    ScoreSearch,
)
from dynid.regressor import FrictionTerms
from dynid.robot import RobotModel
from dynid.signals import (
    NYQUIST_SHARE,
    ORDERS,
    ProcessingSettings,
    TorqueFilter,
    UniformSignals,
    torque_end,
)

LONGEST_DELAY_S = 0.08
DELAY_STEP_S, FINE_STEP_S = 0.008, 0.002
"""Between delays that are tried, and between those beside the best where the rate allows."""
CERTAIN = 4.0
"""Size of a delay over its standard deviation from which it is taken in any case."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Delays:
    """How much later torques were recorded than the motion."""

    taken_s: tuple[float, ...] | None = None
    """(n) delays that pay, 0 for the others; None where none does [s]."""
    std_s: tuple[float, ...] | None = None
    """(n) their standard deviations, from leaving parts out; None where none was measured [s]."""


def measured_delays(search: ScoreSearch, settings: ProcessingSettings) -> Delays:
    """Measure each joint's delay.

    Beside every column of friction that is known here, those of presliding among them: what
    only looks like a delay when a joint reverses is not one. A delay is taken that is sure from
    leaving parts out, or that lowers the errors on these by more than their standard error, on
    every partition: so many columns foretell parts left out poorly.

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
    columns = replace(search.columns, extras=extras)
    places = [tuple(range(len(columns.positive)))] * n
    found, std, reach = np.zeros(n), np.zeros(n), LONGEST_DELAY_S
    steps = [max(1, round(length * rate)) / rate for length in (DELAY_STEP_S, FINE_STEP_S)]
    for step in dict.fromkeys(steps):
        # On the samples: between them straight lines take noise away, and would be preferred.
        near = np.round(found * rate) / rate
        count = max(1, round(reach / step))
        trials = np.asarray(np.arange(-count, count + 1) * step, dtype=np.float64)
        blocks = search.summed(settings, columns, near + trials[:, None])
        best, _, _ = _best_delays(search, blocks.all, columns, places, trials)
        found, reach = near + best, 2 * step
        if step == steps[-1]:
            parts = _parts(blocks)
            each = np.array([_best_delays(search, b, columns, places, trials)[0] for b in parts])
            std = np.sqrt((len(each) - 1) * each.var(axis=0))
    near = np.where(np.abs(found) < LONGEST_DELAY_S, np.round(found * rate) / rate, 0.0)
    blocks = search.summed(settings, columns, np.stack([np.zeros(n), near]))
    taken = (near != 0).astype(int).tolist()
    prior = search.prior.times(PRIOR_OF_PLAIN)

    def scored(which: list[int]) -> Scores:
        picks = search.picks_at(places, columns, which)
        weights = joint_weights(blocks.all, picks, prior, search.positive(picks, columns))
        return search.errors_of(blocks, picks, weights, PRIOR_OF_PLAIN)

    for j in np.argsort(np.abs(near)):
        if taken[j]:
            without = [*taken[:j], 0, *taken[j + 1 :]]
            gains = scored(taken).gains(scored(without))
            unsure = abs(found[j]) < CERTAIN * std[j]
            if unsure and min(gain - error for gain, error in gains) < LEAST_GAIN:
                taken = without
    late = tuple(np.where(taken, found, 0.0).tolist()) if any(taken) else None
    return Delays(taken_s=late, std_s=tuple(std.tolist()))


def _parts(blocks: CandidateBlocks) -> Iterator[GramBlocks]:
    """The sums of all parts but one, in turn."""
    parts = blocks.parts[0][0]
    every: Indices = np.arange(int(parts.rows.shape[1]))
    for part in range(len(every)):
        yield parts.merged(np.where(every == part, -1, 0))


FINER = tuple(3.0 ** (k / 5) for k in range(-2, 3))
"""Displacements that are tried about each of `DISPLACEMENTS`, over it."""
AWAY_S = 0.012
"""How far from what was measured a delay is looked for again."""


def refined_delays(
    search: ScoreSearch, settings: ProcessingSettings, choices: tuple[JointChoice, ...]
) -> tuple[float, ...] | None:
    """The delays of the settings, measured again beside the friction that was chosen.

    A displacement that is a little off looks like a delay: finer ones are tried with it.
    """
    if settings.delays_s is None:
        return None
    rate, late = search.recordings[0].rate_hz, np.array(settings.delays_s)
    step = max(1, round(FINE_STEP_S * rate)) / rate
    near = np.round(late * rate) / rate
    count = max(2, round(AWAY_S / step))
    trials = np.asarray(np.arange(-count, count + 1) * step, dtype=np.float64)
    fine = tuple(d * f for d in search.columns.displacements for f in FINER)
    columns = replace(search.columns, displacements=fine)
    blocks = search.summed(
        replace(settings, delays_s=None), columns, near + trials[:, None] * (late != 0)
    )

    def placed(j: int, more: int = 0) -> tuple[int, ...]:
        choice = choices[j]
        if choice.displacement is None:
            return columns.places(j, choice.width, choice.terms)
        index = len(FINER) * choice.displacement + len(FINER) // 2 + more
        index = min(max(index, 0), len(fine) - 1)
        return columns.places(j, len(WIDTHS) + index, choice.terms)

    places = [placed(j) for j in range(len(choices))]
    by, _, weights = _best_delays(search, blocks.all, columns, places, trials)
    for j, choice in enumerate(choices):
        if late[j] and choice.displacement is not None:
            found: dict[tuple[int, ...], tuple[float, Array]] = {}
            for more in range(-len(FINER), len(FINER) + 1):
                places[j] = placed(j, more)
                by, cost, _ = _best_delays(search, blocks.all, columns, places, trials, weights)
                found[places[j]] = cost, by
            places[j] = min(found, key=lambda at: found[at][0])
            by = found[places[j]][1]
    return tuple(np.round(np.where(late != 0, near + by, late), 4).tolist())


def _best_delays(
    search: ScoreSearch,
    blocks: GramBlocks,
    columns: CandidateColumns,
    places: Sequence[tuple[int, ...]],
    delays: Array,
    given: Array | None = None,
) -> tuple[Array, float, Array]:
    """(n) the delays that fit best, of those whose torques stand in the blocks.

    With the torques t of all joints at all delays side by side and s a choice of one a joint,
    the squared error of the best fit to t s is s' (t't - t'W (W'W)^-1 W't) s: one solution
    serves all choices. Also the squared error of the best, and the (n) weights of the joints: those
    given, or else one over the noise of the fit.
    """
    n, rank, count = search.robot.joints, search.base.rank, len(delays)
    products = blocks.products.sum(axis=1)
    size, torque = rank + sum(map(len, places)), rank + len(columns.positive) + np.arange(count)
    shrinkage = search.prior.times(PRIOR_OF_PLAIN * float(blocks.rows.sum(axis=1).mean()))
    chosen = np.full(n, int(np.argmin(np.abs(delays))))
    joints, costs = np.arange(n), np.empty((n, count))
    prior, weights, least = search.prior.times(PRIOR_OF_PLAIN), np.ones(n), np.inf
    for _ in range(2):
        picks = search.picks_at(places, columns, chosen.tolist())
        positive = search.positive(picks, columns)
        weights = joint_weights(blocks, picks, prior, positive) if given is None else given
        matrix, cross = np.zeros((size, size)), np.zeros((size, n * count + 1))
        energy = np.zeros((n * count + 1, n * count + 1))
        matrix[:rank, :rank] = shrinkage.precision
        cross[:rank, -1] = shrinkage.precision @ shrinkage.mean
        for j, pick in enumerate(picks):
            here, there, weight = pick.unknowns, pick.columns, weights[j] ** 2
            at = j * count + np.arange(count)
            matrix[np.ix_(here, here)] += weight * products[j][np.ix_(there, there)]
            cross[np.ix_(here, at)] = weight * products[j][np.ix_(there, torque)]
            energy[np.ix_(at, at)] = weight * products[j][np.ix_(torque, torque)]
        scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        solved = np.linalg.solve(
            matrix / np.outer(scale, scale) + RIDGE * np.eye(size), cross / scale[:, None]
        )
        square = energy - (cross / scale[:, None]).T @ solved
        together = [
            float(square[np.ix_(k, k)].sum())
            for k in (np.append(joints * count + d, n * count) for d in range(count))
        ]
        chosen = np.full(n, int(np.argmin(together)))
        for _ in range(2 * n):
            before = chosen.copy()
            for j in range(n):
                others = np.append(np.delete(joints * count + chosen, j), n * count)
                at = j * count + np.arange(count)
                costs[j] = np.diag(square)[at] + 2.0 * square[np.ix_(at, others)].sum(axis=1)
                chosen[j] = int(np.argmin(costs[j]))
            if (chosen == before).all():
                break
        every = np.append(joints * count + chosen, n * count)
        least = float(square[np.ix_(every, every)].sum())
    inner = np.clip(chosen, 1, count - 2)
    left, middle, right = (costs[joints, inner + k] for k in (-1, 0, 1))
    bend = np.maximum(left - 2.0 * middle + right, 1e-300)
    between = np.clip(0.5 * (left - right) / bend, -0.5, 0.5)
    step = float(delays[1] - delays[0])
    found = delays[chosen] + np.where(inner == chosen, between * step, 0.0)
    return found, least, weights


PURPOSES = ("anywhere", "this-motion")
"""What a model is for."""
CUTOFFS_HZ = (2.0, 3.0, 4.5, 7.0, 10.0, 15.0, 22.0, 33.0, 50.0, 75.0)
"""Cut-offs that are tried, as far as the record's length and rate allow."""
SHORTEST_RECORD = 10.0
"""Periods of the torque filter's cut-off that a record must hold."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """What was chosen, and its score."""

    settings: ProcessingSettings
    friction: FrictionTerms
    prior_weight: float
    """Of the published inertias, see `TowardPublished`; 0 for none."""
    near_weights: tuple[float, ...]
    """Weights that score as well, to a standard error."""
    score: float
    """Sum over joints of log RMS of the left-out error [log N.m], rows that count."""
    noise: Array
    """(n) left-out RMS error of these rows [N.m or N]."""
    purpose: str
    delays_std_s: tuple[float, ...] | None
    """(n) standard deviations of the measured delays [s]; None where they were given."""


def select(
    robot: RobotModel,
    frames: str,
    recordings: Sequence[UniformSignals],
    settings: ProcessingSettings,
    *,
    terms: FrictionTerms | None = None,
    smoothed: bool = False,
    presliding: bool = True,
    purpose: str = "anywhere",
    progress: Progress | None = None,
) -> Selection:
    """Choose settings, friction terms and the weight of the published inertias.

    Args:
        robot: The robot.
        frames: Parameter frames.
        recordings: The recordings on uniform grids, folded if periodic; in any order.
        settings: Settings given by the user: what is set there stays.
        terms: Terms given by the user; None to choose them.
        smoothed: Whether the torque was smoothed before it was written: what did it is found.
        presliding: Whether friction may build up over a displacement.
        purpose: One of `PURPOSES`.
        progress: Told what is being tried and how far it is (0 to 1).

    Raises:
        InputError: A recording is too short to leave parts out.
    """
    search = ScoreSearch(robot, frames, recordings, terms, presliding=presliding, purpose=purpose)
    tell = progress or silent
    choices = (JointChoice(PLAIN_WIDTH, frozenset()),) * robot.joints
    delays_are_free, late = settings.delays_s is None, Delays()
    if delays_are_free and not smoothed:
        tell("delays", 0.0)
        late = measured_delays(search, settings)
        settings = replace(settings, delays_s=late.taken_s)
    trials = _settings_to_try(recordings, settings)
    scored: list[float] = []
    for index, trial in enumerate(trials):
        tell("cut-off", 0.1 + 0.3 * index / len(trials))
        scored.append(search.plain_score(trial))
    best = int(np.argmin(scored))
    if smoothed and settings.torque_filter is None:
        tell("what smoothed the torque", 0.3)
        passed = _passed_by(search, trials[best])
        trials = tuple(replace(trial, torque_filter=passed) for trial in trials)
    if delays_are_free and smoothed:
        late = measured_delays(search, trials[best])
        trials = tuple(replace(trial, delays_s=late.taken_s) for trial in trials)
    tell("friction", 0.4)
    blocks = search.blocks(trials[best])
    near, _ = search.prior_weights(blocks, choices, search.weights(blocks, choices, PRIOR_OF_PLAIN))
    prior = near[0]
    choices, now = search.descend(trials[best], choices, prior)
    # Friction chosen, the cut-off may move to a neighbour.
    for near in _neighbours(trials, best):
        tell("cut-off", 0.75)
        blocks = search.blocks(trials[near])
        other = search.scores(blocks, choices, search.weights(blocks, choices, prior), prior)
        if other.value < now.value - GAIN_OF_SHAPE * robot.joints:
            choices, now = search.descend(trials[near], choices, prior)
            best = near
    settings = trials[best]
    if delays_are_free:
        settings = replace(settings, delays_s=refined_delays(search, settings, choices))
    blocks = search.blocks(settings)
    weights = search.weights(blocks, choices, prior)
    near_weights, now = search.prior_weights(blocks, choices, weights)
    tell("done", 1.0)
    return Selection(
        settings=settings,
        friction=search.friction(settings, choices, near_weights[-1]),
        prior_weight=near_weights[-1],
        near_weights=near_weights,
        score=now.value,
        noise=now.noise,
        purpose=purpose,
        delays_std_s=late.std_s,
    )


def _passed_by(search: ScoreSearch, trial: ProcessingSettings) -> TorqueFilter | None:
    """The filter that the torque has passed, if one explains it better than none.

    Cut-offs up to where the torque ends, then finer beside the best, then orders: an error in
    the cut-off costs more than one in the order.
    """
    known: dict[TorqueFilter | None, float] = {}

    def score(passed: TorqueFilter | None) -> float:
        if passed not in known:
            known[passed] = search.plain_score(replace(trial, torque_filter=passed))
        return known[passed]

    highest = max(torque_end(signals) for signals in search.recordings)
    lowest = max(highest / 8, SHORTEST_RECORD / _duration(search.recordings))
    cutoffs = np.geomspace(min(lowest, highest / 2), highest, 6)
    found = min((TorqueFilter(cutoff_hz=float(f), order=2) for f in cutoffs), key=score)
    step = float(cutoffs[1] / cutoffs[0])
    for _ in range(3):
        step = step**0.5
        beside = (replace(found, cutoff_hz=found.cutoff_hz * r) for r in (1.0, step, 1 / step))
        found = min(beside, key=score)
        near = (k for k in ORDERS if abs(k - found.order) <= 1)
        found = min((replace(found, order=order) for order in near), key=score)
    if score(found) > score(None) - GAIN_OF_SHAPE * search.robot.joints:
        return None
    return found


def _duration(recordings: Sequence[UniformSignals]) -> float:
    """The shortest recording's [s]."""
    return min(float(np.ptp(signals.t)) for signals in recordings)


def _settings_to_try(
    recordings: Sequence[UniformSignals], settings: ProcessingSettings
) -> tuple[ProcessingSettings, ...]:
    highest = NYQUIST_SHARE * min(signals.rate_hz for signals in recordings) / 2
    if settings.cutoff_hz is not None:
        cutoffs = [settings.cutoff_hz]
    else:
        lowest = 10.0 / _duration(recordings)
        cutoffs = [f for f in CUTOFFS_HZ if lowest <= f <= highest] or [highest]
    exact = settings.period_s is not None or any(r.qd is None for r in recordings)
    sources = ["position"] if exact else ["position", "measured"]
    return tuple(
        replace(settings, cutoff_hz=cutoff, velocity=source)
        for source in sources
        for cutoff in cutoffs
    )


def _neighbours(trials: tuple[ProcessingSettings, ...], index: int) -> list[int]:
    return [
        k
        for k in (index - 1, index + 1)
        if 0 <= k < len(trials) and trials[k].velocity == trials[index].velocity
    ]
