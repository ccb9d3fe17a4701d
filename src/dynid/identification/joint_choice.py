"""What `--preset best` may give one joint, the next choices from there, and what they must gain."""

from __future__ import annotations

from dataclasses import dataclass, replace

from dynid.identification.candidate_columns import DISPLACEMENTS, LOAD, WIDTHS

EXTRA_TERMS = ("fo", "fca", "fva", "fs", "fr", LOAD)
"""Terms that a joint may take beside the paper's; load-dependent friction has the step's width."""
ALIKE = frozenset({"fs", "fr"})
"""Both bend the curve below some speed: together they cancel, inside the record only."""
PAIR = frozenset({"fo", "fca"})
"""Together an offset that stops at rest; alone neither helps. Where the arm rests, so does
stiction, which is another one each time."""
GAIN_OF_TERM = 0.03
"""An extra column, or presliding, must lower the sum over joints of log RMS by this much."""
GAIN_OF_SHAPE = 0.01
"""So must a change of width, delay, cut-off or velocity source."""


@dataclass(frozen=True, slots=True)
class JointChoice:
    """What one joint has been given; indices into the lists of candidates."""

    width: int
    terms: frozenset[int]
    delay: int
    displacement: int | None = None
    """Of presliding friction, which then takes the place of the step; None without."""

    @property
    def step(self) -> int:
        """Index into the steps of `CandidateColumns`."""
        return self.width if self.displacement is None else len(WIDTHS) + self.displacement


@dataclass(frozen=True, slots=True, kw_only=True)
class Moves:
    """Which choices a joint has."""

    extras: tuple[str, ...]
    """Terms that may be added."""
    widths: int
    """Number of widths; 1 where no term has a step."""
    delays: int
    """Number of delays."""
    no_delay: int
    """Index of the delay 0."""
    presliding: bool
    """Whether friction may build up over a displacement."""
    pair: bool
    """Whether `PAIR` may be added at once."""

    def after(self, now: JointChoice) -> list[JointChoice]:
        """The choices one move away from a choice."""
        steps = [replace(now, width=k, displacement=None) for k in range(self.widths)]
        moves = [*steps, *(replace(now, delay=k) for k in range(self.delays))]
        if self.presliding:
            moves += [replace(now, displacement=k) for k in range(len(DISPLACEMENTS))]
        # What a term does depends on the width beside it; presliding has none.
        beside = steps if now.displacement is None else [now]
        for term in range(len(self.extras)):
            toggled = now.terms ^ {term}
            if not {self.extras[k] for k in toggled} >= ALIKE:
                moves += [replace(choice, terms=toggled) for choice in beside]
        if self.pair and set(self.extras) >= PAIR:
            both = now.terms | {self.extras.index(term) for term in PAIR}
            moves += [replace(choice, terms=both) for choice in beside]
        return [move for move in moves if move != now]

    def price(self, now: JointChoice, trial: JointChoice) -> float:
        """What a move must gain; going back to simpler is nearly free."""
        terms = GAIN_OF_TERM * (_size(trial) - _size(now))
        delay = GAIN_OF_SHAPE * ((trial.delay != self.no_delay) - (now.delay != self.no_delay))
        width = GAIN_OF_SHAPE * ((trial.width > 0) - (now.width > 0))
        return terms + delay + width + 1e-4


def _size(choice: JointChoice) -> int:
    return len(choice.terms) + (choice.displacement is not None)
