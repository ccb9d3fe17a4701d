"""What an error says, and in which order."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest

from dynid.core import (
    DynidError,
    InputError,
    JobError,
    MissingExtraError,
    RecordError,
    RobotError,
    like_named,
    require,
)


def test_a_message_says_where_what_value_limit_and_what_to_do() -> None:
    error = InputError(
        "too fast", where="joint 2", value=4.5, limit="3.14 rad/s", next_step="Slow down."
    )
    assert str(error) == "joint 2: too fast; got 4.5; allowed: 3.14 rad/s. Slow down."
    assert (error.what, error.where, error.value) == ("too fast", "joint 2", 4.5)
    assert (error.limit, error.next_step) == ("3.14 rad/s", "Slow down.")


def test_python_reads_the_names_of_its_arguments() -> None:
    error = InputError(
        "too fast", where="--from 3 --to 2", next_step="Run: dynid import F --rate 125. Or --force."
    )
    assert error.line == "--from 3 --to 2: too fast. Run: dynid import F --rate 125. Or --force."
    # Whole commands are given as they are typed.
    told = "start_s 3 stop_s 2: too fast. Run: dynid import F --rate 125. Or force=True."
    assert str(error) == told
    assert str(pickle.loads(pickle.dumps(error))) == told


def test_what_is_not_known_is_left_out() -> None:
    assert str(JobError("no motion was found")) == "no motion was found"
    assert str(JobError("failed", value=0)) == "failed; got 0"
    assert str(JobError("failed", next_step="Try again.")) == "failed. Try again."


@pytest.mark.parametrize(("length", "shown"), [(200, 200), (201, 200), (5000, 200)])
def test_long_values_are_cut_and_say_so(length: int, shown: int) -> None:
    message = str(InputError("wrong", value="x" * length))
    assert message.count("x") == (length if length <= shown else shown - 3)
    assert message.endswith("..." if length > shown else "x")
    assert len(message) == len("wrong; got ") + shown


def test_values_stay_on_one_printable_line() -> None:
    message = str(InputError("wrong", value="a\nb\x1b[31mc\0", limit=["ä", "\u2028"]))
    assert message == "wrong; got a?b?[31mc?; allowed: ä, ?"


@pytest.mark.parametrize(
    ("kind", "code"),
    [
        (DynidError, 1),
        (JobError, 1),
        (InputError, 2),
        (RobotError, 2),
        (RecordError, 2),
        (MissingExtraError, 2),
    ],
)
def test_bad_input_and_failed_jobs_leave_with_their_codes(
    kind: type[DynidError], code: int
) -> None:
    assert kind("x").exit_code == code
    assert issubclass(kind, InputError) == (code == 2)


def test_a_missing_extra_names_the_package_and_the_command() -> None:
    with pytest.raises(MissingExtraError) as caught:
        require("dynid_nowhere.inner", "sim")
    assert str(caught.value) == (
        "this needs the package 'dynid_nowhere'. Run: pip install 'dynid[sim]'"
    )
    assert require("json.decoder", "sim").JSONDecoder


def test_a_library_that_cannot_be_imported_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "dynid_broken.py").write_text("raise RuntimeError('another NumPy')")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(MissingExtraError, match=r"dynid_broken.*RuntimeError: another NumPy"):
        require("dynid_broken", "sim")


@pytest.mark.parametrize("limit", ["best, paper", ("best", "paper"), ["paper", "best"]])
def test_a_refused_word_gets_the_closest_allowed_one(limit: object) -> None:
    assert InputError("unknown", value="bset", limit=limit).next_step == "Did you mean best?"
    assert InputError("unknown", value="zzz", limit=limit).next_step is None
    assert InputError("unknown", value=3, limit=limit).next_step is None
    told = InputError("unknown", value="bset", limit=limit, next_step="Stop.")
    assert told.next_step == "Stop."


def test_an_amount_is_not_compared_with_its_only_limit() -> None:
    assert InputError("size", value="0 bytes", limit="3 to 12300 bytes").next_step is None
    assert InputError("size", value="3 bytes", limit="2 bytes").next_step is None


def test_a_missing_file_is_compared_with_those_beside_it(tmp_path: Path) -> None:
    (tmp_path / "monday.csv").touch()
    assert like_named(tmp_path / "mondy.csv") == "Did you mean monday.csv?"
    (tmp_path / "recordings").mkdir()
    assert like_named(tmp_path / "recordigns") == "Did you mean recordings?"
    assert like_named(tmp_path / "UR55", "ur5", "ur10") == "Did you mean ur5?"
    assert like_named(tmp_path / "absent" / "other.csv") is None
