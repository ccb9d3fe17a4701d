"""The programs of the controller: one main program, secondary ones beside it."""

import re

from dynid.protocol import RobotMode
from urtwin.core import PROGRAM_STARTED, PROGRAM_STOPPED, Core, MessageKind
from urtwin.functions import BUILTINS
from urtwin.urscript import CompiledProgram, ScriptError, ScriptRun, compile_script

_SECONDARY = 10
_LINE = re.compile(r"\bline (\d+)\b")


def compile_program(text: str) -> CompiledProgram:
    """Compile a script against the built-ins of the controller; touches nothing else.

    Raises:
        ScriptError: It does not compile, or is too long.
    """
    try:
        return compile_script(text, BUILTINS)
    except ScriptError:
        raise
    except RecursionError as error:
        raise ScriptError("nested too deeply to compile", 1) from error
    except MemoryError as error:
        raise ScriptError("the script needs more memory than there is", 1) from error
    except Exception as error:
        # A fault of ours refuses one script; it ends neither the compiler nor the controller.
        raise ScriptError(f"internal fault: {type(error).__name__}: {error}", 1) from error


def refuse(core: Core, error: ScriptError) -> None:
    """Say why a script does not compile."""
    core.say(
        f"compile error: {error}",
        "program",
        0,
        MessageKind.EXCEPTION,
        title=error.code,
        line=error.line,
    )


class Programs:
    """Starts, pauses, steps and ends programs.

    Args:
        core: The controller.
    """

    def __init__(self, core: Core) -> None:
        self._core = core
        self._main: ScriptRun | None = None
        self._beside: list[ScriptRun] = []
        self._loaded: CompiledProgram | None = None
        self._started = 0
        self.name = ""
        """The running program, or the loaded one."""

    def submit(self, text: str) -> None:
        """Compile and start a script; what is wrong with it goes to the messages."""
        program = self._compiled(text)
        if program is not None:
            self.start(program)

    def start(self, program: CompiledProgram) -> None:
        """Start a compiled script in place of the running one; a secondary one beside it."""
        core = self._core
        if core.mode != RobotMode.RUNNING or core.safety.stopped:
            core.say(f"{program.name}: the robot is not ready to run a program", "controller", 1)
            return
        execution = program.execution(core)
        if program.secondary:
            if len(self._beside) >= _SECONDARY:
                core.say("too many secondary programs", "controller", 1)
                return
            self._beside.append(execution)
            return
        self.stop("")
        self._main, self.name = execution, program.name
        self._started += 1
        core.arm.draw_anew(self._started)
        core.playing, core.paused = True, False
        core.watchdogs.clear()
        core.lacking.clear()
        core.interpreter.begin(execution, program.context)
        core.rest_brake()
        core.say(self.name, "controller", 3, MessageKind.KEY, title=PROGRAM_STARTED)

    def load(self, name: str, text: str) -> bool:
        """Load a script as the program `name`; whether it compiles."""
        program = self._compiled(text)
        if program is None:
            return False
        self.stop("")
        self._loaded, self.name = program, name
        return True

    def play(self) -> bool:
        """Start the loaded program or go on with the paused one; whether that was possible."""
        core = self._core
        if core.mode != RobotMode.RUNNING or core.safety.stopped:
            return False
        if core.playing:
            core.paused = False
            for watchdog in core.watchdogs.values():
                watchdog.fed = core.now
            return True
        if self._loaded is None:
            return False
        name = self.name
        self.start(self._loaded)
        self.name = name
        return True

    def pause(self) -> bool:
        """Pause the program; whether one runs."""
        if not self._core.playing:
            return False
        self._core.paused = True
        return True

    def stop(self, reason: str) -> bool:
        """End the main program; whether there was one. The arm brakes."""
        if self._main is None:
            return False
        core = self._core
        self._main.stop()
        self._main = None
        core.playing = core.paused = core.teaching = core.blocking_popup = False
        core.watchdogs.clear()
        core.rest = core.force = None
        core.network.close_all()
        core.interpreter.finish()
        core.arm.refuse()
        if reason:
            core.say(f"program {self.name} stopped: {reason}", "controller", 2)
        core.say(self.name, "controller", 3, MessageKind.KEY, title=PROGRAM_STOPPED)
        return True

    def step(self) -> None:
        """One control cycle of every program."""
        for execution in self._beside:
            execution.step()
            if execution.fault is not None:
                self._fault("secondary program", execution.fault)
        self._beside = [each for each in self._beside if not each.finished]
        main = self._main
        if main is None or self._core.paused:
            return
        self._core.interpreter.step()
        main.step()
        self._move_on()
        if main.finished and (self._core.rest is None or main.fault is not None):
            if main.fault is not None:
                self._fault(self.name, main.fault)
            # The last set point of a program that ended well still counts.
            held = self._core.arm.pending if main.fault is None else None
            self.stop("")
            if held is not None:
                self._core.arm.command(held)

    def _move_on(self) -> None:
        """What a blend has left to do, or force mode does, while no thread moves the arm."""
        core = self._core
        if core.arm.commanded or core.mode != RobotMode.RUNNING:
            return
        if core.force is not None:
            core.rest = None
            core.arm.command(core.force.next(core.arm, core.tcp_matrix))
        elif core.rest is not None:
            step = core.arm.cycle * core.scaling
            core.rest = core.rest if core.rest.alone(core.arm, step) else None

    def _compiled(self, text: str) -> CompiledProgram | None:
        try:
            return compile_program(text)
        except ScriptError as error:
            refuse(self._core, error)
            return None

    def _fault(self, name: str, fault: str) -> None:
        """A program has failed: say so, and where."""
        found = _LINE.search(fault)
        line = int(found.group(1)) if found else 0
        self._core.say(f"{name}: {fault}", "program", 0, MessageKind.EXCEPTION, line=line)
