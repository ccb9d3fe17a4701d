"""A simulated fleet: friction of two joints rises by 15 % over the last fifth of the recordings.

Each arm of the bench has links and friction of its own (Stribeck, load, presliding), which the
identified model does not know; friction falls with temperature, which varies from recording to
recording. Told: whether both joints were found, other alarms, and how many recordings a second
run with ten new ones computes.

    python benchmarks/fleet.py [--robots 4] [--recordings 50] [--seeds 0] [--jobs 1]
    python benchmarks/fleet.py --robots 20 --dask 3

`--dask`: so many first runs, and designs of 16 starts, by this process alone and with two local
Dask workers of one thread each, with the same result. Asked: 1.7 times on idle cores, the median.
Exits with 1 where a joint is not found, or a figure is missed.
"""

import itertools
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import cached_property
from pathlib import Path

import numpy as np
from shared.measuring import asked, print_head, print_row, run

import dynid
from dynid.bench import Motion, Plant, motion, plant

MOTIONS, LENGTH_S, RATE_HZ, RISE, SHARE = 5, 10.0, 125.0, 1.15, 0.2
START = datetime(2026, 1, 5, 8, tzinfo=UTC)
REFERENCE_DEGC, VISCOUS_PER_K, COULOMB_PER_K = 30.0, 0.03, 0.002
COLUMNS = (
    "seed", "robots x recordings", "found", "other alarms", "trends", "computed again",
    "CPU s simulation", "CPU s first run", "CPU s second run",
)  # fmt: skip
STARTS, FEW = 16, 3
"""Starts of a design; of one that only warms up."""


@dataclass(frozen=True)
class Individual:
    """An arm of the fleet."""

    name: str
    plant: Plant
    seed: int

    @cached_property
    def motions(self) -> list[tuple[Motion, np.ndarray]]:
        """What it repeats, and the torques of its links."""
        robot = self.plant.robot
        made = [motion(robot, "fourier", 100 + k, RATE_HZ, LENGTH_S) for k in range(MOTIONS)]
        return [(m, self.plant.torque(m.q, m.dq, m.ddq)) for m in made]

    def write(self, folder: Path, day: int, worn: set[int]) -> None:
        """One recording: a motion of a few, joints between cold and warm."""
        draw = np.random.default_rng([self.seed, day])
        moved, rigid = self.motions[draw.integers(MOTIONS)]
        n = self.plant.robot.joints
        warm = draw.uniform(24.0, 36.0) + draw.uniform(-1.0, 1.0, n)
        rise, factor = warm - REFERENCE_DEGC, np.ones(n)
        factor[list(worn)] = RISE
        now = replace(
            self.plant,
            coulomb=self.plant.coulomb * factor * (1 - COULOMB_PER_K * rise),
            viscous=self.plant.viscous * factor * np.exp(-VISCOUS_PER_K * rise),
        )
        torque = rigid + now.friction(moved.dq, rigid, 1 / RATE_HZ)
        torque += draw.normal(0, now.torque_noise, torque.shape)
        step, when = now.position_step, (START + timedelta(days=day)).isoformat()
        record = dynid.ExperimentRecord(
            t=moved.t,
            signals={
                "q": step * np.round(moved.q / step),
                "effort": torque,
                "temperature": warm + draw.normal(0, 0.05, torque.shape),
            },
            metadata=dynid.RecordMetadata(robot="ur5", extra={"robot_id": self.name, "time": when}),
        )
        dynid.write_record(record, folder / f"{self.name}_{day:04d}.parquet")


class Fleet:
    """Recordings in a folder.

    Args:
        seed: Of arms, and of the joints whose friction rises.
        robots: How many arms.
        recordings: Of each.
        folder: An empty one.
    """

    def __init__(self, seed: int, robots: int, recordings: int, folder: Path) -> None:
        draw, model = np.random.default_rng(seed), dynid.load_robot("ur5")
        two = draw.choice(robots, 2, replace=robots < 2)
        self.worn = {(int(r), int(draw.integers(6))) for r in two}
        self.folder, self.data = folder, folder / "recordings"
        self.data.mkdir()
        seeds = range(1000 * seed, 1000 * seed + robots)
        self.arms = [Individual(f"arm{k:02d}", plant(model, s), s) for k, s in enumerate(seeds)]
        for k, day in itertools.product(range(robots), range(recordings)):
            self.add(k, day, rising=day >= (1 - SHARE) * recordings)

    def add(self, k: int, day: int, *, rising: bool) -> None:
        """One more recording of arm k."""
        worn = {joint for other, joint in self.worn if other == k}
        self.arms[k].write(self.data, day, worn if rising else set())


