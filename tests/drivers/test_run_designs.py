"""What `dynid design` makes runs on a controller that has just been switched on."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from controllers import Observer
from gentle_motion import write_gentle

from dynid.constraints import safe_constraints
from dynid.core import JobError
from dynid.drivers import inspect
from dynid.drivers.ur.link import ScriptPort
from dynid.drivers.ur.variables import APPROACHING, DONE, MOVING, STATE
from dynid.protocol import RuntimeState
from dynid.robot import load_robot
from dynid.trajectory import read_trajectory
from dynid.workflow import DesignSettings, RunSettings, design, run_design
from dynid.workflow.running import load_design
from urtwin import controller_process, own_address
from urtwin.machine import UPRIGHT

JUDGE = safe_constraints(load_robot("ur5"))
PERIOD_S, HARMONICS, CYCLES = 6.0, 4, 750
APPROACH_RAD_S = 0.5
TRACKING_RAD = 1e-3
"""By which the arm's measured pose may lie beside its target."""


def designed(path: Path, seed: int, mount: str | None = None) -> Path:
    settings = DesignSettings(
        period_s=PERIOD_S, harmonics=HARMONICS, starts=1, seed=seed, jobs=1, mount=mount
    )
    assert design("ur5", settings, output=path).feasible
    return path


@pytest.mark.parametrize(
    "seed", [1, pytest.param(2, marks=pytest.mark.long), pytest.param(3, marks=pytest.mark.long)]
)
def test_a_design_runs_from_where_a_new_controller_stands(tmp_path: Path, seed: int) -> None:
    path = designed(tmp_path / "design.json", seed)
    start = read_trajectory(path).trajectory.evaluate([0.0]).q[0]
    said: list[str] = []
    with (
        controller_process("ur5", host=own_address(), virtual_time=True) as running,
        Observer(running.host) as observer,
    ):
        run = run_design(
            path,
            tmp_path / "run.parquet",
            on=f"ur://{running.host}",
            settings=RunSettings(repeat=1),
            confirm=lambda words, _: said.append(words),
        )
        observer.wait_for(lambda package: observer.number(package, STATE) == DONE)
        state, q, qd = observer.columns(STATE, "target_q", "target_qd")
    assert run.abort is None
    assert run.to_json()["samples"] == CYCLES
    assert "way to the start: " in said[0]
    moving = np.flatnonzero(state == MOVING)
    begun = int(moving[0])
    way, speed = q[:begun], np.abs(qd[:begun])
    np.testing.assert_allclose(way[0], UPRIGHT, rtol=0, atol=TRACKING_RAD)
    np.testing.assert_allclose(way[-1], start, rtol=0, atol=TRACKING_RAD)
    assert speed.max() <= APPROACH_RAD_S * (1 + 1e-6)
    assert state[begun - 1] == APPROACHING
    # Whatever way it took, every target on it keeps the clearance.
    assert JUDGE.surroundings is not None
    pairs = JUDGE.surroundings.pairs["self_collision"]
    assert JUDGE.surroundings.bodies.nearest(way, pairs).room.min() >= -1e-6


def test_who_is_asked_agrees_to_a_robot_that_stands_still(tmp_path: Path) -> None:
    rtde = pytest.importorskip("rtde_control")
    path = write_gentle(tmp_path / "design.json")
    with controller_process("ur5", host=own_address(), virtual_time=True) as running:
        target = f"ur://{running.host}"

        def jog(_: str, host: str) -> None:
            control = rtde.RTDEControlInterface(host)
            control.moveJ([value + 0.05 for value in UPRIGHT], 1.0, 1.0)
            control.stopScript()
            control.disconnect()

        with pytest.raises(JobError, match="has moved since it was checked"):
            run_design(path, tmp_path / "run.parquet", on=target, confirm=jog)


def test_a_robot_that_others_use_by_the_time_of_the_word_stays_theirs(tmp_path: Path) -> None:
    path = write_gentle(tmp_path / "design.json")
    with controller_process("ur5", host=own_address(), virtual_time=True) as running:

        def play(_: str, host: str) -> None:
            with closing(ScriptPort(host)) as port:
                port.send("def other():\n  while True:\n    sync()\n  end\nend\n")
            while inspect(host).runtime_state != RuntimeState.PLAYING:
                pass

        with pytest.raises(JobError, match="not ready; program: playing"):
            run_design(path, tmp_path / "run.parquet", on=f"ur://{running.host}", confirm=play)
        assert inspect(running.host).runtime_state == RuntimeState.PLAYING
    assert not list(tmp_path.glob("run*"))


@pytest.mark.long
def test_a_run_is_mounted_as_its_design(tmp_path: Path) -> None:
    path = designed(tmp_path / "design.json", 1, mount="ceiling")
    assert load_design(path, RunSettings()).robot.mount == "ceiling"
    assert load_design(path, RunSettings(mount="floor")).robot.mount == "floor"
