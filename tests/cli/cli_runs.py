"""What the tests of the command line share."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import dynid

COMMANDS = (
    "robots",
    "analyze",
    "fit",
    "design",
    "check",
    "controller",
    "run",
    "import",
    "identify",
    "validate",
    "compare",
    "gains",
    "payload",
    "gravity",
    "export",
    "report",
    "fleet",
    "studio",
    "demo",
)
LISTED = (*COMMANDS, "bench")
"""`bench` is a group of commands."""


@dataclass(frozen=True)
class Outcome:
    code: int
    out: str
    err: str

    def json(self) -> dict[str, Any]:
        """The one JSON object on stdout; strict, so NaN and Infinity fail."""

        def refuse(word: str) -> None:
            raise AssertionError(f"{word} in JSON")

        assert self.out, self.err
        return json.loads(self.out, parse_constant=refuse)


Run = Callable[..., Outcome]


@dataclass(frozen=True)
class Recordings:
    identification: Path
    validation: Path
    csv: Path
    estimate: Path


def write_rtde_csv(record: dynid.ExperimentRecord, path: Path) -> None:
    names = {"q": "actual_q", "qd": "actual_qd", "current": "actual_current"}
    header = ["timestamp", *(f"{long}_{j}" for long in names.values() for j in range(6))]
    table = np.column_stack([record.t, *(record.signals[name] for name in names)])
    np.savetxt(path, table, delimiter=",", header=",".join(header), comments="", fmt="%.6f")
