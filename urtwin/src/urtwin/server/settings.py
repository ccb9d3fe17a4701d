"""The settings of a controller, and its ports: clients cannot be told others."""

from dataclasses import dataclass
from pathlib import Path

from dynid.core import InputError
from dynid.protocol import dashboard, rtde
from dynid.simulation import Thermal

PRIMARY, SECONDARY, REALTIME = 30001, 30002, 30003
INTERPRETER = 30020
"""Takes statements for the running program while it is in interpreter mode."""
PORTS = {
    "dashboard": dashboard.PORT,
    "primary": PRIMARY,
    "secondary": SECONDARY,
    "realtime": REALTIME,
    "rtde": rtde.PORT,
    "interpreter": INTERPRETER,
}
READ_ONLY = {30011: PRIMARY, 30012: SECONDARY, 30013: REALTIME}
"""Ports that send what another does, and do not listen."""
CB_HZ, E_SERIES_HZ = 125.0, 500.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerSettings:
    """What to simulate, and where; `InputError` for a control rate that no UR controller has."""

    robot: str = "ur5"
    """Built-in name, URDF or robot file."""
    host: str = "127.0.0.1"
    """Address to listen on."""
    thermal: Thermal = "cold"
    """Temperatures at the start."""
    virtual_time: bool = False
    """Whether time goes as fast as the clients read."""
    hold: bool = False
    """Whether time stands still until the first client has started RTDE."""
    seed: int = 0
    """Seed of the measurement noise."""
    rate_hz: float | None = None
    """Control cycles a second; None: 500 for robots whose name ends in `e`, else 125."""
    version: tuple[int, int, int] | None = None
    """Software version; None: the one usual for the rate."""
    truth: Path | None = None
    """Where to write the truth behind the measurements."""
    report: Path | None = None
    """Where to write, at the end, how well time was kept."""
    programs: Path | None = None
    """Folder of the programs that the dashboard can load."""
    parent: int | None = None
    """The process without which the controller ends; None: it stays."""

    def __post_init__(self) -> None:
        if self.rate_hz is not None and self.rate_hz not in (CB_HZ, E_SERIES_HZ):
            raise InputError(
                "no UR controller has this control rate",
                value=f"{self.rate_hz:g} Hz",
                limit=f"{CB_HZ:g} Hz (CB-Series) or {E_SERIES_HZ:g} Hz (e-Series)",
            )
