"""`dynid export`: an estimate as a model that other programs load."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynid.core import Array, Finding, InputError, told
from dynid.export import ExportedFile, write_model
from dynid.workflow.temperature import estimate_at

ENDINGS = {
    "urdf": (".urdf", ".xml"),
    "mjcf": (".xml", ".mjcf"),
    "json": (".json",),
    "c": (".h", ".hpp", ".c"),
    "python": (".py",),
}
"""What files of each format are called."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Export:
    """A written model and what must be known about it."""

    to: str
    """The format."""
    written: ExportedFile
    warnings: tuple[Finding, ...]

    def to_json(self) -> dict[str, Any]:
        """The object that `--json` prints."""
        return {
            "file": str(self.written.path),
            "format": self.to,
            "verified": self.written.verified.to_json(),
            "physical": self.written.model.physical,
            "standard_parameters": self.written.model.origin,
            "left_out": list(self.written.left_out),
            "warnings": told(self.warnings),
            "findings": [finding.to_json() for finding in self.warnings],
        }


def check_suffix(to: str, output: Path) -> None:
    """Refuse a name that belongs to another format, such as C in `arm.urdf`.

    Args:
        to: The format.
        output: File to write; an ending that belongs to no format is left to the user.

    Raises:
        InputError: The name ends as those of another format do.
    """
    suffix = output.suffix.lower()
    if to in ENDINGS and any(suffix in own for own in ENDINGS.values()):
        own = ENDINGS[to]
        if suffix not in own:
            raise InputError(
                f"the name is of another format than {to}",
                where="-o",
                value=str(output),
                limit=", ".join(f"*{ending}" for ending in own),
            )


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
    if any(known.model.friction.presliding):
        note += "\nIts presliding needs the past: friction here is that of joints that slide."
    written = write_model(known, to, Path(output), note)
    return Export(to=to, written=written, warnings=_warnings(to, written, known.noise))


def _warnings(to: str, written: ExportedFile, noise: Array) -> tuple[Finding, ...]:
    model, friction = written.model, written.friction
    found: list[Finding] = []
    if not model.physical:
        found.append(
            Finding(
                "not_physical",
                "no physically consistent links have the identified base parameters"
                f" ({model.worst}): torques are right, but single masses and inertias have no"
                " meaning, and simulators may refuse them; use --estimator sdp",
            )
        )
    if friction is not None and (friction.missing > noise).any():
        joints = ", ".join(
            f"{j + 1} ({friction.missing[j]:.2g} against {noise[j]:.2g})"
            for j in np.flatnonzero(friction.missing > noise)
        )
        found.append(
            Finding(
                "extrapolated",
                f"{to} cannot represent all identified friction; damping and dry friction"
                " approximate it over the recorded range. The residual exceeds the noise of the"
                f" identification at joints {joints}, RMS in N.m or N; c, python and json represent"
                " all of it",
            )
        )
    return tuple(found)
