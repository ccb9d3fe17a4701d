"""What `dynid design` can be told."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from dynid.constraints import PRESETS
from dynid.core import InputError
from dynid.excitation import CRITERIA, METHODS
from dynid.trajectory import FAMILY_NAMES

PURPOSES = {"prediction": "prediction", "parameters": "a-opt", "cond": "cond"}
"""What a model is for, and the criterion that serves it."""
DEFAULT_STARTS = {"prediction": 4, "a-opt": 4, "d-opt": 4}
"""Of the gradient method, where neither starts nor a budget are given: seeds of smooth criteria
end within 2 % of each other."""
MOST_STARTS = 12
"""The same where extreme eigenvalues make many local minima."""
HARMONICS = 5
"""The paper's."""
HIGHEST_HZ = 1.0
"""Of the harmonics of a prediction design, to which servo loops follow without error: twice the
paper's 0.5 Hz lowers the torque error of ten seconds by 13 %, 1.4 Hz by 3 % more."""
MOST_DEFAULT_HARMONICS = 12
POINTS_A_SECOND = 1.5
"""Rests of a point-to-point motion."""
FOURIER = ("fourier", "modified-fourier", "fourier-quintic")
POPULATION, GENERATIONS = 300, 5
"""The paper's."""
MOST_HARMONICS = 100
PATIENCE = 60
"""Starts without a better motion that end a search with a budget."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignSettings:
    """How to design.

    Raises:
        InputError: A word that is not known, or a number that makes no sense.
    """

    method: str = "gradient"
    """`gradient`, or `ga` for the paper's genetic algorithm."""
    purpose: str = ""
    """One of `PURPOSES`; empty for `prediction`, and `cond` with the paper's method or limits."""
    motions: tuple[str, ...] = ()
    """Designs, recordings or poses that the model is for; empty for the whole workspace."""
    criterion: str = ""
    """One of `CRITERIA`, in place of the purpose's."""
    accuracy_percent: float | None = None
    """Torque error that the shortest motion shall reach [%]; None for the period as it is."""
    trajectory: str = "fourier"
    """One of `FAMILY_NAMES`."""
    harmonics: int | None = None
    """Of the series; a B-spline gets as many free numbers, `points` as many points.
    None for the default, see `order`."""
    period_s: float = 10.0
    """Time of one period [s]."""
    rate_hz: float = 125.0
    """Samples a second at which criteria are computed."""
    population: int = POPULATION
    """Of the genetic algorithm."""
    generations: int = GENERATIONS
    """Of the genetic algorithm, after the random one."""
    starts: int | None = None
    """Of the gradient method; None for the default, or for as many as fit into the budget."""
    budget_s: float | None = None
    """Time [s], which makes the result depend on the machine; None to count starts alone."""
    seed: int = 0
    """Of all random numbers."""
    limits: str = "safe"
    """`safe`: all that is known of the robot; `paper`: position, velocity, acceleration."""
    scene: str | None = None
    """Scene file: what stands around the robot and what it carries."""
    collision: bool = True
    """Whether collisions are looked at, with `safe`."""
    floor: float | str | None = None
    """Height of the floor in the base frame [m], `none`, or None for the mounting plane."""
    tool: tuple[float, ...] | None = None
    """(3) the tool's point in the flange's frame [m]; None for the robot's own."""
    payload: tuple[float, ...] | None = None
    """(4) mass that the flange carries [kg] and its centre [m]; None for the robot's own."""
    margin_percent: float | None = None
    """Of the limits, kept free; None for the usual."""
    clearance: float | None = None
    """Smallest distance of bodies [m]; None for the usual ones."""
    mesh_dirs: tuple[str, ...] | None = None
    """Folders where meshes of a URDF are looked for, beside the usual places."""
    frames: str = ""
    """`dh`, `mdh` or `urdf`; empty for the robot's own."""
    mount: str | None = None
    """Mounting; None for the robot's own."""
    terms: str = "fc,fv,im"
    """Friction terms beside the inertial parameters."""
    start_pose: tuple[float, ...] | None = None
    """Where the motion starts and ends, for families that can [rad or m]."""
    noise: tuple[float, ...] | None = None
    """Standard deviation of each joint's torque, by which its rows are divided [N.m or N]."""
    previous: tuple[str, ...] = ()
    """Recordings whose information the new motion shall complete."""
    jobs: int = 1
    """Processes, the calling one included."""
    dask: str | None = None
    """Address of a Dask scheduler whose workers take part."""

    def __post_init__(self) -> None:
        for name, value, words in (
            ("--method", self.method, METHODS),
            ("--for", self.purpose, ("", *PURPOSES)),
            ("--criterion", self.criterion, ("", *CRITERIA)),
            ("--trajectory", self.trajectory, FAMILY_NAMES),
            ("--limits", self.limits, PRESETS),
        ):
            if value not in words:
                raise InputError(
                    "unknown word", where=name, value=value, limit=", ".join(filter(None, words))
                )
        if not 0.1 <= self.period_s <= 3600:
            raise InputError(
                "must be a time", where="--period", value=self.period_s, limit="0.1 to 3600 s"
            )
        least = 1 if self.trajectory in ("bspline", "points") else 2
        if not least <= self.order <= MOST_HARMONICS:
            raise InputError(
                "too few harmonics to move" if self.order < least else "too many harmonics",
                where="--harmonics",
                value=self.order,
                limit=f"{least} to {MOST_HARMONICS}",
            )
        accuracy = self.accuracy_percent
        if accuracy is not None and not 0.01 <= accuracy <= 100:
            raise InputError(
                "must be a share of the torque",
                where="--accuracy",
                value=accuracy,
                limit="0.01 to 100 %",
            )
        if self.seed < 0:
            raise InputError("must not be negative", where="--seed", value=self.seed)
        for name, numbers in (("--start", self.start_pose), ("--noise", self.noise)):
            if numbers is not None and not all(math.isfinite(number) for number in numbers):
                raise InputError("needs finite numbers", where=name, value=list(numbers))
        if self.noise is not None and not all(number > 0 for number in self.noise):
            raise InputError("must be positive", where="--noise", value=list(self.noise))

    @property
    def goal(self) -> str:
        """The purpose, its default filled in."""
        paper = self.method == "ga" or self.limits == "paper"
        return self.purpose or ("cond" if paper else "prediction")

    @property
    def minimised(self) -> str:
        """The name of the criterion, its default filled in."""
        return self.criterion or PURPOSES[self.goal]

    @property
    def order(self) -> int:
        """The number of harmonics, its default filled in."""
        if self.harmonics is not None:
            return self.harmonics
        if self.trajectory == "points":
            return max(round(POINTS_A_SECOND * self.period_s), 2)
        if self.minimised in ("cond", "cond+sigma") or self.trajectory not in FOURIER:
            return HARMONICS
        return min(max(round(HIGHEST_HZ * self.period_s), HARMONICS), MOST_DEFAULT_HARMONICS)

    @property
    def unused(self) -> tuple[str, ...]:
        """Options that were given and that the method has no use for."""
        genetic = self.method == "ga"
        given = {
            "--population": not genetic and self.population != POPULATION,
            "--generations": not genetic and self.generations != GENERATIONS,
            "--starts": genetic and self.starts is not None,
            "--dask": genetic and self.dask is not None,
        }
        return tuple(name for name, wrongly in given.items() if wrongly)

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        data: dict[str, Any] = asdict(self)
        for name in ("start_pose", "tool", "payload", "noise", "previous", "motions", "mesh_dirs"):
            if data[name] is not None:
                data[name] = list(data[name])
        return data

    @property
    def scene_path(self) -> Path | None:
        """The scene file."""
        return None if self.scene is None else Path(self.scene)
