"""Can a result be trusted? One word and the reasons, from its warnings and errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from dynid.identification.diagnostics import ILL_CONDITIONED
from dynid.workflow.identify import Identification

CARE = frozenset(
    {"not_physical", "over_fitted", "extrapolated", "saturated", "unit_suspect", "clock_mismatch"}
)
"""Codes that ask for a look before the result is used."""
POOR_PREDICTION = 15.0
"""[%] of the torque of moving joints; good identifications predict to 5 %."""

HEADLINES = {
    "usable": "This result can be used",
    "care": "Use this result with care",
    "do_not_use": "This result must not be used",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What a person has to know first."""

    level: str
    """`usable`, `care` or `do_not_use`."""
    reasons: tuple[str, ...]
    """Why, in words."""

    @property
    def headline(self) -> str:
        """The verdict in one sentence."""
        return f"{HEADLINES[self.level]}: {'; '.join(self.reasons)}."

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {"level": self.level, "reasons": list(self.reasons)}


def verdict(result: Identification) -> Verdict:
    """Judge an identification."""
    codes = {notice.code for notice in result.warnings}
    poor: list[str] = []
    if result.estimate.scaled_condition_number > ILL_CONDITIONED:
        poor.append("the motion does not tell its parameters apart (ill_conditioned)")
    if "low_excitation" in codes:
        poor.append("the motion excites too little (low_excitation)")
    if poor:
        return Verdict(level="do_not_use", reasons=tuple(poor))
    found = sorted(codes & CARE)
    doubts = [f"see the warning{'s' * (len(found) > 1)} {', '.join(found)}"] if found else []
    if result.validation is None:
        doubts.append("no other motion has confirmed it yet (--validate)")
        return Verdict(level="care", reasons=tuple(doubts))
    error = result.validation.moving.relative_error_overall_percent
    share = f"it predicts another motion's torques to {error:.1f} % (moving joints)"
    if found or not error <= POOR_PREDICTION:
        return Verdict(level="care", reasons=(share, *doubts))
    return Verdict(level="usable", reasons=(share, "the motion tells its parameters apart"))
