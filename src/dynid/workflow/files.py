"""From files to files: `dynid identify`, `dynid validate`, and `dynid fit`, the whole job."""

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid import core, recording, signals
from dynid.export import ExportedFile, write_model
from dynid.identification import Estimate, open_estimate, write_estimate
from dynid.recording import AnyRecording, ExperimentRecord, RecordLike, open_record
from dynid.robot import RobotLike, load_robot
from dynid.settings import IdentifySettings
from dynid.validation import REFIT, ValidationResult, refit_friction, samples_of, validate
from dynid.workflow.identify import Identification, Verdict, identify, verdict
from dynid.workflow.recordings import known_gains, of_robot, robot_of
from dynid.workflow.reporting import MODELS, report


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
    jobs: int = 1,
    dask: str | None = None,
    progress: core.Progress | None = None,
) -> Identification:
    """Identify from recordings, validate if asked to, write the estimate if told where.

    As `identify`, from paths or URLs of an object store; None stands for the robot that they say.
    With a window alone, the validation is of the one recording that was given. `gains` (n)
    [N.m/A] override those of the recordings and of the robot; `jobs` or the workers of a Dask
    scheduler sum long recordings.

    Raises:
        InputError: Files that cannot be read or do not belong together, unknown settings.
        JobError: A singular problem.
    """
    others = [] if validation is None else [validation]
    with recording.local_files([*recordings, *others]) as paths:
        files = paths[: len(recordings)]
        model = robot_of(files, robot)
        records = recording.open_any(files, model, gains)
        if gains is not None:
            # Remembered with the estimate, for recordings of the robot that are without.
            model = replace(model, drives=replace(model.drives, gain=np.array(gains)))
        other: ExperimentRecord | None = None
        if validation is not None:
            other = open_record(paths[-1], model, gains)
        elif validation_start_s is not None or validation_stop_s is not None:
            if len(records) > 1:
                raise core.InputError(
                    "a validation window needs a recording",
                    value=f"{len(records)} recordings",
                    next_step="Name it with --validate RECORD.",
                )
            with _of_validation():
                signals.ProcessingSettings(start_s=validation_start_s, stop_s=validation_stop_s)
                other = _window_of(records[0], validation_start_s, validation_stop_s)
            if not isinstance(records[0], ExperimentRecord):
                validation_start_s = validation_stop_s = None
        if other is not None:
            # A wrong window must not cost the time of an identification first.
            with _of_validation():
                signals.ProcessingSettings(start_s=validation_start_s, stop_s=validation_stop_s)
                signals.window(other.t, validation_start_s, validation_stop_s)
        with core.workers(jobs, dask) as beside:
            result = identify(
                records,
                model,
                settings,
                validation=other,
                validation_start_s=validation_start_s,
                validation_stop_s=validation_stop_s,
                partial=None if output is None else f"{output}.partial",
                beside=beside,
                progress=progress,
            )
        if output is not None:
            write_estimate(result.estimate, output)
        return result


@contextmanager
def _of_validation() -> Generator[None]:
    """What is wrong with a window is told of the options of the validation."""
    try:
        yield
    except core.InputError as error:
        raise error.changed(where="--validate-from, --validate-to") from error


def _window_of(
    record: AnyRecording, start_s: float | None, stop_s: float | None
) -> ExperimentRecord:
    """A recording whose window can be validated: of a stored one, the window alone."""
    if isinstance(record, ExperimentRecord):
        return record
    grid = signals.survey(record, start_s, stop_s)
    if grid.last_row - grid.first_row > recording.LONG:
        raise core.InputError(
            "the window is too long to be predicted at once",
            where="--from, --to",
            value=f"{grid.last_row - grid.first_row} rows",
            limit=f"{recording.LONG} rows",
        )
    return signals.rows_of(record, grid.first_row, grid.last_row)


def validate_files(
    estimate: str | Path,
    recording: str | Path,
    *,
    start_s: float | None = None,
    stop_s: float | None = None,
    at_degC: float | None = None,
    gains: Sequence[float] | None = None,
    refit: str | None = None,
    output: str | Path | None = None,
) -> ValidationResult:
    """Predict the torques of a recording, or of a window of it [s], and measure the error.

    All joints are at a temperature [degC] where the file holds temperature laws. `gains` (n)
    [N.m/A] override those of the recording and of the robot. With `refit`, which is `friction`,
    friction is taken from this recording first, and the refitted estimate written if told where.

    Raises:
        InputError: Files that cannot be read, or do not belong together.
    """
    core.check_word(refit or "friction", ("friction",), "--refit")
    if output is not None and refit is None:
        raise core.InputError(
            "nothing to write without --refit", where="--output", value=str(output)
        )
    known = open_estimate(estimate, at_degC)
    record = open_record(recording, known.model.robot, gains)
    # What is new: of the refit, and of a temperature beyond the recordings.
    before = known.warnings if at_degC is None else ()
    if refit is not None:
        known = _refitted(known, record, start_s, stop_s)
        if output is not None:
            write_estimate(known, output)
    found = validate(known, record, start_s=start_s, stop_s=stop_s)
    new = [one for one in known.warnings if one not in before]
    return replace(found, warnings=tuple(dict.fromkeys([*new, *found.warnings])))


def _refitted(
    estimate: Estimate, record: ExperimentRecord, start_s: float | None, stop_s: float | None
) -> Estimate:
    """The estimate with this recording's friction; it tells where that comes from."""
    found = refit_friction(estimate, samples_of(estimate, record, start_s=start_s, stop_s=stop_s))
    name, made = record.metadata.origin or "the recording", estimate.provenance
    start, stop = start_s or 0.0, record.duration_s if stop_s is None else stop_s
    rows = {"record": recording.fingerprint(record), "start_s": start, "stop_s": stop}
    whole = start_s is None and stop_s is None
    words = f"friction refitted to {name}{'' if whole else f', {start:g} s to {stop:g} s'}"
    return replace(
        found,
        choices=(*found.choices, words),
        provenance=core.provenance(made.inputs, {**made.settings, REFIT: rows}, made.seed),
    )


