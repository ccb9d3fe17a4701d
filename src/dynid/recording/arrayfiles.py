"""Typed tables (Parquet, Arrow) and named arrays (MATLAB, HDF5, NumPy, JSON).

SciPy reads MATLAB files of version 5 to 7, variable by variable, so that a damaged or cut one costs
no other. On some damaged files (1 of 600 random mutations) it ends the interpreter: that is the
reading process of its own, which the caller sees as one error.
"""

import importlib
import json
import struct
import warnings
import zlib
from dataclasses import dataclass, field
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from dynid.core import Array, MissingExtraError, RecordError, parse_json, printable, require
from dynid.recording.columns import assign
from dynid.recording.content import Budget, first_bytes, refused
from dynid.recording.names import holds_names, one_order
from dynid.recording.table import RawTable, ReadOptions
from dynid.recording.variables import moments_of, numbers_of, table_of

_MAX_ITEMS = 200


def read_frame(files: list[Path], options: ReadOptions, budget: Budget) -> RawTable:
    """Read a Parquet or Arrow table that dynid did not write; see `Reader`.

    Columns of lists count as one column an item: `position[0]`, `position[1]`, ...
    """
    path = files[0]
    with refused("the table is damaged"):
        table = _load(path, budget)
        joints = _joint_names(table)
        named = [item for name in table.column_names for item in _columns(name, table.column(name))]
    if not named:
        raise RecordError("there are no columns of numbers")
    names = [name for name, _ in named]
    found = assign(names, options.columns, len(names), options.joints)
    return found.table(
        names,
        lambda k: named[k][1],
        beside=joints,
        format="parquet",
        rows=np.arange(1, len(named[0][1]) + 1, dtype=np.int64),
        row_word="row",
    )


def _joint_names(table: Any) -> tuple[str, ...]:
    """The joint names that stand in a column of lists, as in messages of ROS."""
    types = importlib.import_module("pyarrow.types")
    for name in filter(holds_names, table.column_names):
        column = table.column(name)
        listed = types.is_list(column.type) or types.is_large_list(column.type)
        if listed and _is_text(types, column.type.value_type):
            rows: list[Any] = column.to_pylist()
            return one_order([list(map(str, row)) for row in rows if row], name)
    return ()


def _is_text(types: Any, kind: Any) -> bool:
    return bool(types.is_string(kind) or types.is_large_string(kind) or types.is_string_view(kind))


def _load(path: Path, budget: Budget) -> Any:
    if first_bytes(path, 6) == b"ARROW1":
        return importlib.import_module("pyarrow.feather").read_table(path, memory_map=False)
    parquet = importlib.import_module("pyarrow.parquet")
    facts = parquet.read_metadata(path)
    budget.require_values(facts.num_rows * facts.num_columns)
    return parquet.read_table(path, use_threads=False)


def _columns(name: str, column: Any) -> list[tuple[str, Array]]:
    """Name and numbers of a column, or of each item of its lists; of text only dates."""
    types = importlib.import_module("pyarrow.types")
    kind = column.type
    if types.is_timestamp(kind) or types.is_duration(kind) or types.is_time64(kind):
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
    if types.is_decimal(kind):
        return _columns(name, column.cast("float64"))
    if types.is_floating(kind) or types.is_integer(kind) or types.is_boolean(kind):
        return [(name, np.asarray(column.to_numpy(zero_copy_only=False), dtype=np.float64))]
    found = moments_of(map(str, column.to_pylist())) if _is_text(types, kind) else None
    return [] if found is None else [(f"{name} [s]", found)]


_MAX_VARIABLES, _MAX_ELEMENTS, _MAX_DEPTH = 5000, 200, 12


