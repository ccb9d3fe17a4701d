"""Where a result comes from: versions, inputs by hash, settings, seed."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """What is needed to make a result again."""

    created: str
    """UTC time, ISO 8601."""
    versions: Mapping[str, str]
    """Package name to version; `python` included."""
    inputs: Mapping[str, str] = field(default_factory=dict[str, str])
    """Input path to SHA-256 of its bytes."""
    settings: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Settings as given, JSON values only."""
    seed: int | None = None
    """The seed, where randomness was used."""

    def to_json(self) -> dict[str, Any]:
        """A JSON object."""
        return {
            "created": self.created,
            "versions": dict(self.versions),
            "inputs": dict(self.inputs),
            "settings": dict(self.settings),
            "seed": self.seed,
        }


def provenance(
    inputs: Mapping[str, str] | None = None,
    settings: Mapping[str, Any] | None = None,
    seed: int | None = None,
) -> Provenance:
    """A provenance stamped now."""
    versions = {"python": platform.python_version()}
    for package in ("dynid", "numpy", "scipy", "numba"):
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = "unknown"
    return Provenance(
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        versions=versions,
        inputs=dict(inputs or {}),
        settings=dict(settings or {}),
        seed=seed,
    )


def file_hash(path: Path) -> str:
    """SHA-256 of a file, as hex."""
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while chunk := stream.read(1 << 20):
            digest.update(chunk)
    return digest.hexdigest()
