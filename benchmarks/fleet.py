"""A simulated fleet: friction of two joints rises by 15 % over the last fifth of the recordings.

Each arm of the bench has links and friction of its own (Stribeck, load, presliding), which the
identified model does not know; friction falls with temperature, which varies from recording to
recording. Told: whether both joints were found, other alarms, and how many recordings a second
run with ten new ones computes.

    python benchmarks/fleet.py [--robots 4] [--recordings 50] [--seeds 0] [--jobs 1]
"""

import tempfile
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import cached_property
from pathlib import Path
from time import process_time

import numpy as np
from shared import measuring

import dynid
from dynid.bench import Motion, Plant, motion, plant

MOTIONS, LENGTH_S, RATE_HZ, RISE, SHARE = 5, 10.0, 125.0, 1.15, 0.2
START = datetime(2026, 1, 5, 8, tzinfo=UTC)
REFERENCE_DEGC, VISCOUS_PER_K, COULOMB_PER_K = 30.0, 0.03, 0.002


@dataclass(frozen=True)
class Individual:
    """An arm of the fleet."""

    name: str
    plant: Plant
    seed: int

    @cached_property
    def motions(self) -> list[tuple[Motion, np.ndarray]]:
        """What it repeats, and the torques of its links."""
        made = [
            motion(self.plant.robot, "fourier", 100 + k, RATE_HZ, LENGTH_S) for k in range(MOTIONS)
        ]
        return [(m, self.plant.torque(m.q, m.dq, m.ddq)) for m in made]

    def write(self, folder: Path, day: int, worn: set[int], gain: float = 1.0) -> None:
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
        torque = gain * torque + draw.normal(0, now.torque_noise, torque.shape)
        step, time = now.position_step, (START + timedelta(days=day)).isoformat()
        record = dynid.ExperimentRecord(
            t=moved.t,
            signals={
                "q": step * np.round(moved.q / step),
                "effort": torque,
                "temperature": warm + draw.normal(0, 0.05, torque.shape),
            },
            metadata=dynid.RecordMetadata(robot="ur5", extra={"robot_id": self.name, "time": time}),
        )
        dynid.write_record(record, folder / f"{self.name}_{day:04d}.parquet")


def run(seed: int, robots: int, recordings: int, folder: Path, jobs: int) -> tuple[object, ...]:
    """A row of the table."""
    model, draw = dynid.load_robot("ur5"), np.random.default_rng(seed)
    chosen = {(int(r), int(draw.integers(6))) for r in draw.choice(robots, 2, replace=robots < 2)}
    data = folder / "recordings"
    data.mkdir()
    times = [process_time()]
    arms = [
        Individual(f"arm{r:02d}", plant(model, 1000 * seed + r), 1000 * seed + r)
        for r in range(robots)
    ]
    worn = [{joint for other, joint in chosen if other == r} for r in range(robots)]
    for arm, joints in zip(arms, worn, strict=True):
        for day in range(recordings):
            arm.write(data, day, joints if day >= (1 - SHARE) * recordings else set())
    settings = dynid.FleetSettings(jobs=jobs)
    times.append(process_time())
    found = dynid.fleet(data, folder / "fleet", settings)
    times.append(process_time())
    for day in range(recordings, recordings + 10):
        arms[-1].write(data, day, worn[-1])
    before = process_time()
    again = dynid.fleet(data, folder / "fleet", settings)
    spent = [*np.diff(times), process_time() - before]
    right, others = [], []
    for joint in found.alarms:
        name = f"{joint.robot}/{joint.joint + 1}"
        if (int(joint.robot[3:]), joint.joint) not in chosen:
            others.append(f"{name} {joint.alarm}")
        elif joint.alarm == "friction_drift":
            right.append(f"{name} {joint.change_percent[0]:+.1f} %")
    return (
        seed,
        f"{robots} x {recordings}",
        f"{len(right)} of {len(chosen)} ({', '.join(right)})",
        f"{len(others)} {' '.join(others)}",
        found.tests,
        again.computed,
        *(f"{value:.0f}" for value in spent),
    )


def main(
    robots: int = 4, recordings: int = 50, jobs: int = 1, seeds: tuple[int, ...] = (0,)
) -> None:
    columns = "seed, robots x recordings, found, other alarms, trends, computed again"
    columns += ", CPU s simulation, CPU s first run, CPU s second run"
    measuring.print_head(columns.split(", "))
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            measuring.print_row(run(seed, robots, recordings, Path(folder), jobs))


if __name__ == "__main__":
    measuring.run(main)
