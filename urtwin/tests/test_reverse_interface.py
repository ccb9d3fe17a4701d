"""Programs that connect back to the machine of a driver, as UR's own drivers make them.

The script below is ours, in the manner of Universal_Robots_Client_Library,
resources/external_control.urscript: three sockets, set points as whole numbers, one thread that
reads them in a critical section and one that servos in another, a third that listens for
commands without end.
"""

import contextlib
import itertools
import math
import socket
import struct
import time

import pytest

from rtde_client import TIMEOUT_S, RtdeClient, send_script
from scripts import finish, said
from urtwin import controller_process
from urtwin.network import on_this_machine

SCALE = 1_000_000
DRIVER = """def driver():
  global state = -1
  global q_now = get_joint_positions()
  global q_last = q_now
  global mode = -1
  global extrapolated = 0
  steptime = get_steptime()

  def extrapolate():
    q_last = q_now
    q_now = q_now + (get_target_joint_speeds() * steptime)
    return q_now
  end

  thread servo():
    while mode == 1:
      enter_critical
      q = q_now
      wants = False
      if state == 0:
        wants = True
      end
      before = state
      if state > -1:
        state = 0
      end
      if wants:
        extrapolated = extrapolated + 1
        q = extrapolate()
        servoj(q, t=steptime, lookahead_time=0.03, gain=500)
      elif before == 1:
        servoj(q, t=steptime, lookahead_time=0.03, gain=500)
      else:
        sync()
      end
      exit_critical
    end
    stopj(4.0)
  end

  thread commands():
    while mode > -2:
      raw = socket_read_binary_integer(3, "commands", 0)
      if raw[0] > 0:
        write_output_integer_register(31, raw[1] + raw[2] + raw[3])
      end
    end
  end

  ready = socket_open("{host}", {reverse}, "reverse")
  ready = ready and socket_open("{host}", {commands}, "commands")
  textmsg(str_cat("connected: ", ready))
  listener = run commands()
  mover = 0
  timeout = 0.0
  while mode > -2:
    enter_critical
    params = socket_read_binary_integer(8, "reverse", timeout)
    if params[0] > 0:
      timeout = params[1] / 1000.0
      if mode != params[8]:
        mode = params[8]
        join mover
        if mode == 1:
          q_now = get_joint_positions()
          mover = run servo()
        end
      end
      if mode == 1:
        q_last = q_now
        q_now = [params[2], params[3], params[4], params[5], params[6], params[7]] / {scale}
        state = 1
        socket_send_int(params[7], "reverse")
        write_output_integer_register(30, params[7])
      end
    else:
      textmsg("timed out")
      mode = -2
      kill mover
      kill listener
      stopj(4.0)
    end
    exit_critical
  end
  write_output_integer_register(32, extrapolated)
  socket_close("reverse")
end
"""
UPRIGHT = [0.0, -math.pi / 2, 0.0, -math.pi / 2, 0.0, 0.0]
IDLE, SERVOJ, STOPPED = 0, 1, -2
STANDING = 1e-3
"""Joint speed of an arm that has braked [rad/s]."""


def scaled(numbers):
    return [round(SCALE * number) for number in numbers]


class Driver:
    """The listening ends, and what a driver sends through them."""

    def __init__(self, stack):
        self.listeners = [stack.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in "ab"]
        for listener in self.listeners:
            listener.settimeout(TIMEOUT_S)

    def script(self):
        reverse, commands = (listener.getsockname()[1] for listener in self.listeners)
        text = DRIVER.replace("{host}", "127.0.0.1").replace("{scale}", f"{float(SCALE)}")
        return text.replace("{reverse}", str(reverse)).replace("{commands}", str(commands))

    def accept(self, stack):
        self.reverse, self.commands = (
            stack.enter_context(listener.accept()[0]) for listener in self.listeners
        )
        for sock in (self.reverse, self.commands):
            sock.settimeout(TIMEOUT_S)

    def send(self, mode, q=(0.0,) * 6, timeout_ms=400):
        self.reverse.sendall(struct.pack(">8i", timeout_ms, *scaled(q), mode))


