"""How a setting is asked for on the command line and checked: each is declared once, as a field.

Python sets the fields; the command line makes options of them (`dynid.cli.ask`), and both are
checked here. A field without an option is for Python alone. Help pages are made of these fields:
nothing heavy is loaded.
"""

import math
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from importlib import import_module
from numbers import Integral, Real
from pathlib import Path
from typing import Any, cast

from dynid.core import InputError, check_word

FINITE = sys.float_info.max
WHOLE: tuple[Any, ...] = (int, int | None)
SEVERAL: tuple[Any, ...] = (tuple[float, ...], tuple[float, ...] | None)
NUMERIC: tuple[Any, ...] = (*WHOLE, float, float | None, *SEVERAL)
TEXT: tuple[Any, ...] = (str, str | None, str | Path | None)
"""Annotations of fields that hold a whole number, several, numbers of any kind, or text."""
Parse = Callable[[str, str], Any]
"""From the text and the name of an option to its value; raises `InputError`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """How a field is asked for on the command line, and which values it takes."""

    name: str
    """Such as `--repeat`."""
    metavar: str
    """What stands for the value in help pages; empty for a flag."""
    help: str
    words: tuple[str, ...] = ()
    """The only words that it takes."""
    parse: Parse | None = None
    """Reads the text; None where it is the value already."""
    many: bool = False
    """Whether it may be repeated."""
    own: str = ""
    """Class whose objects stand for text, by its name below `dynid`."""
    least: float = -FINITE
    most: float = FINITE
    """Bounds of a number, or of each number of several."""
    default: Any = None
    kind: Any = None
    """Default and annotation of the field."""

    @property
    def bounds(self) -> str:
        """Which values are allowed, in words."""
        if not self.metavar:
            return "True or False"
        if self.kind in TEXT:
            return "text"
        known = "several finite numbers" if self.kind in SEVERAL else "a finite number"
        known = "a whole number" if self.kind in WHOLE else known
        if self.most < FINITE:
            return f"{known}, {self.least:g} to {self.most:g}"
        return known if self.least == -FINITE else f"{known}, {self.least:g} or more"

    def allows(self, value: object) -> bool:
        """Whether a flag, or a field of text or numbers, may hold this one, or these."""
        if value is None:
            return self.default is None
        if not self.metavar:
            return value in (True, False)
        if self.kind in TEXT:
            return isinstance(value, self.kind)
        if self.kind not in SEVERAL:
            value = (value,)
        if isinstance(value, str | bytes) or not isinstance(value, Iterable):
            return False
        number = Integral if self.kind in WHOLE else Real
        return all(
            not isinstance(one, bool)
            and isinstance(one, number)
            and self.least <= cast("float", one) <= self.most
            for one in cast("Iterable[object]", value)
        )

    def read(self, given: Any) -> Any:
        """The value of the field from what was given: text, texts, a number, or a flag.

        Raises:
            InputError: A text that makes no sense.
        """
        if not self.metavar:
            return self.default is False if given else self.default
        if self.parse is None:
            return tuple(given) if self.many else given
        if self.many:
            return tuple(self.parse(one, self.name) for one in given)
        return self.parse(given, self.name)


def option(
    default: object, metavar: str | tuple[str, ...], help: str, name: str = "", **more: Any
) -> Any:
    """A field with an option.

    Args:
        default: Of the field, and of the option.
        metavar: What stands for the value; or the words that it takes.
        help: For the help page.
        name: Of the option; empty for that of the field.
        **more: Of `Option`.
    """
    words = () if isinstance(metavar, str) else metavar
    shown = metavar if isinstance(metavar, str) else "|".join(metavar)
    declared = Option(name=name, metavar=shown, help=help, words=words, **more)
    return field(default=default, metadata={"option": declared})


def word_of(chosen: Any) -> Any:
    """The word of an option, or the name of the object that stands for one."""
    return chosen if chosen is None or isinstance(chosen, str) else chosen.name


def flag(default: bool | None, name: str, help: str) -> Any:
    """A field with an option that has no value: it gives True, or False where that is not so."""
    return option(default, "", help, name)


def options_of(kind: type) -> dict[str, Option]:
    """The options of the fields of settings, by the name of the field."""
    found: dict[str, Option] = {}
    for item in fields(kind):
        declared: Option | None = item.metadata.get("option")
        if declared is not None:
            name = declared.name or f"--{item.name.replace('_', '-')}"
            found[item.name] = replace(declared, name=name, default=item.default, kind=item.type)
    return found


def check_options(settings: object) -> None:
    """Refuse what no option takes; text in place of an object is read.

    Raises:
        InputError: A word that is not known, an object of a wrong class, no number where one is
            needed, or one out of bounds.
    """
    for name, declared in options_of(type(settings)).items():
        value: Any = getattr(settings, name)
        if declared.own and not isinstance(value, str | None):
            package, _, word = declared.own.rpartition(".")
            if not isinstance(value, getattr(import_module(f"dynid.{package}"), word)):
                raise InputError(
                    f"neither text nor an object whose class is or derives from dynid.{word}",
                    where=declared.name,
                    value=repr(value),
                    next_step=f"Pass such an object, or {declared.metavar} as text.",
                )
        elif declared.words and value != declared.default:
            check_word(cast("str", value), declared.words, declared.name)
        elif declared.own and declared.parse and value is not None:
            object.__setattr__(settings, name, declared.parse(value, declared.name))
        checked = declared.kind in (*NUMERIC, *TEXT) or not declared.metavar
        if (checked or isinstance(value, Real)) and not declared.allows(value):
            raise InputError(
                "out of bounds", where=declared.name, value=value, limit=declared.bounds
            )


class Settings:
    """Settings are checked when they are made.

    Raises:
        InputError: See `check_options`.
    """

    __slots__ = ()

    def __post_init__(self) -> None:
        check_options(self)


def numbers(
    text: str, where: str, counts: tuple[int, ...] = (), form: str = ""
) -> tuple[float, ...]:
    """Finite numbers with commas between, such as `13.6,13.7`.

    Raises:
        InputError: Something else, or another number of them than one of the counts.
    """
    with suppress(ValueError):
        found = tuple(float(part) for part in text.split(","))
        if all(map(math.isfinite, found)) and (not counts or len(found) in counts):
            return found
    said = "needs finite numbers with commas between"
    raise InputError(said, where=where, value=text, limit=form or None)
