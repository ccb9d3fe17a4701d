"""`dynid export`: an estimate as a model that other programs load."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dynid.core.notices import Notice
from dynid.export.writing import ExportedFile, write_model
from dynid.workflow.temperature_file import estimate_at


@dataclass(frozen=True, slots=True, kw_only=True)
class Export:
    """A written model and what must be known about it."""

    to: str
    """The format."""
    written: ExportedFile
    warnings: tuple[Notice, ...]

    def to_json(self) -> dict[str, Any]:
        """The object that `--json` prints."""
        return {
            "file": str(self.written.path),
            "format": self.to,
            "verified": self.written.verified.to_json(),
            "physical": self.written.model.physical,
            "standard_parameters": self.written.model.origin,
            "left_out": list(self.written.left_out),
            "warnings": [notice.to_json() for notice in self.warnings],
        }


def export_file(
    estimate: str | Path, to: str, output: str | Path, *, at_degC: float | None = None
) -> Export:
    """Write the model of an estimate and have another program load it.

    Args:
        estimate: An estimate's JSON file.
        to: `urdf`, `mjcf`, `json`, `c` or `python`.
        output: File to write.
        at_degC: Temperature of all joints, where the file holds temperature laws [degC].

    Raises:
        InputError: An estimate that cannot be read, an unknown format, or a file that cannot be
            written.
        JobError: A model that the format cannot hold, or torques that differ after loading.
    """
    known = estimate_at(estimate, at_degC)
    made = known.provenance
    note = (
        f"dynid {made.versions.get('dynid', '')}, estimator {known.estimator}, "
        f"{known.samples} samples, identified {made.created}."
    )
    written = write_model(known, to, Path(output), note)
    return Export(to=to, written=written, warnings=_warnings(written))


def _warnings(written: ExportedFile) -> tuple[Notice, ...]:
    model = written.model
    if model.physical:
        return ()
    return (
        Notice(
            "not_physical",
            f"no bodies that can exist have the identified base parameters ({model.worst}):"
            " torques are right, but single masses and inertias mean nothing and simulators may"
            " refuse them; --estimator sdp finds consistent ones",
        ),
    )
