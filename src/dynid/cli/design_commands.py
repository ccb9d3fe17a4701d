"""Commands about motions: `dynid design`, `dynid check`."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from dynid.cli.options import (
    ClearanceOption,
    DaskOption,
    DesignArgument,
    FloorOption,
    ForceFlag,
    FramesOption,
    Interrupted,
    JobsOption,
    JsonFlag,
    LimitsOption,
    MarginOption,
    MeshDirOption,
    MountOption,
    MovedRobotOption,
    NoCollisionFlag,
    PayloadOption,
    RobotArgument,
    SceneOption,
    SeedOption,
    ToolOption,
    carried,
    command,
    flag,
    numbers,
    option,
)
from dynid.cli.output import (
    check_output,
    console,
    count,
    number,
    print_json,
    print_table,
    progress_bar,
)
from dynid.core import InputError

if TYPE_CHECKING:
    from rich.console import Console


def _print_certificate(screen: Console, data: Mapping[str, Any]) -> None:
    """Print the margins of a certificate's JSON, and where each is smallest."""
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


@command(
    "dynid design ur5 -o design.json",
    "dynid design ur5 -o design.json --accuracy 3 --noise 2,2.5,1.5,0.4,0.4,0.3",
    "dynid design arm.urdf -o design.json --scene cell.json --motion task.parquet",
    "dynid design ur5 -o paper.json --limits paper --method ga",
)
def design_command(
    robot: RobotArgument,
    output: Annotated[Path, option("DESIGN.json", "Where the design goes.", "-o", "--output")],
    method: Annotated[str, option("gradient|ga", "ga: the paper's genetic one.")] = "gradient",
    criterion: Annotated[
        str | None,
        option(
            "prediction|cond|cond+sigma|d-opt|a-opt|e-opt", "What is minimised, in place of --for."
        ),
    ] = None,
    purpose: Annotated[
        str,
        option(
            "prediction|parameters|cond",
            "Purpose of the model. [default: prediction; cond with ga or paper limits]",
            "--for",
        ),
    ] = "",
    motion: Annotated[
        list[str] | None, option("TASK", "Task of the model: a design, recording or poses.")
    ] = None,
    accuracy: Annotated[
        float | None, option("PERCENT", "The shortest motion expected to reach it.")
    ] = None,
    accept_weak: Annotated[
        bool, flag("--accept-weak", "Exit 0 even if the motion excites too little.")
    ] = False,
    trajectory: Annotated[
        str, option("fourier|modified-fourier|fourier-quintic|bspline|points", "Kind of motion.")
    ] = "fourier",
    harmonics: Annotated[
        int | None, option("H", "Of the series. [default: up to 1 Hz; 5 for cond]")
    ] = None,
    period: Annotated[float, option("S", "Time of one period.")] = 10.0,
    population: Annotated[int, option("N", "Of the genetic algorithm.")] = 300,
    generations: Annotated[int, option("N", "Of the genetic algorithm.")] = 5,
    starts: Annotated[
        int | None, option("N", "Of the gradient method. [default: 4; 12 for cond]")
    ] = None,
    budget: Annotated[
        float | None, option("S", "Time to search; the result then depends on the machine.")
    ] = None,
    seed: SeedOption = 0,
    limits: LimitsOption = "safe",
    scene: SceneOption = None,
    no_collision: NoCollisionFlag = False,
    mesh_dir: MeshDirOption = None,
    floor: FloorOption = None,
    tool: ToolOption = None,
    payload: PayloadOption = None,
    margin: MarginOption = None,
    clearance: ClearanceOption = None,
    start: Annotated[
        str | None, option("Q1,..,QN", "Pose at both ends; not for --trajectory fourier.")
    ] = None,
    noise: Annotated[
        str | None, option("S1,..,SN", "Torque noise of each joint, to weight them [N.m].")
    ] = None,
    previous: Annotated[
        list[str] | None,
        option("RECORD", "A recording that the motion complements; may be repeated."),
    ] = None,
    frames: FramesOption = "",
    mount: MountOption = None,
    terms: Annotated[str, option("fc,fv,im[,fo]", "Friction terms of the model.")] = "fc,fv,im",
    jobs: JobsOption = 2,
    dask: DaskOption = None,
    csv: Annotated[Path | None, option("FILE", "Also write the motion as CSV.")] = None,
    urscript: Annotated[Path | None, option("FILE", "Also write a URScript program.")] = None,
    ros: Annotated[Path | None, option("FILE", "Also write a ROS JointTrajectory (YAML).")] = None,
    movej: Annotated[Path | None, option("FILE", "Points as URScript movej.")] = None,
    waypoints: Annotated[Path | None, option("FILE", "Points and times as CSV.")] = None,
    krl: Annotated[Path | None, option("FILE", "Points as KUKA KRL.")] = None,
    rapid: Annotated[Path | None, option("FILE", "Points as ABB RAPID.")] = None,
    force: ForceFlag = False,
    json: JsonFlag = False,
) -> int:
    """Optimal excitation trajectory, certified (paper 2.2)."""
    from dynid.workflow import DesignSettings, design, export_motion

    motions, records = tuple(motion or ()), tuple(previous or ())
    inputs = [Path(path) for path in (*motions, *records, *filter(None, [scene]))]
    check_output(output, inputs=inputs, suffix=".json", force=force)
    exports = {"csv": csv, "urscript": urscript, "ros": ros}
    exports |= {"movej": movej, "waypoints": waypoints, "krl": krl, "rapid": rapid}
    asked = {kind: path for kind, path in exports.items() if path is not None}
    for kind, path in asked.items():
        check_output(path, inputs=inputs, where=f"--{kind}", force=force)
    _check_apart({"-o": output, **{f"--{kind}": path for kind, path in asked.items()}})
    settings = DesignSettings(
        method=method,
        purpose=purpose,
        motions=motions,
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
        scene=scene,
        collision=not no_collision,
        margin_percent=margin,
        clearance=clearance,
        frames=frames,
        mount=mount,
        terms=terms,
        start_pose=numbers(start, "--start"),
        noise=numbers(noise, "--noise"),
        previous=records,
        jobs=jobs,
        dask=dask,
        **carried(floor, tool, payload, mesh_dir),
    )
    with progress_bar("design") as progress:
        found = design(robot, settings, output=output, progress=progress)
    for kind, path in asked.items():
        export_motion(found, kind, path)
    if json:
        print_json(found.to_json())
    else:
        _show_design(found.to_json(), output, found.certificate.headline)
    for name in settings.unused:
        print(f"dynid: {name} is not used by --method {method}", file=sys.stderr)
    if found.interrupted:
        raise Interrupted(f"interrupted; the best design so far is in {output}")
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
    _print_certificate(screen, data)
    screen.print()
    again = shlex.quote(str(output))
    screen.print(f"written to {output}; show it again with: dynid check {again}", soft_wrap=True)


