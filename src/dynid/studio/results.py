"""The estimates of a folder, judged, in numbers that the page draws."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from dynid.report import ReportedEstimate
from dynid.studio.facts import encoded, plain, series, thinned
from dynid.workflow import report

PARAMETERS = 60
"""Most parameters of an estimate that are listed."""
CONFIDENCE = 1.96


def judged_estimates(folder: Path, output: Path | None) -> list[dict[str, Any]]:
    """Judge the estimates of a folder, the newest first.

    Args:
        folder: Where estimates and recordings are.
        output: Where the report goes; None for nowhere.

    Raises:
        DynidError: No estimate is there, or the report cannot be written.
    """
    with tempfile.TemporaryDirectory(prefix="dynid-studio-") as scratch:
        _, contents = report(folder, output or Path(scratch) / "report.html")
    newest = sorted(contents.estimates, key=lambda item: -_made(folder / item.name))
    return [_facts(item) for item in newest]


def _facts(item: ReportedEstimate) -> dict[str, Any]:
    estimate = item.estimate
    names = estimate.model.robot.joint_names
    found: dict[str, Any] = {
        "name": plain(item.name, 120),
        "level": {"usable": "good", "do_not_use": "bad"}.get(item.level, "warn"),
        "headline": plain(item.headline, 300),
        "warnings": [plain(str(warning), 300) for warning in item.warnings[:6]],
        "parameters": [
            {
                "name": plain(estimate.names[k]),
                "expression": plain(estimate.expressions[k], 160),
                "unit": estimate.units[k],
                "value": _finite(estimate.values[k]),
                "interval": _finite(CONFIDENCE * estimate.std[k]),
            }
            for k in estimate.essential[:PARAMETERS]
        ],
        "record": "",
    }
    shown = item.shown
    if shown is None:
        return found
    own = item.validation is None
    found["record"] = plain(item.training_name if own else item.validation_name, 120)
    error = np.sqrt(np.mean((shown.measured - shown.predicted) ** 2, axis=0))
    size = np.sqrt(np.mean(shown.measured**2, axis=0))
    found["joints"] = [
        {"name": plain(name), "error": _finite(error[j]), "torque": _finite(size[j])}
        for j, name in enumerate(names)
    ]
    found["basis"] = "the recording it was made from" if own else "another recording"
    start = estimate.settings.start_s if own else None
    t, measured, predicted = thinned(shown.t + (start or 0.0), shown.measured, shown.predicted)
    found["prediction"] = {
        "title": "Torque",
        "unit": "N·m",
        "series": [series("measured", measured), series("predicted", predicted)],
        "t": encoded(t),
    }
    return found


def _finite(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None


def _made(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0
