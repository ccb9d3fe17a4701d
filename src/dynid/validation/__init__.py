"""How well a model predicts another record."""

from dynid.validation.comparison import CAUSES as CAUSES
from dynid.validation.comparison import OF_COMPARISON as OF_COMPARISON
from dynid.validation.comparison import REFIT as REFIT
from dynid.validation.comparison import ParameterComparison as ParameterComparison
from dynid.validation.comparison import compare as compare
from dynid.validation.comparison import refit_friction as refit_friction
from dynid.validation.error_metrics import DecidingErrors as DecidingErrors
from dynid.validation.error_metrics import Metrics as Metrics
from dynid.validation.error_metrics import deciding_errors as deciding_errors
from dynid.validation.error_metrics import errors_by_kind as errors_by_kind
from dynid.validation.error_metrics import metrics as metrics
from dynid.validation.observer import ContactThresholds as ContactThresholds
from dynid.validation.observer import MomentumObserver as MomentumObserver
from dynid.validation.observer import contact_thresholds as contact_thresholds
from dynid.validation.prediction import MOVING_SPEED as MOVING_SPEED
from dynid.validation.prediction import ValidationResult as ValidationResult
from dynid.validation.prediction import record_findings as record_findings
from dynid.validation.prediction import reproduce as reproduce
from dynid.validation.prediction import samples_of as samples_of
from dynid.validation.prediction import uncertainty_over_poses as uncertainty_over_poses
from dynid.validation.prediction import validate as validate
from dynid.validation.prediction import validate_samples as validate_samples
