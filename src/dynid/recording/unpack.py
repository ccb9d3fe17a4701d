"""Packed recordings: gzip, bzip2, xz, zstd, zip archives of one file, and Excel workbooks."""

from __future__ import annotations

import bz2
import gzip
import lzma
import tempfile
import zipfile
import zlib
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from dynid.core import RecordError
from dynid.recording.bag.inflate import zstd_module
from dynid.recording.opening import first_bytes
from dynid.recording.workbook import is_workbook, write_sheet

_MARKS = {b"\x1f\x8b": "gzip", b"BZh": "bzip2", b"\xfd7zXZ\x00": "xz", b"\x28\xb5\x2f\xfd": "zstd"}
_MOST_BYTES = 8 << 30
_BLOCK = 1 << 20


def packing(path: Path) -> str:
    """How a file is packed: `gzip`, `bzip2`, `xz`, `zstd`, `zip`, `xlsx`; empty for not at all.

    Args:
        path: The file.

    Raises:
        RecordError: It cannot be read.
    """
    head = first_bytes(path, 1 << 12)
    for mark, kind in _MARKS.items():
        if head.startswith(mark):
            return kind
    if not head.startswith(b"PK\x03\x04") or b".npy" in head[:200]:
        return ""
    if is_workbook(path):
        return "xlsx"
    return "zip" if path.suffix.lower() == ".zip" else ""


@contextmanager
def unpacked(files: Sequence[Path]) -> Generator[list[Path]]:
    """The files, each compressed one in place of which its content stands for a while.

    Args:
        files: Recordings; folders pass through.

    Yields:
        Paths of the plain files.

    Raises:
        RecordError: Damaged, too large, or a zip archive of several files.
        MissingExtraError: zstd without its package.
    """
    kinds = ["" if file.is_dir() else packing(file) for file in files]
    if not any(kinds):
        yield list(files)
        return
    with tempfile.TemporaryDirectory(prefix="dynid-") as folder:
        plain: list[Path] = []
        for number, (file, kind) in enumerate(zip(files, kinds, strict=True)):
            if not kind:
                plain.append(file)
                continue
            place = Path(folder) / str(number)
            place.mkdir()
            # Messages name the file that the user gave.
            target = place / file.name
            if kind == "xlsx":
                write_sheet(file, target)
                plain.append(target)
                continue
            try:
                with _opened(file, kind) as source, target.open("wb") as sink:
                    _copy(source, sink, file)
            except RecordError:
                raise
            # The libraries share no exception for damaged bytes.
            except (
                *(OSError, EOFError, ValueError, RuntimeError, NotImplementedError),
                *(zlib.error, lzma.LZMAError, zipfile.BadZipFile, *_zstd_errors(kind)),
            ) as error:
                raise RecordError(
                    f"the {kind} file is damaged",
                    where=file.name,
                    value=str(error) or None,
                    next_step="Copy it again, or unpack what is left of it and import that.",
                ) from error
            plain.append(target)
        yield plain


def _opened(file: Path, kind: str) -> IO[bytes] | gzip.GzipFile:
    if kind == "gzip":
        return gzip.open(file)
    if kind == "bzip2":
        return bz2.open(file)
    if kind == "xz":
        return lzma.open(file)
    if kind == "zstd":
        return zstd_module().open(file, "rb")
    try:
        archive = zipfile.ZipFile(file)
        members = [item for item in archive.infolist() if not item.is_dir()]
    except zipfile.BadZipFile as error:
        raise RecordError("the zip file is damaged", where=file.name) from error
    if len(members) != 1:
        raise RecordError(
            "the zip archive holds several files",
            where=file.name,
            value=[item.filename for item in members][:10],
            next_step=f"Unpack it first: unzip {file.name}",
        )
    return archive.open(members[0])


def _zstd_errors(kind: str) -> tuple[type[Exception], ...]:
    """What zstd raises, which only its own package knows."""
    return (zstd_module().ZstdError,) if kind == "zstd" else ()


def _copy(source: IO[bytes] | gzip.GzipFile, sink: IO[bytes], file: Path) -> None:
    written = 0
    while block := source.read(_BLOCK):
        written += len(block)
        if written > _MOST_BYTES:
            raise RecordError(
                "the file is too large when unpacked",
                where=file.name,
                limit=f"{_MOST_BYTES} bytes",
            )
        sink.write(block)
    if written == 0:
        raise RecordError("the compressed file is empty", where=file.name)
