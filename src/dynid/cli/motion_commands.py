"""Commands about motions and what is recorded of them: design, check, run, import, controller."""

from __future__ import annotations

import math
import shlex
import sys
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dynid.cli import ask, show
from dynid.core import InputError, MissingExtraError
from dynid.settings import DesignSettings, ImportOptions, LimitSettings, RunSettings

if TYPE_CHECKING:
    from rich.console import Console


def _print_certificate(screen: Console, data: Mapping[str, Any]) -> None:
    """Print the margins of a certificate's JSON, and where each is smallest."""
    rows: list[tuple[Any, ...]] = []
    reasons: dict[tuple[str, str], list[str]] = {}
    for item in data["unjudged"]:
        reasons.setdefault((item["message"], item["next_step"]), []).append(item["kind"])
    nothing: list[str] = []
    for key, margin in data["margins"].items():
        kind = key.removesuffix("_m")
        worst = data["worst"].get(kind)
        if worst is None:
            if any(kind in kinds for kinds in reasons.values()):
                rows.append((kind.replace("_", " "), "not judged", "", "-", "-", ""))
            else:
                nothing.append(kind.replace("_", " "))
            continue
        left = f"{100 * margin:.1f} %"
        if key.endswith("_m"):
            left = f"{abs(1000 * margin):.1f} mm {'apart' if margin >= 0 else 'overlap'}"
        time, least = worst["t"], worst["required"]
        rows.append(
            (
                kind.replace("_", " "),
                left,
                f"{1000 * least:.3g} mm" if key.endswith("_m") else f"{100 * least:.3g} %",
                worst["limit"],
                "-" if time is None else f"{time:.2f}",
                str(worst.get("joint") or worst.get("bodies") or ""),
            )
        )
    show.print_table(
        screen,
        "Remaining margin of each limit",
        {"limit": None, "left": 4, "asked": 4, "limit [SI]": 4, "at [s]": 4, "where": None},
        rows,
    )
    if nothing:
        screen.print(f"No limit, nothing to meet, or not asked for: {', '.join(nothing)}")
    for (message, step), kinds in reasons.items():
        screen.print(f"- unjudged: {', '.join(kinds)}: {message}. {step}")
    told = {cause for item in data["unjudged"] for cause in item["causes"]}
    for note in data["notes"]:
        if note not in told:
            screen.print(f"- {note}.")


@ask.command(
    "dynid design ur5 -o design.json",
    "dynid design ur5 -o design.json --accuracy 3 --noise 2,2.5,1.5,0.4,0.4,0.3",
    "dynid design arm.urdf -o design.json --scene cell.json --motion task.parquet",
    "dynid design ur5 -o paper.json --limits paper --method ga",
)
def design_command(
    robot: ask.RobotArgument,
    output: Annotated[Path, ask.option("DESIGN.json", "Where the design goes.", "-o", "--output")],
    settings: DesignSettings,
    accept_weak: Annotated[
        bool, ask.flag("--accept-weak", "Exit 0 even if the motion excites too little.")
    ] = False,
    jobs: ask.JobsOption = 2,
    csv: Annotated[Path | None, ask.option("FILE", "Also write the motion as CSV.")] = None,
    urscript: Annotated[Path | None, ask.option("FILE", "Also write a URScript program.")] = None,
    ros: Annotated[
        Path | None, ask.option("FILE", "Also write a ROS JointTrajectory (YAML).")
    ] = None,
    movej: Annotated[Path | None, ask.option("FILE", "Points as URScript movej.")] = None,
    waypoints: Annotated[Path | None, ask.option("FILE", "Points and times as CSV.")] = None,
    krl: Annotated[Path | None, ask.option("FILE", "Points as KUKA KRL.")] = None,
    rapid: Annotated[Path | None, ask.option("FILE", "Points as ABB RAPID.")] = None,
    force: ask.ForceFlag = False,
    json: ask.JsonFlag = False,
) -> int:
    """Optimal excitation trajectory, certified (paper 2.2)."""
    from dynid.workflow import check_export, design, export_motion, unfinished_path

    sources = (robot, *settings.motions, *settings.previous, *filter(None, [settings.scene]))
    inputs = list(map(Path, sources))
    show.check_output(output, inputs=inputs, suffix=".json", force=force)
    exports = {"csv": csv, "urscript": urscript, "ros": ros}
    exports |= {"movej": movej, "waypoints": waypoints, "krl": krl, "rapid": rapid}
    asked = {kind: path for kind, path in exports.items() if path is not None}
    for kind, path in asked.items():
        show.check_output(path, inputs=inputs, where=f"--{kind}", force=force)
        check_export(kind, robot, settings.trajectory)
    _check_apart({"-o": output, **{f"--{kind}": path for kind, path in asked.items()}})
    settings, unfinished = replace(settings, jobs=jobs), unfinished_path(output)
    with show.progress_bar("design") as progress:
        found = design(robot, settings, output=output, progress=progress)
    if found.interrupted:
        output = unfinished
        asked = {kind: unfinished_path(path) for kind, path in asked.items()}
    for kind, path in asked.items():
        export_motion(found, kind, path)
    if json:
        show.print_json(found.to_json())
    else:
        _show_design(found.to_json(), output, found.certificate.headline)
    for words in settings.unused:
        print(f"dynid: {words}", file=sys.stderr)
    if found.interrupted:
        raise ask.Interrupted(f"interrupted; the best design so far is in {output}")
    if not found.feasible:
        state = found.certificate.headline
        print(f"dynid: {output} is {state}. Do not run it.", file=sys.stderr)
    if not found.certificate.holds:
        return 1
    if found.findings and not accept_weak:
        for item in found.findings:
            print(f"dynid: {item.message}", file=sys.stderr)
        return 1
    return 0


