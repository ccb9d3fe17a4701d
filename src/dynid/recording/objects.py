"""Recordings in object stores, as `s3://bucket/run.parquet`, through fsspec."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from dynid.core import InputError, RecordError, require

_URL = re.compile(r"[a-z][a-z0-9+.-]+://", re.IGNORECASE)


def is_url(place: str | Path) -> bool:
    """Whether a place is one of an object store; paths of this machine are none."""
    return isinstance(place, str) and _URL.match(place) is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredObject:
    """A file in an object store."""

    name: str
    """Relative to the folder that was listed."""
    url: str
    state: str
    """What the store says of its content (tag, size, time), as a hash."""


def objects_below(folder: str) -> list[StoredObject]:
    """The objects below a folder, by name.

    Args:
        folder: Its URL.

    Raises:
        InputError: No such folder, or a store that does not answer.
        MissingExtraError: fsspec is not installed.
    """
    store, root = _store(folder)
    try:
        found = [
            StoredObject(
                name=path.removeprefix(root).lstrip("/"),
                url=store.unstrip_protocol(path),
                state=store.ukey(path),
            )
            for path in store.find(root)
        ]
    # Every store has errors of its own, of its network and of its credentials.
    except Exception as error:
        raise InputError("the folder cannot be listed", where=folder, value=_said(error)) from error
    if not found:
        raise InputError("there is nothing below this folder", where=folder)
    return sorted(found, key=lambda one: one.name)


@contextmanager
def local_files(places: Sequence[str | Path]) -> Generator[list[str | Path]]:
    """Files on this machine: objects are copied for as long as they are needed.

    Args:
        places: Paths, which stay as they are, and URLs.

    Yields:
        Paths in their order.

    Raises:
        RecordError: An object that cannot be read.
        MissingExtraError: fsspec is not installed.
    """
    if not any(map(is_url, places)):
        yield list(places)
        return
    with tempfile.TemporaryDirectory(prefix="dynid-") as folder:
        yield [
            _copied(str(place), Path(folder) / str(k)) if is_url(place) else place
            for k, place in enumerate(places)
        ]


def _copied(url: str, folder: Path) -> Path:
    store, path = _store(url)
    target = folder / PurePosixPath(path).name
    folder.mkdir()
    try:
        store.get_file(path, str(target))
    # As above.
    except Exception as error:
        raise RecordError("the object cannot be read", where=url, value=_said(error)) from error
    return target


def _store(url: str) -> tuple[Any, str]:
    """The file system of a URL, and its path there."""
    fsspec: Any = require("fsspec", "objects")
    if "::" in url:
        raise InputError("chained URLs are not taken", where=url)
    try:
        return fsspec.url_to_fs(url)
    # An unknown scheme, a store whose package is missing, credentials that are none.
    except Exception as error:
        raise InputError(
            "the object store cannot be opened", where=url, value=_said(error)
        ) from error


def _said(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
