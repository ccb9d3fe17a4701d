"""A certificate as a table, for `dynid design` and `dynid check`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from dynid.cli.output import number, print_table

if TYPE_CHECKING:
    from rich.console import Console


def print_certificate(screen: Console, data: Mapping[str, Any]) -> None:
    """Print margins and where each is smallest.

    Args:
        screen: Where to.
        data: With the keys `margins`, `worst`, `proven` and `notes` of a certificate.
    """
    rows: list[tuple[str, ...]] = []
    for key, margin in data["margins"].items():
        kind = key.removesuffix("_m")
        worst = data["worst"].get(kind)
        if worst is None:
            rows.append((kind.replace("_", " "), "not judged", "-", "-", ""))
            continue
        left = f"{1000 * margin:.1f} mm apart" if key.endswith("_m") else f"{100 * margin:.1f} %"
        time = worst["t"]
        rows.append(
            (
                kind.replace("_", " "),
                left,
                number(worst["limit"]),
                "-" if time is None else f"{time:.2f}",
                str(worst.get("joint") or worst.get("bodies") or ""),
            )
        )
    print_table(
        screen,
        "What is left of each limit",
        ("limit", "left", "limit [SI]", "at [s]", "where"),
        rows,
        words=(0, 4),
    )
    for note in data["notes"]:
        screen.print(f"- {note}.")
