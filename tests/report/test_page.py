"""The page: every section, the estimate's numbers, nothing from outside, no text that runs."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import pytest

import dynid
from dynid.core import Finding
from dynid.report import ReportContents, ReportedEstimate, write_report
from dynid.report.contents import Table, number
from dynid.report.page import default_sections, render
from dynid.workflow import report

MAX_BYTES = 6_000_000
HOSTILE = '<script>alert("x")</script>\u2028</script><!--' + "y" * 3000


@pytest.fixture(scope="module")
def page(finished_run: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    path, _ = report(finished_run, tmp_path_factory.mktemp("page") / "report.html")
    assert path.stat().st_size < MAX_BYTES
    return path.read_text(encoding="utf-8")


def visible(page: str) -> str:
    """What a reader sees: no scripts, no tags."""
    without = re.sub(r"<(script|style).*?</\1>", " ", page, flags=re.DOTALL)
    return unescape(re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", without)))


def test_every_section_that_has_something_to_say_is_there(page: str) -> None:
    found = set(re.findall(r'<section id="(\w+)">', page))
    assert found == {section.anchor for section in default_sections()} - {"comparison"}
    assert page.index('id="verdict"') < min(
        page.index(f'id="{name}"') for name in found - {"verdict"}
    )


def test_the_verdict_is_the_one_of_identify(page: str, finished_run: Path) -> None:
    robot = dynid.load_robot("ur5")
    first, second = (
        dynid.read_record(finished_run / f"{name}.parquet")
        for name in ("identification", "validation")
    )
    settings = dynid.IdentifySettings(preset="paper")
    result = dynid.identify(first, robot, settings, validation=second)
    assert dynid.verdict(result).headline in visible(page)


def test_numbers_are_those_of_the_estimate(page: str, finished_run: Path) -> None:
    estimate = json.loads((finished_run / "estimate.json").read_text())
    text = visible(page)
    for parameter in estimate["parameters"]:
        row = (
            f"{parameter['name']} {number(parameter['value'], 4)} {parameter['unit']} "
            f"{number(parameter['std'], 2)} {number(parameter['relative_std_percent'], 2)}"
        )
        assert row in text, row
    assert f"condition number {number(estimate['condition_number'])}" in text
    for digest in estimate["provenance"]["inputs"].values():
        assert digest in text


def test_numbers_keep_their_digits_and_stand_below_each_other(page: str) -> None:
    texts = [number(value) for value in (1.7, 524.0, 0.0415, 0.0, 87300.0, None, float("nan"))]
    assert texts == ["1.70", "524", "0.0415", "0", "8.73e+04", "-", "-"]
    rows = (("a", "1.70", "-", "kg"), ("b", "12.0", "", "kg"))
    assert Table(columns=("", "value", "std", "unit"), rows=rows).numeric == (0, 1, 1, 0)
    assert Table(columns=("", ""), rows=(("samples", "12"),)).numeric == (False, False)
    assert re.search(r'<th scope="col" class="n">R2</th>', page)
    assert re.search(r'<td class="n">[\d.]+</td>', page)


def test_nothing_is_fetched(page: str) -> None:
    head = re.sub(r'<script[^>]*type="(?:application/json|text/plain)".*?</script>', "", page)
    head = re.sub(r"<script>.*?</script>", "", head, flags=re.DOTALL)
    links = re.findall(r'(?:src|href)="([^"]*)"', head)
    assert all(link.startswith(("#", "data:")) for link in links)
    assert "@import" not in page.split("</style>")[0]


def test_hostile_names_are_shown_as_text(finished_run: Path, tmp_path: Path) -> None:
    known = dynid.read_estimate(finished_run / "estimate.json")
    robot = replace(known.model.robot, name=HOSTILE, joint_names=(HOSTILE, *"bcdef"))
    estimate = replace(known, model=replace(known.model, robot=robot), choices=(HOSTILE,))
    item = ReportedEstimate(
        name=HOSTILE,
        estimate=estimate,
        level="care",
        headline=HOSTILE,
        warnings=(Finding("saturated", HOSTILE),),
    )
    page = render(ReportContents(title=HOSTILE, directory=tmp_path, estimates=(item,)))
    assert 'alert("x")' not in re.sub(r"<script>\(\(\) => .*", "", page, flags=re.DOTALL)
    assert page.count("<!--") == 0
    assert "<script>alert" in unescape(page)


@pytest.mark.parametrize("level", ["usable", "care", "do_not_use"])
def test_a_verdict_is_painted(finished_run: Path, tmp_path: Path, level: str) -> None:
    estimate = dynid.read_estimate(finished_run / "estimate.json")
    item = ReportedEstimate(name="e", estimate=estimate, level=level, headline="h", warnings=())
    page = render(ReportContents(title="t", directory=tmp_path, estimates=(item,)))
    assert f'class="part {level}"' in page


def test_two_estimates_are_compared(finished_run: Path, tmp_path: Path) -> None:
    estimate = dynid.read_estimate(finished_run / "estimate.json")
    for name, factor in (("cold", 1.0), ("warm", 0.8)):
        values = estimate.values.copy()
        values[[k for k, n in enumerate(estimate.names) if n.startswith("Fv")]] *= factor
        dynid.write_estimate(replace(estimate, values=values), tmp_path / f"{name}.json")
    path, contents = report(tmp_path, tmp_path / "report.html")
    text = visible(path.read_text())
    assert [pair[:2] for pair in contents.comparisons] == [("cold.json", "warm.json")]
    assert "viscous moved -20" in text
    assert "inertial did not move" in text


def test_files_that_cannot_be_read_are_named(finished_run: Path, tmp_path: Path) -> None:
    estimate = dynid.read_estimate(finished_run / "estimate.json")
    dynid.write_estimate(estimate, tmp_path / "good.json")
    (tmp_path / "broken.parquet").write_bytes(b"PAR1 no")
    (tmp_path / "other.json").write_text("[1, 2")
    path, contents = report(tmp_path, tmp_path / "report.html")
    assert [name for name, _ in contents.skipped] == ["broken.parquet"]
    assert "broken.parquet" in visible(path.read_text())
    assert "recording is not at hand" in visible(path.read_text())


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
    path, contents = report(tmp_path, tmp_path / "report.html")
    (shown,) = contents.estimates
    assert shown.validation is not None
    assert shown.validation_name == f"one.parquet {words}"
    # Times count from the window's start.
    length = shown.validation.t.max()
    assert length == pytest.approx(record.t[-1] - 6.0 if "from" in words else 4.5, abs=0.5)
    assert "no other motion has confirmed it" not in shown.headline
    assert f"Torques of one.parquet {words}" in visible(path.read_text())


def test_wrong_places_are_said(tmp_path: Path, finished_run: Path) -> None:
    with pytest.raises(dynid.InputError, match="no such directory"):
        report(tmp_path / "none", tmp_path / "r.html")
    with pytest.raises(dynid.InputError, match="no estimate"):
        report(tmp_path, tmp_path / "r.html")
    contents = ReportContents(title="t", directory=tmp_path)
    with pytest.raises(dynid.InputError, match="cannot be written"):
        write_report(contents, tmp_path / "none" / "r.html")


def test_a_design_is_shown_with_its_limits_over_time(finished_run: Path, tmp_path: Path) -> None:
    settings = dynid.DesignSettings(method="ga", population=20, generations=1, limits="paper")
    designed = dynid.design("ur5", settings, output=tmp_path / "design.json")
    document = json.loads((tmp_path / "design.json").read_text())
    document["design"]["limits"]["preset"] = "safe"
    (tmp_path / "design.json").write_text(json.dumps(document))
    dynid.write_estimate(
        dynid.read_estimate(finished_run / "estimate.json"), tmp_path / "estimate.json"
    )
    path, contents = report(tmp_path, tmp_path / "report.html")
    (shown,) = contents.designs
    assert shown.judged is not None
    worst = dynid.check(tmp_path / "design.json").certificate.margins
    # The instant where bodies come nearest is among those that are drawn.
    nearest = json.loads((tmp_path / "design.json").read_text())["design"]["worst"]
    assert {entry["t"] for entry in nearest.values()} <= set(shown.judged.t)
    largest = dict(zip(shown.judged.kinds, shown.judged.shares.max(axis=0), strict=True))
    # The certificate looks closer than two hundred instants, and adds what it is not sure of.
    assert 1 - largest["tcp_speed"] == pytest.approx(worst["tcp_speed"], abs=0.02)
    assert number(designed.condition_number, 4) in visible(path.read_text())
