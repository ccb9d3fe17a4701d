"""The screens that decide, as values for the page: answers, errors, rival models, next steps."""

import shlex
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dynid.diagnosis import Answer
from dynid.figures import joint_labels, joint_unit, number
from dynid.report.contents import ReportContents, ReportedEstimate
from dynid.report.figures import MODEL_NAMES, MODEL_ROLES, worst_first
from dynid.robot import joints_by_kind

PRECISE_PERCENT = 10.0
"""Relative standard deviation up to which a parameter is counted as precise."""
MOST_STEPS = 3
ANSWERS = {"yes": "yes", "limits": "with limits", "no": "no"}
LEVEL_WORDS = {"usable": "yes", "care": "with limits", "do_not_use": "no"}


@dataclass(frozen=True, slots=True, kw_only=True)
class PurposeAnswer:
    """One use of a result, and whether it serves it."""

    title: str
    answer: str
    role: str
    figure: str
    unit: str
    text: str
    detail: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bar:
    """A bar with its value; shares are of the width [%]."""

    name: str
    value: str
    share: float
    role: str = "predicted"
    tick: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """Something to do."""

    title: str
    """What was found, or what to do."""
    text: str
    command: str = ""


def headline(item: ReportedEstimate) -> str:
    """The first sentence of the page."""
    errors = item.errors
    if item.verdict is None or errors is None:
        return "Not judged: its recording is not in the folder"
    if item.level == "do_not_use":
        return "This result must not be used"
    if item.validation is not None:
        return f"Predicts torque to {_percent(errors.moving)} on another motion"
    told = item.estimate.assessment
    if told is not None:
        expected, _ = told.deciding_percent(item.estimate.model.robot.prismatic)
        return f"Expected to predict torque to {_percent(expected)}"
    return "Fits its own recording; no other motion has confirmed it"


def _percent(value: float) -> str:
    return f"{number(value, 2)}\N{NO-BREAK SPACE}%"


def lead(item: ReportedEstimate) -> str:
    """What it was identified from and validated on, and its error there with the rests."""
    made = ", ".join(item.conditions)
    text = f"Identified from one recording ({made})" if made else "Identified from a recording"
    errors = item.errors
    if item.validation is not None and errors is not None:
        tested = ", ".join(item.tested)
        text = f"{text}, validated on another motion" + (f" ({tested})" if tested else "")
        moving, whole = _percent(errors.moving), _percent(errors.whole)
        return f"{text}." if moving == whole else f"{text}: {moving} in motion, {whole} with rests."
    return f"{text}; no other motion has been predicted."


def purposes(item: ReportedEstimate) -> tuple[PurposeAnswer, ...]:
    """Prediction, parameters and simulation."""
    if item.verdict is None:
        return ()
    estimate, shown = item.estimate, item.shown
    names = joint_labels(estimate.model.robot.joint_names)
    error = float("nan") if item.errors is None else item.errors.moving
    unit = "% of torque in motion"
    if item.validation is None and estimate.assessment is not None:
        error, _ = estimate.assessment.deciding_percent(estimate.model.robot.prismatic)
        unit = "% of torque"
    detail = ""
    if shown is not None:
        by_joint = shown.moving.relative_error_percent
        worst = worst_first(shown)[0]
        slides = np.array(estimate.model.robot.prismatic)
        # Of joints of both kinds, those that turn.
        kind = slides if slides.all() else ~slides
        fastest = float(np.abs(shown.dq[:, kind]).max())
        speed = joint_unit("rad/s", slides[kind].tolist())
        detail = (
            f"Worst joint: {names[worst]} with {number(float(by_joint[worst]), 2)} %. "
            f"Tested up to {number(fastest, 2)} {speed}."
        )
    relative = estimate.relative_std_percent
    precise = [k for k in range(len(relative)) if relative[k] <= PRECISE_PERCENT]
    judged, within = item.verdict, f"within ±{PRECISE_PERCENT:g} % (1 σ)"  # noqa: RUF001
    words = _precise_words([estimate.names[k] for k in precise])
    return (
        _purpose("Prediction", judged.prediction, number(error, 2), unit, detail),
        _purpose(
            "Parameters",
            judged.parameters,
            str(len(precise)),
            f"of {len(relative)} {within}",
            words,
            judged.prediction.reason,
        ),
        _purpose("Simulation", judged.simulation, *_bodies(item), judged.prediction.reason),
    )


def _purpose(
    title: str, answer: Answer, figure: str, unit: str, detail: str, repeated: str = ""
) -> PurposeAnswer:
    reason = "as for prediction" if answer.reason in repeated else answer.reason
    return PurposeAnswer(
        title=title,
        answer=ANSWERS[answer.answer],
        role=ANSWERS[answer.answer].replace(" ", "-"),
        figure=figure,
        unit=unit,
        text=f"{reason[:1].upper()}{reason[1:]}.",
        detail=detail,
    )


_GROUPS = {
    "Fc": "Coulomb friction",
    "Fv": "viscous friction",
    "Im": "motor inertia",
    **dict.fromkeys(("mx", "my", "mz"), "first moments"),
    **dict.fromkeys(("Jxx", "Jyy", "Jzz", "Jxy", "Jxz", "Jyz"), "inertia tensors"),
}


