"""The clock of a topic: the stamps of its headers, or the times of arrival."""

from __future__ import annotations

import numpy as np

from dynid.recording.table import Mask, Rows


def clock_of(stamps: Rows, receive: Rows) -> tuple[str, Rows]:
    """Header stamps, unless drivers left them empty.

    Args:
        stamps: (N) header stamps [ns].
        receive: (N) receive times [ns].

    Returns:
        `header` or `receive`, and the stamps.
    """
    empty: Mask = stamps <= 0
    if empty.mean() > 0.5 or np.unique(stamps).size <= max(1, len(stamps) // 10):
        return "receive", receive
    return "header", stamps
