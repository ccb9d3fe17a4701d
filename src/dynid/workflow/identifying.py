"""`dynid identify`: from the files of recordings to an estimate in a file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from dynid.core.errors import InputError
from dynid.core.progress import Progress
from dynid.identification.estimate_file import write_estimate
from dynid.recording.record import ExperimentRecord
from dynid.signals.resample import window
from dynid.workflow.identify import Identification, identify
from dynid.workflow.identify_settings import IdentifySettings
from dynid.workflow.recordings import open_record, open_records


def identify_files(
    recordings: Sequence[str | Path],
    output: str | Path | None = None,
    *,
    robot: str | Path | None = None,
    settings: IdentifySettings | None = None,
    validation: str | Path | None = None,
    validation_start_s: float | None = None,
    validation_stop_s: float | None = None,
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
        progress: Told what is being done and how far it is (0 to 1).

    Raises:
        InputError: Files that cannot be read or do not belong together, unknown settings.
        JobError: A singular problem.
    """
    records, model = open_records(recordings, robot)
    other: ExperimentRecord | None = None
    if validation is not None:
        other = open_record(validation, model)
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