ESTIMATE = "estimate.json"
REPORT = "report.html"
UNFINISHED = "unfinished.txt"
"""Stands in the folder of a fit or a demo until it has ended."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogFit:
    """What was identified from logs, and the files written."""

    identification: Identification
    """The estimate with its errors."""
    verdict: Verdict
    """By purpose."""
    gains_from: tuple[str, ...]
    """Where the drive gains of each log come from: `effort` (none needed), `recording`, `robot`,
    `targets` (found in the log) or `given`."""
    records: tuple[Path, ...]
    """The logs as recordings of dynid; the last one is the validation log, where there is one."""
    estimate: Path
    """Its file."""
    models: tuple[ExportedFile, ...]
    """The written models."""
    not_exported: tuple[tuple[str, str], ...]
    """Formats that cannot represent this model, each with the reason."""
    report: Path
    """The page."""

    def to_json(self) -> dict[str, Any]:
        """The object that `--json` prints: the keys of `identify`, the verdict and the files."""
        return {
            **self.identification.to_json(),
            "verdict": self.verdict.to_json(),
            "gains_from": list(self.gains_from),
            "records": [str(path) for path in self.records],
            "estimate": str(self.estimate),
            "models": [export.to_json() for export in self.models],
            "not_exported": dict(self.not_exported),
            "report": str(self.report),
        }


def fit(
    robot: RobotLike,
    logs: RecordLike | Sequence[RecordLike],
    output: str | Path,
    *,
    validation: RecordLike | None = None,
    gains: Sequence[float] | None = None,
    settings: IdentifySettings | None = None,
    progress: core.Progress | None = None,
) -> LogFit:
    """Identify a robot from logs at hand: import, identify, validate, export and report.

    Args:
        robot: Built-in name, URDF file, robot file or model.
        logs: Recordings, or their files in any format that `dynid import` reads without options,
            or folders with the text files of one run.
        output: Folder for recordings, estimate, models and report; made if it is missing.
        validation: Another log, which the identified model has to predict.
        gains: (n) drive gains [N.m/A]; None: those of the recording or of the robot, or else from
            the target currents and moments in the log.
        settings: How to identify; None: preset best.
        progress: Told what is being done and how far it is (0 to 1).

    Raises:
        InputError: A robot or logs that cannot be read, no drive gains, or a folder that cannot
            be written.
        JobError: A singular problem, or a full disk.
    """
    tell = progress or core.silent
    given = recording.as_list(logs)
    if not given:
        raise core.InputError("needs at least one log")
    model = load_robot(robot, collision=False)
    kinds = ["log"] if len(given) == 1 else [f"log{k + 1}" for k in range(len(given))]
    read = dict(zip(kinds, given, strict=True))
    if validation is not None:
        read["validation"] = validation
    names = {
        kind: kind
        if isinstance(log, ExperimentRecord)
        else f"{kind}_{recording.recording_name(log)}"
        for kind, log in read.items()
    }
    paths = [Path(output) / f"{name}.parquet" for name in names.values()]
    folder = _folder(output, paths)
    records: list[ExperimentRecord] = []
    sources: list[str] = []
    for k, (kind, log) in enumerate(read.items()):
        tell(f"read {names[kind].removeprefix(f'{kind}_')}", 0.1 * k / (len(given) + 1))
        record, source = known_gains(open_record(log, model, gains), model)
        records.append(record)
        sources.append("given" if gains is not None and source == "recording" else source)
    other = None if validation is None else records[-1]
    result = identify(
        records[: len(given)],
        model,
        settings,
        validation=other,
        progress=lambda what, share: tell(what, 0.1 + 0.6 * share),
    )
    unfinished = folder / UNFINISHED
    core.write_text(
        unfinished, "The fit that wrote these files has not ended: the next replaces them.\n"
    )
    for record, path in zip(records, paths, strict=True):
        recording.write_record(of_robot(record, robot), path)
    write_estimate(result.estimate, folder / ESTIMATE)
    exports: list[ExportedFile] = []
    failed: list[tuple[str, str]] = []
    for k, (to, name) in enumerate(MODELS.items()):
        tell(f"write {name}", 0.7 + 0.05 * k)
        try:
            exports.append(write_model(result.estimate, folder / name, to))
        except core.DynidError as error:
            failed.append((to, error.line))
    page, _ = report(
        folder, folder / REPORT, progress=lambda what, share: tell(what, 0.85 + 0.15 * share)
    )
    unfinished.unlink(missing_ok=True)
    return LogFit(
        identification=result,
        verdict=verdict(result),
        gains_from=tuple(sources),
        records=tuple(paths),
        estimate=folder / ESTIMATE,
        models=tuple(exports),
        not_exported=tuple(failed),
        report=page,
    )


def _folder(output: str | Path, recordings: Sequence[Path]) -> Path:
    folder = core.make_folder(output)
    written = (*(path.name for path in recordings), ESTIMATE, REPORT, *MODELS.values())
    taken = [name for name in written if (folder / name).exists()]
    if (folder / UNFINISHED).exists():
        for name in taken:
            (folder / name).unlink()
    elif taken:
        raise core.InputError(
            "the folder already holds results, and nothing is replaced",
            where="-o",
            value=f"{folder}: {', '.join(taken)}",
            next_step="Name another folder, or move these files away.",
        )
    return folder
