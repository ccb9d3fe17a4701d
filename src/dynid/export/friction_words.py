"""What friction depends on beside speed, in words for the heads of files."""

from __future__ import annotations

from textwrap import wrap

import numpy as np

from dynid.export.model import ExportModel

_WIDTH = 88


def friction_words(model: ExportModel) -> list[str]:
    """Lines of a comment; none where friction depends on speed alone."""
    lines: list[str] = []
    if model.terms["Fl"].any():
        lines += wrap(
            f"Friction that grows with load, joints {_joints(model, 'Fl')}: a share of |load| "
            "times the Coulomb step. The load is the torque (recursive Newton-Euler, less that "
            "of counterbalances) of bodies with fixed numbers, so it needs q, dq and ddq.",
            _WIDTH,
        )
    if model.terms["Fw"].any():
        lines += wrap(
            f"Torque ripple of gears, joints {_joints(model, 'Fw')}: waves in the positions of "
            "joints whose size changes with their speeds; it needs q and dq.",
            _WIDTH,
        )
    return lines


def _joints(model: ExportModel, symbol: str) -> str:
    return ", ".join(str(j + 1) for j in np.flatnonzero(model.terms[symbol]).tolist())
