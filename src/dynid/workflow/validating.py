"""`dynid validate`: an estimate against a recording, from their files.

`dynid identify`: from the files of recordings to an estimate in a file.

`dynid compare`: two estimates, from their files.

Can a result be trusted? One word and the reasons, from its warnings and errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core import InputError, Progress
from dynid.identification import read_estimate, write_estimate
from dynid.recording import ExperimentRecord, checked_records
from dynid.signals import window
from dynid.validation import (
    ParameterComparison,
    ValidationResult,
    compare,
    validate,
)
from dynid.workflow.identify import Identification, IdentifySettings, identify
from dynid.workflow.recordings import open_record, open_records
from dynid.workflow.temperature import estimate_at


def identify_files(
    recordings: Sequence[str | Path],
    output: str | Path | None = None,
    *,
    robot: str | Path | None = None,
    settings: IdentifySettings | None = None,
    validation: str | Path | None = None,
    validation_start_s: float | None = None,
    validation_stop_s: float | None = None,
    gains: Sequence[float] | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Identify from recordings, validate if asked to, write the estimate if told where.

    Args:
        recordings: Recordings of one robot, ours or foreign.
        output: The estimate's JSON file; it appears whole or not at all.
        robot: Built-in name, URDF or robot file; None to take what the recordings say.
        settings: What to do.
        validation: Another recording to predict. With a window alone, it is the one recording
            that was given.
        validation_start_s: Start of its window [s].
        validation_stop_s: End of its window [s].
        gains: (n) drive gains [N.m/A]; they override those of the recordings and of the robot.
        progress: Told what is being done and how far it is (0 to 1).

    Raises:
        InputError: Files that cannot be read or do not belong together, unknown settings.
        JobError: A singular problem.
    """
    records, model = open_records(recordings, robot, gains)
    records = checked_records(records)
    other: ExperimentRecord | None = None
    if validation is not None:
        other = open_record(validation, model, gains)
    elif validation_start_s is not None or validation_stop_s is not None:
        if len(records) > 1:
            raise InputError(
                "a validation window of which recording?",
                value=f"{len(records)} recordings",
                next_step="Name it with --validate RECORD.",
            )
        other = records[0]
    if other is not None:
        # A wrong window must not cost the time of an identification first.
        window(other.t, validation_start_s, validation_stop_s)
    result = identify(
        records,
        model,
        settings,
        validation=other,
        validation_start_s=validation_start_s,
        validation_stop_s=validation_stop_s,
        progress=progress,
    )
    if output is not None:
        write_estimate(result.estimate, output)
    return result


def validate_files(
    estimate: str | Path,
    recording: str | Path,
    *,
    start_s: float | None = None,
    stop_s: float | None = None,
    at_degC: float | None = None,
    gains: Sequence[float] | None = None,
) -> ValidationResult:
    """Predict the torques of a recording and measure the error.

    Args:
        estimate: An estimate's JSON file; it carries its robot.
        recording: A recording, ours or foreign.
        start_s: Start of the window [s].
        stop_s: End of the window [s].
        at_degC: Temperature of all joints, where the file holds temperature laws [degC].
        gains: (n) drive gains of the recording [N.m/A]; they override its own and the robot's.

    Raises:
        InputError: Files that cannot be read, or do not belong together.
    """
    known = estimate_at(estimate, at_degC)
    record = open_record(recording, known.model.robot, gains)
    return validate(known, record, start_s=start_s, stop_s=stop_s)


def compare_files(a: str | Path, b: str | Path) -> ParameterComparison:
    """Compare two estimates.

    Args:
        a: The first estimate's JSON file, such as the cold robot's.
        b: The second one's, such as the warm robot's.

    Raises:
        InputError: Files that cannot be read, or estimates that cannot be compared.
    """
    return compare(read_estimate(a), read_estimate(b))


CARE = frozenset(
    {
        "not_physical", "over_fitted", "saturated", "unit_suspect", "clock_mismatch", "contact",
        "delay", "drive_gain", "encoder_zero", "exchanged_joints", "payload", "flexibility",
        "friction_drift", "torque_kind", "aborted", "dead_channel",
    }
)  # fmt: skip
"""Codes that ask for a look before the result is used."""
EXCITATION = frozenset({"ill_conditioned", "low_excitation"})
"""Errors of the motion, not of the inputs."""
UNEXPLAINED = 40.0
"""[%] of the torque of moving joints that the fit to its own record may leave."""
POOR_PREDICTION = 15.0
"""[%] of the torque of moving joints; good identifications predict to 5 %."""

HEADLINES = {
    "usable": "This result can be used",
    "care": "Use this result with care",
    "do_not_use": "This result must not be used",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What a person has to know first."""

    level: str
    """`usable`, `care` or `do_not_use`."""
    reasons: tuple[str, ...]
    """Why, in words."""

    @property
    def headline(self) -> str:
        """The verdict in one sentence."""
        return f"{HEADLINES[self.level]}: {'; '.join(self.reasons)}."

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {"level": self.level, "reasons": list(self.reasons)}


def _unexplained(fit: float) -> str:
    return (
        f"the model leaves {fit:.0f} % of the torques of its own record unexplained: check the "
        "robot, the order of the joints, units and signs"
    )


def _unlike(error: float, codes: set[str]) -> str:
    known = [code for code in ("unit_suspect", "not_physical", "over_fitted") if code in codes]
    return (
        f"it predicts another motion's torques to {error:.0f} % only (moving joints): check "
        "mounting, drive gains and the order of the joints"
        + (f"; see {', '.join(known)}" if known else "")
    )


def verdict(result: Identification) -> Verdict:
    """Judge an identification."""
    found = {f.kind: f for f in result.warnings if f.severity != "info"}
    codes = {f.code for f in found.values()}
    errors = {kind: f for kind, f in found.items() if f.severity == "error"}
    fit = result.training.moving.relative_error_overall_percent
    inputs = tuple(f.text for kind, f in errors.items() if kind not in EXCITATION)
    if inputs:
        return Verdict(level="do_not_use", reasons=inputs)
    if not fit <= UNEXPLAINED:
        return Verdict(level="do_not_use", reasons=(_unexplained(fit),))
    # A mounting that was set straight is called ill_conditioned as well, and forbids nothing.
    ill = "ill_conditioned" in errors
    error = np.inf
    if result.validation is not None:
        error = result.validation.moving.relative_error_overall_percent
    seen = "same_record" in found
    what = "reproduces its own record's" if seen else "predicts another motion's"
    predicts = f"it {what} torques to {error:.1f} % (moving joints)"
    if "low_excitation" in codes or (ill and not error <= POOR_PREDICTION):
        poor = ["the motion does not tell its parameters apart (ill_conditioned)"] if ill else []
        if "low_excitation" in codes:
            poor.append("the motion excites too little (low_excitation)")
        return Verdict(level="do_not_use", reasons=tuple(poor))
    if result.validation is not None and not seen and error > UNEXPLAINED:
        return Verdict(level="do_not_use", reasons=(_unlike(error, codes),))
    doubts = ["only for motions like these: single values mean nothing (ill_conditioned)"] * ill
    care = sorted(codes & CARE)
    if care:
        doubts.append(f"see the warning{'s' * (len(care) > 1)} {', '.join(care)}")
    if result.validation is None or seen:
        doubts.append("no other motion has confirmed it yet (--validate)")
        return Verdict(level="care", reasons=tuple(doubts))
    if doubts or not error <= POOR_PREDICTION:
        return Verdict(level="care", reasons=(predicts, *doubts))
    return Verdict(level="usable", reasons=(predicts, "the motion tells its parameters apart"))
