"""Universal Robots' C++ client library against urtwin: `python real_clients.py CLIENTS`.

CLIENTS holds its source in `urcl`; the examples are built with cmake and g++ where they are not yet
(about 9 minutes). A step of `make proof`, no part of the suite. Each example runs against a fresh
controller at 125 Hz (CB3, software 3.15) and 500 Hz (e-Series, 5.12); it passes when it ends by
itself with code 0 in time, has written what is expected as often as expected, and the controller
still runs without a fault of its own.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import socket
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from urtwin import controller_process

BUILD = Path(__file__).resolve().parents[2] / "build" / "urcl"
SOFTWARE = {125.0: ("ur5", "3.15.8"), 500.0: ("ur5e", "5.12.0")}
WAIT = "def wait_program():\n  while True:\n    sync()\n  end\nend\n"
"""The program that the dashboard example loads."""

PRIORITY = 5
LAST = 2000
"""How much of what a failed example and its controller said is shown [characters]."""
ASK = """def ask():
  socket_open("127.0.0.1", 12345, "sender")
  socket_send_line("request_program", "sender")
  textmsg(socket_read_string("sender"))
end
"""
"""Asks the script sender for its program."""


@dataclass(frozen=True)
class Example:
    """A program of the library, and what shows that it did its work."""

    name: str
    program: str
    arguments: tuple[str, ...] = ()
    counted: str = ""
    """What is counted in its output (regular expression)."""
    least: int = 0
    """How often, at least."""
    limit_s: float = 90.0
    """A run that takes longer has failed."""
    script: str = ""
    """Sent to the controller while the example runs."""
    said: str = ""
    """What the controller then says."""


EXAMPLES = (
    # Fifty packages a second were asked for; some are gone before the first is printed.
    Example("rtde_client", "rtde_client_example", ("10",), r"target_speed_fraction: \[", 400),
    Example("full_driver", "driver_example", (), "Movement done", 1),
    Example("instruction_executor", "instruction_executor", (), "result SUCCESS", 5),
    Example("trajectory_point_interface", "trajectory_point_interface_example", (), "SUCCESS", 3),
    Example("trajectory_streaming", "trajectory_streaming_example", (), "SUCCESS", 2),
    Example("spline", "spline_example", (), "Movement done", 2, 150.0),
    Example(
        "script_command_interface",
        "script_command_interface_example",
        ("10",),
        "Timeout reached",
        1,
    ),
    Example("send_script", "send_script", (), "name_not_found:current_pos|executed success", 4),
    Example("freedrive", "freedrive_example", ("10",), "Robot connected to reverse interface", 1),
    Example("force_mode", "force_mode_example", ("10",), "Robot connected to reverse interface", 1),
    Example(
        "script_sender",
        "script_sender_example",
        ("10",),
        "Timeout reached",
        1,
        script=ASK,
        said="Hello, World!",
    ),
    Example("dashboard", "dashboard_example", (), "STOPPED wait_program|off command success: 1", 2),
    Example("primary_pipeline", "primary_pipeline_example", ("10",), "Type: |VersionMessage", 1),
)


def hurried() -> None:
    """What UR asks of a driver's threads: a real-time priority, below the controller's."""
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))


def run(example: Example, rate_hz: float, build: Path, source: Path) -> tuple[bool, str]:
    """Whether one run passed, and what is to be said of it."""
    robot, software = SOFTWARE[rate_hz]
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "wait_program.script").write_text(WAIT)
        with controller_process(
            robot, rate_hz=rate_hz, software=software, programs=Path(folder)
        ) as controller:
            begun = time.monotonic()
            words = [str(build / "examples" / example.program), controller.host]
            with subprocess.Popen(
                [*words, *example.arguments],
                cwd=source,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                preexec_fn=hurried,
            ) as done:
                if example.script:
                    time.sleep(2.0)
                    with socket.create_connection((controller.host, 30002), 10) as sock:
                        sock.sendall(example.script.encode())
                        time.sleep(2.0)
                try:
                    output = done.communicate(timeout=example.limit_s)[0].decode(errors="replace")
                except subprocess.TimeoutExpired:
                    done.kill()
                    output = done.communicate()[0].decode(errors="replace")
                    return False, (
                        f"not over in {example.limit_s:g} s; {output[-LAST:]}\n"
                        f"controller: {controller.said()[-LAST:]}"
                    )
            taken = time.monotonic() - begun
            count = len(re.findall(example.counted, output)) if example.counted else 0
            if controller.process.poll() is not None:
                return False, f"the controller ended: {controller.said()[-300:]}"
            if example.said not in controller.said():
                return False, f"the controller never said {example.said!r}"
            if "internal fault" in controller.said():
                return False, f"internal fault: {controller.said()[-300:]}"
            if done.returncode or count < example.least:
                return False, (
                    f"code {done.returncode}, counted {count}; {output[-LAST:]}\n"
                    f"controller: {controller.said()[-LAST:]}"
                )
            return True, f"{taken:.1f} s, counted {count}"


def main() -> None:
    """Run every example at every rate; the exit code tells whether all passed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("clients", type=Path)
    parser.add_argument("--build", type=Path, default=BUILD, help="where the examples are built")
    parser.add_argument("--times", type=int, default=1, help="runs of each")
    parser.add_argument("--rates", type=float, nargs="+", default=list(SOFTWARE))
    parser.add_argument("--only", nargs="+", default=[example.name for example in EXAMPLES])
    asked = parser.parse_args()
    source, build = asked.clients / "urcl", asked.build
    if not (build / "examples" / EXAMPLES[-1].program).is_file():
        subprocess.run(["cmake", "-S", source, "-B", build], check=True)
        subprocess.run(["cmake", "--build", build, "-j2"], check=True)
    failed = 0
    for rate in asked.rates:
        for example in (each for each in EXAMPLES if each.name in asked.only):
            for _ in range(asked.times):
                good, words = run(example, rate, build, source)
                failed += not good
                mark = "pass" if good else "FAIL"
                print(f"{mark} {rate:g} Hz {example.name}: {words}", flush=True)
    raise SystemExit(1 if failed else 0)


if __name__ == "__main__":
    main()
