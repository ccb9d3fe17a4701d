from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dynid.core.errors import RecordError
from dynid.recording.files import read_recording
from dynid.robot.load import load_robot

JOINTS = range(1, 7)


def write(path: Path, *, time: str = "t", q: str = "", torque: str = "tau{} [Nm]") -> Path:
    t = np.arange(400) / 125
    motion = np.sin(np.outer(t, np.arange(1, 7) / 2))
    table = np.column_stack([t, motion, 5 * np.cos(np.outer(t, np.arange(1, 7)))])
    header = [time, *(f"q{k}{q}" for k in JOINTS), *(torque.format(k) for k in JOINTS)]
    np.savetxt(path, table, delimiter=",", header=",".join(header), comments="", fmt="%.6f")
    return path


@pytest.mark.parametrize(
    "names",
    [
        {},
        {"time": "time [s]", "q": " [rad]", "torque": "effort{} (N.m)"},
        {"torque": "current{} [A]"},
    ],
)
def test_si_units_pass(tmp_path: Path, names: dict[str, str]) -> None:
    record = read_recording(write(tmp_path / "x.csv", **names), robot=load_robot("ur5"))
    assert record.samples == 400
    assert record.rate_hz == pytest.approx(125.0, rel=1e-3)


@pytest.mark.parametrize(
    ("names", "unit"),
    [
        ({"torque": "current{} [mA]"}, "ma"),
        ({"torque": "tau{} [mNm]"}, "mnm"),
        ({"torque": "tau{} [%]"}, "%"),
        ({"q": " [rev]"}, "rev"),
        ({"time": "Time [min]"}, "min"),
    ],
)
def test_other_units_are_refused_by_name(tmp_path: Path, names: dict[str, str], unit: str) -> None:
    with pytest.raises(RecordError, match="does not convert") as caught:
        read_recording(write(tmp_path / "x.csv", **names), robot=load_robot("ur5"))
    assert str(caught.value.value).replace("_", "") == unit


@pytest.mark.parametrize("rate", [0.0, -5.0, float("nan"), float("inf")])
def test_a_rate_is_positive_even_where_stamps_win(tmp_path: Path, rate: float) -> None:
    with pytest.raises(RecordError, match="rate must be positive"):
        read_recording(write(tmp_path / "x.csv"), robot=load_robot("ur5"), rate_hz=rate)
