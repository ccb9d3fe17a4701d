"""The demo's table: the paper's figures beside ours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dynid.excitation.design import ExcitationDesign
from dynid.validation.comparison import ParameterComparison
from dynid.workflow.analyze import Analysis
from dynid.workflow.identify import Identification

PAPER_CONDITION = 153.0
PAPER_WARMING = -35.0
"""Largest change of viscous friction from a cold to a warm robot [%]."""
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


def comparison(
    analysis: Analysis, design: ExcitationDesign, paper: Identification, best: Identification
) -> tuple[Row, ...]:
    """Structure, excitation and prediction.

    Args:
        analysis: The structure of the UR5.
        design: The motion that was identified from.
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
            quantity="condition number, designed",
            paper=PAPER_CONDITION,
            preset_paper=design.condition_number,
            preset_best=design.condition_number,
            note="ours inside every safety limit: tool speed, power, torque, self-collision",
        ),
        Row(
            quantity="condition number, as executed",
            paper=None,
            preset_paper=both[0].estimate.condition_number,
            preset_best=both[1].estimate.condition_number,
            note="the servo follows with a delay; preset best may have more columns",
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


def warming(change: ParameterComparison, joints: int) -> tuple[Row, ...]:
    """What warming up changed (paper 3.2, Fig. 4).

    Args:
        change: From cold to warm, with the paper's settings.
        joints: Number of joints.
    """
    found = dict(zip(change.names, change.change_percent, strict=True))
    rows = [
        _ours(
            f"viscous friction of joint {j}, cold to warm",
            float(found[f"Fv{j}"]),
            PAPER_WARMING if j == 1 else None,
            "paper: by up to 35 % down" if j == 1 else "",
            unit="%",
        )
        for j in range(1, joints + 1)
        if f"Fv{j}" in found
    ]
    for group in change.groups:
        if group.members:
            rows.append(
                _ours(
                    f"{group.name} parameters, largest |z| cold to warm",
                    group.largest_z,
                    None,
                    f"above {group.limit_z:.1f} something moved",
                )
            )
    return tuple(rows)


def _ours(quantity: str, ours: float, paper: float | None, note: str = "", unit: str = "") -> Row:
    """A figure of the paper's settings alone."""
    return Row(
        quantity=quantity, unit=unit, paper=paper, preset_paper=ours, preset_best=None, note=note
    )


def _same(quantity: str, paper: float, ours: float, note: str = "") -> Row:
    """A count that does not depend on the preset."""
    return Row(quantity=quantity, paper=paper, preset_paper=ours, preset_best=ours, note=note)
