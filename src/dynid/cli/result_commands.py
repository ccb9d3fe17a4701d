"""Commands that show and hand over results: export, report, fleet, studio, bench, demo."""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dynid import core
from dynid.cli import ask, show
from dynid.settings import FleetSettings

if TYPE_CHECKING:
    from dynid.studio import Served


MATERIAL = 1e-4
"""Torques that miss the prediction by less are not told [N.m or N]."""


@ask.command(
    "dynid export ur5.json --to urdf -o ur5.urdf",
    "dynid export ur5.json --to c -o ur5_dynamics.h --json",
)
def export_command(
    estimate: ask.EstimateArgument,
    to: Annotated[
        str,
        ask.option(
            "urdf|mjcf|json|c|python", "c: one C99 header; python: one file that needs NumPy alone."
        ),
    ],
    output: Annotated[Path, ask.option("FILE", "Where the model goes.", "-o", "--output")],
    urdf: Annotated[
        Path | None,
        ask.option(
            "FILE", "Robot's own URDF, to copy with the identified inertias; default: where it was."
        ),
    ] = None,
    at: ask.TemperatureOption = None,
    force: ask.ForceFlag = False,
    json: ask.JsonFlag = False,
) -> None:
    """A model that other programs load, checked by loading it."""
    from dynid import export, figures, identification

    show.check_output(output, [estimate], force=force)
    export.check_suffix(to, output)
    result = export.write_model(identification.open_estimate(estimate, at), output, to, urdf=urdf)
    if json:
        show.print_json(result.to_json())
        return
    screen, verified = show.console(), result.verified
    copied = "" if result.source is None else f", a copy of {result.source}"
    screen.print(f"{to} model written to {output}{copied}", soft_wrap=True)
    known = result.model.robot.urdf
    if to == "urdf" and known and result.source is None:
        screen.print(f"{known} is not there: links have names of their own; --urdf names the file.")
    if verified.max_torque_difference is None:
        screen.print(f"Not verified: {verified.loaded_with}.")
    else:
        screen.print(
            f"Verified with {verified.loaded_with}: torques of what the file holds differ by "
            f"{show.number(verified.max_torque_difference)} at most in {verified.states} random "
            "states."
        )
    screen.print(f"Standard parameters: {result.model.origin}.")
    if result.left_out:
        screen.print(f"Not representable in {to}: {', '.join(result.left_out)}.")
    if result.left_out or result.left_out_rms.max() > MATERIAL:
        rms = " ".join(show.number(float(value), 3) for value in result.left_out_rms)
        screen.print(
            f"Its torques miss the prediction by {rms} "
            f"{figures.joint_unit('N.m', result.model.robot.prismatic)}, RMS by joint over the "
            "recorded range."
        )
        if result.left_out and result.model.presliding is not None:
            screen.print(f"That is without presliding: {export.AFTER_REVERSALS}.")
    show.print_findings(screen, "Warnings", result.warnings)


@ask.command(
    "dynid report runs/demo -o report.html",
    "dynid report runs/demo --figures figures --png",
)
def report_command(
    directory: Annotated[Path, ask.argument("DIR", "Estimates, recordings and designs.")],
    output: Annotated[Path, ask.option("FILE.html", "The page to write.", "-o", "--output")] = Path(
        "report.html"
    ),
    figures: Annotated[
        Path | None, ask.option("FOLDER", "Also write each figure there, as SVG.")
    ] = None,
    png: Annotated[
        bool, ask.flag("--png", "With --figures: PNG too; needs the extra figures.")
    ] = False,
    force: ask.ForceFlag = False,
    json: ask.JsonFlag = False,
) -> None:
    """One self-contained page, with the verdict first."""
    from dynid import report, workflow

    show.check_output(output, suffix=".html", force=force)
    if png:
        if figures is None:
            raise core.InputError("PNG needs a folder", where="--png", next_step="--figures FOLDER")
        core.require("resvg_py", "figures")
    with show.progress_bar("report") as progress:
        path, contents = workflow.report(directory, output, progress=progress)
        drawn = ()
        if figures is not None:
            drawn = report.write_figures(contents, figures, png=png, force=force)
    if json:
        show.print_json(
            {
                "file": str(path),
                "bytes": path.stat().st_size,
                "estimates": [item.name for item in contents.estimates],
                "skipped": [list(pair) for pair in contents.skipped],
                **({} if figures is None else {"figures": [str(file) for file in drawn]}),
            }
        )
        return
    screen = show.console()
    for item in contents.estimates:
        screen.print(f"{item.name}: {item.headline}", style="bold")
    for name, why in contents.skipped:
        screen.print(f"- left out: {name} ({why})", soft_wrap=True)
    screen.print(f"Written: {path}", soft_wrap=True)


