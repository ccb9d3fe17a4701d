"""Words of a script. Line ends mean nothing in URScript, as little as they do here."""

from __future__ import annotations

import re
from dataclasses import dataclass

from dynid.simulation.controller.urscript.errors import ScriptError

MAX_CHARACTERS = 1_000_000
"""Longest script."""
MAX_STRING = 1_000
"""Longest string."""
_WORDS = (
    "def sec thread end if elif else while break continue return halt run kill join global local "
    "enter_critical exit_critical and or not xor True False"
)
_LONG_NUMBER, _LARGEST_INTEGER = 12, 2**31 - 1
KEYWORDS = frozenset(_WORDS.split(" "))

_TOKEN = re.compile(
    r"""(?P<space>[ \t\r\f\v]+|\#[^\n]*)
    |(?P<newline>\n)
    |(?P<number>(?:\d+\.\d*|\.\d+|\d+)(?:[eE][+-]?\d+)?)
    |(?P<name>[A-Za-z_]\w*)
    |(?P<string>"[^"\n]*")
    |(?P<label>\$[ \t]*\d+[ \t]*"[^"\n]*"(?:[ \t]*"noBreak")?)
    |(?P<sign>==|!=|<=|>=|[-+*/%<>=()\[\],:.])""",
    re.VERBOSE | re.ASCII,
)


@dataclass(frozen=True, slots=True)
class Token:
    """One word."""

    kind: str
    """`number`, `name`, `keyword`, `string`, `sign` or `end of text`."""
    text: str
    line: int
    """Counted from one."""


def tokenize(text: str) -> list[Token]:
    """The words of a script; the last one is the end of the text.

    Raises:
        ScriptError: A character that no word begins with, or a script that is too long.
    """
    if len(text) > MAX_CHARACTERS:
        raise ScriptError("the script is too long", 1, value=len(text), limit=MAX_CHARACTERS)
    tokens: list[Token] = []
    place, line = 0, 1
    while place < len(text):
        match = _TOKEN.match(text, place)
        if match is None:
            raise ScriptError("unexpected character", line, value=text[place])
        kind, word = str(match.lastgroup), match.group()
        place = match.end()
        if kind == "newline":
            line += 1
        elif kind == "name":
            tokens.append(Token("keyword" if word in KEYWORDS else "name", word, line))
        elif kind == "string":
            if len(word) > MAX_STRING:
                raise ScriptError("the string is too long", line, limit=MAX_STRING)
            tokens.append(Token(kind, word[1:-1], line))
        elif kind in ("number", "sign"):
            tokens.append(Token(kind, word, line))
    tokens.append(Token("end of text", "", line))
    return tokens


def number_of(text: str) -> int | float:
    """The value of a number in a script; a whole one that 32 bits do not hold is a float."""
    whole = text.isdigit() and len(text) < _LONG_NUMBER
    value = int(text) if whole else float(text)
    return value if value <= _LARGEST_INTEGER else float(value)
