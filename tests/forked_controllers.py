"""Controllers of the tests are forked from one process that has imported everything.

Each costs 0.3 s of CPU in place of 1.9 s, most of it to load compilers. What a user starts is
tested as it is in urtwin/tests/test_controller_command.py.
"""

from __future__ import annotations

import json
import os
import runpy
import select
import signal
import socket
import subprocess
import sys
import threading
from types import SimpleNamespace
from typing import IO, Any

MOST = 1 << 17
"""Bytes of a request: words, folder and environment."""


def serve(link: socket.socket) -> None:
    """Fork a controller for each request, until nobody can ask any more."""
    from dynid.robot import load_robot
    from dynid.simulation import simulated_arm
    from urtwin import ControllerMachine

    # Loads what is compiled, too.
    ControllerMachine(simulated_arm(load_robot("ur5")), version=(3, 15, 8, 106339))
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    while True:
        request, files, _, _ = socket.recv_fds(link, MOST, 3)
        if not request:
            return
        if os.fork() == 0:
            link.close()
            _watch(json.loads(request), *files)
            return
        for file in files:
            os.close(file)


def _watch(request: dict[str, Any], out: int, err: int, end: int) -> None:
    """Fork once more, tell the number of that process, and how it ended."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    # Closed by the end of the child, the only one who keeps the other end.
    lives, child_lives = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(end)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(out, 1)
        os.dup2(err, 2)
        os.chdir(request["folder"])
        os.environ.clear()
        os.environ.update(request["environment"])
        words = [word for word in request["words"] if not word.startswith("--parent=")]
        sys.argv = ["urtwin", *words, f"--parent={os.getppid()}"]
        runpy.run_module("urtwin", run_name="__main__", alter_sys=True)
        return
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.close(out)
    os.close(child_lives)
    os.write(end, f"{child}\n".encode())
    ended = select.poll()
    ended.register(lives, select.POLLIN)
    # Of a pipe that nobody reads any more: whoever asked is gone.
    ended.register(end, 0)
    ended.poll()
    if any(event & select.POLLERR for _, event in ended.poll(0)):
        os._exit(0)
    _, status = os.waitpid(child, 0)
    os.write(end, f"{os.waitstatus_to_exitcode(status)}\n".encode())
    os._exit(0)


_LOCK = threading.Lock()
_SERVER: list[tuple[socket.socket, subprocess.Popen[bytes]]] = []


def _link() -> socket.socket:
    with _LOCK:
        if not _SERVER:
            ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            words = [sys.executable, __file__, str(theirs.fileno())]
            server = subprocess.Popen(words, pass_fds=[theirs.fileno()], start_new_session=True)
            theirs.close()
            _SERVER.append((ours, server))
        return _SERVER[0][0]


class ForkedProcess:
    """What `controller_process` uses of `subprocess.Popen`."""

    def __init__(self, command: list[str], *, stdin: int, stdout: int, stderr: IO[bytes]) -> None:
        python, flag, module, *words = command
        assert (python, flag, module) == (sys.executable, "-m", "urtwin")
        assert (stdin, stdout) == (subprocess.DEVNULL, subprocess.PIPE)
        request = {"words": words, "folder": os.getcwd(), "environment": dict(os.environ)}
        (heard, said), (end, ended) = os.pipe(), os.pipe()
        socket.send_fds(_link(), [json.dumps(request).encode()], [said, stderr.fileno(), ended])
        os.close(said)
        os.close(ended)
        self.stdout, self._end = os.fdopen(heard, "rb"), os.fdopen(end, "rb", buffering=0)
        self.pid = int(self._end.readline())
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Its exit code, if it has ended."""
        return self._ended(0.0)

    def wait(self, timeout: float | None = None) -> int:
        """Its exit code."""
        code = self._ended(timeout)
        if code is None:
            raise subprocess.TimeoutExpired("urtwin", timeout or 0.0)
        return code

    def _ended(self, timeout: float | None) -> int | None:
        if self.returncode is None and select.select([self._end], [], [], timeout)[0]:
            self.returncode = int(self._end.readline())
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send it a signal, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """End it without asking."""
        self.send_signal(signal.SIGKILL)

    def __enter__(self) -> ForkedProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.stdout.close()
        self.wait()
        self._end.close()


def fork_controllers(command: Any) -> None:
    """Let `urtwin.command` start its controllers so."""
    command.subprocess = SimpleNamespace(**{**vars(subprocess), "Popen": ForkedProcess})


if __name__ == "__main__":
    serve(socket.socket(fileno=int(sys.argv[1])))
