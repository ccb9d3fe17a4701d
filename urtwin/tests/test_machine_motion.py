"""Motions of the machine against their own words and an independent kinematics."""

import math

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.core import Array
from dynid.robot import RobotModel
from dynid.simulation import SimulatedArm
from dynid.trajectory import random_excitation, ur_program
from scripts import HOME, finish, said, ticks
from urtwin import ControllerMachine
from urtwin.arm import trapezoid
from urtwin.kinematics import ToolKinematics, to_matrix, to_pose
from urtwin.safety import WatchedLimits

START = HOME.tolist()
RESTING = 1e-4
"""Speeds below which a target stands [rad/s]."""
UNBOUND = WatchedLimits(tool_speed=math.inf, momentum=math.inf, power=math.inf)
TOOL = [0.01, -0.02, 0.1, 0.3, -0.2, 0.1]


@pytest.fixture
def machine(arm: SimulatedArm) -> ControllerMachine:
    return ControllerMachine(arm, pose=START)


@pytest.mark.parametrize(
    "words",
    [
        "speedl([0.1, 0, 0, 0, 0, 0], -0.5, 0.5)",
        "servoc(p[0.3, 0.3, 0.3, 0, 0, 0], 1.2, -0.25)",
        "servoc(p[0.3, 0.3, 0.3, 0, 0, 0], -1.2, 0.25)",
    ],
)
def test_a_tool_is_not_moved_backwards(machine: ControllerMachine, words: str) -> None:
    """It went the other way, and with `speedl` faster and faster."""
    machine.run_script(f"def p():\n  {words}\nend\n")
    ticks(machine, 0.5)
    assert any("acceleration" in text and "must be positive" in text for text in said(machine))
    assert machine.output("target_qd") == [0.0] * 6


def recorded(machine: ControllerMachine, text: str, *names: str) -> dict[str, Array]:
    """Outputs of every cycle, from the start of a script to its end."""
    machine.run_script(text)
    rows: dict[str, list[object]] = {name: [] for name in names}
    while True:
        machine.tick()
        for name in names:
            rows[name].append(machine.output(name))
        if not machine.program_running:
            assert not any("error" in text for text in said(machine)), said(machine)
            return {name: np.array(values) for name, values in rows.items()}


def pinocchio_model(robot: RobotModel, parameters: Array) -> pin.Model:
    """The same arm in pinocchio, from the (n, 13) standard parameters."""
    model, parent = pin.Model(), 0
    for i in range(robot.joints):
        joint = pin.JointModelRevoluteUnaligned(*robot.axes[i])
        parent = model.addJoint(parent, joint, pin.SE3(robot.placements[i]), robot.joint_names[i])
        m, mx, my, mz, xx, yy, zz, yz, xz, xy = parameters[i, :10]
        body = pin.Inertia.FromDynamicParameters(np.array([m, mx, my, mz, xx, xy, yy, xz, yz, zz]))
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    model.gravity.linear = robot.gravity
    model.armature = parameters[:, 12]
    return model


def oracle(arm: SimulatedArm) -> tuple[pin.Model, pin.Data]:
    model = pinocchio_model(arm.robot, arm.truth.standard_parameters)
    return model, model.createData()


def test_movej_keeps_its_speed_and_acceleration(machine: ControllerMachine) -> None:
    goal = (HOME + np.array([0.5, -0.2, 0.1, 0, 0, 0.3])).tolist()
    rows = recorded(machine, f"movej({goal}, a=2.0, v=0.4)", "target_qd", "target_qdd", "target_q")
    assert np.abs(rows["target_qd"]).max() == pytest.approx(0.4, rel=1e-3)
    assert np.abs(rows["target_qdd"]).max() <= 2.0 * 1.001
    assert np.abs(rows["target_q"][-1] - goal).max() < 1e-4
    # All joints arrive together: their shares of the way agree at any time.
    shares = (rows["target_q"] - HOME)[:, [0, 1, 5]] / [0.5, -0.2, 0.3]
    assert np.ptp(shares, axis=1).max() < 1e-6


def test_movej_takes_the_time_it_is_told(machine: ControllerMachine) -> None:
    goal = (HOME + 0.2).tolist()
    machine.run_script(f"movej({goal}, t=2.0)")
    before = machine.core.cycles
    finish(machine)
    took = (machine.core.cycles - before) * machine.cycle
    assert 2.0 <= took < 2.3


