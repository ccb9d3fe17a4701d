from __future__ import annotations

import math
from html.parser import HTMLParser

import numpy as np
import pytest

from dynid.constraints import Worst
from dynid.core import InputError
from dynid.studio import text
from dynid.studio.live import Near
from dynid.studio.session import file_in

HOSTILE = [
    "<script>alert(1)</script>",
    "<img src=x onerror=alert(1)>",
    "a" * 10_000,
    "\u202egpj.exe",
    "\x00\x1b[31m",
    "&lt;b&gt;",
    "名前 🤖",
    "' onload='x",
]


class Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.attributes: set[str] = set()
        self.words = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}

    def handle_data(self, data: str) -> None:
        self.words += data


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_names_are_text(name: str) -> None:
    near = Near(
        kind="environment",
        names=f"{name} - {name}",
        distance=0.01,
        clearance=0.02,
        start=np.zeros(3),
        end=np.zeros(3),
    )
    worst = {
        "torque": Worst(margin=0.2, what=name, value=1.0, limit=2.0),
        "environment": Worst(margin=0.01, what=name, value=0.01, limit=0.02, distance=True),
    }
    page = text.nearest([near]) + text.margins(worst) + text.line(name)
    found = Tags()
    found.feed(page)
    assert found.tags <= {"div", "span"}
    assert found.attributes <= {"style", "data-dynid"}
    assert text.plain(name)[:10] in found.words
    assert len(text.plain(name)) <= text.LONGEST


def test_limits_that_are_broken_are_red_and_full() -> None:
    broken = text.margins({"torque": Worst(margin=-0.5, what="j", value=3.0, limit=2.0)})
    assert "150 %" in broken
    assert "width:100.0%" in broken
    assert text.BAD in broken
    touching = Worst(margin=-0.001, value=-0.001, limit=0.02, distance=True)
    assert text.BAD in text.margins({"environment": touching})
    assert "no limit" in text.margins({"torque": Worst(margin=math.nan)})


@pytest.mark.parametrize(
    "name", ["", "../up.json", "/etc/x.json", "a/b.json", "a\\b.json", ".json", ".x.json",
             "a.txt", "a.json\x00", "x" * 200 + ".json", "a\n.json"],
)  # fmt: skip
def test_the_page_writes_nowhere_but_into_its_folder(name: str, tmp_path) -> None:
    with pytest.raises(InputError, match="file name"):
        file_in(tmp_path, name, ".json")


def test_a_plain_name_is_taken(tmp_path) -> None:
    assert file_in(tmp_path, "名前.json", ".json") == tmp_path / "名前.json"
