"""What `dynid identify` can be asked for, and what is chosen before a fit.

`--preset best` lets the recordings choose how they are processed and modelled.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dynid.core import InputError, Progress
from dynid.identification import (
    ESTIMATORS,
    PRIOR_GAIN,
    PURPOSES,
    Estimator,
    PhysicallyConsistent,
    Selection,
    TowardPublished,
    WeightedLeastSquares,
    estimator_of,
    select,
    with_load,
    with_ripple,
)
from dynid.recording import ExperimentRecord
from dynid.regressor import FrictionTerms, InverseDynamicModel
from dynid.robot import RobotModel
from dynid.signals import (
    NYQUIST_SHARE,
    ProcessingSettings,
    Samples,
    find_period,
    fold_periods,
    joined,
    process,
    uniform_signals,
    was_smoothed,
)

PRESETS = ("best", "paper")
WEIGHTINGS = ("joint", "size")


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifySettings:
    """Settings of an identification; None: by the preset.

    Raises:
        InputError: An unknown preset, estimator or weighting.
    """

    preset: str = "best"
    """`paper`: exactly as in the paper; `best`: selected by cross-validation."""
    estimator: str | Estimator | None = None
    """A word of `ESTIMATORS`, or an estimator of your own."""
    terms: FrictionTerms | None = None
    """Friction terms."""
    cutoff_hz: float | None = None
    """Low-pass cut-off [Hz]."""
    start_s: float | None = None
    """Start of the window, from the start of the recording [s]."""
    stop_s: float | None = None
    """End of the window [s]."""
    weighting: str = "joint"
    """`joint`: one noise a joint; `size`: joints with equal torque limit share one."""
    frames: str = ""
    """`dh`, `mdh` or `urdf`."""
    purpose: str = "anywhere"
    """What the model is for: `anywhere` chooses by regions left out, `this-motion` by stretches
    of time left out."""

    def __post_init__(self) -> None:
        word = None if isinstance(self.estimator, Estimator) else self.estimator
        for value, allowed, where in (
            (self.preset, PRESETS, "--preset"),
            (self.purpose, PURPOSES, "--for"),
            (word or "ols", ESTIMATORS, "--estimator"),
            (self.weighting, WEIGHTINGS, "--weighting"),
        ):
            if value not in allowed:
                raise InputError("unknown", where=where, value=value, limit=", ".join(allowed))

    @property
    def estimator_word(self) -> str | None:
        """The estimator's word, or the name of one's own; None: by the preset."""
        return self.estimator.name if isinstance(self.estimator, Estimator) else self.estimator

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {
            "preset": self.preset,
            "estimator": self.estimator_word,
            "terms": None if self.terms is None else self.terms.to_json(),
            "cutoff_hz": self.cutoff_hz,
            "start_s": self.start_s,
            "stop_s": self.stop_s,
            "weighting": self.weighting,
            "frames": self.frames,
            "for": self.purpose,
        }


REGIONS_FROM = 1e-2
"""Weight of the published inertias from which consistent bodies are fitted by regions too: the
motion leaves that much to the prior."""


def chosen_estimator(
    settings: IdentifySettings, robot: RobotModel, choice: Choice | None
) -> Estimator:
    """The estimator that settings ask for, or the one that was chosen.

    Args:
        settings: What the user asked for.
        robot: The robot.
        choice: What was chosen by what is left out; None with the preset `paper`.

    Raises:
        InputError: Weighting by joint size without torque limits.
    """
    if isinstance(settings.estimator, Estimator):
        return settings.estimator
    weight = 0.0 if choice is None else choice.prior_weight
    gain = None if choice is None else PRIOR_GAIN
    word = settings.estimator or ("ols" if choice is None else "wls")
    if word == "sdp" and weight >= REGIONS_FROM:
        return PhysicallyConsistent(prior_gain=gain, by_regions=True)
    if word != "wls":
        return estimator_of(word, gain)
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
    if settings.estimator is None and weight > 0:
        return TowardPublished(weight=weight, groups=groups)
    return WeightedLeastSquares(groups=groups, prior_gain=gain)


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """What was chosen, for programs and for people."""

    processing: ProcessingSettings
    friction: FrictionTerms
    prior_weight: float
    near_weights: tuple[float, ...]
    words: tuple[str, ...]


def choose(
    records: Sequence[ExperimentRecord],
    robot: RobotModel,
    settings: IdentifySettings,
    processing: ProcessingSettings,
    progress: Progress | None = None,
) -> Choice:
    """Choose settings and friction on all records together; a lone periodic one is averaged.

    Args:
        records: The recordings, in any order.
        robot: The robot.
        settings: What the user asked for.
        processing: Settings given by the user: what is set there stays.
        progress: Told what is being tried and how far it is (0 to 1).

    Raises:
        InputError: See `select`.
    """
    recordings = [uniform_signals(record, robot, processing) for record in records]
    averaged: tuple[str, ...] = ()
    # Maximum likelihood has a noise of its own for each sample: no filter fits there. A filter
    # that one record has passed says nothing of the others.
    smoothed = settings.estimator != "ml" and all(map(was_smoothed, recordings))
    # For this motion its repetitions are what is left out: their average would hide how they
    # differ.
    if len(recordings) == 1 and settings.purpose == "anywhere":
        signals = recordings[0]
        period = find_period(signals.q, signals.rate_hz)
        if period is not None:
            processing = replace(processing, period_s=period)
            repetitions = int(len(signals.t) / signals.rate_hz / period + 1e-6)
            recordings = [fold_periods(signals, period)]
            averaged = (f"average of {repetitions} periods of {period:g} s",)
    chosen = select(
        robot,
        settings.frames,
        recordings,
        processing,
        terms=settings.terms,
        smoothed=smoothed,
        # These follow the arm in a simulation, whose friction has no past.
        presliding=settings.estimator not in ("ml", "iv", "didim"),
        purpose=settings.purpose,
        progress=progress,
    )
    return Choice(
        processing=chosen.settings,
        friction=chosen.friction,
        prior_weight=chosen.prior_weight,
        near_weights=chosen.near_weights,
        words=(*averaged, *_words(chosen, any(robot.prismatic))),
    )


def _words(chosen: Selection, slides: bool) -> tuple[str, ...]:
    place, speed, torque = "rad", "rad/s", "N.m"
    if slides:
        place, speed, torque = "rad or m", "rad/s or m/s", "N.m or N"
    settings, width = chosen.settings, chosen.friction.width
    widths = width if isinstance(width, tuple) else (width,)
    delays = "none" if settings.delays_s is None else _row(1000 * d for d in settings.delays_s)
    sources = {
        "measured": "velocities from measured values",
        "position": "velocities differentiated from positions",
    }
    words = [
        f"chosen for {chosen.purpose}",
        f"cut-off {settings.cutoff_hz:g} Hz",
        sources[settings.velocity],
        f"torque delays {delays}" + ("" if settings.delays_s is None else " ms"),
        f"friction terms {_terms(chosen.friction)}",
        f"Coulomb widths {_row(widths)} {speed}",
        f"held-out RMS {_row(chosen.noise)} {torque}",
    ]
    over = chosen.friction.presliding
    if over:
        words.insert(-1, f"presliding over {_row(over)} {place}")
    if settings.torque_filter is not None:
        words.insert(0, settings.torque_filter.describe())
    return tuple(words)


def _terms(friction: FrictionTerms) -> str:
    load = friction.load
    return friction.describe() + ("" if load is None else f",{load.describe()}")


def _row(values: Iterable[float]) -> str:
    return " ".join(f"{value:.3g}" for value in values)


LONG_RECORD = 20_000
"""Samples above which rows are averaged whatever the preset: time and memory stay bounded."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Prepared:
    """Samples, and what they are to be fitted with."""

    model: InverseDynamicModel
    samples: Samples
    lengths: tuple[int, ...]
    """Samples of each recording."""
    estimator: Estimator
    processing: ProcessingSettings
    choice: Choice | None

    @property
    def words(self) -> tuple[str, ...]:
        """What was chosen."""
        return (
            *(() if self.choice is None else self.choice.words),
            *(ripple.describe() for ripple in self.model.friction.ripples),
        )

    @property
    def prior_weight(self) -> float:
        """Of the published inertias; 0 for none."""
        return 0.0 if self.choice is None else self.choice.prior_weight

    @property
    def near_weights(self) -> tuple[float, ...]:
        """Weights that score as well."""
        return () if self.choice is None else self.choice.near_weights


