"""Condition number of the paper's problem: a range over seeds and BLAS kernels.

    python benchmarks/kernels.py [--starts 12] [--seeds 10] [--kernels Haswell Sandybridge Nehalem]

UR5, the paper's columns and limits, 10 s, 5 harmonics. Rounding differs between the kernels that
OpenBLAS takes on different processors, and a search amplifies it: the quality has to be the same,
the motion need not be. Every kernel gets a process of its own, Nehalem with numba for any
processor too; SkylakeX needs a processor with AVX-512. Prints the condition numbers by seed and
the CPU time; exits with 1 where one is above 34.5 (12 starts, the default of `--limits paper`) or
33 (60 starts).
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time

ASKED = {12: 34.5, 60: 33.0}
"""Condition number by the number of starts."""
GENERIC = "Nehalem"
"""The kernel that comes with numba for any processor."""


def conditions(seeds: int, starts: int) -> tuple[str, list[float], float]:
    """In this process: the kernel, the condition numbers by seed, CPU time of a design [s]."""
    from threadpoolctl import threadpool_info

    from dynid import DesignSettings, design

    kernel = next(x["architecture"] for x in threadpool_info() if x["internal_api"] == "openblas")
    settings = [DesignSettings(limits="paper", starts=starts, seed=k) for k in range(seeds)]
    design("ur5", DesignSettings(limits="paper", starts=1))
    began = time.process_time()
    found = [design("ur5", one) for one in settings]
    assert all(one.feasible for one in found)
    spent = (time.process_time() - began) / seeds
    return kernel, [one.condition_number for one in found], spent


def main() -> int:
    """Print the ranges."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--starts", type=int, default=12)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--kernels", nargs="*", default=["Haswell", "Sandybridge", GENERIC])
    asked = parser.parse_args()
    if not asked.kernels:
        print(json.dumps(conditions(asked.seeds, asked.starts)))
        return 0
    limit, worst = ASKED.get(asked.starts, float("inf")), 0.0
    words = ["--seeds", str(asked.seeds), "--starts", str(asked.starts), "--kernels"]
    for name in asked.kernels:
        changed = {"OPENBLAS_CORETYPE": name}
        if name == GENERIC:
            changed["NUMBA_CPU_NAME"] = "generic"
        child = subprocess.run(
            [sys.executable, __file__, *words],
            env=os.environ | changed,
            stdout=subprocess.PIPE,
            check=True,
        )
        kernel, values, spent = json.loads(child.stdout)
        worst = max(worst, *values)
        numbers = " ".join(f"{value:.2f}" for value in values)
        print(f"{kernel:12} {min(values):.2f} to {max(values):.2f}: {numbers}; {spent:.1f} s CPU",
              flush=True)  # fmt: skip
    print(f"{asked.starts} starts, {asked.seeds} seeds: worst {worst:.2f}, asked {limit:g}")
    return int(worst > limit)


if __name__ == "__main__":
    sys.exit(main())
