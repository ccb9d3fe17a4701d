"""The dashboard server, the programs that it can load, and the command lines of pendants.

PolyScope saves `work.urp` together with `work.script`, which is what runs: `load work.urp` takes
`work.script` of the folder, with or without a file `work.urp` beside it. UR's own client library
switches the robot on by lines on the script ports (src/primary/primary_client.cpp): software 10 has
no dashboard server.
"""

import re
from collections.abc import Callable
from pathlib import Path, PurePosixPath

from dynid.core import InputError
from dynid.protocol import dashboard as words
from urtwin.machine import ControllerMachine
from urtwin.urscript import MAX_CHARACTERS

FindProgram = Callable[[str], str | None]
"""The text of a program, or None if there is none of that name."""
_ON_THE_ROBOT = "programs"
_SUFFIXES = (".urp", ".script")
LONGEST_LINE = 4096
"""The longest command taken [bytes]."""
_SPEED = re.compile(r"set speed (\d+(?:\.\d*)?|\.\d+)")
_LONGEST = 60


def program_folder(folder: Path) -> FindProgram:
    """Finds the programs of a folder, the robot's `/programs`; each is read when it is loaded.

    Raises:
        InputError: It is no folder.
    """
    if not folder.is_dir():
        raise InputError("there is no such folder of programs", where=str(folder))
    root = folder.resolve()

    def find(name: str) -> str | None:
        parts = PurePosixPath(name).parts
        if parts[:1] == ("/",):
            parts = parts[2:] if parts[1:2] == (_ON_THE_ROBOT,) else parts[1:]
        is_program = bool(parts) and PurePosixPath(parts[-1]).suffix in _SUFFIXES
        path = root.joinpath(*parts).with_suffix(".script") if is_program else root
        try:
            path = path.resolve(strict=True)
            if not path.is_relative_to(root) or path.stat().st_size > MAX_CHARACTERS:
                return None
            return path.read_text(encoding="utf-8")
        except (OSError, ValueError):
            # ValueError: a name that no file can have, or a file that is no text.
            return None

    return find


