"""Interpreter mode, spoken to as the script manual's chapter 13 and UR's own example say."""

import re
import socket
import time

import pytest

from rtde_client import TIMEOUT_S, RtdeClient, ask_dashboard, send_script
from scripts import said, ticks
from urtwin import ControllerMachine

PORT = 30020
REPLY = re.compile(r"(\w+):\W+(\d+)?")
"""How UR's own example reads an answer."""
ENTER = "def prog():\n outside = 5\n def own(k):\n  return k + 1\n end\n interpreter_mode()\nend\n"


class Sender:
    """A client without a socket."""

    def __init__(self, machine: ControllerMachine, program: str = ENTER) -> None:
        self.machine, self.replies = machine, []
        machine.run_script(program)
        ticks(machine, 0.1)

    def __call__(self, line: str, seconds: float = 0.1) -> str:
        before = len(self.replies)
        self.machine.core.interpreter.receive(line, self.replies.append)
        ticks(self.machine, seconds)
        return self.replies[-1] if len(self.replies) > before else ""


@pytest.fixture
def send(machine: ControllerMachine) -> Sender:
    return Sender(machine)


def test_statements_run_in_the_program_and_are_acknowledged_by_number(send: Sender) -> None:
    assert send("write_output_integer_register(3, outside)") == (
        "ack: 1: write_output_integer_register(3, outside)"
    )
    assert send("outside = own(outside)  write_output_integer_register(4, outside)") == (
        "ack: 2: outside = own(outside)  write_output_integer_register(4, outside)"
    )
    assert send.machine.output("output_int_register_3") == 5
    assert send.machine.output("output_int_register_4") == 6
    assert send("statelastexecuted") == "state: 2: statelastexecuted"
    assert send("statelastinterpreted") == "state: 2: statelastinterpreted"
    assert send("stateunexecuted") == "state: 0: stateunexecuted"


