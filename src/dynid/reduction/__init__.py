"""From standard to base parameters: rank, regrouping, classes."""

from dynid.reduction.base import BaseParametrization, random_states, reduce_model

__all__ = [
    "BaseParametrization",
    "random_states",
    "reduce_model",
]
