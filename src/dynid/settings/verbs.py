"""The settings of the verbs."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.core import InputError, check_word

if TYPE_CHECKING:
    from dynid.excitation import DesignOptimiser
    from dynid.identification import Estimator
    from dynid.regressor import FrictionTerms
    from dynid.robot import RobotLike
    from dynid.simulation import Thermal

from dynid.settings.options import Settings, check_options, flag, numbers, option, word_of


def _height(text: str, where: str) -> float | str:
    if text in ("mount", "none"):
        return text
    return numbers(text, where, (1,), "HEIGHT, mount or none")[0]


def _load(text: str, where: str) -> tuple[float, ...]:
    load = numbers(text, where, (1, 4), "KG or KG,X,Y,Z")
    if load[0] < 0:
        raise InputError("a negative mass", where=where, value=text)
    return load if len(load) == 4 else (*load, 0.0, 0.0, 0.0)


def _folder(text: str, where: str) -> str:
    """Absolute, so that it is found again from elsewhere."""
    folder = Path(text)
    if not folder.is_dir():
        raise InputError("there is no such folder", where=where, value=text)
    return str(folder.resolve())


def _words(text: str, where: str) -> tuple[str, ...]:
    return tuple(text.split(","))


def _terms(text: str, where: str) -> "FrictionTerms":
    from dynid.regressor import parse_terms

    return parse_terms(text)


DEGC = (-40, 120)
"""Joint temperatures that are believed."""


def parse_thermal(text: str, where: str = "--thermal") -> "Thermal":
    """Read a thermal state: `cold`, `warm` or degC.

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
        limit = f"cold, warm, or {DEGC[0]} to {DEGC[1]} degC"
        raise InputError("unknown thermal state", where=where, value=text, limit=limit)
    return value


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneSettings(Settings):
    """Around what a motion is judged; None for what the design says, or for the robot's own."""

    mount: str | None = option(
        None, "floor|wall|ceiling|tilt:DEG", "Mounting; default: that of the file."
    )
    scene: str | Path | None = option(
        None, "SCENE.json", "Surroundings; default: those of the design."
    )
    mesh_dirs: tuple[str | Path, ...] | None = option(
        None,
        "DIR",
        "Where meshes of a URDF are; may be repeated.",
        "--mesh-dir",
        parse=_folder,
        many=True,
    )
    floor: float | str | None = option(
        None,
        "HEIGHT|none",
        "Floor, wall or ceiling, in the base frame [m]. [default: the mounting plane]",
        parse=_height,
    )
    tool: tuple[float, ...] | None = option(
        None,
        "X,Y,Z",
        "Tool point in the flange's frame [m].",
        parse=partial(numbers, counts=(3,), form="X,Y,Z"),
    )
    payload: tuple[float, ...] | None = option(
        None, "KG[,X,Y,Z]", "Mass at the flange [kg], its centre [m].", parse=_load
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitSettings(SceneSettings):
    """What a motion is held to; None for what the design says, or for the usual."""

    limits: str = option(
        "safe", ("safe", "paper"), "safe: all known limits; paper: q, dq and ddq alone."
    )
    collision: bool = flag(True, "--no-collision", "Do not check collisions.")
    margin_percent: float | None = option(
        None,
        "PERCENT",
        "Margin to limits of speed, torque and power. [default: 5]",
        "--margin",
        least=0,
        most=99,
    )
    clearance: float | None = option(
        None, "M", "Smallest distance of bodies [m]. [default: 0.01]", least=0.001, most=1
    )


PURPOSES = {"prediction": "prediction", "parameters": "a-opt", "cond": "cond"}
"""What a model is for, and the criterion that serves it."""
HARMONICS = 5
"""The paper's."""
HIGHEST_HZ = 1.0
"""Of the harmonics of a prediction design, to which servo loops follow without error: twice the
paper's 0.5 Hz lowers the torque error of ten seconds by 13 %, 1.4 Hz by 3 % more."""
MOST_DEFAULT_HARMONICS = 12
MOST_HARMONICS = 100
LONGEST_S = 600.0
"""Of a period, and of the motion that `--accuracy` may ask for: at 125 Hz the search takes a minute
of CPU and 0.6 GB there, and a hundred harmonics reach 0.17 Hz alone."""
POINTS_A_SECOND = 1.5
"""Rests of a point-to-point motion."""
FOURIER = ("fourier", "modified-fourier", "fourier-quintic")
PERIOD_S, POPULATION, GENERATIONS = 10.0, 300, 5
"""The paper's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignSettings(LimitSettings):
    """How to design; inputs are named by their files, as the design's file keeps them.

    Raises:
        InputError: A word that is not known, a number that makes no sense, or an input that is no
            file.
    """

    method: "str | DesignOptimiser" = option(
        "gradient",
        ("gradient", "ga"),
        "ga: the paper's genetic one.",
        own="excitation.DesignOptimiser",
    )
    """Or an optimiser of your own."""
    purpose: str = option(
        "",
        tuple(PURPOSES),
        "Purpose of the model. [default: prediction; cond with ga or paper limits]",
        "--for",
    )
    motions: tuple[str | Path, ...] = option(
        (), "TASK", "Task of the model: a design, recording or poses.", "--motion", many=True
    )
    """Empty: the whole workspace."""
    criterion: str = option(
        "",
        ("prediction", "cond", "cond+sigma", "d-opt", "a-opt", "e-opt"),
        "What is minimised, in place of --for.",
    )
    accuracy_percent: float | None = option(
        None,
        "PERCENT",
        "The shortest motion expected to reach it.",
        "--accuracy",
        least=0.01,
        most=100,
    )
    """Torque error [%]; None for the period as it is."""
    trajectory: str = option("fourier", (*FOURIER, "bspline", "points"), "Kind of motion.")
    harmonics: int | None = option(None, "H", "Of the series. [default: up to 1 Hz; 5 for cond]")
    """A B-spline gets as many free numbers, `points` as many points; None: see `order`."""
    period_s: float = option(
        PERIOD_S, "S", "Time of one period.", "--period", least=0.1, most=LONGEST_S
    )
    rate_hz: float = 125.0
    """Samples a second at which criteria are computed."""
    population: int = option(POPULATION, "N", "Of the genetic algorithm.", least=4)
    generations: int = option(GENERATIONS, "N", "Of the genetic algorithm.", least=1)
    """After the random one."""
    starts: int | None = option(
        None, "N", "Of the gradient method. [default: 6; 4 for parameters; 12 for cond]", least=1
    )
    """None for the default, or for as many as fit into the budget."""
    budget_s: float | None = option(
        None, "S", "Time to search; the result then depends on the machine.", "--budget", least=0.01
    )
    seed: int = option(0, "N", "Seed of the random numbers.", least=0)
    frames: str = option("", ("dh", "mdh", "urdf"), "Frames of the parameters; default: its own.")
    terms: str = option("fc,fv,im", "fc,fv,im[,fo]", "Friction terms of the model.")
    start_pose: tuple[float, ...] | None = option(
        None,
        "Q1,..,QN",
        "Pose at both ends; not for --trajectory fourier.",
        "--start",
        parse=numbers,
    )
    """[rad or m]"""
    noise: tuple[float, ...] | None = option(
        None,
        "S1,..,SN",
        "Torque noise of each joint, to weight them [N.m].",
        parse=numbers,
        least=1e-6,
        most=1e6,
    )
    """Standard deviations, by which the rows of each joint are divided [N.m or N]."""
    previous: tuple[str | Path, ...] = option(
        (), "RECORD", "A recording that the motion complements; may be repeated.", many=True
    )
    jobs: int = 1
    """Processes, the calling one included."""
    dask: str | None = option(None, "ADDRESS", "A Dask scheduler, instead of --jobs.")

    def __post_init__(self) -> None:
        if self.scene is not None:
            object.__setattr__(self, "scene", _names((self.scene,), "scene")[0])
        for name in ("motions", "previous", "mesh_dirs"):
            if (given := getattr(self, name)) is not None:
                object.__setattr__(self, name, _names(given, name))
        check_options(self)
        least = 1 if self.trajectory in ("bspline", "points") else 2
        if not least <= self.order <= MOST_HARMONICS:
            raise InputError(
                "too few harmonics to move" if self.order < least else "too many harmonics",
                where="--harmonics",
                value=self.order,
                limit=f"{least} to {MOST_HARMONICS}",
            )
        for name, value in {"--jobs": self.jobs, "rate_hz": self.rate_hz}.items():
            if not (isinstance(value, Real) and value > 0):
                raise InputError("must be positive", where=name, value=value, limit="above 0")

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
        """Options that were given and have no effect beside the others, each in a sentence."""
        genetic = self.method == "ga"
        no_use = f"is not used by --method {word_of(self.method)}"
        task = self.minimised == "prediction" or self.accuracy_percent is not None
        given = {
            f"--population {no_use}": not genetic and self.population != POPULATION,
            f"--generations {no_use}": not genetic and self.generations != GENERATIONS,
            f"--starts {no_use}": self.method != "gradient" and self.starts is not None,
            f"--dask {no_use}": self.method != "gradient" and self.dask is not None,
            "--period is only where the search begins: --accuracy decides the period": (
                self.accuracy_percent is not None and self.period_s != PERIOD_S
            ),
            f"--motion does not change a motion for {self.minimised}, only its expected error": (
                bool(self.motions) and not task
            ),
            f"--for is not used beside --criterion {self.criterion}": (
                bool(self.purpose and self.criterion)
            ),
        }
        return tuple(words for words, wrongly in given.items() if wrongly)

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        told = self if isinstance(self.method, str) else replace(self, method="ga")
        return asdict(told) | {"method": word_of(self.method)}


def _names(paths: Any, setting: str) -> tuple[str, ...]:
    """Paths as text, which JSON holds, and absolute: `dynid run --until` may be elsewhere."""
    several = hasattr(paths, "__iter__") and not isinstance(paths, str)
    found: list[str] = []
    for path in paths if several else (paths,):
        if not isinstance(path, str | Path):
            raise InputError(
                "settings of a design name files",
                where=setting,
                value=type(path).__name__,
                next_step="Write it to a file first.",
            )
        found.append(str(Path(path).absolute()))
    return tuple(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSettings(SceneSettings):
    """How to run a design; what is None is not asked for.

    Raises:
        InputError: An unknown word, or a number that makes no sense.
    """

    repeat: int = option(3, "N", "Periods to record.", least=1)
    thermal: "Thermal" = option(
        "cold",
        "cold|warm|DEGC",
        "Set in the simulation; of a real robot, recorded only.",
        parse=parse_thermal,
        least=DEGC[0],
        most=DEGC[1],
    )
    slow: float | None = option(
        None, "SHARE", "First pass at a share of the speed, such as 0.2.", least=0.001, most=1
    )
    settle: bool = flag(False, "--settle", "Move one period first that is not recorded.")
    warm_up_s: float = option(0.0, "SECONDS", "Repeat the motion first.", "--warm-up", least=0)
    method: str = option(
        "program", ("program", "servoj"), "With ur://: on the controller, or streamed."
    )
    robot: "RobotLike | None" = option(None, "ROBOT", "If the design's robot file has moved.")
    accept_unjudged: tuple[str, ...] = option(
        (),
        "KIND",
        "Move although this limit cannot be checked, such as self-collision.",
        many=True,
    )
    force: bool = flag(False, "--force", "Replace the file if it exists.")
    """Once the new one is complete."""
    seed: int = option(0, "N", "Seed of the random numbers.", least=0)
    """Of the simulated noise."""

    def __post_init__(self) -> None:
        given = self.accept_unjudged or ()
        kinds: Sequence[str] = [given] if isinstance(given, str) else given
        kinds = tuple(kind.replace("-", "_") for kind in kinds)
        object.__setattr__(self, "accept_unjudged", kinds)
        if isinstance(self.thermal, str):
            object.__setattr__(self, "thermal", parse_thermal(self.thermal))
        check_options(self)
        if kinds:
            from dynid.constraints import DISTANCES, RATIOS

            for kind in kinds:
                check_word(kind, (*RATIOS, *DISTANCES), "--accept-unjudged")


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifySettings(Settings):
    """Settings of an identification; None: by the preset.

    Raises:
        InputError: An unknown preset, estimator, weighting or term.
    """

    preset: str = option(
        "best",
        ("paper", "best"),
        "paper: exactly as in the paper; best: select by cross-validation.",
    )
    estimator: "str | Estimator | None" = option(
        None,
        ("ols", "wls", "irls", "tls", "iv", "ml", "didim", "sdp", "bayes", "rls"),
        "Default: by the preset. sdp: physically consistent.",
        own="identification.Estimator",
    )
    """Or an estimator of your own."""
    terms: "FrictionTerms | None" = option(
        None,
        "fc,fv,im[,..]",
        "Friction terms, each for all joints or for some; default: by the preset.",
        parse=_terms,
        own="regressor.FrictionTerms",
    )
    """Text is read as by `parse_terms`."""
    purpose: str = option(
        "anywhere",
        ("anywhere", "this-motion"),
        "Purpose of the model: anywhere selects it on left-out regions of the workspace, "
        "this-motion on left-out stretches of time.",
        "--for",
    )
    cutoff_hz: float | None = option(
        None, "HZ", "Low-pass cut-off; default: from the data.", "--cutoff", least=0.001
    )
    weighting: str = option(
        "joint", ("joint", "size"), "Noise variance of each joint, or of joints of one size."
    )
    """`size`: joints with equal torque limit share one."""
    start_s: float | None = option(
        None, "S", "Start of the window, from the record's start.", "--from"
    )
    stop_s: float | None = option(None, "S", "End of the window, same clock.", "--to")
    mount: str | None = option(
        None,
        "floor|wall|ceiling|tilt:DEG",
        "Mounting; default: that of the recording or of the robot.",
    )
    frames: str = ""
    """`dh`, `mdh` or `urdf`."""

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        data: dict[str, Any] = {item.name: getattr(self, item.name) for item in fields(self)}
        data["for"] = data.pop("purpose")
        terms = self.terms and self.terms.to_json()
        return data | {"estimator": word_of(self.estimator), "terms": terms}


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions(Settings):
    """Options for files that are not self-describing; see `read_recording`."""

    format: str = option(
        "auto",
        (
            *("auto", "ur-csv", "ur-rtde-csv", "csv", "rosbag", "mcap", "mat", "npz", "hdf5"),
            *("json", "parquet"),
        ),
        "Format of the file; auto: by its content.",
    )
    columns: str | Mapping[str, str] | None = option(
        None,
        "t=0,q=1:7,...",
        "Columns from 0, ranges exclude their end; header names; .mat paths (q=rec.pos).",
    )
    header: bool | None = flag(None, "--no-header", "The first line has numbers, no names.")
    """None: find out."""
    delimiter: str | None = option(None, ",", "A character, or comma, semicolon, tab, space.")
    gains: tuple[float, ...] | None = option(
        None,
        "g1,..,gn",
        "Drive gains [N.m/A], one a joint; default: those of the recording or the robot.",
        parse=numbers,
    )
    rate_hz: float | None = option(
        None, "HZ", "The clock of a file without time stamps.", "--rate", least=1e-6, most=1e6
    )
    degrees: bool = flag(False, "--degrees", "Angles without a unit are in degrees.")
    joint_order: tuple[str, ...] | None = option(
        None,
        "0,2,1,...",
        "The file's joints base to tip: numbers or names.",
        parse=_words,
    )
    topic: str | None = option(None, "NAME", "The bag's topic, of any type.")


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetSettings(Settings):
    """How a fleet is judged.

    Raises:
        InputError: A false-alarm rate that is no probability.
    """

    robot: str | Path | None = option(
        None, "ROBOT", "Built-in name, URDF or robot file; default: that of the recording."
    )
    terms: str = option("fc,fv,im", "fc,fv,im[,fo]", "Friction terms, the same for all.")
    false_alarms: float = option(
        0.05, "P", "Probability of a false alarm in a run.", least=1e-6, most=0.999999
    )
    """Of any in the whole fleet."""
    reference_degC: float | None = option(
        None,
        "DEGC",
        "Reference temperature of the trends. [default: median of each joint]",
        "--reference",
        least=DEGC[0],
        most=DEGC[1],
    )
    jobs: int = option(1, "N", "Processes on this machine.", least=1)
    dask: str | None = option(None, "ADDRESS", "A Dask scheduler, instead of --jobs.")
