"""Commands about motions: `dynid design`, `dynid check`."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dynid.cli.options import (
    ClearanceOption,
    FloorOption,
    ForceFlag,
    Interrupted,
    JsonFlag,
    MarginOption,
    MeshDirOption,
    PayloadOption,
    SeedOption,
    ToolOption,
    command,
)
from dynid.cli.output import number, print_table

if TYPE_CHECKING:
    from rich.console import Console

    from dynid.workflow import Check


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
            rows.append((kind.replace("_", " "), "not judged", "", "-", "-", ""))
            continue
        left = f"{1000 * margin:.1f} mm apart" if key.endswith("_m") else f"{100 * margin:.1f} %"
        time, least = worst["t"], worst["required"]
        rows.append(
            (
                kind.replace("_", " "),
                left,
                f"{1000 * least:.3g} mm" if key.endswith("_m") else f"{100 * least:.3g} %",
                number(worst["limit"]),
                "-" if time is None else f"{time:.2f}",
                str(worst.get("joint") or worst.get("bodies") or ""),
            )
        )
    print_table(
        screen,
        "Remaining margin of each limit",
        ("limit", "left", "asked", "limit [SI]", "at [s]", "where"),
        rows,
        words=(0, 5),
    )
    for item in data["unjudged"]:
        screen.print(f"- unjudged: {item['kind']}: {item['message']}. {item['next_step']}")
    for note in data["notes"]:
        screen.print(f"- {note}.")


JOBS = 2


@command(
    "dynid design ur5 -o design.json",
    "dynid design ur5 -o design.json --accuracy 3 --noise 2,2.5,1.5,0.4,0.4,0.3",
    "dynid design arm.urdf -o design.json --scene cell.json --motion task.parquet",
    "dynid design ur5 -o paper.json --limits paper --method ga",
)
def design_command(
    robot: Annotated[
        str, typer.Argument(metavar="ROBOT", help="Built-in name, URDF or robot file.")
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DESIGN.json", help="Where the design goes.")
    ],
    method: Annotated[
        str, typer.Option(metavar="gradient|ga", help="ga: the paper's genetic algorithm.")
    ] = "gradient",
    criterion: Annotated[
        str | None,
        typer.Option(
            metavar="prediction|cond|cond+sigma|d-opt|a-opt|e-opt",
            help="What is minimised, in place of --for.",
        ),
    ] = None,
    purpose: Annotated[
        str,
        typer.Option(
            "--for",
            metavar="prediction|parameters|cond",
            help="Purpose of the model. [default: prediction; cond with ga or paper limits]",
        ),
    ] = "",
    motion: Annotated[
        list[Path] | None,
        typer.Option(metavar="TASK", help="Task of the model: a design, recording or poses."),
    ] = None,
    accuracy: Annotated[
        float | None,
        typer.Option(metavar="PERCENT", help="The shortest motion expected to reach it."),
    ] = None,
    accept_weak: Annotated[
        bool, typer.Option("--accept-weak", help="Exit 0 even if the motion excites too little.")
    ] = False,
    trajectory: Annotated[
        str,
        typer.Option(
            metavar="fourier|modified-fourier|fourier-quintic|bspline|points",
            help="Kind of motion.",
        ),
    ] = "fourier",
    harmonics: Annotated[
        int | None,
        typer.Option(metavar="H", help="Of the series. [default: up to 1 Hz; 5 for cond]"),
    ] = None,
    period: Annotated[float, typer.Option(metavar="S", help="Time of one period.")] = 10.0,
    population: Annotated[int, typer.Option(metavar="N", help="Of the genetic algorithm.")] = 300,
    generations: Annotated[int, typer.Option(metavar="N", help="Of the genetic algorithm.")] = 5,
    starts: Annotated[
        int | None,
        typer.Option(metavar="N", help="Of the gradient method. [default: 4; 12 for cond]"),
    ] = None,
    budget: Annotated[
        float | None,
        typer.Option(metavar="S", help="Time to search; the result then depends on the machine."),
    ] = None,
    seed: SeedOption = 0,
    limits: Annotated[
        str,
        typer.Option(
            metavar="safe|paper", help="safe: all known limits; paper: q, dq and ddq alone."
        ),
    ] = "safe",
    scene: Annotated[
        Path | None, typer.Option(metavar="SCENE.json", help="Surroundings of the robot.")
    ] = None,
    no_collision: Annotated[
        bool, typer.Option("--no-collision", help="Do not check collisions.")
    ] = False,
    mesh_dir: MeshDirOption = None,
    floor: FloorOption = None,
    tool: ToolOption = None,
    payload: PayloadOption = None,
    margin: MarginOption = None,
    clearance: ClearanceOption = None,
    start: Annotated[
        str | None,
        typer.Option(metavar="Q1,..,QN", help="Pose at both ends; not for --trajectory fourier."),
    ] = None,
    noise: Annotated[
        str | None,
        typer.Option(metavar="S1,..,SN", help="Torque noise of each joint, to weight them [N.m]."),
    ] = None,
    previous: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="RECORD", help="A recording that the motion complements; may be repeated."
        ),
    ] = None,
    frames: Annotated[
        str, typer.Option(metavar="dh|mdh|urdf", help="Frames of the parameters; default: its own.")
    ] = "",
    mount: Annotated[
        str | None,
        typer.Option(metavar="floor|wall|ceiling|tilt:DEG", help="Mounting; default: the file's."),
    ] = None,
    terms: Annotated[
        str, typer.Option(metavar="fc,fv,im[,fo]", help="Friction terms of the model.")
    ] = "fc,fv,im",
    jobs: Annotated[
        int, typer.Option(metavar="N", min=1, help="Processes of the gradient method.")
    ] = JOBS,
    dask: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="A Dask scheduler, instead of --jobs.")
    ] = None,
    csv: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also write the motion as CSV.")
    ] = None,
    urscript: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also write a URScript program.")
    ] = None,
    ros: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also write a ROS JointTrajectory (YAML).")
    ] = None,
    movej: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Points as URScript movej.")
    ] = None,
    waypoints: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Points and times as CSV.")
    ] = None,
    krl: Annotated[Path | None, typer.Option(metavar="FILE", help="Points as KUKA KRL.")] = None,
    rapid: Annotated[Path | None, typer.Option(metavar="FILE", help="Points as ABB RAPID.")] = None,
    force: ForceFlag = False,
    json: JsonFlag = False,
) -> int:
    """Optimal excitation trajectory, certified (paper 2.2)."""
    from dynid.cli.output import check_output, print_json, progress_bar
    from dynid.workflow import (
        DesignSettings,
        design,
        export_motion,
        mesh_folders,
        parse_floor,
        parse_payload,
        parse_tool,
    )

    inputs = [path for path in (scene, *(previous or ()), *(motion or ())) if path is not None]
    check_output(output, inputs=inputs, suffix=".json", force=force)
    exports = {"csv": csv, "urscript": urscript, "ros": ros}
    exports |= {"movej": movej, "waypoints": waypoints, "krl": krl, "rapid": rapid}
    for kind, path in exports.items():
        if path is not None:
            check_output(path, inputs=inputs, where=f"--{kind}", force=force)
    _check_apart({"-o": output, **{f"--{kind}": path for kind, path in exports.items()}})
    settings = DesignSettings(
        method=method,
        purpose=purpose,
        motions=tuple(str(path) for path in motion or ()),
        criterion=criterion or "",
        accuracy_percent=accuracy,
        trajectory=trajectory,
        harmonics=harmonics,
        period_s=period,
        population=population,
        generations=generations,
        starts=starts,
        budget_s=budget,
        seed=seed,
        limits=limits,
        scene=None if scene is None else str(scene),
        collision=not no_collision,
        mesh_dirs=mesh_folders(mesh_dir),
        floor=parse_floor(floor),
        tool=parse_tool(tool),
        payload=parse_payload(payload),
        margin_percent=margin,
        clearance=clearance,
        frames=frames,
        mount=mount,
        terms=terms,
        start_pose=_numbers(start, "--start"),
        noise=_numbers(noise, "--noise"),
        previous=tuple(str(path) for path in previous or ()),
        jobs=jobs,
        dask=dask,
    )
    with progress_bar("design") as progress:
        found = design(robot, settings, output=output, progress=progress)
    for kind, path in exports.items():
        if path is not None:
            export_motion(found, kind, path)
    data = found.to_json()
    if json:
        print_json(data)
    else:
        _show(data, output, found.certificate.headline)
    for name in settings.unused:
        print(f"dynid: {name} is not used by --method {method}", file=sys.stderr)
    if found.interrupted:
        raise Interrupted(f"interrupted; the best design so far is in {output}")
    certificate = found.certificate
    if not found.feasible:
        print(f"dynid: {output} is {certificate.headline}. Do not run it.", file=sys.stderr)
    if not certificate.holds:
        return 1
    if found.findings and not accept_weak:
        for item in found.findings:
            print(f"dynid: {item.message}", file=sys.stderr)
        return 1
    return 0


def _check_apart(paths: Mapping[str, Path | None]) -> None:
    from dynid.core import InputError

    seen: dict[str, str] = {}
    for where, path in paths.items():
        if path is None:
            continue
        if str(path.absolute()) in seen:
            first = seen[str(path.absolute())]
            raise InputError(f"the same file as {first}", where=where, value=str(path))
        seen[str(path.absolute())] = where


def _numbers(text: str | None, where: str) -> tuple[float, ...] | None:
    from dynid.core import InputError

    if text is None:
        return None
    try:
        return tuple(float(word) for word in text.split(","))
    except ValueError as error:
        raise InputError(
            "needs numbers, one a joint, with commas between", where=where, value=text
        ) from error


def _show(data: Mapping[str, Any], output: Path, verdict: str) -> None:
    from dynid.cli.output import console, count, number

    screen = console()
    state = ", interrupted: the best so far" if data["interrupted"] else ""
    runs = f"{data['repetitions']} x " if data["repetitions"] > 1 else ""
    screen.print(
        f"{data['robot']}: expected torque error {number(data['predicted_torque_error_percent'])} %"
        f" from {runs}{data['duration_s']:g} s of motion, {verdict}{state}",
        style="bold",
    )
    screen.print(
        f"for {data['for']} on {data['purpose_motions']}, by torque noise alone; largest standard "
        f"deviation of a parameter {number(data['largest_parameter_std'])}"
    )
    screen.print(
        f"condition number {number(data['condition_number'])}, scaled columns "
        f"{number(data['scaled_condition_number'])}, log det "
        f"{number(data['log_det'])}; {data['base_parameters']} base parameters, "
        f"{data['samples']} samples, {data['frames']} frames"
    )
    screen.print(
        f"{data['method']}, {data['criterion']}: {data['evaluations']} motions in "
        f"{data['wall_s']:.1f} s, "
        f"{count(data['starts'], 'generation' if data['method'] == 'ga' else 'start')}, "
        f"ended by {data['ended_by']}"
    )
    if data["repair"]:
        screen.print(f"made feasible afterwards: {data['repair']}")
    print_certificate(screen, data)
    screen.print()
    again = shlex.quote(str(output))
    screen.print(f"written to {output}; show it again with: dynid check {again}", soft_wrap=True)


@command(
    "dynid check design.json",
    "dynid check design.json --scene cell.json --json",
)
def check_command(
    design: Annotated[Path, typer.Argument(metavar="DESIGN.json", help="A design or trajectory.")],
    limits: Annotated[
        str,
        typer.Option(
            metavar="safe|paper", help="safe: all known limits; paper: q, dq and ddq alone."
        ),
    ] = "safe",
    scene: Annotated[
        Path | None,
        typer.Option(metavar="SCENE.json", help="Surroundings; default: the design's scene."),
    ] = None,
    no_collision: Annotated[
        bool, typer.Option("--no-collision", help="Do not check collisions.")
    ] = False,
    robot: Annotated[
        str | None, typer.Option(metavar="ROBOT", help="If the design's robot file has moved.")
    ] = None,
    mount: Annotated[
        str | None,
        typer.Option(
            metavar="floor|wall|ceiling|tilt:DEG", help="Mounting; default: the design's."
        ),
    ] = None,
    mesh_dir: MeshDirOption = None,
    floor: FloorOption = None,
    tool: ToolOption = None,
    payload: PayloadOption = None,
    margin: MarginOption = None,
    clearance: ClearanceOption = None,
    json: JsonFlag = False,
) -> int:
    """Certify limits and collisions, also between samples."""
    from dynid.cli.output import print_json
    from dynid.workflow import check, mesh_folders, parse_floor, parse_payload, parse_tool

    result = check(
        design,
        limits=limits,
        scene=scene,
        collision=not no_collision,
        robot=robot,
        mount=mount,
        mesh_dirs=mesh_folders(mesh_dir),
        floor=parse_floor(floor),
        tool=parse_tool(tool),
        payload=parse_payload(payload),
        margin_percent=margin,
        clearance=clearance,
    )
    if json:
        print_json(result.to_json())
    else:
        _check_show(result)
    return 0 if result.feasible else 1


def _check_show(result: Check) -> None:
    from dynid.cli.output import console

    data = result.to_json()
    screen = console()
    verdict = result.certificate.headline
    screen.print(f"{data['robot']}, {data['duration_s']:g} s: {verdict}", style="bold")
    if (said := result.design.describe_digest()) is not None:
        screen.print(f"{said}; certified anew")
    if data["designed_for"] not in (None, data["limits"]):
        screen.print(f"designed with --limits {data['designed_for']}, held to {data['limits']}")
    print_certificate(screen, data)
