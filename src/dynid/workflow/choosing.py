"""`--preset best`: let the record choose how it is processed and modelled."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from dynid.core.progress import Progress
from dynid.identification.least_squares import PRIOR_GAIN
from dynid.identification.selection import Selection, select
from dynid.recording.record import ExperimentRecord
from dynid.regressor.terms import FrictionTerms
from dynid.robot.model import RobotModel
from dynid.signals.periods import find_period, fold_periods
from dynid.signals.process import uniform_signals
from dynid.signals.samples import ProcessingSettings
from dynid.signals.torque_filter import was_smoothed


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """What was chosen, for programs and for people."""

    processing: ProcessingSettings
    friction: FrictionTerms
    prior_gain: float
    ill_conditioned: bool
    words: tuple[str, ...]


def choose(
    records: Sequence[ExperimentRecord],
    robot: RobotModel,
    frames: str,
    processing: ProcessingSettings,
    *,
    terms: FrictionTerms | None = None,
    smoothed: bool = True,
    presliding: bool = True,
    progress: Progress | None = None,
) -> Choice:
    """Choose settings and friction on the longest record; a lone periodic one is averaged.

    Args:
        records: The recordings.
        robot: The robot.
        frames: Parameter frames.
        processing: Settings given by the user: what is set there stays.
        terms: Terms given by the user; None to choose them.
        smoothed: Whether to look for a low-pass that the torques have passed.
        presliding: Whether friction may build up over a displacement.
        progress: Told what is being tried and how far it is (0 to 1).

    Raises:
        InputError: See `select`.
    """
    longest = max(records, key=lambda record: record.duration_s)
    signals = uniform_signals(longest, robot, processing)
    period = find_period(signals.q, signals.rate_hz) if len(records) == 1 else None
    averaged: tuple[str, ...] = ()
    if period is not None:
        processing = replace(processing, period_s=period)
        repetitions = int(len(signals.t) / signals.rate_hz / period + 1e-6)
        signals = fold_periods(signals, period)
        averaged = (f"average of {repetitions} periods of {period:g} s",)
    # A filter that one record has passed says nothing of the others.
    smoothed = smoothed and all(
        was_smoothed(uniform_signals(record, robot, processing)) for record in records
    )
    chosen = select(
        robot,
        frames,
        signals,
        processing,
        terms=terms,
        smoothed=smoothed,
        presliding=presliding,
        progress=progress,
    )
    return Choice(
        processing=chosen.settings,
        friction=chosen.friction,
        prior_gain=chosen.prior_gain,
        ill_conditioned=chosen.ill_conditioned,
        words=(*averaged, *_words(chosen)),
    )


def _words(chosen: Selection) -> tuple[str, ...]:
    settings, width = chosen.settings, chosen.friction.width
    widths = width if isinstance(width, tuple) else (width,)
    delays = "none" if settings.delays_s is None else _row(1000 * d for d in settings.delays_s)
    sources = {
        "measured": "velocities from measured values",
        "position": "velocities differentiated from positions",
    }
    words = [
        f"cut-off {settings.cutoff_hz:g} Hz",
        sources[settings.velocity],
        f"torque delays {delays}" + ("" if settings.delays_s is None else " ms"),
        f"friction terms {_terms(chosen.friction)}",
        f"Coulomb widths {_row(widths)} rad/s",
        f"held-out RMS {_row(chosen.noise)} N.m",
    ]
    over = chosen.friction.presliding
    if over:
        words.insert(-1, f"presliding over {_row(over)} rad")
    if settings.torque_filter is not None:
        words.insert(0, settings.torque_filter.describe())
    if chosen.prior_gain < PRIOR_GAIN:
        words.insert(
            -1, f"prior gain {chosen.prior_gain:g}, stronger for an ill-conditioned record"
        )
    return tuple(words)


def _terms(friction: FrictionTerms) -> str:
    load = friction.load
    return friction.describe() + ("" if load is None else f",{load.describe()}")


def _row(values: Iterable[float]) -> str:
    return " ".join(f"{value:.3g}" for value in values)
