"""From standard to base parameters: rank, regrouping, classes, non-zero columns."""

from dynid.reduction.base import BaseParametrization, random_states, reduce_model
from dynid.reduction.panels import (
    ColumnPanel,
    GramLayout,
    acting_joints,
    fill_beside,
    gram_layout,
)

__all__ = [
    "BaseParametrization",
    "ColumnPanel",
    "GramLayout",
    "acting_joints",
    "fill_beside",
    "gram_layout",
    "random_states",
    "reduce_model",
]