@given(
    st.floats(0.0, 5.0), st.floats(0.01, 3.0), st.floats(0.01, 10.0), st.sampled_from([0.0, 1.5])
)
@settings(derandomize=True, max_examples=60)
def test_profiles_start_and_end_at_rest(length: float, v: float, a: float, time: float) -> None:
    profile = trapezoid(length, v, a, time)
    t = np.linspace(0.0, profile.duration, 2001)
    way = np.array([profile.share(moment) for moment in t]) * length
    assert way[-1] == pytest.approx(length)
    speed = np.diff(way) / np.diff(t) if length else np.zeros(1)
    assert speed.min() >= -1e-9
    if time == 0.0:
        assert speed.max() <= v * (1 + 1e-6)
    elif length:
        assert profile.duration == pytest.approx(time)


def test_movel_is_straight_and_as_fast_as_told(machine: ControllerMachine) -> None:
    first = machine.output("target_TCP_pose")
    goal = [first[0] + 0.1, first[1] - 0.05, first[2] - 0.1, *first[3:]]
    rows = recorded(machine, f"movel(p{goal}, a=1.0, v=0.1)", "target_TCP_pose", "target_TCP_speed")
    points = rows["target_TCP_pose"][:, :3] - first[:3]
    way = np.array(goal[:3]) - first[:3]
    beside = points - np.outer(points @ way / (way @ way), way)
    assert np.abs(beside).max() < 1e-4
    assert np.linalg.norm(rows["target_TCP_speed"][:, :3], axis=1).max() == pytest.approx(
        0.1, rel=1e-2
    )
    assert rows["target_TCP_pose"][-1] == pytest.approx(goal, abs=1e-4)


def test_movel_to_joints_ends_where_they_are(machine: ControllerMachine) -> None:
    goal = (HOME + 0.05).tolist()
    rows = recorded(machine, f"movel({goal})", "target_q")
    assert rows["target_q"][-1] == pytest.approx(goal, abs=1e-4)


def test_movej_takes_poses(machine: ControllerMachine) -> None:
    goal = machine.output("target_TCP_pose")
    goal[2] += 0.05
    rows = recorded(machine, f"movej(p{goal})", "target_TCP_pose")
    assert rows["target_TCP_pose"][-1] == pytest.approx(goal, abs=1e-4)


@pytest.mark.parametrize(
    "script", ["movej(p[3, 0, 0, 0, 0, 0])", "get_inverse_kin(p[1e308 * 10.0, 0, 0, 0, 0, 0])"]
)
def test_a_pose_out_of_reach_is_a_fault_in_words(machine: ControllerMachine, script: str) -> None:
    machine.run_script(script)
    finish(machine, 1.0)
    assert any("no inverse kinematics solution" in text for text in said(machine))
    assert machine.output("safety_mode") == 1


def test_our_own_program_repeats_its_period_exactly(machine: ControllerMachine) -> None:
    text = f"""def excite():
      k = 0
      while k < 1000:
        t = (k % 250) * 0.008
        s = sin(3.141592653589793 * t)
        q = [{", ".join(f"{value} + 0.1 * s" for value in START)}]
        write_output_integer_register(24, k)
        servoj(q, t=0.008, lookahead_time=0.03, gain=500)
        k = k + 1
      end
    end"""
    rows = recorded(machine, text, "output_int_register_24", "target_q")
    index, target = rows["output_int_register_24"][:1000], rows["target_q"][:1000]
    assert index.tolist() == list(range(1000)), "every index once"
    assert np.abs(target[500:750] - target[750:1000]).max() < 1e-12
    assert np.ptp(target[:, 0]) > 0.19


