"""One simulated UR controller: no sockets, no wall clock, one control cycle at a time.

It runs one main program, and secondary ones beside it.
"""

import math
import re
from collections import deque
from collections.abc import Sequence

from dynid.core import InputError
from dynid.protocol import RobotMode, SafetyMode
from dynid.simulation import SimulatedArm, Thermal
from urtwin.arm import PROGRAM_STOP, ControlledArm
from urtwin.core import PROGRAM_STARTED, PROGRAM_STOPPED, Core, Message, MessageKind
from urtwin.functions import BUILTINS
from urtwin.safety import Safety, WatchedLimits
from urtwin.urscript import CompiledProgram, ScriptError, ScriptRun, compile_script
from urtwin.variables import READERS, Inputs, InputValue, OutputValue

_SECONDARY = 10
_LINE = re.compile(r"\bline (\d+)\b")
_BOOT_S, _RELEASE_S = 1.0, 0.5
Version = tuple[int, int, int, int]
UPRIGHT = (0.0, -math.pi / 2, 0.0, -math.pi / 2, 0.0, 0.0)
"""Where UR arms stand when a new controller starts [rad]."""


def compile_program(text: str) -> CompiledProgram:
    """Compile a script against the built-ins of the controller; touches nothing else.

    A `ScriptError` tells why it does not compile.
    """
    try:
        return compile_script(text, BUILTINS)
    except ScriptError:
        raise
    except Exception as error:
        # A fault of ours refuses one script; it ends neither the compiler nor the controller.
        raise ScriptError(f"internal fault: {type(error).__name__}: {error}", 1) from error


class Programs:
    """Starts, pauses, steps and ends programs."""

    def __init__(self, core: Core) -> None:
        self.core = core
        self._main: ScriptRun | None = None
        self._beside: list[ScriptRun] = []
        self._loaded: CompiledProgram | None = None
        self._started = 0
        self.loaded_name = ""
        """The program that is loaded; empty for none."""
        self.program_name = ""
        """The program that runs, else the loaded one."""

    def run_script(self, text: str) -> None:
        """Run a script as if sent to a script port: it replaces the running program.

        What is wrong with it is said in `core.messages`.
        """
        program = self._compiled(text)
        if program is not None:
            self.run_program(program)

    def refuse(self, error: ScriptError) -> None:
        """Say why a script sent to a script port does not compile."""
        words, kind = f"compile error: {error}", MessageKind.EXCEPTION
        self.core.say(words, "program", 0, kind, title=error.code, line=error.line)

    def run_program(self, program: CompiledProgram, name: str = "") -> None:
        """Start a compiled script in place of the running one; a secondary one beside it.

        Its `name` is its own where none is given.
        """
        core = self.core
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
        self.stop()
        self._main, self.program_name = execution, name or program.name
        self._started += 1
        core.arm.draw_anew(self._started)
        core.playing, core.paused = True, False
        core.watchdogs.clear()
        core.lacking.clear()
        core.interpreter.begin(execution, program.context)
        core.arm.braking = PROGRAM_STOP
        core.say(self.program_name, "controller", 3, MessageKind.KEY, title=PROGRAM_STARTED)

    def load(self, name: str, text: str) -> bool:
        """Load a program; whether it compiles. What is wrong is said in `core.messages`."""
        program = self._compiled(text)
        if program is None:
            return False
        self.stop()
        self._loaded, self.loaded_name, self.program_name = program, name, name
        return True

    def play(self) -> bool:
        """Start the loaded program, or go on with the paused one; whether that was possible."""
        core = self.core
        if core.mode != RobotMode.RUNNING or core.safety.stopped:
            return False
        if core.playing:
            core.paused = False
            for watchdog in core.watchdogs.values():
                watchdog.fed = core.now
            return True
        if self._loaded is None:
            return False
        self.run_program(self._loaded, self.loaded_name)
        return True

    def pause(self) -> bool:
        """Pause the running program; whether there was one."""
        if not self.core.playing:
            return False
        self.core.paused = True
        return True

    def stop(self, reason: str = "") -> bool:
        """Stop the program, for a reason to tell if one is given; whether there was one.

        The arm brakes.
        """
        if self._main is None:
            return False
        core = self.core
        self._main.stop()
        self._main = None
        core.playing = core.paused = core.teaching = core.blocking_popup = False
        core.watchdogs.clear()
        core.rest = core.force = None
        core.network.close_all()
        core.interpreter.finish()
        core.arm.pending = None
        if reason:
            core.say(f"program {self.program_name} stopped: {reason}", "controller", 2)
        core.say(self.program_name, "controller", 3, MessageKind.KEY, title=PROGRAM_STOPPED)
        self.program_name = self.loaded_name
        return True

    def step_programs(self) -> None:
        """One control cycle of every program."""
        for execution in self._beside:
            execution.step()
            if execution.fault is not None:
                self._fault("secondary program", execution.fault)
        self._beside = [each for each in self._beside if not each.finished]
        main = self._main
        if main is None or self.core.paused:
            return
        self.core.interpreter.step()
        main.step()
        self._move_on()
        if main.finished and (self.core.rest is None or main.fault is not None):
            if main.fault is not None:
                self._fault(self.program_name, main.fault)
            # The last set point of a program that ended well still counts.
            held = self.core.arm.pending if main.fault is None else None
            self.stop()
            self.core.arm.pending = held

    def _move_on(self) -> None:
        """What a blend has left to do, or force mode does, while no thread moves the arm."""
        core = self.core
        if core.arm.pending is not None or core.mode != RobotMode.RUNNING:
            return
        if core.force is not None:
            core.rest = None
            core.arm.pending = core.force.next(core.arm, core.tcp_matrix)
        elif core.rest is not None:
            step = core.arm.cycle * core.scaling
            core.rest = core.rest if core.rest.alone(core.arm, step) else None

    def _compiled(self, text: str) -> CompiledProgram | None:
        try:
            return compile_program(text)
        except ScriptError as error:
            self.refuse(error)
            return None

    def _fault(self, name: str, fault: str) -> None:
        """A program has failed: say so, and where."""
        found = _LINE.search(fault)
        line = int(found.group(1)) if found else 0
        self.core.say(f"{name}: {fault}", "program", 0, MessageKind.EXCEPTION, line=line)


