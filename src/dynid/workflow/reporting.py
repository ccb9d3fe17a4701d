"""`dynid report`: what lies in a directory becomes one page."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from dynid.core.errors import DynidError, InputError
from dynid.core.progress import Progress, silent
from dynid.identification.estimate import Estimate
from dynid.identification.estimate_file import FORMAT, read_estimate
from dynid.recording.parquet import read_record
from dynid.recording.record import ExperimentRecord
from dynid.report.contents import ReportContents, ReportedDesign, ReportedEstimate
from dynid.report.page import write_report
from dynid.validation.comparison import ParameterComparison, compare
from dynid.workflow.reported_design import reported_design
from dynid.workflow.reported_estimate import reported_estimate

MOST_ESTIMATES = 6
"""A page with more would no longer be light."""
MAX_JSON = 64 << 20


@dataclass(frozen=True, slots=True, kw_only=True)
class _Found:
    estimates: dict[str, Estimate]
    records: dict[str, ExperimentRecord]
    designs: tuple[ReportedDesign, ...]
    skipped: tuple[tuple[str, str], ...]


def report(
    directory: str | Path, output: str | Path, *, progress: Progress | None = None
) -> tuple[Path, ReportContents]:
    """Write a page about the estimates, recordings and designs in a directory.

    An estimate knows its recording by its hash; other recordings of the same robot validate it, or
    else the stretch of its own that `--from` and `--to` left out.

    Args:
        directory: Where the files are.
        output: The page to write.
        progress: Told what is being done and how far it is (0 to 1).

    Raises:
        InputError: No such directory, no estimate in it, or a place where no page can be.
        JobError: The disk does not take the page.
    """
    folder = Path(directory)
    if not folder.is_dir():
        raise InputError(
            "this is a file, and a report is of a directory"
            if folder.exists()
            else "there is no such directory",
            where=str(directory),
            next_step=f"Run: dynid report {folder.parent}" if folder.exists() else None,
        )
    tell: Progress = progress or silent
    found = _search(folder, tell)
    if not found.estimates:
        raise InputError(
            "there is no estimate in the directory",
            where=str(directory),
            next_step="Write one: dynid identify RECORD -o " + str(folder / "estimate.json"),
        )
    chosen = dict(itertools.islice(found.estimates.items(), MOST_ESTIMATES))
    estimates: list[ReportedEstimate] = []
    for k, (name, estimate) in enumerate(chosen.items()):
        tell(f"predict with {name}", 0.3 + 0.5 * k / len(chosen))
        estimates.append(reported_estimate(name, estimate, found.records))
    tell("write the page", 0.9)
    contents = ReportContents(
        title=f"{estimates[0].estimate.model.robot.name}: identified dynamics",
        directory=folder,
        estimates=tuple(estimates),
        designs=found.designs,
        comparisons=tuple(_comparisons(estimates)),
        skipped=(
            *found.skipped,
            *((name, "too many estimates") for name in list(found.estimates)[MOST_ESTIMATES:]),
        ),
    )
    return write_report(contents, output), contents


def _search(folder: Path, tell: Progress) -> _Found:
    estimates: dict[str, Estimate] = {}
    records: dict[str, ExperimentRecord] = {}
    designs: list[ReportedDesign] = []
    skipped: list[tuple[str, str]] = []
    for path in sorted(folder.glob("*.json")) + sorted(folder.glob("*.parquet")):
        tell(f"read {path.name}", 0.1)
        try:
            if path.suffix == ".parquet":
                records[path.name] = read_record(path)
                continue
            kind = _kind(path)
            if kind == FORMAT:
                estimates[path.name] = read_estimate(path)
            elif kind == "trajectory":
                designs.append(reported_design(path))
        except DynidError as error:
            skipped.append((path.name, str(error)))
    return _Found(
        estimates=estimates, records=records, designs=tuple(designs), skipped=tuple(skipped)
    )


def _kind(path: Path) -> str:
    """What a JSON file holds; empty for anything else."""
    if path.stat().st_size > MAX_JSON:
        return ""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return ""
    if not isinstance(document, dict):
        return ""
    fields: dict[str, object] = document  # pyright: ignore[reportUnknownVariableType]
    if fields.get("format") == FORMAT:
        return FORMAT
    kind = str(fields.get("kind", ""))
    return "trajectory" if kind.startswith("dynid.") else ""


def _comparisons(
    estimates: list[ReportedEstimate],
) -> Iterator[tuple[str, str, ParameterComparison]]:
    for first, second in itertools.pairwise(estimates):
        try:
            yield first.name, second.name, compare(first.estimate, second.estimate)
        except InputError:
            # Estimates of other robots or terms stand side by side without a comparison.
            continue
