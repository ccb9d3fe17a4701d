"""Programs as people and their tools send them, with what real controllers make of them."""

import math

import pytest

from scripts import finish, said, ticks
from urtwin import ControllerMachine
from urtwin.server.clients import Pool, ScriptReader

ON_THE_SPLINE = 2e-3
"""Where the target stands after a spline of speeds [rad]."""


def test_a_program_that_is_called_after_its_definition_runs_once(
    machine: ControllerMachine,
) -> None:
    # In the manner of ur-py-ctl and many forum posts. The call is a program of its own, whose
    # name the controller does not know; what runs goes on.
    text = (
        b'def program():\n\tset_tcp(p[0,0,0,0,0,0])\n\ttextmsg("Starting")\n'
        b'\tsleep(0.2)\n\ttextmsg("Done")\nend\nprogram()\n\n\n'
    )
    programs = ScriptReader(Pool()).feed(text)
    assert len(programs) == 2
    for program in programs:
        machine.run_script(program)
    assert machine.program_running
    finish(machine)
    words = said(machine)
    assert [text for text in words if text in ("Starting", "Done")] == ["Starting", "Done"]
    assert any("unknown function; got program" in text for text in words)


SPLINE = """def spline():
  global qd = [0, 0, 0, 0, 0, 0]
  def largest(list):
    local length = get_list_length(list)
    local i = 1
    local max = norm(list[0])
    while i < length:
      if norm(list[i]) > max:
        max = norm(list[i])
      end
      i = i + 1
    end
    return max
  end
  local time = 1.0
  local start = get_target_joint_positions()
  local stop = start + [0.1, 0, 0, 0, 0, 0]
  local c2 = (-3 * start + stop * 3) / pow(time, 2)
  local c3 = (2 * start - 2 * stop) / pow(time, 3)
  local t = 0.0
  while t < time:
    t = t + get_steptime()
    before = qd
    qd = 2.0 * t * c2 + 3.0 * pow(t, 2) * c3
    speedj(qd, largest((qd - before) / get_steptime()), get_steptime())
  end
  stopj(4.0)
end
"""


def test_a_cubic_spline_of_speeds_ends_where_it_should(machine: ControllerMachine) -> None:
    # How UR's driver forwards the points of a trajectory.
    start = machine.output("target_q")
    machine.run_script(SPLINE)
    finish(machine)
    goal = [start[0] + 0.1, *start[1:]]
    assert machine.output("target_q") == pytest.approx(goal, abs=ON_THE_SPLINE)


def test_the_accelerometer_of_programs_is_that_of_clients(machine: ControllerMachine) -> None:
    machine.run_script(
        "def p():\n a = get_tool_accelerometer_reading()\n write_output_float_register(1, a[0])\n"
        " write_output_float_register(2, norm(a))\nend\n"
    )
    before = machine.output("actual_tool_accelerometer")
    ticks(machine, 0.1)
    assert machine.output("output_double_register_1") == pytest.approx(before[0], abs=1e-3)
    assert machine.output("output_double_register_2") == pytest.approx(
        math.hypot(*before), abs=1e-3
    )


@pytest.mark.parametrize(
    "call",
    [
        'modbus_add_signal(IP="127.0.0.1", slave_number=255, signal_address=5, signal_type=1, '
        'signal_name="out")',
        'modbus_get_signal_status("out", False)',
        'modbus_set_output_signal("out", True, False)',
        "high_holding_torque_disable()",
        "direct_torque([0, 0, 0, 0, 0, 0], friction_comp=False)",
        "get_target_tcp_pose_along_path()",
        "get_target_tcp_speed_along_path()",
        "set_tool_communication(True, 115200, 0, 1, 1.5, 3.5)",
    ],
)
def test_calls_of_other_peoples_programs_compile_and_run(
    machine: ControllerMachine, call: str
) -> None:
    machine.run_script(f'def p():\n {call}\n textmsg("after")\nend\n')
    ticks(machine, 0.1)
    assert "after" in said(machine)


def test_modbus_signals_of_several_registers_read_back_what_was_written(
    machine: ControllerMachine,
) -> None:
    machine.run_script(
        "def p():\n"
        ' modbus_add_signal("10.0.0.1", 255, 0, 0, "in", True, 4)\n'
        ' modbus_add_rw_signal("10.0.0.1", 255, 100, 2, 0, 2, "both", True)\n'
        ' modbus_set_output_register("both", [7, 8], False)\n'
        ' a = modbus_get_signal_status("in")\n b = modbus_get_signal_status("both", False)\n'
        " textmsg(a, b)\nend"
    )
    ticks(machine, 0.1)
    assert "[0, 0, 0, 0][7, 8]" in said(machine)


def test_a_program_asks_for_an_rtde_output(machine: ControllerMachine) -> None:
    machine.run_script(
        "def p():\n"
        ' q = get_rtde_value("target_q")\n'
        ' write_output_float_register(0, q[1] + get_rtde_value("speed_scaling"))\nend'
    )
    ticks(machine, 0.1)
    expected = machine.output("target_q")[1] + 1.0
    assert machine.output("output_double_register_0") == pytest.approx(expected)
    machine.run_script('def p():\n get_rtde_value("nothing")\nend')
    ticks(machine, 0.1)
    assert any("no RTDE output has this name" in line for line in said(machine))


@pytest.mark.parametrize("name", ["get_joint_positions", "get_target_joint_positions"])
def test_a_program_that_streams_speeds_reads_where_they_have_led(
    machine: ControllerMachine, name: str
) -> None:
    # UR's driver begins each piece of a streamed trajectory there: a delay makes it unstable.
    machine.run_script(
        f"def p():\n a = {name}()\n i = 0\n"
        " while i < 100:\n  speedj([0.3, 0, 0, 0, 0, 0], 40, get_steptime())\n  i = i + 1\n end\n"
        f" b = {name}()\n write_output_float_register(0, b[0] - a[0])\nend\n"
    )
    finish(machine)
    way = 0.3 * 100 * machine.cycle
    assert machine.output("output_double_register_0") == pytest.approx(way, abs=ON_THE_SPLINE * 2)
