"""`dynid report`: what lies in a directory becomes one page.

A design is judged over time; an estimate stands beside its record and beside what confirms it.
"""

import itertools
import shlex
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dynid import constraints, core, diagnosis, reduction
from dynid import report as pages
from dynid.identification import FORMAT, Estimate, read_estimate, standard_posterior
from dynid.recording import ExperimentRecord, identity, open_record, read_record
from dynid.robot import move
from dynid.validation import ParameterComparison, ValidationResult, compare, reproduce, validate
from dynid.workflow import design_files, running
from dynid.workflow.identify import Identification, over_fitted, verdict

MODELS = {"urdf": "model.urdf", "mjcf": "model.xml", "c": "model.h"}
"""What `dynid fit` calls the models that it writes, by format."""
SAMPLES = 200
KINDS = ("torque", "tcp_speed", "elbow_speed", "momentum", "power")
FACTS = {
    "criterion": "criterion",
    "method": "method",
    "condition_number": "condition number",
    "feasible": "feasible",
    "evaluations": "objective evaluations",
    "wall_s": "time of the search [s]",
    "seed": "seed",
}


def _reported_design(path: Path) -> pages.ReportedDesign:
    """Read a design or a trajectory and judge it at instants."""
    found = design_files.read_design(path)
    stored, facts = found.stored, found.facts
    return pages.ReportedDesign(
        name=path.name,
        trajectory=stored.trajectory,
        robot=found.robot,
        bounds=stored.limits,
        facts=(
            ("duration", f"{stored.trajectory.duration:g} s"),
            *((words, _text(facts[name])) for name, words in FACTS.items() if name in facts),
        ),
        search=_search(facts.get("history")),
        judged=_judged(found),
    )


