"""The tutorial runs as it is printed, from an empty folder with a URDF in it."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from cli_runs import Outcome, Recordings, Run

import dynid
from dynid.export.verification import C_FLAGS, c_compiler
from dynid.simulation import Thermal

TEXT = (Path(__file__).parents[2] / "docs" / "tutorial.md").read_text()
LINK = """
<link name="l{k}"><inertial><origin xyz="{com}"/><mass value="{m}"/>
 <inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j{k}" type="revolute"><parent link="l{p}"/><child link="l{k}"/><origin xyz="{xyz}"/>
 <axis xyz="{axis}"/><limit lower="-2.5" upper="2.5" effort="150" velocity="3"/>
 <dynamics damping="2" friction="3"/></joint>"""
TOOL_KG = 1.5


def arm(tool: float = 0.0) -> str:
    links = (
        {"com": "0.02 0.01 0.1", "m": 6, "i": 0.05, "xyz": "0 0 0.2", "axis": "0 0 1"},
        {"com": "0.2 0.03 0.02", "m": 5, "i": 0.04, "xyz": "0.05 0 0.1", "axis": "0 1 0"},
        {"com": "0.15 -0.02 0.01", "m": 2 + tool, "i": 0.01, "xyz": "0.4 0 0", "axis": "0 1 0"},
    )
    text = "".join(LINK.format(k=k + 1, p=k, **link) for k, link in enumerate(links))
    return f'<robot name="arm"><link name="l0"/>{text}</robot>'


def recorded(
    folder: Path, design: str, seed: int, *, tool: float = 0.0, thermal: Thermal = "cold"
) -> dynid.ExperimentRecord:
    path = folder / "moved.urdf"
    path.write_text(arm(tool))
    motion = dynid.read_trajectory(str(folder / design)).trajectory
    robot = dynid.load_robot(path)
    made = dynid.simulate_recording(robot, motion, periods=1, seed=seed, thermal=thermal)
    # Without drive gains an ampere of the simulated arm is a newton metre.
    torque = {"effort": made.signals["current"]}
    return replace(made, signals={**made.signals, **torque})


def write_log(record: dynid.ExperimentRecord, path: Path) -> None:
    signals = record.signals
    names = [f"{what}_{j}" for what in ("position", "velocity", "effort") for j in range(1, 4)]
    table = np.column_stack([record.t, signals["q"], signals["qd"], signals["effort"]])
    header = ",".join(["time", *names])
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.7f")


def prepare(folder: Path, words: list[str]) -> None:
    """What happens outside of dynid before a command: the arm moves and is recorded."""
    if words[0] == "import":
        seed = 1 + words[1].startswith("second")
        write_log(recorded(folder, words[1].replace("_log.csv", ".json"), seed), folder / words[1])
    if words[0] == "payload":
        loaded = recorded(folder, "first.json", 3, tool=TOOL_KG)
        write_log(loaded, folder / "loaded.csv")
        target = folder / "loaded.parquet"
        dynid.import_recording([folder / "loaded.csv"], target, robot=folder / "arm.urdf")


def steps() -> list[tuple[str, str]]:
    found = re.finditer(r"(?m)^ {4}dynid ([^\n]*)$|^```python\n([\s\S]*?)^```", TEXT)
    return [(match[1] or "", match[2] or "") for match in found]


@pytest.mark.usefixtures("undiagnosed_once")
def test_the_tutorial_runs_as_printed(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    plainly = partial(dynid.identify_temperature, settings=dynid.IdentifySettings(preset="paper"))
    monkeypatch.setattr(dynid, "identify_temperature", plainly)
    (tmp_path / "arm.urdf").write_text(arm())
    said: dict[str, Outcome] = {}
    for command, code in steps():
        if code:
            if "identify_temperature" in code:
                for seed, (name, degC) in enumerate({"cold": 20, "warmer": 30, "warm": 40}.items()):
                    record = recorded(tmp_path, "first.json", seed, thermal=float(degC))
                    dynid.write_record(record, tmp_path / f"{name}.parquet")
            exec(compile(code, "tutorial.md", "exec"), {})
            continue
        words = shlex.split(command)
        prepare(tmp_path, words)
        # Short searches and no choices: what is looked at here is the path.
        quick = {"design": ["--starts", "1"], "identify": ["--preset", "paper"]}
        outcome = run(*words, *quick.get(words[0], []))
        assert outcome.code == 0, (command, outcome)
        said[command] = outcome
    assert "arm" in sys.modules["arm_model"].__doc__
    names = [path.name for path in tmp_path.iterdir()]
    assert {"arm.h", "arm.xml", "report.html", "arm_at_40.h", "any.json"} <= set(names)
    mass = re.search(r"Payload: ([\d.]+) kg", next(said[c].out for c in said if "payload" in c))
    assert mass is not None
    assert float(mass[1]) == pytest.approx(TOOL_KG, abs=0.3)


@pytest.mark.skipif(c_compiler() is None, reason="needs a C compiler")
def test_the_loop_in_c_compiles(run: Run, tmp_path: Path, recordings: Recordings) -> None:
    """Its names and arguments are those of a header."""
    (code,) = re.findall(r"```c\n(.*?)```", TEXT, re.DOTALL)
    assert run("export", recordings.estimate, "--to", "c", "-o", tmp_path / "ur5.h").code == 0
    program = (
        '#include "ur5.h"\nvoid stop(void) {}\n'
        "void cycle(const double *q, const double *dq, const double *torque, double limit)\n"
        f"{{\n{code.replace('arm_', 'ur5_')}\n}}\nint main(void) {{ return 0; }}\n"
    )
    (tmp_path / "loop.c").write_text(program)
    words = [str(c_compiler()), *C_FLAGS, "loop.c", "-o", "loop", "-lm"]
    subprocess.run(words, cwd=tmp_path, check=True)
    if shutil.which("g++"):
        strict = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror"]
        (tmp_path / "loop.cc").write_text(program)
        subprocess.run(["g++", *strict, "-c", "loop.cc"], cwd=tmp_path, check=True)
