"""Strict reading of TOML tables: known keys only, and errors that name the line."""

import difflib
import math
import re
import tomllib
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import numpy as np

from dynid.core import Array, InputError, RobotError, printable


def read_limited(path: Path, limit: int) -> bytes:
    """The bytes of a regular file that has at most so many.

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


_PATH_WIDTH = 120


def shown_path(path: Path) -> str:
    """A path as one printable line; where it is too long, its end."""
    text = printable(path, None)
    return text if len(text) <= _PATH_WIDTH else "..." + text[3 - _PATH_WIDTH :]


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
        raise RobotError(**error.facts | {"where": inner}) from error


_LARGEST = 1e9
_TURN = 6.2832
"""Largest fixed angle [rad]."""
_MOST_PARTS = 16
_DEEP_KEY = re.compile(rf"^[ \t\[]*(?:[\w\"'-]+[ \t]*\.[ \t]*){{{_MOST_PARTS},}}", re.MULTILINE)


def parse_toml(data: bytes) -> dict[str, Any]:
    """The tables of TOML text.

    Raises:
        RobotError: Not UTF-8, or not TOML; the message gives line and column.
    """
    try:
        text = data.decode("utf-8-sig")
        # Each dot of a key makes a table, and the parser keeps all prefixes: `a.a.a...` of 100 kB
        # took 6.7 GB. No robot file has keys of more than three parts.
        if _DEEP_KEY.search(text):
            raise RobotError(
                "a key has too many parts", limit=f"{_MOST_PARTS} parts", next_step="Use tables."
            )
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        reason = "nested too deep" if isinstance(error, RecursionError) else printable(error, 120)
        raise RobotError(f"not a TOML file ({reason})") from error


class TomlTable:
    """One table of a robot file.

    Besides the known keys, `source` and `KEY_source` are texts that say where numbers are from.

    Raises:
        RobotError: The value is not a table, or has a key that is not known.
    """

    def __init__(self, values: object, name: str, where: str, known: Sequence[str]) -> None:
        self.where = ": ".join(part for part in (where, name) if part)
        if not isinstance(values, dict):
            raise RobotError(
                "must be a table", where=self.where or None, value=printable(values, 120)
            )
        self._values = cast("dict[str, Any]", values)
        sources = ["source", *(f"{key}_source" for key in known)]
        for key in self._values:
            if key not in known and key not in sources:
                near = difflib.get_close_matches(key, known, n=1)
                raise RobotError(
                    f"unknown key '{printable(key, 60)}'",
                    where=self.where or None,
                    limit=", ".join(known),
                    next_step=f"Did you mean {near[0]}?" if near else None,
                )
        self._sources = {key: self.text(key) for key in self._values if key in sources}

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def sources(self, name: str) -> list[str]:
        """Where this table's numbers are from, one sentence each; `name` stands before them."""
        found: list[str] = []
        for key, text in self._sources.items():
            about = f"{name} {key.removesuffix('source').removesuffix('_')}".strip()
            found.append(f"{about}: {text}" if about else text)
        return found

    def raw(self, key: str) -> object:
        """The value as parsed, or None."""
        return self._values.get(key)

    def text(self, key: str, choices: Sequence[str] | None = None) -> str:
        """A text of one line, or one of `choices`."""
        value = self._required(key)
        if not isinstance(value, str) or not value.isprintable() or not value.strip():
            raise self._wrong(key, "must be a text of one line", value)
        if choices is not None and value not in choices:
            raise self._wrong(key, "unknown word", value, ", ".join(choices))
        return value

    def texts(self, key: str, count: int | None = None) -> tuple[str, ...]:
        """A list of texts."""
        items = self._list(key, count)
        if not all(isinstance(item, str) and item.isprintable() and item.strip() for item in items):
            raise self._wrong(key, "must be a list of texts", items)
        return tuple(cast("list[str]", items))

    def number(self, key: str) -> float:
        """A finite number."""
        return self._number(key, self._required(key), unknown=False)

    def numbers(self, key: str, count: int | None = None, *, unknown: bool = False) -> Array:
        """A list of numbers (count); `unknown` allows nan."""
        items = self._list(key, count)
        return np.array([self._number(key, item, unknown) for item in items], dtype=np.float64)

    def angles(self, key: str, count: int) -> Array:
        """A list of fixed angles (count) [rad]."""
        values = self.numbers(key, count)
        if (np.abs(values) > _TURN).any():
            limit = "one turn (6.2832 rad); if these are degrees, write radians"
            raise self._wrong(key, "is more than a turn", values.tolist(), limit)
        return values

    def rows(self, key: str, count: int | None, width: int, *, unknown: bool = False) -> Array:
        """A list of lists of numbers (count, width), of any count if None; `unknown` allows nan."""
        rows = [self._check_list(key, row, width) for row in self._list(key, count)]
        values = [[self._number(key, item, unknown) for item in row] for row in rows]
        return np.array(values, dtype=np.float64).reshape(len(rows), width)

    def _required(self, key: str) -> object:
        if key not in self._values:
            raise RobotError(f"the key '{key}' is missing", where=self.where or None)
        return self._values[key]

    def _list(self, key: str, count: int | None) -> list[object]:
        return self._check_list(key, self._required(key), count)

    def _check_list(self, key: str, value: object, count: int | None) -> list[object]:
        if not isinstance(value, list):
            raise self._wrong(key, "must be a list", value)
        items = cast("list[object]", value)
        if count is not None and len(items) != count:
            raise self._wrong(key, "wrong number of entries", len(items), count)
        return items

    def _number(self, key: str, value: object, unknown: bool) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self._wrong(key, "must be a number", value)
        if isinstance(value, float) and math.isnan(value) and unknown:
            return math.nan
        # An int may be too large for a float, but compares with one.
        if not -_LARGEST <= value <= _LARGEST:
            raise self._wrong(
                key, "is out of range", printable(value), f"-{_LARGEST:g} to {_LARGEST:g}"
            )
        return float(value)

    def _wrong(self, key: str, what: str, value: object, limit: object = None) -> RobotError:
        if not isinstance(value, int | float | str):
            value = printable(value, 120)
        return RobotError(f"'{key}' {what}", where=self.where or None, value=value, limit=limit)


def array_of_tables(values: object, name: str, where: str, known: Sequence[str]) -> list[TomlTable]:
    """An array of tables.

    Raises:
        RobotError: Not a list of tables, or unknown keys.
    """
    if not isinstance(values, list):
        raise RobotError(f"write [[{name}]], not [{name}]", where=where or None)
    items = cast("list[object]", values)
    return [TomlTable(item, f"{name} {k + 1}", where, known) for k, item in enumerate(items)]


def locked_joints(values: object) -> Mapping[str, float]:
    """The table `locked`: joint name to position.

    Raises:
        RobotError: Not a table of finite numbers.
    """
    if not isinstance(values, dict):
        raise RobotError("must be a table of positions", where="locked")
    names = list(cast("dict[str, Any]", values))
    table = TomlTable(cast("object", values), "locked", "", names)
    return {name: table.number(name) for name in names if name != "source"}
