"""What reading a file may cost: memory, time, temporary space, and values, by the file's size.

A file of up to 20 MB may claim anything: it gets a fixed budget. What a larger file needs grows
with its size, so that long recordings have no bound of their own.
"""

from __future__ import annotations

import math
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dynid.core import RecordError

_SMALL = 20_000_000
"""Files up to this size [bytes] share one budget."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """What reading may cost."""

    memory_bytes: int = 1 << 30
    """Memory of the reader, beyond what its program takes."""
    cpu_s: float = 17.0
    """CPU time of the reader."""
    unpacked_bytes: int = 512 << 20
    """Size of what comes out of compressed files, on disk."""
    values: int = 16_000_000
    """Numbers in the table that is read, and in the arrays it is chosen from."""

    @classmethod
    def of(cls, files: Sequence[Path]) -> Budget:
        """The budget for files that belong together."""
        more = max(0, sum(file.stat().st_size for file in files) - _SMALL)
        return cls(
            memory_bytes=(1 << 30) + 30 * more,
            cpu_s=17.0 + 2e-6 * more,
            unpacked_bytes=(512 << 20) + 30 * more,
            values=16_000_000 + 4 * more,
        )

    def require_values(self, *shape: int, where: str, times: int = 1) -> int:
        """Check a size that a file claims before anything of that size is made.

        Args:
            *shape: Sizes along the axes.
            where: The file or the array, for messages.
            times: How many of them there are.

        Returns:
            The number of values.

        Raises:
            RecordError: More values than a file of this size may have.
        """
        count = math.prod(shape) * times
        if count > self.values:
            raise RecordError(
                "the file claims more numbers than one of its size may hold",
                where=where,
                value=f"{count:.3g} numbers",
                limit=f"{self.values:.3g}",
                next_step="Save only the signals of the joints, or split the recording.",
            )
        return count

    def require_space(self, folder: str | None = None) -> int:
        """Bytes that unpacking may write: the budget, as far as the disk has them.

        Raises:
            RecordError: The disk is nearly full.
        """
        place = folder or tempfile.gettempdir()
        free = shutil.disk_usage(place).free - (64 << 20)
        if free <= 0:
            raise RecordError(
                "there is no room to unpack the file",
                where=place,
                limit="64 MB must stay free",
                next_step="Free some space, or set TMPDIR to a folder on another disk.",
            )
        return min(self.unpacked_bytes, free)