def prepare(
    records: Sequence[ExperimentRecord],
    robot: RobotModel,
    settings: IdentifySettings,
    processing: ProcessingSettings,
    progress: Progress | None = None,
) -> Prepared:
    """Choose, process, and find the shapes that a fit takes as given.

    Args:
        records: The recordings.
        robot: The robot.
        settings: What the user asked for.
        processing: Settings given by the user: what is set there stays.
        progress: Told what is being done and how far it is (0 to 1).
    """
    choice = None
    if settings.preset == "best":
        choice = choose(records, robot, settings, processing, progress)
        processing = choice.processing
    parts = [process(record, robot, processing) for record in records]
    samples = parts[0] if len(parts) == 1 else joined(parts)
    friction = settings.terms or FrictionTerms() if choice is None else choice.friction
    estimator = chosen_estimator(settings, robot, choice)
    model = InverseDynamicModel(robot=robot, frames=settings.frames, friction=friction)
    model = with_load(model, samples, estimator)
    if choice is not None and settings.terms is None:
        model = with_ripple(model, samples, estimator)
    return Prepared(
        model=model,
        samples=samples,
        lengths=tuple(part.count for part in parts),
        estimator=estimator,
        processing=processing,
        choice=choice,
    )


def require_cutoff(rate_hz: float, cutoff_hz: float | None) -> None:
    """Refuse a cut-off that a rate cannot carry; nothing replaces it.

    Args:
        rate_hz: Samples a second.
        cutoff_hz: The cut-off; None for none.

    Raises:
        InputError: It is too high.
    """
    highest = NYQUIST_SHARE * rate_hz / 2
    if cutoff_hz is not None and cutoff_hz > highest * (1 + 1e-6):
        raise InputError(
            "the cut-off is too high for the record's rate",
            where="--cutoff",
            value=f"{cutoff_hz:g} Hz",
            limit=f"up to {highest:g} Hz",
        )