@dataclass(slots=True)
class _Contents:
    """The arrays of numbers in a file."""

    arrays: dict[str, Array] = field(default_factory=dict[str, Array])
    """Path (`rec.act_pos`, `run(2).q`) to array of one or two axes."""
    names: dict[str, tuple[str, ...]] = field(default_factory=dict[str, tuple[str, ...]])
    """Path to the joint names that stand there."""
    objects: int = 0
    """Variables of MATLAB's own classes (timeseries, table), which only MATLAB can read."""

    def collect(self, value: Any, path: str, depth: int = 0) -> None:
        """Take the arrays of numbers in a value that stands at a path."""
        if depth > _MAX_DEPTH or len(self.arrays) >= _MAX_VARIABLES:
            return
        if isinstance(value, dict):
            for name, item in _by_columns(cast("dict[str, Any]", value)).items():
                self.collect(item, f"{path}.{name}" if path else str(name), depth + 1)
        elif isinstance(value, list):
            self._collect_list(cast("list[Any]", value), path, depth)
        elif type(value).__name__ in ("MatlabOpaque", "MatlabFunction"):
            self.objects += type(value).__name__ == "MatlabOpaque"
        elif fields := getattr(value, "dtype", np.dtype(object)).names:
            # Where all fields are objects, elements are structs.
            structs = all(value.dtype[name].kind == "O" for name in fields)
            elements = value.ravel(order="F")[:_MAX_ELEMENTS] if structs else [value]
            for number, element in enumerate(elements, 1):
                stem = path if value.size == 1 or not structs else f"{path}({number})"
                for name in fields:
                    inner = f"{stem}.{printable(name, 80)}" if stem else name
                    self.collect(element[name], inner, depth + 1)
        elif holds_names(path) and len(texts := _texts(value)):
            self.names[path] = one_order(texts, path)
        elif np.asarray(value).dtype.kind == "O":
            self._collect_cells(value, path, depth)
        elif (array := numbers_of(value)) is not None and array.size:
            dated = np.asarray(value).dtype.kind in "mMU"
            self.arrays[f"{path} [s]" if dated else path or "array"] = array

    def _collect_list(self, rows: list[Any], path: str, depth: int) -> None:
        known = [row for row in rows if row is not None]
        if known and all(isinstance(row, dict) for row in known):
            # One object a row: each field becomes an array; a row without it has no value.
            names = dict.fromkeys(chain.from_iterable(known))
            fields = {name: [row and row.get(name) for row in rows] for name in names}
            self.collect(fields, path, depth)
            return
        # What is null is missing; in place of a list, all of it.
        width = len(cast("list[Any]", known[0])) if known and isinstance(known[0], list) else 0
        # The joints' names stand in any of the rows.
        named = width > 0 and holds_names(path)
        rows = known if named else [[None] * width or None if row is None else row for row in rows]
        try:
            array = np.array(rows)
            array = np.array(rows, dtype=np.float64) if array.dtype.kind == "O" else array
        except (TypeError, ValueError, OverflowError):
            return
        self.collect(array, path, depth)

    def _collect_cells(self, cells: Any, path: str, depth: int) -> None:
        own = _Contents()
        for number, element in enumerate(cells.ravel(order="F")[:_MAX_ELEMENTS], 1):
            own.collect(element, f"{path}({number})", depth + 1)
        columns = list(own.arrays.values())
        # Vectors as long as each other are the columns of a matrix.
        alike = len(columns) == cells.size > 1 and len({x.shape for x in columns}) == 1
        if alike and columns[0].ndim == 1 and columns[0].size > cells.size:
            own.arrays = {path: np.column_stack(columns)}
        self.arrays.update(own.arrays)
        self.objects += own.objects


def _texts(value: Any) -> list[list[str]]:
    """Rows of words, of lists of them and of MATLAB's cells and matrices of letters."""
    array: NDArray[Any] = np.atleast_1d(np.asarray(value).squeeze())
    if array.ndim > 2 or array.dtype.kind not in "OUS":
        return []
    words: list[str] = []
    for item in array.ravel().tolist():
        inner: NDArray[Any] = np.asarray(item)
        if inner.size != 1 or inner.dtype.kind not in "US":
            return []
        word = inner.ravel()[0]
        words.append((word.decode(errors="replace") if isinstance(word, bytes) else word).strip())
    width = array.shape[-1]
    return [words[k : k + width] for k in range(0, len(words), width)]


def _by_columns(item: dict[str, Any]) -> dict[str, Any]:
    """An object as it is, or a pandas table as one list a column.

    `DataFrame.to_json` writes objects of rows by their numbers.
    """
    found: dict[str, Any] = {}
    for name, value in item.items():
        inner = cast("dict[str, Any]", value) if isinstance(value, dict) else {}
        counted = bool(inner) and list(inner) == [str(k) for k in range(len(inner))]
        found[name] = list(inner.values()) if counted else value
    return found


_AGAIN = "ave it again (MATLAB: save(file, '-v7'))."


