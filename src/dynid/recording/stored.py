"""Recordings that stay where they are: parts of files read when wanted, and object stores.

Objects, as `s3://bucket/run.parquet`, are reached through fsspec.
"""

import importlib
import re
import tempfile
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import accumulate
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from dynid.core import Array, Finding, InputError, RecordError, require
from dynid.recording import records
from dynid.recording.content import located, refused
from dynid.recording.store import KEY, described, is_own
from dynid.robot import RobotModel

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
    # Every store has errors of its own, of its network and of its credentials.
    with refused("the folder cannot be listed", where=folder, kind=InputError):
        found = [
            StoredObject(
                name=path.removeprefix(root).lstrip("/"),
                url=store.unstrip_protocol(path),
                state=store.ukey(path),
            )
            for path in store.find(root)
        ]
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
        local = list(places)
        for k, url in enumerate(map(str, places)):
            if is_url(url):
                store, path = _store(url)
                target = Path(folder) / str(k) / PurePosixPath(path).name
                target.parent.mkdir()
                with refused("the object cannot be read", where=url):
                    store.get_file(path, str(target))
                local[k] = target
        yield local


def _store(url: str) -> tuple[Any, str]:
    """The file system of a URL, and its path there."""
    fsspec: Any = require("fsspec", "objects")
    if "::" in url:
        raise InputError("chained URLs are not taken", where=url)
    # An unknown scheme, a store whose package is missing, credentials that are none.
    with refused("the object store cannot be opened", where=url, kind=InputError):
        return fsspec.url_to_fs(url)


LONG = 300_000
"""Rows above which a recording of ours stays in its file: ten minutes at 500 Hz."""
SMALLEST = 1 << 16
"""Smaller files are not looked into [bytes]."""
MOST_ROWS_A_GROUP, BYTES_A_VALUE = 1 << 20, 16
"""What a row group may hold: release 0.1 wrote a million rows into one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredRecording:
    """A Parquet recording of ours whose rows stay in the file."""

    path: Path
    samples: int
    """Number of rows."""
    joints: int
    quantities: tuple[str, ...]
    """Signals that it has."""
    metadata: records.RecordMetadata
    problems: tuple[Finding, ...]
    """What was found and repaired in reading."""
    fingerprint: str
    """Of its description and every number, as its writer found it."""
    order: tuple[int, ...]
    """Columns in the order of the robot's joints."""

    def part(self, first: int, last: int, quantities: Sequence[str]) -> records.ExperimentRecord:
        """Rows as a recording of their own; neighbours are read fastest in their order.

        Args:
            first: The first row.
            last: One behind the last row.
            quantities: Which signals; positions come along.

        Raises:
            RecordError: Damaged rows.
        """
        names = tuple(name for name in self.quantities if name in {"q", *quantities})
        written = self.path.stat().st_mtime_ns
        _, starts = _footer(self.path, written)
        if last > starts[-1]:
            raise RecordError("rows are missing", where=self.path.name, value=last)
        begin = int(np.searchsorted(starts, first, side="right")) - 1
        end = int(np.searchsorted(starts, last))
        columns = ("t", *(f"{name}_{k}" for name in names for k in self.order))
        groups = [_group(self.path, columns, written, k) for k in range(begin, end)]
        rows = slice(first - starts[begin], last - starts[begin])
        table, n = np.concatenate(groups, axis=1)[:, rows], self.joints
        return records.ExperimentRecord(
            t=table[0],
            signals={name: table[1 + k * n : 1 + (k + 1) * n].T for k, name in enumerate(names)},
            # A part is not the file.
            metadata=replace(self.metadata, input_hash=""),
        )

    def stamps(self) -> Iterator[Array]:
        """The time stamps [s], some at a time.

        Raises:
            RecordError: Damaged rows, or time that does not increase.
        """
        written, before = self.path.stat().st_mtime_ns, -np.inf
        for k in range(len(_footer(self.path, written)[1]) - 1):
            t = _group(self.path, ("t",), written, k)[0]
            if not (np.diff(t, prepend=before) > 0).all():
                raise RecordError("time does not increase", where=self.path.name)
            before = float(t[-1])
            yield t


