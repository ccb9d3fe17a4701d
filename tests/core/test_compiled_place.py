"""Where compiled kernels are kept, and that none outlives what it was compiled from."""

import os
import sys
from importlib import import_module
from pathlib import Path

import pytest

from dynid.core import compiled, place_compiled

INNER = """
from dynid.core import compiled

FACTOR = {factor}

@compiled(cache=False)
def inner(x: float) -> float:
    return x + {more}
"""
OUTER = """
from dynid.core import compiled
from stale_inner import FACTOR, inner

@compiled()
def outer(x: float) -> float:
    return FACTOR * inner(x)
"""


def placed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, writable: bool) -> str | None:
    # Set first, so that what is set in the test is taken back after it.
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "none"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(os, "access", lambda *_: writable)
    place_compiled()
    return os.environ.get("NUMBA_CACHE_DIR")


def test_numba_chooses_where_it_can(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert placed(monkeypatch, tmp_path, writable=True) is None


def test_the_place_is_this_accounts_alone(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    place = placed(monkeypatch, tmp_path, writable=False)
    assert place is not None
    assert Path(place).stat().st_mode & 0o77 == 0
    # One that others may write to is not used: what is read from there is run.
    Path(place).chmod(0o777)
    assert placed(monkeypatch, tmp_path, writable=False) is None


def test_a_kernel_is_compiled_again_where_another_file_has_changed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    (tmp_path / "stale_outer.py").write_text(OUTER)
    hits: list[int] = []
    for factor, more, expected in ((2, 1, 8.0), (2, 1, 8.0), (3, 1, 12.0), (3, 2, 15.0)):
        (tmp_path / "stale_inner.py").write_text(INNER.format(factor=factor, more=more))
        for name in ("stale_inner", "stale_outer"):
            monkeypatch.delitem(sys.modules, name, raising=False)
        outer = import_module("stale_outer").outer
        assert outer(3.0) == expected
        hits.append(sum(outer.stats.cache_hits.values()))
    assert hits == [0, 1, 0, 0], "only what has not changed is loaded"


def test_kernels_stay_python_where_numba_compiles_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("numba.core.config.DISABLE_JIT", 1)

    def twice(x: float) -> float:
        return 2 * x

    assert compiled()(twice)(2.0) == 4.0
