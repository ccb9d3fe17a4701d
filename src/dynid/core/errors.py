"""Every error that dynid raises on purpose, and extras that are not installed.

Each error says what is wrong, where, with the value, the limit and the next step.
"""

import importlib
import importlib.util
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Any, Self, cast

LONGEST_WORD = 40
"""A longer value is no word that was mistyped."""


class DynidError(Exception):
    """An error with the facts a person needs to act.

    Args:
        what: What went wrong, as a sentence without its full stop.
        where: File, row, column, joint or option concerned.
        value: The offending value.
        limit: What was allowed or available.
        next_step: What to do now.
    """

    exit_code = 1

    def __init__(
        self,
        what: str,
        *,
        where: str | None = None,
        value: object = None,
        limit: object = None,
        next_step: str | None = None,
    ) -> None:
        self.what = what
        self.where = where
        self.value = value
        self.limit = limit
        self.next_step = next_step or _suggestion(value, limit)
        super().__init__(self._message())

    @property
    def facts(self) -> dict[str, Any]:
        """What it tells, by the names of the arguments."""
        names = ("what", "where", "value", "limit", "next_step")
        return {name: getattr(self, name) for name in names}

    def changed(self, **facts: Any) -> Self:
        """The same error with some of its facts changed."""
        return type(self)(**self.facts | facts)

    def _message(self) -> str:
        parts = [f"{self.where}: {self.what}" if self.where else self.what]
        if self.value is not None:
            parts.append(f"got {_short(self.value)}")
        if self.limit is not None:
            parts.append(f"allowed: {_short(self.limit)}")
        message = "; ".join(parts)
        return f"{message}. {self.next_step}" if self.next_step else message


class JobError(DynidError):
    """The job was well posed but failed."""


class InputError(DynidError):
    """The usage or the input is wrong."""

    exit_code = 2


class RobotError(InputError):
    """A robot name, URDF or robot file is wrong."""


class RecordError(InputError):
    """A recording cannot be read or does not fit the robot."""


class MissingExtraError(InputError):
    """An optional dependency is not installed."""


def check_word(value: str, words: Iterable[str], where: str | None = None) -> None:
    """Refuse a word that is none of those known, of which an empty one stands for a default.

    Raises:
        InputError: It is none of them; `where` names the option.
    """
    known = tuple(words)
    if value not in known:
        limit = ", ".join(filter(None, known))
        raise InputError("unknown word", where=where, value=value, limit=limit)


def _suggestion(value: object, limit: object) -> str | None:
    """The allowed word that is closest to a refused one, where there are several."""
    if not isinstance(value, str) or len(value) > LONGEST_WORD:
        return None
    if isinstance(limit, str):
        words = limit.split(", ")
    elif isinstance(limit, tuple | list | frozenset | set):
        words = [word for word in cast("Iterable[object]", limit) if isinstance(word, str)]
    else:
        return None
    if len(words) == 1:
        return None
    import difflib

    near = difflib.get_close_matches(value.lower(), sorted(words), n=1)
    return f"Did you mean {near[0]}?" if near and near[0] != value else None


def like_named(path: Path, *words: str) -> str | None:
    """The file or folder beside a missing one, or word, with the closest name, as a next step."""
    import difflib

    files: list[str] = []
    with suppress(OSError, ValueError):
        files = [item.name for item in path.parent.iterdir()]
    near = difflib.get_close_matches(path.name.lower(), words, n=1)
    near += difflib.get_close_matches(path.name, files, n=1, cutoff=0.75)
    return f"Did you mean {near[0]}?" if near else None


def printable(value: object, longest: int | None = 60) -> str:
    """Any text, of a file or a person, as one printable line.

    It has at most `longest` characters, three dots included; all where that is None.
    """
    text = "".join(c if c.isprintable() else "?" for c in str(value))
    return text if longest is None or len(text) <= longest else text[: longest - 3] + "..."


def _short(value: object) -> str:
    return printable(value if isinstance(value, str) else repr(value), 200)


def installed(module: str) -> bool:
    """Whether a top-level module can be imported."""
    return importlib.util.find_spec(module) is not None


def require(module: str, extra: str) -> ModuleType:
    """Import an optional module by its dotted name.

    Raises:
        MissingExtraError: It is not installed; the message names the dynid extra to install.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            f"this needs the package '{module.split('.', 1)[0]}'",
            next_step=f"Run: pip install 'dynid[{extra}]'",
        ) from error
