"""The recordings of a fleet, and their statistics, cached by content."""

import csv
import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path, PurePath, PurePosixPath
from typing import Any

import numpy as np

from dynid import core, identification, recording, reduction, regressor
from dynid.robot import load_robot, robot_to_json
from dynid.signals import ProcessingSettings, process
from dynid.workflow.recordings import known_gains, stored_robot

SCHEME = 5
"""Of what is cached; another number makes all of it new."""
MANIFEST = "manifest.csv"
COLUMNS = ("file", "robot", "model", "time", "temperature_degC")
SUFFIXES = frozenset(
    (".parquet", ".csv", ".tsv", ".txt", ".mat", ".npz", ".db3", ".mcap", ".bag", ".h5", ".hdf5")
)
_DAY = re.compile(r"\d{4}-\d{2}-\d{2}(?:[T_ ]\d{2}[:-]?\d{2}(?:[:-]?\d{2})?)?")
ROBOT_KEYS, TIME_KEYS = ("robot_id", "serial"), ("time", "created")
"""Entries of a recording's metadata (`extra`) that name the individual and the time."""
EPOCH_FROM_S = 1e8
"""First stamps from here on are seconds since 1970, smaller ones count from anything."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetRecording(core.Value):
    """One recording of a fleet, and what it contributes."""

    path: str = ""
    """Relative to the folder; not yet known of one that was computed or cached."""
    robot: str
    """The individual."""
    model: str
    """Built-in name, URDF or robot file."""
    mount: str | None
    """How the arm was mounted; None for as in its file."""
    time_s: float
    """When it was made, seconds since 1970; NaN where nobody says."""
    temperature_degC: core.Array
    """(n) mean joint temperatures; NaN where nobody says."""
    signals: str
    """Hash of positions and torques: copies may have other stamps."""
    statistics: identification.RecordStatistics
    computed: bool
    """Whether it was computed now, not taken from the cache."""


def read_folder(
    folder: str | Path,
    cache: Path,
    *,
    model: str | None,
    terms: str,
    beside: core.Workers,
    progress: core.Progress,
) -> tuple[list[FleetRecording], list[tuple[str, str]]]:
    """Statistics of all recordings below a folder; only those not in the cache are computed.

    Robot, model, time and temperature come from the recording's metadata (`extra`: `robot_id` or
    `serial`, `time`; temperature channels), else from the row of the file in `manifest.csv`, else
    robot and day from the names of folder and file.

    The folder (a path, or the URL of an object store) holds `ROBOT/DAY/FILE`, or what a manifest
    says; `model` is the robot of recordings that name none.

    Returns:
        The recordings in the order of robots, then times; files left out, and why.

    Raises:
        InputError: No such folder, a manifest that cannot be read, or a cache that cannot be
            written.
    """
    # Files of robots may have changed since another call.
    base_of.cache_clear()
    _key.cache_clear()
    manifest, files = _looked_into(folder, cache.parent)
    found = list[FleetRecording]()
    skipped, seen = list[tuple[str, str]](), dict[str, str]()
    waiting: dict[str, tuple[str, str, Mapping[str, str]]] = {}
    core.make_folder(cache)
    for name, place, digest in files:
        row = manifest.get(name, {})
        if digest in seen:
            skipped.append((name, f"the same recording as {seen[digest]}"))
            continue
        seen[digest] = name
        known = _cached(cache / f"{digest}.npz", row.get("model") or model, terms)
        if known is None:
            waiting[name] = (place, digest, row)
        else:
            found.append(_placed(name, known, row))
    names = list(waiting)
    jobs = [(place, row.get("model") or model, terms) for place, _, row in waiting.values()]
    for number, outcome in core.each(
        _contribution, jobs, beside, tell=progress, words="recordings"
    ):
        name = names[number]
        _, digest, row = waiting[name]
        if isinstance(outcome, str):
            skipped.append((name, outcome))
            continue
        _keep(cache / f"{digest}.npz", outcome, terms)
        found.append(_placed(name, outcome, row))
    first = {one.signals: one for one in sorted(found, key=lambda x: x.path, reverse=True)}
    alike = [(one.path, first[one.signals].path) for one in found]
    skipped += [(own, f"the same recording as {path}") for own, path in alike if own != path]
    found = list(first.values())
    found.sort(key=lambda one: (one.robot, np.nan_to_num(one.time_s, nan=np.inf), one.path))
    return found, sorted(skipped)


def _contribution(job: tuple[str, str | None, str]) -> FleetRecording | str:
    """What one file says and its statistics, or why there are none; in a worker.

    The job is the recording (path or URL), its robot (None for what it says), and friction terms.
    """
    place, model, terms = job
    try:
        with recording.local_files([place]) as (path,):
            reference = stored_robot([path])[0] if model is None else model
            plain = load_robot(reference, collision=False)
            record, _ = known_gains(recording.open_record(path, plain), plain)
            extra = record.metadata.extra
            mount = extra.get("mount", "file")
            mount = None if mount == "file" else mount
            base = base_of(reference, terms, mount)
            robot = base.model.robot
        with core.one_thread():
            samples = process(record, robot, ProcessingSettings(decimate=True))
            problem = identification.IdentificationProblem(base=base, samples=samples)
            statistics = identification.record_statistics(problem)
    except core.DynidError as error:
        return error.line
    named, when = (
        next((extra[key] for key in keys if extra.get(key)), "") for keys in (ROBOT_KEYS, TIME_KEYS)
    )
    first, warm = float(extra.get("t0", "nan")), record.signals.get("temperature")
    return FleetRecording(
        robot=named,
        model=reference,
        mount=mount,
        time_s=_seconds(when) if when or not first >= EPOCH_FROM_S else first,
        temperature_degC=np.full(robot.joints, np.nan) if warm is None else warm.mean(axis=0),
        signals=recording.signals_hash(record),
        statistics=statistics,
        computed=True,
    )


@lru_cache(maxsize=16)
def base_of(reference: str, terms: str, mount: str | None) -> reduction.BaseParametrization:
    """The base parameters that statistics of a robot, mounted like this, are about."""
    robot = load_robot(reference, mount=mount, collision=False)
    model = regressor.InverseDynamicModel(robot=robot, friction=regressor.parse_terms(terms))
    return reduction.reduce_model(model)


@lru_cache(maxsize=64)
def _key(reference: str, terms: str) -> str:
    """What of model and settings a cached result depends on."""
    stored = robot_to_json(load_robot(reference, collision=False))
    return core.content_hash([SCHEME, terms, *(stored[name] for name in _DYNAMICS)])


_DYNAMICS = (
    "name", "joint_types", "placements", "axes", "parameter_frames", "default_frames", "gravity",
    "drives", "counterbalances",
)  # fmt: skip
"""Of a robot, what torques and columns follow from."""


def _placed(name: str, known: FleetRecording, row: Mapping[str, str]) -> FleetRecording:
    """A recording with what the manifest and the names of its folders say besides."""
    folders = name.split("/")[:-1]
    # A file in the folder of its day may tell the time as well.
    day = max(_DAY.findall(name), key=len, default="")
    named = next((part for part in folders if not _DAY.fullmatch(part)), "")
    temperature = known.temperature_degC
    if np.isnan(temperature).any() and row.get("temperature_degC"):
        try:
            given = float(row["temperature_degC"])
        except ValueError as error:
            said = f"a temperature in {MANIFEST} is no number"
            raise core.InputError(said, where=name, value=row["temperature_degC"]) from error
        temperature = np.where(np.isnan(temperature), given, temperature)
    told = known.time_s
    return replace(
        known,
        path=name,
        robot=known.robot or row.get("robot") or named,
        time_s=_seconds(row.get("time") or day) if np.isnan(told) else told,
        temperature_degC=temperature,
    )


def _seconds(text: str) -> float:
    """Seconds since 1970 of an ISO time, UTC where it names no zone; NaN where it is none."""
    text = text.strip()
    if _DAY.fullmatch(text):
        # A file's name has `-` where a time has `:`; within an ISO time it would begin the zone.
        text = text[:10] + re.sub("[:-]", "", text[10:])
    try:
        found = datetime.fromisoformat(text)
    except ValueError:
        return float("nan")
    return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()


def of_one_type(
    robot: str, group: list[FleetRecording]
) -> tuple[list[FleetRecording], list[tuple[str, str]]]:
    """Recordings of the type that most of a robot's name; of the others, why they are left out.

    Raises:
        InputError: Two types are named equally often.
    """
    named = [f"{one.model} ({one.mount or 'as in its file'})" for one in group]
    (usual, most), *others = Counter(named).most_common()
    if others and others[0][1] == most:
        raise core.InputError(
            "recordings of one robot name different models or mountings",
            where=robot,
            value=[f"{one.path}: {name}" for one, name in zip(group, named, strict=True)][:6],
            next_step=f"Give each robot a folder or a name of its own ({MANIFEST}).",
        )
    pairs = list(zip(group, named, strict=True))
    kept = [one for one, name in pairs if name == usual]
    left = [
        (one.path, f"is of {name}, others of {robot or 'this robot'} of {usual}")
        for one, name in pairs
        if name != usual
    ]
    return kept, left


Manifest = dict[str, dict[str, str]]


def _looked_into(
    folder: str | Path, output: Path
) -> tuple[Manifest, Iterable[tuple[str, str, str]]]:
    """The manifest; name, place and digest of files that may be recordings, without the output."""
    if recording.is_url(folder):
        objects = recording.objects_below(str(folder))
        with recording.local_files([one.url for one in objects if one.name == MANIFEST]) as given:
            manifest = _manifest(Path(given[0])) if given else {}
        return manifest, [
            (one.name, one.url, one.state) for one in objects if _may_be(PurePosixPath(one.name))
        ]
    root, output = Path(folder), output.resolve()
    if not root.is_dir():
        if root.exists():
            raise core.InputError("this is a file, and a fleet is a folder", where=str(folder))
        raise core.InputError(
            "there is no such folder", where=str(folder), next_step=core.like_named(root)
        )
    paths = sorted(
        path
        for path in root.rglob("*")
        if _may_be(path.relative_to(root))
        and path.is_file()
        and output not in path.resolve().parents
    )
    return _manifest(root / MANIFEST), (
        (path.relative_to(root).as_posix(), str(path), core.file_hash(path)) for path in paths
    )


def _may_be(path: PurePath) -> bool:
    """Whether a file below the folder may be a recording: a suffix of one, and not hidden."""
    return (
        path.suffix.lower() in SUFFIXES
        and path.name != MANIFEST
        and not any(part.startswith(".") for part in path.parts)
    )


def _manifest(path: Path) -> Manifest:
    """Rows of the manifest by file; none without one."""
    if not path.is_file():
        return {}
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = list(csv.DictReader(stream))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise core.InputError(
            "the manifest cannot be read", where=str(path), value=str(error)
        ) from error
    if rows and "file" not in rows[0]:
        raise core.InputError(
            "the manifest needs a column `file`",
            where=str(path),
            value=", ".join(rows[0]),
            limit=", ".join(COLUMNS),
        )
    return {
        row["file"].strip(): {
            name: (row.get(name) or "").strip() for name in COLUMNS if name != "file"
        }
        for row in rows
    }


def _cached(path: Path, model: str | None, terms: str) -> FleetRecording | None:
    """What is cached, if it is of the same model and terms; None else, or where damaged."""
    stored = core.read_arrays(path)
    try:
        facts: dict[str, Any] = json.loads(str(stored.pop("facts")))
        if facts.pop("key") != _key(model or facts["model"], terms):
            return None
        temperature, samples = stored.pop("temperature_degC"), int(stored.pop("samples"))
        statistics = identification.RecordStatistics(**stored, samples=samples)
        return FleetRecording(
            **facts, temperature_degC=temperature, statistics=statistics, computed=False
        )
    # What another version cached, or whose robot file has gone, is computed again.
    except (KeyError, TypeError, ValueError, core.DynidError):
        return None


def _keep(path: Path, known: FleetRecording, terms: str) -> None:
    names = ("robot", "model", "mount", "time_s", "signals")
    facts = {name: getattr(known, name) for name in names}
    more = json.dumps(facts | {"key": _key(known.model, terms)})
    temperature = {"temperature_degC": known.temperature_degC}
    core.write_arrays(path, {**asdict(known.statistics), **temperature, "facts": more})
