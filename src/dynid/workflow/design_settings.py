"""Settings of `dynid design`, and the limits of a motion as a value that its file keeps."""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, cast

from dynid.constraints import (
    CLEARANCE,
    FLOORS,
    MARGIN,
    PRESETS,
    MotionConstraints,
    Scene,
    paper_constraints,
    safe_constraints,
    scene_from_json,
)
from dynid.core import InputError, JsonFields, load_object
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
        for name, value, known in (
            ("--limits", self.preset, PRESETS),
            ("--floor", self.floor, FLOORS if isinstance(self.floor, str) else (self.floor,)),
        ):
            if value not in known:
                raise InputError("unknown word", where=name, value=value, limit=", ".join(PRESETS))
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
        return safe_constraints(
            self.equipped(robot),
            self._scene(),
            collision=self.collision,
            clearance=self.clearance,
            margin=self.margin_percent / 100.0,
            floor=self.floor,
        )

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {
            "preset": self.preset,
            "collision": self.collision,
            "scene": None if self.scene is None else dict(self.scene),
            "scene_file": self.scene_file or None,
            "floor": self.floor,
            "tool": None if self.tool is None else list(self.tool),
            "payload": None if self.payload is None else list(self.payload),
            "margin_percent": self.margin_percent,
            "clearance": self.clearance,
            "mesh_dirs": list(self.mesh_dirs),
        }

    def _scene(self) -> Scene | None:
        if self.scene is None:
            return None
        return scene_from_json(JsonFields(self.scene), self.scene_file or "scene")


def given_limits(
    preset: str, collision: bool, scene: Path | None, base: DesignLimits | None = None, **more: Any
) -> DesignLimits:
    """Limits from the command line's words.

    Args:
        preset: `safe` or `paper`.
        collision: Whether to look at collisions.
        scene: The scene file; None for the one of `base`.
        base: What holds where nothing is given.
        more: Other fields of `DesignLimits`; None where they are not given.

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


def mesh_folders(given: Sequence[Path] | None) -> tuple[str, ...] | None:
    """The folders of `--mesh-dir`, so that they are found again from elsewhere.

    Raises:
        InputError: One that is none.
    """
    for folder in given or ():
        if not os.path.isdir(folder):
            raise InputError("there is no such folder", where="--mesh-dir", value=str(folder))
    return tuple(str(folder.resolve()) for folder in given) if given else None


def parse_floor(text: str | None) -> float | str | None:
    """Read `--floor`: a height [m], `mount` or `none`.

    Raises:
        InputError: Something else.
    """
    if text is None or text in FLOORS:
        return text
    return _numbers(text, "--floor", (1,), "HEIGHT, mount or none")[0]


def parse_tool(text: str | None) -> tuple[float, ...] | None:
    """Read `--tool`: x, y, z of the tool's point in the flange's frame [m].

    Raises:
        InputError: Other than three numbers.
    """
    return None if text is None else _numbers(text, "--tool", (3,), "X,Y,Z")


def parse_payload(text: str | None) -> tuple[float, ...] | None:
    """Read `--payload`: a mass [kg], or a mass and its centre x, y, z [m].

    Raises:
        InputError: Other than one or four numbers, or a negative mass.
    """
    if text is None:
        return None
    numbers = _numbers(text, "--payload", (1, 4), "KG or KG,X,Y,Z")
    if numbers[0] < 0:
        raise InputError("a negative mass", where="--payload", value=text)
    return numbers if len(numbers) == 4 else (*numbers, 0.0, 0.0, 0.0)


def _numbers(text: str, where: str, counts: tuple[int, ...], form: str) -> tuple[float, ...]:
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) not in counts or not all(math.isfinite(number) for number in numbers):
        raise InputError("not the numbers that this needs", where=where, value=text, limit=form)
    return numbers


def limits_from_json(fields: JsonFields) -> DesignLimits:
    """The inverse of `DesignLimits.to_json`; what release 0.1 did not know has its default.

    Raises:
        InputError: Missing keys or values of the wrong type.
    """
    preset, collision = fields.text("preset"), fields.get("collision")
    if not isinstance(collision, bool):
        raise InputError("collision must be true or false", value=collision)
    found: dict[str, Any] = {}
    if fields.get("scene") is not None:
        found["scene"] = fields.object("scene").values
    if fields.get("floor") is not None:
        floor = fields.get("floor")
        found["floor"] = floor if isinstance(floor, str) else fields.number("floor")
    for name in ("margin_percent", "clearance"):
        if fields.get(name) is not None:
            found[name] = fields.number(name)
    for name in ("tool", "payload"):
        if fields.get(name) is not None:
            found[name] = tuple(fields.vector(name).tolist())
    found["mesh_dirs"] = tuple(map(str, cast("list[str]", fields.get("mesh_dirs") or [])))
    scene_file = str(fields.get("scene_file") or "")
    return DesignLimits(preset=preset, collision=collision, scene_file=scene_file, **found)
