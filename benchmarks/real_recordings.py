"""Identification of published recordings of real arms: the table of the README.

Each recording is identified on one part and judged on all rows of another that it has not seen,
in both directions: with the preset paper, and with the preset best for anywhere and for this
motion. Left-out errors of the three rival models are those that the identification itself
reports. Without the recordings at ../shared/data (or the folder given) there is nothing to do.

    python benchmarks/real_recordings.py [DATA [NAME...]]
"""

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from shared.measuring import DATA, ROOT, print_head, print_row, run

import dynid

KUKA = "q=rec.act_pos_mot_deg,qd=rec.act_vel_mot_deg_per_s,effort=rec.act_torque_abs_nm"
PANDA = ("time", "positions", "velocity", "torques")
UR5_GAINS = (11.5, 10.1, 10.6, 10.0, 10.2, 8.8)
"""Regressed from `no6`: target current on target moment [N.m/A]."""

Window = tuple[float | None, float | None]


@dataclass(frozen=True)
class Source:
    """Files of one recording, and how they are read."""

    robot: str
    files: tuple[str, ...]
    columns: str | None = None
    rate_hz: float | None = None
    degrees: bool = False

    def load_robot(self) -> dynid.RobotModel:
        """From examples/robots."""
        return dynid.load_robot(ROOT / "examples" / "robots" / f"{self.robot}.toml")

    def read(self, data: Path) -> dynid.ExperimentRecord:
        """The recording, from the folder of all."""
        return dynid.read_recording(
            [data / file for file in self.files],
            robot=self.load_robot(),
            columns=self.columns,
            rate_hz=self.rate_hz,
            degrees=self.degrees,
        )


SOURCES = {
    "UR10": Source("ur10_unisa", ("ur10_unisa/ur10_exciting_trajectory.db3",)),
    "KR300 A": Source("kr300", ("kr300_weigand/A/data.mat",), KUKA, 250.0, degrees=True),
    "KR300 B": Source("kr300", ("kr300_weigand/B/data.mat",), KUKA, 250.0, degrees=True),
    "TX40": Source(
        "tx40", ("tx40/pos_read_data.csv", "tx40/curr_data.csv"), "q=0:6,effort=6:12", 5000.0
    ),
    "Panda": Source(
        "panda",
        tuple(f"panda_gaz/exciting_traj_{part}.txt" for part in PANDA),
        "t=0,q=1:8,qd=8:15,effort=15:22",
    ),
}
"""The recordings that `dynid.read_recording` reads as they are."""


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
    ur5 = {name: _ur5(data / "ur5_kufieta" / name) for name in ("no5", "no6", "no7")}
    arm = dynid.load_robot("ur5")
    kuka = {part: SOURCES[f"KR300 {part}"].read(data) for part in "AB"}
    kr300 = SOURCES["KR300 A"].load_robot()
    return [
        *(Case(f"UR5 {a}, on {b}", ur5[a], arm, ur5[b]) for a in ur5 for b in ur5 if a != b),
        *_halves("UR10", data, 13.75),
        *(Case(f"KR300 {a}, on {b}", kuka[a], kr300, kuka[b]) for a, b in ("AB", "BA")),
        *_halves("TX40", data, 4.5),
        *_halves("Panda", data, 10.5),
    ]


def _ur5(folder: Path) -> dynid.ExperimentRecord:
    """A run whose files differ in length: rows that all of them have, by their time."""
    tables = []
    for name in ("q_actual", "qd_actual", "i_actual"):
        lines = (folder / f"log_{name}.csv").read_text().splitlines()
        # The last line is cut.
        rows = ([float(word) for word in line.split(",")] for line in lines[:-1])
        tables.append({round(1000 * row[0]): row[1:] for row in rows})
    stamps = sorted(set.intersection(*map(set, tables)))
    q, qd, current = (np.array([table[k] for k in stamps]) for table in tables)
    return dynid.ExperimentRecord(
        t=np.array(stamps) / 1000.0,
        signals={"q": q, "qd": qd, "effort": current * UR5_GAINS},
    )


def _halves(name: str, data: Path, middle: float) -> list[Case]:
    record, robot = SOURCES[name].read(data), SOURCES[name].load_robot()
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


def cells(case: Case, preset: str, purpose: str) -> tuple[str, ...]:
    """Identify, check, and give a row of the table."""
    started = time.process_time()
    result = identified(case, dynid.IdentifySettings(preset=preset, purpose=purpose))
    cpu = time.process_time() - started
    assert result.validation is not None
    told = result.estimate.assessment
    assert told is not None
    metrics, covered = result.validation.metrics, result.validation.covered
    assert covered is not None
    return (
        case.name,
        preset if preset == "paper" else purpose,
        plain(float(np.linalg.norm(metrics.rmse))),
        " ".join(plain(x) for x in metrics.rmse),
        f"{metrics.normalized_error:.3g} ({metrics.samples})",
        plain(float(np.linalg.norm(told.anywhere))),
        " / ".join(plain(float(np.linalg.norm(rms))) for rms in told.models.values()),
        " ".join(f"{100 * share:.0f}" for share in covered),
        dynid.verdict(result).level.replace("_", " "),
        f"{cpu:.0f}",
    )


def main(data: Path = DATA, names: tuple[str, ...] = (), /) -> None:
    """Print the table."""
    if not data.exists():
        print(f"no recordings at {data}: nothing to measure")
        return
    columns = (
        "recording",
        "preset",
        "RSS",
        "RMS a joint [N.m]",
        "e_N (N) [N.m]",
        "RSS left out",
        "published / friction fitted / identified (one figure: nothing is published)",
        "90 % covers [%]",
        "verdict",
        "CPU s",
    )
    print_head(columns)
    for case in cases(data):
        if names and not case.name.startswith(tuple(names)):
            continue
        for words in (("paper", "anywhere"), ("best", "anywhere"), ("best", "this-motion")):
            print_row(cells(case, *words))


if __name__ == "__main__":
    run(main)
