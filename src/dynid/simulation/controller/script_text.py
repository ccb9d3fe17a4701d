"""Finds whole programs in the text that arrives at a script port."""

from __future__ import annotations

import re

from dynid.core import JobError

LARGEST_SCRIPT = 2_000_000
"""The longest program taken [bytes]."""
POOL = 8_000_000
"""Unfinished programs of all clients together [bytes]."""
_TOKEN = re.compile(rb"[A-Za-z0-9_]+|[#\"'\n]")
_OPENERS = frozenset((b"def", b"sec", b"thread", b"if", b"while"))
_LONGEST_KEYWORD = 8
_NEWLINE, _COMMENT = b"\n", b"#"
_END_OF_COMMENT = re.compile(rb"\n")
_END_OF_STRING = {quote: re.compile(rb"[\n" + quote + rb"]") for quote in (b'"', b"'")}


class ScriptRefused(JobError):
    """A client sent text that can be no program; the connection is to be closed."""


class Pool:
    """Memory that all clients share for programs that are not complete.

    Args:
        size: How much there is [bytes].
    """

    def __init__(self, size: int = POOL) -> None:
        self.size, self.taken = size, 0

    def take(self, count: int) -> None:
        """Take room for `count` bytes; a negative count gives it back.

        Raises:
            ScriptRefused: There is none left.
        """
        if self.taken + count > self.size:
            raise ScriptRefused(
                "too many unfinished programs at once", limit=f"{self.size} bytes together"
            )
        self.taken += count


class ScriptReader:
    """Collects text until its blocks are closed.

    A program is `def` to its `end`, or a single line of code. Line ends matter nowhere else.
    Every byte is looked at once, however the text is cut.

    Args:
        pool: Memory shared with the other clients.
        largest: The longest program to take [bytes].
    """

    def __init__(self, pool: Pool, largest: int = LARGEST_SCRIPT) -> None:
        self._pool, self._largest = pool, largest
        self._text = bytearray()
        self._seen: int = 0
        self._forget()

    def feed(self, data: bytes) -> list[str]:
        """Take text; return the programs that it completes.

        Raises:
            ScriptRefused: The text is too long, or no text.
        """
        self._pool.take(len(data))
        self._text += data
        programs: list[str] = []
        while (end := self._scan()) is not None:
            program = bytes(self._text[:end])
            worth, code = self._has_code, self._text[end:]
            self._pool.take(-end)
            self._text, self._seen = code, 0
            self._forget()
            if worth:
                programs.append(_decoded(program))
        if len(self._text) > self._largest:
            raise ScriptRefused(
                "the program is too long; its blocks are not closed yet",
                value=f"{len(self._text)} bytes",
                limit=f"{self._largest} bytes",
            )
        return programs

    def finish(self) -> list[str]:
        """The client has left: what it sent last needs no line end."""
        return self.feed(b"\n")

    @property
    def unfinished(self) -> bool:
        """Whether there is code that is no whole program yet."""
        return self._has_code

    def close(self) -> None:
        """Give the memory back."""
        self._pool.take(-len(self._text))
        self._text = bytearray()

    def _forget(self) -> None:
        self._depth = 0
        self._has_code = False
        self._inside = b""

    def _scan(self) -> int | None:
        """Look at the new text; the end of the first whole program, if there is one."""
        text = self._text
        while True:
            if self._inside and not self._skip():
                return None
            match = _TOKEN.search(text, self._seen)
            if match is None:
                self._seen = len(text)
                return None
            token = match.group()
            if match.end() == len(text) and token not in (b'"', b"'", _COMMENT, _NEWLINE):
                # The word may go on in the next piece; of a long one only the end is kept.
                self._seen = max(match.start(), len(text) - 2 * _LONGEST_KEYWORD)
                return None
            self._seen = match.end()
            if token == _NEWLINE:
                if self._depth <= 0:
                    return self._seen
            elif token in (b'"', b"'", _COMMENT):
                self._inside = token
                self._has_code |= token != _COMMENT
            else:
                self._has_code = True
                self._depth += (token in _OPENERS) - (token == b"end")

    def _skip(self) -> bool:
        """Pass over a comment or a string; whether its end has come."""
        ending = _END_OF_COMMENT if self._inside == _COMMENT else _END_OF_STRING[self._inside]
        match = ending.search(self._text, self._seen)
        if match is None:
            self._seen = len(self._text)
            return False
        # A string that its line does not close ends there; the compiler will say so.
        self._inside = b""
        self._seen = match.start() if match.group() == _NEWLINE else match.end()
        return True


def _decoded(program: bytes) -> str:
    try:
        return program.decode()
    except UnicodeDecodeError as error:
        raise ScriptRefused(
            "this is no program: it is not UTF-8 text", value=program[:40]
        ) from error
