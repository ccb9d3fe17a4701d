"""The table of `dynid bench verdicts`: what was refused is counted."""

from __future__ import annotations

import numpy as np
import pytest

from dynid.bench import Judged, Recorded, cases, markdown, recorded, run_verdicts, summarise
from dynid.cli.app import main
from dynid.core import JobError


def refuse(made: Recorded) -> Judged:
    raise JobError("a singular problem", value=made.record.samples)


def test_a_clean_recording_that_is_refused_is_no_success() -> None:
    told = summarise(run_verdicts(refuse, cases(0, 1, 0)))
    assert (told["clean"], told["good"], told["refused"]) == (1, 0, 1)
    assert "Refused recordings: 1." in markdown(told, "Refused")


def test_random_arms_move_within_their_limits() -> None:
    chosen = list(cases(1, 6, 0, random_arms=True))
    assert len({case.arm for case in chosen}) == 6
    for case in chosen:
        made = recorded(case)
        q, limits = made.record.signals["q"], made.robot.limits
        assert 4 <= made.robot.joints <= 7
        assert (q > limits.lower - 0.01).all()
        assert (q < limits.upper + 0.01).all()
        assert (np.abs(made.clean).max(axis=0) < limits.torque).all()


@pytest.mark.parametrize(
    ("option", "value", "allowed"),
    [("--preset", "no", "allowed: paper, best"), ("--seed", "-1", "greater than or equal to 0")],
)
def test_an_unknown_preset_or_seed_is_bad_usage(
    capsys: pytest.CaptureFixture[str], option: str, value: str, allowed: str
) -> None:
    assert main(["bench", "verdicts", "--clean", "1", "--each", "0", option, value]) == 2
    assert allowed in capsys.readouterr().err
