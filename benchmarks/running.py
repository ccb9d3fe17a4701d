"""How much faster than real time runs are, and whether time changes what they record.

Run with:  python benchmarks/running.py [--seconds 30]

- in process: `--on sim`, CPU time against the time simulated (asked: 20 x)
- virtual time: `--on ur://`, wall time from the command to the record (asked: 5 x)
- real time against virtual time, same seed: how far the records differ
"""

import argparse
import os
import tempfile
import time
from pathlib import Path

import numpy as np

from dynid.drivers import SimulatedDriver, UrDriver, inspect
from dynid.experiment import ExperimentPlan
from dynid.recording import ExperimentRecord, RecordMetadata, RecordWriter, read_record
from dynid.robot import load_robot
from dynid.simulation import simulated_arm
from dynid.trajectory import rest_series
from urtwin import controller_process

HOST = "127.0.1.77"
POSE = np.array([0.1, -1.4, 0.3, -2.1, 0.2, 0.1])


def record(driver, plan: ExperimentPlan, path: Path) -> ExperimentRecord:
    source = driver.source
    words = (path, plan.robot.joint_names, source.quantities, RecordMetadata(robot="ur5"))
    with RecordWriter(*words, channels=source.channels, force=True) as recorder:
        outcome = driver.execute(plan.passes()[-1].execution, recorder)
    if outcome.abort is not None:
        raise SystemExit(f"stopped: {outcome.abort}")
    return read_record(path)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=int, default=30)
    periods = max(parser.parse_args().seconds // 10, 1)
    robot = load_robot("ur5")
    motion = rest_series(10.0, POSE, 0.05 * np.random.default_rng(0).normal(size=(6, 8)))
    plan = ExperimentPlan(robot=robot, trajectory=motion, periods=periods)
    print(f"UR5, {10 * periods} s at 125 Hz")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.parquet"
        record(SimulatedDriver(simulated_arm(robot)), plan, path)  # compiles
        begin = time.process_time()
        record(SimulatedDriver(simulated_arm(robot)), plan, path)
        used = time.process_time() - begin
        print(f"in process, CPU time:      {10 * periods / used:6.1f} x real time (asked 20)")
        runs: list[ExperimentRecord] = []
        for virtual in (True, False):
            with controller_process("ur5", host=HOST, virtual_time=virtual, hold=True) as running:
                begin, cpu = time.perf_counter(), cpu_of(running.process.pid)
                runs.append(record(UrDriver(inspect(running.host)), plan, path))
                wall, cpu = time.perf_counter() - begin, cpu_of(running.process.pid) - cpu
            if virtual:
                speed = 10 * periods / wall
                print(f"virtual time, wall clock:  {speed:6.1f} x real time (asked 5)")
                print(f"virtual time, CPU of both: {10 * periods / cpu:6.1f} x real time")
        compare(*runs)


def cpu_of(controller: int) -> float:
    """CPU time of this process and of a controller's [s]."""
    fields = Path(f"/proc/{controller}/stat").read_text().rpartition(")")[2].split()
    return time.process_time() + (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def compare(virtual: ExperimentRecord, real: ExperimentRecord) -> None:
    print("virtual time against real time, same seed, largest difference:")
    for name, value in virtual.signals.items():
        difference = np.abs(value - real.signals[name]).max()
        print(f"  {name:16s} {difference:.3g}")
    index = np.array_equal(virtual.channels["index"], real.channels["index"])
    print(f"  index            {'the same' if index else 'differs'}")


if __name__ == "__main__":
    main()
