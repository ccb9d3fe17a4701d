"""How to run a design, and the words of the command line for it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from dynid.core.errors import InputError
from dynid.experiment.plan import Payload
from dynid.simulation.thermal import Thermal

METHODS = ("program", "servoj")
DEGC = (-40, 120)
"""Joint temperatures that are believed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSettings:
    """How to run a design; what is None is not asked for.

    Raises:
        InputError: An unknown method, or a number that makes no sense.
    """

    repeat: int = 3
    """Periods to record."""
    settle: bool = False
    """Move one period before them that is not recorded."""
    slow: float | None = None
    """Speed of a first pass, as a share."""
    warm_up_s: float = 0.0
    """Time to repeat the motion before the recording [s]."""
    thermal: Thermal = "cold"
    """Thermal state: set on the simulated arm, noted down for a real one."""
    seed: int = 0
    """Seed of the simulated noise."""
    method: str = "program"
    """`program`: the controller evaluates the motion; `servoj`: set points are streamed."""
    robot: str | None = None
    """The robot, where the design's has moved."""
    mount: str | None = None
    """Mounting, where it is not the design's."""
    scene: str | None = None
    """Scene file, where the surroundings are not the design's."""
    payload: Payload = field(default_factory=Payload)
    """What the robot carries."""

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise InputError(
                "unknown method", where="--method", value=self.method, limit=", ".join(METHODS)
            )
        if self.repeat < 1:
            raise InputError(
                "needs a period to record", where="--repeat", value=self.repeat, limit="1 or more"
            )
        if not (math.isfinite(self.warm_up_s) and self.warm_up_s >= 0):
            raise InputError(
                "the time to warm up",
                where="--warm-up",
                value=self.warm_up_s,
                limit="0 s or more",
            )
        if self.slow is not None and not 0.0 < self.slow <= 1.0:
            raise InputError(
                "the share of the speed",
                where="--slow",
                value=self.slow,
                limit="above 0, at most 1",
            )


def parse_thermal(text: str) -> Thermal:
    """Read `--thermal`: `cold`, `warm` or degC.

    Raises:
        InputError: Another word.
    """
    if text in ("cold", "warm"):
        return text
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not DEGC[0] <= value <= DEGC[1]:
        raise InputError(
            "unknown thermal state",
            where="--thermal",
            value=text,
            limit=f"cold, warm, or {DEGC[0]} to {DEGC[1]} degC",
        )
    return value


def parse_payload(text: str | None) -> Payload:
    """Read `--payload`: a mass [kg], or a mass and its centre x, y, z [m].

    Raises:
        InputError: Other than one or four numbers, or a negative mass.
    """
    if text is None:
        return Payload()
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    sound = all(math.isfinite(number) for number in numbers)
    if len(numbers) not in (1, 4) or not sound or numbers[0] < 0:
        raise InputError(
            "a payload is a mass, or a mass and three coordinates",
            where="--payload",
            value=text,
            limit="KG or KG,X,Y,Z",
        )
    x, y, z = numbers[1:] or (0.0, 0.0, 0.0)
    return Payload(mass=numbers[0], com=(x, y, z))
