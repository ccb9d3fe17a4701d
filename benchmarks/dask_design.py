"""A design by many starts on two local Dask workers, beside one process.

The workers are processes with one thread each; the calling process takes part. The same starts
give the same design, whoever runs them. Asked: 1.7 times on idle cores. Needs dynid[dask].
"""

from __future__ import annotations

import resource
import time
from dataclasses import replace

import distributed
import numpy as np

import dynid

STARTS = 8
ASKED = 1.7


def main() -> None:
    """Print the times."""
    plain = dynid.DesignSettings(criterion="cond", starts=STARTS, seed=0, collision=False)

    def run(settings: dynid.DesignSettings) -> tuple[float, np.ndarray]:
        begun = time.perf_counter()
        found = dynid.design("ur5", settings)
        return time.perf_counter() - begun, found.trajectory.evaluate(np.arange(100) / 10.0).q

    run(replace(plain, starts=1))
    own = resource.getrusage(resource.RUSAGE_SELF)
    alone_s, alone = run(plain)
    used = resource.getrusage(resource.RUSAGE_SELF).ru_utime - own.ru_utime
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0"
    ) as cluster:
        on_cluster = replace(plain, dask=cluster.scheduler_address)
        # Workers import and compile once.
        run(replace(on_cluster, starts=4))
        together_s, together = run(on_cluster)
    print(f"{STARTS} starts: one process {alone_s:.1f} s ({used:.1f} s of CPU)")
    print(
        f"with two Dask workers {together_s:.1f} s: {alone_s / together_s:.2f} times "
        f"(asked {ASKED} on idle cores)"
    )
    print("same design" if np.array_equal(alone, together) else "ANOTHER DESIGN")


if __name__ == "__main__":
    main()
