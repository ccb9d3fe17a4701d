"""One simulated controller in this process, from its robot's name to the end of its loop."""

import os
import signal
import time
from collections.abc import Callable
from typing import Any, TextIO

from dynid import core, simulation
from dynid.robot import PARAMETERS, load_robot
from urtwin.machine import ControllerMachine
from urtwin.server import clock, loop
from urtwin.settings import CB_HZ, E_SERIES, E_SERIES_HZ, PORTS, ControllerSettings

_CB, _E_SERIES = (3, 15, 8, 106339), (5, 12, 0, 1101319)


def serve(
    settings: ControllerSettings,
    stream: TextIO,
    ready: Callable[[dict[str, Any]], None],
) -> None:
    """Simulate a controller until Ctrl-C, SIGTERM, or the end of the parent process.

    `stream` tells people what happens; `ready` is called once, when clients can connect, with
    what they need to know.

    Raises:
        InputError: A robot that cannot be simulated, an address that is none, or no such folder.
        JobError: A port is taken.
        MissingExtraError: MuJoCo is not installed.
    """
    log = loop.Log(stream, "urtwin")
    robot = load_robot(settings.robot)
    e_series = robot.name.endswith("e")
    if settings.version is not None:
        e_series = settings.version[0] >= E_SERIES
    rate = settings.rate or (E_SERIES_HZ if e_series else CB_HZ)
    version = _CB if rate == CB_HZ else _E_SERIES
    if settings.version is not None:
        version = (*settings.version, version[3])
    arm = simulation.simulated_arm(robot, serial=simulation.SERIAL)
    machine = ControllerMachine(
        arm, rate_hz=rate, thermal=settings.start, seed=settings.seed, version=version
    )
    server = loop.ControllerServer(machine, settings, log)
    try:
        fast = clock.keep_time(real_time=not settings.virtual_time)
        stopped = _Stop(settings.parent)
        about = {
            "robot": robot.name,
            "host": settings.host,
            "ports": PORTS,
            "rate_hz": rate,
            "version": ".".join(map(str, version)),
            "virtual_time": settings.virtual_time,
            "seed": settings.seed,
            "real_time_priority": fast,
            "pid": os.getpid(),
        }
        start = machine.output("joint_temperatures")
        if settings.truth is not None:
            core.write_json(settings.truth, _truth(machine, about) | {"start_degC": start})
        ready(about)
        begun, worked = time.monotonic(), time.process_time()
        server.run(stopped)
        if settings.report is not None:
            spent = {"wall_s": time.monotonic() - begun, "cpu_s": time.process_time() - worked}
            core.write_json(settings.report, _report(server, machine) | spent)
        log.say(f"stopped by {stopped.why} after {machine.core.cycles} cycles")
    finally:
        server.close()


class _Stop:
    """Whether it is time to stop: a signal came, or the parent process is gone."""

    def __init__(self, parent: int | None) -> None:
        self._parent = parent
        self.why = ""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._hear)

    def __call__(self) -> bool:
        if self._parent is not None and os.getppid() != self._parent:
            self.why = self.why or "the end of its parent process"
        return bool(self.why)

    def _hear(self, number: int, frame: object) -> None:
        self.why = signal.Signals(number).name


def _truth(machine: ControllerMachine, about: dict[str, Any]) -> dict[str, Any]:
    truth = machine.core.arm.truth
    return {
        "robot": about["robot"],
        "label": truth.label,
        "seed": about["seed"],
        "rate_hz": about["rate_hz"],
        "parameters": [*PARAMETERS, "Fc", "Fv", "Im"],
        "frame": "joint frames, tensors about their origins; Fc and Fv at reference_degC",
        "reference_degC": truth.friction.reference_degC,
        "links": truth.standard_parameters.tolist(),
        "drive_gain": truth.gain.tolist(),
    }


def _report(server: loop.ControllerServer, machine: ControllerMachine) -> dict[str, Any]:
    cycles = machine.core.cycles
    shares = (50.0, 99.0, 99.9, 100.0)
    late = server.pace.lateness_us(*shares)
    return {
        "cycles": cycles,
        "controller_s": cycles * machine.cycle,
        "late_us": {f"p{share:g}": value for share, value in zip(shares, late, strict=True)},
        "slips": server.pace.slips,
    }
