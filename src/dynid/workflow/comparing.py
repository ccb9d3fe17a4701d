"""`dynid compare`: two estimates, from their files."""

from __future__ import annotations

from pathlib import Path

from dynid.identification.estimate_file import read_estimate
from dynid.validation.comparison import ParameterComparison, compare


def compare_files(a: str | Path, b: str | Path) -> ParameterComparison:
    """Compare two estimates.

    Args:
        a: The first estimate's JSON file, such as the cold robot's.
        b: The second one's, such as the warm robot's.

    Raises:
        InputError: Files that cannot be read, or estimates that cannot be compared.
    """
    return compare(read_estimate(a), read_estimate(b))
