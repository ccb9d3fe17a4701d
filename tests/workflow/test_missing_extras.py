"""Without extras every job runs, or says at once which one it needs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

PROJECT = Path(__file__).parents[2] / "pyproject.toml"
EXTRAS = {
    "sim": "mujoco",
    "ur": "rtde_control",
    "collision": "coal",
    "sdp": "clarabel",
    "dask": "distributed",
    "objects": "fsspec",
    "figures": "resvg_py",
    "hdf5": "h5py",
    "excel": "python_calamine",
    "ros": "lz4",
}
"""Every extra, and the module that it is for."""
EXTRA_MODULES = (*EXTRAS.values(), "rtde_receive", "backports.zstd")
BUILT_WITHOUT = ("bz2", "_bz2", "lzma", "_lzma", "sqlite3", "_sqlite3")
"""What pyenv's Python lacks on a machine without the libraries."""


def without(
    modules: tuple[str, ...], folder: Path, *words: str, module: bool = True
) -> subprocess.CompletedProcess[str]:
    """What a command, or Python, says without modules, also in the processes that it starts."""
    start = folder.with_name(f"{folder.name}-start")
    start.mkdir()
    (start / "sitecustomize.py").write_text(
        f"import sys\nsys.modules.update(dict.fromkeys({modules}))\n"
    )
    paths = [str(start), *filter(None, [os.environ.get("PYTHONPATH")])]
    return subprocess.run(
        [sys.executable, *(("-m", "dynid") if module else ()), *words],
        capture_output=True,
        text=True,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        timeout=120,
        check=False,
    )


def test_every_extra_is_looked_at() -> None:
    declared = tomllib.loads(PROJECT.read_text())["project"]["optional-dependencies"]
    assert {name for name, needs in declared.items() if needs} - {"all", "dev"} == set(EXTRAS)
    assert {f"dynid[{','.join(sorted(EXTRAS))}]"} == {
        f"dynid[{','.join(sorted(item[6:-1].split(',')))}]" for item in declared["all"]
    }


JOBS = {
    "demo -o demo --quick": "sim",
    "controller --robot ur5 --virtual-time": "sim",
    "import a.h5 -o a.parquet --robot ur5": "hdf5",
    "import a.xlsx -o a.parquet --robot ur5": "excel",
    "import a.csv.zst -o a.parquet --robot ur5": "ros",
    "design ur5 -o d.json --dask 127.0.0.1:1": "dask",
    "fleet memory://recordings -o out": "objects",
}
"""Command to the extra that it needs."""
PYTHONS = {
    "import a.csv.bz2 -o a.parquet --robot ur5": "bz2",
    "import a.csv.xz -o a.parquet --robot ur5": "lzma",
    "import a.db3 -o a.parquet --robot ur5": "sqlite3",
}
"""Command to the module of Python that it needs."""
ANALYZE = "analyze ur5 --json"
"""A command that needs none."""
FILES = {
    "a.h5": b"\x89HDF\r\n\x1a\n" + bytes(64),
    "a.xlsx": b"PK\x03\x04" + bytes(64),
    "a.csv.zst": b"\x28\xb5\x2f\xfd" + bytes(64),
    "a.csv.bz2": b"BZh9" + bytes(64),
    "a.csv.xz": b"\xfd7zXZ\x00" + bytes(64),
    "a.db3": b"SQLite format 3\x00" + bytes(84),
}
ONE_AFTER_THE_OTHER = """
import contextlib, io, json, os, sys
from dynid.cli.app import main
found = []
for line in json.loads(sys.argv[1]):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(line.split())
    found.append([code, out.getvalue(), err.getvalue(), sorted(os.listdir())])
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Any]]:
    """Exit code, output, errors and files after each job, all in one process without extras."""
    folder = tmp_path_factory.mktemp("jobs")
    for name, content in FILES.items():
        (folder / name).write_bytes(content)
    jobs = [*JOBS, *PYTHONS, ANALYZE]
    words = ("-c", ONE_AFTER_THE_OTHER, json.dumps(jobs))
    done = without((*EXTRA_MODULES, *BUILT_WITHOUT), folder, *words, module=False)
    assert done.returncode == 0, done.stderr
    return dict(zip(jobs, json.loads(done.stdout), strict=True))


@pytest.mark.parametrize("job", JOBS | PYTHONS)
def test_a_job_says_what_it_needs_and_leaves_nothing(job: str, said: dict[str, list[Any]]) -> None:
    code, out, err, files = said[job]
    assert code == 2, err
    assert err.count("\n") == 1
    assert err.startswith("dynid: ")
    needed = f"pip install 'dynid[{JOBS[job]}]'" if job in JOBS else f"'{PYTHONS[job]}'"
    assert needed in err
    assert out == ""
    assert files == sorted(FILES)


def test_without_urtwin_the_command_says_how_to_install_it(tmp_path: Path) -> None:
    done = without(("urtwin",), tmp_path, "controller", "--robot", "ur5")
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1
    assert "pip install ./urtwin" in done.stderr


def test_the_core_dependencies_are_enough_to_analyze(said: dict[str, list[Any]]) -> None:
    code, out, err, _ = said[ANALYZE]
    assert code == 0, err
    assert json.loads(out)["base_parameters"] == 52
