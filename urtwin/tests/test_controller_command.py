"""`urtwin` as a process: it says when it is ready, stops when asked, leaves no orphan."""

import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from dynid.core import JobError
from dynid.robot import load_robot
from dynid.simulation import SERIAL, simulated_arm
from rtde_client import RtdeClient, ask_dashboard, send_script, wait_for
from urtwin import controller_process, own_address

BAD_USAGE = {
    "--expose": ["--host", "0.0.0.0"],
    "no IPv4 address": ["--host", "nowhere"],
    "125 Hz": ["--rate", "250"],
    "no software version": ["--software", "new"],
    "thermal state": ["--thermal", "lukewarm"],
    "built-in robot": ["--robot", "r2d2"],
    "folder of programs": ["--programs", "nowhere/at/all"],
    "--truth: the file exists": ["--truth", "."],
    "--report: the file exists": ["--report", "."],
}


@pytest.fixture(autouse=True)
def as_users_start_it(monkeypatch):
    """Not forked, see tests/forked_controllers.py."""
    monkeypatch.setattr("urtwin.command.subprocess", subprocess)


def test_bad_usage_is_told_in_one_line_each():
    # One process for all: what should be refused would else run for ever in this one.
    code = (
        "import sys\n"
        "from urtwin.command import main\n"
        f"for words in {list(BAD_USAGE.values())!r}:\n"
        "    print(main(words), flush=True)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.stdout.split() == ["2"] * len(BAD_USAGE)
    lines = done.stderr.strip().splitlines()
    for message, line in zip(BAD_USAGE, lines, strict=True):
        assert message in line


@pytest.mark.parametrize(
    ("robot", "software", "rate"), [("ur5", "5.12", 500.0), ("ur5e", "3.15", 125.0)]
)
def test_the_rate_is_that_of_the_software_by_which_clients_choose_theirs(robot, software, rate):
    with controller_process(robot, software=software, virtual_time=True) as controller:
        assert controller.rate_hz == rate
        with RtdeClient(controller.host) as client:
            client.read_outputs(["timestamp"], rate)
            client.start()
            times = client.rows(3)["timestamp"]
    np.testing.assert_allclose(np.diff(times), 1 / rate, atol=1e-9)


def test_ready_line_truth_and_report(tmp_path):
    truth, report = tmp_path / "truth.json", tmp_path / "report.json"
    with controller_process("ur5", thermal=30.0, seed=3, truth=truth, report=report) as controller:
        assert controller.ports["rtde"] == 30004
        assert controller.version == "3.15.8.106339"
        written = json.loads(truth.read_text())
        with RtdeClient(controller.host) as client:
            client.read_outputs(["joint_temperatures"])
            client.start()
            client.rows(20)
        assert controller.end() == 0
        said = controller.said()
    assert "stopped by SIGINT" in said
    known = simulated_arm(load_robot("ur5"), serial=SERIAL).truth
    np.testing.assert_array_equal(written["links"], known.standard_parameters)
    np.testing.assert_allclose(written["start_degC"], 30.0, atol=1.0)
    kept = json.loads(report.read_text())
    assert kept["cycles"] >= 20
    assert kept["late_us"]["p50"] <= kept["late_us"]["p100"]


def test_sigterm_ends_it_cleanly_and_clients_are_hung_up():
    with controller_process("ur5") as controller, RtdeClient(controller.host) as client:
        client.read_outputs(["timestamp"])
        client.start()
        client.row()
        controller.process.send_signal(signal.SIGTERM)
        assert controller.process.wait(20) == 0
        with pytest.raises(ConnectionError):
            client.rows(10_000)


@pytest.mark.realtime
def test_a_long_script_that_is_being_compiled_does_not_delay_the_end():
    with controller_process("ur5") as controller:
        send_script(controller.host, "def f():\n" + "x = [1, 2, 3, 4]\n" * 55_000 + "end\n")
        time.sleep(0.5)
        began = time.monotonic()
        assert controller.end() == 0
        assert time.monotonic() - began < 2.0


def test_a_taken_address_is_told(fast):
    taken = pytest.raises(JobError, match=r"cannot listen on port 29999.*address of its own")
    with taken, controller_process("ur5", host=fast.host):
        pass


def test_it_ends_with_its_parent():
    host = own_address()
    code = (
        "import os\n"
        "from urtwin import controller_process\n"
        f"with controller_process('ur5', host={host!r}) as controller:\n"
        "    print(controller.process.pid, flush=True)\n"
        "    os._exit(9)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 9
    assert int(done.stdout) > 0

    def gone():
        try:
            ask_dashboard(host, "robotmode")
        except OSError:
            return True
        return False

    wait_for(gone, "the controller has ended with its parent")


def test_robots_of_both_series_name_themselves(fast):
    # In real time a controller takes a tenth of a core for as long as it lives: it ends here.
    with controller_process("ur5e") as e_series:
        assert (fast.rate_hz, e_series.rate_hz) == (125.0, 500.0)
        assert ask_dashboard(e_series.host, "get robot model") == ["UR5"]
        assert e_series.version.startswith("5.")


def test_programs_of_a_folder_are_loaded_and_played_by_the_dashboard(tmp_path):
    (tmp_path / "work.script").write_text("def work():\n while True:\n  sync()\n end\nend\n")
    with controller_process("ur5", programs=tmp_path) as controller:
        replies = ask_dashboard(controller.host, "load work.urp", "play", "programState", "stop")
    assert replies[:2] == ["Loading program: work.urp", "Starting program"]
    assert replies[2:] == ["PLAYING work.urp", "Stopped"]
