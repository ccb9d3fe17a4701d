"""Files appear whole or not at all."""

from __future__ import annotations

import errno
import json
import os
import stat
from pathlib import Path

import numpy as np
import pytest

from dynid.core import (
    InputError,
    JobError,
    read_arrays,
    require_absent,
    write_arrays,
    write_json,
    write_text,
)


def names(folder: Path) -> list[str]:
    return sorted(item.name for item in folder.iterdir())


def test_a_file_is_written_and_written_again(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    write_json(path, {"m": [1.5, None], "unit": "kg"})
    assert json.loads(path.read_text()) == {"m": [1.5, None], "unit": "kg"}
    write_text(path, "Größe\n")
    assert path.read_bytes() == "Größe\n".encode()
    assert names(tmp_path) == ["result.json"]


@pytest.mark.parametrize("fault", [KeyboardInterrupt(), OSError(errno.ENOSPC, "No space left")])
def test_a_fault_while_writing_leaves_the_old_file(
    fault: BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "result.json"
    write_json(path, {"old": 1})
    whole = Path.write_text

    def half(self: Path, text: str, **how: str) -> int:
        whole(self, text[: len(text) // 2], **how)
        raise fault

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_text", half)
        with pytest.raises((KeyboardInterrupt, JobError)) as caught:
            write_json(path, {"new": 2})
    if isinstance(caught.value, JobError):
        assert str(caught.value) == f"{path}: the file cannot be written; got No space left"
    assert json.loads(path.read_text()) == {"old": 1}
    assert names(tmp_path) == ["result.json"]


def test_arrays_that_were_damaged_on_the_disk_are_none(tmp_path: Path) -> None:
    path = tmp_path / "arrays.npz"
    write_arrays(path, {"a": np.arange(9.0), "b": np.array(["x", "yy"])})
    whole, draw = path.read_bytes(), np.random.default_rng(0)
    assert read_arrays(path).keys() == {"a", "b"}
    for place in draw.integers(len(whole), size=800).tolist():
        path.write_bytes(whole[:place] + b"\x63" + whole[place + 1 :])
        assert read_arrays(path).keys() <= {"a", "b", "c"}


def test_the_file_gets_the_rights_of_any_new_file(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_text(tmp_path / "a.txt", "a")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) == 0o640


def test_a_place_that_cannot_be_written_is_named_with_its_reason(tmp_path: Path) -> None:
    for path in (tmp_path / "none" / "a.json", tmp_path):
        with pytest.raises(InputError, match="cannot be written") as caught:
            write_text(path, "a")
        assert caught.value.where == str(path)
        assert caught.value.value in {os.strerror(errno.ENOENT), os.strerror(errno.EISDIR)}
    for nameless in (Path("."), tmp_path / "a\0b"):
        with pytest.raises(InputError, match="cannot be written"):
            write_text(nameless, "a")
    with pytest.raises(InputError, match="no ordinary file"):
        write_text(Path("/"), "a")
    assert names(tmp_path) == []


@pytest.mark.parametrize("value", [float("nan"), float("inf"), {1, 2}])
def test_what_json_cannot_hold_is_refused_before_the_file_is_touched(
    value: object, tmp_path: Path
) -> None:
    path = tmp_path / "result.json"
    with pytest.raises(InputError, match="JSON values"):
        write_json(path, {"a": value})
    assert names(tmp_path) == []


@pytest.mark.parametrize("links", [True, False])
def test_a_file_that_appeared_since_it_was_looked_for_stays(
    links: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_links(*_: object) -> None:
        raise OSError(errno.EPERM, "Operation not permitted")

    if not links:
        monkeypatch.setattr(os, "link", no_links)
    path = tmp_path / "result.json"
    require_absent(path, force=False)
    path.write_text("of another process")
    for name in ("result.new-1.json", "result.new-2.json"):
        with pytest.raises(JobError, match=f"appeared.*{name}"):
            write_text(path, "ours")
        assert path.read_text() == "of another process"
        assert (tmp_path / name).read_text() == "ours"
        require_absent(tmp_path / "other.json", force=False)
    require_absent(path, force=True)
    write_text(path, "ours")
    assert path.read_text() == "ours"
    # What was looked for and not there is one's own from its first writing on.
    for text in ("once", "twice"):
        write_text(tmp_path / "other.json", text)
        assert (tmp_path / "other.json").read_text() == text
    assert len(names(tmp_path)) == 4
