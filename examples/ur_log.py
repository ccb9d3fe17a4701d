"""A log of a UR's recorder: verdict, models and report in one call.

The log that comes along is of a real UR5; its drive gains are the robot's published ones, or found
from the target currents and moments in the log where none are known.
"""

import tempfile
from pathlib import Path

import dynid

DATA = Path(__file__).parent / "data"
with tempfile.TemporaryDirectory() as folder:
    found = dynid.fit("ur5", DATA / "ur5_no6.csv.gz", folder, validation=DATA / "ur5_no5.csv.gz")
    print(found.verdict.headline)
    result = found.identification
    for name, rms in result.estimate.assessment.models.items():
        print(f"{name}: {rms.round(2)} N.m on regions left out")
    print(f"another motion: {result.validation.metrics.rmse.round(2)} N.m a joint")
    print("written:", *(item.name for item in sorted(Path(folder).iterdir())))
