"""Every figure shows the numbers that it was given, with units, in both colours."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dynid
from dynid.report import Canvas, joint_unit
from dynid.report import figures as friction
from dynid.report import figures as parameters
from dynid.report import figures as signals
from dynid.report import figures as structure
from dynid.report import time_figures as motion
from dynid.report import time_figures as torque
from dynid.report.theme import (
    POINTS,
    TITLE_WIDTH,
    figure,
    label,
    log_axis,
    plain,
    thinned,
    write_figure,
)
from dynid.trajectory import copied_bounds

SINGLE = 1e-6
"""Relative error of single precision."""


@pytest.fixture(scope="module")
def gallery(identified: dynid.Identification) -> dict[str, Canvas]:
    estimate, result = identified.estimate, identified.validation
    assert result is not None
    robot = estimate.model.robot
    names, slides = robot.joint_names, robot.prismatic
    series = dynid.random_excitation(robot.limits, seed=1)
    samples = series.evaluate(np.linspace(0, 10, 200))
    gaps = np.linspace(0.5, 0.01, 600).reshape(200, 3)
    return {
        "structure": structure.singular_values(dynid.reduce_model(estimate.model)),
        "trajectory": motion.trajectory(series, names),
        "limits": motion.limit_usage(samples, copied_bounds(robot.limits), names),
        "distances": motion.distances(samples.t, gaps, ("a", "b", "c"), 0.02),
        "safety": motion.safety_usage(samples.t, gaps, ("torque", "tcp_speed", "power")),
        "convergence": motion.convergence(np.arange(1.0, 9), 90 / np.arange(1.0, 9), "cond"),
        "prediction": torque.prediction(result, names, slides),
        "residuals": torque.residuals(result, names),
        "residuals over time": torque.residuals(result, names, against=result.t, what="time [s]"),
        "autocorrelation": torque.autocorrelations(result, names),
        "moving": torque.moving_and_at_rest(result, names),
        "intervals": parameters.parameter_intervals(estimate),
        "changes": parameters.parameter_changes(("Fv1",), (-20.0,), (2.0,)),
        "side by side": parameters.side_by_side(estimate, estimate, ("cold", "warm")),
        "friction": friction.friction_figure(estimate, result),
        "spectrum": signals.spectrum(samples.q, 20.0, 5.0, names, "positions [rad]"),
    }


def test_every_plot_has_a_title_data_and_axes_with_units(gallery: dict[str, Canvas]) -> None:
    for name, drawn in gallery.items():
        shown = plain(drawn)
        layout = shown["layout"]
        assert layout["title"]["text"], name
        assert shown["data"], name
        axes = [layout[key] for key in layout if re.fullmatch(r"yaxis\d*", key)]
        assert all(axis["title"]["text"] for axis in axes), name


def test_units_are_those_of_joints_that_slide(identified: dynid.Identification) -> None:
    result = identified.validation
    assert result is not None
    slides = (False, True, *(False,) * 4)
    shown = plain(torque.residuals(result, "abcdef", prismatic=slides))["layout"]
    assert shown["yaxis"]["title"]["text"] == "residual [N.m]"
    assert shown["yaxis2"]["title"]["text"] == "residual [N]"
    assert shown["xaxis6"]["title"]["text"] == "velocity [rad/s, m/s where sliding]"
    errors = plain(torque.moving_and_at_rest(result, "abcdef", (True,) * 6))["layout"]
    assert errors["yaxis"]["title"]["text"] == "RMS error [N]"
    assert "0.02 m/s" in errors["title"]["text"].replace("<br>", " ")
    assert joint_unit("rad/s\u00b2", (False, False)) == "rad/s\u00b2"


def test_ticks_of_logarithmic_axes_can_be_read(gallery: dict[str, Canvas]) -> None:
    for name, axis in (("convergence", "yaxis"), ("spectrum", "xaxis")):
        shown = plain(gallery[name])["layout"][axis]
        assert (shown["type"], shown["tickformat"], shown["dtick"]) == ("log", "~g", "D2"), name
    assert "dtick" not in log_axis(np.array([1e-6, 1.0]))


def test_every_parameter_has_its_name_on_a_telephone(gallery: dict[str, Canvas]) -> None:
    layout = plain(gallery["intervals"])["layout"]
    axes = [layout[key] for key in layout if re.fullmatch(r"xaxis\d*", key)]
    assert [axis["dtick"] for axis in axes] == [1] * len(axes)


def test_distances_are_in_millimetres(gallery: dict[str, Canvas]) -> None:
    drawn = plain(gallery["distances"])
    assert drawn["layout"]["yaxis"]["title"]["text"] == "distance [mm]"
    gaps = np.concatenate([series.y for series in gallery["distances"].data])
    assert gaps.max() == pytest.approx(500.0)
    assert drawn["layout"]["shapes"][0]["y0"] == pytest.approx(20.0)


def test_titles_fit_a_telephone_and_legends_stay_below_the_axes(gallery: dict[str, Canvas]) -> None:
    for name, drawn in gallery.items():
        layout = plain(drawn)["layout"]
        assert max(map(len, layout["title"]["text"].split("<br>"))) <= TITLE_WIDTH, name
        assert (layout["legend"]["yref"], layout["legend"]["y"]) == ("container", 0)
    title = "Errors of moving joints (above 0.02 rad/s) and at rest"
    assert plain(figure(title=title, x="x", y="y"))["layout"]["title"]["text"].count("<br>") == 1


def test_lines_carry_the_numbers_they_stand_for(
    gallery: dict[str, Canvas], identified: dynid.Identification
) -> None:
    result = identified.validation
    assert result is not None
    traces = gallery["prediction"].data
    assert [trace.name for trace in traces[:2]] == ["measured", "predicted"]
    keep = thinned(result.measured[:, 0])
    np.testing.assert_allclose(traces[0].y, result.measured[keep, 0], rtol=SINGLE)
    bars = gallery["moving"].data
    np.testing.assert_allclose(bars[0].y, result.moving.rmse)


def test_a_friction_curve_is_coulomb_and_viscous(identified: dynid.Identification) -> None:
    estimate = identified.estimate
    speed = np.full((1, 6), 0.7)
    curve = friction.friction_curve(estimate, speed)[0]
    values = dict(zip(estimate.names, estimate.values, strict=True))
    expected = [values[f"Fc{j}"] + 0.7 * values[f"Fv{j}"] for j in range(1, 7)]
    np.testing.assert_allclose(curve, expected, rtol=1e-9)


def test_the_autocorrelation_starts_at_one_and_agrees_with_its_definition(
    gallery: dict[str, Canvas], identified: dynid.Identification
) -> None:
    result = identified.validation
    assert result is not None
    shown = gallery["autocorrelation"].data[2].y
    error = (result.measured - result.predicted)[:, 2]
    error = error - error.mean()
    assert shown[0] == pytest.approx(1.0)
    assert shown[7] == pytest.approx(error[7:] @ error[:-7] / (error @ error), abs=1e-5)


@settings(deadline=None)
@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=5000))
def test_thinning_keeps_the_extremes(values: list[float]) -> None:
    y = np.array(values)
    keep = thinned(y)
    assert len(keep) <= max(POINTS, 1)
    assert y[keep].max() == y.max()
    assert y[keep].min() == y.min()
    assert (np.diff(keep) > 0).all()


def test_names_from_files_are_shown_as_text(identified: dynid.Identification) -> None:
    hostile = (
        "<script>alert(1)</script>",
        "<b>bold</b>",
        "x" * 5000,
        "\u202e\U0001f916",
        "a&b",
        "j",
    )
    result = identified.validation
    assert result is not None
    text = json.dumps(plain(torque.moving_and_at_rest(result, hostile)), default=str)
    assert "<script" not in text
    assert "<b>bold" not in text
    assert "x" * 50 not in text
    assert label("a&b\u202e") == "a&amp;b?"


def test_files_are_written_in_both_colours(gallery: dict[str, Canvas], tmp_path: Path) -> None:
    page = write_figure(gallery["moving"], tmp_path / "a.html").read_text()
    assert "src=" not in page.split("<body>")[0].replace("data:", "")
    light = json.loads(write_figure(gallery["moving"], tmp_path / "a.json").read_text())
    dark = json.loads(write_figure(gallery["moving"], tmp_path / "b.json", dark=True).read_text())
    grounds = [document["layout"]["paper_bgcolor"] for document in (light, dark)]
    assert grounds[0] != grounds[1]
    with pytest.raises(dynid.InputError, match="figure format"):
        write_figure(gallery["moving"], tmp_path / "a.gif")
    with pytest.raises(dynid.InputError, match="cannot be written"):
        write_figure(gallery["moving"], tmp_path / "none" / "a.html")


@pytest.mark.skipif(shutil.which("chromium") is None, reason="no chromium")
def test_svg_and_png_come_from_the_browser(gallery: dict[str, Canvas], tmp_path: Path) -> None:
    assert b"<svg" in write_figure(gallery["changes"], tmp_path / "a.svg").read_bytes()
    assert write_figure(gallery["changes"], tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"
