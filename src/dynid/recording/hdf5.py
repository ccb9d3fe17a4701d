"""HDF5 files, MATLAB 7.3 among them: the arrays of numbers in them, by their paths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core import Array, MissingExtraError, RecordError, require
from dynid.recording.table import RawTable
from dynid.recording.variables import numbers_of, table_of

_AGAIN = "save it again (MATLAB: save(file, '-v7'))."
_MAX_VARIABLES = 5000
_MAX_ELEMENTS = 200
_MAX_VALUES = 500_000_000
_MAX_DEPTH = 12


def read_hdf5(
    path: Path,
    *,
    columns: str | Mapping[str, str] | None = None,
    joints: int | None = None,
    names: Sequence[str] = (),
) -> RawTable:
    """Read an HDF5 file or a MATLAB file of version 7.3.

    Groups and structs give paths (`rec.act_pos`), struct arrays and cells `run(2).q`, tables
    of named fields `table.field`.

    Args:
        path: The file.
        columns: Quantity to path, as in `q=robot.position,t=robot.time`; None to go by the
            names.
        joints: Number of joints, if known.
        names: The robot's joint names, if known.

    Raises:
        RecordError: Damaged, or without the arrays.
        MissingExtraError: Without the `hdf5` extra.
    """
    try:
        library = require("h5py", "hdf5")
    except MissingExtraError as error:
        raise MissingExtraError(
            error.what, where=path.name, next_step=f"Run: pip install 'dynid[hdf5]', or {_AGAIN}"
        ) from error
    variables: dict[str, Array] = {}
    try:
        with library.File(path, "r") as file:
            for name in file:
                # MATLAB keeps what its cells point to under #refs#.
                if not name.startswith("#"):
                    _collect(file, file[name], name, variables, 0)
    except RecordError:
        raise
    # libhdf5 reports damage as OSError, RuntimeError, KeyError, ValueError or TypeError.
    except Exception as error:
        text = " ".join(str(error).split())[:200] or type(error).__name__
        raise RecordError(
            "the HDF5 file is damaged",
            where=path.name,
            value=text,
            next_step=f"{_AGAIN[0].upper()}{_AGAIN[1:]}",
        ) from error
    if not variables:
        raise RecordError("there are no arrays of numbers", where=path.name)
    return table_of(variables, columns, joints=joints, where=path.name, format="hdf5", names=names)


def _collect(file: Any, item: Any, path: str, into: dict[str, Array], depth: int) -> None:
    if depth > _MAX_DEPTH or len(into) >= _MAX_VARIABLES:
        return
    if not hasattr(item, "dtype"):
        # pandas keeps its columns in blocks, and their names beside them.
        for name in [name for name in item if f"{name.partition('_')[0]}_items" in item]:
            if name.endswith("_values") and _keep_block(item, name, path, into):
                return
        for name in item:
            _collect(file, item[name], f"{path}.{name}", into, depth + 1)
        return
    if item.size > _MAX_VALUES:
        raise RecordError("an array is too large", where=path, value=item.shape)
    if item.dtype.names:
        table = item[()]
        for name in item.dtype.names:
            _keep(f"{path}.{name}", table[name], into)
    elif item.dtype.kind == "O" and item.dtype.metadata and "ref" in item.dtype.metadata:
        for number, reference in enumerate(item[()].ravel(order="F")[:_MAX_ELEMENTS]):
            if reference:
                # Fields of a struct array hold one reference an element.
                stem, _, last = path.rpartition(".")
                inner = f"{stem}({number + 1}).{last}" if stem else f"{path}({number + 1})"
                _collect(file, file[reference], inner, into, depth + 1)
    elif "MATLAB_empty" not in item.attrs:
        _keep(path, item[()], into)


def _keep_block(item: Any, name: str, path: str, into: dict[str, Array]) -> bool:
    """Keep each column of a block of a pandas table under its own name."""
    labels: list[Any] = item[name.replace("_values", "_items")][()].ravel().tolist()
    values = item[name][()]
    if values.ndim != 2 or values.shape[1] != len(labels):
        return False
    for k, label in enumerate(labels):
        text = label.decode(errors="replace") if isinstance(label, bytes) else str(label)
        _keep(f"{path}.{text}", values[:, k], into)
    return True


def _keep(path: str, value: Any, into: dict[str, Array]) -> None:
    array = numbers_of(np.squeeze(value) if np.ndim(value) > 2 else value)
    if array is not None:
        into[path] = array.ravel() if 1 in array.shape else array
