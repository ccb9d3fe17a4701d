"""Recordings and the robots and drive gains that belong to them; `dynid import`."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid import recording, settings
from dynid.core import InputError, JobError, require_absent, told
from dynid.robot import RobotLike, RobotModel, builtin_names, load_robot, with_mount
from dynid.workflow.shared_inertias import TARGETS, identify_gains

_NEXT = "Pass --robot: a built-in name (dynid robots), a URDF or a robot file."


def robot_reference(robot: RobotLike) -> str:
    """What files remember of a robot: a built-in name, or an absolute path.

    Of a robot that no file holds it is the name, which need not lead back to it.
    """
    if isinstance(robot, RobotModel):
        return robot.file or robot.name
    text = str(robot)
    if text.lower() in builtin_names():
        return text.lower()
    path = Path(text).expanduser()
    return str(path.parent.resolve() / path.name)


def of_robot(record: recording.ExperimentRecord, robot: RobotLike) -> recording.ExperimentRecord:
    """The recording, which remembers its robot so that its file is found again."""
    return replace(record, metadata=replace(record.metadata, robot=robot_reference(robot)))


def known_gains(
    record: recording.ExperimentRecord, robot: RobotModel
) -> tuple[recording.ExperimentRecord, str]:
    """The recording with the drive gains that its torque needs, and where they come from.

    Where neither the recording nor the robot has gains, they are found in the recording itself:
    from the target currents and target moments of the controller. They come from `effort` (no
    gains needed), `recording`, `robot` or `targets`.

    Raises:
        InputError: No gains, and no targets to find them in.
        JobError: Targets that do not show the gain of every joint.
    """
    if "effort" in record.signals:
        return record, "effort"
    if record.metadata.drive_gains is not None:
        return record, "recording"
    if np.isfinite(robot.drives.gain).all():
        return record, "robot"
    if not {"current", *TARGETS} <= set(record.signals):
        raise InputError(
            "torque from current needs drive gains [N.m/A], and neither the robot nor the"
            " recording has them",
            where=robot.name,
            next_step="Pass --gains g1,..,gn, or record target_current and target_moment too.",
        )
    found = identify_gains(record, robot)
    missing = [robot.joint_names[j] for j in np.flatnonzero(~np.isfinite(found.gain))]
    if missing:
        raise JobError(
            "the targets do not determine the drive gain of every joint",
            where=robot.name,
            value=", ".join(missing),
            next_step="Pass --gains g1,..,gn, or record a motion that loads every joint.",
        )
    return recording.open_record(record, robot, found.gain.tolist()), "targets"


def open_records(
    paths: Sequence[str | Path],
    robot: str | Path | None = None,
    gains: Sequence[float] | None = None,
) -> tuple[list[recording.ExperimentRecord], RobotModel]:
    """Recordings of one robot, and the robot, None for what they say.

    `gains` (n) [N.m/A] override those of the recordings and of the robot.

    Raises:
        InputError: No recordings, a robot that is not known, or recordings that do not fit it.
    """
    model = robot_of(paths, robot)
    records = recording.open_several(paths, model, gains)
    return records, as_mounted(model, records)


USUAL_MOUNT = "floor"
"""Of a robot of which nobody has said another."""


def as_mounted(robot: RobotModel, records: Sequence[recording.AnyRecording]) -> RobotModel:
    """The robot on the mounting that its recordings remember, where it says no other itself."""
    said = {record.metadata.extra.get("mount", "file") for record in records} - {"file"}
    if robot.mount != USUAL_MOUNT or len(said) != 1:
        return robot
    return with_mount(robot, said.pop())


def robot_of(paths: Sequence[str | Path], robot: RobotLike | None = None) -> RobotModel:
    """A robot, or None for the one that recordings remember, mounted as they were made.

    Raises:
        InputError: As `stored_robot`.
    """
    if robot is not None:
        return load_robot(robot, collision=False)
    name, mount = stored_robot(paths)
    return load_robot(name, mount=mount, collision=False)


def stored_robot(paths: Sequence[str | Path]) -> tuple[str, str | None]:
    """The robot that recordings remember, and its mounting; None for that of the robot's file.

    Raises:
        InputError: A recording does not say, they disagree, or the robot's file has gone.
    """
    if not paths:
        raise InputError("needs at least one recording")
    names: list[str] = []
    mounts: list[str] = []
    for path in paths:
        name, mount = recording.remembered_robot(path)
        if name is None:
            raise InputError(
                "the recording does not say which robot it is of", where=str(path), next_step=_NEXT
            )
        names.append(name)
        # Logs of other programs say no mounting.
        mounts += [] if mount is None else [mount]
    for what, found in (("robots", names), ("mountings", mounts)):
        if len(set(found)) > 1:
            value = ", ".join(map(str, found))
            raise InputError(
                f"the recordings are of different {what}", value=value, next_step=_NEXT
            )
    name, mount = names[0], next(iter(mounts), "file")
    if Path(name).is_absolute() and not Path(name).exists():
        raise InputError(
            "the robot file of the recording does not exist any more",
            where=str(paths[0]),
            value=name,
            next_step=_NEXT,
        )
    return name, None if mount == "file" else mount


@dataclass(frozen=True, slots=True, kw_only=True)
class Imported:
    """A recording, and the file it was written to."""

    record: recording.ExperimentRecord
    """The recording, repaired."""
    path: Path
    """Its file."""
    needs: tuple[str, ...] = ()
    """What identification needs beside it, in words."""

    def to_json(self) -> dict[str, Any]:
        """The keys of the design, and what else was found."""
        record, metadata = self.record, self.record.metadata
        return {
            "record": str(self.path),
            "robot": metadata.robot,
            "format": metadata.format,
            "samples": record.samples,
            "joints": record.joints,
            "joint_names": list(metadata.joint_names),
            "rate_hz": record.rate_hz,
            "duration_s": record.duration_s,
            "clock": metadata.clock,
            "signals": list(record.signals),
            "channels": list(record.channels),
            "drive_gains": None if metadata.drive_gains is None else list(metadata.drive_gains),
            "dropped_rows": metadata.dropped_rows,
            **told(record.problems, "problems"),
            "notes": metadata.extra.get("notes", ""),
            "needs": list(self.needs),
        }


def import_recording(
    files: str | Path | Sequence[str | Path],
    output: str | Path,
    *,
    robot: RobotLike | None = None,
    options: settings.ImportOptions | None = None,
    force: bool = False,
) -> Imported:
    """Read a recording in any format, repair it and write it as a dynid recording.

    Args:
        files: One file; or text files side by side; or the files of one split bag.
        output: The Parquet file to write; it appears whole or not at all.
        robot: The robot, or its name or file. Without one, nothing is checked against the robot,
            motor signals stay as they are, and `identify` has to be told the robot.
        options: How to read the files.
        force: Whether an existing file is replaced.

    Raises:
        InputError: A robot or recording that cannot be read, or a place where no such file can
            be.
        JobError: The disk does not take the recording.
    """
    require_absent(Path(output), force=force)
    model = None if robot is None else load_robot(robot, collision=False)
    how = asdict(options or settings.ImportOptions())
    record = recording.read_recording(files, robot=model, **how)
    if robot is not None:
        record = of_robot(record, robot)
    recording.write_record(record, output, force=force)
    return Imported(record=record, path=Path(output), needs=tuple(_needs(record, model)))


def _needs(record: recording.ExperimentRecord, robot: RobotModel | None) -> Iterator[str]:
    """What identification would refuse a recording for."""
    if record.metadata.robot is None:
        yield f"the recording does not say which robot it is of. {_NEXT}"
    if robot is not None:
        try:
            known_gains(record, robot)
        except (InputError, JobError) as error:
            yield f"{error.what}. {error.next_step}"
