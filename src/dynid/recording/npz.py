"""NumPy files: `.npz` archives of arrays, or one matrix in a `.npy`."""

from __future__ import annotations

import warnings
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core import Array, RecordError
from dynid.recording.table import RawTable
from dynid.recording.variables import numbers_of, table_of

_MAX_BYTES = 2 << 30


def read_npz(
    path: Path,
    *,
    columns: str | Mapping[str, str] | None = None,
    joints: int | None = None,
    names: Sequence[str] = (),
) -> RawTable:
    """Read a `.npz` or `.npy` file; nothing pickled is ever loaded.

    Args:
        path: The file.
        columns: Quantity to array name, as in `q=positions,t=time`; None to go by the names.
        joints: Number of joints, if known.
        names: The robot's joint names, if known.

    Raises:
        RecordError: Damaged, too large, pickled, or without the arrays.
    """
    variables: dict[str, Array] = {}
    try:
        if zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as archive:
                size = sum(item.file_size for item in archive.infolist())
            if size > _MAX_BYTES:
                raise RecordError(
                    "the arrays are too large", where=path.name, value=size, limit=_MAX_BYTES
                )
        with path.open("rb") as stream, np.errstate(all="ignore"), warnings.catch_warnings():
            # Files of Python 2 only load more slowly.
            warnings.simplefilter("ignore", UserWarning)
            content = np.load(stream, allow_pickle=False)
            arrays: dict[str, Any] = (
                {"array": content} if isinstance(content, np.ndarray) else dict(content)
            )
            for name, value in arrays.items():
                for own_name, part in _parts(name, value):
                    array = numbers_of(part)
                    if array is not None:
                        variables[own_name] = array
    except RecordError:
        raise
    # A damaged archive can fail in zipfile, zlib, the header parser or the allocation.
    except Exception as error:
        text = " ".join(str(error).split()) or type(error).__name__
        if "allow_pickle" in text:
            raise RecordError(
                "the file holds Python objects, which are pickled and never loaded",
                where=path.name,
                next_step="Save each array under its name: numpy.savez(file, t=t, q=q, tau=tau).",
            ) from error
        raise RecordError(
            "the NumPy file is damaged or not plain arrays",
            where=path.name,
            value=text,
            next_step="Save it again with numpy.savez.",
        ) from error
    if not variables:
        raise RecordError("there are no arrays of numbers", where=path.name)
    return table_of(variables, columns, joints=joints, where=path.name, format="npz", names=names)


def _parts(name: str, value: Any) -> list[tuple[str, Any]]:
    """An array, or each field of an array with named fields."""
    fields: tuple[str, ...] | None = getattr(value.dtype, "names", None)
    if not fields:
        return [(name, value)]
    return [(field if name == "array" else f"{name}.{field}", value[field]) for field in fields]
