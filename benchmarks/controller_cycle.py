"""What a control cycle of the simulated controller costs, beside the bare physics.

CPU time, in turns, so that other work on the machine meets both sides alike. Printed for 125 and
500 Hz: the physics alone, the whole cycle with a program that evaluates six Fourier series, the
outputs that a recorder asks for, and ur_rtde's own control script where it waits for a command.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial

import numpy as np
import script_client
from shared.measuring import fastest

from dynid.robot import load_robot
from dynid.simulation import SimulatedPlant, simulated_arm
from urtwin import ControllerMachine

ROUNDS, CYCLES = 10, 100
ASKED_TIMES_REAL_TIME = 5.0
POSE = np.array([0.0, -1.4, 1.2, -1.3, -1.2, 0.3])
OUTPUTS = (
    "timestamp target_q target_qd target_qdd target_current target_moment actual_q actual_qd "
    "actual_current joint_control_output joint_temperatures robot_mode safety_mode "
    "safety_status_bits runtime_state speed_scaling target_speed_fraction actual_momentum "
    "payload payload_cog output_int_register_24 actual_TCP_pose actual_TCP_speed"
)


def program(cycle: float) -> str:
    """Six Fourier series of five harmonics, evaluated on the controller for ever."""
    sines = "\n".join(
        f"s{k} = sin({k + 1} * 0.6283 * t)\nc{k} = cos({k + 1} * 0.6283 * t)" for k in range(5)
    )
    joints = "\n".join(
        f"q{j} = {POSE[j]} + " + " + ".join(f"0.01 * s{k} - 0.01 * (c{k} - 1)" for k in range(5))
        for j in range(6)
    )
    return f"""def excite():
    i = 0
    while True:
      t = i * {cycle}
      {sines}
      {joints}
      write_output_integer_register(24, i)
      servoj([q0, q1, q2, q3, q4, q5], t={cycle}, lookahead_time=0.03, gain=500)
      i = i + 1
    end
    end"""


def measure(rate_hz: float) -> dict[str, float]:
    """CPU time of each part [us a cycle], the fastest of the rounds."""
    arm = simulated_arm(load_robot("ur5"))
    plant = SimulatedPlant(arm, rate_hz=rate_hz)
    plant.reset(POSE)
    moving = ControllerMachine(arm, rate_hz=rate_hz, pose=POSE.tolist())
    moving.run_script(program(moving.cycle))
    waiting = ControllerMachine(arm, rate_hz=rate_hz, pose=POSE.tolist())
    text = script_client.ScriptClient("127.0.0.1", 3, 15).getScript()
    for mark in ("# float register offset\n", "# int register offset\n"):
        text = text.replace(mark, f"{mark}0", 1)
    waiting.run_script(f"def rtde_control():\n{text}end\n")
    names = OUTPUTS.split(" ")

    def read() -> None:
        for name in names:
            moving.output(name)

    parts = {
        "physics alone": lambda: plant.tick(POSE),
        "cycle, series in URScript": moving.tick,
        "outputs of a recorder": read,
        "cycle, ur_rtde's script": waiting.tick,
    }
    works = {name: partial(repeated, part) for name, part in parts.items()}
    times = fastest(works, ROUNDS)
    if not (moving.program_running and waiting.program_running):
        raise RuntimeError("a program has stopped")
    return {name: seconds / CYCLES * 1e6 for name, seconds in times.items()}


def repeated(part: Callable[[], object]) -> None:
    for _ in range(CYCLES):
        part()


def main() -> int:
    """Print the tables; 1 if a whole cycle is not fast enough."""
    slowest = np.inf
    for rate_hz in (125.0, 500.0):
        found = measure(rate_hz)
        base = found["physics alone"]
        print(f"{rate_hz:.0f} Hz: {'part':28}{'us a cycle':>11}{'ratio':>7}")
        for name, value in found.items():
            print(f"        {name:28}{value:11.0f}{value / base:7.2f}")
        whole = found["cycle, series in URScript"] + found["outputs of a recorder"]
        times = 1e6 / rate_hz / whole
        slowest = min(slowest, times)
        print(f"        a recorded cycle is {times:.1f} times faster than real time")
    print(f"asked: {ASKED_TIMES_REAL_TIME:g} times, with sockets and client; this is without them")
    return int(slowest < ASKED_TIMES_REAL_TIME)


if __name__ == "__main__":
    sys.exit(main())
