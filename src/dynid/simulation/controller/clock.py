"""When the next control cycle is due: by the wall clock, or as fast as the clients read."""

from __future__ import annotations

from array import array

CATCH_UP_S = 0.1
"""How far behind the wall clock the controller may run before it gives the time up [s]."""
_KEPT = 1 << 20


class Pace:
    """The rhythm of the control cycles, from wall times that it is told.

    In real time cycle k is due at start + k dt. A late cycle is run at once and the next ones
    keep their times, so no cycle is lost; after a longer standstill than `CATCH_UP_S` (a
    suspended computer) the rhythm starts anew and the controller's time has simply stood still.

    Args:
        cycle: Length of a cycle [s].
        now: The wall clock [s].
    """

    def __init__(self, cycle: float, now: float) -> None:
        self._cycle = cycle
        self._start, self._cycles = now, 0
        self.slips = 0
        """How often time was given up."""
        self._late = array("f")

    def wait(self, now: float) -> float:
        """Seconds until the next cycle is due; not positive when it is."""
        return self._start + (self._cycles + 1) * self._cycle - now

    def advance(self, now: float) -> None:
        """A cycle begins."""
        late = -self.wait(now)
        self._cycles += 1
        if len(self._late) < _KEPT:
            self._late.append(late)
        if late > CATCH_UP_S:
            self.slips += 1
            self.restart(now)

    def restart(self, now: float) -> None:
        """Begin the rhythm anew."""
        self._start, self._cycles = now, 0

    def lateness_us(self, *percentiles: float) -> list[float]:
        """How late cycles began [us], at percentiles from 0 to 100."""
        if not self._late:
            return [0.0] * len(percentiles)
        ordered = sorted(self._late)
        last = len(ordered) - 1
        return [1e6 * ordered[round(last * share / 100)] for share in percentiles]