class DashboardSession:
    """What the dashboard knows of one client.

    Programs cannot be uploaded to the dashboard: `load` takes those that `programs` finds.
    """

    def __init__(
        self, machine: ControllerMachine, model: str, serial: str, programs: FindProgram
    ) -> None:
        self._machine, self._programs = machine, programs
        self._rest = b""
        self._role = self._mode = "NONE"
        self.over = False
        """Whether the client said goodbye."""
        self._answers: dict[str, Callable[[], str]] = {
            "is in remote control": lambda: "true",
            "get serial number": lambda: serial,
            "get robot model": lambda: model,
            "version": lambda: _dotted(machine),
            "polyscopeversion": lambda: f"URSoftware {_dotted(machine)} (simulated by dynid)",
            "play": lambda: self._try("play", machine.play(), words.STARTING),
            # Stopping what stands still succeeds on the real pendant too.
            "stop": lambda: _after(machine.stop, words.STOPPED),
            "pause": lambda: self._try("pause", machine.pause(), words.PAUSING),
            "running": lambda: f"Program running: {str(machine.program_running).lower()}",
            "robotmode": lambda: f"Robotmode: {machine.core.mode.name}",
            "safetymode": lambda: f"Safetymode: {machine.core.safety.mode.name}",
            "safetystatus": lambda: f"Safetystatus: {machine.core.safety.mode.name}",
            "programstate": lambda: f"{machine.core.runtime.name} {machine.program_name or 'null'}",
            "get loaded program": self._loaded,
            "isprogramsaved": lambda: f"true {machine.loaded_name or 'null'}",
            "power on": lambda: self._try("power on", machine.power_on(), words.POWERING_ON),
            "power off": lambda: self._try("power off", machine.power_off(), words.POWERING_OFF),
            "brake release": lambda: self._try(
                "brake release", machine.brake_release(), words.RELEASING
            ),
            "unlock protective stop": self._unlock,
            "close popup": self._close_popup,
            "close safety popup": lambda: "closing safety popup",
            "getuserrole": lambda: self._role,
            "get operational mode": lambda: self._mode,
            "clear operational mode": self._clear_mode,
            "restart safety": self._restart_safety,
            "savelog": lambda: words.LOG_SAVED,
            "shutdown": lambda: _after(machine.power_off, self._end(words.SHUTTING_DOWN)),
            "quit": lambda: self._end(words.DISCONNECTED),
        }
        self._with_text: dict[str, Callable[[str], str]] = {
            "load installation": lambda name: f"Loading installation: {name}",
            "load": self._load,
            "popup": lambda _: "showing popup",
            "addtolog": lambda text: "Added log message" if text else "No log message to add",
            "setuserrole": self._set_role,
            "set operational mode": self._set_mode,
            "generate flight report": lambda _: words.NO_REPORT,
            "generate support file": lambda _: words.NO_SUPPORT_FILE,
        }

    def receive(self, data: bytes) -> list[str]:
        """Take what the client sent; return one reply for each whole line."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        replies = [
            self.answer(line.decode(errors="replace").strip()) for line in lines if not self.over
        ]
        if len(self._rest) > LONGEST_LINE:
            self.over = True
            replies.append(f"no command is longer than {LONGEST_LINE} bytes")
        return replies

    def answer(self, line: str) -> str:
        """The reply to one command."""
        command = " ".join(line.split()).lower()
        version = self._machine.core.version[:2]
        plain = self._answers.get(command)
        if plain is not None and words.known_to(command, version):
            return plain()
        for start, answer in self._with_text.items():
            if command == start or command.startswith(start + " "):
                if not words.known_to(start, version):
                    break
                return answer(" ".join(line.split())[len(start) :].strip())
        return words.not_understood(line[:200])

    def _try(self, command: str, done: bool, reply: str) -> str:
        return reply if done else words.failed(command)

    def _unlock(self) -> str:
        unlocked = self._machine.unlock_protective_stop() or not self._machine.core.safety.stopped
        return words.UNLOCKING if unlocked else words.UNLOCK_TOO_EARLY

    def _loaded(self) -> str:
        name = self._machine.loaded_name
        return f"Loaded program: {name}" if name else words.NO_PROGRAM

    def _load(self, name: str) -> str:
        text = self._programs(name)
        if text is None:
            return f"File not found: {name}"
        if not self._machine.load(name, text):
            return f"Error while loading program: {name}"
        return f"Loading program: {name}"

    def _set_role(self, role: str) -> str:
        known = ("programmer", "operator", "none", "locked", "restricted")
        if role.lower() not in known:
            return f"Failed setting user role: {role}"
        self._role = role.upper()
        return f"Setting user role: {role}"

    def _set_mode(self, mode: str) -> str:
        if mode.lower() not in ("manual", "automatic"):
            return f"Failed setting operational mode: {mode}"
        self._mode = mode.upper()
        return f"Operational mode '{self._mode}' is set"

    def _clear_mode(self) -> str:
        self._mode = "NONE"
        return (
            f"No longer controlling the operational mode. Current operational mode: '{self._mode}'."
        )

    def _restart_safety(self) -> str:
        self._machine.power_off()
        self._machine.core.safety.restart()
        return "Restarting safety"

    def _close_popup(self) -> str:
        self._machine.core.blocking_popup = False
        return "closing popup"

    def _end(self, reply: str) -> str:
        self.over = True
        return reply


def _after(action: Callable[[], object], reply: str) -> str:
    action()
    return reply


def _dotted(machine: ControllerMachine) -> str:
    return ".".join(str(number) for number in machine.core.version)


_COMMANDS: dict[str, Callable[[ControllerMachine], object]] = {
    "power on": ControllerMachine.power_on,
    "power off": ControllerMachine.power_off,
    "set robotmode run": ControllerMachine.brake_release,
    "set unlock protective stop": ControllerMachine.unlock_protective_stop,
    "stop program": ControllerMachine.stop,
    "pause program": ControllerMachine.pause,
    "resume program": ControllerMachine.play,
    "run program": ControllerMachine.play,
    # The simulated arm is the real one here.
    "set real": lambda _: None,
    "set sim": lambda _: None,
}


def obey(text: str, machine: ControllerMachine) -> bool:
    """Do what a line of a script port says; whether it is such a command, else it is a program."""
    if len(text) > _LONGEST:
        return False
    line = " ".join(text.split()).lower()
    command = _COMMANDS.get(line)
    if command is not None:
        command(machine)
        return True
    speed = _SPEED.fullmatch(line)
    if speed is None:
        return False
    machine.set_input("speed_slider_mask", 1)
    machine.set_input("speed_slider_fraction", float(speed.group(1)))
    return True
