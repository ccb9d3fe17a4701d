"""Faults stay where they are: no script, thread, command or connection ends the controller."""

import pytest

from fuzzing import run
from scripts import execution, finish, said, ticks
from urtwin import ControllerMachine
from urtwin.dashboard import program_folder
from urtwin.urscript import builtins, compile_script

OPERATIONS = 60_000
"""More than UR's driver program needs in any cycle, five times what 500 Hz allowed once."""


def test_a_name_that_no_file_can_have_is_not_found(tmp_path):
    assert program_folder(tmp_path)("\0.urp") is None


def test_a_thread_killed_before_a_critical_section_leaves_the_line():
    # The first thread stands before the section when the second, which it kept waiting, kills it.
    running, _ = execution(
        "def f():\n"
        " thread one():\n"
        "  enter_critical\n  sync()\n  exit_critical\n  enter_critical\n  exit_critical\n end\n"
        " thread two():\n  kill first\n end\n"
        " global first = 0\n"
        " enter_critical\n first = run one()\n second = run two()\n sync()\n exit_critical\n"
        " sync()\n sync()\n sync()\n sync()\nend"
    )
    for _ in range(10):
        running.step()
    assert running.finished
    assert running.fault is None


def test_a_fault_of_a_built_in_ends_the_script_alone():
    def broken():
        return {}["nothing"]

    program = compile_script("def f():\n broken()\nend", builtins({"broken": broken}))
    running = program.execution(None)
    running.step()
    assert running.finished
    assert "KeyError" in running.fault


def test_a_fault_in_a_cycle_stops_the_program_and_nothing_else(machine: ControllerMachine):
    machine.run_script("def f():\n while True:\n  sync()\n end\nend")
    ticks(machine, 0.1)

    class Broken:
        def next(self, arm, tcp):
            raise ZeroDivisionError

    machine.core.force = Broken()
    ticks(machine, 0.1)
    assert not machine.program_running
    assert any("ZeroDivisionError" in line for line in said(machine))
    machine.run_script("def g():\n textmsg(1)\nend")
    finish(machine)


def test_time_not_operations_is_what_a_cycle_may_take(e_machine: ControllerMachine):
    e_machine.run_script(
        "def f():\n"
        f" i = 0\n while i < {OPERATIONS // 4}:\n  i = i + 1\n end\n"
        " write_output_integer_register(0, i)\nend"
    )
    finish(e_machine, 1.0)
    assert e_machine.output("output_int_register_0") == OPERATIONS // 4, said(e_machine)


@pytest.mark.realtime
@pytest.mark.parametrize("rate_hz", [125.0, 500.0])
def test_hostile_clients_beside_a_good_one(rate_hz):
    received, missed, answers, log = run(400, rate_hz, seed=1)
    assert "internal fault" not in log
    assert answers[0] == "File not found: \0.urp"
    assert received > 0
    assert missed == 0
