"""Reading robot files from disk, with the errors a person needs."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from dynid.core.errors import InputError, RobotError


def read_limited(path: Path, limit: int) -> bytes:
    """The bytes of a regular file.

    Args:
        path: The file.
        limit: Most bytes accepted.

    Raises:
        RobotError: The file is missing, is not a file, cannot be read or is too large.
    """
    where = shown_path(path)
    try:
        if not path.is_file():
            what = "is not a file" if path.exists() else "no such file"
            raise RobotError(
                what, where=where, next_step=f"Looked in {shown_path(path.absolute())}"
            )
        with path.open("rb") as stream:
            data = stream.read(limit + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise RobotError(f"cannot be read ({reason})", where=where) from error
    if len(data) > limit:
        raise RobotError("the file is too large for a robot", where=where, limit=f"{limit} bytes")
    return data


def is_there(path: Path) -> bool:
    """Whether something is at a path; a path that no file can have has nothing at it."""
    try:
        return path.exists()
    except (OSError, ValueError):
        # Longer than the file system allows, or with a null byte.
        return False


def shown(name: object, width: int = 120) -> str:
    """Any name as one printable line of at most `width` characters."""
    text = "".join(c if c.isprintable() else "?" for c in str(name))
    return text if len(text) <= width else text[: width - 3] + "..."


def shown_path(path: Path, width: int = 120) -> str:
    """A path as one printable line; where it is too long, its end."""
    text = shown(path, 10_000)
    return text if len(text) <= width else "..." + text[3 - width :]


@contextmanager
def located(where: str) -> Generator[None]:
    """Add the place in the file to errors of the values built within.

    Raises:
        RobotError: In place of any InputError.
    """
    try:
        yield
    except InputError as error:
        inner = f"{where}: {error.where}" if error.where else where
        raise RobotError(
            error.what,
            where=inner,
            value=error.value,
            limit=error.limit,
            next_step=error.next_step,
        ) from error
