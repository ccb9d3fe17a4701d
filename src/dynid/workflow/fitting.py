"""`dynid fit`: the whole job on logs at hand, to models and a report."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dynid import recording
from dynid.core import DynidError, InputError, Progress, make_folder, silent
from dynid.export import ExportedFile, write_model
from dynid.identification import write_estimate
from dynid.robot import RobotLike, load_robot
from dynid.settings import IdentifySettings
from dynid.workflow.identify import Identification, identify
from dynid.workflow.recordings import known_gains, of_robot
from dynid.workflow.reporting import report
from dynid.workflow.validating import Verdict, verdict

MODELS = {"urdf": "model.urdf", "mjcf": "model.xml", "c": "model.h"}
"""The models that are written, by format."""
ESTIMATE = "estimate.json"
REPORT = "report.html"


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
    logs: recording.RecordLike | Sequence[recording.RecordLike],
    output: str | Path,
    *,
    validation: recording.RecordLike | None = None,
    gains: Sequence[float] | None = None,
    settings: IdentifySettings | None = None,
    progress: Progress | None = None,
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
    tell = progress or silent
    given = recording.as_list(logs)
    if not given:
        raise InputError("needs at least one log")
    model = load_robot(robot)
    folder = _folder(output)
    records: list[recording.ExperimentRecord] = []
    sources: list[str] = []
    paths: list[Path] = []
    others = [] if validation is None else [validation]
    for k, log in enumerate([*given, *others]):
        kind = "validation" if k >= len(given) else f"log{k + 1}" if len(given) > 1 else "log"
        name = "" if isinstance(log, recording.ExperimentRecord) else Path(log).stem
        tell(f"read {name or kind}", 0.1 * k / (len(given) + 1))
        record, source = known_gains(recording.open_record(log, model, gains), model)
        records.append(record)
        sources.append("given" if gains is not None and source == "recording" else source)
        paths.append(folder / f"{f'{kind}_{name}' if name else kind}.parquet")
    other = None if validation is None else records[-1]
    result = identify(
        recording.checked_records(records[: len(given)]),
        model,
        settings,
        validation=other,
        progress=lambda what, share: tell(what, 0.1 + 0.6 * share),
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
        except DynidError as error:
            failed.append((to, str(error)))
    page, _ = report(
        folder, folder / REPORT, progress=lambda what, share: tell(what, 0.85 + 0.15 * share)
    )
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


def _folder(output: str | Path) -> Path:
    folder = make_folder(output)
    taken = [name for name in (ESTIMATE, REPORT, *MODELS.values()) if (folder / name).exists()]
    if taken:
        raise InputError(
            "the folder already holds results, and nothing is replaced",
            where="-o",
            value=f"{folder}: {', '.join(taken)}",
            next_step="Name another folder, or move these files away.",
        )
    return folder
