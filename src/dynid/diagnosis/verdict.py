"""Can a result be used, and what for: prediction, single parameters, simulation.

The error that is to be expected on another motion decides, beyond the noise that no model can
predict; then the faults that were found, then how much the motion shows.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynid.core import Finding, plain

GOOD_PREDICTION = 10.0
"""[%] of the torque, beyond noise, up to which a prediction is good."""
USELESS_PREDICTION = 40.0
"""[%] from which it is none."""
MATTERS = 3.0
"""[%] of error beyond noise below which a fault of the inputs has done no harm."""
LEAST_COVERED = 0.5
"""Share of a joint's torques below which their 90 % intervals are false."""
SLOWER = 10.0
"""Motions so many times slower have an error of their own: friction at low speed."""
POOR_SHARE = 0.5
"""Share of parameters that may be uncertain by more than half of their value."""
LEVELS = {"yes": "usable", "limits": "care", "no": "do_not_use"}
HEADLINES = {
    "usable": "This result can be used",
    "care": "Use this result with care",
    "do_not_use": "This result must not be used",
}
FAULTS = frozenset(
    {
        "contact", "delay", "drive_gain", "encoder_zero", "exchanged_joints", "payload",
        "flexibility", "friction_drift", "torque_kind", "saturated", "unit_suspect",
        "clock_mismatch", "aborted", "dead_channel",
    }
)  # fmt: skip
"""Codes of faults of the inputs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """Whether a result serves one purpose."""

    answer: str
    """`yes`, `limits` or `no`."""
    reason: str
    value: float | None = None
    """The number that decides."""
    unit: str = ""
    limit: float | None = None
    """What it is compared with."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Whether a result can be used, by purpose."""

    prediction: Answer
    """Of torques on other motions."""
    parameters: Answer
    """Single values and their deviations."""
    simulation: Answer
    """An exported model in a simulator."""

    @property
    def level(self) -> str:
        """`usable`, `care` or `do_not_use`: the answer for prediction."""
        return LEVELS[self.prediction.answer]

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why, each once, in words: prediction first, then what else is limited."""
        said = self.prediction.reason
        limited: dict[str, list[str]] = {}
        for name, answer in (("parameters", self.parameters), ("simulation", self.simulation)):
            if answer.answer != "yes":
                reason = "the same" if answer.reason in said else answer.reason
                limited.setdefault(reason, []).append(name)
        rest = (f"{' and '.join(names)}: {reason}" for reason, names in limited.items())
        return (said, *rest)

    @property
    def headline(self) -> str:
        """The verdict in one sentence."""
        return f"{HEADLINES[self.level]}: {'; '.join(self.reasons)}."

    def to_json(self) -> dict[str, Any]:
        """The keys of the design."""
        return {"level": self.level, "reasons": list(self.reasons), **plain(self)}


def judge(
    findings: Sequence[Finding],
    *,
    expected_percent: float | None,
    noise_percent: float,
    resolution_percent: float = 0.0,
    confirmed: bool,
    uncertain_share: float,
    pays: bool | None = None,
    obstacle: str = "",
    whole_percent: float | None = None,
    slow_percent: float | None = None,
    covered: tuple[str, float] | None = None,
) -> Verdict:
    """Judge an identification.

    Args:
        findings: All of them.
        expected_percent: Error on another motion, of moving joints, or on left-out data; None
            where nothing was left out and nothing else was predicted.
        noise_percent: What of it is noise, so that no model can predict it.
        resolution_percent: Error of the model that is not told from this noise.
        confirmed: The error is that of another recording.
        uncertain_share: Share of parameters whose deviation exceeds half of their value.
        pays: Identified inertias predict better than published ones; None where none are.
        obstacle: Why the model cannot be exported to a simulator; empty where it can.
        whole_percent: The error on another motion with its rests.
        slow_percent: Error of the model `SLOWER` times slower, over the same torque; None where
            another motion was predicted.
        covered: The joint of which the fewest torques of another recording lie within their 90 %
            intervals, and their share.
    """
    errors = [f for f in findings if f.severity == "error"]
    faults = [f for f in findings if f.severity == "warning" and f.code in FAULTS]
    wrong = [f for f in errors if f.code in FAULTS]
    poor = [f for f in errors if f.code not in FAULTS]
    impossible = [f for f in findings if f.code == "not_physical"]
    errors_percent = (expected_percent, whole_percent)
    noises = (noise_percent, resolution_percent)
    prediction = _prediction(errors_percent, noises, slow_percent, confirmed, wrong, faults, poor)
    if prediction.answer == "yes" and covered is not None and covered[1] < LEAST_COVERED:
        joint, share = covered
        prediction = Answer(
            answer="limits",
            reason=f"90 % intervals hold {100 * share:.0f} % of the torques of {joint}; "
            f"{prediction.reason}",
            value=100 * share,
            unit="%",
            limit=100 * LEAST_COVERED,
        )
    return Verdict(
        prediction=prediction,
        parameters=_parameters([*wrong, *faults], poor, impossible, uncertain_share, pays),
        simulation=_simulation(prediction, impossible, obstacle),
    )


def with_rests(moving: str, whole: str) -> str:
    """An error in motion, and beside it that of all samples where it is another figure."""
    return moving if moving == whole else f"{moving} in motion ({whole} with rests)"


def _prediction(
    errors: tuple[float | None, float | None],
    noises: tuple[float, float],
    slow: float | None,
    confirmed: bool,
    wrong: list[Finding],
    faults: list[Finding],
    poor: list[Finding],
) -> Answer:
    (expected, whole), (noise, hidden) = errors, noises
    if wrong:
        return Answer(answer="no", reason=wrong[0].text, value=wrong[0].value, unit=wrong[0].unit)
    if expected is None or not np.isfinite(expected):
        answer = "no" if poor else "limits"
        reason = poor[0].text if poor else "no other motion has confirmed it yet (--validate)"
        return Answer(answer=answer, reason=reason)
    told = float(np.sqrt(max(expected**2 - noise**2, 0.0)))
    beyond = max(told, hidden)
    others = "such motions" if poor else "other motions as fast as this one"
    what = "another motion's torques" if confirmed else f"torques of {others}"
    says = "predicts" if confirmed else "is expected to predict"
    known = min(noise, expected)
    shown = with_rests(f"{expected:.1f} %", f"{expected if whole is None else whole:.1f} %")
    of = f"of {beyond:.1f} % (their squares add)" if told >= hidden else f"below {beyond:.1f} %"
    parts = f"noise of {known:.1f} % and a model error {of}"
    text = f"it {says} {what} to {shown}, from {parts}"
    if slow is not None and slow > beyond:
        text += f"; at 1/{SLOWER:g} of the speed the model error is {slow:.1f} % of this torque"
    if beyond > USELESS_PREDICTION or (poor and beyond > GOOD_PREDICTION):
        reason = f"{text}; {poor[0].text}" if poor else text
        return Answer(answer="no", reason=reason, value=beyond, unit="%", limit=USELESS_PREDICTION)
    if faults:
        reason = f"{faults[0].text}; {text}"
        return Answer(answer="limits", reason=reason, value=beyond, unit="%", limit=GOOD_PREDICTION)
    if poor:
        reason = f"only for motions like these: {poor[0].text}; {text}"
        small = confirmed and beyond <= MATTERS
        answer = "yes" if small else "limits"
        return Answer(answer=answer, reason=reason, value=beyond, unit="%", limit=MATTERS)
    answer = "yes" if beyond <= GOOD_PREDICTION else "limits"
    return Answer(answer=answer, reason=text, value=beyond, unit="%", limit=GOOD_PREDICTION)


def _parameters(
    faults: list[Finding],
    poor: list[Finding],
    impossible: list[Finding],
    uncertain: float,
    pays: bool | None,
) -> Answer:
    if poor:
        return Answer(answer="no", reason=poor[0].text, value=poor[0].value, unit=poor[0].unit)
    if faults or impossible:
        first = [*faults, *impossible][0]
        return Answer(answer="limits", reason=first.text, value=first.value, unit=first.unit)
    if pays is False:
        reason = "identified inertias predict no better than published ones with fitted friction"
        return Answer(answer="limits", reason=reason)
    answer = "yes" if uncertain <= POOR_SHARE else "limits"
    reason = f"{100 * uncertain:.0f} % of them are uncertain by more than half of their value"
    return Answer(
        answer=answer, reason=reason, value=100 * uncertain, unit="%", limit=100 * POOR_SHARE
    )


def _simulation(prediction: Answer, impossible: list[Finding], obstacle: str) -> Answer:
    for first in impossible:
        if first.kind == "indefinite_mass":
            return Answer(answer="no", reason=first.text, value=first.value, limit=0.0)
    if prediction.answer == "no":
        return Answer(answer="no", reason=prediction.reason)
    if obstacle:
        return Answer(answer="no", reason=obstacle)
    if impossible:
        return Answer(answer="limits", reason=impossible[0].text)
    return Answer(answer=prediction.answer, reason=prediction.reason)
