"""One simulated UR controller: no sockets, no wall clock, one control cycle at a time."""

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from dynid.core import InputError
from dynid.protocol import RobotMode, SafetyMode
from dynid.simulation import SimulatedArm, Thermal
from urtwin.arm import ControlledArm
from urtwin.core import Core, InputWatchdog, Message, MessageKind
from urtwin.programs import Programs, compile_program, refuse
from urtwin.safety import Safety, WatchedLimits
from urtwin.urscript import CompiledProgram, ScriptError
from urtwin.variables import READERS, Inputs, InputValue, OutputValue

_BOOT_S, _RELEASE_S = 1.0, 0.5


class Power:
    """Robot modes from `POWER_OFF` to `RUNNING`.

    Args:
        core: The controller.
    """

    def __init__(self, core: Core) -> None:
        self._core = core
        self._wanted: RobotMode | None = None
        self._ready = 0.0

    def on(self) -> bool:
        """Switch on, up to closed brakes; not in a fault or an emergency stop."""
        if self._core.safety.mode > SafetyMode.RECOVERY:
            return False
        if self._core.mode == RobotMode.POWER_OFF:
            self._start(RobotMode.IDLE)
        return True

    def off(self) -> bool:
        """Close the brakes and switch off, at once."""
        self._wanted = None
        self._core.mode = RobotMode.POWER_OFF
        return True

    def release(self) -> bool:
        """Open the brakes, switching on first if need be."""
        if not self.on() or self._core.safety.stopped:
            return False
        if self._core.mode != RobotMode.RUNNING:
            self._start(RobotMode.RUNNING)
        return True

    def step(self) -> None:
        """One control cycle."""
        core = self._core
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

    def _start(self, wanted: RobotMode) -> None:
        core = self._core
        self._wanted = wanted
        if core.mode == RobotMode.POWER_OFF:
            core.mode = RobotMode.POWER_ON
            self._ready = core.now + _BOOT_S
        elif core.mode == RobotMode.IDLE:
            self._ready = core.now + _RELEASE_S


_AT_REST = 1e-4
"""Too slow to break any limit [rad/s]."""


def watch(core: Core) -> None:
    """Judge the new set point and the state of the arm; a violation is a protective stop."""
    if core.safety.stopped or core.mode != RobotMode.RUNNING:
        core.arm.refuse()
        return
    reason = _setpoint(core) or _state(core)
    if reason is not None:
        core.protective_stop(reason)


def _setpoint(core: Core) -> str | None:
    arm = core.arm
    if arm.pending is None:
        return None
    return core.safety.judge_setpoint(arm.pending, arm.setpoint, arm.lower, arm.upper)


def _state(core: Core) -> str | None:
    arm, limits = core.arm, core.safety.limits
    state = arm.state
    speeds: list[float] = state.target.dq.tolist()
    fastest = max(map(abs, speeds))
    if fastest < _AT_REST and arm.still > 0:
        return None
    if fastest > limits.joint_speed:
        joint = max(range(len(speeds)), key=lambda k: abs(speeds[k]))
        return (
            f"C191A{32 + joint}: Joint {joint} speed violation: {fastest:.3f} rad/s, "
            f"limit {limits.joint_speed:.3f} rad/s"
        )
    deviation = float(np.max(np.abs(state.q - state.target.q)))
    if deviation > limits.deviation:
        return f"C153: Position deviates from path: {deviation:.3f} rad"
    if math.isfinite(limits.tool_speed):
        point = arm.tool_point(core.tcp_matrix)
        speed = arm.plant.tracker.tool_speed(point)
        if speed > limits.tool_speed:
            return f"Tool speed limit: {speed:.3f} m/s, limit {limits.tool_speed:.3f} m/s"
    if math.isfinite(limits.momentum):
        momentum = arm.plant.tracker.momentum()
        if momentum > limits.momentum:
            return f"Momentum limit: {momentum:.2f} kg.m/s, limit {limits.momentum:.2f} kg.m/s"
    if math.isfinite(limits.power):
        power = float(np.sum(np.abs(state.torque * state.dq)))
        if power > limits.power:
            return f"Power limit: {power:.0f} W, limit {limits.power:.0f} W"
    return None


Version = tuple[int, int, int, int]
UPRIGHT = (0.0, -math.pi / 2, 0.0, -math.pi / 2, 0.0, 0.0)
"""Where UR arms stand when a new controller starts [rad]."""


