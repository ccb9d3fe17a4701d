"""dynid and other tools on the same recordings: a page, its table in the README, and a figure.

Every tool runs on every case in a process of its own, the rivals in an environment of their own.
What is there already in runs/rivals is not run again.

    make rivals                                     # all of it, on a fresh machine
    python benchmarks/rivals/rivals.py UR10 Panda   # cases whose names begin so
    python benchmarks/rivals/rivals.py --page       # of what was measured before, nothing more

Where a rival errs less than dynid's default, the page says by how much; the reason has to stand in
notes.md, which it ends with.
"""

import ast
import json
import os
import platform
import signal
import subprocess
import sys
import textwrap
import time
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import cases
from run_one import CPU_LIMIT_S
from shared.measuring import DATA, ROOT, commit, fill, peak_mb, processor, run

import dynid
from dynid.figures import Axis, Figure, Level, Panel, Points, category_axis, write_figure

HERE = Path(__file__).parent
RUNS = ROOT / "runs" / "rivals"
PYTHON = ROOT / ".venv-rivals" / "bin" / "python"
DYNID = {"dynid": "anywhere", "dynid --for this-motion": "this-motion"}
RIVALS = {
    "figaroh 1.0.2": "with_figaroh",
    "pinocchio + SciPy": "plain_pinocchio",
    "mujoco.sysid": "with_mujoco",
    "mujoco-sysid 0.2.1": "with_mujoco_regressor",
}
TOOLS = (*DYNID, *RIVALS)
PACKAGES = ("figaroh", "pin", "mujoco", "mujoco-sysid", "scipy", "numpy")
ROLES = ("predicted", "joint2", "joint1", "joint3", "joint4", "measured")
README = ("UR5 no6", "UR10 1st", "KR300 A", "TX40 1st", "Panda 1st", "simulated")
"""Beginnings of the recordings that the README shows: one direction each."""
USER = """import dynid
record = dynid.read_recording("log.csv", robot=(robot := dynid.load_robot("ur5")))
result = dynid.identify([record], robot)
"""
"""What a user of dynid writes; or one line of shell, `dynid fit ur5 log.csv -o out`."""


def dynid_on(name: str, purpose: str, result: Path) -> None:
    """Identify and predict one case; in a process of its own."""
    case = next(c for c in cases.all_cases(DATA) if c.name == name)
    base = peak_mb()
    started = time.process_time()
    found = cases.real_recordings.identified(case, dynid.IdentifySettings(purpose=purpose))
    cpu = time.process_time() - started
    assert found.validation is not None
    rms = found.validation.metrics.rmse
    if case.truth is not None:
        rows = np.searchsorted(case.other.t, case.other.t[0] + found.validation.t - 1e-6)
        rms = np.sqrt(np.mean((found.validation.predicted - case.truth[rows]) ** 2, axis=0))
    told = {"rms": list(map(float, rms)), "cpu_s": cpu, "peak_mb": peak_mb(), "before_mb": base}
    result.write_text(json.dumps(told))


def measured(case: cases.Case, tool: str, *, old: bool) -> dict:
    """The result of a tool on a case, from the file if it is there; empty if that is to be old."""
    word = RIVALS[tool] if tool in RIVALS else f"dynid_{DYNID[tool]}"
    path = RUNS / "results" / f"{cases.folder_of(case, Path()).name}.{word}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    if old and not path.exists():
        return {}
    if not path.exists():
        part = path.with_suffix(".part")
        if tool in DYNID:
            words = [sys.executable, __file__, "--one", case.name, DYNID[tool], str(part)]
        else:
            folder = cases.write(case, RUNS / "cases")
            words = [str(PYTHON), str(HERE / "run_one.py"), RIVALS[tool], str(folder), str(part)]
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        with path.with_suffix(".log").open("w") as log:
            ended = subprocess.run(words, env=environment, stdout=log, stderr=log, check=False)
        if ended.returncode:
            over = ended.returncode == -signal.SIGXCPU
            told = f"stopped after {CPU_LIMIT_S} s of CPU" if over else f"code {ended.returncode}"
            part.write_text(json.dumps({"error": told}))
        part.replace(path)
    return json.loads(path.read_text())


def written(tool: str) -> int:
    """Lines that a user of a tool writes, without comments, docstrings and blanks."""
    source = USER if tool in DYNID else (HERE / f"{RIVALS[tool]}.py").read_text()
    strings = [
        range(node.lineno - 1, node.end_lineno or 0)
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    ]
    return sum(
        text.strip() != "" and text.strip()[0] != "#" and not any(k in rows for rows in strings)
        for k, text in enumerate(source.splitlines())
    )


def versions() -> str:
    """Versions of the rivals' packages."""
    words = f"import importlib.metadata as m; print([m.version(p) for p in {PACKAGES!r}])"
    told = subprocess.run([str(PYTHON), "-c", words], capture_output=True, text=True, check=True)
    found = ast.literal_eval(told.stdout)
    return ", ".join(f"{name} {version}" for name, version in zip(PACKAGES, found, strict=True))


def error_cells(row: dict[str, dict]) -> list[str]:
    """Errors of the tools on one recording, the best in bold."""
    errors = {tool: error_of(row.get(tool)) for tool in TOOLS}
    best, cells = np.nanmin(list(errors.values())), []
    for tool, error in errors.items():
        if np.isnan(error):
            cells.append("x" if tool in row else "-")
        else:
            cells.append(f"**{error:.3g}**" if error == best else f"{error:.4g}")
    return cells


