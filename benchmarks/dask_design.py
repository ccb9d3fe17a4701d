"""Designs by many starts and a fleet on two local Dask workers, beside one process.

The workers are processes with one thread each; the calling process takes part. The result is the
same, whoever computes it. Asked: 1.7 times on idle cores, the median of the rounds.

    python benchmarks/dask_design.py [--rounds 3] [--only design|fleet]

Needs dynid[dask].
"""

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import distributed
import numpy as np
from fleet import Individual
from shared.measuring import run

import dynid
from dynid.bench import plant

STARTS, ARMS, DAYS = 16, 20, 50
FEW = 20
"""Recordings of a run that only warms up."""
ASKED, IDLE_S = 1.7, 10.0
Job = Callable[[str | None], list[np.ndarray]]
"""Runs on a cluster, or on none, and gives its numbers."""


def design(dask: str | None, starts: int = STARTS) -> list[np.ndarray]:
    """A design by many starts."""
    settings = dynid.DesignSettings(criterion="cond", starts=starts, seed=0, collision=False)
    found = dynid.design("ur5", replace(settings, dask=dask))
    return [found.trajectory.evaluate(np.arange(100) / 10.0).q]


@contextmanager
def fleet() -> Iterator[tuple[Job, Job]]:
    """A fleet in a folder, and a small one; each run is a first one."""
    with tempfile.TemporaryDirectory() as place:
        data, few, runs = Path(place) / "recordings", Path(place) / "few", iter(range(1000))
        data.mkdir()
        few.mkdir()
        for seed in range(ARMS):
            arm = Individual(f"arm{seed}", plant(dynid.load_robot("ur5"), seed), seed)
            for day in range(DAYS):
                arm.write(data, day, set())
        for day in range(FEW):
            arm.write(few, day, set())

        def run(dask: str | None, folder: Path = data) -> list[np.ndarray]:
            output = Path(place) / f"run{next(runs)}"
            found = dynid.fleet(folder, output, dynid.FleetSettings(dask=dask))
            trends = [joint.friction for joint in found.joints if joint.friction is not None]
            return [
                *(one.statistics.factors for one in found.recordings),
                *(np.array([one.change, one.p_value, *one.at_reference]) for one in trends),
            ]

        yield run, partial(run, folder=few)


def timed(job: Job, dask: str | None) -> tuple[list[np.ndarray], float]:
    """What a job finds, and its wall time [s]."""
    begun = time.perf_counter()
    found = job(dask)
    return found, time.perf_counter() - begun


def same(a: list[np.ndarray], b: list[np.ndarray]) -> str:
    """Whether two results are equal to the last bit."""
    equal = len(a) == len(b) and all(map(np.array_equal, a, b))
    return "same result" if equal else "ANOTHER RESULT"


def idle_cpu(client: Any) -> float:
    """CPU that an idle cluster takes, this process included [s a second]."""

    def spent() -> float:
        return time.process_time() + sum(client.run(time.process_time).values())

    before = spent()
    time.sleep(IDLE_S)
    return (spent() - before) / IDLE_S


def main(rounds: int = 3, only: str = "") -> None:
    """Print times."""
    with (
        fleet() as (of_fleet, of_few),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        print(f"an idle cluster takes {idle_cpu(client):.2f} s of CPU a second", flush=True)
        jobs = {
            f"design, {STARTS} starts": (design, partial(design, starts=3)),
            f"fleet, {ARMS * DAYS} recordings": (of_fleet, of_few),
        }
        for name, (job, short) in jobs.items():
            if not name.startswith(only):
                continue
            # Workers import and compile once.
            short(cluster.scheduler_address)
            ratios = []
            for _ in range(rounds):
                expected, alone_s = timed(job, None)
                found, together_s = timed(job, cluster.scheduler_address)
                ratios.append(alone_s / together_s)
                print(f"{name}: one process {alone_s:.1f} s, with two workers {together_s:.1f} s: "
                      f"{ratios[-1]:.2f} times; {same(expected, found)}", flush=True)  # fmt: skip
            print(f"{name}: median {np.median(ratios):.2f} times (asked {ASKED} on idle cores)")


if __name__ == "__main__":
    run(main)
