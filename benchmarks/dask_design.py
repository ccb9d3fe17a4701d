"""Designs by many starts and a fleet on two local Dask workers, beside one process.

The workers are processes with one thread each; the calling process takes part. The result is the
same, whoever computes it. Asked: 1.7 times on idle cores, the median of the rounds. On busy ones
the CPU of the processes tells what idle cores would give: all work alone over what the busiest of
two cores has to do, without what an idle cluster takes by the second. For designs it also tells
what two jobs gain that share nothing: two cores of a virtual machine are not always twice one.

    python benchmarks/dask_design.py            # times
    python benchmarks/dask_design.py --kill 10  # and a worker is killed in mid-run, so many times

Needs dynid[dask].
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import dask
import distributed
import numpy as np
from fleet import Individual

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
def fleet():
    """A fleet in a folder; each run is a first one."""
    with tempfile.TemporaryDirectory() as place:
        data, runs = Path(place) / "recordings", iter(range(1000))
        few = Path(place) / "few"
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


def same(a: list[np.ndarray], b: list[np.ndarray]) -> str:
    """Whether two results are equal to the last bit."""
    equal = len(a) == len(b) and all(map(np.array_equal, a, b))
    return "same result" if equal else "ANOTHER RESULT"


def timed(
    name: str, job: Job, client: Any, address: str, rounds: int
) -> tuple[list[np.ndarray], float]:
    """One process, then the cluster, so many times; what the first found, and the second's time."""

    def spent() -> np.ndarray:
        return np.array([time.process_time(), *client.run(time.process_time).values()])

    def measured(dask: str | None) -> tuple[float, np.ndarray, list[np.ndarray]]:
        before, begun = spent(), time.perf_counter()
        found = job(dask)
        return time.perf_counter() - begun, spent() - before, found

    before = spent()
    time.sleep(IDLE_S)
    idle = (spent() - before) / IDLE_S
    expected, together_s, ratios = list[np.ndarray](), 0.0, list[float]()
    for _ in range(rounds):
        alone_s, alone, expected = measured(None)
        together_s, shares, found = measured(address)
        own, net = alone[0] - idle[0] * alone_s, shares - idle * together_s
        busiest = max(net.max(), net.sum() / 2)
        ratios.append(alone_s / together_s)
        print(
            f"{name}: one process {alone_s:.1f} s ({alone[0]:.1f} s of CPU), with two workers "
            f"{together_s:.1f} s ({' + '.join(f'{s:.1f}' for s in shares)} s of CPU): "
            f"{ratios[-1]:.2f} times, by CPU, without the {1e3 * idle.sum():.0f} ms a second of "
            f"an idle cluster, {own / busiest:.2f}; {same(expected, found)}",
            flush=True,
        )
    print(f"{name}: median {np.median(ratios):.2f} of {rounds} (asked {ASKED} on idle cores)")
    return expected, together_s


def ceiling(name: str, job: Job, client: Any, rounds: int) -> None:
    """What two cores of this machine give: a job in one worker, then one in each."""
    first, *_ = workers = list(client.scheduler_info()["workers"])

    def together(places: list[str]) -> float:
        begun = time.perf_counter()
        jobs = [client.submit(job, None, workers=[place], pure=False) for place in places]
        distributed.wait(jobs)
        return time.perf_counter() - begun

    ratios = [2 * together([first]) / together(workers) for _ in range(rounds)]
    each = " ".join(f"{ratio:.2f}" for ratio in ratios)
    print(f"{name}: two jobs that share nothing, one in each worker: {each} times", flush=True)


def killed(
    name: str, job: Job, client: Any, cluster: Any, kills: int, expected: list[np.ndarray], s: float
) -> None:
    """A worker dies at a random time of each run of about so many seconds."""
    address, draw = cluster.scheduler_address, random.Random(0)
    for k in range(kills):
        # Of the processes' parents: whoever asks the cluster may still ask a dead one.
        victim = draw.choice([worker.pid for worker in cluster.workers.values()])
        wait, over, struck = draw.uniform(0.1, 0.7) * s, threading.Event(), list[float]()

        def strike(wait=wait, victim=victim, over=over, struck=struck) -> None:
            if not over.wait(wait):
                os.kill(victim, signal.SIGKILL)
                struck.append(wait)

        thread = threading.Thread(target=strike)
        thread.start()
        begun = time.perf_counter()
        found = job(address)
        over.set()
        thread.join()
        told = f"killed after {struck[0]:.1f} s" if struck else "over before anybody was killed"
        print(
            f"{name} {k + 1}: {told} of {time.perf_counter() - begun:.1f} s: "
            f"{same(expected, found)}",
            flush=True,
        )
        client.wait_for_workers(2)


def main() -> None:
    """Print times, and what became of killed workers."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kill", type=int, default=0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--only", choices=("design", "fleet"))
    asked = parser.parse_args()
    with (
        fleet() as (of_fleet, of_few),
        # So long after any loss, LocalCluster gives up a worker that is away at that moment: at
        # its 15 s, one whose second death is just being mended.
        dask.config.set({"distributed.deploy.lost-worker-timeout": "1 day"}),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        jobs = {
            f"design, {STARTS} starts": (design, partial(design, starts=3)),
            f"fleet, {ARMS * DAYS} recordings": (of_fleet, of_few),
        }
        for name, (job, short) in jobs.items():
            if asked.only and not name.startswith(asked.only):
                continue
            # Workers import and compile once.
            short(cluster.scheduler_address)
            expected, together_s = timed(name, job, client, cluster.scheduler_address, asked.rounds)
            if job is design:
                ceiling(name, job, client, asked.rounds)
            killed(name, job, client, cluster, asked.kill, expected, together_s)


if __name__ == "__main__":
    main()
