"""Identification of published recordings of real arms: the table of the README.

Each recording is identified on one part and judged on all rows of another that it has not seen,
in both directions: with the preset paper, and with the preset best for anywhere and for this
motion. Left-out errors of the three rival models are those that the identification itself
reports. Without the recordings at ../shared/data (or the folder given) there is nothing to do.

    python benchmarks/real_recordings.py [DATA [NAME...]]
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import dynid

ROOT = Path(__file__).parents[1]
ROBOTS = ROOT / "examples" / "robots"
KUKA = "q=rec.act_pos_mot_deg,qd=rec.act_vel_mot_deg_per_s,effort=rec.act_torque_abs_nm"

UR5_GAINS = (11.5, 10.1, 10.6, 10.0, 10.2, 8.8)
"""Regressed from `no6`: target current on target moment [N.m/A]."""

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
    ur5 = {name: _ur5(data / "ur5_kufieta" / name) for name in ("no5", "no6", "no7")}
    ur5_robot = dynid.load_robot("ur5")
    return [
        *(Case(f"UR5 {a}, on {b}", ur5[a], ur5_robot, ur5[b]) for a in ur5 for b in ur5 if a != b),
        *_halves("UR10", ur10, robot["ur10_unisa"], 13.75),
        Case("KR300 A, on B", kuka[0], robot["kr300"], kuka[1]),
        Case("KR300 B, on A", kuka[1], robot["kr300"], kuka[0]),
        *_halves("TX40", tx40, robot["tx40"], 4.5),
        *_halves("Panda", panda, robot["panda"], 10.5),
    ]


def _ur5(folder: Path) -> dynid.ExperimentRecord:
    """A run whose files differ in length: rows that all of them have, by their time."""
    tables = []
    for name in ("q_actual", "qd_actual", "i_actual"):
        lines = (folder / f"log_{name}.csv").read_text().splitlines()
        # The last line is cut.
        tables.append({round(1000 * row[0]): row[1:] for row in map(_numbers, lines[:-1])})
    stamps = sorted(set.intersection(*map(set, tables)))
    q, qd, current = (np.array([table[k] for k in stamps]) for table in tables)
    return dynid.ExperimentRecord(
        t=np.array(stamps) / 1000.0,
        signals={"q": q, "qd": qd, "effort": current * UR5_GAINS},
    )


def _numbers(line: str) -> list[float]:
    return [float(word) for word in line.split(",")]


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


def identified(case: Case, settings: dynid.IdentifySettings) -> dynid.Identification:
    """Identify a case by these settings, and validate on its other part."""
    start, stop = case.window
    return dynid.identify(
        [case.record],
        case.robot,
        replace(settings, start_s=start, stop_s=stop),
        validation=case.other,
        validation_start_s=case.check[0],
        validation_stop_s=case.check[1],
    )


def plain(value: float) -> str:
    """Three digits, without an exponent up to ten thousand."""
    return f"{value:.0f}" if 1000 <= value < 10_000 else f"{value:.3g}"


def row(case: Case, preset: str, purpose: str) -> str:
    """Identify, check, and give a row of the table."""
    started = time.process_time()
    result = identified(case, dynid.IdentifySettings(preset=preset, purpose=purpose))
    cpu = time.process_time() - started
    assert result.validation is not None
    told = result.estimate.assessment
    assert told is not None
    metrics, covered = result.validation.metrics, result.validation.covered
    assert covered is not None
    cells = (
        case.name,
        preset if preset == "paper" else purpose,
        plain(float(np.linalg.norm(metrics.rmse))),
        " ".join(plain(x) for x in metrics.rmse),
        f"{metrics.normalized_error:.3g} ({metrics.samples})",
        plain(float(np.linalg.norm(told.anywhere))),
        " / ".join(plain(float(np.linalg.norm(model.rms))) for model in told.models),
        " ".join(f"{100 * share:.0f}" for share in covered),
        dynid.verdict(result).level.replace("_", " "),
        f"{cpu:.0f}",
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
        "RSS",
        "RMS a joint [N.m]",
        "e_N (N) [N.m]",
        "RSS left out",
        "published / friction fitted / identified",
        "90 % covers [%]",
        "verdict",
        "CPU s",
    )
    print("| " + " | ".join(columns) + " |")
    print("|" + "---|" * len(columns))
    for case in cases(data):
        if words[1:] and not any(case.name.startswith(word) for word in words[1:]):
            continue
        for preset, purpose in (
            ("paper", "anywhere"),
            ("best", "anywhere"),
            ("best", "this-motion"),
        ):
            print(row(case, preset, purpose), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
