"""What makes the machine stop, and that it does so in time."""

import math

import numpy as np
import pytest

from dynid.core import InputError, JobError
from dynid.robot import load_robot
from dynid.simulation import SimulatedArm, simulated_arm
from scripts import HOME, said, ticks
from urtwin import ControllerMachine
from urtwin.safety import WatchedLimits

START = HOME.tolist()
STOP_WITHIN = 0.1
"""Controller time from a fault to standstill [s]."""
STANDING = 0.03
"""Speed that counts as standing: three deviations of the measured one and a little [rad/s]."""
OPEN = WatchedLimits(tool_speed=math.inf, momentum=math.inf, power=math.inf, unlock_after=0.0)


def moving(
    arm: SimulatedArm, joint: int, speed: float, rate_hz: float = 125.0
) -> ControllerMachine:
    machine = ControllerMachine(arm, pose=START, safety=OPEN, rate_hz=rate_hz)
    speeds = [0.0] * 6
    speeds[joint] = speed
    machine.run_script(f"speedj({speeds}, 15, 10)")
    ticks(machine, 0.4)
    assert machine.output("actual_qd")[joint] == pytest.approx(speed, rel=0.05)
    return machine


@pytest.mark.parametrize("joint", range(6))
@pytest.mark.parametrize("rate_hz", [125.0, 500.0])
def test_a_protective_stop_stops_in_time(arm: SimulatedArm, joint: int, rate_hz: float) -> None:
    machine = moving(arm, joint, 2.5, rate_hz)
    machine.core.protective_stop("test")
    ticks(machine, STOP_WITHIN)
    assert abs(machine.output("actual_qd")[joint]) < STANDING
    assert machine.output("runtime_state") == 1
    assert machine.output("safety_mode") == 3
    assert machine.output("safety_status_bits") == 1 << 2 | 1 << 10
    assert machine.output("robot_mode") == 7
    assert not machine.program_running


@pytest.mark.parametrize("joint", [0, 1, 5])
def test_a_stopped_program_stops_the_arm_in_time(arm: SimulatedArm, joint: int) -> None:
    machine = moving(arm, joint, 2.5)
    assert machine.stop()
    ticks(machine, STOP_WITHIN)
    assert abs(machine.output("actual_qd")[joint]) < STANDING
    assert machine.output("safety_mode") == 1


def test_nothing_moves_in_a_protective_stop(arm: SimulatedArm) -> None:
    machine = ControllerMachine(arm, pose=START, safety=OPEN)
    machine.core.protective_stop("test")
    before = machine.output("target_q")
    machine.run_script(f"movej({(HOME + 0.3).tolist()})")
    ticks(machine, 0.5)
    assert machine.output("target_q") == pytest.approx(before, abs=1e-9)
    assert any("not ready" in text for text in said(machine))
    assert not machine.play()


def test_unlocking_takes_its_time(arm: SimulatedArm) -> None:
    machine = ControllerMachine(arm, pose=START)
    assert not machine.unlock_protective_stop(), "there is nothing to unlock"
    machine.core.protective_stop("test")
    ticks(machine, 4.9)
    assert not machine.unlock_protective_stop()
    ticks(machine, 0.2)
    assert machine.unlock_protective_stop()
    assert machine.output("safety_mode") == 1
    assert machine.output("safety_status_bits") == 1


def reason(machine: ControllerMachine) -> str:
    assert machine.output("safety_mode") == 3, said(machine)
    return machine.core.safety.reason


@pytest.mark.parametrize(
    ("script", "words"),
    [
        (f"servoj({(HOME + 0.2).tolist()}, t=0.008)", "C204A1"),
        ("servoj([7.0, -1.4, 1.2, -1.3, -1.2, 0.3], t=5)", "position limit"),
        ("servoj([1e308 * 10.0, 0, 0, 0, 0, 0])", "C204A5"),
    ],
)
def test_set_points_that_make_no_sense(arm: SimulatedArm, script: str, words: str) -> None:
    machine = ControllerMachine(arm, pose=START, safety=OPEN)
    machine.run_script(script)
    machine.tick()
    while machine.program_running:
        machine.tick()
    assert words in reason(machine)


def test_joints_that_turn_too_fast(arm: SimulatedArm) -> None:
    machine = ControllerMachine(arm, pose=START, safety=OPEN)
    machine.run_script("speedj([0, 0, 0, 0, 0, 4.0], 20, 2)")
    ticks(machine, 1.0)
    assert "C191A37" in reason(machine)
    assert max(np.abs(machine.output("target_qd"))) < STANDING


@pytest.mark.parametrize(
    ("robot", "joint", "speed", "words"),
    [("ur3e", 5, 6.0, ""), ("ur3e", 5, 7.0, "C191A37"), ("ur10e", 0, 2.4, "C191A32")],
)
def test_each_joint_has_its_own_speed(robot: str, joint: int, speed: float, words: str) -> None:
    machine = ControllerMachine(simulated_arm(load_robot(robot)), pose=START, safety=OPEN)
    speeds = [speed if k == joint else 0.0 for k in range(6)]
    machine.run_script(f"speedj({speeds}, 40, 0.3)")
    ticks(machine, 0.3)
    assert (words in reason(machine)) if words else not machine.core.safety.stopped


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"tool_speed": 0.5}, "Tool speed limit"),
        ({"momentum": 3.0}, "Momentum limit"),
        ({"power": 20.0}, "Power limit"),
        ({"deviation": 1e-4}, "C153"),
    ],
)
def test_limits_of_the_whole_arm(arm: SimulatedArm, limits: dict[str, float], words: str) -> None:
    none = {"tool_speed": math.inf, "momentum": math.inf, "power": math.inf}
    machine = ControllerMachine(arm, pose=START, safety=WatchedLimits(**{**none, **limits}))
    machine.run_script("speedj([1.5, 0, 0, 0, 0, 0], 5, 2)")
    ticks(machine, 1.0)
    assert words in reason(machine)


