"""ur_rtde's control interface in a process of its own, which is killed to end it.

After 2.5 s without a package ur_rtde 1.6.5 reconnects, from several threads at once where somebody
disconnects meanwhile: its process crashes, and its program is started again on the controller.
It also writes to stdout. This file is run by its path: it must import nothing of dynid then.
"""

import json
import os
import select
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import IO, Any

ANSWER_S = 20.0
"""How long ur_rtde may take for a call, its connection included [s]."""
_PRIORITY = 10


class UrRtde:
    """Has the methods of `rtde_control.RTDEControlInterface`, as far as JSON takes their words.

    Raises:
        RuntimeError: What ur_rtde says, or that it has ended; so does each of its methods.
    """

    def __init__(self, host: str) -> None:
        # A session of its own: Ctrl-C and a terminal that closes are for the caller alone.
        self._process = subprocess.Popen(
            [sys.executable, "-P", __file__, host],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        self._requests: Any = self._process.stdin
        self._answers: Any = self._process.stdout
        self._lock = threading.Lock()
        try:
            self._answer()
        except BaseException:
            self.close()
            raise

    def __getattr__(self, name: str) -> Callable[..., Any]:
        def call(*words: Any) -> Any:
            with self._lock:
                try:
                    self._requests.write(json.dumps([name, *words]).encode() + b"\n")
                    self._requests.flush()
                except (OSError, ValueError) as error:
                    raise RuntimeError("ur_rtde has ended") from error
                return self._answer()

        return call

    def _answer(self) -> Any:
        if not select.select([self._answers], [], [], ANSWER_S)[0]:
            self.kill()
            raise RuntimeError(f"ur_rtde does not answer within {ANSWER_S:g} s")
        line = self._answers.readline()
        if not line:
            raise RuntimeError("ur_rtde has ended")
        value, fault = json.loads(line)
        if fault is not None:
            raise RuntimeError(fault)
        return value

    def kill(self) -> None:
        """End it at once, without a wait; who waits for an answer is told."""
        self._process.kill()

    def close(self) -> None:
        """End it, and wait for its end."""
        self.kill()
        with self._lock:
            self._process.communicate()


def _serve(host: str, asked: IO[bytes], answers: IO[bytes]) -> None:
    def watch() -> None:
        # Whoever asked is gone, perhaps in the middle of a call that takes minutes.
        hung_up = select.poll()
        hung_up.register(asked, 0)
        hung_up.poll()
        os._exit(0)

    threading.Thread(target=watch, daemon=True).start()
    control: Any = None

    def answer(call: Callable[[], Any]) -> None:
        value, fault = None, None
        try:
            value = call()
        # It is raised again where the call was made.
        except Exception as error:
            fault = str(error)
        answers.write(json.dumps([value, fault]).encode() + b"\n")
        answers.flush()

    def connect() -> None:
        nonlocal control
        import rtde_control  # pyright: ignore[reportMissingImports]

        control = rtde_control.RTDEControlInterface(host)  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]

    answer(connect)
    urgent = False
    for line in iter(asked.readline, b""):
        name, *words = json.loads(line)
        if not urgent and name == "servoJ":
            # The stream waits for it. Not before: in other calls ur_rtde waits without sleep, and
            # its own reader of packages would not get the processor.
            urgent = True
            with suppress(OSError, AttributeError):
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
        answer(lambda name=name, words=words: getattr(control, name)(*words))


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = os.fdopen(os.dup(1), "wb")
    # ur_rtde talks on stdout.
    os.dup2(2, 1)
    _serve(sys.argv[1], sys.stdin.buffer, answers)
