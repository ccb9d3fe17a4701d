"""How well a model predicts another record."""

from dynid.validation.comparison import CAUSES, ParameterComparison, compare, refit_friction
from dynid.validation.observer import ContactThresholds, MomentumObserver, contact_thresholds
from dynid.validation.prediction import (
    MOVING_SPEED,
    Metrics,
    ValidationResult,
    reproduce,
    samples_of,
    validate,
    validate_samples,
)

__all__ = [
    "CAUSES",
    "MOVING_SPEED",
    "ContactThresholds",
    "Metrics",
    "MomentumObserver",
    "ParameterComparison",
    "ValidationResult",
    "compare",
    "contact_thresholds",
    "refit_friction",
    "reproduce",
    "samples_of",
    "validate",
    "validate_samples",
]
