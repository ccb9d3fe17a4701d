"""Which variables are recorded of a UR controller, and what it reports before a run."""

from contextlib import closing
from dataclasses import dataclass

import numpy as np

from dynid import protocol
from dynid.core import Array, JobError, frozen
from dynid.drivers.driver import QUANTITIES, Cycle, mode_name
from dynid.drivers.ur.link import Dashboard, RtdeLink

INDEX, STATE = "output_int_register_24", "output_int_register_25"
"""Where our program writes the number of the sample, and what it is doing."""
FEED = "input_int_register_24"
"""What keeps our program alive."""
APPROACHING, MOVING, DONE = 0, 1, 2
"""Values of `STATE`."""
SIGNALS = {
    **{name: name for name in QUANTITIES},
    **{name: f"actual_{name}" for name in ("q", "qd", "current")},
    "temperature": "joint_temperatures",
}
"""Signals of a recording and the variables that they are."""
_CHANNELS = (
    *("timestamp", INDEX, STATE, "robot_mode", "safety_mode", "runtime_state"),
    *("robot_status_bits", "safety_status_bits", "speed_scaling", "target_speed_fraction"),
    *("joint_control_output", "joint_mode", "actual_momentum", "actual_main_voltage"),
    *("actual_robot_current", "actual_execution_time", "payload", "payload_cog"),
)
_NAMES = {INDEX: "index", FEED: "index", STATE: "program_state"}


def recorded_names(version: protocol.Version, index: str = INDEX) -> tuple[str, ...]:
    """The variables to ask a controller for: all of ours that its software has.

    `index` is where the number of the sample is found: `INDEX`, or `FEED` where it is streamed.
    """
    names = (*SIGNALS.values(), *(index if name == INDEX else name for name in _CHANNELS))
    return tuple(name for name in names if protocol.OUTPUTS[name].exists_in(version))


def recorded(version: protocol.Version, index: str = INDEX) -> "Layout":
    """The layout of `recorded_names`, without asking the controller."""
    names = recorded_names(version, index)
    return Layout.of(protocol.Recipe(names, tuple(protocol.OUTPUTS[name].type for name in names)))


@dataclass(frozen=True, slots=True)
class Layout:
    """Where the numbers of a package stand."""

    signals: tuple[tuple[str, slice], ...]
    """Signal of the recording and its numbers."""
    channels: tuple[tuple[str, int], ...]
    """Channel of the recording and its number."""
    places: dict[str, slice]
    """Variable and its numbers."""
    index: str
    """The variable with the number of the sample."""

    @classmethod
    def of(cls, recipe: protocol.Recipe) -> "Layout":
        """The layout of a recipe made from `recorded_names`."""
        places: dict[str, slice] = {}
        start = 0
        for name, kind in zip(recipe.names, recipe.types, strict=True):
            places[name] = slice(start, start + kind.count)
            start += kind.count
        channels: list[tuple[str, int]] = []
        vectors = set(SIGNALS.values())
        for name in (name for name in places if name not in vectors):
            place, label = places[name], _NAMES.get(name, name)
            count = place.stop - place.start
            labels = [label] if count == 1 else [f"{label}_{k + 1}" for k in range(count)]
            channels += zip(labels, range(place.start, place.stop), strict=True)
        signals = tuple((name, places[variable]) for name, variable in SIGNALS.items())
        return cls(signals, tuple(channels), places, INDEX if INDEX in places else FEED)

    def number(self, numbers: protocol.Numbers, name: str) -> float:
        """The number of a scalar variable."""
        start: int = self.places[name].start
        return float(numbers[start])

    def cycle(self, numbers: protocol.Numbers) -> Cycle:
        """What the watchdog looks at."""
        return Cycle(
            timestamp=self.number(numbers, "timestamp"),
            index=int(self.number(numbers, self.index)),
            q=np.array(numbers[self.places["actual_q"]]),
            qd=np.array(numbers[self.places["actual_qd"]]),
            target_q=np.array(numbers[self.places["target_q"]]),
            robot_mode=int(self.number(numbers, "robot_mode")),
            safety_mode=int(self.number(numbers, "safety_mode")),
            runtime_state=int(self.number(numbers, "runtime_state")),
            speed_scaling=self.number(numbers, "speed_scaling"),
            speed_fraction=self.number(numbers, "target_speed_fraction"),
            freedrive=_teaches(self.number(numbers, "robot_status_bits")),
        )


def _teaches(status_bits: float) -> bool:
    return bool(int(status_bits) & protocol.RobotStatus.TEACH_BUTTON)


_ASKED = (
    *("actual_q", "target_qd", "joint_temperatures", "robot_mode", "safety_mode", "runtime_state"),
    *("robot_status_bits", "target_speed_fraction", "payload", "payload_cog", "tcp_offset"),
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
    """Whether it may be controlled from outside; None if it has no such switch or does not say."""
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
    tcp_offset: Array | None = None
    """(3) the tool's point in the flange's frame [m]; None if it does not say."""
    round_trip_s: float = 0.0
    """How long it takes to answer, median of some [s]: so late a stop arrives."""
    freedrive: bool = False
    """Whether somebody presses the teach button, to move the arm by hand."""


def inspect(host: str) -> ControllerState:
    """Ask a controller, by its name or address, for its state.

    Raises:
        JobError: Nobody answers there, or what answers is no UR controller.
    """
    with closing(RtdeLink(host)) as link:
        names = [name for name in _ASKED if protocol.OUTPUTS[name].exists_in(link.version[:3])]
        recipe = link.ask_outputs(names)
        version, rate_hz, round_trip_s = link.version, link.rate_hz, link.answer_time()
        link.start()
        values = recipe.by_name(link.packages()[-1])
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
        tcp_offset=vector("tcp_offset")[:3] if "tcp_offset" in values else None,
        round_trip_s=round_trip_s,
        freedrive=_teaches(number("robot_status_bits")),
    )


_ENDING_S = 0.5
"""Controller time in which a program comes to its end [s]."""


def require_free(host: str) -> None:
    """Refuse a controller on which a program runs: ours would take its place.

    Raises:
        JobError: There is one, or nobody answers there.
    """
    state = protocol.RuntimeState.STOPPED
    with closing(RtdeLink(host)) as link:
        link.ask_outputs(["runtime_state"])
        link.start()
        # Of the pass before ours the program may still be ending.
        for _ in range(round(_ENDING_S * link.rate_hz)):
            state = int(link.packages()[-1][0])
            if state == protocol.RuntimeState.STOPPED:
                return
    raise JobError(
        "another program runs on the controller",
        where=host,
        value=mode_name(protocol.RuntimeState, state),
        next_step="Start again when it has ended.",
    )


def _dashboard(host: str, version: tuple[int, int, int, int]) -> tuple[str, bool | None]:
    """The robot's model and whether it is in remote control, as far as it says."""
    try:
        board = Dashboard(host)
    except JobError:
        # PolyScope X has no dashboard server; what it would say stays unknown.
        return "", None
    with closing(board):
        model, remote = (
            protocol.value(board.ask(command)) if protocol.known_to(command, version[:2]) else ""
            for command in ("get robot model", "is in remote control")
        )
        board.ask("quit")
    return model, remote.lower() == "true" if remote else None
