"""dynid and other tools on the same recordings: a page, its table in the README, and a figure.

Every tool runs on every case in a process of its own, the rivals in an environment of their own.
What is there already in runs/rivals is not run again.

    make rivals                                     # all of it, on a fresh machine
    python benchmarks/rivals/rivals.py UR10 Panda   # cases whose names begin so
    python benchmarks/rivals/rivals.py --page       # of what was measured before, nothing more
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
from run_one import CPU_LIMIT_S, peak_mb
from shared.measuring import DATA, ROOT, commit, processor

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
SAME_MOTION = (
    "Both recordings repeat one motion, and who follows that motion closely errs least. The "
    "default chooses a model for any motion, by parts of the workspace that are left out: on "
    "{other}, another motion, it errs by {own:.3g} N.m in all, everybody else by {least:.3g} to "
    "{most:.3g}."
)
REASONS = {"UR5 no6, on no7": "no5", "UR5 no7, on no6": "no5"}
"""Another motion, where dynid's default is not first on the same one."""
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
    told = {
        "rms": list(map(float, rms)),
        "cpu_s": cpu,
        "peak_mb": peak_mb(),
        "before_mb": base,
        "verdict": dynid.verdict(found).level,
    }
    result.write_text(json.dumps(told))


def measured(case: cases.Case, tool: str, *, run: bool = True) -> dict:
    """The result of a tool on a case, from the file if it is there; empty if it may not run."""
    word = RIVALS[tool] if tool in RIVALS else f"dynid_{DYNID[tool]}"
    path = RUNS / "results" / f"{cases.folder_of(case, Path()).name}.{word}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists() and not run:
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


def code_lines(source: str) -> int:
    """Lines without comments, docstrings and blanks."""
    tree, left = ast.parse(source), set()
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        first = body[0] if isinstance(body, list) and body else None
        if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
            left |= set(range(first.lineno, (first.end_lineno or 0) + 1))
    lines = source.splitlines()
    kept = [
        k for k, text in enumerate(lines, 1) if text.strip() and not text.lstrip().startswith("#")
    ]
    return len(set(kept) - left)


def written(tool: str) -> int:
    """Lines that a user of a tool writes."""
    return code_lines(USER if tool in DYNID else (HERE / f"{RIVALS[tool]}.py").read_text())


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


def document(table: dict[str, dict[str, dict]]) -> str:
    """The page of results."""
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
        *table_of("recording", {name: error_cells(row) for name, row in table.items()}),
        "",
        *table_of("", costs(table)),
    ]
    told = ((name, why_behind(name, table)) for name in table)
    behind = [_bullet(f"{name}: {why}") for name, why in told if why]
    failed = [
        _bullet(f"{tool}, {name}: {found['error']}")
        for name, row in table.items()
        for tool, found in row.items()
        if "error" in found
    ]
    for title, part in (("Where dynid is not first", behind), ("What failed", failed)):
        lines += ["", f"## {title}", "", *part] if part else []
    absent = {tool: sum(tool not in row for row in table.values()) for tool in TOOLS}
    told = "; ".join(f"{tool} on {count} cases" for tool, count in absent.items() if count)
    if told:
        again = "`make rivals` runs what is missing"
        lines += ["", f"Not run (`-`), as the run was ended before: {told}. {again}."]
    return "\n".join(lines) + "\n\n" + (HERE / "notes.md").read_text()


def _bullet(text: str) -> str:
    """An item of a list, as wide as the page."""
    return textwrap.fill(f"- {text}", 118, subsequent_indent="  ", break_on_hyphens=False)


def error_of(found: dict | None) -> float:
    """Root of the summed squares; NaN without a result."""
    return float(np.linalg.norm(found["rms"])) if found and "rms" in found else float("nan")


def why_behind(name: str, table: dict[str, dict[str, dict]]) -> str:
    """Who errs less than dynid's default, by how much, and why; empty for nobody."""
    errors = {tool: error_of(found) for tool, found in table[name].items() if "rms" in found}
    own = errors.get("dynid")
    better = {t: e for t, e in errors.items() if own is not None and t not in DYNID and e < own}
    told = ", ".join(f"{tool} by {100 * (1 - e / own):.0f} %" for tool, e in better.items())
    if not told:
        return ""
    purpose = errors.get("dynid --for this-motion", np.inf)
    first = "first" if purpose <= min(better.values()) else "not first either"
    said = f"less than dynid's default err {told}; `--for this-motion` is {first} ({purpose:.4g})."
    if name not in REASONS:
        return said
    row = table[f"{name.split(', on ')[0]}, on {REASONS[name]}"]
    others = [error_of(found) for tool, found in row.items() if tool not in DYNID]
    why = SAME_MOTION.format(
        other=REASONS[name],
        own=error_of(row["dynid"]),
        least=np.nanmin(others),
        most=np.nanmax(others),
    )
    return f"{said} {why}"


README = ("UR5 no6", "UR10 1st", "KR300 A", "TX40 1st", "Panda 1st", "simulated")
"""Beginnings of the recordings that the README shows: one direction each."""


def fill_readme(page: str) -> None:
    """Copy the page's table of errors to the README, one direction of each pair of recordings."""
    path, mark, end = ROOT / "README.md", "<!-- rivals -->\n", "\n<!-- /rivals -->"
    before, rest = path.read_text().split(mark)
    head, rule, *rows = page.split("\n\n")[3].splitlines()
    kept = "\n".join([head, rule, *(row for row in rows if row[2:].startswith(README))])
    path.write_text(before + mark + kept + end + rest.split(end)[1])


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


def main(words: list[str]) -> int:
    """Measure; write the page and the figure, of all recordings."""
    if words[:1] == ["--one"]:
        dynid_on(words[1], words[2], Path(words[3]))
        return 0
    run = words[:1] != ["--page"]
    words = words if run else words[1:]
    if not DATA.exists():
        print(f"no recordings at {DATA}: simulated arms only")
    table: dict[str, dict[str, dict]] = {}
    for case in cases.all_cases(DATA):
        if words and not any(case.name.startswith(word) for word in words):
            continue
        found = {tool: measured(case, tool, run=run) for tool in (*RIVALS, *DYNID)}
        if any(found.values()):
            table[case.name] = {tool: result for tool, result in found.items() if result}
        print(case.name, {tool: round(error_of(r), 3) for tool, r in found.items()}, flush=True)
    if words:
        return 0
    (ROOT / "docs" / "figures").mkdir(exist_ok=True)
    draw(table, ROOT / "docs" / "figures" / "rivals.svg")
    page = document(table)
    (ROOT / "docs" / "benchmarks.md").write_text(page)
    fill_readme(page)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
