"""Bytes of files, compressed ones with a bound, and what reading a file may cost.

The budget counts memory, time, temporary space and values by the file's size. A file of up to 20 MB
may claim anything: it gets a fixed budget. What a larger file needs grows with its size, so that
long recordings have no bound of their own.
"""

import importlib
import shutil
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dynid.core import DynidError, InputError, MissingExtraError, RecordError, require

_SMALL = 20_000_000
"""Files up to this size [bytes] share one budget."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """What reading may cost."""

    memory_bytes: int = 1 << 30
    """Memory of the reader, beyond what its program takes."""
    cpu_s: float = 17.0
    """CPU time of the reader."""
    unpacked_bytes: int = 512 << 20
    """Size of what comes out of compressed files, on disk."""
    values: int = 16_000_000
    """Numbers in the table that is read, and in the arrays it is chosen from."""

    @classmethod
    def of(cls, files: Sequence[Path]) -> "Budget":
        """The budget for files that belong together."""
        more = max(0, sum(file.stat().st_size for file in files) - _SMALL)
        return cls(
            memory_bytes=(1 << 30) + 30 * more,
            cpu_s=17.0 + 2e-6 * more,
            unpacked_bytes=(512 << 20) + 30 * more,
            values=16_000_000 + 4 * more,
        )

    def require_values(self, count: int) -> None:
        """Check a number of values that a file claims before anything of that size is made.

        Raises:
            RecordError: More values than a file of this size may have.
        """
        if count > self.values:
            raise RecordError(
                "the header states more numbers than a file of this size may contain",
                value=f"{count:.3g} numbers",
                limit=f"{self.values:.3g}",
                next_step="Save only the signals of the joints, or split the recording.",
            )

    def require_space(self, folder: str) -> int:
        """Bytes that unpacking may write into a folder: the budget, as far as the disk has them.

        Raises:
            RecordError: The disk is nearly full.
        """
        free = shutil.disk_usage(folder).free - (64 << 20)
        if free <= 0:
            raise RecordError(
                "there is no room to unpack the file",
                where=folder,
                limit="64 MB must stay free",
                next_step="Free some space, or set TMPDIR to a folder on another disk.",
            )
        return min(self.unpacked_bytes, free)


ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
MAX_BYTES = 1 << 28
"""Most that one compressed piece may hold [bytes]."""


class InflateError(ValueError):
    """The compressed bytes are damaged, or hold more than they may."""


def inflate(data: bytes, method: str, size: int | None = None) -> bytes:
    """Decompress one piece of a bag (zstd, lz4, bz2, nothing), to `size` bytes where it is known.

    Raises:
        InflateError: Damaged bytes, an unknown method, or the wrong size.
        MissingExtraError: The decompressor is not installed.
    """
    limit = MAX_BYTES if size is None else size
    if limit > MAX_BYTES:
        raise InflateError("too large")
    if method == "":
        result = data
    elif method == "zstd":
        result = _stream(zstd_module().ZstdDecompressor(), data, limit)
    elif method == "lz4":
        frame = require("lz4.frame", "ros")
        result = _stream(frame.LZ4FrameDecompressor(), data, limit)
    elif method == "bz2":
        result = _stream(require("bz2").BZ2Decompressor(), data, limit)
    else:
        raise InflateError(f"unknown compression {method[:20]!r}")
    if size is not None and len(result) != size:
        raise InflateError("wrong size")
    return result


def _stream(decompressor: Any, data: bytes, limit: int) -> bytes:
    try:
        result: bytes = decompressor.decompress(data, max_length=limit + 1)
    # The libraries share no exception: zstd has its own, lz4 raises RuntimeError.
    except Exception as error:
        raise InflateError("damaged") from error
    if len(result) > limit:
        raise InflateError("too large")
    return result


def zstd_module() -> Any:
    """Python's own zstd, or the package that brings it to older Pythons.

    Raises:
        MissingExtraError: Neither is there.
    """
    for name in ("compression.zstd", "backports.zstd"):
        try:
            return importlib.import_module(name)
        except ModuleNotFoundError:
            continue
    raise MissingExtraError(
        "this needs the package 'backports.zstd'", next_step="Run: pip install 'dynid[ros]'"
    )


def said(error: BaseException) -> str:
    """What a library's error says, on one line."""
    return " ".join(str(error).split())[:200] or type(error).__name__


@contextmanager
def refused(
    what: str,
    next_step: str | None = None,
    *,
    where: str | None = None,
    kind: type[InputError] = RecordError,
) -> Generator[None]:
    """Whatever a library raises inside as one error of ours: on damaged bytes that is many kinds.

    Args:
        what: What is wrong then.
        next_step: What to do.
        where: The file, unless `located` tells it.
        kind: The error of ours.

    Raises:
        InputError: Of that kind.
        MemoryError: Not what was wrong with the bytes, but that memory was used up.
    """
    try:
        yield
    except (DynidError, MemoryError):
        raise
    except Exception as error:
        if "bad_alloc" in str(error):
            # All that Arrow tells of an allocation that failed within a library of its own.
            raise MemoryError from error
        raise kind(what, where=where, value=said(error), next_step=next_step) from error


@contextmanager
def located(where: str) -> Generator[None]:
    """The place of those errors raised inside that name none: the file that is read.

    Raises:
        RecordError: In place of an OSError: the system does not let us read.
    """
    try:
        yield
    except DynidError as error:
        if error.where is None:
            raise error.changed(where=where) from error
        raise
    except OSError as error:
        raise RecordError("the file cannot be read", where=where, value=error.strerror) from error


def first_bytes(path: Path, count: int) -> bytes:
    """At most `count` bytes from the start of a file; RecordError where it cannot be read."""
    with located(path.name), path.open("rb") as stream:
        return stream.read(count)