def read_hdf5(files: list[Path], options: ReadOptions, budget: Budget) -> RawTable:
    """Read an HDF5 file or a MATLAB file of version 7.3; see `Reader`.

    Groups and structs give paths (`rec.act_pos`), struct arrays and cells `run(2).q`, tables
    of named fields `table.field`.
    """
    try:
        library = require("h5py", "hdf5")
    except MissingExtraError as error:
        step = f"Run: pip install 'dynid[hdf5]', or s{_AGAIN}"
        raise MissingExtraError(error.what, next_step=step) from error
    contents = _Contents()
    with refused("the HDF5 file is damaged", f"S{_AGAIN}"), library.File(files[0], "r") as file:
        for name in file:
            # MATLAB keeps what its cells point to under #refs#.
            if not name.startswith("#"):
                _collect_hdf5(file, _own(file, name, name), name, contents, 0, budget)
    return table_of(contents.arrays, options, contents.names)


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


def _collect_hdf5(
    file: Any, item: Any, path: str, into: _Contents, depth: int, budget: Budget
) -> None:
    if depth > _MAX_DEPTH or len(into.arrays) >= _MAX_VARIABLES:
        return
    if not hasattr(item, "dtype"):
        # pandas keeps its columns in blocks, and their names beside them.
        for name in [name for name in item if f"{name.partition('_')[0]}_items" in item]:
            if name.endswith("_values") and _collect_block(item, name, path, into, budget):
                return
        for name in item:
            own = _own(item, name, path)
            _collect_hdf5(file, own, f"{path}.{name}", into, depth + 1, budget)
        return
    taken = sum(value.size for value in into.arrays.values())
    budget.require_values((item.size + taken) * max(1, len(item.dtype.names or ())))
    if holds_names(path) and (words := _letters(file, item)):
        into.collect(np.array(words), path, depth)
    elif _refers(item):
        for number, reference in enumerate(item[()].ravel(order="F")[:_MAX_ELEMENTS]):
            if reference:
                # Fields of a struct array hold one reference an element.
                stem, _, last = path.rpartition(".")
                inner = f"{stem}({number + 1}).{last}" if stem else f"{path}({number + 1})"
                _collect_hdf5(file, file[reference], inner, into, depth + 1, budget)
    elif item.dtype.kind == "O" and holds_names(path):
        into.collect(item[()], path, depth)
    elif "MATLAB_empty" not in item.attrs and item.dtype.kind != "O":
        # MATLAB and C write bytes, or an array of one text or of one a column.
        units = {*chain(*_texts(item.attrs.get("unit", item.attrs.get("units"))))}
        mark = f" [{units.pop()}]" if len(units) == 1 and "" not in units else ""
        into.collect(item[()], f"{path}{mark}", depth)


def _refers(item: Any) -> bool:
    """Whether an array holds references, as MATLAB's cells and struct arrays do."""
    return item.dtype.kind == "O" and "ref" in (item.dtype.metadata or {})


def _letters(file: Any, item: Any) -> list[str]:
    """The texts of a cell or matrix of letters, which MATLAB writes as numbers of two bytes."""
    cells = item[()].ravel(order="F")[:_MAX_ELEMENTS] if _refers(item) else ()
    parts = [file[reference] for reference in cells if reference] or [item]
    # A group, as of a struct, has no dtype.
    letters = [x for x in parts if getattr(x, "dtype", None) == np.uint16 and x.ndim == 2]
    return ["".join(map(chr, row)) for part in letters for row in part[()].T.tolist()]


def _collect_block(item: Any, name: str, path: str, into: _Contents, budget: Budget) -> bool:
    """Take each column of a block of a pandas table under its own name."""
    parts = [_own(item, part, path) for part in (name.replace("_values", "_items"), name)]
    budget.require_values(sum(part.size for part in parts))
    labels: list[Any] = parts[0][()].ravel().tolist()
    values = parts[1][()]
    if values.ndim != 2 or values.shape[1] != len(labels):
        return False
    for k, label in enumerate(labels):
        text = label.decode(errors="replace") if isinstance(label, bytes) else str(label)
        into.collect(values[:, k], f"{path}.{text}")
    return True


def read_npz(files: list[Path], options: ReadOptions, budget: Budget) -> RawTable:
    """Read a `.npz` or `.npy` file; nothing pickled is ever loaded; see `Reader`."""
    contents = _Contents()
    with (
        refused(
            "the NumPy file is damaged, or holds pickled Python objects, which are never loaded",
            "Save each array under its name: numpy.savez(file, t=t, q=q, tau=tau).",
        ),
        np.errstate(all="ignore"),
        warnings.catch_warnings(),
    ):
        # Files of Python 2 only load more slowly.
        warnings.simplefilter("ignore", UserWarning)
        content = np.load(files[0], allow_pickle=False)
        contents.collect(content if isinstance(content, np.ndarray) else dict(content), "")
    return table_of(contents.arrays, options, contents.names)


