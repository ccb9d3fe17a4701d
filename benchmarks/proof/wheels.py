"""Wheel and sdist of dynid and urtwin, installed in empty environments, with each extra.

    python benchmarks/proof/wheels.py [--pythons 3.11 3.12 3.13] [--only sdist sim ur ...]

Interpreters are those of the PATH and of pyenv. Each environment starts as a copy of the bare
installation, so that a row holds what the extra adds. After each installation `dynid --version`,
the analysis of a robot and the import of the extra's packages have to work; the bare one also reads
the example log. `oldest` is what the oldest packages that the requirements of the bare installation
allow make of that log. Packages come from the index or pip's cache, as wheels only.
"""

import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
import venv
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from shared.measuring import ROOT, print_head, print_row, run

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
LOG = ROOT / "examples" / "data" / "ur5_no6.csv.gz"
MODULES = {
    "sim": "mujoco",
    "ur": "rtde_control",
    "collision": "coal",
    "sdp": "clarabel",
    "ros": "rosbags, mcap, lz4",
    "excel": "python_calamine",
    "hdf5": "h5py",
    "dask": "distributed",
    "objects": "fsspec",
    "figures": "resvg_py",
    "studio": "dynid.studio",
    "all": "mujoco, coal, clarabel, rosbags, h5py, distributed",
}
"""What has to be importable with an extra."""


def interpreter(version: str) -> str | None:
    """A Python of this version, or None."""
    pyenv = sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python"))
    for path in (*map(str, pyenv), shutil.which(f"python{version}")):
        if path is None:
            continue
        done = subprocess.run([path, "--version"], capture_output=True, text=True)
        if done.stdout.startswith(f"Python {version}."):
            return path
    return None


def python_runs(python: Path, *words: str | Path, cwd: Path | None = None) -> None:
    """Run Python, which has to succeed; by default outside the repository."""
    place = python.parents[1] if cwd is None else cwd
    command = [str(python), *map(str, words)]
    subprocess.run(command, check=True, cwd=place, stdout=subprocess.DEVNULL)


def pip(python: Path, *words: str | Path) -> None:
    """Install quietly, wheels only."""
    quiet = ("--quiet", "--disable-pip-version-check", "--only-binary", ":all:")
    python_runs(python, "-m", "pip", "install", *quiet, *words)


def build(folder: Path) -> Path:
    """Wheels and sdists of both distributions; the folder that holds them."""
    target = folder / "dist"
    venv.create(folder / "build", with_pip=True)
    python = folder / "build" / "bin" / "python"
    pip(python, "hatchling>=1.25")
    for source in (ROOT, ROOT / "urtwin"):
        python_runs(python, "-m", "hatchling", "build", "-d", target, cwd=source)
    return target


def install(case: str, python: Path, dist: Path) -> None:
    """One installation, and what has to work in it."""
    (wheel,), (twin,) = dist.glob("dynid-*.whl"), dist.glob("urtwin-*.whl")
    modules = ""
    match case:
        case "bare":
            pip(python, wheel)
            python_runs(python, "-m", "dynid", "import", LOG, "--robot", "ur5", "-o", "log.parquet")
        case "oldest":
            pip(python, *(words.replace(">=", "==") for words in PROJECT["dependencies"]))
            python_runs(python, "-m", "dynid", "fit", "ur5", LOG, "-o", "fitted")
        case "sdist":
            (source,) = dist.glob("dynid-*.tar.gz")
            pip(python, "--no-deps", "--force-reinstall", "--no-binary", "dynid", source)
        case "urtwin":
            pip(python, f"{wheel}[sim]", twin)
            modules = ", urtwin"
        case _:
            pip(python, f"{wheel}[{case}]")
            missing = case == "ur" and python.resolve().name.endswith("3.13")
            modules = "" if missing else f", {MODULES[case]}"
    python_runs(python, "-c", f"import dynid{modules}")
    python_runs(python, "-m", "dynid", "--version")
    python_runs(python, "-m", "dynid", "analyze", "ur5", "--json")


def megabytes(folder: Path) -> float:
    """Size of the installed packages, without pip [MB]."""
    (site,) = folder.glob("lib/python*/site-packages")
    files = (path for path in site.rglob("*") if path.is_file())
    return 1e-6 * sum(
        path.stat().st_size for path in files if path.relative_to(site).parts[0] != "pip"
    )


def main(pythons: tuple[str, ...] = ("3.11", "3.12", "3.13"), only: tuple[str, ...] = ()) -> bool:
    """Build, install, print a row each; true if one fails."""
    known = ["sdist", "oldest", *PROJECT["optional-dependencies"], "urtwin"]
    known.remove("dev")
    failed = 0
    print_head(("Python", "installed", "MB", "s", "result"))
    with tempfile.TemporaryDirectory() as place:
        dist = build(Path(place))
        for version in pythons:
            own = interpreter(version)
            if own is None:
                print_row((version, "-", "", "", "no such interpreter here"))
                continue
            bare = Path(place) / version
            subprocess.run([own, "-m", "venv", str(bare)], check=True)
            # Of the oldest packages there are no wheels for newer ones.
            cases = [x for x in only or known if x != "oldest" or version == "3.11"]
            for case in ("bare", *cases):
                folder = bare if case == "bare" else Path(place) / f"{version}-{case}"
                if folder != bare:
                    shutil.copytree(bare, folder, symlinks=True, copy_function=_link)
                started, result = time.perf_counter(), "passed"
                try:
                    install(case, folder / "bin" / "python", dist)
                except subprocess.CalledProcessError as error:
                    failed += 1
                    result = f"failed: {' '.join(map(str, error.cmd))[-80:]}"
                wall = time.perf_counter() - started
                print_row((version, case, f"{megabytes(folder):.0f}", f"{wall:.0f}", result))
                if folder != bare:
                    shutil.rmtree(folder)
            shutil.rmtree(bare)
    print(f"{failed} installations failed")
    return failed > 0


def _link(source: str, target: str) -> str:
    """A hard link in place of a copy: pip replaces files, it does not edit them."""
    Path(target).hardlink_to(source)
    return target


if __name__ == "__main__":
    run(main)