@pytest.fixture
def driver():
    with contextlib.ExitStack() as stack:
        driver = Driver(stack)
        driver.stack = stack
        yield driver


@pytest.fixture(scope="module", params=["ur5", "ur5e"])
def controller(request):
    """One of our own: the arm does not stay where it was."""
    with controller_process(request.param) as controller:
        yield controller


@pytest.mark.realtime
def test_a_driver_streams_set_points_through_the_reverse_interface(controller, driver):
    names = ["timestamp", "actual_q", "target_q", "runtime_state", "safety_status_bits"]
    names += [f"output_int_register_{k}" for k in (30, 31, 32)]
    with RtdeClient(controller.host) as client:
        client.read_outputs(names, controller.rate_hz)
        client.start()
        send_script(controller.host, driver.script(), 30001)
        driver.accept(driver.stack)
        driver.send(IDLE)
        k, rows = 0, []
        while k < 300:
            rows.append(client.row())
            # Slow: where this process is held up, the script goes on along the last speed.
            swing = 0.05 * (1 - math.cos(2 * k / controller.rate_hz))
            driver.send(SERVOJ, [swing, *UPRIGHT[1:5], 1e-6 * k], timeout_ms=1000)
            k += 1
        driver.commands.sendall(struct.pack(">3i", 1, 20, 300))
        client.until(lambda row: row["output_int_register_31"] == 321)
        # Every set point is read, in order.
        echoes = b""
        while len(echoes) < 4 * 300:
            echoes += driver.reverse.recv(4096)
        assert list(struct.unpack(">300i", echoes)) == list(range(300))
        arrived = client.until(lambda row: row["output_int_register_30"] == 299)
        driver.send(STOPPED)
        last = client.until(lambda row: row["runtime_state"] == 1)
    assert last["safety_status_bits"] == 1
    assert max(row["actual_q"][0] for row in rows) > 0.02
    assert abs(arrived["target_q"][0] - swing) < 0.005
    speeds = [(b["target_q"][0] - a["target_q"][0]) for a, b in itertools.pairwise(rows)]
    assert max(map(abs, speeds)) < 0.05, "no jumps between set points"


@pytest.mark.realtime
def test_a_driver_that_falls_silent_ends_its_program(controller, driver):
    with RtdeClient(controller.host) as client:
        client.read_outputs(["timestamp", "actual_q", "runtime_state", "target_qd"])
        client.start()
        send_script(controller.host, driver.script(), 30003)
        driver.accept(driver.stack)
        driver.send(IDLE)
        begun = client.until(lambda row: row["runtime_state"] == 2)
        here = client.row()["actual_q"]
        driver.send(SERVOJ, here, timeout_ms=200)
        ended = client.until(lambda row: row["runtime_state"] == 1)
    assert 0.2 <= ended["timestamp"] - begun["timestamp"] < 5.0
    assert max(map(abs, ended["target_qd"])) < STANDING
    # The program's end hangs up, which is how a driver learns of it.
    while driver.commands.recv(4096):
        pass


@pytest.mark.realtime
def test_virtual_time_does_not_run_away_from_a_program_that_listens(driver):
    with controller_process("ur5", virtual_time=True) as fast, RtdeClient(fast.host) as client:
        client.read_outputs(["timestamp", "output_int_register_30"])
        send_script(fast.host, driver.script(), 30002)
        driver.accept(driver.stack)
        client.start()
        begin, first = time.monotonic(), client.row()["timestamp"]
        for k in range(1, 31):
            driver.send(SERVOJ, [*UPRIGHT[:5], 1e-6 * k], timeout_ms=500)
            row = client.until(lambda row, k=k: row["output_int_register_30"] == k)
        driver.send(STOPPED)
        passed, wall = row["timestamp"] - first, time.monotonic() - begin
    # A cycle or two a set point; in free virtual time it would be twenty times the wall clock's.
    assert passed < 2 * wall + 0.1


