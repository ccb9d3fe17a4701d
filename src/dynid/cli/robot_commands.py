"""Commands about robots and their loads: `robots`, `analyze`, `gains`, `payload`, `compare`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from dynid.cli import ask, show
from dynid.settings import SceneSettings

if TYPE_CHECKING:
    from rich.console import Console

    from dynid import validation, workflow


@ask.command("dynid robots", "dynid robots --json")
def robots_command(json: ask.JsonFlag = False) -> None:
    """List the built-in robots."""
    from dynid.robot import robots

    found = robots()
    if json:
        show.print_json({"robots": [robot._asdict() for robot in found]})
        return
    screen = show.console()
    show.print_table(
        screen,
        "Built-in robots",
        dict.fromkeys(("name", "joints", "arm")),
        # The first part of the source names the arm.
        [(robot.name, robot.joints, robot.source.split("; ", 1)[0]) for robot in found],
    )
    screen.print("\nWhere each number is from: dynid robots --json")
    screen.print("Any other arm: give a URDF or a robot file (TOML) in the place of the name.")


MAX_SAMPLES = 10_000


@ask.command(
    "dynid analyze ur5",
    "dynid analyze ur5 --mount wall --terms fc,fv,im,fo",
    "dynid analyze arm.urdf --frames dh --json",
)
def analyze_command(
    robot: ask.RobotArgument,
    frames: Annotated[
        str, ask.option("dh|mdh|urdf", "Frames of the parameters; default: its own.")
    ] = "",
    mount: Annotated[str | None, ask.declared(SceneSettings, "mount")] = None,
    samples: Annotated[
        int,
        ask.option("N", "Random points; more where the rank needs them.", min=1, max=MAX_SAMPLES),
    ] = 25,
    seed: ask.SeedOption = 0,
    terms: Annotated[
        str, ask.option("fc,fv,im[,fo]", "Also fca, fva, fs, fr; fo:1+3 is for joints 1 and 3.")
    ] = "fc,fv,im",
    everything: Annotated[
        bool, ask.flag("--all", "Print every base parameter with its unit.")
    ] = False,
    json: ask.JsonFlag = False,
) -> None:
    """Rank and base parameters of a robot (paper 2.1)."""
    from dynid.robot import load_robot
    from dynid.workflow import analyze

    model = load_robot(robot, mount=mount, collision=False)
    result = analyze(model, frames=frames, samples=samples, seed=seed, terms=terms)
    if json:
        show.print_json(result.to_json())
    else:
        _show(result, everything)


MOST_ROWS = 18
"""Combinations that are printed unasked."""
MOST_CHANGES, MOST_LETTERS = 15, 28
"""Changes of `dynid compare` that are printed unasked, and letters of a combination there."""


def _show(result: workflow.Analysis, everything: bool) -> None:
    data, screen = result.to_json(), show.console()
    screen.print(
        f"{data['robot']}: {data['standard_parameters']} standard parameters, "
        f"{data['base_parameters']} base parameters",
        style="bold",
    )
    before, after = data["gap"]
    screen.print(
        f"identifiable alone {data['identifiable_alone']}, in combination "
        f"{data['identifiable_combined']}, not at all {data['unidentifiable']}; "
        f"{data['frames']} frames, mounting {data['mount']}, terms {data['terms']}, "
        f"{data['samples']} random points"
    )
    screen.print(f"at the rank, singular values fall from {before:.1e} to {after:.1e}")
    rows = list(zip(data["expressions"], data["units"], strict=True))
    alone = [name for name, e in zip(data["names"], data["expressions"], strict=True) if name == e]
    if not everything:
        screen.print()
        screen.print(f"Identifiable alone ({len(alone)}): {', '.join(alone)}")
        rows = [row for row in rows if row[0] not in alone]
    shown = rows if everything else [(_shortened(e), unit) for e, unit in rows[:MOST_ROWS]]
    title = "Base parameters" if everything else f"Identifiable in combination ({len(rows)})"
    show.print_table(screen, title, {"combination": None, "unit": None}, shown)
    if not everything:
        screen.print("--all prints every combination in full")
    screen.print()
    screen.print("Not identifiable: " + (", ".join(data["unidentifiable_names"]) or "none"))
    for note in data["notes"]:
        screen.print(f"- {note}.")
    show.print_findings(screen, "Warnings", result.warnings)


def _shortened(expression: str, longest: int = 62) -> str:
    """As many terms of a combination as fit on a line."""
    if len(expression) <= longest:
        return expression
    return expression[: expression.rfind(" ", 0, longest - 4)] + " ..."


@ask.command("dynid gains run.parquet", "dynid gains log.csv --robot ur10 --json")
def gains_command(
    record: Annotated[
        Path, ask.argument("RECORD", "A recording with target currents and moments.")
    ],
    robot: ask.RobotOption = None,
    json: ask.JsonFlag = False,
) -> None:
    """Drive gains, from target currents and moments (UR)."""
    from dynid import figures, workflow

    (opened,), model = workflow.open_records([record], robot)
    found = workflow.identify_gains(opened, model)
    data: dict[str, Any] = {"robot": model.name, **found.to_json(model.joint_names)}
    if json:
        show.print_json(data)
        return
    screen = show.console()
    pairs = zip(data["gains"], model.drives.gain, strict=True)
    rows = [(row["joint"], row["gain"], row["std"], known, row["r2"]) for row, known in pairs]
    columns = {"joint": None, "gain": 4, "std": 4, "robot's": 4, "r2": 6}
    unit = figures.joint_unit("N.m/A", model.prismatic)
    show.print_table(screen, f"Drive gains [{unit}]", columns, rows)
    if all(row["gain"] is not None for row in data["gains"]):
        screen.print()
        screen.print("--gains " + ",".join(f"{row['gain']:.4f}" for row in data["gains"]))
    show.print_findings(screen, "Warnings", found.warnings)


@ask.command(
    "dynid payload empty.parquet gripper.parquet",
    "dynid payload empty.parquet gripper.parquet --robot ur5 --json",
)
def payload_command(
    unloaded: Annotated[Path, ask.argument("UNLOADED", "A recording without the payload.")],
    loaded: Annotated[Path, ask.argument("LOADED", "One with it, preferably of the same motion.")],
    robot: ask.RobotOption = None,
    mount: ask.MountOption = None,
    cutoff: Annotated[float | None, ask.option("HZ", "Low-pass cut-off; default: chosen.")] = None,
    gains: ask.GainsOption = None,
    json: ask.JsonFlag = False,
) -> None:
    """Mass, centre and inertia of a payload, with intervals."""
    from dynid.robot import with_mount
    from dynid.workflow import identify_payload, open_records

    (empty, carrying), model = open_records([unloaded, loaded], robot, ask.drive_gains(gains))
    model = model if mount is None else with_mount(model, mount)
    found = identify_payload(empty, carrying, model, cutoff_hz=cutoff)
    data: dict[str, Any] = {"robot": model.name, **found.to_json()}
    if json:
        show.print_json(data)
        return
    screen = show.console()
    half = float(data["mass_interval"][1]) - found.mass
    width = half / found.mass_std
    if found.mass < half:
        most = found.mass + half
        screen.print(f"No significant payload: below {most:.2g} kg (95 %)", style="bold")
        show.print_findings(screen, "Findings", found.warnings)
        return
    screen.print(f"Payload: {found.mass:.4g} kg ± {half:.2g} kg (95 %)", style="bold")
    axes = zip("xyz", found.centre, found.centre_std, strict=True)
    rows = [(f"centre {axis}", "m", place, width * std) for axis, place, std in axes]
    tensor = data["parameters"][4:]
    rows += [(row["name"], row["unit"], row["value"], width * row["std"]) for row in tensor]
    columns = {"quantity": None, "unit": None, "value": 4, "± (95 %)": 4}
    show.print_table(screen, "In the flange frame, tensor about its origin", columns, rows)
    show.print_findings(screen, "Findings", found.warnings)


@ask.command(
    "dynid gravity poses.csv --robot ur5",
    "dynid gravity stops.parquet -o gravity.json",
)
def gravity_command(
    record: Annotated[Path, ask.argument("RECORD", "Poses at rest, or a motion with stops.")],
    robot: ask.RobotOption = None,
    mount: ask.MountOption = None,
    gains: ask.GainsOption = None,
    output: Annotated[
        Path | None, ask.option("FILE", "Also write the parameters as JSON.", "--output", "-o")
    ] = None,
    everything: Annotated[bool, ask.flag("--all", "Print every parameter, in full.")] = False,
    force: ask.ForceFlag = False,
    json: ask.JsonFlag = False,
) -> None:
    """Gravity parameters and stiction, from poses at rest."""
    from dynid import core, figures, identification, validation, workflow
    from dynid.robot import with_mount

    if output is not None:
        show.check_output(output, inputs=[record], suffix=".json", force=force)
    (opened,), model = workflow.open_records([record], robot, ask.drive_gains(gains))
    mounted = model if mount is None else with_mount(model, mount)
    found = identification.identify_gravity(opened, mounted)
    findings = (*found.warnings, *validation.record_findings(model, opened))
    data: dict[str, Any] = found.to_json() | core.told(findings)
    if output is not None:
        core.write_json(output, data)
    if json:
        show.print_json(data)
        return
    screen = show.console()
    unit = figures.joint_unit("N.m", model.prismatic)
    said = f"{len(found.values)} gravity parameters from {found.poses} poses at rest"
    screen.print(f"{model.name}: {said}", style="bold")
    given = found.published
    prior = "plausible bodies" if given is None else "published inertias"
    rows = [
        (
            name,
            found.left_out[j],
            None if given is None else given[j],
            f"{show.number(float(found.band[j]), 3)} ± {show.number(float(found.band_std[j]), 1)}",
        )
        for j, name in enumerate(model.joint_names)
    ]
    columns = {"joint": None, "left out": 3, "published": 3, "band (95 %)": 3}
    show.print_table(screen, f"RMS errors at poses left out, stiction band [{unit}]", columns, rows)
    rows = [
        (
            row["expression"] if everything else _shortened(row["expression"]),
            row["value"],
            row["std"],
            row["unit"],
            prior if row["from_prior"] else "poses",
        )
        for row in data["parameters"]
    ]
    columns = {"combination": None, "value": 4, "std": 2, "unit": None, "from": None}
    show.print_table(screen, "Gravity parameters", columns, rows)
    screen.print()
    masses = [name for name in data["unseen"] if name.startswith("m")]
    screen.print(
        "Not identifiable at rest: inertia tensors, motor inertias, friction while moving, "
        + ", ".join(masses)
    )
    show.print_findings(screen, "Findings", findings)


@ask.command("dynid compare cold.json warm.json", "dynid compare a.json b.json --json")
def compare_command(
    a: Annotated[Path, ask.argument("A.json", "An estimate, such as that of the cold robot.")],
    b: Annotated[Path, ask.argument("B.json", "Another, such as that of the warm robot.")],
    everything: Annotated[bool, ask.flag("--all", "Print every base parameter, in full.")] = False,
    json: ask.JsonFlag = False,
) -> None:
    """Which parameters changed between two estimates (paper 3.2)."""
    from dynid.validation import compare

    comparison = compare(a, b)
    if json:
        show.print_json(comparison.to_json())
    else:
        _print_comparison(show.console(), comparison, everything)


def _print_comparison(
    screen: Console, comparison: validation.ParameterComparison, everything: bool
) -> None:
    called = [_shortened(text, MOST_LETTERS) for text in comparison.expressions]
    groups = [
        (
            group.name,
            "moved" if group.moved else "did not move",
            len(group.members),
            group.median_change_percent,
            "-" if group.largest is None else called[group.largest],
            group.largest_z,
            group.limit_z,
        )
        for group in comparison.groups
    ]
    columns = {"group": None, "": None, "number": 3, "median %": 3, "largest": None}
    columns |= {"|z|": 3, "limit": 3}
    show.print_table(screen, "Groups, z = change in standard deviations", columns, groups)
    size = [abs(float(z)) for z in comparison.z]
    order = range(len(size)) if everything else sorted(range(len(size)), key=lambda k: -size[k])
    rows = [
        (
            comparison.expressions[k] if everything else called[k],
            comparison.units[k],
            comparison.a[k],
            comparison.b[k],
            comparison.change_percent[k],
            comparison.z[k],
        )
        for k in order
    ]
    columns = {"parameter": None, "unit": None, "A": 4, "B": 4, "change %": 3, "z": 3}
    title = "Base parameters" if everything else "Largest changes"
    shown = rows if everything else rows[:MOST_CHANGES]
    show.print_table(screen, title, columns, shown)
    if not everything:
        screen.print(f"--all prints all {len(rows)} base parameters in full")
    show.print_findings(screen, "Findings", comparison.warnings)
