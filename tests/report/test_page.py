"""The page: the numbers are those of the results, nothing is fetched, no text of a file runs."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest

import dynid
from dynid.core import Finding
from dynid.figures import number, units
from dynid.report import ReportContents, ReportedEstimate, render, write_figures, write_report
from dynid.workflow import report

MAX_BYTES = 3_000_000
DRAWN = 4e-3
"""Distances at two hundred instants against a certificate of all [m]."""
HOSTILE = '<script>alert("x")</script>\u2028</script><!--' + "y" * 3000
Page = tuple[Path, ReportContents]


def visible(page: str) -> str:
    """What a reader sees: no scripts, no tags."""
    without = re.sub(r"<(script|style).*?</\1>", " ", page, flags=re.DOTALL)
    return unescape(re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", without)))


def test_the_answer_comes_first_and_is_the_one_of_identify(page: Page) -> None:
    path, contents = page
    text = path.read_text()
    item = contents.estimates[0]
    assert item.verdict is not None
    assert item.validation is not None
    error = item.validation.moving.relative_error_overall_percent
    assert f"Predicts torque to {number(error, 2)}\u00a0%" in text
    places = [text.index(f'id="{name}"') for name in ("verdict", "torque", "model", "appendix")]
    assert places == sorted(places)
    for answer in (item.verdict.prediction, item.verdict.parameters):
        assert answer.reason[1:] in visible(text)
    assert path.stat().st_size < MAX_BYTES


def test_periods_are_those_that_were_recorded(page: Page) -> None:
    for item in page[1].estimates:
        for told in (item.conditions, item.tested):
            assert [word for word in told if "period" in word] == ["2 periods"]


def test_numbers_are_those_of_the_estimate(page: Page, finished_run: Path) -> None:
    path, contents = page
    text = visible(path.read_text())
    estimate = json.loads((finished_run / contents.estimates[0].name).read_text())
    for parameter in estimate["parameters"]:
        row = (
            f"{parameter['name']} {number(parameter['value'], 4)} {units(parameter['unit'])} "
            f"{number(parameter['std'], 2)} {number(parameter['relative_std_percent'], 2)}"
        )
        assert row in text, row
    for digest in estimate["provenance"]["inputs"].values():
        assert digest in text


def test_what_to_do_follows_what_was_found(page: Page) -> None:
    _, contents = page
    item = contents.estimates[0]
    payload = Finding(
        "payload", "the last link carries 1.65 +- 0.18 kg", next_step="remove it, or add it"
    )
    text = visible(render(replace(contents, estimates=(replace(item, warnings=(payload,)),))))
    assert "The last link carries 1.65 ± 0.18 kg. Remove it, or add it." in text
    assert "+-" not in text
    assert "95 % intervals of Fc [N·m] and Fv [N·m·s/rad]." in text


def test_the_command_for_another_motion_names_the_file_of_the_robot(page: Page) -> None:
    _, contents = page
    item = contents.estimates[0]
    weak = Finding("identification_gains_nothing", "weak", next_step="move more")
    for file, word in (("/robots/my arm.urdf", "'/robots/my arm.urdf'"), ("", "ur5")):
        model = replace(item.estimate.model, robot=replace(item.estimate.model.robot, file=file))
        changed = replace(item, estimate=replace(item.estimate, model=model), warnings=(weak,))
        text = visible(render(replace(contents, estimates=(changed,))))
        assert f"dynid design {word} -o design.json" in text


def test_units_of_sliding_joints_are_their_own(page: Page) -> None:
    _, contents = page
    item = contents.estimates[0]
    assert item.shown is not None
    model = item.estimate.model
    turned = float(np.abs(item.shown.dq[:, 1:]).max())
    dq = np.array(item.shown.dq)
    dq[:, 0] *= 100.0
    kinds = ("prismatic", *["revolute"] * (model.robot.joints - 1))
    robot = replace(model.robot, joint_types=kinds)
    estimate = replace(item.estimate, model=replace(model, robot=robot))
    slid = replace(item, estimate=estimate, validation=None, training=replace(item.shown, dq=dq))
    text = visible(render(replace(contents, estimates=(slid,))))
    assert f"Tested up to {number(turned, 2)} rad/s." in text
    assert "torque and residual [N·m, N where sliding]" in text
    # Of rival models as of all errors: those of the kind that errs more.
    told = estimate.assessment
    assert told is not None
    newtons = np.where(np.arange(model.robot.joints) == 0, 1e5, 1.0)
    told = replace(told, torque=newtons * told.torque, models={"identified": 0.25 * told.torque})
    rivals = replace(slid, estimate=replace(estimate, assessment=told))
    assert "everything identified 25.0 %" in visible(render(replace(contents, estimates=(rivals,))))
    # One error everywhere: that of the verdict, not the squares of N and N·m in one sum.
    two = visible(render(replace(contents, estimates=(slid, slid))))
    assert slid.errors is not None
    error = number(slid.errors.moving, 2)
    assert error != number(item.shown.moving.relative_error_overall_percent, 2)
    assert re.search(rf"error, moving \[%\] .*? {re.escape(error)} {len(estimate.values)} ", two)


def test_a_slide_that_stood_at_zero_without_limits_and_torque_is_drawn(page: Page) -> None:
    _, contents = page
    item = contents.estimates[0]
    assert item.shown is not None
    estimate, still = item.estimate, np.r_[0.0, np.ones(5)]
    model, seen = estimate.model, estimate.motion
    kinds = ("prismatic", *model.robot.joint_types[1:])
    limits = replace(model.robot.limits, lower=np.full(6, np.nan), upper=np.full(6, np.nan))
    robot = replace(model.robot, joint_types=kinds, limits=limits)
    seen = replace(seen, lower=still * seen.lower, upper=still * seen.upper)
    estimate = replace(estimate, model=replace(model, robot=robot), motion=seen)
    measured, predicted = still * item.shown.measured, still * item.shown.predicted
    percent = np.where(still > 0, item.shown.moving.relative_error_percent, np.nan)
    moving = replace(item.shown.moving, relative_error_percent=percent)
    shown = replace(item.shown, measured=measured, predicted=predicted, moving=moving)
    gantry = replace(item, estimate=estimate, validation=shown)
    text = visible(render(replace(contents, estimates=(gantry,))))
    assert "Uncertainty over poses" in text
    # There is no error of a joint that did not move: neither in its bar nor in its row.
    assert " 0 %" not in text


def test_measured_torque_is_drawn_where_it_was_measured(page: Page) -> None:
    path, contents = page
    shown = contents.estimates[0].shown
    assert shown is not None
    worst = int(np.nanargmax(shown.moving.relative_error_percent))
    svg = re.search(
        r'data-y="([-\d.e]+),([-\d.e]+)".*?data-n="measured" d="M-?\d+ (-?\d+)l([^"]*)"',
        path.read_text(),
        flags=re.DOTALL,
    )
    assert svg
    low, high = float(svg[1]), float(svg[2])
    steps = np.array(re.findall(r"-?\d+", svg[4]), dtype=int)[1::2]
    y = high - (int(svg[3]) + np.concatenate([[0], np.cumsum(steps)])) / 10000 * (high - low)
    np.testing.assert_allclose(y, shown.measured[:, worst], atol=1e-4 * (high - low))


def test_truth_of_a_simulation_is_drawn_in_the_frames_of_the_estimate(page: Page) -> None:
    path, contents = page
    item = contents.estimates[0]
    assert item.truth is not None
    robot = item.estimate.model.robot
    assert item.truth.inertials[:, 0] == pytest.approx(robot.inertias[:, 0], rel=0.3)
    known = dict(zip(item.estimate.names, item.estimate.values, strict=True))
    for j in range(6):
        assert known[f"Fv{j + 1}"] == pytest.approx(item.truth.viscous[j], rel=0.35)
    assert path.read_text().count("ground truth") >= 2


def test_links_say_how_much_of_them_is_data(page: Page) -> None:
    _, contents = page
    item = contents.estimates[0]
    assert item.links is not None
    share = 1 - item.links.prior_share[:60].reshape(6, 10)
    assert share[0, 0] == pytest.approx(0.0, abs=1e-9)  # the first link only turns about its axis
    assert share[1:3, 0].min() > 0.3
    # Corrected by the base parameters, the standard parameters give the same torques.
    q = np.random.default_rng(1).normal(size=(3, 20, 6))
    model = item.estimate.model
    ours = model.inverse_dynamics(*q, item.links.values)
    theirs = model.inverse_dynamics(*q, item.estimate.standard_parameters())
    assert np.abs(ours - theirs).max() < 0.1 * np.abs(theirs).max()


def test_nothing_is_fetched(page: Page) -> None:
    text = page[0].read_text()
    head = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    links = re.findall(r'\s(?:src|href)="([^"]*)"', head)
    assert links
    assert all(link.startswith(("#", "data:")) for link in links)
    assert "@import" not in text
    assert "url(" not in text


def test_hostile_names_are_shown_as_text(finished_run: Path, tmp_path: Path) -> None:
    known = dynid.read_estimate(finished_run / "estimate.json")
    robot = replace(known.model.robot, name=HOSTILE, joint_names=(HOSTILE, *"bcdef"))
    estimate = replace(known, model=replace(known.model, robot=robot), choices=(HOSTILE,))
    item = ReportedEstimate(
        name=HOSTILE, label=HOSTILE, estimate=estimate, warnings=(Finding("saturated", HOSTILE),)
    )
    page = render(
        ReportContents(robot=HOSTILE, date=HOSTILE, directory=tmp_path, estimates=(item,))
    )
    assert "<script>alert" not in page
    assert page.count("<!--") == 0
    assert "<script>alert" in unescape(page)
    assert "its recording is not in the folder" in page


def test_all_estimates_are_listed_and_compared(page: Page) -> None:
    path, contents = page
    text = visible(path.read_text())
    assert len(contents.estimates) == 2
    assert "viscous moved" in text
    assert "inertial did not move" in text
    assert [name for name, _ in contents.skipped] == ["broken.parquet"]
    assert "broken.parquet" in text


def test_estimates_of_one_preset_are_told_apart_and_so_are_their_motions(
    finished_run: Path, tmp_path: Path
) -> None:
    known = dynid.read_estimate(finished_run / "estimate.json")
    wider = replace(known.motion, upper=known.motion.upper + np.pi)
    dynid.write_estimate(known, tmp_path / "one.json")
    made = replace(known.provenance, inputs={})
    dynid.write_estimate(replace(known, motion=wider, provenance=made), tmp_path / "two.json")
    path, _ = report(tmp_path, tmp_path / "report.html")
    text, label = visible(path.read_text()), f"preset {known.preset}"
    assert f"Change from {label} (one.json) to {label} (two.json)" in text
    assert "The motions differ (range of" in text


def test_figures_are_written_as_files(page: Page, tmp_path: Path) -> None:
    written = write_figures(page[1], tmp_path / "figures")
    assert len(written) >= 8
    assert all(file.read_text().startswith("<svg xmlns") for file in written)
    assert written[0].name == "01-measured-and-predicted-torque.svg"
    assert any(file.name.endswith("uncertainty-over-poses.svg") for file in written)
    (tmp_path / "file").write_text("")
    with pytest.raises(dynid.InputError, match="need a folder"):
        write_figures(page[1], tmp_path / "file")


@pytest.mark.parametrize(
    ("window", "words"),
    [({"stop_s": 6.0}, "from 6 s on"), ({"start_s": 4.5, "stop_s": 9.9}, "up to 4.5 s")],
)
def test_the_rest_of_a_record_confirms_what_one_window_gave(
    finished_run: Path, tmp_path: Path, window: dict[str, float], words: str
) -> None:
    record = dynid.read_record(finished_run / "identification.parquet")
    dynid.write_record(record, tmp_path / "one.parquet")
    settings = dynid.IdentifySettings(preset="paper", **window)  # type: ignore[arg-type]
    result = dynid.identify(record, "ur5", settings)
    dynid.write_estimate(result.estimate, tmp_path / "half.json")
    _, contents = report(tmp_path, tmp_path / "report.html")
    (shown,) = contents.estimates
    assert shown.validation is not None
    assert shown.validation_name == f"one.parquet {words}"
    # Times count from the window's start.
    length = shown.validation.t.max()
    assert length == pytest.approx(record.t[-1] - 6.0 if "from" in words else 4.5, abs=0.5)


def test_wrong_places_are_refused(page: Page, tmp_path: Path) -> None:
    with pytest.raises(dynid.InputError, match="no such directory"):
        report(tmp_path / "none", tmp_path / "r.html")
    with pytest.raises(dynid.InputError, match="no estimate"):
        report(tmp_path, tmp_path / "r.html")
    with pytest.raises(dynid.InputError, match="cannot be written"):
        write_report(page[1], tmp_path / "none" / "r.html")
    empty = ReportContents(robot="r", date="d", directory=tmp_path, estimates=())
    with pytest.raises(dynid.InputError, match="at least one estimate"):
        render(empty)


def test_a_design_is_shown_with_its_limits_over_time(finished_run: Path, tmp_path: Path) -> None:
    designed = dynid.design("ur5", dynid.DesignSettings(starts=1), output=tmp_path / "design.json")
    dynid.write_estimate(
        dynid.read_estimate(finished_run / "estimate.json"), tmp_path / "estimate.json"
    )
    path, contents = report(tmp_path, tmp_path / "report.html")
    (shown,) = contents.designs
    assert shown.judged is not None
    worst = dynid.check(tmp_path / "design.json").certificate.worst
    # The instant where bodies come nearest is among those that are drawn.
    assert {item.t for item in worst.values()} <= set(shown.judged.t)
    # The certificate looks closer than two hundred instants, and adds what it is not sure of.
    largest = {kind: row.max() for kind, row in shown.judged.shares.items()}
    assert 1 - largest["tcp_speed"] == pytest.approx(worst["tcp_speed"].margin, abs=0.02)
    # Bodies beside a joint are never 10 mm apart: they keep half of what there is.
    assert worst["self_collision"].required < worst["environment"].required
    beyond = {kind: row.min() for kind, row in shown.judged.distances.items()}
    for kind, least in beyond.items():
        assert least == pytest.approx(worst[kind].room, abs=DRAWN)
    assert f"{designed.condition_number:.4g}" in visible(path.read_text())
