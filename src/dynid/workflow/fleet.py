"""`dynid fleet`: many recordings of many robots become estimates, trends and alarms."""

import csv
import importlib
import io
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import compress, groupby
from pathlib import Path
from typing import Any

import numpy as np

from dynid import core, identification, report
from dynid.recording import is_url
from dynid.settings import FleetSettings
from dynid.workflow import fleet_files

TABLE, PAGE = "estimates.parquet", "report.html"
CACHE = "statistics"
FEWEST, SPARE = 9999, 4
"""Permutations: at least so many, and so many times what the correction needs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fleet:
    """What `dynid fleet` found."""

    folder: str | Path
    """The recordings."""
    output: Path
    """Folder of the results."""
    settings: FleetSettings
    """How they were computed."""
    recordings: tuple[fleet_files.FleetRecording, ...]
    """All recordings that were used."""
    skipped: tuple[tuple[str, str], ...]
    """Recordings that were not used, each with the reason."""
    joints: tuple[identification.JointState, ...]
    """State and trend of each joint of each robot."""
    tests: int
    """Trends that were tested together."""
    findings: tuple[core.Finding, ...]
    """Alarms, and what is missing in the recordings."""

    @property
    def computed(self) -> int:
        """Recordings that were computed now; the others came from the cache."""
        return sum(one.computed for one in self.recordings)

    @property
    def alarms(self) -> tuple[identification.JointState, ...]:
        """The joints with an alarm."""
        return tuple(joint for joint in self.joints if joint.alarm)

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        robots: list[dict[str, Any]] = [
            {
                "robot": name,
                "model": group[0].model,
                "recordings": len(group),
                "first": _iso_time(np.fmin.reduce([one.time_s for one in group])),
                "last": _iso_time(np.fmax.reduce([one.time_s for one in group])),
                "joints": [_joint_row(joint) for joint in self.joints if joint.robot == name],
            }
            for name, group in _by_robot(self.recordings).items()
        ]
        return {
            "folder": str(self.folder),
            "recordings": len(self.recordings),
            "computed": self.computed,
            "cached": len(self.recordings) - self.computed,
            "skipped": [list(pair) for pair in self.skipped],
            "robots": robots,
            "alarms": [row for robot in robots for row in robot["joints"] if row["alarm"]],
            "false_alarm_rate": self.settings.false_alarms,
            "tests": self.tests,
            "files": [str(self.output / name) for name in (TABLE, PAGE, STATE, METRICS)],
            **core.told(self.findings),
        }


def fleet(
    folder: str | Path,
    output: str | Path = "runs/fleet",
    settings: FleetSettings | None = None,
    *,
    progress: core.Progress | None = None,
) -> Fleet:
    """Identify the recordings of a fleet together, follow friction over time, raise alarms.

    Inertias are shared by the recordings of a robot, friction is of each recording. Only
    recordings that are not in the cache beside the table are computed.

    Args:
        folder: The recordings, a path or the URL of an object store; how they name robot and
            time: `read_folder`.
        output: Folder of the table, the page, the state and the cache.
        settings: How it is judged.
        progress: Told what is being done and how far it is (0 to 1).

    Raises:
        InputError: No recordings that can be read, or a place where no files can be.
        JobError: A recording or robot that cannot be computed.
    """
    asked, target = settings or FleetSettings(), Path(output)
    held = () if is_url(folder) else (Path(folder).resolve(), *Path(folder).resolve().parents)
    if target.resolve() in held:
        raise core.InputError(
            "the output must not hold the recordings",
            where="-o",
            value=str(target),
            next_step="Name another folder.",
        )
    with core.workers(asked.jobs, asked.dask) as beside:
        recordings, skipped = fleet_files.read_folder(
            folder,
            target / CACHE,
            model=None if asked.robot is None else str(asked.robot),
            terms=asked.terms,
            beside=beside,
            progress=progress or core.silent,
        )
        if not recordings:
            raise core.InputError(
                "no recording in the folder can be used",
                where=str(folder),
                value="; ".join(f"{name}: {why}" for name, why in skipped[:3]) or None,
                next_step="dynid import converts other recordings; --robot names their robot.",
            )
        robots = _by_robot(recordings)
        for robot, group in robots.items():
            robots[robot], others = fleet_files.of_one_type(robot, group)
            skipped = [*skipped, *others]
        family = 2 * sum(len(group[0].temperature_degC) for group in robots.values())
        # Enough for the smallest p value to count after the correction.
        permutations = math.ceil(max(FEWEST, SPARE * family / asked.false_alarms))
        tasks = [(robot, group, asked, permutations) for robot, group in robots.items()]
        by_robot = dict(core.each(_robot, tasks, beside, tell=progress, words="robots"))
    joints = [joint for k in sorted(by_robot) for joint in by_robot[k][0]]
    rows = [row for k in sorted(by_robot) for row in by_robot[k][1]]
    strange = {one.path for *_, others in by_robot.values() for one in others}
    why = "does not have the torques of its robot's other recordings: another arm, or wrong signs"
    skipped = [*skipped, *((path, why) for path in sorted(strange))]
    recordings = [one for group in robots.values() for one in group if one.path not in strange]
    judged, tests = identification.judge(joints, asked.false_alarms)
    result = Fleet(
        folder=folder,
        output=target,
        settings=asked,
        recordings=tuple(recordings),
        skipped=tuple(skipped),
        joints=judged,
        tests=tests,
        findings=(
            *_missing(recordings, asked.reference_degC),
            *_unreachable(judged, tests / asked.false_alarms),
            *(_alarm(joint) for joint in judged if joint.alarm),
        ),
    )
    _write_table(target / TABLE, rows)
    _write_state(target, joints=judged, recordings=len(recordings))
    report.write_fleet_page(
        target / PAGE,
        joints=judged,
        notes=[finding.message for finding in result.findings],
        facts=_procedure(result),
    )
    return result


def _by_robot(
    recordings: Sequence[fleet_files.FleetRecording],
) -> dict[str, list[fleet_files.FleetRecording]]:
    return {name: list(group) for name, group in groupby(recordings, key=lambda one: one.robot)}


def _missing(
    recordings: Sequence[fleet_files.FleetRecording], reference_degC: float | None
) -> Iterator[core.Finding]:
    """What the recordings do not say, and how to say it."""
    unnamed = [one.path for one in recordings if not one.robot]
    undated = [one.path for one in recordings if np.isnan(one.time_s)]
    unknown = [one.path for one in recordings if np.isnan(one.temperature_degC).any()]
    for kind, what, names in (
        ("another_robot", "the name of a robot, taken as one robot", unnamed),
        ("clock_mismatch", "a time, left out of the trends", undated),
        ("extrapolated", "joint temperatures, which cannot be regressed out", unknown),
    ):
        if names:
            yield core.Finding(
                kind,
                f"recordings without {what}: {len(names)} ({', '.join(names[:3])})",
                value=float(len(names)),
                next_step=f"give it in {fleet_files.MANIFEST} ({','.join(fleet_files.COLUMNS)})",
            )
    temperatures = np.concatenate([one.temperature_degC for one in recordings])
    if reference_degC is not None and not np.isnan(temperatures).all():
        low, high = np.nanmin(temperatures), np.nanmax(temperatures)
        if not low <= reference_degC <= high:
            text = (
                f"the reference of {reference_degC:g} degC is beyond the joint temperatures of all "
                f"recordings, {low:.3g} to {high:.3g} degC: friction there is extrapolated"
            )
            yield core.Finding("extrapolated", text, next_step="Leave --reference out.")
    known = Counter(one.robot for one in recordings if not np.isnan(one.time_s))
    least = identification.LEAST_RECORDINGS
    rare = [one for one in recordings if known[one.robot] < least]
    few = sorted({one.robot or f"{one.model} without a name" for one in rare})
    if few:
        text = (
            f"robots with fewer than {least} recordings with a time have "
            f"no trends: {', '.join(few[:3])}{f' and {len(few) - 3} more' if few[3:] else ''}"
        )
        yield core.Finding("not_diagnosed", text, value=float(len(few)))


def _unreachable(
    joints: Sequence[identification.JointState], family: float
) -> Iterator[core.Finding]:
    """Robots without alarms whatever happens; the family is all tests over the false alarms."""
    sizes = {one.robot: len(one.friction.std) for one in joints if one.friction.known}
    # Of n recordings in all orders, n over n/2 have different ones before and after a step.
    few = [name for name, size in sizes.items() if math.comb(size, size // 2) < family]
    if few:
        text = f"no change of {', '.join(few[:3])} can raise an alarm yet: too few recordings for"
        yield core.Finding("not_diagnosed", f"{text} so many trends", value=float(len(few)))


@core.one_thread()
def _robot(
    task: tuple[str, Sequence[fleet_files.FleetRecording], FleetSettings, int],
) -> tuple[list[identification.JointState], list[dict[str, Any]], list[fleet_files.FleetRecording]]:
    """The joints of one robot, not yet judged, its rows of the table, and recordings left out.

    Runs in a worker.
    """
    robot, group, asked, permutations = task
    base = fleet_files.base_of(group[0].model, asked.terms, group[0].mount)
    model = base.model.robot
    states = identification.solve_robot([one.statistics for one in group])
    left = list(compress(group, states.strange))
    if 2 * len(left) >= len(group):
        # Which of them are of another arm?
        left = []
    if left:
        group = list(compress(group, ~states.strange))
        states = identification.solve_robot([one.statistics for one in group])
    time_s = np.array([one.time_s for one in group])
    warm = np.array([one.temperature_degC for one in group])
    motion = identification.repeated_motions(np.array([one.statistics.speed for one in group]))
    names = identification.friction_names(base)
    weights = np.zeros(states.friction.shape[1:])
    for j, own in enumerate(names):
        of = {"Fc": 1.0, "Fcm": 1.0, "Fv": states.speed[j], "Fvm": states.speed[j]}
        for f, name in enumerate(own):
            weights[j, f] = of.get(name.rstrip("0123456789"), 0.0)
    level, level_std = states.level(weights)
    facts = {"robot": robot, "model": group[0].model}
    # What the robot's recordings share has no recording, no time and no temperature.
    none = dict.fromkeys(TEMPERATURES, float("nan"))
    rows: list[dict[str, Any]] = [
        {**facts, **none, "joint": 0, "name": name, "value": float(value), "std": float(std)}
        for name, value, std in zip(
            identification.shared_names(base), states.shared, states.shared_std, strict=True
        )
    ]
    joints: list[identification.JointState] = []
    for j, name in enumerate(model.joint_names):
        known = np.isfinite(warm[:, j])
        dated = np.isfinite(time_s) & (known | ~known.any())
        reference = asked.reference_degC
        if reference is None:
            reference = float(np.median(warm[known, j])) if known.any() else float("nan")
        pair = (level[:, j], level_std[:, j]), (states.scale[:, j], states.scale_std[:, j])
        shown = [dated & np.isfinite(std) for _, std in pair]
        friction, control = (
            identification.trend(
                time_s[told_by],
                value[told_by],
                std[told_by],
                warm[told_by, j],
                reference,
                motion=motion[told_by],
                permutations=permutations,
            )
            for told_by, (value, std) in zip(shown, pair, strict=True)
        )
        joints.append(
            identification.JointState(
                robot=robot,
                joint=j,
                name=name,
                unit="N" if model.prismatic[j] else "N.m",
                reference_speed=float(states.speed[j]),
                friction=friction,
                control=control,
            )
        )
        own = np.sqrt(np.maximum(np.einsum("rff->rf", states.covariance[:, j]), 0.0))
        series = [
            (f"friction{j + 1}", *pair[0], shown[0], friction),
            (f"torque_scale{j + 1}", *pair[1], shown[1], control),
            *(
                (n, states.friction[:, j, f], own[:, f], dated, identification.Trend())
                for f, n in enumerate(names[j])
            ),
        ]
        for quantity, value, std, told_by, over in series:
            at = np.full((2, len(group)), np.nan)
            at[:, told_by] = over.at_reference, over.std
            rows += [
                {
                    **facts,
                    "recording": one.path,
                    "time": _moment(one.time_s),
                    "joint": j + 1,
                    "name": quantity,
                    "value": float(value[k]),
                    "std": float(std[k]),
                    "temperature_degC": float(warm[k, j]),
                    "at_reference": float(at[0, k]),
                    "at_reference_std": float(at[1, k]),
                    "reference_degC": reference,
                }
                for k, one in enumerate(group)
            ]
    return joints, rows, left


def _alarm(joint: identification.JointState) -> core.Finding:
    """An alarm as a finding."""
    step, low, high = joint.change_percent
    friction, control = joint.friction, joint.control
    size = 100.0 * control.change
    if joint.alarm == "friction_drift":
        since = _moment(float(friction.time_s[friction.step_at]))
        return core.Finding(
            "friction_drift",
            f"{joint.robot}, {joint.name}: friction changed by {step:+.1f} % ({low:+.1f} to "
            f"{high:+.1f}) about {since:%Y-%m-%d %H:%M} UTC, "
            f"p {joint.friction_p:.2g}; the torque of the inertias by {size:+.1f} %, "
            f"p {joint.control_p:.2g}",
            joints=(joint.joint,),
            value=step,
            std=(high - low) / (2 * identification.CONFIDENCE),
            unit="%",
            next_step="Check gear, brake and lubrication of this joint",
        )
    return core.Finding(
        "torque_scale",
        f"{joint.robot}, {joint.name}: the torque of the inertias changed by {size:+.1f} %, "
        f"p {joint.control_p:.2g}: drive gain, load or sensor, not friction alone",
        joints=(joint.joint,),
        value=size,
        unit="%",
        next_step="Check what the robot carries, its drive gain and its torque signal",
    )


def _procedure(result: Fleet) -> list[str]:
    """How the alarms are raised, in words."""
    return [
        f"{len(result.recordings)} recordings of {len(_by_robot(result.recordings))} robots; "
        f"{result.computed} computed in this run, {len(result.skipped)} left out.",
        "Inertias are shared by the recordings of a robot; friction is of each recording, taken "
        "at the joint's mean speed, with temperature and the motion regressed out.",
        f"An alarm is a step at any time (at least three recordings on either side) that "
        f"{result.tests} trends without any change would show somewhere with a probability of "
        f"{100 * result.settings.false_alarms:g} % (Holm's correction), in one run.",
    ]


STATE, METRICS = "state.csv", "state.prom"
ALARMS = ("", "friction_drift", "torque_scale")
"""Their places are the numbers of the metric."""
TEMPERATURES = ("temperature_degC", "at_reference", "at_reference_std", "reference_degC")
TABLE_COLUMNS = {
    **dict.fromkeys(("robot", "model", "recording"), "string"),
    "time": "timestamp",
    "joint": "int32",
    "name": "string",
    **dict.fromkeys(("value", "std", *TEMPERATURES), "float64"),
}
"""Columns of the table and their types; `joint` is from 1, 0 for none."""


def _moment(time_s: float) -> datetime | None:
    """Seconds since 1970 as a time in UTC, to the millisecond; None where unknown."""
    return datetime.fromtimestamp(round(time_s, 3), UTC) if np.isfinite(time_s) else None


def _iso_time(time_s: float) -> str | None:
    """The same as an ISO time, to the second."""
    found = _moment(time_s)
    return found and found.isoformat(timespec="seconds")


def _joint_row(joint: identification.JointState) -> dict[str, Any]:
    """The state of a joint: a row of the CSV, an object of the JSON."""
    step, low, high = joint.change_percent
    one, control = joint.friction, joint.control
    percent = 100 / max(abs(one.level), 1e-12)
    changed = _iso_time(float(one.time_s[one.step_at])) if joint.alarm else None
    return {
        "robot": joint.robot,
        "joint": joint.joint + 1,
        "name": joint.name,
        "unit": joint.unit,
        "reference_speed": joint.reference_speed,
        "reference_degC": one.reference_degC,
        "friction": joint.now,
        "friction_std": joint.now_std,
        "change_percent": step,
        "change_low_percent": low,
        "change_high_percent": high,
        "changed_at": changed,
        "slope_percent_per_year": percent * one.slope_per_year,
        "slope_std_percent": percent * one.slope_std,
        "per_kelvin_percent": percent * one.per_kelvin,
        "torque_scale": control.before + control.change,
        "torque_scale_change_percent": 100 * control.change,
        "p_friction": joint.friction_p,
        "p_torque_scale": joint.control_p,
        "alarm": joint.alarm or None,
    }


def _write_table(target: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write the estimates as Parquet, one row a quantity and recording, whole or not at all."""
    arrow, parquet = (importlib.import_module(name) for name in ("pyarrow", "pyarrow.parquet"))
    types = {"string": arrow.string(), "int32": arrow.int32(), "float64": arrow.float64()}
    types["timestamp"] = arrow.timestamp("ms", "UTC")
    schema = arrow.schema([(name, types[kind]) for name, kind in TABLE_COLUMNS.items()])
    table = arrow.Table.from_pylist(rows, schema=schema)
    with core.in_one_piece(target) as draft:
        parquet.write_table(table, draft, compression="zstd")


