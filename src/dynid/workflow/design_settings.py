"""Settings of `dynid design`, and the limits of a motion as a value that its file keeps."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from dynid.constraints import (
    CLEARANCE,
    FLOORS,
    MARGIN,
    PRESETS,
    MotionConstraints,
    paper_constraints,
    safe_constraints,
    scene_from_json,
)
from dynid.core import InputError, JsonFields, check_word, load_object
from dynid.excitation import CRITERIA, METHODS
from dynid.robot import RobotModel, with_tool
from dynid.trajectory import FAMILY_NAMES

PURPOSES = {"prediction": "prediction", "parameters": "a-opt", "cond": "cond"}
"""What a model is for, and the criterion that serves it."""
DEFAULT_STARTS = {"prediction": 6, "a-opt": 4, "d-opt": 4}
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
    """How to design; inputs are named by their files, as the design's file keeps them.

    Raises:
        InputError: A word that is not known, a number that makes no sense, or an input that is no
            file.
    """

    method: str = "gradient"
    """`gradient`, or `ga` for the paper's genetic algorithm."""
    purpose: str = ""
    """One of `PURPOSES`; empty for `prediction`, and `cond` with the paper's method or limits."""
    motions: tuple[str | Path, ...] = ()
    """Files of designs, recordings or poses that the model is for; empty: the whole workspace."""
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
    scene: str | Path | None = None
    """Scene file: surroundings and payload of the robot."""
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
    mesh_dirs: tuple[str | Path, ...] | None = None
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
    previous: tuple[str | Path, ...] = ()
    """Files of recordings whose information the new motion shall complete."""
    jobs: int = 1
    """Processes, the calling one included."""
    dask: str | None = None
    """Address of a Dask scheduler whose workers take part."""

    def __post_init__(self) -> None:
        if self.scene is not None:
            object.__setattr__(self, "scene", str(self.scene))
        for name in ("motions", "previous", "mesh_dirs"):
            object.__setattr__(self, name, _names(getattr(self, name), name))
        check_word(self.method, METHODS, "--method")
        check_word(self.purpose, ("", *PURPOSES), "--for")
        check_word(self.criterion, ("", *CRITERIA), "--criterion")
        check_word(self.trajectory, FAMILY_NAMES, "--trajectory")
        check_word(self.limits, PRESETS, "--limits")
        for what, where, value, low, high, unit in (
            ("must be a time", "--period", self.period_s, 0.1, 3600, "s"),
            ("must be a share of the torque", "--accuracy", self.accuracy_percent, 0.01, 100, "%"),
        ):
            if value is not None and not low <= value <= high:
                limit = f"{low} to {high} {unit}"
                raise InputError(what, where=where, value=value, limit=limit)
        least = 1 if self.trajectory in ("bspline", "points") else 2
        if not least <= self.order <= MOST_HARMONICS:
            raise InputError(
                "too few harmonics to move" if self.order < least else "too many harmonics",
                where="--harmonics",
                value=self.order,
                limit=f"{least} to {MOST_HARMONICS}",
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
        return _with_lists(asdict(self))


def _names(paths: Sequence[object] | None, setting: str) -> tuple[str, ...] | None:
    """Paths as text, which JSON holds."""
    if paths is None:
        return None
    given = [paths] if isinstance(paths, str | Path) else paths
    for path in given:
        if not isinstance(path, str | Path):
            raise InputError(
                "settings of a design name files",
                where=setting,
                value=type(path).__name__,
                next_step="Write it to a file first.",
            )
    return tuple(map(str, given))


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignLimits:
    """Which limits hold, and around what.

    Raises:
        InputError: Limits that are not known.
    """

    preset: str = "safe"
    """`safe` or `paper`."""
    collision: bool = True
    scene: Mapping[str, Any] | None = None
    """The scene file's content."""
    scene_file: str = ""
    """Where it was read."""
    floor: float | str = "mount"
    """Height of the floor in the base frame [m]; `mount`: at the mounting plane; `none`."""
    tool: tuple[float, ...] | None = None
    """(3) the tool's point in the flange's frame [m]; None for the robot's own."""
    payload: tuple[float, ...] | None = None
    """(4) mass that the flange carries [kg] and its centre [m]; None for the robot's own."""
    margin_percent: float = 100.0 * MARGIN
    """Of the limits of velocity, speed, torque, momentum and power, kept free."""
    clearance: float = CLEARANCE
    """Smallest distance between bodies [m]."""
    mesh_dirs: tuple[str, ...] = ()
    """Folders where meshes of the robot are looked for, beside the usual places."""

    def __post_init__(self) -> None:
        check_word(self.preset, PRESETS, "--limits")
        if isinstance(self.floor, str):
            check_word(self.floor, FLOORS, "--floor")
        for name, numbers, count in (("--tool", self.tool, 3), ("--payload", self.payload, 4)):
            if numbers is not None and not (
                len(numbers) == count and all(math.isfinite(x) for x in numbers)
            ):
                raise InputError(f"needs {count} numbers", where=name, value=list(numbers))
        if not 0 <= self.margin_percent < 100:
            raise InputError(
                "margin", where="--margin", value=self.margin_percent, limit="0 to 100 %"
            )

    def equipped(self, robot: RobotModel) -> RobotModel:
        """The robot with the tool and the payload.

        Raises:
            RobotError: They make no sense.
        """
        return with_tool(robot, tcp=self.tool, payload=self.payload)

    def constraints(self, robot: RobotModel) -> MotionConstraints:
        """The judge of these limits, for the robot with its tool.

        Raises:
            InputError: Contradictory bounds, a scene that is none, or one without room for the
                robot.
        """
        if self.preset == "paper":
            return paper_constraints(robot)
        scene = None
        if self.scene is not None:
            scene = scene_from_json(JsonFields(self.scene), self.scene_file or "scene")
        return safe_constraints(
            self.equipped(robot),
            scene,
            collision=self.collision,
            clearance=self.clearance,
            margin=self.margin_percent / 100.0,
            floor=self.floor,
        )

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return _with_lists(asdict(self)) | {"scene_file": self.scene_file or None}


def _with_lists(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Fields as JSON has them: tuples become lists."""
    return {name: list(x) if isinstance(x, tuple) else x for name, x in fields.items()}  # pyright: ignore[reportUnknownArgumentType]


def given_limits(
    preset: str,
    collision: bool,
    scene: str | Path | None,
    base: DesignLimits | None = None,
    **more: Any,
) -> DesignLimits:
    """Limits from the command line's words; what is None is that of `base`.

    Raises:
        InputError: An unknown word, a scene that cannot be read, or surroundings that would not be
            looked at.
    """
    blind = preset == "paper" or not collision
    for name, value in (("--scene", scene), ("--floor", more.get("floor"))):
        if blind and value is not None and value not in FLOORS:
            raise InputError(
                "it is looked at only with --limits safe and collisions on",
                where=name,
                value=str(value),
            )
    given: dict[str, Any] = {name: value for name, value in more.items() if value is not None}
    if scene is not None:
        given |= {"scene": load_object(scene).values, "scene_file": str(scene)}
    elif blind:
        given |= {"scene": None, "scene_file": ""}
    return replace(base or DesignLimits(), preset=preset, collision=collision, **given)


def limits_from_json(fields: JsonFields) -> DesignLimits:
    """The inverse of `DesignLimits.to_json`; what release 0.1 did not know has its default.

    Raises:
        InputError: Missing keys or values of the wrong type.
    """
    values = {name: value for name, value in fields.values.items() if value is not None}
    if not isinstance(values.get("collision"), bool):
        raise InputError("collision must be true or false", value=values.get("collision"))
    found: dict[str, Any] = {"preset": fields.text("preset"), "collision": values["collision"]}
    if "scene" in values:
        found["scene"] = fields.object("scene").values
    if "floor" in values:
        floor = values["floor"]
        found["floor"] = floor if isinstance(floor, str) else fields.number("floor")
    for name in {"margin_percent", "clearance"} & set(values):
        found[name] = fields.number(name)
    for name in {"tool", "payload"} & set(values):
        found[name] = tuple(fields.vector(name).tolist())
    folders = tuple(map(str, values.get("mesh_dirs", ())))
    return DesignLimits(**found, scene_file=str(values.get("scene_file", "")), mesh_dirs=folders)