def _json_lines(text: str) -> list[object]:
    """The values of a text of one value a line; none where its first line is no value.

    A line that is no value is None, as a row without numbers.
    """
    lines = [line for line in text.splitlines() if line.strip()]
    found: list[object] = []
    for line in lines if len(lines) > 1 else []:
        try:
            found.append(parse_json(line))
        except json.JSONDecodeError:
            if not found:
                break
            found.append(None)
    return found


def read_json(files: list[Path], options: ReadOptions, budget: Budget) -> RawTable:
    """Read arrays of numbers from a JSON file; see `Reader`."""
    path, contents, cut = files[0], _Contents(), False
    data = path.read_bytes()
    with refused("the JSON file is damaged"):
        text = data.decode("utf-8-sig")
        try:
            content = parse_json(text)
        except json.JSONDecodeError as damage:
            content = _json_lines(text)
            if not content:
                raise damage from None
            if cut := content[-1] is None:
                content.pop()
    if isinstance(content, dict | list):
        contents.collect(content, "")
    table = table_of(contents.arrays, options, contents.names)
    if cut:
        text = f"the last line of {path.name} stops in the middle; it is left out"
        table = table.report("truncated_file", text)
    return table


_HEADER = 128
"""Bytes before the first variable of a MATLAB file; the last two tell the byte order."""
_MATRIX, _COMPRESSED = 14, 15
_PLAIN = "Save plain arrays in MATLAB: t = ts.Time; q = ts.Data; save(file, 't', 'q', '-v7')."
_SAVE = "Save it again in MATLAB with: save(file, '-v7')."


def read_mat(files: list[Path], options: ReadOptions, budget: Budget) -> RawTable:
    """Read a MATLAB file of version 5 to 7; see `Reader`."""
    path = files[0]
    data = path.read_bytes()
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None:
        raise RecordError("this is no MATLAB file of version 5 to 7", next_step=_SAVE)
    contents = _Contents()
    damaged, cut = _variables(data, order, contents)
    harm = "; ".join(damaged[:3]) or ("it is cut off" if cut else "")
    try:
        table = table_of(contents.arrays, options, contents.names)
    except RecordError as error:
        if harm:
            what = "the MATLAB file is damaged"
            raise RecordError(what, value=f"{harm}; {error}", next_step=_SAVE) from error
        if contents.objects:
            objects = f"{contents.objects} variables are timeseries or tables"
            what = f"{error.what}; {objects}, which only MATLAB can read"
            step = f"{error.next_step or ''} {_PLAIN}".lstrip()
            raise error.changed(what=what, next_step=step) from error
        raise
    if cut:
        table = table.report("truncated_file", f"{path.name} is cut off: what precedes is taken")
    if damaged:
        table = table.report("corrupt_rows", f"{path.name}: damaged variables left out: {harm}")
    return table


def _variables(data: bytes, order: str, contents: _Contents) -> tuple[list[str], bool]:
    """Take all arrays of numbers; what is wrong with variables left out, and whether data are cut.

    The byte order is `<` or `>`.
    """
    damaged: list[str] = []
    offset = _HEADER
    while offset + 8 <= len(data) and len(contents.arrays) < _MAX_VARIABLES:
        kind, size = struct.unpack_from(order + "II", data, offset)
        start, offset = offset, offset + 8 + size
        if offset > len(data):
            return damaged, True
        try:
            with refused(f"the variable at byte {start} is damaged"):
                element = data[start:offset]
                if kind == _COMPRESSED:
                    element = zlib.decompress(element[8:])
                    kind, size = struct.unpack_from(order + "II", element)
                    element = element[: 8 + size]
                if kind != _MATRIX or size > len(element) - 8:
                    raise ValueError("no array, or one that is larger than its bytes")
                for name, value in _read(data[:_HEADER] + element).items():
                    contents.collect(value, printable(name, 80))
        except RecordError as error:
            damaged.append(f"{error.what} ({error.value})")
    return damaged, False


def _read(file: bytes) -> dict[str, Any]:
    """The variable of a file that has one; text, sparse matrices and functions are left out."""
    library: Any = importlib.import_module("scipy.io.matlab")
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        # So it says that a variable cannot be read.
        warnings.simplefilter("error", library.MatReadWarning)
        found: dict[str, Any] = library.loadmat(BytesIO(file))
    own = {name: value for name, value in found.items() if not name.startswith("__")}
    return {name: value for name, value in own.items() if isinstance(value, np.ndarray)}
