"""Identification of published recordings of real arms: the table of the README.

Each recording is identified on one part and judged on another that it has not seen, with both
presets. Without the recordings at ../shared/data (or the folder given) there is nothing to do.

    python benchmarks/real_recordings.py [DATA]
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import dynid

ROOT = Path(__file__).parents[1]
ROBOTS = ROOT / "examples" / "robots"
KUKA = "q=rec.act_pos_mot_deg,qd=rec.act_vel_mot_deg_per_s,effort=rec.act_torque_abs_nm"

Window = tuple[float | None, float | None]


@dataclass(frozen=True)
class Case:
    """One identification and its check."""

    name: str
    record: dynid.ExperimentRecord
    robot: dynid.RobotModel
    other: dynid.ExperimentRecord
    window: Window = (None, None)
    check: Window = (None, None)


def cases(data: Path) -> list[Case]:
    """The recordings, in the order of the README."""
    robot = {name: dynid.load_robot(ROBOTS / f"{name}.toml") for name in _robots()}
    bag = data / "ur10_unisa" / "ur10_exciting_trajectory.db3"
    ur10 = dynid.read_recording(bag, robot=robot["ur10_unisa"])
    kuka = [
        dynid.read_recording(
            data / "kr300_weigand" / part / "data.mat",
            robot=robot["kr300"],
            degrees=True,
            rate_hz=250,
            columns=KUKA,
        )
        for part in "AB"
    ]
    tx40 = dynid.read_recording(
        [data / "tx40" / "pos_read_data.csv", data / "tx40" / "curr_data.csv"],
        robot=robot["tx40"],
        rate_hz=5000,
        columns="q=0:6,effort=6:12",
    )
    panda = dynid.read_recording(
        [
            data / "panda_gaz" / f"exciting_traj_{part}.txt"
            for part in ("time", "positions", "velocity", "torques")
        ],
        robot=robot["panda"],
        columns="t=0,q=1:8,qd=8:15,effort=15:22",
    )
    return [
        *_halves("UR10", ur10, robot["ur10_unisa"], 13.75),
        Case("KR300 A, on B", kuka[0], robot["kr300"], kuka[1]),
        *_halves("TX40", tx40, robot["tx40"], 4.5)[:1],
        *_halves("Panda", panda, robot["panda"], 10.5)[:1],
    ]


def _robots() -> tuple[str, ...]:
    return ("ur10_unisa", "kr300", "tx40", "panda")


def _halves(
    name: str, record: dynid.ExperimentRecord, robot: dynid.RobotModel, middle: float
) -> list[Case]:
    first, second = (None, middle), (middle, None)
    return [
        Case(f"{name} 1st half, on 2nd", record, robot, record, first, second),
        Case(f"{name} 2nd half, on 1st", record, robot, record, second, first),
    ]


def plain(value: float) -> str:
    """Three digits, without an exponent up to ten thousand."""
    return f"{value:.0f}" if 1000 <= value < 10_000 else f"{value:.3g}"


def row(case: Case, preset: str) -> str:
    """Identify, check, and give a row of the table."""
    settings = dynid.IdentifySettings(preset=preset, start_s=case.window[0], stop_s=case.window[1])
    started = time.perf_counter()
    result = dynid.identify(
        [case.record],
        case.robot,
        settings,
        validation=case.other,
        validation_start_s=case.check[0],
        validation_stop_s=case.check[1],
    )
    wall = time.perf_counter() - started
    assert result.validation is not None
    metrics, moving = result.validation.metrics, result.validation.moving
    cells = (
        case.name,
        preset,
        plain(result.estimate.condition_number),
        " ".join(plain(x) for x in metrics.rmse),
        f"{np.nanmin(metrics.r2):.2f}",
        f"{moving.relative_error_overall_percent:.1f}",
        f"{metrics.normalized_error:.3g} ({metrics.samples})",
        dynid.verdict(result).level.replace("_", " "),
        f"{wall:.0f}",
    )
    return "| " + " | ".join(cells) + " |"


def main(words: list[str]) -> int:
    """Print the table."""
    data = Path(words[0]) if words else ROOT.parent / "shared" / "data"
    if not data.exists():
        print(f"no recordings at {data}: nothing to measure")
        return 0
    columns = (
        "recording",
        "preset",
        "condition",
        "RMS a joint [N.m]",
        "lowest R2",
        "moving [%]",
        "e_N (N) [N.m]",
        "verdict",
        "s",
    )
    print("| " + " | ".join(columns) + " |")
    print("|" + "---|" * len(columns))
    for case in cases(data):
        for preset in ("paper", "best"):
            print(row(case, preset), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
