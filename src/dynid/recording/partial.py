"""Claim the file of a recording in progress, without losing what an earlier one left there."""

from __future__ import annotations

import fcntl
import os
from contextlib import suppress
from pathlib import Path

from dynid.core import JobError, RecordError


def create_partial(path: Path) -> int:
    """Create and lock a `.partial` file; one that a crash left is renamed, never overwritten.

    Args:
        path: The `.partial` file.

    Returns:
        A file descriptor open for writing.

    Raises:
        RecordError: Another program is recording there.
        JobError: The file cannot be created.
    """
    try:
        if path.exists():
            _set_aside(path)
        file = os.open(path, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o644)
    except OSError as error:
        raise JobError(
            "the recording cannot be started", where=str(path), value=error.strerror
        ) from error
    # The lock only tells other writers; a file system without locks can still record.
    with suppress(OSError):
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    return file


def _set_aside(path: Path) -> None:
    old = os.open(path, os.O_RDONLY)
    try:
        # A file system without locks cannot say; the old rows are kept in any case.
        with suppress(OSError):
            _lock_or_refuse(old, path)
    finally:
        os.close(old)
    number = 1
    while (aside := path.with_name(f"{path.name}.{number}")).exists():
        number += 1
    os.rename(path, aside)


def _lock_or_refuse(file: int, path: Path) -> None:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise RecordError("another program is recording there", where=str(path)) from error
