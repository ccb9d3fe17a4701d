"""The variables that the machine shows and takes."""

import numpy as np
import pinocchio as pin
import pytest

from dynid.core import InputError
from dynid.protocol import INPUTS, OUTPUTS, DataType
from dynid.robot import load_robot
from dynid.simulation import SimulatedArm, simulated_arm
from scripts import HOME, finish, ticks
from urtwin import ControllerMachine
from urtwin.core import MESSAGES_KEPT

START = HOME.tolist()
WHOLE = {
    DataType.UINT8,
    DataType.UINT32,
    DataType.UINT64,
    DataType.INT32,
    DataType.VECTOR6INT32,
    DataType.VECTOR6UINT32,
}


@pytest.fixture(scope="module")
def moved(arm: SimulatedArm) -> ControllerMachine:
    machine = ControllerMachine(arm, pose=START)
    machine.run_script(f"movej({(HOME + 0.2).tolist()})")
    ticks(machine, 0.5)
    return machine


@pytest.mark.parametrize("name", [name for name in OUTPUTS if "_register_" not in name])
def test_every_output_has_its_type(moved: ControllerMachine, name: str) -> None:
    field = OUTPUTS[name].type
    value = moved.output(name)
    values = value if field.count > 1 else [value]
    assert len(values) == field.count
    for item in values:
        if field in WHOLE:
            assert isinstance(item, int)
        elif field == DataType.DOUBLE:
            assert type(item) is float
            assert np.isfinite(item)
        elif field == DataType.BOOL:
            assert type(item) is bool


def test_registers_in_both_directions(arm: SimulatedArm) -> None:
    machine = ControllerMachine(arm, pose=START)
    machine.run_script(
        """def f():
          write_output_integer_register(47, read_input_integer_register(24) * 2)
          write_output_float_register(47, read_input_float_register(24) * 2)
          write_output_boolean_register(70, not read_input_boolean_register(70))
          write_output_boolean_register(33, read_input_boolean_register(1))
        end"""
    )
    machine.set_input("input_int_register_24", -3)
    machine.set_input("input_double_register_24", 0.25)
    machine.set_input("input_bit_register_70", True)
    machine.set_input("input_bit_registers0_to_31", 2)
    finish(machine)
    assert machine.output("output_int_register_47") == -6
    assert machine.output("output_double_register_47") == 0.5
    assert machine.output("output_bit_register_70") is False
    assert machine.output("output_bit_registers32_to_63") == 2
    assert machine.output("input_int_register_24") == -3


def test_every_input_of_the_protocol_is_taken(arm: SimulatedArm) -> None:
    machine = ControllerMachine(arm, pose=START)
    for name, field in INPUTS.items():
        machine.set_input(name, [0.0] * field.type.count if field.type.count > 1 else 0)
    machine.tick()
    with pytest.raises(InputError, match="unknown RTDE input"):
        machine.set_input("output_int_register_0", 1)
    with pytest.raises(InputError, match="unknown RTDE output"):
        machine.output("nonsense")


def test_masked_outputs(arm: SimulatedArm) -> None:
    machine = ControllerMachine(arm, pose=START)
    machine.set_input("standard_digital_output_mask", 0b101)
    machine.set_input("standard_digital_output", 0b111)
    machine.set_input("configurable_digital_output_mask", 0b1)
    machine.set_input("configurable_digital_output", 0b1)
    machine.set_input("tool_digital_output_mask", 0b10)
    machine.set_input("tool_digital_output", 0b10)
    machine.set_input("standard_analog_output_mask", 0b10)
    machine.set_input("standard_analog_output_1", 0.4)
    machine.tick()
    assert machine.output("actual_digital_output_bits") == 0b101 | 1 << 8 | 1 << 17
    assert machine.output("standard_analog_output1") == 0.4
    machine.set_input("standard_digital_output_mask", 0b001)
    machine.set_input("standard_digital_output", 0b000)
    machine.tick()
    assert machine.output("actual_digital_output_bits") & 0xFF == 0b100