def test_reading_and_writing_in_every_way(machine, driver):
    listener = driver.listeners[0]
    script = """def talk():
  ok = socket_open("localhost", {port})
  socket_send_string("hello ")
  socket_send_line("world")
  socket_send_int(-2)
  socket_send_byte(65)
  socket_set_var("speed", 7)
  a = socket_read_ascii_float(3)
  b = socket_read_line()
  c = socket_read_string(prefix="<", suffix=">")
  d = socket_read_byte_list(2)
  e = socket_get_var("count")
  g = socket_read_string(suffix="\\n", interpret_escape=True)
  f = socket_read_binary_integer(1, "socket_0", 0.05)
  textmsg(ok)
  textmsg(a)
  textmsg(b)
  textmsg(c)
  textmsg(d)
  textmsg(e)
  textmsg(f[0])
  textmsg(g)
end
"""
    machine.run_script(script.replace("{port}", str(listener.getsockname()[1])))
    for _ in range(3):
        machine.tick()
    with listener.accept()[0] as peer:
        peer.settimeout(TIMEOUT_S)
        peer.sendall(b"noise (1.5, -2, 3e2)a line\r\nxx<inside>\x07\xffcount 12\nend\n")
        finish(machine)
        heard = b""
        while piece := peer.recv(4096):
            heard += piece
    assert heard == b"hello world\n" + struct.pack(">i", -2) + b"ASET speed 7\nGET count\n"
    texts = [text for text in said(machine) if text != "talk"]
    assert texts[:4] == ["True", "[3, 1.5, -2, 300]", "a line", "inside"]
    assert texts[4:] == ["[2, 7, 255]", "12", "0", "end"]


def test_what_cannot_be_reached_is_no_socket(machine, driver):
    port = driver.listeners[0].getsockname()[1]
    driver.listeners[0].close()
    machine.run_script(
        f'def f():\n a = socket_open("127.0.0.1", {port})\n b = socket_open("192.0.2.1", 80)\n'
        " textmsg(a)\n textmsg(b)\n textmsg(socket_send_int(1))\n"
        " textmsg(socket_read_line())\nend\n"
    )
    finish(machine)
    texts = said(machine)
    assert any("connect to this machine only" in text for text in texts)
    assert [text for text in texts if text in ("True", "False", "")] == ["False"] * 3 + [""]


@pytest.mark.parametrize(
    ("host", "here"),
    [
        *(("127.0.0.1", True), ("127.9.8.7", True), ("192.0.2.1", False), ("224.0.0.1", False)),
        *(("0.0.0.0", False), ("example.org", False), ("", False)),
    ],
)
def test_only_its_own_addresses_are_this_machine(host, here):
    assert on_this_machine(host) is here


def test_a_reader_that_gets_nothing_does_not_hold_the_others_up(machine):
    # Without a socket each read answers at once, but not within the same cycle.
    machine.run_script(
        'def f():\n thread read():\n while True:\n x = socket_read_binary_integer(1, "none", 0)\n'
        " end\n end\n run read()\n k = 0\n while k < 20:\n k = k + 1\n sync()\n end\n"
        ' textmsg("done")\nend\n'
    )
    finish(machine)
    assert "done" in said(machine)


def test_connecting_takes_longer_than_a_thread_that_accepts(machine, driver):
    port = driver.listeners[0].getsockname()[1]
    machine.run_script(f'def f():\n textmsg(socket_open("127.0.0.1", {port}))\nend\n')
    begin = machine.core.now
    while "True" not in said(machine):
        machine.tick()
    assert 0.01 <= machine.core.now - begin < 0.05


def test_cycles_that_are_caught_up_count_as_no_waiting(machine, driver):
    port = driver.listeners[0].getsockname()[1]
    machine.run_script(
        f'def f():\n socket_open("127.0.0.1", {port})\n'
        ' textmsg(socket_read_binary_integer(1, "socket_0", 0.02)[0])\nend\n'
    )
    machine.tick()
    machine.core.network.late = True
    for _ in range(50):
        machine.tick()
    assert "0" not in said(machine)
    machine.core.network.late = False
    finish(machine, 0.1)
    assert "0" in said(machine)
