"""Repair: tables of several topics, whose signals stand on rows of their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynid.core import Array
from dynid.recording.table import Mask, RawTable

_MOSTLY = 0.1
"""A quantity that is missing on more of the rows of q than this has rows of its own."""
_FEWEST_ROWS = 24
_FARTHEST = 5.0
"""Median steps of a quantity's own rows, across which it is still read between them."""


def lay_together(table: RawTable) -> RawTable:
    """Bring signals with rows of their own to the rows of q; drop rows of other topics.

    Args:
        table: Cells without a value are NaN.
    """
    if table.t is None or "q" not in table.signals:
        return table
    t = table.t
    there = np.isfinite(t) & np.isfinite(table.signals["q"]).all(axis=1)
    if there.sum() < _FEWEST_ROWS or there.all():
        return table
    for quantity in [name for name in table.signals if name != "q"]:
        value = table.signals[quantity]
        own = np.isfinite(t) & np.isfinite(value).all(axis=1)
        missing = there & ~own
        if missing.sum() <= _MOSTLY * there.sum() or (own & ~there).sum() < _FEWEST_ROWS:
            continue
        filled = value.copy()
        filled[missing] = _between(t[own], value[own], t[missing])
        rates = [float(1.0 / np.median(np.diff(np.unique(t[rows])))) for rows in (own, there)]
        table = table.with_signals({quantity: filled}).report(
            "clock_mismatch",
            f"{quantity} has rows of its own, {rates[0] / rates[1]:.3g} times as many a second as "
            "q; it is read between them on straight lines",
        )
    return _without_blank(table, there)


def _between(t: Array, value: Array, at: Array) -> Array:
    """Columns of `value` at other times; NaN where its own rows are too far apart."""
    order = np.argsort(t, kind="stable")
    t, value = t[order], value[order]
    step = float(np.median(np.diff(np.unique(t))))
    after = np.clip(np.searchsorted(t, at), 1, len(t) - 1)
    wide = (t[after] - t[after - 1] > _FARTHEST * step) | (at < t[0]) | (at > t[-1])
    out = np.empty((len(at), value.shape[1]))
    for joint, column in enumerate(value.T):
        out[:, joint] = np.interp(at, t, column)
    out[wide] = np.nan
    return out


def _without_blank(table: RawTable, there: Mask) -> RawTable:
    """Without rows that hold nothing of the joints."""
    blank = np.all([np.isnan(value).all(axis=1) for value in table.signals.values()], axis=0)
    if table.reported is not None:
        blank &= ~table.reported
    partly = ~there & ~blank
    if blank.mean() > 0.05:
        # Beside them stand rows that held another quantity only, which is on q's rows by now.
        blank |= partly & np.isnan(table.signals["q"]).all(axis=1)
    elif partly.mean() > 0.05:
        blank |= np.isnan(table.signals["q"]).all(axis=1)
    if blank.mean() <= 0.05:
        return table
    kept = table.keep(~blank, counted=False)
    return replace(kept, index=np.arange(kept.samples, dtype=np.int64)).note(
        f"{int(blank.sum())} of {table.samples} rows have no positions: they are of other topics"
    )