@pytest.mark.parametrize("name", ["speed_slider", "standard_analog_output"])
def test_numbers_that_are_none_change_nothing(arm: SimulatedArm, name: str) -> None:
    machine = ControllerMachine(arm, pose=START)
    machine.set_input(f"{name}_mask", 1)
    machine.set_input(f"{name}_fraction" if name == "speed_slider" else f"{name}_0", np.nan)
    machine.tick()
    assert machine.output("target_speed_fraction") == 1.0
    assert machine.output("standard_analog_output0") == 0.0


@pytest.mark.parametrize("rate_hz", [125.0, 500.0])
def test_timestamps_are_whole_cycles(arm: SimulatedArm, rate_hz: float) -> None:
    machine = ControllerMachine(arm, pose=START, rate_hz=rate_hz)
    stamps = []
    for _ in range(200):
        machine.tick()
        stamps.append(machine.output("timestamp"))
    assert stamps[0] > 40.0, "clients wait for a controller that has just started"
    assert stamps == [(60 * rate_hz + k) / rate_hz for k in range(1, 201)]


def run(arm: SimulatedArm, seed: int, asked: tuple[str, ...]) -> list[object]:
    machine = ControllerMachine(arm, pose=START, seed=seed)
    machine.run_script(f"movej({(HOME + 0.3).tolist()})")
    rows: list[object] = []
    for _ in range(100):
        machine.tick()
        values = [machine.output(name) for name in asked]
        rows.append(values[0])
    return rows


def test_the_seed_fixes_the_noise_whoever_listens(arm: SimulatedArm) -> None:
    first = run(arm, 1, ("actual_current",))
    assert first == run(arm, 1, ("actual_current", "actual_qd", "joint_temperatures"))
    assert first != run(arm, 2, ("actual_current",))


def test_measured_values_have_the_steps_and_noise_of_the_sensors(arm: SimulatedArm) -> None:
    machine = ControllerMachine(arm, pose=START)
    rows = []
    for _ in range(500):
        machine.tick()
        rows.append(machine.output("actual_current"))
    current, sensors = np.array(rows), arm.truth.sensors
    steps = current / sensors.current_step
    assert np.abs(steps - np.round(steps)).max() < 1e-6
    assert current.std(axis=0) == pytest.approx(sensors.current_noise, rel=0.15)
    torque = np.array(machine.core.arm.state.torque)
    assert current.mean(axis=0) * arm.truth.gain == pytest.approx(torque, abs=0.1)


def test_target_current_is_the_model_and_temperatures_are_the_plants(arm: SimulatedArm) -> None:
    machine = ControllerMachine(arm, pose=START, thermal=31.0)
    machine.run_script("speedj([0.5, 0, 0, 0, 0, 0], 2, 5)")
    ticks(machine, 1.0)
    friction = arm.controller.friction(np.array(machine.output("target_qd")))
    expected = (np.array(machine.output("target_moment")) + friction) / arm.truth.gain
    assert machine.output("target_current") == pytest.approx(expected.tolist(), rel=1e-9, abs=1e-9)
    assert machine.output("joint_temperatures") == pytest.approx([31.0] * 6, abs=0.5)


def test_tool_outputs_agree_with_each_other(moved: ControllerMachine) -> None:
    ticks(moved, 0.1)
    before = np.array(moved.output("target_TCP_pose")[:3])
    speed = np.array(moved.output("target_TCP_speed")[:3])
    moved.tick()
    after = np.array(moved.output("target_TCP_pose")[:3])
    later = np.array(moved.output("target_TCP_speed")[:3])
    assert (after - before) / moved.cycle == pytest.approx((speed + later) / 2, abs=2e-4)
    assert np.linalg.norm(moved.output("target_TCP_speed")[:3]) == pytest.approx(
        moved.core.arm.plant.tracker.tool_speed(moved.core.arm.tool_point(np.eye(4))), abs=0.02
    )


def test_messages_are_kept_to_a_bound(arm: SimulatedArm) -> None:
    machine = ControllerMachine(arm, pose=START)
    machine.run_script('def f():\n while True:\n textmsg("x")\n end\nend')
    for _ in range(20):
        machine.tick()
    machine.run_script('def f():\n while True:\n textmsg("y")\n sync()\n end\nend')
    ticks(machine, 8.0)
    assert len(machine.messages) == MESSAGES_KEPT