def _text(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _search(history: Any) -> tuple[core.Array, core.Array] | None:
    """Evaluations and the best criterion so far; None where a file does not hold them."""
    try:
        table = np.array([(row["evaluations"], row["value"]) for row in history], dtype=np.float64)
    except (TypeError, KeyError, ValueError):
        return None
    return None if len(table) < 2 else (table[:, 0], np.fmin.accumulate(table[:, 1]))


def _judged(found: design_files.StoredDesign) -> pages.JudgedMotion | None:
    if found.limits is None:
        return None
    judge = found.limits.constraints(found.robot)
    t = _instants(found)
    motion = found.stored.trajectory.evaluate(t)
    rows = zip(motion.q[:, None], motion.dq[:, None], motion.ddq[:, None], strict=True)
    worst = [judge.usage(*row) for row in rows]
    shares = {kind: np.array([1.0 - item[kind].margin for item in worst]) for kind in KINDS}
    # Each pair has a clearance of its own: beyond it, one line at zero is the limit of all.
    gaps = {kind: np.array([item[kind].room for item in worst]) for kind in constraints.DISTANCES}
    return pages.JudgedMotion(t=t, shares=shares, distances=gaps)


def _instants(found: design_files.StoredDesign) -> core.Array:
    """When to judge: evenly, and where the certificate of the design is tightest."""
    duration = found.stored.trajectory.duration
    worst: Any = found.facts.get("worst")
    rows: list[Any] = list(worst.values()) if isinstance(worst, dict) else []  # pyright: ignore
    tight: list[Any] = [row.get("t") for row in rows if isinstance(row, dict)]  # pyright: ignore
    known = [float(t) for t in tight if isinstance(t, int | float) and 0.0 <= t <= duration]
    return np.union1d(np.linspace(0.0, duration, SAMPLES), known)


SHORTEST_REST_S = 2.0
"""A shorter stretch of a record, left out by `--from` or `--to`, confirms nothing."""


class _Partner(NamedTuple):
    """A motion that an estimate was not identified from, and which window of it [s]."""

    name: str
    record: ExperimentRecord
    start_s: float | None = None
    stop_s: float | None = None


def _reported_estimate(
    path: Path, estimate: Estimate, records: Mapping[str, ExperimentRecord]
) -> pages.ReportedEstimate:
    """Predict an estimate's own record (known by its hash) and another motion, and judge it."""
    inputs = set(estimate.provenance.inputs.values())
    own = {key: record for key, record in records.items() if identity(record) in inputs}
    findings = estimate.warnings
    base = reduction.reduce_model(estimate.model)
    item = pages.ReportedEstimate(
        name=path.name,
        label=f"preset {estimate.preset}",
        estimate=estimate,
        base=base,
        # An estimate of other columns, such as one with temperatures, has no such mapping.
        links=standard_posterior(estimate, base)
        if tuple(base.independent) == tuple(estimate.independent)
        else None,
        truth=_truth([path.parent / key for key in own], estimate),
    )
    if not own:
        return replace(item, warnings=findings)
    key, record = next(iter(own.items()))
    training = reproduce(estimate, record)
    # A log is there for the estimate that names it: it may be of the same motion on another day.
    others = {name: one for name, one in records.items() if name.endswith(".parquet")}
    partner, validation = _partner(estimate, own, others), None
    if partner is not None:
        _, other, start_s, stop_s = partner
        validation = validate(estimate, other, start_s=start_s, stop_s=stop_s)
        findings = (*findings, *validation.warnings, *over_fitted(training, validation))
    findings = tuple(dict.fromkeys(findings))
    judged = Identification(
        estimate=estimate, training=training, validation=validation, warnings=findings
    )
    thermal = record.metadata.extra.get("thermal")
    return replace(
        item,
        label=", ".join(filter(None, (thermal, f"preset {estimate.preset}"))),
        verdict=verdict(judged),
        warnings=findings,
        training=training,
        training_name=key,
        validation=validation,
        validation_name="" if partner is None else partner.name,
        conditions=_conditions(record),
        tested=() if partner is None else _conditions(partner.record),
        events=_events(estimate, validation or training),
    )


def _conditions(record: ExperimentRecord) -> tuple[str, ...]:
    """What a recording is, in words: how long, how fast, how often, how warm, what it carries."""
    extra = record.metadata.extra
    lasted = float(record.t[-1] - record.t[0])
    words = [f"{lasted:.0f} s", f"{record.rate_hz:.0f} Hz"]
    # Those that were asked for, unless it was stopped before.
    periods = int((lasted + 1.5 / record.rate_hz) / float(extra.get("period_s", "inf")))
    if periods > 1:
        words.append(f"{periods} periods")
    known = record.signals.get("temperature")
    if known is not None:
        words.append(f"joints at {float(np.mean(known)):.0f} °C")
    if "payload_kg" in extra:
        mass = float(extra["payload_kg"])
        words.append(f"payload {mass:g} kg" if mass else "no payload")
    return tuple(words)


def _truth(recordings: list[Path], estimate: Estimate) -> pages.KnownTruth | None:
    """What a simulation wrote beside a recording, in the estimate's frames."""
    robot = estimate.model.robot
    for file in filter(Path.exists, map(running.truth_path, recordings)):
        with suppress(core.InputError):
            rows = core.load_object(file).matrix("links")
            if rows.shape == (robot.joints, 13):
                inverses = np.linalg.inv(robot.parameter_frames[estimate.model.frames])
                links = [move(row[:10], turn) for row, turn in zip(rows, inverses, strict=True)]
                return pages.KnownTruth(
                    inertials=np.array(links), coulomb=rows[:, 10], viscous=rows[:, 11]
                )
    return None


def _events(estimate: Estimate, shown: ValidationResult) -> pages.Events:
    """Contacts in what is shown, and stretches without samples."""
    steps = np.diff(shown.t)
    usual = float(np.median(steps)) if len(steps) else 0.0
    gaps = np.flatnonzero(steps > max(5 * usual, 0.05))
    contacts: tuple[tuple[float, float], ...] = ()
    if any(finding.code == "contact" for finding in (*estimate.warnings, *shown.warnings)):
        known = dict(zip(estimate.names, estimate.values, strict=True))
        robot = estimate.model.robot
        held = np.array([abs(known.get(f"Fc{j + 1}", 0.0)) for j in range(robot.joints)])
        error = shown.measured - shown.predicted
        contacts = diagnosis.contact_stretches(robot, shown.t, shown.dq, error, held)
    left_out = tuple((float(shown.t[k]), float(shown.t[k + 1])) for k in gaps)
    return pages.Events(contacts=contacts, left_out=left_out)


def _partner(
    estimate: Estimate,
    own: Mapping[str, ExperimentRecord],
    records: Mapping[str, ExperimentRecord],
) -> _Partner | None:
    """The likeliest other record: as warm, named so, else the first; or the rest of its own."""
    robot = estimate.model.robot
    thermal = {record.metadata.extra.get("thermal") for record in own.values()}
    others = [
        (record.metadata.extra.get("thermal") not in thermal, "valid" not in key, key)
        for key, record in records.items()
        if key not in own
        and record.joints == robot.joints
        and _may_be(record.metadata.robot, robot.name)
    ]
    if others:
        _, _, key = min(others)
        return _Partner(key, records[key])
    key, record = next(iter(own.items()))
    return _rest(estimate, key, record)


def _rest(estimate: Estimate, name: str, record: ExperimentRecord) -> _Partner | None:
    """The longer stretch of its record that an estimate was not identified from, if any."""
    start, stop = estimate.settings.start_s, estimate.settings.stop_s
    before = start or 0.0
    after = 0.0 if stop is None else float(record.t[-1] - record.t[0]) - stop
    if max(before, after) < SHORTEST_REST_S:
        return None
    if before > after:
        return _Partner(f"{name} up to {before:g} s", record, stop_s=start)
    return _Partner(f"{name} from {stop:g} s on", record, start_s=stop)


def _may_be(recorded: str | None, name: str) -> bool:
    """Whether a recording can be of the robot: a path says less than a built-in name."""
    return recorded is None or recorded == name or not recorded.isalnum()


MOST_ESTIMATES = 6
"""A page with more would no longer be light."""


class _Found(NamedTuple):
    estimates: dict[str, Estimate]
    records: dict[str, ExperimentRecord]
    designs: list[pages.ReportedDesign]
    skipped: list[tuple[str, str]]


def report(
    directory: str | Path, output: str | Path, *, progress: core.Progress | None = None
) -> tuple[Path, pages.ReportContents]:
    """Write a page about the estimates, recordings and designs in a directory.

    An estimate knows its recording by its hash; other recordings of the same robot validate it, or
    else the stretch of its own that `--from` and `--to` left out.

    Raises:
        InputError: No such directory, no estimate in it, or a place where no page can be.
        JobError: The disk does not take the page.
    """
    folder = Path(directory)
    if not folder.is_dir():
        what, step = "there is no such directory", core.like_named(folder)
        if folder.exists():
            what = "this is a file, and a report is of a directory"
            step = f"Run: dynid report {shlex.quote(str(folder.parent))}"
        raise core.InputError(what, where=str(directory), next_step=step)
    tell: core.Progress = progress or core.silent
    found = _reporting_search(folder, tell)
    if not found.estimates:
        raise core.InputError(
            "there is no estimate in the directory",
            where=str(directory),
            next_step="Write one: dynid identify RECORD -o " + str(folder / "estimate.json"),
        )
    chosen = dict(itertools.islice(found.estimates.items(), MOST_ESTIMATES))
    many = f"a page shows {MOST_ESTIMATES} estimates at most"
    estimates: list[pages.ReportedEstimate] = []
    for k, (name, estimate) in enumerate(chosen.items()):
        tell(f"predict with {name}", 0.3 + 0.5 * k / len(chosen))
        estimates.append(_reported_estimate(folder / name, estimate, found.records))
    tell("write the page", 0.9)
    # Of one preset and one thermal state, the file tells which.
    often = Counter(item.label for item in estimates)
    estimates = [
        item if often[item.label] == 1 else replace(item, label=f"{item.label} ({item.name})")
        for item in estimates
    ]
    compared = tuple(_comparisons(estimates))
    estimates.sort(key=_decides)
    contents = pages.ReportContents(
        robot=_robot_name(estimates[0], found.records),
        date=_date(estimates[0].estimate.provenance.created),
        directory=folder,
        estimates=tuple(estimates),
        designs=tuple(found.designs),
        comparisons=compared,
        models=tuple(name for name in MODELS.values() if (folder / name).exists()),
        skipped=(
            *found.skipped,
            *((name, many) for name in found.estimates if name not in chosen),
        ),
    )
    return pages.write_report(contents, output), contents


def _reporting_search(folder: Path, tell: core.Progress) -> _Found:
    found = _Found({}, {}, [], [])
    for path in sorted(folder.glob("*.json")) + sorted(folder.glob("*.parquet")):
        tell(f"read {path.name}", 0.1)
        try:
            if path.suffix == ".parquet":
                found.records[path.name] = read_record(path)
                continue
            fields = core.JsonFields({})
            with suppress(core.InputError):
                fields = core.load_object(path)
            if fields.get("format") == FORMAT:
                found.estimates[path.name] = read_estimate(path)
            elif str(fields.get("kind")).startswith("dynid."):
                found.designs.append(_reported_design(path))
        except core.DynidError as error:
            found.skipped.append((path.name, error.line))
    # Logs of other programs that were identified from as they are.
    for estimate in found.estimates.values():
        robot = estimate.model.robot
        gains = robot.drives.gain.tolist() if np.isfinite(robot.drives.gain).all() else None
        for name in estimate.provenance.inputs:
            if (folder / name).is_file() and name not in found.records:
                with suppress(core.DynidError):
                    record = open_record(folder / name, robot, gains)
                    if gains or "effort" in record.signals:
                        found.records[name] = record
    return found


def _comparisons(
    estimates: list[pages.ReportedEstimate],
) -> Iterator[tuple[str, str, ParameterComparison]]:
    for first, second in itertools.pairwise(estimates):
        try:
            yield first.label, second.label, compare(first.estimate, second.estimate)
        except core.InputError:
            # Estimates of other robots or terms stand side by side without a comparison.
            continue


def _decides(item: pages.ReportedEstimate) -> tuple[bool, float, str]:
    """The estimate that the page is about comes first: chosen settings, then the smallest error."""
    error = np.inf if item.errors is None else item.errors.moving
    return item.estimate.preset != "best", error, item.name


def _robot_name(item: pages.ReportedEstimate, records: Mapping[str, ExperimentRecord]) -> str:
    """The robot for people: what its controller calls it, or else its name without folders."""
    record = records.get(item.training_name)
    model = None if record is None else record.metadata.extra.get("model")
    name = item.estimate.model.robot.name
    return model or (name.upper() if name.startswith("ur") and len(name) <= 5 else Path(name).stem)


def _date(created: str) -> str:
    try:
        made = datetime.fromisoformat(created)
    except ValueError:
        return created
    return f"{made.day} {made:%B %Y, %H:%M}"
