"""Tables keep every digit, however narrow the terminal is."""

from __future__ import annotations

import io
import re

import pytest
from rich.console import Console

from dynid.cli.app import main
from dynid.cli.show import count, fitting, print_table
from dynid.core import Finding

ROWS = [
    ("shoulder_pan_joint", "0.914", "1.2345e-05", "-6.283", "0.999"),
    ("a very long name of many words", 1.09, None, 150.0, "0.998"),
]
SHOWN = [ROWS[0], ("a very long name of many words", "1.090", "-", "150.0", "0.998")]
COLUMNS = {"joint": None, "RMS": 4, "std": 4, "limit [SI]": 4, "R2": 4}


@pytest.mark.parametrize("width", [20, 40, 60, 80, 200])
def test_numbers_are_never_cut(width: int) -> None:
    stream = io.StringIO()
    screen = Console(file=stream, width=width, markup=False, highlight=False)
    print_table(screen, "Title", COLUMNS, ROWS)
    text = stream.getvalue()
    for row in SHOWN:
        for cell in row[1:]:
            assert re.search(rf"(?<![\d.]){re.escape(cell)}(?![\d.])", text), (cell, text)
    for heading in COLUMNS:
        assert heading in text
    assert "shoulder_pan_joint" in text
    assert screen.width == width


def test_a_wide_terminal_holds_a_row_in_a_line() -> None:
    stream = io.StringIO()
    print_table(Console(file=stream, width=80), "Title", COLUMNS, ROWS)
    assert len(stream.getvalue().splitlines()) == 3 + len(ROWS)


def test_as_many_findings_are_printed_as_lines_are_free() -> None:
    screen = Console(file=io.StringIO(), width=40)
    many = "the last link carries more than was published " * 3
    short = Finding("at_rest", "it stands still")
    long = Finding("payload", many)
    assert [fitting(screen, [short, long, short], n) for n in (0, 1, 4, 5, 6)] == [1, 1, 1, 2, 3]
    assert fitting(screen, [long], 1) == 1
    assert fitting(screen, [], 5) == 0


def test_one_is_no_plural() -> None:
    assert [count(k, "start") for k in (0, 1, 2)] == ["0 starts", "1 start", "2 starts"]


def test_analyze_fits_a_screen_and_names_combinations_by_their_expression(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["analyze", "ur5"]) == 0
    text = capsys.readouterr().out
    assert len(text.splitlines()) <= 40
    assert "mx2 - 2.3529412*Jzz2 - 2.3529412*Im2" in text
    alone = text.split("Identifiable alone")[1].split("Identifiable in combination")[0]
    assert "my2" in alone
    assert "mx2" not in alone


def test_many_options_stand_below_headings(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["design", "--help"]) == 0
    text = capsys.readouterr().out
    headings = [line[:-1] for line in text.splitlines() if re.fullmatch(r"\S.*:", line)]
    assert set(headings) - {"Example"} >= {"Options", "Method", "Other files"}
    part = text.split("Method:")[1].split("\n\n")[0]
    assert "--population" in part
    assert "--krl" not in part
    main(["export", "--help"])
    assert "Method:" not in capsys.readouterr().out
