"""Bytes of a file that may not be readable, or too large."""

from __future__ import annotations

from pathlib import Path

from dynid.core import RecordError


def unreadable(path: Path, error: OSError) -> RecordError:
    """The error for a file that the system does not let us read.

    Args:
        path: The file.
        error: What the system says.
    """
    return RecordError("the file cannot be read", where=path.name, value=error.strerror)


def first_bytes(path: Path, count: int) -> bytes:
    """The first bytes of a file.

    Args:
        path: The file.
        count: How many, at most.

    Raises:
        RecordError: It cannot be read.
    """
    try:
        with path.open("rb") as stream:
            return stream.read(count)
    except OSError as error:
        raise unreadable(path, error) from error


def all_bytes(path: Path, most: int) -> bytes:
    """All bytes of a file that must fit in memory.

    Args:
        path: The file.
        most: Largest size [bytes].

    Raises:
        RecordError: It cannot be read, or is too large.
    """
    try:
        if path.stat().st_size > most:
            raise RecordError("the file is too large", where=path.name, limit=f"{most} bytes")
        return path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error