def _check_apart(paths: Mapping[str, Path]) -> None:
    seen: dict[Path, str] = {}
    for where, path in paths.items():
        first = seen.setdefault(path.absolute(), where)
        if first != where:
            raise InputError(f"the same file as {first}", where=where, value=str(path))


def _show_design(data: Mapping[str, Any], output: Path, verdict: str) -> None:
    screen = show.console()
    state = ", interrupted: the best so far" if data["interrupted"] else ""
    runs = f"{data['repetitions']} x " if data["repetitions"] > 1 else ""
    error = data["predicted_torque_error_percent"]
    known = error is not None and math.isfinite(error)
    expected = f"{show.number(error)} %" if known else "unknown without masses of its links,"
    screen.print(
        f"{data['robot']}: expected torque error {expected} from {runs}"
        f"{data['duration_s']:g} s of motion, {verdict}{state}",
        style="bold",
    )
    screen.print(
        f"for {data['for']} on {data['purpose_motions']}, by torque noise alone; largest standard "
        f"deviation of a parameter {show.number(data['largest_parameter_std'])}"
    )
    screen.print(
        f"condition number {show.number(data['condition_number'])}, scaled columns "
        f"{show.number(data['scaled_condition_number'])}, log det "
        f"{show.number(data['log_det'])}; {data['base_parameters']} base parameters, "
        f"{data['samples']} samples, {data['frames']} frames"
    )
    screen.print(
        f"{data['method']}, {data['criterion']}: {data['evaluations']} motions in "
        f"{data['wall_s']:.1f} s, "
        f"{show.count(data['starts'], 'generation' if data['method'] == 'ga' else 'start')}, "
        f"ended by {data['ended_by']}"
    )
    if data["repair"]:
        screen.print(f"made feasible afterwards: {data['repair']}")
    _print_certificate(screen, data)
    screen.print()
    again = shlex.quote(str(output))
    screen.print(f"written to {output}; show it again with: dynid check {again}", soft_wrap=True)


@ask.command(
    "dynid check design.json",
    "dynid check design.json --scene cell.json --json",
)
def check_command(
    design: ask.DesignArgument,
    settings: LimitSettings,
    robot: Annotated[
        str | None, ask.option("ROBOT", "If the design's robot file has moved.")
    ] = None,
    json: ask.JsonFlag = False,
) -> int:
    """Certify limits and collisions, also between samples."""
    from dynid.workflow import check

    result = check(design, settings, robot=robot)
    data = result.to_json()
    if json:
        show.print_json(data)
        return 0 if result.feasible else 1
    screen, verdict = show.console(), result.certificate.headline
    screen.print(f"{data['robot']}, {data['duration_s']:g} s: {verdict}", style="bold")
    if (said := result.design.describe_digest()) is not None:
        screen.print(f"{said}; certified anew")
    if data["designed_for"] not in (None, data["limits"]):
        screen.print(f"designed with --limits {data['designed_for']}, held to {data['limits']}")
    _print_certificate(screen, data)
    return 0 if result.feasible else 1


