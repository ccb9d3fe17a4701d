"""From standard to base parameters: rank, regrouping, classes, non-zero columns."""

from dynid.reduction.base import (
    BaseParametrization,
    ColumnPanel,
    GramLayout,
    acting_joints,
    fill_beside,
    gram_layout,
    random_states,
    reduce_model,
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