@command(
    "dynid check design.json",
    "dynid check design.json --scene cell.json --json",
)
def check_command(
    design: DesignArgument,
    limits: LimitsOption = "safe",
    scene: SceneOption = None,
    no_collision: NoCollisionFlag = False,
    robot: MovedRobotOption = None,
    mount: MountOption = None,
    mesh_dir: MeshDirOption = None,
    floor: FloorOption = None,
    tool: ToolOption = None,
    payload: PayloadOption = None,
    margin: MarginOption = None,
    clearance: ClearanceOption = None,
    json: JsonFlag = False,
) -> int:
    """Certify limits and collisions, also between samples."""
    from dynid.workflow import check

    result = check(
        design,
        limits=limits,
        scene=scene,
        collision=not no_collision,
        robot=robot,
        mount=mount,
        margin_percent=margin,
        clearance=clearance,
        **carried(floor, tool, payload, mesh_dir),
    )
    data = result.to_json()
    if json:
        print_json(data)
        return 0 if result.feasible else 1
    screen, verdict = console(), result.certificate.headline
    screen.print(f"{data['robot']}, {data['duration_s']:g} s: {verdict}", style="bold")
    if (said := result.design.describe_digest()) is not None:
        screen.print(f"{said}; certified anew")
    if data["designed_for"] not in (None, data["limits"]):
        screen.print(f"designed with --limits {data['designed_for']}, held to {data['limits']}")
    _print_certificate(screen, data)
    return 0 if result.feasible else 1
