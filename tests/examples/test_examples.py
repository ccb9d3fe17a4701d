"""Examples run as they are; `make proof` runs all of them."""

from __future__ import annotations

import runpy
from importlib.util import find_spec
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
NEED_FILES = {"own_urdf.py"}
QUICK = ["payload.py", "own_estimator.py"]


@pytest.mark.skipif(not find_spec("mujoco"), reason="needs MuJoCo")
@pytest.mark.parametrize("name", QUICK)
def test_a_quick_example_runs(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    # In this process, where warnings are errors too.
    runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    assert capsys.readouterr().out.strip()


def test_examples_use_public_names_alone() -> None:
    for path in sorted(EXAMPLES.glob("*.py")):
        text = path.read_text(encoding="utf-8")
        compile(text, str(path), "exec")
        assert len(text.splitlines()) <= 60, path.name
        # A package's face, never a module within it.
        assert not [
            line
            for line in text.splitlines()
            if line.startswith("from dynid.") and line.split()[1].count(".") > 1
        ], path.name
