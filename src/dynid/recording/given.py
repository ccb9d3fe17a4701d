"""The files of a recording, from what a user names: files, a bag folder, or a folder of one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from dynid.core import RecordError
from dynid.recording.rosbag import bag_files
from dynid.recording.segments import partial_path

_EXTENSIONS = (
    *(
        ".csv",
        ".txt",
        ".tsv",
        ".dat",
        ".log",
        ".mat",
        ".npz",
        ".npy",
        ".h5",
        ".hdf5",
        ".json",
        ".jsonl",
    ),
    *(".parquet", ".feather", ".arrow", ".xlsx", ".gz", ".bz2", ".xz", ".zst", ".zstd", ".zip"),
)


def given_files(paths: str | Path | Sequence[str | Path]) -> list[Path]:
    """The files that a user means: themselves, those of a bag, or the one in a folder.

    Args:
        paths: Files, or one folder.

    Raises:
        RecordError: Missing, empty, or a folder that holds several recordings.
    """
    files = [Path(paths)] if isinstance(paths, (str, Path)) else [Path(path) for path in paths]
    if not files:
        raise RecordError("no recording was given")
    if len(files) == 1 and partial_path(files[0]).is_file() and not files[0].exists():
        # A recording that was interrupted: what there is of it.
        return [partial_path(files[0])]
    for file in files:
        try:
            size = file.stat().st_size
        except (OSError, ValueError) as error:
            raise RecordError("there is no such file", where=str(file)) from error
        if file.is_dir():
            if len(files) > 1:
                raise RecordError("a folder cannot stand beside other files", where=str(file))
            return _in_folder(file)
        if not file.is_file():
            raise RecordError("this is no regular file", where=str(file))
        if size == 0:
            raise RecordError("the file is empty", where=str(file))
    return files


def _in_folder(folder: Path) -> list[Path]:
    """The storage files of a bag, or the only recording that a folder holds.

    Raises:
        RecordError: The folder holds no recording, or several.
    """
    bags = bag_files(folder)
    others = sorted(
        path
        for path in folder.iterdir()
        if path.is_file() and path.name.lower().endswith(_EXTENSIONS) and path not in bags
    )
    if bags or len(others) == 1:
        return bags or others
    if not others:
        raise RecordError(
            "the folder holds no recording",
            where=str(folder),
            limit="a ROS bag, or files that end in " + ", ".join(_EXTENSIONS),
        )
    quoted = " ".join(str(path) for path in others[:8])
    raise RecordError(
        f"the folder holds {len(others)} files",
        where=str(folder),
        value=[path.name for path in others[:20]],
        next_step=f"Name one, or those that belong side by side: dynid import {quoted} ...",
    )
