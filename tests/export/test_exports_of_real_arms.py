"""What preset best finds on physical robots, in every format; the recordings lie beside us."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from dynid import identify
from dynid.core import JobError
from dynid.export import write_model
from dynid.export.writing import FORMATS
from dynid.recording import ExperimentRecord, read_recording
from dynid.robot import RobotModel, load_robot
from dynid.workflow import IdentifySettings

pytestmark = pytest.mark.usefixtures("undiagnosed")

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"
# The asked agreement of torques [N.m]; above 100 in proportion.
EXACT = 1e-9

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason="the real recordings of ../shared/data are not here"
)


def ur10() -> tuple[ExperimentRecord, RobotModel]:
    robot = load_robot(str(ROOT / "examples" / "robots" / "ur10_unisa.toml"))
    bag = DATA / "ur10_unisa" / "ur10_exciting_trajectory.db3"
    return read_recording([bag], robot=robot), robot


def panda() -> tuple[ExperimentRecord, RobotModel]:
    robot = load_robot(str(ROOT / "examples" / "robots" / "panda.toml"))
    names = ("time", "positions", "velocity", "torques")
    files = [DATA / "panda_gaz" / f"exciting_traj_{name}.txt" for name in names]
    columns = "t=0,q=1:8,qd=8:15,effort=15:22"
    return read_recording(files, robot=robot, columns=columns, header=False), robot


@pytest.mark.parametrize(
    ("name", "symbol", "words"),
    [
        pytest.param("ur10", "Fl", "friction that grows with load", marks=pytest.mark.long),
        pytest.param("panda", "Fw", "torque ripple of gears", marks=pytest.mark.long),
    ],
)
def test_what_preset_best_finds_is_exported(
    name: str, symbol: str, words: str, tmp_path: Path
) -> None:
    record, robot = ur10() if name == "ur10" else panda()
    settings = IdentifySettings(preset="best")
    estimate = identify([record], robot, settings).estimate
    assert any(column.startswith(symbol) for column in estimate.model.names)
    for to in FORMATS:
        path = tmp_path / to
        if to == "mjcf" and name == "panda":
            # Nothing is published of this arm that would hold its links to consistent ones.
            with pytest.raises(JobError, match="MuJoCo refuses such a model") as refused:
                write_model(estimate, path, to)
            assert "estimator sdp" in str(refused.value)
            continue
        done = write_model(estimate, path, to)
        assert done.verified.passed
        assert (words in done.left_out) == (to in ("urdf", "mjcf"))
    arm = runpy.run_path(str(tmp_path / "python"))
    q, dq = (record.signals[key][::50] for key in ("q", "qd"))
    ddq = np.gradient(dq, axis=0)
    ours = estimate.predict(q, dq, ddq)
    allowed = EXACT * max(1.0, float(np.abs(ours).max()) / 100.0)
    np.testing.assert_allclose(arm["inverse_dynamics"](q, dq, ddq), ours, rtol=0, atol=allowed)
    assert np.abs(ours).max() > 10.0
