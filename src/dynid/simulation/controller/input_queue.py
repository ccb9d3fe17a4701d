"""The inputs that an RTDE client has written and that have not acted yet."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping

from dynid.protocol import Value

LONGEST = 64
"""Packages that may wait; of a client that writes more than one a cycle the oldest act at once."""
PATIENCE_S = 0.2
"""How long virtual time waits for the next set point of a client that streams them [s]."""
MEMORY_S = 2.0
"""How long what clients write keeps its order after numbers that may be set points [s]."""
_SETPOINTS, _STREAM = "input_double_register", 3


class InputQueue:
    """Lets one package of each recipe act in each cycle while set points are streamed.

    Packages act in the order in which they came; without a stream all act at once.

    Args:
        write: Writes an input.
    """

    def __init__(self, write: Callable[[str, Value], None]) -> None:
        self._write = write
        self._waiting: deque[tuple[int, Mapping[str, Value]]] = deque()
        self._last = -PATIENCE_S
        self._streak = 0
        self._steered = -MEMORY_S
        self.asked = False
        """Whether the client was sent a package since it wrote."""

    def put(self, recipe: int, values: Mapping[str, Value], now: float) -> None:
        """Take what the client wrote.

        Args:
            recipe: The number of the recipe.
            values: Its inputs.
            now: The monotonic clock [s].
        """
        self._waiting.append((recipe, values))
        self._last, self.asked = now, False
        # Commands that are answered, such as ur_rtde's moveJ, are followed by one without numbers.
        steers = any(name.startswith(_SETPOINTS) for name in values)
        self._streak = self._streak + 1 if steers else 0
        if steers:
            self._steered = now
        while len(self._waiting) > LONGEST:
            self._act()

    def apply_all(self) -> None:
        """Let everything act."""
        while self._waiting:
            self._act()

    def apply_next(self, guided: bool) -> None:
        """Let act what belongs to this cycle.

        Args:
            guided: Whether any client writes set points: what others say belongs to one of them.
                Otherwise all acts, a wish to stop not behind signs of life in a bunch.
        """
        if not guided:
            self.apply_all()
            return
        seen: set[int] = set()
        while self._waiting and self._waiting[0][0] not in seen:
            seen.add(self._waiting[0][0])
            self._act()

    def guided(self, now: float) -> bool:
        """Whether the client wrote numbers that may be set points not long ago."""
        return now - self._steered < MEMORY_S

    def steers(self, now: float) -> bool:
        """Whether the client streams numbers that may be set points."""
        return self._streak >= _STREAM and now - self._last < PATIENCE_S

    def awaited(self, now: float) -> bool:
        """Whether the client, which wrote a moment ago, owes an answer to its last package."""
        return self.asked and not self._waiting and now - self._last < PATIENCE_S

    def _act(self) -> None:
        _, values = self._waiting.popleft()
        for name, value in values.items():
            self._write(name, value)
