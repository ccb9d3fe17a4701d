"""Model selection: terms, shapes, delays, cut-off and prior, by what is left out.

What fits one motion best is not what transfers. For a model to be used anywhere, choices are
scored on regions of the workspace left out (and on recordings left out where there are several),
rows in motion only: at rest friction hides the torque. For a model of this motion, on stretches
of time left out. A term that does not pay on every partition is not taken. Delays come first.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid import signals
from dynid.core import Array, Progress, silent
from dynid.identification.selection import delays
from dynid.identification.selection.candidates import DISPLACEMENTS, PLAIN_WIDTH, JointChoice
from dynid.identification.selection.scoring import GAIN_OF_SHAPE, ScoreSearch
from dynid.regressor import FrictionTerms, coupled_motors
from dynid.robot import RobotModel
from dynid.signals import ProcessingSettings, TorqueFilter, UniformSignals

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
    near_weights: tuple[float, ...]
    """Weights of the published inertias (see `TowardPublished`) that score alike, to a standard
    error, of which the last is taken; 0 for none."""
    noise: Array
    """(n) left-out RMS error of the rows that count [N.m or N]."""
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
    tell = progress or silent
    delays_are_free, late = settings.delays_s is None, delays.Delays()
    if delays_are_free and (terms is not None or not presliding):
        # Friction that the model leaves out would look like delays.
        free = select(
            robot, frames, recordings, settings, smoothed=smoothed, purpose=purpose,
            progress=lambda word, share: tell(word, 0.1 * share),
        )  # fmt: skip
        late = delays.Delays(taken_s=free.settings.delays_s, std_s=free.delays_std_s)
        settings, delays_are_free = replace(settings, delays_s=late.taken_s), False
    search = ScoreSearch(
        robot,
        frames,
        signals.at_one_rate(recordings),
        terms,
        presliding=presliding,
        purpose=purpose,
    )
    over = _take_presliding_of_motors(search, _settings_to_try(recordings, settings))
    choices = tuple(JointChoice(PLAIN_WIDTH, frozenset(), displacement) for displacement in over)
    if delays_are_free and not smoothed:
        tell("delays", 0.0)
        late = delays.measured_delays(search, settings)
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
        late = delays.measured_delays(search, trials[best])
        trials = tuple(replace(trial, delays_s=late.taken_s) for trial in trials)
    tell("friction", 0.4)
    prior = search.prior_weights(trials[best], choices, search.plain_prior)[0][0]
    choices, now = search.descend(trials[best], choices, prior)
    if delays_are_free:
        chosen, choices, now = delays.delays_that_pay(search, trials[best], choices, now, prior)
        trials = tuple(replace(trial, delays_s=chosen.delays_s) for trial in trials)
    # Steps that are sharper than friction is ask for a low cut-off: chosen, it may move far.
    tell("cut-off", 0.75)
    far, tried = int(np.argmin([search.plain_score(trial, choices) for trial in trials])), {best}
    for step in (far - best, -1, 1):
        near = best + step
        if near in tried or not 0 <= near < len(trials):
            continue
        # Beside the last cut-off of one source of velocities stands the first one of the other.
        if near != far and trials[near].velocity != trials[best].velocity:
            continue
        tried.add(near)
        blocks = search.blocks(trials[near])
        weights = search.weights(blocks, choices, prior)
        other = search.scores(blocks, search.picks(choices), weights, prior)
        # Far off, the terms that hide what a low cut-off leaves stand in the way.
        if near == far or other.value < now.value - GAIN_OF_SHAPE * robot.joints:
            found, other = search.descend(trials[near], choices, prior)
            if other.value < now.value - GAIN_OF_SHAPE * robot.joints:
                choices, now, best = found, other, near
    settings = trials[best]
    if delays_are_free:
        settings = replace(settings, delays_s=delays.refined_delays(search, settings, choices))
    near_weights, now = search.prior_weights(settings, choices, prior)
    tell("done", 1.0)
    return Selection(
        settings=settings,
        friction=search.friction(settings, choices, near_weights[-1]),
        near_weights=near_weights,
        noise=now.noise,
        delays_std_s=late.std_s,
    )


def _take_presliding_of_motors(
    search: ScoreSearch, trials: Sequence[ProcessingSettings]
) -> list[int | None]:
    """Let friction of coupled motors build up where that pays; over which displacement, by joint.

    Their columns stand in the rows of several joints, so that no joint can choose alone. All have
    the same displacement; None for joints of other motors, and where a step is as good.
    """
    motors, joints = coupled_motors(search.robot), range(search.robot.joints)
    found: list[int | None] = [None for _ in joints]
    if not (motors and search.columns.displacements):
        return found
    base, levers = search.base, search.columns.levers.tolist()
    trial = min(trials, key=search.plain_score)
    best, taken = search.plain_score(trial) - GAIN_OF_SHAPE * len(joints), base
    for k, displacement in enumerate(DISPLACEMENTS):
        over = tuple(displacement * levers[j] if j in motors else 0.0 for j in joints)
        friction = replace(base.model.friction, presliding=over)
        search.base = replace(base, model=replace(base.model, friction=friction))
        if (score := search.plain_score(trial)) < best:
            best, taken = score, search.base
            found = [k if j in motors else None for j in joints]
    search.base = taken
    return found


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

    highest = max(signals.torque_end(one) for one in search.recordings)
    lowest = max(highest / 8, SHORTEST_RECORD / _duration(search.recordings))
    cutoffs = np.geomspace(min(lowest, highest / 2), highest, 6)
    found = min((TorqueFilter(cutoff_hz=float(f), order=2) for f in cutoffs), key=score)
    step = float(cutoffs[1] / cutoffs[0])
    for _ in range(3):
        step = step**0.5
        beside = (replace(found, cutoff_hz=found.cutoff_hz * r) for r in (1.0, step, 1 / step))
        found = min(beside, key=score)
        near = (k for k in signals.ORDERS if abs(k - found.order) <= 1)
        found = min((replace(found, order=order) for order in near), key=score)
    if score(found) > score(None) - GAIN_OF_SHAPE * search.robot.joints:
        return None
    return found


def _duration(recordings: Sequence[UniformSignals]) -> float:
    """The shortest recording's [s]."""
    return min(float(np.ptp(one.t)) for one in recordings)


def _settings_to_try(
    recordings: Sequence[UniformSignals], settings: ProcessingSettings
) -> tuple[ProcessingSettings, ...]:
    highest = signals.NYQUIST_SHARE * min(one.rate_hz for one in recordings) / 2
    if settings.cutoff_hz is not None:
        cutoffs = [settings.cutoff_hz]
    else:
        lowest = 10.0 / _duration(recordings)
        # Stamps give rates like 124.9999999, of which 50 Hz is in reach.
        cutoffs = [f for f in CUTOFFS_HZ if lowest <= f <= highest * (1 + 1e-6)] or [highest]
    exact = settings.period_s is not None or any(r.qd is None for r in recordings)
    sources = ["position"] if exact else ["position", "measured"]
    return tuple(
        replace(settings, cutoff_hz=cutoff, velocity=source)
        for source in sources
        for cutoff in cutoffs
    )
