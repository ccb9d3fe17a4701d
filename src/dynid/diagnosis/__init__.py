"""What is wrong with a recording or a result: rival explanations of one residual."""

from dynid.diagnosis.diagnose import diagnose as diagnose
from dynid.diagnosis.diagnose import findings_of as findings_of
from dynid.diagnosis.events import contact_stretches as contact_stretches
from dynid.diagnosis.explain import Explanation as Explanation
from dynid.diagnosis.explain import explain as explain
from dynid.diagnosis.prior import link_prior as link_prior
from dynid.diagnosis.residual import Recording as Recording
from dynid.diagnosis.verdict import SLOWER as SLOWER
from dynid.diagnosis.verdict import USELESS_PREDICTION as USELESS_PREDICTION
from dynid.diagnosis.verdict import Answer as Answer
from dynid.diagnosis.verdict import Verdict as Verdict
from dynid.diagnosis.verdict import judge as judge
from dynid.diagnosis.verdict import with_rests as with_rests