AnyRecording = records.ExperimentRecord | StoredRecording


def fingerprint(record: AnyRecording) -> str:
    """What tells a recording from every other."""
    if isinstance(record, records.ExperimentRecord):
        return records.identity(record)
    return record.metadata.input_hash or record.fingerprint


def stored_rows(path: Path) -> int:
    """Rows of a Parquet file, by its footer; 0 where it is none of ours or cannot be read."""
    if not path.is_file() or path.stat().st_size < SMALLEST or not is_own(path):
        return 0
    parquet = importlib.import_module("pyarrow.parquet")
    # pyarrow raises many kinds on damaged bytes; whoever reads the file says what is wrong.
    with suppress(Exception):
        footer = parquet.read_metadata(path)
        return int(footer.num_rows) if KEY in (footer.metadata or {}) else 0
    return 0


def open_stored(
    path: str | Path, robot: RobotModel | None = None, gains: Sequence[float] | None = None
) -> StoredRecording:
    """A recording of ours that stays in its file.

    Its pages carry checksums, which are verified as they are read; the fingerprint over the whole
    file is not computed again.

    Args:
        path: The Parquet file.
        robot: The robot; its joints must be those of the recording.
        gains: Drive gains [N.m/A] that override those of the recording.

    Raises:
        RecordError: Missing, foreign, damaged, or of another robot.
    """
    file = Path(path)
    with located(file.name), refused("the Parquet file is damaged or no dynid recording"):
        footer, _ = _footer(file, file.stat().st_mtime_ns)
        found, _, digest = described(footer)
        metadata, order, told = records.of_robot(found.metadata, found.joints, robot)
    return StoredRecording(
        path=file,
        samples=int(footer.num_rows),
        joints=found.joints,
        quantities=found.quantities,
        metadata=records.with_gains(metadata, found.joints, gains),
        problems=(*found.problems, *told),
        fingerprint=digest,
        order=order,
    )


@lru_cache(maxsize=2)
def _footer(path: Path, written_ns: int) -> tuple[Any, tuple[int, ...]]:
    """The footer of a file; the first row of each row group, and the number of rows."""
    del written_ns
    parquet = importlib.import_module("pyarrow.parquet")
    with refused("the Parquet file is damaged", where=path.name):
        footer = parquet.read_metadata(path)
        groups = [footer.row_group(k) for k in range(footer.num_row_groups)]
    for group in groups:
        most = BYTES_A_VALUE * group.num_rows * group.num_columns + SMALLEST
        if group.num_rows > MOST_ROWS_A_GROUP or group.total_byte_size > most:
            raise RecordError(
                "a row group is larger than any that dynid writes",
                where=path.name,
                value=f"{group.num_rows} rows, {group.total_byte_size} bytes",
                limit=f"{MOST_ROWS_A_GROUP} rows",
            )
    return footer, (0, *accumulate(int(group.num_rows) for group in groups))


@lru_cache(maxsize=2)
def _group(path: Path, columns: tuple[str, ...], written_ns: int, number: int) -> Array:
    """(c, N) some columns of a row group; neighbouring parts share one."""
    footer, _ = _footer(path, written_ns)
    parquet = importlib.import_module("pyarrow.parquet")
    with (
        refused("the Parquet file is damaged", where=path.name),
        parquet.ParquetFile(
            path,
            metadata=footer,
            page_checksum_verification=True,
            pre_buffer=False,
            buffer_size=1 << 18,
        ) as file,
    ):
        table = file.read_row_group(number, columns=list(columns), use_threads=False)
        return np.array([table.column(name).to_numpy() for name in columns], dtype=np.float64)
