"""`dynid validate`: an estimate against a recording, from their files."""

from __future__ import annotations

from pathlib import Path

from dynid.validation.prediction import ValidationResult, validate
from dynid.workflow.recordings import open_record
from dynid.workflow.temperature_file import estimate_at


def validate_files(
    estimate: str | Path,
    recording: str | Path,
    *,
    start_s: float | None = None,
    stop_s: float | None = None,
    at_degC: float | None = None,
) -> ValidationResult:
    """Predict the torques of a recording and measure the error.

    Args:
        estimate: An estimate's JSON file; it carries its robot.
        recording: A recording, ours or foreign.
        start_s: Start of the window [s].
        stop_s: End of the window [s].
        at_degC: Temperature of all joints, where the file holds temperature laws [degC].

    Raises:
        InputError: Files that cannot be read, or do not belong together.
    """
    known = estimate_at(estimate, at_degC)
    record = open_record(recording, known.model.robot)
    return validate(known, record, start_s=start_s, stop_s=stop_s)
