"""`dynid run --on ur://` from the design to the record: passes, e-Series, two ways to the same."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from controllers import Observer
from gentle_motion import CYCLES, gentle, ur5, write_gentle

from dynid.cli.app import main
from dynid.core import provenance
from dynid.recording import read_record
from dynid.robot import load_robot
from dynid.simulation import simulate, simulated_arm
from dynid.trajectory import write_trajectory
from dynid.workflow import RunSettings, run_design
from urtwin import controller_process, own_address

SAME_PATH = 2e-3
"""Distance between the simulated arm under the controller and in this process [rad]."""


@pytest.mark.long
def test_slow_and_warm_up_passes_come_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    design, path = write_gentle(tmp_path / "design.json"), tmp_path / "run.parquet"
    with (
        controller_process("ur5", host=own_address(), virtual_time=True) as running,
        Observer(running.host) as observer,
    ):
        words = ["run", design, "--on", f"ur://{running.host}", "-o", path, "--yes", "--json"]
        options = ["--slow", 0.25, "--warm-up", 3, "--settle", "--repeat", 1]
        assert main([str(word) for word in (*words, *options)]) == 0
        state, index, qd = observer.columns(
            "output_int_register_25", "output_int_register_24", "target_qd"
        )
    data = json.loads(capsys.readouterr().out)
    assert (data["samples"], data["periods"], data["aborted"]) == (CYCLES, 1, False)
    starts = np.flatnonzero((state[1:] == 1) & (state[:-1] != 1)) + 1
    ends = np.flatnonzero((state[1:] == 2) & (state[:-1] == 1)) + 1
    # A slow period, two warm ones, a settling and a recorded one: a program each.
    assert [int(index[end - 1]) for end in ends] == [4 * CYCLES, 2 * CYCLES, 2 * CYCLES]
    speeds = [np.abs(qd[start:end]).max(axis=0) for start, end in zip(starts, ends, strict=True)]
    np.testing.assert_allclose(speeds[0], 0.25 * speeds[1], rtol=0.05)
    np.testing.assert_allclose(speeds[1], speeds[2], rtol=1e-6)
    assert read_record(path).metadata.extra["settled"] == "True"


def test_an_e_series_robot_runs_at_its_own_rate(tmp_path: Path) -> None:
    robot = load_robot("ur5e")
    design, path = tmp_path / "design.json", tmp_path / "run.parquet"
    made = provenance(seed=0)
    write_trajectory(gentle(), design, robot="ur5e", limits=robot.limits, provenance=made)
    with controller_process("ur5e", host=own_address(), virtual_time=True) as running:
        run = run_design(design, path, on=f"ur://{running.host}", settings=RunSettings(repeat=1))
    assert run.abort is None
    record = read_record(path)
    assert record.samples == 1000
    np.testing.assert_allclose(np.diff(record.t), 0.002, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(record.channels["index"], np.arange(1000))


@pytest.mark.long
def test_the_controllers_arm_moves_as_the_one_in_this_process(tmp_path: Path) -> None:
    design, path = write_gentle(tmp_path / "design.json"), tmp_path / "run.parquet"
    with controller_process("ur5", host=own_address(), virtual_time=True) as running:
        settings = RunSettings(repeat=1, settle=True)
        run_design(design, path, on=f"ur://{running.host}", settings=settings)
    record = read_record(path)
    reference = simulate(simulated_arm(ur5()), gentle(), periods=2)
    second = slice(CYCLES, 2 * CYCLES)
    best = min(
        float(
            np.abs(record.signals["q"][shift:] - reference.truth.q[second][: CYCLES - shift]).max()
        )
        for shift in range(4)
    )
    assert best < SAME_PATH
