"""What is chosen before a fit.

`--preset best` lets the recordings choose how they are processed and modelled.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from dynid import identification, recording, regressor, signals
from dynid.core import InputError, Progress, Provenance, provenance
from dynid.robot import RobotModel
from dynid.settings import IdentifySettings

REGIONS_FROM = 1e-2
"""Weight of the published inertias from which consistent bodies take it over: the motion leaves
that much to the prior."""
SIMULATED = ("ml", "iv", "didim")
"""Estimators that follow the arm in a simulation, whose friction has no past."""


def _word(settings: IdentifySettings) -> str | None:
    """The word of the estimator, which may be a value."""
    chosen = settings.estimator
    return chosen.name if isinstance(chosen, identification.Estimator) else chosen


def _estimator(
    settings: IdentifySettings, robot: RobotModel, choice: identification.Selection | None
) -> identification.Estimator:
    """The estimator that settings ask for, or the one that was chosen (None: preset `paper`)."""
    if isinstance(settings.estimator, identification.Estimator):
        return settings.estimator
    weight = 0.0 if choice is None else choice.near_weights[-1]
    gain = None if choice is None else identification.PRIOR_GAIN
    word = settings.estimator or ("ols" if choice is None else "wls")
    if word == "sdp" and weight >= REGIONS_FROM:
        return identification.PhysicallyConsistent(prior_gain=gain, weight=weight)
    if word != "wls":
        return identification.estimator_of(word, gain)
    groups = None
    if settings.weighting == "size":
        torque = robot.limits.torque
        if not np.isfinite(torque).all():
            raise InputError(
                "joint sizes follow from torque limits, and this robot has none",
                where="--weighting size",
                value=robot.name,
            )
        groups = tuple(int(k) for k in np.unique(torque, return_inverse=True)[1])
    if settings.estimator is None:
        return identification.TowardPublished(weight=weight, groups=groups)
    return identification.WeightedLeastSquares(groups=groups, prior_gain=gain)


def choose(
    records: Sequence[recording.ExperimentRecord],
    robot: RobotModel,
    settings: IdentifySettings,
    processing: signals.ProcessingSettings,
    progress: Progress | None = None,
) -> tuple[identification.Selection, tuple[str, ...]]:
    """Choose settings and friction on all records together; a lone periodic one is averaged.

    What the processing sets stays; what was chosen is returned for programs and in words.
    """
    recordings = [signals.uniform_signals(record, robot, processing) for record in records]
    averaged: tuple[str, ...] = ()
    # Maximum likelihood has a noise of its own for each sample: no filter fits there. A filter
    # that one record has passed says nothing of the others.
    smoothed = _word(settings) != "ml" and all(map(signals.was_smoothed, recordings))
    # For this motion its repetitions are what is left out: their average would hide how they
    # differ.
    if len(recordings) == 1 and settings.purpose == "anywhere":
        uniform = recordings[0]
        period = signals.find_period(uniform.q, uniform.rate_hz)
        if period is not None:
            processing = replace(processing, period_s=period)
            repetitions = int(len(uniform.t) / uniform.rate_hz / period + 1e-6)
            recordings = [signals.fold_periods(uniform, period)]
            averaged = (f"average of {repetitions} periods of {period:g} s",)
    simulated = _word(settings) in SIMULATED
    left = ("friction without presliding: the estimator simulates the arm",) if simulated else ()
    chosen = identification.select(
        robot,
        settings.frames,
        recordings,
        processing,
        terms=settings.terms,
        smoothed=smoothed,
        presliding=not simulated,
        purpose=settings.purpose,
        progress=progress,
    )
    words = _words(chosen, settings.purpose, any(robot.prismatic))
    return chosen, (*averaged, *left, *words)


def _words(chosen: identification.Selection, purpose: str, slides: bool) -> tuple[str, ...]:
    place, speed, torque = "rad", "rad/s", "N.m"
    if slides:
        place, speed, torque = "rad or m", "rad/s or m/s", "N.m or N"
    settings, friction = chosen.settings, chosen.friction
    widths = friction.width if isinstance(friction.width, tuple) else (friction.width,)
    load = "" if friction.load is None else f",{friction.load.describe()}"
    delays = "none" if settings.delays_s is None else f"{_ms(settings.delays_s)} ms"
    if chosen.delays_std_s is not None:
        delays += f" (standard deviations {_ms(chosen.delays_std_s)} ms)"
    sources = {
        "measured": "velocities from measured values",
        "position": "velocities differentiated from positions",
    }
    words = [
        f"chosen for {purpose}",
        f"cut-off {settings.cutoff_hz:g} Hz",
        sources[settings.velocity],
        f"torque delays {delays}",
        f"friction terms {friction.describe()}{load}",
        f"Coulomb widths {_row(widths)} {speed}",
        f"held-out RMS {_row(chosen.noise)} {torque}",
    ]
    if friction.presliding:
        words.insert(-1, f"presliding over {_row(friction.presliding)} {place}")
    if settings.torque_filter is not None:
        words.insert(0, settings.torque_filter.describe())
    return tuple(words)


def _ms(seconds: Iterable[float]) -> str:
    return _row(1000 * value for value in seconds)


def _row(values: Iterable[float]) -> str:
    return " ".join(f"{value:.3g}" for value in values)


LONG_RECORD = 20_000
"""Samples above which rows are averaged whatever the preset: time and memory stay bounded."""


def asked_processing(
    records: Sequence[recording.ExperimentRecord], settings: IdentifySettings
) -> signals.ProcessingSettings:
    """How recordings are processed as far as the user said; rows of long ones are averaged."""
    return signals.ProcessingSettings(
        cutoff_hz=settings.cutoff_hz,
        start_s=settings.start_s,
        stop_s=settings.stop_s,
        decimate=settings.preset == "best" or max(r.samples for r in records) > LONG_RECORD,
    )


def made_from(records: Sequence[recording.AnyRecording], settings: IdentifySettings) -> Provenance:
    """Where an estimate comes from: its recordings and what was asked for."""
    names = [r.metadata.origin or f"record {k}" for k, r in enumerate(records, start=1)]
    inputs = dict(zip(names, map(recording.fingerprint, records), strict=True))
    return provenance(inputs=inputs, settings=settings.to_json())


def prepare(
    records: Sequence[recording.ExperimentRecord],
    robot: RobotModel,
    settings: IdentifySettings,
    processing: signals.ProcessingSettings,
    made: Provenance,
    progress: Progress | None = None,
) -> identification.PreparedFit:
    """Choose, process, and find the shapes that a fit takes as given.

    What the processing sets stays; `progress` is told how far it is (0 to 1).
    """
    choice, words = None, ()
    if settings.preset == "best":
        choice, words = choose(records, robot, settings, processing, progress)
        processing = choice.settings
    recordings = [signals.uniform_signals(record, robot, processing) for record in records]
    if _word(settings) in SIMULATED:
        # Derivatives, spectra and simulations of all of them go by one rate.
        recordings = signals.at_one_rate(recordings)
    parts = [signals.samples_from(uniform, processing) for uniform in recordings]
    samples = parts[0] if len(parts) == 1 else signals.joined(parts)
    friction = settings.terms or regressor.FrictionTerms() if choice is None else choice.friction
    estimator = _estimator(settings, robot, choice)
    model = regressor.InverseDynamicModel(robot=robot, frames=settings.frames, friction=friction)
    model = identification.with_load(model, samples, estimator)
    if choice is not None and settings.terms is None:
        chosen = model.names
        model = identification.without_negative(model, samples, estimator)
        dropped = ", ".join(name for name in chosen if name not in model.names)
        words += (f"without {dropped}, negative in the fit",) if dropped else ()
        model = identification.with_ripple(model, samples, estimator)
        samples = identification.resolve_ripple(model, samples)
    return identification.PreparedFit(
        model=model,
        samples=samples,
        lengths=tuple(part.count for part in parts),
        estimator=estimator,
        source=identification.EstimateSource(
            records=records,
            settings=processing,
            preset=settings.preset,
            choices=(*words, *(ripple.describe() for ripple in model.friction.ripples)),
            made=made,
        ),
        near_weights=() if choice is None else choice.near_weights,
    )


LEAST_PERIODS = 3.0
"""Of the cut-off within a recording: below, the filter leaves no motion to identify from."""


def require_cutoff(rate_hz: float, cutoff_hz: float | None, seconds: float = math.inf) -> None:
    """Refuse a cut-off [Hz] that a rate or a duration cannot carry; nothing replaces it.

    Raises:
        InputError: It is too high, or too low.
    """
    if cutoff_hz is None:
        return
    if cutoff_hz * seconds < LEAST_PERIODS:
        raise InputError(
            "the cut-off is too low for the record's duration: the filter leaves no motion",
            where="--cutoff",
            value=f"{cutoff_hz:g} Hz",
            limit=f"from {1.01 * LEAST_PERIODS / seconds:.3g} Hz",
        )
    highest = signals.NYQUIST_SHARE * rate_hz / 2
    if cutoff_hz > highest * (1 + 1e-6):
        raise InputError(
            "the cut-off is too high for the record's rate",
            where="--cutoff",
            value=f"{cutoff_hz:g} Hz",
            limit=f"up to {highest:g} Hz",
        )


def require_torques(parts: Sequence[recording.ExperimentRecord], robot: RobotModel) -> None:
    """Refuse a recording, given in parts, of which a joint's torque never changes.

    Raises:
        InputError: Such a torque was not measured, and is no model's.
    """
    flat = [np.ptp(signals.measured_torque(part, robot), axis=0) == 0.0 for part in parts]
    dead = np.flatnonzero(np.all(flat, axis=0))
    if len(dead):
        raise InputError(
            "a torque is the same on every row",
            where=parts[0].metadata.origin or None,
            value=", ".join(robot.joint_names[j] for j in dead),
            next_step="Check its column and its sensor.",
        )
