"""Measure the tables of the README and of docs/real-recordings.md again, and draw its picture."""

import sys
import tempfile
from pathlib import Path

from claim import claim
from picture import draw

from dynid.workflow import run_demo
from dynid.workflow.demo import DemoRow

sys.path.insert(0, str(Path(__file__).parents[1]))
from shared.measuring import DATA, ROOT, child, fill


def real_recordings() -> str:
    """The table of `benchmarks/real_recordings.py`, without its times."""
    lines = child([ROOT / "benchmarks" / "real_recordings.py"]).splitlines()
    return "\n".join(line.rsplit("|", 2)[0] + "|" for line in lines)


FIRST = ("UR5 no6, on no5", "UR5 no6, on no7", "UR10 1st", "KR300 A", "TX40 1st", "Panda 1st")
"""The rows of the README: one direction each, the presets `paper` and best for `anywhere`."""
SHOWN = (0, 1, 2, 3, 8)
"""Their columns."""


def selected(table: str) -> str:
    """The README's part of the whole table."""
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()]
    head, body = rows[:2], [row for row in rows[2:] if row[0].startswith(FIRST)]
    kept = [*head, *(row for row in body if row[1] != "this-motion")]
    return "\n".join(f"| {' | '.join(row[k] for k in SHOWN)} |" for row in kept)


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
    # A bar would end the cell.
    quantity = row.quantity.replace("|", "\\|")
    return "| " + " | ".join((quantity, row.unit, *numbers)) + " |"


def main() -> int:
    """Replace what stands between the marks; 1 if there is nothing to measure."""
    if not DATA.exists():
        print("the recordings are not at ../shared/data", file=sys.stderr)
        return 1
    whole = real_recordings()
    fill(ROOT / "docs" / "real-recordings.md", "results", whole)
    fill(ROOT / "README.md", "results", selected(whole))
    fill(ROOT / "README.md", "demo", demo())
    fill(ROOT / "README.md", "claim", claim())
    draw()
    return 0


if __name__ == "__main__":
    sys.exit(main())