def test_the_program_of_a_fourier_series_runs_sample_by_sample(
    arm: SimulatedArm,
) -> None:
    motion = random_excitation(
        arm.robot.limits, seed=4, margin=0.8, acceleration=5.5 * np.pi, offset=HOME
    )
    program = ur_program(motion, repeats=2)
    machine = ControllerMachine(arm, pose=START, safety=UNBOUND)
    machine.run_script(program)
    index, setpoints, targets = [], [], []
    while machine.program_running or not index:
        machine.set_input("input_int_register_24", len(index))
        machine.tick()
        index.append(machine.output("output_int_register_24"))
        setpoints.append(machine.core.arm.setpoint)
        targets.append(machine.output("target_q"))
    assert machine.output("safety_mode") == 1, said(machine)
    assert machine.output("output_int_register_25") == 2
    first = index.index(0)
    n = round(motion.duration / machine.cycle)
    assert index[first : first + 2 * n] == list(range(2 * n)), "every sample once, in order"
    commanded = np.array(setpoints[first : first + n])
    expected = motion.evaluate(np.arange(n) * machine.cycle).q
    assert np.abs(commanded - expected).max() < 1e-9
    target = np.array(targets[first : first + 2 * n]).reshape(2, n, 6)
    settled = target[:, n // 2 :]
    assert np.abs(settled[0] - settled[1]).max() < 1e-12


def test_servoj_over_several_cycles_is_a_straight_line(machine: ControllerMachine) -> None:
    goal = (HOME + 0.05).tolist()
    machine.run_script(f"servoj({goal}, t=0.08)\nservoj({goal}, t=0.08)")
    before = machine.core.cycles
    setpoints = []
    while machine.program_running or machine.core.cycles == before:
        machine.tick()
        setpoints.append(machine.core.arm.setpoint)
    line = np.array(setpoints[:10])
    assert line == pytest.approx(HOME + 0.005 * np.arange(1, 11)[:, None], abs=1e-12)


def test_lookahead_delays_the_target(arm: SimulatedArm) -> None:
    delays = []
    for lookahead in (0.03, 0.1):
        machine = ControllerMachine(arm, pose=START)
        machine.run_script(
            f"""def ramp():
              k = 0
              while k < 200:
                servoj([{START[0]} + 0.002 * k, {", ".join(map(str, START[1:]))}],
                       t=0.008, lookahead_time={lookahead})
                k = k + 1
              end
            end"""
        )
        for _ in range(190):
            machine.tick()
        behind = machine.core.arm.setpoint[0] - machine.output("target_q")[0]
        delays.append(behind / 0.25)
    # The set point of this cycle is seen one cycle later.
    assert delays == pytest.approx([0.03, 0.1], abs=machine.cycle)


def test_speedj_ramps_and_the_arm_brakes_at_the_end_of_the_program(
    machine: ControllerMachine,
) -> None:
    rows = recorded(machine, "speedj([0.3, 0, 0, 0, 0, 0], 1.0, 0.5)", "target_qd")
    steepest = np.diff(rows["target_qd"][:, 0]).max() / machine.cycle
    assert steepest == pytest.approx(1.0, rel=1e-3)
    assert rows["target_qd"][-1, 0] == pytest.approx(0.3, abs=0.02)
    ticks(machine, 0.3)
    assert abs(machine.output("target_qd")[0]) < RESTING


def test_servoc_arrives_and_stays(machine: ControllerMachine) -> None:
    goal = machine.output("target_TCP_pose")
    goal[1] += 0.05
    text = f"def f():\n k = 0\n while k < 250:\n servoc(p{goal}, 1.0, 0.1)\n k = k + 1\n end\nend"
    rows = recorded(machine, text, "target_TCP_pose", "target_TCP_speed")
    assert rows["target_TCP_pose"][-1] == pytest.approx(goal, abs=1e-3)
    assert np.linalg.norm(rows["target_TCP_speed"][:, :3], axis=1).max() < 0.105


def test_pause_and_play_go_on_to_the_goal(machine: ControllerMachine) -> None:
    goal = (HOME + 0.5).tolist()
    machine.run_script(f"movej({goal}, a=2, v=0.5)")
    ticks(machine, 0.5)
    assert machine.pause()
    ticks(machine, 0.5)
    assert machine.output("runtime_state") == 4
    assert np.abs(machine.output("target_qd")).max() < RESTING
    assert machine.play()
    finish(machine)
    assert machine.output("target_q") == pytest.approx(goal, abs=1e-4)
    assert machine.output("safety_mode") == 1


def test_the_speed_slider_slows_moves(arm: SimulatedArm) -> None:
    took = []
    for fraction in (1.0, 0.5):
        machine = ControllerMachine(arm, pose=START)
        machine.set_input("speed_slider_mask", 1)
        machine.set_input("speed_slider_fraction", fraction)
        ticks(machine, 1.0)
        assert machine.output("speed_scaling") == pytest.approx(fraction)
        assert machine.output("target_speed_fraction") == fraction
        machine.run_script(f"movej({(HOME + 0.5).tolist()}, a=2, v=0.5)")
        before = machine.core.cycles
        finish(machine)
        took.append(machine.core.cycles - before)
    assert took[1] / took[0] == pytest.approx(2.0, abs=0.15)


def test_two_threads_must_not_move_the_arm_in_one_cycle(machine: ControllerMachine) -> None:
    machine.run_script(
        """def f():
          thread t():
            while True:
              speedj([0.1, 0, 0, 0, 0, 0], 1.0, 0.008)
            end
          end
          run t()
          movej([0, 0, 0, 0, 0, 0])
        end"""
    )
    finish(machine, 1.0)
    assert any("another thread moves the robot" in text for text in said(machine))


@settings(derandomize=True, max_examples=25)
@given(st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6))
def test_forward_kinematics_and_jacobian_against_pinocchio(q: list[float]) -> None:
    arm = ARMS[0]
    model, data = oracle(arm)
    tcp = to_matrix(TOOL)
    tool = pin.SE3(arm.robot.flange @ tcp)
    joint = model.njoints - 1
    frame = model.addFrame(pin.Frame("tool", joint, 0, tool, pin.FrameType.OP_FRAME))
    data = model.createData()
    pin.forwardKinematics(model, data, np.array(q))
    pin.updateFramePlacements(model, data)
    found, jacobian = ToolKinematics(arm.robot).jacobian(q, tcp)
    assert np.abs(found - data.oMf[frame].homogeneous).max() < 1e-12
    expected = pin.computeFrameJacobian(
        model, data, np.array(q), frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    )
    assert np.abs(jacobian - expected).max() < 1e-12


