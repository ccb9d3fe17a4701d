"""How well a model predicts another record."""

from dynid.validation.comparison import ParameterComparison, compare
from dynid.validation.findings import wrong_inputs
from dynid.validation.observer import MomentumObserver, contact_thresholds
from dynid.validation.prediction import (
    CARRIED,
    MOVING_SPEED,
    SAME_RECORD,
    Metrics,
    ValidationResult,
    reproduce,
    validate,
)
from dynid.validation.record_faults import DISTURBED

__all__ = [
    "CARRIED",
    "DISTURBED",
    "MOVING_SPEED",
    "SAME_RECORD",
    "Metrics",
    "MomentumObserver",
    "ParameterComparison",
    "ValidationResult",
    "compare",
    "contact_thresholds",
    "reproduce",
    "validate",
    "wrong_inputs",
]
