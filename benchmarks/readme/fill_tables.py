"""Measure the two tables of the README again, and write them into it: `make readme`."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

from dynid.workflow import run_demo
from dynid.workflow.demo import DemoRow

ROOT = Path(__file__).parents[2]


def real_recordings() -> str:
    """The table of `benchmarks/real_recordings.py`, without its times."""
    script = ROOT / "benchmarks" / "real_recordings.py"
    done = subprocess.run([sys.executable, str(script)], check=True, capture_output=True, text=True)
    return "\n".join(line.rsplit("|", 2)[0] + "|" for line in done.stdout.splitlines())


def demo() -> str:
    """The table of `dynid demo`."""
    with tempfile.TemporaryDirectory() as folder:
        rows = [_row(row) for row in run_demo(folder).table]
    head = "| quantity | unit | paper | `--preset paper` | `--preset best` |"
    return "\n".join([head, "|---|---|---|---|---|", *rows])


def _row(row: DemoRow) -> str:
    numbers = (
        "-" if value is None else f"{value:.3g}" if isinstance(value, float) else str(value)
        for value in (row.paper, row.preset_paper, row.preset_best)
    )
    return "| " + " | ".join((row.quantity, row.unit, *numbers)) + " |"


def main() -> int:
    """Replace what stands between the marks; 1 if there is nothing to measure."""
    if not (ROOT.parent / "shared" / "data").exists():
        print("the recordings are not at ../shared/data", file=sys.stderr)
        return 1
    readme = ROOT / "README.md"
    text = readme.read_text()
    for name, table in (("results", real_recordings()), ("demo", demo())):
        marks = re.compile(rf"(<!-- {name} -->\n).*?(\n<!-- /{name} -->)", re.DOTALL)
        text = marks.sub(lambda found, new=table: found[1] + new + found[2], text)
    readme.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