@ask.command(
    "dynid run design.json --on sim -o run.parquet",
    "dynid run design.json --on sim -o warm.parquet --thermal warm --seed 1",
    "dynid run design.json --on sim -o run.parquet --until 3",
    "dynid run design.json --on ur://192.168.0.10 -o run.parquet --slow 0.2",
)
def run_command(
    design: ask.DesignArgument,
    output: ask.RecordOutput,
    settings: RunSettings,
    on: Annotated[str, ask.option("sim|ur://HOST", "The robot that executes it.")] = "sim",
    yes: Annotated[bool, ask.flag("--yes", "Move without confirmation.")] = False,
    until: Annotated[
        float | None,
        ask.option(
            "PERCENT",
            "Design, run and identify in turn, until this torque error is reached at the speeds of "
            "the motions that the design is for.",
        ),
    ] = None,
    json: ask.JsonFlag = False,
) -> None:
    """Execute a design and record it (paper 2.2, 3)."""
    from dynid import experiment, recording, workflow

    show.check_output(output, inputs=[design], suffix=".parquet")
    with experiment.stop_on_signals() as cancel, show.progress_bar("run") as progress:

        def ask_first(what: str, word: str) -> None:
            # Planning takes seconds: Ctrl-C in them is no reason to ask.
            if cancel.is_set():
                raise KeyboardInterrupt
            with nullcontext() if progress is None else progress.hidden():
                _ask(what, word)

        confirm = None if yes else ask_first
        given: dict[str, Any] = {"on": on, "settings": settings, "confirm": confirm}
        given |= {"cancel": cancel, "progress": progress}
        if until is not None:
            rounds = workflow.run_until(design, output, until, **given)
            if json:
                show.print_json(rounds.to_json())
            else:
                show.console().print(rounds.describe(), soft_wrap=True)
            rounds.raise_if_missed()
            return
        result = workflow.run_design(design, output, **given)
        if result.abort is not None and result.result.stopped_in is None:
            raise KeyboardInterrupt
    for name in ("scene", "floor", "tool", "accept_unjudged") if on == "sim" else ():
        if getattr(settings, name) not in (None, ()):
            word = name.replace("_", "-")
            said = "is not used: the simulated arm moves without a certificate (dynid check)"
            print(f"dynid: --{word} {said}", file=sys.stderr)
    if (said := result.design.describe_digest()) is not None and result.design.changed:
        print(f"dynid: {design}: {said}", file=sys.stderr)
    if result.left is not None:
        said = f"rows of an earlier, interrupted run. {recording.read_partial(result.left)}"
        print(f"dynid: {result.left}: {said}", file=sys.stderr)
    if result.abort is None and result.result.outcome.periods < settings.repeat:
        said = "set points were repeated or skipped; --method program executes each once"
        print(f"dynid: {result.record}: {said}", file=sys.stderr)
    if json:
        show.print_json(result.to_json())
    elif result.abort is None:
        outcome = result.result.outcome
        counts = (outcome.samples, outcome.periods, outcome.gaps)
        parts = zip(counts, ("sample", "whole period", "gap"), strict=True)
        show.console().print(", ".join(show.count(many, noun) for many, noun in parts))
        show.console().print(f"Recording: {result.record}", soft_wrap=True)
    result.raise_if_aborted()


def _ask(what: str, word: str) -> None:
    """Let a person type a word before anything moves.

    Raises:
        InputError: Nobody is there to ask, or another word was typed.
    """
    from dynid.experiment import interruptible

    if not sys.stdin.isatty():
        raise InputError("no terminal to confirm the motion on", next_step="Pass --yes.")
    show.console(stderr=True).print(what)
    with interruptible():
        typed = typer.prompt(f"Type {word} to move the robot", default="", err=True)
    if typed.strip() != word:
        raise InputError("the motion was not confirmed", value=typed.strip(), limit=word)


@ask.command(
    "dynid import run.csv --robot ur5 -o run.parquet",
    "dynid import log.txt --columns t=0,q=1:7,current=7:13 --robot ur5 -o log.parquet",
    "dynid import bag.db3 --robot ur10 -o bag.parquet",
)
def import_command(
    files: Annotated[
        list[Path], ask.argument("FILE", "One recording, or text files to be joined by columns.")
    ],
    output: ask.RecordOutput,
    settings: ImportOptions,
    robot: Annotated[str | None, ask.option("ROBOT", "Built-in name, URDF or robot file.")] = None,
    force: ask.ForceFlag = False,
    json: ask.JsonFlag = False,
) -> None:
    """Convert a recording: checked and repaired."""
    from dynid.workflow import import_recording

    show.check_output(output, inputs=files, suffix=".parquet", force=force)
    imported = import_recording(files, output, robot=robot, options=settings, force=force)
    data, screen = imported.to_json(), show.console()
    if json:
        show.print_json(data)
        return
    screen.print(f"{data['record']}: {data['samples']} samples", style="bold")
    screen.print(
        f"{show.number(data['duration_s'])} s at {show.number(data['rate_hz'])} Hz, "
        f"{data['joints']} joints, read as {data['format']}, robot {data['robot'] or 'not given'}"
    )
    screen.print(f"signals: {', '.join(data['signals'])}")
    if data["dropped_rows"]:
        screen.print(f"dropped rows: {data['dropped_rows']}")
    if data["notes"]:
        screen.print(f"notes: {data['notes']}")
    show.print_findings(screen, "Findings", imported.record.problems)
    if not imported.record.problems:
        screen.print("no problems found")
    for need in data["needs"]:
        screen.print(f"dynid identify needs more: {need}", style="bold")


def register_controller(app: typer.Typer) -> None:
    """Add the command: it starts urtwin, the simulated UR controller, which has the options."""
    passed_on: dict[str, Any] = {
        "help_option_names": [],
        "ignore_unknown_options": True,
        "allow_extra_args": True,
    }
    told = "A simulated UR controller: RTDE, script ports, dashboard."
    app.command("controller", help=told, context_settings=passed_on)(_controller)


def _controller(context: typer.Context) -> None:
    try:
        from urtwin.command import run_command
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            "the simulated controller is a distribution of its own, urtwin, which is not installed",
            next_step="In dynid's repository: pip install ./urtwin",
        ) from error

    run_command(context.args, "dynid controller")