@settings(derandomize=True, max_examples=25)
@given(st.lists(st.floats(-0.15, 0.15), min_size=6, max_size=6))
def test_inverse_kinematics_finds_the_pose_nearby(change: list[float]) -> None:
    arm = ARMS[0]
    kinematics, tcp = ToolKinematics(arm.robot), to_matrix(TOOL)
    goal = HOME + change
    found = kinematics.inverse(kinematics.forward(goal.tolist(), tcp), START, tcp)
    assert np.abs(found - goal).max() < 1e-7


def test_the_model_of_the_controller_against_pinocchio(arm: SimulatedArm) -> None:
    machine = ControllerMachine(arm, pose=START)
    tracker = machine.core.arm.plant.tracker
    controller = arm.controller
    model = pinocchio_model(arm.robot, arm.truth.standard_parameters)
    for k, (mass, com) in enumerate(zip(controller.masses, controller.com, strict=True)):
        model.inertias[k + 1] = pin.Inertia(float(mass), com, 1e-9 * np.eye(3))
    model.armature = np.zeros(6)
    data = model.createData()
    q, dq = HOME + 0.3, np.array([0.5, -0.4, 0.3, 0.2, -0.1, 0.6])
    mass_matrix = pin.crba(model, data, q)
    mass_matrix = np.triu(mass_matrix) + np.triu(mass_matrix, 1).T
    assert np.abs(tracker.mass_matrix(q) - mass_matrix).max() < 1e-8
    coriolis = pin.nonLinearEffects(model, data, q, dq) - pin.computeGeneralizedGravity(
        model, data, q
    )
    assert np.abs(tracker.coriolis(q, dq) - coriolis).max() < 1e-8
    moment = pin.computeGeneralizedGravity(model, data, np.array(machine.output("target_q")))
    assert machine.output("target_moment") == pytest.approx(moment.tolist(), abs=1e-6)
    machine.run_script("set_payload(2.0, [0.01, 0.02, 0.05])")
    ticks(machine, 0.1)
    load = pin.Inertia(2.0, (arm.robot.flange @ [0.01, 0.02, 0.05, 1.0])[:3], np.zeros((3, 3)))
    model.inertias[6] = model.inertias[6] + load
    data = model.createData()
    moment = pin.computeGeneralizedGravity(model, data, np.array(machine.output("target_q")))
    assert machine.output("target_moment") == pytest.approx(moment.tolist(), abs=1e-6)


def test_poses_survive_the_way_there_and_back() -> None:
    for pose in (TOOL, [0, 0, 0, np.pi, 0, 0], [0, 0, 0, 0, -3.1415, 0.001], [0.0] * 6):
        assert np.abs(to_matrix(to_pose(to_matrix(pose))) - to_matrix(pose)).max() < 1e-9


ARMS: list[SimulatedArm] = []


@pytest.fixture(autouse=True)
def _arm_for_properties(arm: SimulatedArm) -> None:
    # hypothesis refuses function-scoped fixtures; this one is the session's own.
    ARMS[:] = [arm]


def test_speedj_without_acceleration_keeps_the_speeds(machine: ControllerMachine) -> None:
    # The splines of UR's drivers work out the acceleration that a step needs: often none.
    text = (
        "def spline():\n speedj([0.2, 0, 0, 0, 0, 0], 5.0, 0.2)\n"
        " speedj([0.2, 0, 0, 0, 0, 0], 0.0, 0.4)\n stopj(4.0)\nend\n"
    )
    rows = recorded(machine, text, "target_qd")
    steady = np.abs(rows["target_qd"][:, 0] - 0.2) < 1e-6
    assert steady.sum() * machine.cycle > 0.35
