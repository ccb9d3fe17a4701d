"""How well a model predicts another record."""

from dynid.validation.comparison import ParameterComparison, compare
from dynid.validation.observer import MomentumObserver, contact_thresholds
from dynid.validation.prediction import (
    MOVING_SPEED,
    Metrics,
    ValidationResult,
    reproduce,
    validate,
)

__all__ = [
    "MOVING_SPEED",
    "Metrics",
    "MomentumObserver",
    "ParameterComparison",
    "ValidationResult",
    "compare",
    "contact_thresholds",
    "reproduce",
    "validate",
]
