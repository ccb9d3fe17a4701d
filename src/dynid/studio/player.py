"""Play, pause, scrub: where a motion is at a time of the clock."""

from __future__ import annotations

from dataclasses import dataclass

from dynid.core.errors import InputError

SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
"""What the page offers, as shares of real time."""


@dataclass(slots=True)
class Player:
    """A place in a motion that moves with the clock while it plays.

    Every method that depends on the clock is told its time [s], so that tests need none.

    Raises:
        InputError: A duration that is not positive.
    """

    duration: float
    """Of the motion [s]."""
    loop: bool = True
    """Whether the end is followed by the start."""
    speed: float = 1.0
    """Seconds of the motion a second of the clock."""
    playing: bool = False
    _place: float = 0.0
    _since: float = 0.0

    def __post_init__(self) -> None:
        if not self.duration > 0:
            raise InputError("a motion to play needs a duration", value=self.duration)

    def place(self, now: float) -> float:
        """Where the motion is [s]."""
        if not self.playing:
            return self._place
        raw = self._place + (now - self._since) * self.speed
        return raw % self.duration if self.loop else min(raw, self.duration)

    def play(self, now: float) -> None:
        """Go on from here; from the start where the end was reached."""
        if self.playing:
            return
        if self._place >= self.duration:
            self._place = 0.0
        self.playing, self._since = True, now

    def pause(self, now: float) -> None:
        """Stay here."""
        self._place, self.playing = self.place(now), False

    def seek(self, place: float, now: float) -> None:
        """Go to a place, kept within the motion; playing goes on from there."""
        self._place, self._since = min(max(place, 0.0), self.duration), now

    def set_speed(self, speed: float, now: float) -> None:
        """Change the speed without a jump.

        Raises:
            InputError: A speed that is not positive.
        """
        if not speed > 0:
            raise InputError("the speed must be positive", value=speed)
        self._place, self._since = self.place(now), now
        self.speed = speed

    def settle(self, now: float) -> bool:
        """Stop at the end of a motion that does not repeat; whether it did just now."""
        if self.playing and not self.loop and self.place(now) >= self.duration:
            self.pause(now)
            return True
        return False
