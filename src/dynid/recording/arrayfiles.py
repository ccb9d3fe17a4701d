"""Typed tables (Parquet, Arrow, workbooks) and named arrays (HDF5, MATLAB 7.3, NumPy, JSON)."""

import importlib
import json
import warnings
import zipfile
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import Any, cast

import numpy as np

from dynid.core import Array, MissingExtraError, RecordError, parse_json, require
from dynid.recording.columns import assign
from dynid.recording.content import Budget, all_bytes, refused
from dynid.recording.table import RawTable, ReadOptions
from dynid.recording.variables import numbers_of, table_of

_MAX_ITEMS = 200
_FEWEST_ROWS = 3
_AS_CSV = "Save the sheet as CSV."


def read_frame(files: list[Path], options: ReadOptions, budget: Budget) -> RawTable:
    """Read a Parquet or Arrow table that dynid did not write; see `Reader`.

    Columns of lists count as one column an item: `position[0]`, `position[1]`, ...
    """
    path = files[0]
    with refused("the table is damaged"):
        table = _load(path, budget)
        named = [item for name in table.column_names for item in _columns(name, table.column(name))]
    if not named:
        raise RecordError("there are no columns of numbers")
    names = [name for name, _ in named]
    found = assign(names, options.columns, len(names), options.joints)
    return found.table(
        names,
        lambda k: named[k][1],
        format="parquet",
        rows=np.arange(1, len(named[0][1]) + 1, dtype=np.int64),
        row_word="row",
    )


def _load(path: Path, budget: Budget) -> Any:
    with path.open("rb") as stream:
        arrow = stream.read(6) == b"ARROW1"
    if arrow:
        return importlib.import_module("pyarrow.feather").read_table(path, memory_map=False)
    parquet = importlib.import_module("pyarrow.parquet")
    facts = parquet.read_metadata(path)
    budget.require_values(facts.num_rows * facts.num_columns)
    return parquet.read_table(path, use_threads=False)


def _columns(name: str, column: Any) -> list[tuple[str, Array]]:
    """Name and numbers of a column, or of each item of its lists; nothing for text."""
    types = importlib.import_module("pyarrow.types")
    kind = column.type
    if types.is_timestamp(kind):
        # Seconds as float64 are exact to a quarter of a microsecond.
        ticks = column.cast("int64", safe=False).to_numpy(zero_copy_only=False)
        scale = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[kind.unit]
        return [(f"{name} [s]", np.asarray(ticks, dtype=np.float64) * scale)]
    if types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind):
        if not (types.is_floating(kind.value_type) or types.is_integer(kind.value_type)):
            return []
        rows: list[Any] = column.to_pylist()
        width = max((len(row) for row in rows if row is not None), default=0)
        if not 0 < width <= _MAX_ITEMS:
            return []
        values = np.full((len(rows), width), np.nan)
        for k, row in enumerate(rows):
            if row is not None and len(row) == width:
                values[k] = [np.nan if item is None else item for item in row]
        return [(f"{name}[{k}]", values[:, k]) for k in range(width)]
    if types.is_floating(kind) or types.is_integer(kind) or types.is_boolean(kind):
        return [(name, np.asarray(column.to_numpy(zero_copy_only=False), dtype=np.float64))]
    return []


def write_sheet(path: Path, target: Path) -> None:
    """Write the only sheet of numbers of a workbook as text, with tabs between cells.

    Raises:
        RecordError: Damaged, or none or several sheets of numbers.
        MissingExtraError: Without the `excel` extra.
    """
    library = require("python_calamine", "excel")
    with refused("the workbook is damaged", _AS_CSV):
        book = library.CalamineWorkbook.from_path(str(path))
        names: list[str] = book.sheet_names
        full = [sheet for sheet in map(book.get_sheet_by_name, names) if _has_numbers(sheet)]
        if len(full) != 1:
            raise RecordError(
                f"the workbook has {len(full) or 'no'} sheets of numbers",
                value=names[:20],
                next_step=_AS_CSV,
            )
        with target.open("w", encoding="utf-8") as sink:
            for row in full[0].iter_rows():
                sink.write("\t".join(map(_cell, row)).rstrip("\t") + "\n")


