"""The simulated controller before a recorder: packages missed, step sizes, lateness, speed-up.

60 s at 125 Hz (UR5) and at 500 Hz (UR5e) in real time while a program moves the arm, then the
same in virtual time. Asked: no missing timestamp, steps exactly 8 and 2 ms, virtual time at
least five times as fast as real time, end to end.

Then runs of a plan: `--on sim` in process, CPU time against the time simulated (asked: 20 times),
and `--on ur://` in virtual and in real time, how far what they record differs. Run it on an idle
machine: python benchmarks/controller.py [--seconds 60]
"""

import itertools
import json
import tempfile
import time
from contextlib import closing
from pathlib import Path

import numpy as np
from shared.measuring import run

from dynid.drivers import Driver, SimulatedDriver, UrDriver, inspect
from dynid.drivers.ur.link import RtdeLink, ScriptPort
from dynid.experiment import ExperimentPlan
from dynid.protocol import Numbers
from dynid.recording import ExperimentRecord, RecordMetadata, RecordWriter, read_record
from dynid.robot import load_robot
from dynid.simulation import simulated_arm
from dynid.trajectory import rest_series
from urtwin import RunningController, controller_process

ASKED_SPEED_UP, STEP_ERROR = 5.0, 1e-12
POSE = np.array([0.1, -1.4, 0.3, -2.1, 0.2, 0.1])
TIME, INDEX = "timestamp", "output_int_register_24"
FIELDS = (
    "timestamp target_q target_qd target_qdd target_current target_moment actual_q actual_qd "
    "actual_current joint_control_output joint_temperatures speed_scaling target_speed_fraction "
    "robot_mode safety_mode safety_status_bits runtime_state actual_momentum output_int_register_24"
)
PROGRAM = """def swing():
  k = 0
  while True:
    s = 0.4 * (1 - cos(k * {step}))
    write_output_integer_register(24, k)
    servoj([s, -1.5707963 + 0.5 * s, s, -1.5707963, s, s], t={cycle}, lookahead_time=0.03, gain=500)
    k = k + 1
  end
end
"""


def record(controller: RunningController, seconds: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Time stamps and indices of every package of a time, and how long that took [s]."""
    cycle, rows = 1 / controller.rate_hz, list[Numbers]()
    with closing(RtdeLink(controller.host)) as link:
        recipe = link.ask_outputs(FIELDS.split())
        with closing(ScriptPort(controller.host)) as port:
            port.send(PROGRAM.format(step=2.0 * cycle, cycle=cycle))
        link.start()
        begin = time.perf_counter()
        while len(rows) <= round(seconds / cycle):
            rows += link.packages()
        wall = time.perf_counter() - begin
    found = [recipe.by_name(row) for row in rows]
    return *(np.array([x[name] for x in found]) for name in (TIME, INDEX)), wall


def measured(robot: str, seconds: float, *, virtual: bool) -> bool:
    """Print the figures of one run; whether they are as asked."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        with controller_process(robot, virtual_time=virtual, report=report) as controller:
            stamps, moving, wall = record(controller, seconds)
            controller.end()
            cycle = 1 / controller.rate_hz
        kept = json.loads(report.read_text())
    steps = np.diff(stamps)
    missing, off = np.sum(np.round(steps / cycle) - 1), np.abs(steps - cycle).max()
    speed = float(stamps[-1] - stamps[0]) / wall
    # The controller alone: what an idle machine could reach.
    by_cpu = kept["controller_s"] / kept["cpu_s"]
    print(
        f"{robot:5} {'virtual' if virtual else 'real':8} {1 / cycle:4.0f} Hz: {len(stamps)} "
        f"packages, {missing:.0f} missing, steps off by {off:.1e} s, "
        f"{100 * np.mean(moving > 0):.1f} % under the program, {speed:.2f} x real "
        f"({by_cpu:.1f} x by the controller's CPU time)",
        flush=True,
    )
    if not virtual:
        late = ", ".join(f"{share} {us:.0f}" for share, us in kept["late_us"].items())
        print(f"      cycles late by [us]: {late}", flush=True)
    fast = not virtual or speed >= ASKED_SPEED_UP
    return bool(missing == 0 and off <= STEP_ERROR and fast)


def ran(driver: Driver, plan: ExperimentPlan, path: Path) -> ExperimentRecord:
    """What a driver records of a plan."""
    source = driver.source
    words = (path, plan.robot.joint_names, source.quantities, RecordMetadata(robot="ur5"))
    with RecordWriter(*words, channels=source.channels, force=True) as recorder:
        outcome = driver.execute(plan.passes()[-1].execution, recorder)
    if outcome.abort is not None:
        raise SystemExit(f"stopped: {outcome.abort}")
    return read_record(path)


def runs(seconds: float) -> None:
    """Print how fast runs of a plan are, and whether time changes what they record."""
    robot, periods = load_robot("ur5"), max(round(seconds / 10), 1)
    motion = rest_series(10.0, POSE, 0.05 * np.random.default_rng(0).normal(size=(6, 8)))
    plan = ExperimentPlan(robot=robot, trajectory=motion, periods=periods)
    print(f"UR5, a run of {10 * periods} s at 125 Hz")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.parquet"
        for _ in range(2):  # The first one compiles.
            begin = time.process_time()
            ran(SimulatedDriver(simulated_arm(robot)), plan, path)
            used = time.process_time() - begin
        print(f"in process, CPU time:      {10 * periods / used:6.1f} x real (asked 20)")
        records: list[ExperimentRecord] = []
        for virtual in (True, False):
            report = Path(folder) / f"report_{'virtual' if virtual else 'real'}.json"
            words = {"virtual_time": virtual, "hold": True, "report": report}
            with controller_process("ur5", **words) as controller:
                begin, cpu = time.perf_counter(), time.process_time()
                records.append(ran(UrDriver(inspect(controller.host)), plan, path))
                wall, cpu = time.perf_counter() - begin, time.process_time() - cpu
                controller.end()
            if virtual:
                cpu += json.loads(report.read_text())["cpu_s"]
                print(f"virtual time, wall clock:  {10 * periods / wall:6.1f} x real (asked 5)")
                print(f"virtual time, CPU of both: {10 * periods / cpu:6.1f} x real")
    print("virtual time against real time, same seed, largest difference:")
    first, second = ({**one.signals, "index": one.channels["index"]} for one in records)
    for name, value in first.items():
        print(f"  {name:16s} {np.abs(value - second[name]).max():.3g}")


def main(seconds: float = 60.0) -> bool:
    """Print the tables; true if an asked figure is missed."""
    each = itertools.product(("ur5", "ur5e"), (False, True))
    good = [measured(robot, seconds, virtual=virtual) for robot, virtual in each]
    print("asked: none missing, steps exact, virtual time at least", f"{ASKED_SPEED_UP:g} x")
    runs(seconds)
    return not all(good)


if __name__ == "__main__":
    run(main)
