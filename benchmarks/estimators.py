"""All estimators on the known simulated UR5: noise x seed, BIRDy's figures of merit.

python benchmarks/estimators.py [SEEDS]
"""

from __future__ import annotations

import sys

from dynid.bench import compare_estimators, summary
from dynid.identification import ESTIMATORS


def main(words: list[str]) -> int:
    """Print the table as Markdown."""
    seeds = int(words[0]) if words else 3
    trials = compare_estimators(ESTIMATORS, range(seeds))
    print(f"| scenario | estimator | d_beta | d_tau [%] | d_q [%] | s | failures of {seeds} |")
    print("|---|---|---|---|---|---|---|")
    for row in sorted(summary(trials), key=lambda r: str(r["scenario"])):
        print(
            f"| {row['scenario']} | {row['estimator']} | {row['d_beta']:.3f} | "
            f"{row['d_tau_percent']:.2f} | {row['d_q_percent']:.3f} | {row['seconds']:.2f} | "
            f"{row['failures']} |"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
