"""Every error that dynid raises on purpose, arguments refused by name, extras that are missing.

Each error says what is wrong, where, with the value, the limit and the next step.
"""

import importlib
import inspect
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import wraps
from numbers import Integral, Real
from pathlib import Path
from types import ModuleType, NoneType, UnionType
from typing import Any, Self, Union, cast, get_args, get_origin, get_type_hints

LONGEST_WORD = 40
"""A longer value is no word that was mistyped."""


PYTHON_NAMES = {
    "--accuracy": "accuracy_percent",
    "--at": "at_degC",
    "--budget": "budget_s",
    "--cutoff": "cutoff_hz",
    "--degrees": "degrees=True",
    "--for": "purpose",
    "--force": "force=True",
    "--from": "start_s",
    "--margin": "margin_percent",
    "--mesh-dir": "mesh_dirs",
    "--motion": "motions",
    "--no-collision": "collision=False",
    "--no-header": "header=False",
    "--period": "period_s",
    "--rate": "rate_hz",
    "--reference": "reference_degC",
    "--settle": "settle=True",
    "--start": "start_pose",
    "--to": "stop_s",
    "--validate": "validation",
    "--validate-from": "validation_start_s",
    "--validate-to": "validation_stop_s",
    "--warm-up": "warm_up_s",
    "-o": "output",
}
"""Options that Python calls by another name than their own without dashes."""
_OPTION = re.compile(r"(?<![\w-])(?:--[a-z][a-z-]*|-o)(?![\w-])")
_COMMAND = re.compile(r"((?:dynid|ros2) [a-z].*?(?:$|\. ))", re.DOTALL)
"""A whole command line: it is given as it is typed."""


def in_python(text: str) -> str:
    """A message with the arguments of Python in place of the options of the command line."""

    def name(found: re.Match[str]) -> str:
        option = found[0]
        return PYTHON_NAMES.get(option, option.strip("-").replace("-", "_"))

    parts = _COMMAND.split(text)
    parts[::2] = (_OPTION.sub(name, part) for part in parts[::2])
    return "".join(parts)


class DynidError(Exception):
    """An error with the facts a person needs to act.

    Its facts and its `line` name options of the command line, its text the arguments of Python.

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
        self.line = self._message()
        super().__init__(in_python(self.line))

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


class UnclearRecordError(RecordError):
    """A recording that options of `dynid import` make readable; its next step names them."""


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


def in_words(value: object) -> str:
    """A value as messages show it: words with commas between, others as Python writes them."""
    shown = value if isinstance(value, str) else repr(value)
    if isinstance(value, tuple | list | set | frozenset):
        words = [item for item in cast("Iterable[object]", value) if isinstance(item, str)]
        if words and len(words) == len(cast("Sequence[object]", value)):
            return ", ".join(words)
    return shown


def _short(value: object) -> str:
    return printable(in_words(value), 200)


def require(module: str, extra: str = "") -> ModuleType:
    """Import an optional module by its dotted name: of an extra, or of Python's own.

    Raises:
        MissingExtraError: It is not installed, and the dynid extra to install; or Python was built
            without it, as pyenv does where a library of the system is absent.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if not extra:
            raise MissingExtraError(
                f"this Python was built without its module '{module}'",
                next_step="Use another Python, or install its library and build this one again.",
            ) from error
        raise MissingExtraError(
            f"this needs the package '{module.split('.', 1)[0]}'",
            next_step=f"Run: pip install 'dynid[{extra}]'",
        ) from error
    except Exception as error:
        # As for another NumPy than it was built for, or MUJOCO_GL without such a library.
        raise MissingExtraError(
            f"the package '{module.split('.', 1)[0]}' is installed, but its import fails",
            value=f"{type(error).__name__}: {error}",
            next_step=f"Repair that, or run: pip install --force-reinstall 'dynid[{extra}]'",
        ) from error


_WORDS = {NoneType: "None", int: "a whole number, 0 or more", float: "a number"}
_UNIONS = (Union, UnionType)
_FAILURES = (AttributeError, LookupError, TypeError, ValueError)


def checked(verb: Callable[..., Any]) -> Callable[..., Any]:
    """A verb that fails on an argument of a wrong kind by naming it.

    Calls that work are left alone, and so are errors where all arguments are of the right kind.
    """
    signature, kinds = inspect.signature(verb), get_type_hints(verb)

    @wraps(verb)
    def call(*args: Any, **named: Any) -> Any:
        try:
            return verb(*args, **named)
        except _FAILURES as error:
            try:
                given = signature.bind(*args, **named)
            except TypeError:
                raise error from None
            for name, value in given.arguments.items():
                if not _fits(value, kinds[name]):
                    raise InputError(
                        f"the argument '{name}' of dynid.{verb.__name__}",
                        value=value if isinstance(value, Real) else type(value).__name__,
                        limit=" or ".join(dict.fromkeys(_words(kinds[name]))),
                    ) from error
            raise

    return call


def _fits(value: Any, kind: Any) -> bool:
    origin = get_origin(kind)
    if origin in _UNIONS:
        return any(_fits(value, one) for one in get_args(kind))
    if origin is Callable:
        return callable(value)
    if origin is Sequence:
        return hasattr(value, "__getitem__") and not isinstance(value, str | bytes | Mapping)
    if origin in (Mapping, tuple):
        return isinstance(value, origin)
    # Other generic classes, and protocols, are those of arrays.
    if (
        kind is Any
        or origin is not None
        or not isinstance(kind, type)
        or getattr(kind, "_is_protocol", False)
    ):
        return True
    if kind in (int, float):
        whole = isinstance(value, Integral) and float(value) >= 0
        return not isinstance(value, bool) and (whole if kind is int else isinstance(value, Real))
    return isinstance(value, kind)


def _words(kind: Any) -> list[str]:
    origin = get_origin(kind)
    if origin in _UNIONS:
        return [word for one in get_args(kind) for word in _words(one)]
    name = str(getattr(origin or kind, "__name__", kind))
    return [_WORDS.get(kind, name if origin is None else f"a {name.lower()}")]