def costs(table: dict[str, dict[str, dict]]) -> dict[str, list[str]]:
    """CPU, memory and lines of each tool."""
    known = [[row[tool] for row in table.values() if "rms" in row.get(tool, {})] for tool in TOOLS]
    cpu = [[r["cpu_s"] for r in rows] for rows in known]
    memory = [[r["peak_mb"] - r["before_mb"] for r in rows] for rows in known]
    return {
        "CPU, median [s]": [f"{np.median(x):.1f}" if x else "-" for x in cpu],
        "memory beyond imports, largest [MB]": [f"{max(x):.0f}" if x else "-" for x in memory],
        "lines a user writes": [str(written(tool)) for tool in TOOLS],
    }


def table_of(head: str, rows: dict[str, list[str]]) -> list[str]:
    """A table of numbers in Markdown, a column a tool."""
    lines = [f"| {name} | {' | '.join(cells)} |" for name, cells in rows.items()]
    return [f"| {head} | {' | '.join(TOOLS)} |", "|---|" + "---:|" * len(TOOLS), *lines]


def behind(row: dict[str, dict]) -> str:
    """Who errs less than dynid's default, and by how much; empty for nobody."""
    errors = {tool: error_of(row.get(tool)) for tool in TOOLS}
    less = {tool: 100 * (1 - errors[tool] / errors["dynid"]) for tool in RIVALS}
    told = ", ".join(f"{tool} by {share:.0f} %" for tool, share in less.items() if share > 0)
    own = errors["dynid --for this-motion"]
    return told and f"less than dynid's default err {told}; `--for this-motion`: {own:.4g}."


def document(table: dict[str, dict[str, dict]]) -> tuple[str, str]:
    """The page of results, and the README's table."""
    errors = table_of("recording", {name: error_cells(row) for name, row in table.items()})
    lines = [
        "# dynid beside other tools",
        "",
        f"Made by `benchmarks/rivals/rivals.py` (`make rivals`) on {datetime.now(UTC).date()}: "
        f"{processor()}, {os.cpu_count()} cores, Python {platform.python_version()}, "
        f"dynid {dynid.__version__} ({commit()}), {versions()}.",
        "",
        "Error on the part that was not identified: root of the summed squares of the joints' "
        "RMS errors [N.m], best in bold. `-`: not run; `x`: failed, see below.",
        "",
        *errors,
        "",
        *table_of("", costs(table)),
    ]
    less = {name: behind(row) for name, row in table.items()}
    failed = {
        f"{tool}, {name}": found["error"]
        for name, row in table.items()
        for tool, found in row.items()
        if "error" in found
    }
    for title, part in (("Where dynid is not first", less), ("What failed", failed)):
        told = [f"- {name}: {text}" for name, text in part.items() if text]
        words = {"subsequent_indent": "  ", "break_on_hyphens": False}
        told = [textwrap.fill(text, 118, **words) for text in told]
        lines += ["", f"## {title}", "", *told] if told else []
    absent = {tool: sum(tool not in row for row in table.values()) for tool in TOOLS}
    told = "; ".join(f"{tool} on {count} cases" for tool, count in absent.items() if count)
    if told:
        again = "`make rivals` runs what is missing"
        lines += ["", f"Not run (`-`), as the run was ended before: {told}. {again}."]
    shown = [*errors[:2], *(row for row in errors[2:] if row[2:].startswith(README))]
    return "\n".join(lines) + "\n\n" + (HERE / "notes.md").read_text(), "\n".join(shown)


def error_of(found: dict | None) -> float:
    """Root of the summed squares; NaN without a result."""
    return float(np.linalg.norm(found["rms"])) if found and "rms" in found else float("nan")


def draw(table: dict[str, dict[str, dict]], path: Path) -> None:
    """Error of each tool over dynid's, recording by recording."""
    tools, names = TOOLS[1:], list(table)
    marks: list = [Level(1.0, "predicted", "dynid", upright=True, dash="")]
    for tool, role in zip(tools, ROLES[1:], strict=True):
        points = [
            (error_of(row.get(tool)) / error_of(row.get("dynid")), k)
            for k, row in enumerate(table.values())
        ]
        known = [(x, k) for x, k in points if np.isfinite(x)]
        if known:
            x, y = map(np.array, zip(*known, strict=True))
            marks.append(Points(np.clip(x, 0.5, 20), y, role, tool, size=7))
    figure = Figure(
        title="Torque error on another motion, over dynid's",
        x=Axis(low=0.5, high=20, log=True, label="times dynid's error (20: or more)"),
        panels=(Panel(marks=tuple(marks), y=category_axis(names), height=26.0 * len(names)),),
    )
    write_figure(figure, path)


def main(names: tuple[str, ...] = (), /, page: bool = False, one: tuple[str, ...] = ()) -> None:
    """Measure; write the page and the figure, of all recordings."""
    if one:
        case, purpose, result = one
        dynid_on(case, purpose, Path(result))
        return
    if not DATA.exists():
        print(f"no recordings at {DATA}: simulated arms only")
    table: dict[str, dict[str, dict]] = {}
    for case in cases.all_cases(DATA):
        if names and not case.name.startswith(names):
            continue
        found = {tool: measured(case, tool, old=page) for tool in (*RIVALS, *DYNID)}
        if any(found.values()):
            table[case.name] = {tool: result for tool, result in found.items() if result}
        print(case.name, {tool: round(error_of(r), 3) for tool, r in found.items()}, flush=True)
    if not names:
        draw(table, ROOT / "docs" / "figures" / "rivals.svg")
        text, shown = document(table)
        (ROOT / "docs" / "benchmarks.md").write_text(text)
        fill(ROOT / "README.md", "rivals", shown)


if __name__ == "__main__":
    run(main)
