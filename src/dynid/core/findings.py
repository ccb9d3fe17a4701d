"""Findings: what is worth knowing about an input or a result, as values; and progress of long jobs.

Programs decide by kind, severity, joints and value. The sentence is for people only.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

SEVERITIES = ("info", "warning", "error")
"""`info`: worth knowing; `warning`: look before use; `error`: the result must not be used."""

KINDS: Mapping[str, tuple[str, str]] = {
    # A class of findings is a kind as well, for those that need no name of their own.
    **{
        code: (code, "warning")
        for code in (
            "ill_conditioned", "low_excitation", "over_fitted", "not_physical", "at_rest",
            "clock_jitter", "clock_mismatch", "dropped_rows", "corrupt_rows", "truncated_file",
            "saturated", "unit_suspect", "duplicate_record", "dead_channel", "weak_excitation",
            "contact", "delay", "drive_gain", "encoder_zero", "exchanged_joints", "payload",
            "flexibility", "friction_drift", "torque_kind",
        )
    },
    "non_white_residuals": ("non_white_residuals", "info"),
    "not_diagnosed": ("not_diagnosed", "info"),
    "extrapolated": ("extrapolated", "warning"),
    "other_motion": ("extrapolated", "info"),
    "identification_gains_nothing": ("weak_excitation", "info"),
    "ripple": ("ripple", "info"),
    "unwrapped": ("unit_suspect", "info"),
    "time_unit": ("unit_suspect", "info"),
    "gains_unused": ("unit_suspect", "info"),
    "aborted": ("aborted", "warning"),
    "same_record": ("over_fitted", "warning"),
    "other_shape": ("unit_suspect", "warning"),
    "another_robot": ("extrapolated", "warning"),
    "gain_all": ("drive_gain", "warning"),
    "torque_scale": ("drive_gain", "warning"),
    "payload_change": ("payload", "warning"),
    "reversed": ("unit_suspect", "error"),
    "exchanged": ("exchanged_joints", "error"),
    "exchanged_torques": ("exchanged_joints", "error"),
    "clock_offset": ("clock_mismatch", "error"),
    "clock_scale": ("clock_mismatch", "warning"),
    "mounting": ("unit_suspect", "warning"),
    "link_length": ("unit_suspect", "warning"),
    "spring": ("unit_suspect", "warning"),
    "coupled_friction": ("unit_suspect", "warning"),
    "coupled_torques": ("unit_suspect", "warning"),
    "coupled_motors": ("unit_suspect", "warning"),
    "gravity_compensated": ("torque_kind", "error"),
    "absolute_torque": ("torque_kind", "error"),
    "friction_compensated": ("torque_kind", "warning"),
    "hardly_any_friction": ("torque_kind", "info"),
    "commanded": ("torque_kind", "warning"),
    "unexplained": ("over_fitted", "warning"),
    "negative_friction": ("not_physical", "warning"),
    "indefinite_mass": ("not_physical", "warning"),
}  # fmt: skip
"""Exact kind to its class (the `code` of the JSON) and its usual severity."""
CODES = frozenset(code for code, _ in KINDS.values())


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing worth knowing about an input or a result.

    Raises:
        ValueError: A kind or a severity that is not known.
    """

    kind: str
    """One of `KINDS`."""
    text: str
    """The fact in words, with its numbers. Nothing may be decided by it."""
    severity: str = ""
    """One of `SEVERITIES`; that of the kind if not given."""
    joints: tuple[int, ...] = ()
    """Joints that it is about, from 0; none for the arm or the file as a whole."""
    value: float | None = None
    """Its size, in `unit`."""
    std: float | None = None
    """Standard deviation of the size."""
    unit: str = ""
    """Unit of value and deviation."""
    next_step: str = ""
    """What to do about it."""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"unknown kind of finding {self.kind!r}")
        if not self.severity:
            object.__setattr__(self, "severity", KINDS[self.kind][1])
        if self.severity not in SEVERITIES:
            raise ValueError(f"unknown severity {self.severity!r}")

    @property
    def code(self) -> str:
        """The class of the kind."""
        return KINDS[self.kind][0]

    @property
    def message(self) -> str:
        """The sentence for people: the fact and the next step."""
        return f"{self.text}: {self.next_step}" if self.next_step else self.text

    def to_json(self) -> dict[str, Any]:
        """All fields, the joints counted from 1."""
        return {
            "kind": self.kind,
            "code": self.code,
            "severity": self.severity,
            "joints": [j + 1 for j in self.joints],
            "value": self.value,
            "std": self.std,
            "unit": self.unit,
            "message": self.message,
            "next_step": self.next_step,
        }


def finding_from_json(data: Mapping[str, Any]) -> Finding:
    """A finding from `Finding.to_json`, or from a code and a message of release 0.1.

    Raises:
        KeyError: No code and no kind.
        ValueError: An unknown kind.
    """
    text, step = str(data["message"]), str(data.get("next_step", ""))
    return Finding(
        kind=str(data.get("kind") or data["code"]),
        text=text.removesuffix(f": {step}") if step else text,
        severity=str(data.get("severity", "")),
        joints=tuple(int(j) - 1 for j in data.get("joints", ())),
        value=None if data.get("value") is None else float(data["value"]),
        std=None if data.get("std") is None else float(data["std"]),
        unit=str(data.get("unit", "")),
        next_step=step,
    )


def told(findings: Sequence[Finding], key: str = "warnings") -> dict[str, list[dict[str, Any]]]:
    """Findings in the JSON of a result: all of them, and by code and message those above info."""
    short = [{"code": f.code, "message": f.message} for f in findings if f.severity != "info"]
    return {key: short, "findings": [finding.to_json() for finding in findings]}


Progress = Callable[[str, float], None]
"""Told what is being done, and how far the job is (0 to 1)."""


def silent(what: str, share: float) -> None:
    """Progress that nobody watches."""
    del what, share