_MOST_LINES = 10
"""Findings of a fleet, and recordings that were left out, that are printed without --all."""


@ask.command(
    "dynid fleet recordings/ -o runs/fleet",
    "dynid fleet recordings/ -o runs/fleet --jobs 4 --json",
)
def fleet_command(
    folder: Annotated[
        str, ask.argument("DIR", "Recordings: ROBOT/DAY/FILE, or a manifest.csv; path or s3://...")
    ],
    settings: FleetSettings,
    output: Annotated[
        Path, ask.option("DIR", "Table, page, state and cache.", "-o", "--output")
    ] = Path("runs/fleet"),
    everything: Annotated[
        bool, ask.flag("--all", "Print every alarm and every recording that was left out.")
    ] = False,
    json: ask.JsonFlag = False,
) -> None:
    """Many robots and days: estimates, friction trends, alarms."""
    from dynid.workflow import fleet

    with show.progress_bar("fleet") as progress:
        found = fleet(folder, output, settings, progress=progress)
    data = found.to_json()
    if json:
        show.print_json(data)
        return
    screen = show.console()
    alarms, trends = show.count(len(found.alarms), "alarm"), show.count(found.tests, "trend")
    recordings, robots = len(found.recordings), show.count(len(data["robots"]), "robot")
    screen.print(
        f"{alarms} in {trends}; without any change, an alarm has a probability of "
        f"{100 * settings.false_alarms:g} %",
        style="bold",
    )
    screen.print(
        f"{show.count(recordings, 'recording')} of {robots}: {found.computed} computed, "
        f"{recordings - found.computed} from the cache, {len(found.skipped)} left out"
    )
    notices = sorted(found.findings, key=lambda told: not told.joints)
    most = len(notices) + len(found.skipped) if everything else _MOST_LINES
    show.print_findings(screen, "Findings", notices[:most])
    for name, why in found.skipped[:most]:
        screen.print(f"- left out {name}: {why}", soft_wrap=True)
    hidden = len(notices[most:]) + len(found.skipped[most:])
    if hidden:
        screen.print(f"--all also prints {show.count(hidden, 'more line')}")
    files = [Path(file) for file in data["files"]]
    screen.print(f"Written to {output}: {', '.join(file.name for file in files)}", soft_wrap=True)
    screen.print(f"Next: open {files[1]}", soft_wrap=True)


@ask.command(
    "dynid studio runs/demo",
    "dynid studio design.json",
    "dynid studio ur5e --port 8123",
    "dynid studio runs/demo --host 0.0.0.0",
)
def studio_command(
    path: Annotated[
        str | None, ask.argument("PATH", "Directory, design, recording, or robot; default: here.")
    ] = None,
    robot: Annotated[
        str | None, ask.option("ROBOT", "Robot, where the files have none or it has moved.")
    ] = None,
    host: Annotated[str, ask.option("ADDRESS", "Where to listen.")] = "127.0.0.1",
    port: Annotated[
        int | None, ask.option("PORT", "0 for any. [default: 8080 or next]", min=0, max=65535)
    ] = None,
    token: Annotated[
        str | None, ask.option("TEXT", "Access token; generated where one is needed.")
    ] = None,
    json: ask.JsonFlag = False,
) -> None:
    """A local page: the arm in 3D, design, live run, results.

    It serves until Ctrl-C. With --json, one object is printed on stdout when it can be opened.
    """
    from dynid import experiment, studio

    def ready(served: Served) -> None:
        if json:
            show.print_json(asdict(served))
            sys.stdout.flush()
        print(f"dynid studio: open {served.url} - Ctrl-C ends it.", file=sys.stderr, flush=True)
        if not served.local:
            print(
                "dynid studio: warning: other machines can reach the page; what it sends is not "
                "encrypted, its token neither",
                file=sys.stderr,
                flush=True,
            )

    with experiment.stop_on_signals() as stop:
        studio.serve(path, ready, stop, robot=robot, host=host, token=token, port=port)


@ask.command(
    "dynid bench estimators", "dynid bench estimators --only ols,iv,didim --seeds 5 --json"
)
def _estimators(
    only: Annotated[str | None, ask.option("WORD,..", "Some of the words of --estimator.")] = None,
    seeds: Annotated[int, ask.option("N", "Trajectories and noises.", min=1)] = 3,
    jobs: ask.JobsOption = 1,
    dask: ask.DaskOption = None,
    json: ask.JsonFlag = False,
) -> None:
    """Every estimator, by noise and seed: BIRDy's metrics."""
    from dynid import bench, identification

    words = identification.ESTIMATORS
    if only is not None:
        words = tuple(word.strip() for word in only.split(","))
    with show.progress_bar("bench") as progress, core.workers(jobs, dask) as beside:
        trials = bench.compare_estimators(words, range(seeds), beside=beside, progress=progress)
    if json:
        show.print_json(bench.to_json(trials))
        return
    keys = ("scenario", "estimator", "d_beta", "d_tau_percent", "d_q_percent", "seconds")
    rows = sorted(bench.summary(trials), key=lambda row: row["scenario"])
    show.print_table(
        show.console(),
        f"Means over {show.count(seeds, 'seed')} (d_beta: 0 to 2; errors on another motion)",
        {"scenario": None, "estimator": None, "d_beta": 3, "d_tau %": 3, "d_q %": 3, "s": 2}
        | {"failed": 1},
        [[*(row[key] for key in keys), row["failures"] or ""] for row in rows],
    )