def test_statements_are_compiled_as_far_ahead_as_there_is_memory(
    send: Sender, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Compiled ones of 8000 characters take 2 MB each, and 8500 could wait."""
    monkeypatch.setattr("urtwin.interpreter.MOST_COMPILED", 100)
    assert send("sleep(1.0)").startswith("ack: 1: ")
    for k in range(20):
        send(f"write_output_integer_register(3, {k})", 0.0)
    ticks(send.machine, 0.5)
    assert 2 <= len(send.replies) <= 5
    ticks(send.machine, 2.0)
    assert len(send.replies) == 21
    assert send.machine.output("output_int_register_3") == 19


def test_functions_and_variables_stay_until_they_are_cleared(send: Sender) -> None:
    assert send("def put(v): write_output_integer_register(5, v) end").startswith("ack: 1: ")
    assert send("mine = 7").startswith("ack: 2: ")
    assert send("put(mine)").startswith("ack: 3: ")
    assert send.machine.output("output_int_register_5") == 7
    assert send("clear_interpreter()").startswith("ack: 4: ")
    assert send("statelastcleared") == "state: 4: statelastcleared"
    assert send("put(1)").startswith("discard: ")
    assert send("write_output_integer_register(5, mine)").startswith("discard: ")
    # The program's own are still there, and so is what came of them.
    assert send("write_output_integer_register(5, own(outside))").startswith("ack: 5: ")
    assert send.machine.output("output_int_register_5") == 6


def test_threads_of_the_interpreter_end_with_it(send: Sender) -> None:
    send(
        "thread beat(): n = 0 while True: n = n + 1 write_output_integer_register(6, n) "
        "sync() end end"
    )
    send("h = run beat()", seconds=0.5)
    assert send.machine.output("output_int_register_6") > 20
    send("clear_interpreter()")
    before = send.machine.output("output_int_register_6")
    ticks(send.machine, 0.5)
    assert send.machine.output("output_int_register_6") == before
    assert send.machine.program_running


@pytest.mark.parametrize(
    "line",
    ["nonsense(1)", "movej(", "x = ", "global fresh = 1", "break", "def f(): sync()"],
)
def test_what_does_not_compile_is_discarded_with_the_reason(send: Sender, line: str) -> None:
    reply = send(line)
    assert reply.startswith("discard: Compile error ")
    assert reply.endswith(f": {line}")
    assert send("sync()") == "ack: 1: sync()"
    assert send.machine.program_running


def test_a_program_globals_can_be_set_but_not_made(send: Sender) -> None:
    assert send("global outside = 9").startswith("ack: 1: ")
    send("write_output_integer_register(3, outside)")
    assert send.machine.output("output_int_register_3") == 9


def test_without_a_program_statements_are_discarded(machine: ControllerMachine) -> None:
    replies: list[str] = []
    machine.core.interpreter.receive("sync()", replies.append)
    assert replies == ["discard: Program is not running: sync()"]


def test_what_waits_for_the_mode_is_discarded_or_kept_as_asked(machine: ControllerMachine) -> None:
    send = Sender(machine, "def p():\n sleep(1.0)\n interpreter_mode()\nend\n")
    assert send("sync()") == ""
    ticks(machine, 1.0)
    assert send.replies == ["discard: Cleaned up before interpretation: sync()"]
    send = Sender(machine, "def p():\n sleep(1)\n interpreter_mode(clearQueueOnEnter=False)\nend")
    assert send("sync()") == ""
    ticks(machine, 1.0)
    assert send.replies == ["ack: 1: sync()"]


def test_the_end_lets_the_program_go_on(machine: ControllerMachine) -> None:
    text = (
        "def p():\n k = 0\n interpreter_mode(clearOnEnd=False)\n"
        " write_output_integer_register(7, k)\n interpreter_mode()\n"
        " write_output_integer_register(8, 1)\nend\n"
    )
    send = Sender(machine, text)
    send("def up(): k = k + 1 end")
    send("up() up()")
    assert send("end_interpreter()").startswith("ack: 3: ")
    assert machine.output("output_int_register_7") == 2
    # What was not cleared is known to the next interpreter mode of the program.
    assert send("up()").startswith("ack: 4: ")
    send("end_interpreter()")
    assert machine.output("output_int_register_8") == 1
    assert not machine.program_running
    assert send("sync()").startswith("discard: Program is not running")


def test_moves_are_acknowledged_at_once_skipped_and_aborted(send: Sender) -> None:
    machine = send.machine
    start = machine.output("target_q")
    goal = [start[0] + 1.5, *start[1:]]
    assert send(f"movej({goal}, a=2, v=0.5)").startswith("ack: 1: ")
    assert send(f"movej({start}, a=2, v=0.5)", seconds=1.0).startswith("ack: 2: ")
    assert send("statelastexecuted").startswith("state: 1: ")
    assert send("stateunexecuted").startswith("state: 1: ")
    assert send("skipbuffer").startswith("ack: ")
    assert send("stateunexecuted").startswith("state: 0: ")
    send("abort", seconds=1.0)
    stopped = machine.output("target_q")[0]
    assert start[0] + 0.3 < stopped < start[0] + 1.0
    assert max(abs(value) for value in machine.output("target_qd")) < 1e-6
    # An abort without a move is not kept for the next one.
    send("abort")
    assert send(f"movej({goal}, a=2, v=0.5)", seconds=4.0).startswith("ack: 3: ")
    assert machine.output("target_q")[0] == pytest.approx(goal[0], abs=1e-4)


def test_a_fault_of_a_statement_ends_the_program(send: Sender) -> None:
    send("x = 1 / 0")
    assert not send.machine.program_running
    assert any("division by zero" in words for words in said(send.machine))


def test_the_mode_belongs_to_the_main_thread_and_is_not_nested(machine: ControllerMachine) -> None:
    send = Sender(machine)
    send("interpreter_mode()")
    assert not machine.program_running
    machine.run_script("def p(): thread t(): interpreter_mode() end run t() sleep(1) end")
    ticks(machine, 0.5)
    assert not machine.program_running


def test_many_statements_at_once_neither_starve_the_cycle_nor_are_lost(send: Sender) -> None:
    for k in range(2_000):
        send.machine.core.interpreter.receive(
            f"write_output_integer_register(9, {k})", send.replies.append
        )
    ticks(send.machine, 1.0)
    assert send.machine.program_running, said(send.machine)
    ticks(send.machine, 9.0)
    assert send.machine.output("output_int_register_9") == 1_999
    assert [REPLY.match(line)[2] for line in send.replies] == [str(k + 1) for k in range(2_000)]


def test_too_many_and_too_long_statements_are_refused(machine: ControllerMachine) -> None:
    send = Sender(machine, "def p():\n sleep(100)\nend\n")
    for _ in range(8_501):
        machine.core.interpreter.receive("sync()", send.replies.append)
    assert send.replies == ["discard: Too many interpreted messages: sync()"]
    assert send("sync()" * 2_000).startswith("discard: Statement is longer")


def test_a_stopped_program_answers_what_still_waits(machine: ControllerMachine) -> None:
    send = Sender(machine, "def p():\n sleep(100)\nend\n")
    assert send("sync()") == ""
    machine.stop()
    assert send.replies == ["discard: Program is not running: sync()"]


def test_over_the_wire(fast) -> None:
    with socket.create_connection((fast.host, PORT), timeout=TIMEOUT_S) as sock:
        lines = sock.makefile()
        sock.sendall(b"sync()\n")
        assert lines.readline() == "discard: Program is not running: sync()\n"
        with RtdeClient(fast.host) as client:
            client.read_outputs(["runtime_state", "output_int_register_10"])
            client.start()
            send_script(fast.host, "interpreter_mode()\n")
            client.until(lambda row: row["runtime_state"] == 2)
            # In two pieces; three lines at once.
            sock.sendall(b"write_output_integer_re")
            sock.sendall(b"gister(10, 3)\r\nsync()\nstatelastexec")
            sock.sendall(b"uted\n\n")
            client.until(lambda row: row["output_int_register_10"] == 3)
            replies = sorted(lines.readline() for _ in range(3))
            assert replies[:2] == [
                "ack: 1: write_output_integer_register(10, 3)\n",
                "ack: 2: sync()\n",
            ]
            assert replies[2].startswith("state: ")
            sock.sendall(b"end_interpreter()\n")
            client.until(lambda row: row["runtime_state"] == 1)
            assert lines.readline() == "ack: 3: end_interpreter()\n"
    assert ask_dashboard(fast.host, "programState")[0].startswith("STOPPED")


def test_what_follows_a_clear_is_compiled_after_it(send: Sender) -> None:
    send("def put(v): write_output_integer_register(5, v) end")
    receive = send.machine.core.interpreter.receive
    for line in ("sleep(0.2)", "clear_interpreter()", "put(1)", "sync()"):
        receive(line, send.replies.append)
    ticks(send.machine, 0.5)
    assert send.replies[1:] == [
        "ack: 2: sleep(0.2)",
        "ack: 3: clear_interpreter()",
        "discard: Compile error compile_error_name_not_found:put: put(1)",
        "ack: 4: sync()",
    ]


def test_a_cleared_variable_leaves_nothing_to_the_next(send: Sender) -> None:
    send("mine = 7")
    send("clear_interpreter()")
    send("if False: fresh = 1 end write_output_integer_register(5, fresh)")
    assert send.machine.output("output_int_register_5") == 0
    assert any("has no value" in words for words in said(send.machine))


def test_dear_statements_take_as_many_cycles_as_they_need(send: Sender) -> None:
    for _ in range(25):
        send.machine.core.interpreter.receive(
            "can = get_inverse_kin_has_solution(p[3, 3, 3, 0, 0, 0])", send.replies.append
        )
    ticks(send.machine, 2.0)
    assert send.machine.program_running, said(send.machine)
    assert send("statelastexecuted") == "state: 25: statelastexecuted"


def test_how_many_statements_share_a_cycle_does_not_depend_on_the_processor(
    send: Sender, monkeypatch: pytest.MonkeyPatch
) -> None:
    def cycles(slower: float) -> list[int]:
        read = time.thread_time
        with monkeypatch.context() as patch:
            patch.setattr(time, "thread_time", lambda: slower * read())
            send("write_output_integer_register(5, outside)")
            send("sleep(0.2)", seconds=0.0)
            for _ in range(60):
                send("n = get_forward_kin() write_output_integer_register(5, outside)", seconds=0.0)
                send("outside = outside + 1", seconds=0.0)
            seen: list[int] = []
            for _ in range(100):
                send.machine.tick()
                seen.append(int(str(send.machine.output("output_int_register_5"))))
        return [value - seen[0] for value in seen]

    assert cycles(1.0) == cycles(5.0)