@pytest.mark.parametrize(("action", "state"), [("stop", 1), ("pause", 4), ("ignore", 2)])
def test_watchdogs(arm: SimulatedArm, action: str, state: int) -> None:
    machine = ControllerMachine(arm, pose=START, safety=OPEN)
    machine.run_script(
        f"""def f():
          rtde_set_watchdog("input_int_register_24", 20, "{action}")
          speedj([1.0, 0, 0, 0, 0, 0], 10, 20)
        end"""
    )
    for _ in range(50):
        machine.set_input("input_int_register_24", 1)
        machine.tick()
    assert machine.output("runtime_state") == 2, "fed, it runs"
    ticks(machine, 0.05 + 3 * machine.cycle)
    assert machine.output("runtime_state") == state
    ticks(machine, STOP_WITHIN)
    standing = abs(machine.output("actual_qd")[0]) < STANDING
    assert standing == (action != "ignore")


def test_a_watchdog_watches_an_input_that_there_is(arm: SimulatedArm) -> None:
    """Any name was kept: a loop of them filled the memory."""
    machine = ControllerMachine(arm, pose=START)
    machine.run_script('def f():\n rtde_set_watchdog("input_int_register_48", 10)\n sleep(9)\nend')
    machine.tick()
    assert any("a watchdog needs an RTDE input" in text for text in said(machine))
    assert not machine.core.playing


def test_a_paused_program_is_fed_again_by_play(arm: SimulatedArm) -> None:
    machine = ControllerMachine(arm, pose=START)
    machine.run_script(
        'def f():\n rtde_set_watchdog("input_int_register_24", 20, "pause")\n sleep(9)\nend'
    )
    ticks(machine, 0.2)
    assert machine.core.runtime.name == "PAUSED"
    assert machine.play()
    machine.set_input("input_int_register_24", 1)
    machine.tick()
    assert machine.core.runtime.name == "PLAYING"


def test_an_arm_that_runs_away_is_switched_off(
    arm: SimulatedArm, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine = ControllerMachine(arm, pose=START)
    machine.run_script("sleep(10)")
    machine.tick()

    def run_away(setpoint: object) -> None:
        raise JobError("the simulated arm ran away")

    with monkeypatch.context() as patched:
        patched.setattr(machine.core.arm.plant, "tick", run_away)
        machine.tick()
    assert (machine.output("robot_mode"), machine.output("safety_mode")) == (3, 9)
    assert machine.output("safety_status_bits") == 1 << 9 | 1 << 10
    assert not machine.program_running
    assert not machine.power_on()
    assert not machine.unlock_protective_stop()
    assert machine.core.safety.restart()
    assert machine.brake_release()
    ticks(machine, 2.0)
    assert machine.output("robot_mode") == 7


def test_power_goes_step_by_step(arm: SimulatedArm) -> None:
    machine = ControllerMachine(arm, pose=START)
    machine.run_script("sleep(100)")
    ticks(machine, 0.1)
    assert machine.power_off()
    machine.tick()
    assert (machine.output("robot_mode"), machine.output("runtime_state")) == (3, 1)
    assert machine.output("robot_status_bits") == 0
    assert np.abs(machine.output("actual_current")).max() < 0.2, "no torque, only noise"
    machine.run_script("sleep(1)")
    assert not machine.program_running
    assert machine.brake_release()
    modes = []
    for _ in range(400):
        machine.tick()
        mode = machine.output("robot_mode")
        if mode not in modes:
            modes.append(mode)
    assert modes == [4, 5, 7]
    assert machine.output("actual_q") == pytest.approx(START, abs=5e-3)
    machine.run_script(f"movej({(HOME + 0.1).tolist()})")
    ticks(machine, 3.0)
    assert machine.output("target_q") == pytest.approx((HOME + 0.1).tolist(), abs=1e-4)


def test_loaded_programs_and_popups(arm: SimulatedArm) -> None:
    machine = ControllerMachine(arm, pose=START)
    assert not machine.play(), "nothing is loaded"
    assert not machine.load("broken.urp", "def f():\n")
    assert machine.load("ask.urp", 'def ask():\n popup("go?", blocking=True)\nend')
    assert machine.play()
    ticks(machine, 0.5)
    assert (machine.program_name, machine.core.runtime.name) == ("ask.urp", "PLAYING")
    assert any("go?" in text for text in said(machine))
    machine.core.blocking_popup = False
    ticks(machine, 0.1)
    assert machine.core.runtime.name == "STOPPED"


def test_a_script_replaces_another_and_a_secondary_one_does_not(arm: SimulatedArm) -> None:
    machine = ControllerMachine(arm, pose=START)
    machine.run_script("def first():\n sleep(100)\nend")
    machine.tick()
    machine.run_script("sec beside():\n set_digital_out(3, True)\nend")
    machine.tick()
    assert machine.program_name == "first"
    assert machine.output("actual_digital_output_bits") == 1 << 3
    machine.run_script("def second():\n sleep(100)\nend")
    machine.tick()
    assert machine.program_name == "second"
    machine.run_script("def third():\n nonsense(\nend")
    machine.tick()
    assert machine.program_name == "second", "what does not compile replaces nothing"
    assert any("compile error" in text for text in said(machine))


def test_limits_are_checked() -> None:
    with pytest.raises(InputError):
        WatchedLimits(tool_speed=-1.0)
    with pytest.raises(InputError):
        WatchedLimits(power=math.nan)
