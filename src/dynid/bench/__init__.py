"""Methods side by side, on arms whose truth is known."""

from dynid.bench.estimators import compare_estimators as compare_estimators
from dynid.bench.estimators import summary as summary
from dynid.bench.estimators import to_json as to_json
from dynid.bench.plants import Motion as Motion
from dynid.bench.plants import Plant as Plant
from dynid.bench.plants import arm as arm
from dynid.bench.plants import motion as motion
from dynid.bench.plants import plant as plant
from dynid.bench.plants import urdf as urdf
from dynid.bench.verdicts import Case as Case
from dynid.bench.verdicts import Judged as Judged
from dynid.bench.verdicts import Recorded as Recorded
from dynid.bench.verdicts import cases as cases
from dynid.bench.verdicts import markdown as markdown
from dynid.bench.verdicts import rates as rates
from dynid.bench.verdicts import recorded as recorded
from dynid.bench.verdicts import run_verdicts as run_verdicts
from dynid.bench.verdicts import summarise as summarise