def _has_numbers(sheet: Any) -> bool:
    """Whether at least some rows are mostly numbers."""
    found = 0
    for row in sheet.iter_rows():
        numbers = sum(isinstance(cell, (int, float)) for cell in row)
        found += numbers > 1 and 2 * numbers > sum(cell != "" for cell in row)
        if found >= _FEWEST_ROWS:
            return True
    return False


def _cell(value: Any) -> str:
    if isinstance(value, (datetime, time)):
        return value.isoformat()
    if isinstance(value, date):
        # Midnight is no less a stamp than those after it.
        return f"{value}T00:00:00"
    if isinstance(value, timedelta):
        return repr(value.total_seconds())
    # `#DIV/0!` is no value.
    return "" if str(value).startswith("#") else " ".join(str(value).split())


_AGAIN = "ave it again (MATLAB: save(file, '-v7'))."
_MAX_VARIABLES = 5000
_MAX_ELEMENTS = 200
_MAX_DEPTH = 12


def read_hdf5(files: list[Path], options: ReadOptions, budget: Budget) -> RawTable:
    """Read an HDF5 file or a MATLAB file of version 7.3; see `Reader`.

    Groups and structs give paths (`rec.act_pos`), struct arrays and cells `run(2).q`, tables
    of named fields `table.field`.
    """
    path = files[0]
    try:
        library = require("h5py", "hdf5")
    except MissingExtraError as error:
        step = f"Run: pip install 'dynid[hdf5]', or s{_AGAIN}"
        raise MissingExtraError(error.what, next_step=step) from error
    variables: dict[str, Array] = {}
    with refused("the HDF5 file is damaged", f"S{_AGAIN}"), library.File(path, "r") as file:
        for name in file:
            # MATLAB keeps what its cells point to under #refs#.
            if not name.startswith("#"):
                _collect(file, _own(file, name, name), name, variables, 0, budget)
    return table_of(variables, options)


def _own(group: Any, name: str, path: str) -> Any:
    """A member of a group, if it is in this file.

    Raises:
        RecordError: A link to another file, or values that lie outside of this one.
    """
    link = group.get(name, getlink=True)
    if type(link).__name__ == "ExternalLink":
        raise RecordError("a link leads to another file, which is not followed", value=path)
    item = group[name]
    if getattr(item, "external", None) or getattr(item, "is_virtual", False):
        raise RecordError("an array lies in another file, which is not read", value=path)
    return item


def _collect(
    file: Any, item: Any, path: str, into: dict[str, Array], depth: int, budget: Budget
) -> None:
    if depth > _MAX_DEPTH or len(into) >= _MAX_VARIABLES:
        return
    if not hasattr(item, "dtype"):
        # pandas keeps its columns in blocks, and their names beside them.
        for name in [name for name in item if f"{name.partition('_')[0]}_items" in item]:
            if name.endswith("_values") and _keep_block(item, name, path, into, budget):
                return
        for name in item:
            _collect(file, _own(item, name, path), f"{path}.{name}", into, depth + 1, budget)
        return
    taken = sum(value.size for value in into.values())
    budget.require_values((item.size + taken) * max(1, len(item.dtype.names or ())))
    if item.dtype.kind == "O" and item.dtype.metadata and "ref" in item.dtype.metadata:
        for number, reference in enumerate(item[()].ravel(order="F")[:_MAX_ELEMENTS]):
            if reference:
                # Fields of a struct array hold one reference an element.
                stem, _, last = path.rpartition(".")
                inner = f"{stem}({number + 1}).{last}" if stem else f"{path}({number + 1})"
                _collect(file, file[reference], inner, into, depth + 1, budget)
    elif "MATLAB_empty" not in item.attrs:
        unit = item.attrs.get("unit", item.attrs.get("units"))
        mark = f" [{unit}]" if isinstance(unit, str) and unit else ""
        for name, value in _parts(path, item[()]):
            _keep(f"{name}{mark}", value, into)


def _keep_block(item: Any, name: str, path: str, into: dict[str, Array], budget: Budget) -> bool:
    """Keep each column of a block of a pandas table under its own name."""
    parts = [_own(item, part, path) for part in (name.replace("_values", "_items"), name)]
    budget.require_values(sum(part.size for part in parts))
    labels: list[Any] = parts[0][()].ravel().tolist()
    values = parts[1][()]
    if values.ndim != 2 or values.shape[1] != len(labels):
        return False
    for k, label in enumerate(labels):
        text = label.decode(errors="replace") if isinstance(label, bytes) else str(label)
        _keep(f"{path}.{text}", values[:, k], into)
    return True


