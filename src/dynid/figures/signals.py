"""Spectrum of a motion and the cut-off that was chosen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynid.core.arrays import Array
from dynid.figures.canvas import Canvas
from dynid.figures.theme import LIMIT, colour, figure, label, line, log_axis

FLOOR = 1e-9


def spectrum(
    values: Array, rate_hz: float, cutoff_hz: float, names: Sequence[str], what: str
) -> Canvas:
    """Amplitudes over frequency, with the cut-off.

    Args:
        values: (N, n) uniform samples.
        rate_hz: Their rate [Hz].
        cutoff_hz: Cut-off that was chosen [Hz].
        names: (n) joint names.
        what: What is shown, with its unit.
    """
    centred: Array = values - values.mean(axis=0)
    window = np.hanning(len(values))[:, None]
    amplitude = 2 * np.abs(np.fft.rfft(centred * window, axis=0)) / window.sum()
    frequency = np.arange(float(len(amplitude))) * (rate_hz / len(values))
    drawn = figure(
        title=f"Spectrum: {what}, cut-off {cutoff_hz:.3g} Hz", x="frequency [Hz]", y="amplitude"
    )
    for j, name in enumerate(names):
        drawn.add_trace(
            line(
                frequency[1:],
                np.maximum(amplitude[1:, j], FLOOR),
                label(name),
                color=colour(j),
            )
        )
    drawn.add_vline(cutoff_hz, line={"color": LIMIT, "dash": "dash"})
    drawn.update_xaxes(**log_axis(frequency[1:]))
    drawn.update_yaxes(type="log", exponentformat="power")
    return drawn
