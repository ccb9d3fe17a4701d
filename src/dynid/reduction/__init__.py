"""From standard to base parameters: rank, regrouping, classes, non-zero columns."""

from dynid.reduction.base import (
    BaseParametrization,
    GramLayout,
    gram_layout,
    random_states,
    reduce_model,
)

__all__ = [
    "BaseParametrization",
    "GramLayout",
    "gram_layout",
    "random_states",
    "reduce_model",
]
