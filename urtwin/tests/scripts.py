"""Running scripts without a robot, and machines without sockets."""

from typing import Any

import numpy as np

from urtwin import ControllerMachine
from urtwin.functions import BUILTINS
from urtwin.urscript import ScriptRun, compile_script

HOME = np.array([0.0, -1.4, 1.2, -1.3, -1.2, 0.3])
"""A pose in which no joint is at a limit and the tool is free."""


def execution(text: str) -> tuple[ScriptRun, dict[str, int]]:
    program = compile_script(text, BUILTINS)
    return program.execution(None), dict(program.context.shared)


def variables(text: str, cycles: int = 20) -> dict[str, Any]:
    """The program variables after it has run to its end."""
    running, places = execution(text)
    for _ in range(cycles):
        if running.finished:
            break
        running.step()
    assert running.finished, "the program did not end"
    assert running.fault is None, running.fault
    return {name: running.shared[place] for name, place in places.items()}


def value(expression: str) -> Any:
    return variables(f"def f():\n result = {expression}\nend\n")["result"]


def fault(text: str, cycles: int = 50) -> str:
    """Why a program failed."""
    running, _ = execution(text)
    for _ in range(cycles):
        if running.finished:
            break
        running.step()
    assert running.fault is not None, "the program did not fail"
    return running.fault


def ticks(machine: ControllerMachine, seconds: float) -> None:
    for _ in range(round(seconds / machine.cycle)):
        machine.tick()


def finish(machine: ControllerMachine, seconds: float = 30.0) -> None:
    """Run until the program has ended."""
    for _ in range(round(seconds / machine.cycle)):
        machine.tick()
        if not machine.program_running:
            return
    raise AssertionError(f"the program still runs; {said(machine)}")


def said(machine: ControllerMachine) -> list[str]:
    return [message.text for message in machine.messages]