class ControllerMachine(Programs):
    """A simulated UR controller with its arm.

    `tick` is one control cycle: scripts run, the arm moves, safety judges; then `output` tells
    the state at the start of that cycle. The same seed and inputs give the same outputs. A program
    has to be ticked in the thread of this process in which it started.

    Args:
        arm: The simulated arm, six joints.
        rate_hz: Control cycles a second: 125 (CB3) or 500 (e-Series).
        thermal: `cold`, `warm`, one temperature or one a joint [degC].
        seed: Seed of the measurement noise.
        version: Software version: major, minor, bugfix, build.
        pose: (6) where the arm stands at the start [rad].
        powered: Start with open brakes, ready to move; else with the power off.
        safety: What the safety system watches.

    Raises:
        InputError: Another number of joints, or a rate, thermal state or pose that cannot be.
        MissingExtraError: MuJoCo is not installed.
    """

    def __init__(
        self,
        arm: SimulatedArm,
        *,
        rate_hz: float = 125.0,
        thermal: Thermal = "cold",
        seed: int = 0,
        version: Version = (3, 15, 0, 0),
        pose: Sequence[float] = UPRIGHT,
        powered: bool = True,
        safety: WatchedLimits | None = None,
    ) -> None:
        controlled = ControlledArm(arm, rate_hz, thermal, seed, pose)
        super().__init__(Core(controlled, Safety(safety or WatchedLimits()), rate_hz, version))
        self._inputs = Inputs(self.core)
        self._wanted: RobotMode | None = None
        self._ready = 0.0
        if not powered:
            self.core.mode = RobotMode.POWER_OFF

    @property
    def cycle(self) -> float:
        """Length of a control cycle [s]."""
        return self.core.arm.cycle

    @property
    def messages(self) -> deque[Message]:
        """What to tell clients; take with `popleft`. The oldest are dropped beyond a thousand."""
        return self.core.messages

    def tick(self) -> None:
        """Run one control cycle."""
        core = self.core
        core.cycles += 1
        core.network.listening, core.network.reads = False, 0
        self._inputs.apply()
        self._step_power()
        core.scale()
        self._guard_watchdogs()
        try:
            self.step_programs()
        except Exception as error:
            self.stop(f"internal fault of urtwin: {type(error).__name__}: {error}")
        try:
            self._watch()
            core.arm.tick(powered=core.mode == RobotMode.RUNNING)
        except Exception as error:
            self._fail(str(error))
        core.history.appendleft(core.arm.state.q.tolist())

    def output(self, name: str) -> OutputValue:
        """The RTDE output `name` at the start of the last cycle.

        Raises:
            InputError: No such output.
        """
        reader = READERS.get(name)
        if reader is None:
            raise InputError("unknown RTDE output", value=name)
        return reader(self.core)

    def numbers(self, *names: str) -> list[float]:
        """The values of RTDE outputs one after another, those of vectors too."""
        found: list[float] = []
        for name in names:
            value = self.output(name)
            found += value if isinstance(value, list) else [value]
        return found

    def set_input(self, name: str, value: InputValue) -> None:
        """Write an RTDE input; it acts from the next cycle on and feeds its watchdog.

        Raises:
            InputError: No such input.
        """
        self._inputs.write(name, value)

    def power_on(self) -> bool:
        """Switch the arm on, brakes closed; not in a fault."""
        if self.core.safety.mode == SafetyMode.FAULT:
            return False
        if self.core.mode == RobotMode.POWER_OFF:
            self._switch(RobotMode.IDLE)
        return True

    def power_off(self) -> bool:
        """Stop the program, close the brakes and switch off, at once."""
        self.stop("power off")
        self._wanted, self.core.mode = None, RobotMode.POWER_OFF
        return True

    def brake_release(self) -> bool:
        """Open the brakes, switching the arm on first if need be."""
        if not self.power_on() or self.core.safety.stopped:
            return False
        if self.core.mode != RobotMode.RUNNING:
            self._switch(RobotMode.RUNNING)
        return True

    def unlock_protective_stop(self) -> bool:
        """Leave the protective stop; false in its first seconds, or if there is none."""
        unlocked = self.core.safety.unlock(self.core.now)
        if unlocked:
            self.core.arm.braking = PROGRAM_STOP
        return unlocked

    @property
    def program_running(self) -> bool:
        """Whether a program runs or is paused."""
        return self.core.playing

    def _switch(self, wanted: RobotMode) -> None:
        core = self.core
        self._wanted = wanted
        if core.mode == RobotMode.POWER_OFF:
            core.mode = RobotMode.POWER_ON
            self._ready = core.now + _BOOT_S
        elif core.mode == RobotMode.IDLE:
            self._ready = core.now + _RELEASE_S

    def _step_power(self) -> None:
        core = self.core
        if self._wanted is None or core.now < self._ready:
            return
        if core.mode == RobotMode.POWER_ON:
            core.mode = RobotMode.IDLE
            self._ready = core.now + _RELEASE_S
        elif self._wanted == RobotMode.RUNNING:
            core.mode = RobotMode.RUNNING
            core.arm.release()
        if core.mode == self._wanted:
            self._wanted = None

    def _watch(self) -> None:
        """Judge the new set point and the state of the arm; a violation is a protective stop."""
        core = self.core
        if core.safety.stopped or core.mode != RobotMode.RUNNING:
            core.arm.pending = None
        elif (reason := core.safety.judge(core.arm, core.tcp_matrix)) is not None:
            core.protective_stop(reason)
        if core.safety.stopped:
            self.stop()

    def _fail(self, reason: str) -> None:
        """Switch off after what no real arm does, such as motion without bounds."""
        self.stop()
        self.power_off()
        self.core.safety.fail(reason, self.core.now)
        self.core.say(reason, "safety", 0, MessageKind.STOP)

    def _guard_watchdogs(self) -> None:
        """Pause or stop the program where a client has not written what it promised to."""
        core = self.core
        watchdog = core.starved() if core.playing else None
        if watchdog is None or (watchdog.action == "pause" and core.paused):
            return
        text = f"RTDE watchdog: {watchdog.variable} was not written for {watchdog.period:.3f} s"
        if watchdog.action == "pause":
            core.say(text, "controller", 2)
            self.pause()
        else:
            core.say(text, "controller", 1)
            self.stop(text)
