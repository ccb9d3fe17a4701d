"""How well a model predicts another record."""

from dynid.validation.comparison import ParameterComparison, compare
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
from dynid.validation.transfer import CAUSES, TransferReport, refit_friction

__all__ = [
    "CAUSES",
    "MOVING_SPEED",
    "ContactThresholds",
    "Metrics",
    "MomentumObserver",
    "ParameterComparison",
    "TransferReport",
    "ValidationResult",
    "compare",
    "contact_thresholds",
    "refit_friction",
    "reproduce",
    "samples_of",
    "validate",
    "validate_samples",
]
