"""Your own arm: `python own_urdf.py arm.urdf log.csv other.csv` makes a checked model."""

import sys

import dynid

if len(sys.argv) != 4:
    sys.exit(__doc__)
arm, log, other = sys.argv[1:]
found = dynid.fit(arm, log, "fitted", validation=other)
print(found.verdict.headline)
for name, answer in found.verdict.to_json().items():
    print(f"  {name}: {answer}")
print("report:", found.report)
