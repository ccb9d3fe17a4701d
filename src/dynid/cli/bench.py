"""`dynid bench`."""

from __future__ import annotations

from typing import Annotated

import typer

from dynid.cli.options import JsonFlag, examples


def register(app: typer.Typer) -> None:
    """Add the command group."""
    group = typer.Typer(help="Methods side by side, on arms whose truth is known.")
    group.callback()(_root)
    group.command(
        "estimators",
        epilog=examples(
            "dynid bench estimators", "dynid bench estimators --only ols,iv,didim --seeds 5 --json"
        ),
    )(_estimators)
    app.add_typer(group, name="bench", rich_help_panel=None)


def _root() -> None:
    """Methods side by side, on arms whose truth is known."""


def _estimators(
    only: Annotated[
        str | None, typer.Option(metavar="WORD,..", help="Some of the words of --estimator.")
    ] = None,
    seeds: Annotated[int, typer.Option(metavar="N", min=1, help="Trajectories and noises.")] = 3,
    json: JsonFlag = False,
) -> None:
    """Every estimator, by noise and seed: BIRDy's figures."""
    from dynid.bench import compare_estimators, summary, to_json
    from dynid.cli.output import console, count, number, print_json, print_table
    from dynid.cli.progress import progress_bar
    from dynid.identification import ESTIMATORS

    words = ESTIMATORS if only is None else tuple(word.strip() for word in only.split(","))
    with progress_bar("bench") as progress:
        trials = compare_estimators(words, range(seeds), progress=progress)
    if json:
        print_json(to_json(trials))
        return
    rows = [
        (
            row["scenario"],
            row["estimator"],
            number(row["d_beta"], 3),
            number(row["d_tau_percent"], 3),
            number(row["d_q_percent"], 3),
            number(row["seconds"], 2),
            str(row["failures"] or ""),
        )
        for row in sorted(summary(trials), key=lambda row: row["scenario"])
    ]
    print_table(
        console(),
        f"Means over {count(seeds, 'seed')} (d_beta: 0 to 2; errors on another motion)",
        ("scenario", "estimator", "d_beta", "d_tau %", "d_q %", "s", "failed"),
        rows,
        words=(0, 1),
    )
