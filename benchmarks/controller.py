"""The simulated controller before a recorder: packages missed, step sizes, lateness, speed-up.

60 s at 125 Hz (UR5) and at 500 Hz (UR5e) in real time while a program moves the arm, then the
same in virtual time. Asked: no missing timestamp, steps exactly 8 and 2 ms, virtual time at
least five times as fast as real time, end to end. Run it on an idle machine.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path

import numpy as np

from dynid.drivers.ur.link import RtdeLink, ScriptPort
from dynid.protocol import Numbers
from urtwin import RunningController, controller_process

SECONDS = 60.0
ASKED_SPEED_UP = 5.0
STEP_ERROR = 1e-12
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


def measure(robot: str, *, virtual: bool) -> dict[str, float]:
    """The figures of one run."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        with controller_process(robot, virtual_time=virtual, report=report) as controller:
            stamps, moving, wall = record(controller, SECONDS)
            controller.end()
            cycle = 1 / controller.rate_hz
        kept = json.loads(report.read_text())
    steps = np.diff(stamps)
    return {
        "rate": 1 / cycle,
        "rows": len(stamps),
        "missing": float(np.sum(np.round(steps / cycle) - 1)),
        "step_error": float(np.max(np.abs(steps - cycle))),
        "moving": float(np.mean(moving > 0)),
        # The controller works alone in this sense: what an idle machine could reach.
        "by_cpu": kept["controller_s"] / kept["cpu_s"],
        "speed": float(stamps[-1] - stamps[0]) / wall,
        **{share: value for share, value in kept["late_us"].items() if not virtual},
    }


def main() -> int:
    """Print the tables; 1 if an asked figure is missed."""
    failed = False
    for robot in ("ur5", "ur5e"):
        for virtual in (False, True):
            found = measure(robot, virtual=virtual)
            clock = "virtual" if virtual else "real"
            print(
                f"{robot:5} {clock:8} {found['rate']:4.0f} Hz: {found['rows']} packages, "
                f"{found['missing']:.0f} missing, steps off by {found['step_error']:.1e} s, "
                f"{100 * found['moving']:.1f} % under the program, {found['speed']:.2f} x real "
                f"({found['by_cpu']:.1f} x by the controller's CPU time)"
            )
            if not virtual:
                late = ", ".join(
                    f"{share} {found[share]:.0f}" for share in found if share[0] == "p"
                )
                print(f"      cycles late by [us]: {late}")
            failed |= found["missing"] != 0 or found["step_error"] > STEP_ERROR
            failed |= virtual and found["speed"] < ASKED_SPEED_UP
    print("asked: none missing, steps exact, virtual time at least", f"{ASKED_SPEED_UP:g} x")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
