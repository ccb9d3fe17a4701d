"""Where compiled kernels are kept for an account that may write neither sources nor its home."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import dynid


def placed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, writable: bool) -> str | None:
    # Set first, so that what is set in the test is taken back after it.
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "none"))
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(dynid.os, "access", lambda *_: writable)
    dynid._place_compiled_code(str(tmp_path))
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
