"""SVG figures: what is drawn lies where it belongs, in pages and in files."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from dynid.core import InputError
from dynid.figures import (
    Axis,
    Band,
    Bars,
    Figure,
    Level,
    Line,
    Panel,
    Points,
    Ranges,
    Spans,
    axis_around,
    category_axis,
    document,
    fragment,
    joint_unit,
    number,
    plot,
    script,
    shaded,
    style,
    write_figure,
)
from dynid.figures.marks import colour, thinned
from dynid.figures.svg import FORMATS

MINUS = "\N{MINUS SIGN}"
T = np.linspace(0.0, 10.0, 1001)
PIXEL = 1e-4
"""Rounding of a drawn value, as a share of its axis."""


def drawn_values(svg: str, name: str, low: float, high: float) -> np.ndarray:
    """The y values of a named curve, read from its path."""
    path = re.search(rf'data-n="{name}" d="M(-?\d+) (-?\d+)l([^"]*)"', svg)
    assert path
    steps = np.array(re.findall(r"-?\d+", path[3]), dtype=int)[1::2]
    return high - (int(path[2]) + np.concatenate([[0], np.cumsum(steps)])) / 10000 * (high - low)


def figure() -> Figure:
    y = 40 * np.sin(T)
    marks = (
        Spans([(2.0, 3.0)], "still", "standstill"),
        Band(T, y - 1, y + 1, "band", "band"),
        Line(T, np.where((T > 5) & (T < 6), np.nan, y), "measured", "measured", 3.2),
        Points(T[::50], y[::50], name="data", faint=True),
        Points([1.0], [0.0], name="ring", hollow=True),
        Ranges([4.0], [-10.0], [10.0], name="interval"),
        Level(20.0, name="limit"),
        Level(7.0, upright=True, dash=""),
    )
    names = category_axis(["Elbow", "Wrist 1"])
    bars = Bars([0, 1], [3.0, 9.0], across=True, name="error")
    return Figure(
        title='Torque of "<arm>"',
        x=Axis(low=0, high=10, label="time [s]"),
        panels=(
            Panel(title="Elbow", y=axis_around(y, label="[N·m]"), marks=marks, grid=True),
            Panel(y=names, marks=(bars,)),
        ),
        link="time",
    )


def test_a_curve_is_drawn_where_its_values_are() -> None:
    y = 40 * np.sin(T)
    axis = axis_around(y)
    svg = plot(Panel(y=axis, marks=(Line(T, y, name="m"),)), Axis(low=0, high=10), link="t")
    read = drawn_values(svg, "m", axis.low, axis.high)
    assert read == pytest.approx(y, abs=PIXEL * (axis.high - axis.low))


def test_thinning_keeps_every_peak_and_the_ends() -> None:
    y = np.random.default_rng(1).normal(size=90_000)
    y[[12_345, 70_001]] = 99.0, -99.0
    y[500:900] = np.nan
    kept = thinned(y, 1000)
    assert len(kept) <= 2002
    assert {0, 12_345, 70_001, 89_999} <= set(kept.tolist())
    assert (np.diff(kept) > 0).all()
    assert thinned(y[:100], 1000).tolist() == list(range(100))


def test_pages_and_files_are_well_formed_and_text_stays_text(tmp_path: Path) -> None:
    page = fragment(figure())
    assert "<arm>" not in page
    assert "<b>" not in page.replace("<figcaption><b>", "")
    ET.fromstring(page)
    tree = ET.fromstring(document(figure()))
    assert tree.find("{*}rect").attrib["fill"] == colour("ground")  # type: ignore[union-attr]
    assert "NaN" not in page
    assert "nan" not in re.sub(r"<[^>]*aria-label[^>]*>", "", page)


def test_files_have_the_format_of_their_name(tmp_path: Path) -> None:
    pytest.importorskip("resvg_py", reason="needs the extra figures")
    assert write_figure(figure(), tmp_path / "a.svg").read_text().startswith("<svg xmlns")
    assert write_figure(figure(), tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(InputError, match=", ".join(FORMATS)):
        write_figure(figure(), tmp_path / "a.pdf")
    with pytest.raises(InputError, match="cannot be written"):
        write_figure(figure(), tmp_path / "none" / "a.svg")


def test_ticks_are_round_and_lie_on_their_axis() -> None:
    assert [text for _, text in Axis(low=-50, high=50).ticks(3)] == [f"{MINUS}50", "0", "50"]
    assert [text for _, text in Axis(low=0.98, high=1.07).ticks(3)][:2] == ["0.98", "1.00"]
    assert [t for _, t in Axis(low=1e-6, high=1, log=True).ticks(3)] == ["10⁻⁶", "10⁻³", "10⁰"]
    assert [t for _, t in Axis(low=3, high=90, log=True).ticks(5)] == ["5", "10", "20", "50"]
    assert [t for _, t in Axis(low=9e4, high=2.6e5).ticks(4)] == ["1e5", "1.5e5", "2e5", "2.5e5"]
    assert Axis(low=-4, high=4, bounds=True).ticks(2) == ((0.0, "±4"),)
    assert Axis(low=-150, high=80, bounds=True).ticks(2) == ((0.0, "±150"),)
    for low, high in ((0, 3), (-1e-3, 2e-3), (1e6, 3e6), (-7.3, -7.1)):
        axis = Axis(low=low, high=high)
        values = [v for v, _ in axis.ticks(5)]
        assert 3 <= len(values) <= 7
        assert min(axis.share(values)) >= -1e-6
        assert max(axis.share(values)) <= 1 + 1e-6


def test_axes_hold_their_values_and_refuse_empty_ranges() -> None:
    for values in ([1.0, 1.0], [0.0, 0.0], [], [np.nan, 3.0], [-2.0, 5.0]):
        axis = axis_around(np.array(values), zero=True)
        assert axis.low <= 0 <= axis.high
    assert axis_around([1.0, 100.0, -3.0], log=True).low > 0
    with pytest.raises(InputError, match="range of an axis"):
        Axis(low=1, high=1)
    with pytest.raises(InputError, match="logarithmic"):
        Axis(low=0, high=1, log=True)


def test_shaded_stretches_and_numbers() -> None:
    mask = (T > 2.001) & (T < 3.001) | (T > 8.0005)
    assert shaded(T, mask, 0.5) == ((pytest.approx(2.01), pytest.approx(3.0)), (8.01, 10.0))
    numbers = [number(value) for value in (1.7, -524.0, 0.0415, 0.0, None, float("nan"))]
    assert numbers == ["1.70", f"{MINUS}524", "0.0415", "0", "\N{EN DASH}", "\N{EN DASH}"]
    # Of 99.9999 two digits are a hundred.
    assert [number(value, 2) for value in (99.9999, 99.4, 99999.9)] == ["100", "99", "1.0e+05"]
    assert joint_unit("N.m", (False, True)) == "N·m, N where sliding"
    assert joint_unit("rad/s", (True,)) == "m/s"
    assert joint_unit("deg", (False, True)) == "deg, m where sliding"


def test_every_colour_can_be_told_from_its_ground() -> None:
    def light(hexadecimal: str) -> float:
        parts = [int(hexadecimal[k : k + 2], 16) / 255 for k in (1, 3, 5)]
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    def contrast(one: str, other: str) -> float:
        a, b = sorted((light(one), light(other)))
        return (b + 0.05) / (a + 0.05)

    for dark in (False, True):
        ground = colour("ground", dark=dark)
        for role in ("ink", "ink2", "residual", "predicted", "yes", "with-limits", "no"):
            assert contrast(colour(role, dark=dark), ground) >= 4.5, role
        for role in ("measured", "limit", *(f"joint{k}" for k in range(8))):
            assert contrast(colour(role, dark=dark), ground) >= 3.0, role


def test_style_and_script_need_nothing_from_outside() -> None:
    assert not re.search(r"url\(|@import|https?://(?!www\.w3\.org/2000/svg)", style() + script())