def _write_state(
    folder: Path, *, joints: Sequence[identification.JointState], recordings: int
) -> None:
    """Write the state of each joint as CSV, and for Prometheus with the count of recordings."""
    state = [_joint_row(joint) for joint in joints]
    text = io.StringIO()
    writer = csv.DictWriter(text, list(state[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(state)
    core.write_text(folder / STATE, text.getvalue())
    lines: list[str] = []
    for name, help_text, key in (
        ("friction", "Friction level at the reference speed and temperature, SI units", "friction"),
        ("friction_change_percent", "Step of the friction level", "change_percent"),
        ("torque_scale", "Measured over predicted torque of the inertias", "torque_scale"),
        ("alarm", "1 for a drift of friction, 2 for one of the torque scale", "alarm"),
    ):
        lines += [f"# HELP dynid_{name} {help_text}", f"# TYPE dynid_{name} gauge"]
        for row in state:
            value = ALARMS.index(row["alarm"] or "") if key == "alarm" else row[key]
            label = row["robot"].replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
            if np.isfinite(value):
                lines.append(f'dynid_{name}{{robot="{label}",joint="{row["joint"]}"}} {value:g}')
    lines += ["# TYPE dynid_recordings gauge", f"dynid_recordings {recordings}"]
    core.write_text(folder / METRICS, "\n".join(lines) + "\n")