def test_signals_have_the_names_of_old_scripts_too(machine):
    # python-urx, urx/urrobot.py, sends `digital_out[2]=True`.
    machine.run_script(
        "def f():\n digital_out[2] = True\n analog_out[1] = 0.25\n"
        " write_output_boolean_register(5, digital_out[2] and not digital_in[3])\nend\n"
    )
    machine.tick()
    machine.tick()
    assert machine.output("actual_digital_output_bits") == 4
    assert machine.output("standard_analog_output1") == 0.25
    assert machine.output("output_bit_registers0_to_31") == 1 << 5


def test_the_tool_accelerates_as_its_speed_changes():
    """Checked against differences of the speed, while all joints swing."""
    machine = ControllerMachine(
        simulated_arm(load_robot("ur5e")), rate_hz=500.0, version=(5, 25, 0, 0)
    )
    machine.run_script(
        "def f():\n k = 0\n while True:\n x = 0.3 * (1 - cos(k * 0.005))\n"
        " servoj([x, x - 1.57, x, x - 1.57, x, x], t=0.002, lookahead_time=0.03, gain=500)\n"
        " k = k + 1\n end\nend\n"
    )
    for _ in range(400):
        machine.tick()
    speeds, told, poses, felt = [], [], [], []
    for _ in range(50):
        machine.tick()
        speeds.append(machine.output("target_TCP_speed"))
        told.append(machine.output("target_TCP_acceleration"))
        poses.append(machine.output("actual_TCP_pose"))
        felt.append(machine.output("actual_tool_accelerometer"))
    measured = np.gradient(np.array(speeds), machine.cycle, axis=0)
    scale = np.abs(measured).max()
    assert scale > 0.1
    np.testing.assert_allclose(told[2:-2], measured[2:-2], rtol=0, atol=0.05 * scale)
    # What turns the tool's way into a curve was not felt: 1.3 m/s^2 of it.
    bent = np.diff(np.array(poses)[:, :3], 2, axis=0) / machine.cycle**2 + [0.0, 0.0, 9.80665]
    turned = [pin.exp3(np.array(pose[3:])).T @ a for pose, a in zip(poses[1:-1], bent, strict=True)]
    np.testing.assert_allclose(felt[1:-1], turned, rtol=0, atol=0.02)


def test_rotors_belong_to_the_mass_matrix_where_they_are_asked_for(arm, machine):
    machine.run_script(
        "def f():\n a = get_mass_matrix()\n b = get_mass_matrix(include_rotors_inertia=True)\n"
        " write_output_float_register(0, b[5, 5] - a[5, 5])\nend\n"
    )
    finish(machine)
    rotor = arm.truth.motor_inertia[5]
    assert machine.output("output_double_register_0") == pytest.approx(rotor, rel=1e-9)


def test_time_is_scaled_by_nothing_while_a_program_runs(machine):
    assert machine.output("time_scale_source") == 0
    machine.run_script("def f():\n while True:\n sync()\n end\nend\n")
    machine.tick()
    assert machine.output("time_scale_source") == 1


def test_the_preamble_of_a_pendant_s_program_compiles_and_runs(machine):
    # What PolyScope and python-urx (urx/urscript.py) put before the program proper.
    machine.run_script(
        "def prog():\n set_analog_inputrange(0, 0)\n set_analog_outputdomain(0, 0)\n"
        " set_tool_voltage(0)\n set_runstate_outputs([])\n set_input_actions_to_default()\n"
        ' set_standard_digital_input_action(0, "default")\n set_tool_communication(False)\n'
        " set_safety_mode_transition_hardness(1)\n set_gravity([0.0, 0.0, 9.82])\n"
        " set_flag(3, True)\n if get_flag(3) and not get_flag(4):\n"
        " write_output_integer_register(1, 9)\n end\nend\n"
    )
    finish(machine)
    assert machine.output("output_int_register_1") == 9