@ask.command("dynid bench verdicts", "dynid bench verdicts --clean 300 --each 60 --seed 1 --json")
def _verdicts(
    clean: Annotated[int, ask.option("N", "Clean recordings.", min=0)] = 12,
    each: Annotated[int, ask.option("N", "Recordings of each fault, over three sizes.", min=0)] = 3,
    seed: ask.SeedOption = 0,
    preset: Annotated[str, ask.option("paper|best", "As for identify.")] = "best",
    random_arms: Annotated[bool, typer.Option(help="A random arm for each recording.")] = False,
    json: ask.JsonFlag = False,
) -> None:
    """False alarms, and input faults that are identified."""
    from dynid import bench, workflow

    settings = workflow.IdentifySettings(preset=preset)

    def judge(made: bench.Recorded) -> bench.Judged:
        result = workflow.identify(made.record, made.robot, settings, validation=made.validation)
        shown = result.validation
        return bench.Judged(
            findings=result.warnings,
            level=workflow.verdict(result).level,
            t=() if shown is None else shown.t,
            predicted=() if shown is None else shown.predicted,
        )

    with show.progress_bar("bench") as progress:
        chosen = bench.cases(seed, clean, each, random_arms)
        rows = bench.run_verdicts(judge, chosen, progress=progress or core.silent)
    told = bench.summarise(rows)
    if json:
        asked = {"seed": seed, "preset": preset, "random_arms": random_arms}
        show.print_json(told | {"right_cause_percent": bench.rates(told)} | asked)
        return
    page = bench.markdown(told, f"Seed {seed}, preset {preset}")
    show.console().print(page, soft_wrap=True, markup=False)


def register_bench(app: typer.Typer) -> None:
    """Add the command group."""
    told, example = "Comparison of methods on arms with known parameters.", "dynid bench estimators"
    group = typer.Typer(help=told, epilog=ask.examples(example))
    for name, item in {"estimators": _estimators, "verdicts": _verdicts}.items():
        group.command(name, epilog=item.epilog)(item.run)
    app.add_typer(group, name="bench", rich_help_panel=None)


@ask.command("dynid demo -o runs/demo", "dynid demo -o runs/demo --quick --json")
def demo_command(
    output: Annotated[
        str, ask.option("DIR", "Where the files go.", "-o", "--output")
    ] = "runs/demo",
    quick: Annotated[
        bool,
        ask.flag(
            "--quick", "One repetition of each motion, not three, and a shorter search for them."
        ),
    ] = False,
    force: ask.ForceFlag = False,
    everything: Annotated[
        bool, ask.flag("--all", "Print the whole table, choices, warnings and files.")
    ] = False,
    json: ask.JsonFlag = False,
) -> None:
    """The whole paper on the simulated UR5, cold and warm."""
    from dynid.workflow import run_demo, verdict

    with show.progress_bar("demo") as progress:
        demo = run_demo(output, quick=quick, force=force, progress=progress)
    if json:
        show.print_json(demo.to_json())
        return
    screen = show.console()
    screen.print(verdict(demo.best).headline, style="bold")
    rows = [row for row in demo.table if everything or row.paper is not None]
    show.print_table(
        screen,
        "The paper's UR5 beside the simulated UR5",
        {"quantity": None, "unit": None, "paper": 4, "preset paper": 4, "preset best": 4},
        [(row.quantity, row.unit, row.paper, row.preset_paper, row.preset_best) for row in rows],
    )
    for row in rows:
        if row.note:
            screen.print(f"- {row.quantity}: {row.note}")
    page = Path(output) / "report.html"
    if not everything:
        screen.print(f"\nwritten to {output} in {demo.wall_s:.0f} s; open {page}", soft_wrap=True)
        return
    screen.print("\nChoices of preset best", style="bold")
    for choice in demo.best.estimate.choices:
        screen.print(f"- {choice}")
    show.print_findings(screen, "Warnings of preset best", demo.best.warnings)
    screen.print(f"\nFiles, after {demo.wall_s:.0f} s", style="bold")
    for path in demo.files:
        screen.print(f"- {path}", soft_wrap=True)
