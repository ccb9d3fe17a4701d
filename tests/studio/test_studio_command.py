from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest
from gentle import write_motion
from typer.testing import CliRunner

from dynid.cli.app import build, main

PATIENCE = 60


def get(url: str) -> tuple[int, bytes]:
    """As a browser does: the cookie of the first answer opens the page."""
    visitor = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    with visitor.open(url, timeout=PATIENCE) as answer:
        return answer.status, answer.read()


def test_it_serves_until_it_is_interrupted(tmp_path: Path) -> None:
    write_motion(tmp_path / "motion.json")
    command = [sys.executable, "-m", "dynid", "studio", str(tmp_path), "--port", "0", "--json"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=dict(os.environ)
    ) as process:
        assert process.stdout is not None
        served = json.loads(process.stdout.readline())
        assert served.keys() == {"url", "host", "port", "robot", "local"}
        assert (served["robot"], served["local"], served["host"]) == ("ur5", True, "127.0.0.1")
        try:
            status, page = get(served["url"])
        finally:
            process.send_signal(signal.SIGINT)
        assert status == 200
        assert b"<title>dynid studio</title>" in page
        out, err = process.communicate(timeout=PATIENCE)
    assert (process.returncode, out) == (0, "")
    assert err.splitlines() == [f"dynid studio: open {served['url']} - Ctrl-C ends it."]


@pytest.mark.parametrize(
    "words",
    [
        ["nobody"],
        ["--host", "example.org"],
        ["--host", "0.0.0.0", "--token", "short"],
        ["--port", "99999"],
        ["ur5", "--robot", "nobody", "--host", "192.0.2.1", "--port", "0"],
    ],
)
def test_bad_usage_is_one_line_and_exit_code_2(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["studio", *words]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == 1


def test_help_has_an_example() -> None:
    shown = CliRunner().invoke(build(), ["studio", "--help"]).output
    assert "dynid studio runs/demo" in shown
    assert "--token" in shown