def _keep(path: str, value: Any, into: dict[str, Array]) -> None:
    array = numbers_of(value)
    if array is not None:
        into[path] = array


_MAX_BYTES = 2 << 30


def read_npz(files: list[Path], options: ReadOptions, budget: Budget) -> RawTable:
    """Read a `.npz` or `.npy` file; nothing pickled is ever loaded; see `Reader`."""
    path = files[0]
    variables: dict[str, Array] = {}
    with refused(
        "the NumPy file is damaged, or holds pickled Python objects, which are never loaded",
        "Save each array under its name: numpy.savez(file, t=t, q=q, tau=tau).",
    ):
        if zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as archive:
                size = sum(item.file_size for item in archive.infolist())
            if size > _MAX_BYTES:
                raise RecordError("the arrays are too large", value=size, limit=_MAX_BYTES)
        with path.open("rb") as stream, np.errstate(all="ignore"), warnings.catch_warnings():
            # Files of Python 2 only load more slowly.
            warnings.simplefilter("ignore", UserWarning)
            content = np.load(stream, allow_pickle=False)
            arrays: dict[str, Any] = (
                {"array": content} if isinstance(content, np.ndarray) else dict(content)
            )
            for name, value in arrays.items():
                for own_name, part in _parts(name, value):
                    _keep(own_name, part, variables)
    return table_of(variables, options)


def _parts(name: str, value: Any) -> list[tuple[str, Any]]:
    """An array, or each field of an array with named fields."""
    fields: tuple[str, ...] | None = getattr(getattr(value, "dtype", None), "names", None)
    if not fields:
        return [(name, value)]
    return [(field if name == "array" else f"{name}.{field}", value[field]) for field in fields]


_JSON_MAX_BYTES = 1 << 30


def read_json(files: list[Path], options: ReadOptions, budget: Budget) -> RawTable:
    """Read arrays of numbers from a JSON file; see `Reader`."""
    path = files[0]
    data = all_bytes(path, _JSON_MAX_BYTES)
    with refused("the JSON file is damaged"):
        content = _parse(data.decode("utf-8-sig"))
    variables: dict[str, Array] = {}
    _collect_json(content, "", variables, 0)
    return table_of(variables, options)


def _parse(text: str) -> Any:
    try:
        return parse_json(text)
    except json.JSONDecodeError:
        lines = [line for line in text.splitlines() if line.strip()]
        if len(lines) < 2:
            raise
        return [parse_json(line) for line in lines]


def _collect_json(item: Any, path: str, into: dict[str, Array], depth: int) -> None:
    if depth > _MAX_DEPTH:
        return
    if isinstance(item, dict):
        for name, value in _by_columns(cast("dict[str, Any]", item)).items():
            _collect_json(value, f"{path}.{name}" if path else str(name), into, depth + 1)
    elif isinstance(item, list):
        rows = cast("list[Any]", item)
        if rows and all(isinstance(row, dict) for row in rows):
            # One object a row: each field becomes an array, as far as all rows have it.
            first = cast("dict[str, Any]", rows[0])
            for name in first:
                if all(name in row for row in rows):
                    inner = f"{path}.{name}" if path else str(name)
                    _collect_json([row[name] for row in rows], inner, into, depth + 1)
            return
        try:
            array = numbers_of(np.array(rows))
        except (ValueError, OverflowError):
            return
        if array is not None and array.size:
            into[path or "array"] = array


def _by_columns(item: dict[str, Any]) -> dict[str, Any]:
    """An object as it is, or a pandas table as one list a column.

    `DataFrame.to_json` writes objects of rows by their numbers, or `columns` beside `data`.
    """
    names, rows = item.get("columns"), item.get("data")
    if isinstance(names, list) and isinstance(rows, list):
        listed, table = cast("list[Any]", names), cast("list[Any]", rows)
        width = len(listed)
        if table and all(
            isinstance(row, list) and len(cast("list[Any]", row)) == width for row in table
        ):
            return {str(name): [row[k] for row in table] for k, name in enumerate(listed)}
    found: dict[str, Any] = {}
    for name, value in item.items():
        inner = cast("dict[str, Any]", value) if isinstance(value, dict) else {}
        counted = bool(inner) and list(inner) == [str(k) for k in range(len(inner))]
        found[name] = list(inner.values()) if counted else value
    return found
