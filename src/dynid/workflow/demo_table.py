"""The demo's table: the paper's figures beside ours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dynid.workflow.analyze import Analysis
from dynid.workflow.identify import Identification

PAPER_CONDITION = 153.0
PAPER_ERROR = 0.0550
"""e_N of the paper's validation [N.m]; its N is not given."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One quantity; None where it does not apply or is not given."""

    quantity: str
    unit: str = ""
    paper: float | None
    preset_paper: float | None
    preset_best: float | None
    note: str = ""

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {
            "quantity": self.quantity,
            "unit": self.unit,
            "paper": self.paper,
            "preset_paper": self.preset_paper,
            "preset_best": self.preset_best,
            "note": self.note,
        }


def comparison(analysis: Analysis, paper: Identification, best: Identification) -> tuple[Row, ...]:
    """The table.

    Args:
        analysis: The structure of the UR5.
        paper: Identification with the paper's settings, validated.
        best: Identification with chosen settings, validated.
    """
    both = (paper, best)
    counts = analysis.to_json()
    frames = f"{counts['frames']} frames; the split depends on the frames"
    structure = [
        _same("standard parameters", 78, counts["standard_parameters"]),
        _same("base parameters", 52, counts["base_parameters"]),
        _same("identifiable alone", 30, counts["identifiable_alone"], frames),
        _same("identifiable in combination", 39, counts["identifiable_combined"], frames),
        _same("not identifiable", 9, counts["unidentifiable"]),
    ]
    checks = [item.validation or item.training for item in both]
    rms = [float(np.sqrt(np.mean(np.square(check.metrics.rmse)))) for check in checks]
    fits = [
        Row(
            quantity="condition number",
            paper=PAPER_CONDITION,
            preset_paper=both[0].estimate.condition_number,
            preset_best=both[1].estimate.condition_number,
            note="paper: optimised trajectory; ours: a random one",
        ),
        Row(
            quantity="e_N on the other motion",
            unit="N.m",
            paper=PAPER_ERROR,
            preset_paper=checks[0].metrics.normalized_error,
            preset_best=checks[1].metrics.normalized_error,
            note="e_N falls as 1/sqrt(N); compare RMS where N differs",
        ),
        Row(
            quantity="N, samples of that motion",
            paper=None,
            preset_paper=checks[0].metrics.samples,
            preset_best=checks[1].metrics.samples,
            note="the paper does not give its N",
        ),
        Row(
            quantity="RMS error, all joints",
            unit="N.m",
            paper=None,
            preset_paper=rms[0],
            preset_best=rms[1],
        ),
        Row(
            quantity="relative error, moving joints",
            unit="%",
            paper=None,
            preset_paper=checks[0].moving.relative_error_overall_percent,
            preset_best=checks[1].moving.relative_error_overall_percent,
        ),
    ]
    return (*structure, *fits)


def _same(quantity: str, paper: float, ours: float, note: str = "") -> Row:
    """A count that does not depend on the preset."""
    return Row(quantity=quantity, paper=paper, preset_paper=ours, preset_best=ours, note=note)
