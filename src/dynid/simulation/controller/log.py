"""What the controller tells people: lines on a stream, never too many."""

from __future__ import annotations

import time
from collections import Counter
from typing import TextIO

_PER_SECOND = 100
_SAME_PER_SECOND = 3


class Log:
    """Writes lines; what comes too fast, or again and again, is counted, not written.

    Args:
        stream: Where the lines go.
        name: What each line begins with.
    """

    def __init__(self, stream: TextIO, name: str) -> None:
        self._stream, self._name = stream, name
        self._second, self._dropped = 0, 0
        self._written: Counter[str] = Counter()

    def say(self, words: str) -> None:
        """Write a line."""
        second = int(time.monotonic())
        if second != self._second:
            if self._dropped:
                self._write(f"{self._dropped} more lines were not printed")
            self._second, self._dropped = second, 0
            self._written.clear()
        if self._written[words] >= _SAME_PER_SECOND or self._written.total() >= _PER_SECOND:
            self._dropped += 1
            return
        self._written[words] += 1
        self._write(words)

    def _write(self, words: str) -> None:
        line = " ".join(words.split())
        clean = "".join(c if c.isprintable() else "?" for c in line)[:500]
        try:
            print(f"{self._name}: {clean}", file=self._stream, flush=True)
        except OSError:
            # Nobody reads any more; the robot does not stop for that.
            self._second = int(time.monotonic())
