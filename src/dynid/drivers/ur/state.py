"""What a UR controller says of itself before anything moves."""

from __future__ import annotations

from dataclasses import dataclass

from dynid.core.arrays import Array, frozen
from dynid.core.errors import JobError
from dynid.drivers.ur.commands import Dashboard
from dynid.drivers.ur.link import RtdeLink
from dynid.protocol.dashboard import value
from dynid.protocol.fields import OUTPUTS

_ASKED = (
    "actual_q",
    "actual_qd",
    "target_q",
    "target_qd",
    "joint_temperatures",
    "robot_mode",
    "safety_mode",
    "runtime_state",
    "target_speed_fraction",
    "payload",
    "payload_cog",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerState:
    """A look at a controller; all arrays (n)."""

    host: str
    version: tuple[int, int, int, int]
    """Major, minor, bugfix and build number of its software."""
    model: str
    """What it calls its robot, such as `UR5`; empty if it does not say."""
    remote: bool | None
    """Whether it may be controlled from outside; None if it has no such switch."""
    rate_hz: float
    """Control cycles a second."""
    q: Array
    """Positions [rad]."""
    target_qd: Array
    """Velocities that it aims at [rad/s]."""
    temperature: Array
    """Joint temperatures [degC]."""
    robot_mode: int
    safety_mode: int
    runtime_state: int
    speed_fraction: float
    """The speed slider, 0 to 1."""
    payload: float | None
    """Mass that it reckons with [kg]; None if it does not say."""
    payload_cog: Array | None
    """(3) its centre in the flange's frame [m]; None if it does not say."""


def inspect(host: str) -> ControllerState:
    """Ask a controller for its state.

    Args:
        host: Name or address of the controller.

    Raises:
        JobError: Nobody answers there, or what answers is no UR controller.
    """
    with RtdeLink(host) as link:
        names = [name for name in _ASKED if OUTPUTS[name].exists_in(link.version[:3])]
        recipe = link.ask_outputs(names)
        link.start()
        packages = link.packages()
        while not packages:
            packages = link.packages()
        version, rate_hz = link.version, link.rate_hz
    values = dict[str, object]()
    start = 0
    for name, kind in zip(recipe.names, recipe.types, strict=True):
        numbers = packages[-1][start : start + kind.count]
        values[name] = numbers if kind.count > 1 else numbers[0]
        start += kind.count
    model, remote = _dashboard(host, version)

    def vector(name: str, size: int = 6) -> Array:
        return frozen(values[name], shape=(size,), name=name)  # pyright: ignore[reportArgumentType]

    def number(name: str) -> float:
        return float(values[name])  # pyright: ignore[reportArgumentType]

    return ControllerState(
        host=host,
        version=version,
        model=model,
        remote=remote,
        rate_hz=rate_hz,
        q=vector("actual_q"),
        target_qd=vector("target_qd"),
        temperature=vector("joint_temperatures"),
        robot_mode=int(number("robot_mode")),
        safety_mode=int(number("safety_mode")),
        runtime_state=int(number("runtime_state")),
        speed_fraction=number("target_speed_fraction"),
        payload=number("payload") if "payload" in values else None,
        payload_cog=vector("payload_cog", 3) if "payload_cog" in values else None,
    )


def _dashboard(host: str, version: tuple[int, int, int, int]) -> tuple[str, bool | None]:
    """The robot's model and whether it is in remote control, as far as it says."""
    try:
        board = Dashboard(host)
    except JobError:
        # PolyScope X has no dashboard server; what it would say stays unknown.
        return "", None
    try:
        model = value(board.ask("get robot model"))
        remote = None
        if version[:2] >= (5, 6):
            remote = value(board.ask("is in remote control")).lower() == "true"
        board.ask("quit")
    finally:
        board.close()
    return model, remote