def found(seed: int, robots: int, recordings: int, jobs: int, folder: Path) -> bool:
    """Print a row of the table; whether a joint is missing."""
    times = [time.process_time()]
    made, settings = Fleet(seed, robots, recordings, folder), dynid.FleetSettings(jobs=jobs)
    times.append(time.process_time())
    told = dynid.fleet(made.data, folder / "fleet", settings)
    times.append(time.process_time())
    for day in range(recordings, recordings + 10):
        made.add(robots - 1, day, rising=True)
    before = time.process_time()
    again = dynid.fleet(made.data, folder / "fleet", settings)
    spent = [*np.diff(times), time.process_time() - before]
    right, others = [], []
    for joint in told.alarms:
        name = f"{joint.robot}/{joint.joint + 1}"
        if (int(joint.robot[3:]), joint.joint) not in made.worn:
            others.append(f"{name} {joint.alarm}")
        elif joint.alarm == "friction_drift":
            right.append(f"{name} {joint.change_percent[0]:+.1f} %")
    size, counts = f"{robots} x {recordings}", f"{len(right)} of {len(made.worn)}"
    cells = (seed, size, f"{counts} ({', '.join(right)})", " ".join([str(len(others)), *others]))
    print_row((*cells, told.tests, again.computed, *(f"{value:.0f}" for value in spent)))
    return len(right) < len(made.worn) or again.computed != 10


def beside_dask(rounds: int, robots: int, recordings: int, folder: Path) -> bool:
    """Print times with two workers and without; true if an asked figure is missed."""
    import distributed

    made, runs = Fleet(0, robots, recordings, folder), itertools.count()

    def fleets(dask: str | None) -> list[np.ndarray]:
        output = folder / f"run{next(runs)}"
        told = dynid.fleet(made.data, output, dynid.FleetSettings(dask=dask))
        return [one.statistics.factors for one in told.recordings]

    def designs(dask: str | None, starts: int = STARTS) -> list[np.ndarray]:
        asked = dynid.DesignSettings(criterion="cond", starts=starts, collision=False, dask=dask)
        return [dynid.design("ur5", asked).trajectory.evaluate(np.arange(100) / 10.0).q]

    def timed(job: Callable[[str | None], list[np.ndarray]], dask: str | None):
        begun = time.perf_counter()
        return job(dask), time.perf_counter() - begun

    missed = False
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as near,
        distributed.Client(near),
    ):
        address = near.scheduler_address
        # Workers import and compile once.
        designs(address, FEW)
        for what, job in ((f"design, {STARTS} starts", designs), ("fleet", fleets)):
            ratios = []
            for _ in range(rounds):
                (alone, alone_s), (shared, shared_s) = timed(job, None), timed(job, address)
                ratios.append(alone_s / shared_s)
                same = all(map(np.array_equal, alone, shared)) and len(alone) == len(shared)
                print(f"{what}: {alone_s:.1f} s, {shared_s:.1f} s with two workers; same: {same}")
                missed |= not same
            missed |= asked(f"{what}: times as fast", float(np.median(ratios)), least=1.7)
    return missed


def main(
    robots: int = 4,
    recordings: int = 50,
    jobs: int = 1,
    seeds: tuple[int, ...] = (0,),
    dask: int = 0,
) -> bool:
    missed = False
    if not dask:
        print_head(COLUMNS)
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            if dask:
                return beside_dask(dask, robots, recordings, Path(folder))
            missed |= found(seed, robots, recordings, jobs, Path(folder))
    return missed


if __name__ == "__main__":
    run(main)
