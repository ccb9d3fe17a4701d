"""`--preset best`: choose cut-off, velocities, delays and friction inside the record.

Every choice is scored by block cross-validation against the measured torque of the
identification record alone. A variant that is not clearly better than a simpler one loses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.core.arrays import Array
from dynid.core.progress import Progress, silent
from dynid.identification.candidate_columns import DISPLACEMENTS
from dynid.identification.conditioning import ILL_CONDITIONED, motion_condition_number
from dynid.identification.joint_choice import GAIN_OF_SHAPE, JointChoice
from dynid.identification.least_squares import PRIOR_GAIN
from dynid.identification.search import Descent, Search
from dynid.regressor.terms import FrictionTerms
from dynid.robot.model import RobotModel
from dynid.signals.filters import NYQUIST_SHARE
from dynid.signals.resample import UniformSignals
from dynid.signals.samples import ProcessingSettings
from dynid.signals.torque_filter import ORDERS, TorqueFilter, torque_end

CUTOFFS_HZ = (2.0, 3.0, 4.5, 7.0, 10.0, 15.0, 22.0, 33.0, 50.0, 75.0)
"""Cut-offs that are tried, as far as the record's length and rate allow."""
PRIOR_GAINS = (PRIOR_GAIN, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
"""Priors that are tried on an ill-conditioned record."""
SHORTEST_RECORD = 10.0
"""Periods of the torque filter's cut-off that a record must hold."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """What was chosen, and its score."""

    settings: ProcessingSettings
    friction: FrictionTerms
    score: float
    """Sum over joints of log RMS of the held-out error [log N.m]."""
    noise: Array
    """(n) held-out RMS error [N.m or N]."""
    prior_gain: float
    """Strength of the weak prior; the default unless the record is ill-conditioned."""
    ill_conditioned: bool
    """Whether the motion does not tell the parameters apart."""


def select(
    robot: RobotModel,
    frames: str,
    signals: UniformSignals,
    settings: ProcessingSettings,
    *,
    terms: FrictionTerms | None = None,
    smoothed: bool = False,
    presliding: bool = True,
    progress: Progress | None = None,
) -> Selection:
    """Choose settings and friction terms by cross-validation inside one record.

    Args:
        robot: The robot.
        frames: Parameter frames.
        signals: The identification record on a uniform grid, folded if it is periodic.
        settings: Settings given by the user: what is set there stays.
        terms: Terms given by the user; None to choose them.
        smoothed: Whether the torque was smoothed before it was written: what did it is found.
        presliding: Whether friction may build up over a displacement.
        progress: Told what is being tried and how far it is (0 to 1).

    Raises:
        InputError: The record is too short to leave blocks out.
    """
    search = Search(robot, frames, signals, terms, presliding=presliding)
    plain = (JointChoice(0, frozenset(), search.no_delay),) * robot.joints
    tell = progress or silent
    trials = _settings_to_try(signals, settings)
    scored: list[tuple[float, int]] = []
    for index, trial in enumerate(trials):
        tell("cut-off", 0.4 * index / len(trials))
        scored.append((search.plain_scores(trial)[0], index))
    best = min(scored)[1]
    if smoothed and settings.torque_filter is None:
        tell("what smoothed the torque", 0.3)
        passed = _passed_by(search, trials[best])
        trials = tuple(replace(trial, torque_filter=passed) for trial in trials)
    # Blocks of an ill-conditioned record do not show how a richer model does on another motion.
    ill = motion_condition_number(robot, frames, signals, settings) > ILL_CONDITIONED
    if ill:
        search.extras, search.presliding = (), False
    tell("friction and delays", 0.4)
    found = _best_descent(search, trials[best], plain)
    if settings.delays_s is None and search.at_an_end(found.choices):
        found = _aligned(search, trials[best], plain, found)
    # Friction chosen, the cut-off may move to a neighbour.
    for near in _neighbours(trials, best):
        tell("cut-off", 0.75)
        candidates = search.candidates(trials[near])
        clear = found.score - GAIN_OF_SHAPE * robot.joints
        if search.score(candidates, found.choices)[0] < clear:
            other = search.descend(trials[near], found.choices)
            if other.score < found.score:
                found, best = other, near
    choices, score, noise = found.choices, found.score, found.noise
    gain = PRIOR_GAIN
    if ill:
        gain, score, noise = _prior(search, trials[best], choices)
    tell("done", 1.0)
    return Selection(
        settings=search.settings(trials[best], choices),
        friction=search.friction(choices),
        score=score,
        noise=noise,
        prior_gain=gain,
        ill_conditioned=ill,
    )


def _best_descent(
    search: Search, settings: ProcessingSettings, plain: tuple[JointChoice, ...]
) -> Descent:
    """The best of three descents.

    Presliding and the terms that stand in for it hide each other: one joint at a time, none gives
    way. So joints begin without it; then with it beside what was found; then with it alone.
    """
    price = search.moves(settings, presliding=False).price

    def cost(way: Descent) -> float:
        return way.score + sum(map(price, plain, way.choices))

    best = search.descend(settings, plain, presliding=False)
    if not search.presliding:
        return best
    start = tuple(replace(choice, displacement=0) for choice in best.choices)
    best = min(best, search.descend(settings, start), key=cost)
    if all(choice.displacement is None for choice in best.choices):
        return best
    start = tuple(replace(choice, displacement=len(DISPLACEMENTS) // 2) for choice in plain)
    other = search.descend(settings, start)
    return other if cost(other) < cost(best) - GAIN_OF_SHAPE * len(plain) else best


def _aligned(
    search: Search, settings: ProcessingSettings, plain: tuple[JointChoice, ...], found: Descent
) -> Descent:
    """The descent with delays about what all torques are late by, where it is clearly better.

    Friction that builds up looks late too: so this is tried only where delays came to an end.
    """
    late = search.common_delay(settings)
    if late == 0.0:
        return found
    search.look_about(late)
    other = _best_descent(search, settings, plain)
    if other.score < found.score - GAIN_OF_SHAPE * len(plain):
        return other
    search.look_about(0.0)
    return found


def _prior(
    search: Search, settings: ProcessingSettings, choices: tuple[JointChoice, ...]
) -> tuple[float, float, Array]:
    """The best prior for choices, its score and held-out RMS (n)."""
    candidates = search.candidates(settings)
    weights = search.score(candidates, choices)[2]
    variants = search.variants(choices)
    errors = [candidates.score(variants, weights, gain)[0] for gain in PRIOR_GAINS]
    scores = [float(np.log(error).sum() / 2) for error in errors]
    best = int(np.argmin(scores))
    return PRIOR_GAINS[best], scores[best], np.sqrt(errors[best])


def _passed_by(search: Search, trial: ProcessingSettings) -> TorqueFilter | None:
    """The filter that the torque has passed, if one explains it better than none.

    Cut-offs up to where the torque ends, then finer beside the best, then orders: an error in
    the cut-off costs more than one in the order.
    """
    known: dict[TorqueFilter | None, float] = {}

    def score(passed: TorqueFilter | None) -> float:
        if passed not in known:
            known[passed] = search.plain_scores(replace(trial, torque_filter=passed))[0]
        return known[passed]

    highest = torque_end(search.signals)
    lowest = max(highest / 8, SHORTEST_RECORD / float(np.ptp(search.signals.t)))
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


def _settings_to_try(
    signals: UniformSignals, settings: ProcessingSettings
) -> tuple[ProcessingSettings, ...]:
    highest = NYQUIST_SHARE * signals.rate_hz / 2
    if settings.cutoff_hz is not None:
        cutoffs = [settings.cutoff_hz]
    else:
        lowest = 10.0 / (signals.t[-1] - signals.t[0])
        cutoffs = [f for f in CUTOFFS_HZ if lowest <= f <= highest] or [highest]
    exact = signals.qd is None or settings.period_s is not None
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
