from typing import Any

import numpy as np
import pytest

from dynid.core import InputError
from dynid.recording import ExperimentRecord, RecordMetadata
from dynid.robot import load_robot
from dynid.signals import measured_torque

RANDOM = np.random.default_rng(1)
CURRENT, EFFORT = RANDOM.normal(size=(2, 40, 6))
ROBOT_GAINS = load_robot("ur5").drives.gain


def _record(joints: int = 6, gains: Any = None, **signals: np.ndarray) -> ExperimentRecord:
    return ExperimentRecord(
        t=np.arange(40) / 125.0,
        signals={"q": np.zeros((40, joints)), **signals},
        metadata=RecordMetadata(drive_gains=gains),
    )


def test_effort_wins_over_current() -> None:
    record = _record(current=CURRENT, effort=EFFORT, gains=(1.0,) * 6)
    np.testing.assert_array_equal(measured_torque(record, load_robot("ur5")), EFFORT)


def test_current_is_multiplied_by_the_robots_gains() -> None:
    torque = measured_torque(_record(current=CURRENT), load_robot("ur5"))
    np.testing.assert_array_equal(torque, CURRENT * ROBOT_GAINS)
    assert (ROBOT_GAINS > 1).all()


def test_gains_of_the_recording_win_over_the_robots() -> None:
    gains = (1.0, 2.0, 3.0, -4.0, 5.0, 6.0)
    torque = measured_torque(_record(current=CURRENT, gains=gains), load_robot("ur5"))
    np.testing.assert_array_equal(torque, CURRENT * gains)


@pytest.mark.parametrize(
    ("record", "robot", "message"),
    [
        (
            _record(),
            "ur5",
            r"neither effort nor current; got q\. Import it again with columns",
        ),
        (
            _record(target_current=CURRENT),
            "ur5",
            r"neither effort nor current; got q, target_current",
        ),
        (
            _record(joints=4, effort=EFFORT[:, :4]),
            "ur5",
            r"the recording has 4 joints, the robot ur5 has 6\. Pass the right robot",
        ),
        (
            _record(current=CURRENT, gains=(1.0, 2.0)),
            "ur5",
            r"one drive gain a joint is needed; got 2; allowed: 6",
        ),
        (
            _record(current=CURRENT, gains=(1.0, np.nan, 3.0, 4.0, 5.0, np.inf)),
            "ur5",
            r"ur5: torque from current needs drive gains .*no gain for \S+, \S+\. Pass gains",
        ),
    ],
)
def test_what_is_missing_is_named_with_what_to_do(
    record: ExperimentRecord, robot: str, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        measured_torque(record, load_robot(robot))
