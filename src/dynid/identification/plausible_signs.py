"""Which parameters cannot be negative, whatever the data say."""

from __future__ import annotations

import numpy as np

from dynid.core.arrays import Mask
from dynid.regressor.model import InverseDynamicModel

NOT_NEGATIVE = ("Fc", "Fv", "Fr", "Fl", "Fw", "Im", "Fcm", "Fvm", "Imm")
"""Parameters that only take energy away, or store it."""


def symbol_of(name: str) -> str:
    """The symbol of a parameter without its joint."""
    return name.rstrip("0123456789")


def not_negative(model: InverseDynamicModel) -> Mask:
    """(p) whether each standard parameter only takes energy away or stores it."""
    return np.array([symbol_of(name) in NOT_NEGATIVE for name in model.names])