class ControllerMachine:
    """A simulated UR controller with its arm.

    `tick` is one control cycle: scripts run, the arm moves, safety judges; then `output` tells
    the state at the start of that cycle. The same seed and inputs give the same outputs.

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
        self.core = Core(controlled, Safety(safety or WatchedLimits()), rate_hz, version)
        self._inputs, self._power = Inputs(self.core), Power(self.core)
        self._programs = Programs(self.core)
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
        self._power.step()
        core.scale()
        self._guard_watchdogs()
        try:
            self._programs.step()
        except Exception as error:
            self._programs.stop(f"internal fault of urtwin: {type(error).__name__}: {error}")
        try:
            watch(core)
            if core.safety.stopped:
                self._programs.stop("")
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

    def set_input(self, name: str, value: InputValue) -> None:
        """Write an RTDE input; it acts from the next cycle on and feeds its watchdog.

        Raises:
            InputError: No such input.
        """
        self._inputs.write(name, value)

    @staticmethod
    def compile(text: str) -> CompiledProgram:
        """Compile a script; touches nothing, so it may run in another thread.

        Raises:
            ScriptError: It does not compile, or is too long.
        """
        return compile_program(text)

    def run_script(self, text: str) -> None:
        """Run a script as if sent to a script port: it replaces the running program.

        What is wrong with it is said in `messages`.
        """
        self._programs.submit(text)

    def run_program(self, program: CompiledProgram) -> None:
        """Run a compiled script as if sent to a script port."""
        self._programs.start(program)

    def refuse(self, error: ScriptError) -> None:
        """Say why a script sent to a script port does not compile."""
        refuse(self.core, error)

    def protective_stop(self, reason: str) -> None:
        """Stop the arm hard and lock it."""
        self.core.protective_stop(reason)

    def power_on(self) -> bool:
        """Switch the arm on, brakes closed; whether that was possible."""
        return self._power.on()

    def power_off(self) -> bool:
        """Switch the arm off."""
        self._programs.stop("power off")
        return self._power.off()

    def brake_release(self) -> bool:
        """Open the brakes, switching the arm on first if need be."""
        return self._power.release()

    def unlock_protective_stop(self) -> bool:
        """Leave the protective stop; false in its first seconds, or if there is none."""
        unlocked = self.core.safety.unlock(self.core.now)
        if unlocked:
            self.core.rest_brake()
        return unlocked

    def restart_safety(self) -> bool:
        """End a fault, with the power off; whether there was one."""
        return self.core.safety.restart()

    def close_popup(self) -> None:
        """Close the program's message window."""
        self.core.blocking_popup = False

    def close_safety_popup(self) -> None:
        """Close the safety system's message window."""
        self.core.safety.popup = False

    def load(self, name: str, text: str) -> bool:
        """Load a program; whether it compiles. What is wrong is said in `messages`."""
        return self._programs.load(name, text)

    def play(self) -> bool:
        """Start the loaded program, or go on with the paused one; whether that was possible."""
        return self._programs.play()

    def pause(self) -> bool:
        """Pause the running program; whether there was one."""
        return self._programs.pause()

    def stop(self) -> bool:
        """Stop the program; the arm brakes. Whether there was one."""
        return self._programs.stop("")

    @property
    def program_running(self) -> bool:
        """Whether a program runs or is paused."""
        return self.core.playing

    @property
    def program_state(self) -> str:
        """`STOPPED`, `PLAYING` or `PAUSED`."""
        if not self.core.playing:
            return "STOPPED"
        return "PAUSED" if self.core.paused else "PLAYING"

    @property
    def program_name(self) -> str:
        """The program that runs, or the loaded one; empty for none."""
        return self._programs.name

    @property
    def robot_mode(self) -> RobotMode:
        """The robot mode."""
        return self.core.mode

    @property
    def safety_mode(self) -> SafetyMode:
        """The safety mode."""
        return self.core.safety.mode

    def _fail(self, reason: str) -> None:
        """Switch off after what no real arm does, such as motion without bounds."""
        self._programs.stop("")
        self._power.off()
        self.core.safety.fail(reason, self.core.now)
        self.core.say(reason, "safety", 0, MessageKind.STOP)

    def _guard_watchdogs(self) -> None:
        starved = self.core.starved() if self.core.playing else None
        if starved is not None:
            self._bite(starved)

    def _bite(self, watchdog: InputWatchdog) -> None:
        text = f"RTDE watchdog: {watchdog.variable} was not written for {watchdog.period:.3f} s"
        if watchdog.action == "pause":
            if not self.core.paused:
                self.core.say(text, "controller", 2)
                self._programs.pause()
            return
        self.core.say(text, "controller", 1)
        self._programs.stop(text)
