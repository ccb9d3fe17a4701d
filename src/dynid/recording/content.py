"""Bytes of files: plain ones, and compressed pieces with a bound on what comes out of them."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType
from typing import Any

from dynid.core import MissingExtraError, RecordError, require

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
MAX_BYTES = 1 << 28
"""Most that one compressed piece may hold [bytes]."""


class InflateError(ValueError):
    """The compressed bytes are damaged, or hold more than they may."""


def inflate(data: bytes, method: str, size: int | None = None) -> bytes:
    """Decompress one piece of a bag.

    Args:
        data: The compressed bytes.
        method: `zstd`, `lz4`, or empty for none.
        size: How many bytes must come out, where that is known.

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
    else:
        raise InflateError(f"unknown compression {method[:20]!r}")
    if size is not None and len(result) != size:
        raise InflateError("wrong size")
    return result


def _stream(decompressor: Any, data: bytes, limit: int) -> bytes:
    try:
        result: bytes = decompressor.decompress(data, max_length=limit + 1)
    # The two libraries share no exception: zstd has its own, lz4 raises RuntimeError.
    except Exception as error:
        raise InflateError("damaged") from error
    if len(result) > limit:
        raise InflateError("too large")
    return result


def zstd_module() -> ModuleType:
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
