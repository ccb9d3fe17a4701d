"""What is wrong with a recording or a result: rival explanations of one residual."""

from dynid.diagnosis.diagnose import diagnose, findings_of
from dynid.diagnosis.events import contact_stretches
from dynid.diagnosis.explain import Explained, Explanation, explain
from dynid.diagnosis.residual import Recording
from dynid.diagnosis.verdict import USELESS_PREDICTION, Answer, Verdict, judge

__all__ = [
    "USELESS_PREDICTION",
    "Answer",
    "Explained",
    "Explanation",
    "Recording",
    "Verdict",
    "contact_stretches",
    "diagnose",
    "explain",
    "findings_of",
    "judge",
]