def _precise_words(names: list[str]) -> str:
    found = Counter(_GROUPS.get(name.rstrip("0123456789")) for name in names)
    counted = [
        f"{found[word]} of {word}" for word in dict.fromkeys(_GROUPS.values()) if found[word]
    ]
    return f"Precise: {', '.join(counted)}." if counted else ""


def _bodies(item: ReportedEstimate) -> tuple[str, str, str]:
    """What the masses of single links rest on, and whether the links are physically consistent."""
    if item.links is None:
        return ("\N{EN DASH}", "links not separated", "")
    n = item.estimate.model.robot.joints
    share = 1 - item.links.prior_share[: 10 * n].reshape(n, 10)[:, 0]
    if item.estimate.standard is not None:
        detail = "All links are physically consistent; the rest of each is mostly the prior's."
    else:
        detail = (
            "Other values of single links are mostly the prior's. Physically consistent links: "
            "\N{NON-BREAKING HYPHEN}\N{NON-BREAKING HYPHEN}estimator sdp."
        )
    return (str(int(np.sum(share >= 0.5))), f"of {n} link masses mostly data", detail)


def joint_bars(item: ReportedEstimate) -> tuple[Bar, ...]:
    """Relative error of each moving joint, the worst first, with its noise floor."""
    shown = item.shown
    if shown is None:
        return ()
    names = joint_labels(item.estimate.model.robot.joint_names)
    relative = shown.moving.relative_error_percent
    error = np.nan_to_num(relative)
    told = item.estimate.assessment
    noise = None if told is None else 100 * told.sample_noise / np.maximum(told.torque, 1e-9)
    longest = max(float(error.max()), 1e-9 if noise is None else float(noise.max())) * 1.25
    return tuple(
        Bar(
            name=names[j],
            value=f"{number(float(relative[j]), 2)} %",
            share=100 * float(error[j]) / longest,
            tick=None if noise is None else 100 * float(noise[j]) / longest,
        )
        for j in worst_first(shown)
    )


def model_bars(item: ReportedEstimate) -> tuple[Bar, ...]:
    """The rival models on data left out: their errors over the torque."""
    told = item.estimate.assessment
    if told is None:
        return ()
    # Newtons and newton metres do not add: of joints of both kinds, those that err more.
    kinds = joints_by_kind(item.estimate.model.robot.prismatic).values()
    sizes = [(joints, max(float(np.linalg.norm(told.torque[joints])), 1e-9)) for joints in kinds]
    errors = [
        max(100 * float(np.linalg.norm(rms[joints])) / size for joints, size in sizes)
        for rms in told.models.values()
    ]
    longest = max([*errors, 1e-9])
    return tuple(
        Bar(
            name=MODEL_NAMES.get(name, name),
            value=f"{number(e, 3)} %",
            share=100 * e / longest,
            role=MODEL_ROLES.get(name, "predicted"),
        )
        for name, e in zip(told.models, errors, strict=True)
    )


def models_words(item: ReportedEstimate) -> str:
    """Whether identification of the inertias pays."""
    told = item.estimate.assessment
    if told is None:
        return "This estimate was written by an earlier version: identify again to compare models."
    if told.pays is None:
        return "No inertias are published for this robot: there is nothing to compare with."
    if told.pays:
        return "Identified inertias predict better than the published ones."
    return "Identified inertias predict no better than the published ones with identified friction."


def next_steps(contents: ReportContents) -> tuple[Step, ...]:
    """What to do, the most pressing first."""
    item = contents.estimates[0]
    return tuple(list(_steps(contents, item))[:MOST_STEPS])


def _steps(contents: ReportContents, item: ReportedEstimate) -> Iterator[Step]:
    robot = item.estimate.model.robot
    if item.shown is None:
        yield Step(
            title="Add its recording to the folder.",
            text="Without it there is neither a prediction nor a verdict.",
            command=f"dynid report {shlex.quote(str(contents.directory))}",
        )
    told: set[str] = set()
    for finding in sorted(item.warnings, key=lambda f: f.severity != "error"):
        if finding.next_step and finding.next_step not in told and finding.severity != "info":
            told.add(finding.next_step)
            yield Step(title=_sentence(finding.text), text=_sentence(finding.next_step))
    if item.validation is None and item.shown is not None:
        yield Step(
            title="Validate on another motion.",
            text="No other recording has confirmed this result.",
            command=f"dynid validate {shlex.quote(item.name)} OTHER_RECORDING",
        )
    for finding in item.warnings:
        if finding.code == "weak_excitation" and finding.next_step not in told:
            yield Step(
                title=_sentence(finding.next_step),
                text="The motion excites the inertias poorly.",
                command=f"dynid design {shlex.quote(robot.file or robot.name)} -o design.json",
            )
            break
    if item.level == "usable":
        named = ", ".join(contents.models)
        yield Step(
            title="Use the model." if named else "Export the model.",
            text="C for feed-forward control, MJCF or URDF for simulators"
            + (f"; beside this page: {named}." if named else "."),
            command=""
            if named
            else f"dynid export {shlex.quote(item.name)} --to mjcf -o robot.xml",
        )


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}".rstrip(".") + "."
