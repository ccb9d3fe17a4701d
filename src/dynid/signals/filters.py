"""Zero-phase low-pass filters, derivatives, and the filter that a recorded torque has passed."""

from dataclasses import dataclass

import numpy as np

from dynid.core import Array, InputError, compiled, scipy_part
from dynid.signals.resample import GAP_STEPS, UniformSignals, linear, stretches

METHODS = ("central", "savgol")


def derivative(values: Array, rate_hz: float, method: str, cutoff_hz: float) -> Array:
    """First derivative along the first axis [unit/s].

    Of uniform samples (N, n), by the method `central`, differences of fourth order, or `savgol`, a
    cubic over one period of the cut-off.
    """
    if method == "savgol":
        half = max(2, int(0.5 * rate_hz / cutoff_hz + 1e-6))
        width = min(2 * half + 1, len(values) - 1 + len(values) % 2)
        savgol = scipy_part("signal").savgol_filter
        slope: Array = savgol(values, width, 3, deriv=1, delta=1.0 / rate_hz, axis=0)
        return slope
    # Differences of second order lose 0.3 % of a 2.5 Hz motion at 125 Hz.
    slope = np.gradient(values, 1.0 / rate_hz, axis=0, edge_order=2)
    if len(values) >= 5:
        inner = 8 * (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])
        slope[2:-2] = inner * (rate_hz / 12)
    return slope


def fourier_derivative(values: Array, rate_hz: float, cutoff_hz: float) -> tuple[Array, Array]:
    """Harmonics up to the cut-off, and their exact derivative (Swevers et al. 1997).

    The samples (N, n) are of whole periods.
    """
    count = len(values)
    spectrum = np.fft.rfft(values, axis=0)
    frequency = np.fft.rfftfreq(count, 1.0 / rate_hz)
    # A harmonic on the cut-off stays, of stamps that give a rate like 125.0000000002, too.
    spectrum[frequency > cutoff_hz * (1 + 1e-6)] = 0.0
    slope = spectrum * (2j * np.pi * frequency)[:, None]
    return np.fft.irfft(spectrum, count, axis=0), np.fft.irfft(slope, count, axis=0)


ORDER = 4
NYQUIST_SHARE = 0.8
"""Cut-offs stay below this share of half the sampling rate."""
HARMONIC_FACTOR = 10.0
"""Default cut-off over the highest frequency of the motion (5 to 10 in methods.md 3)."""
HIGHEST_MOTION_HZ = 25.0
"""No arm is excited by design above this."""
ABOVE_NOISE = 10.0
"""Power of a line over that of the noise from which it is motion: white noise exceeds it at one
frequency of 20 000."""
SETTLED = 16.0
"""Periods of the cut-off after which the filter has forgotten all but 1e-16 (order 4)."""
LOWEST_DEFAULT_HZ = 5.0
"""Friction turns over faster than the slowest motions."""


def low_pass(values: Array, rate_hz: float, cutoff_hz: float) -> Array:
    """Butterworth of order 4, forward and backward, along the first axis.

    At the cut-off, at most `NYQUIST_SHARE` of half the rate, half the amplitude remains.
    """
    share = min(cutoff_hz / (rate_hz / 2), NYQUIST_SHARE)
    sections = np.asarray(scipy_part("signal").butter(ORDER, share, output="sos"), dtype=np.float64)
    # Of a cut-off that a record is too short for, less is enough.
    beyond = min(int(np.ceil(2 * SETTLED / share)), 10 * len(values))
    before = _continued(sections, values[::-1], beyond, share)[::-1]
    padded = np.concatenate([before, values, _continued(sections, values, beyond, share)])
    passed = scipy_part("signal").sosfiltfilt(sections, padded, axis=0, padlen=0)
    return np.asarray(passed[beyond:-beyond], dtype=np.float64)


def _continued(sections: Array, values: Array, beyond: int, share: float) -> Array:
    """The cubics on which samples (N, n) go on behind their end, so many samples (beyond, n).

    Those that leave the filter at the end in the state in which the samples leave it: filtered
    forward and backward, the cubics then stay as they are, and a motion that does not rest keeps
    its velocity and acceleration.
    """
    signal = scipy_part("signal")
    last = values[-beyond:]
    time = np.arange(1 - len(last), beyond + 1, dtype=np.float64) * (np.pi * share)
    powers = np.asarray(np.vander(time, ORDER), dtype=np.float64)
    rest = signal.sosfilt_zi(sections)[..., None]

    def state(of: Array) -> Array:
        return signal.sosfilt(sections, of, axis=0, zi=rest * of[0])[1].reshape(ORDER, -1)

    cubics = np.linalg.lstsq(state(powers[: len(last)]), state(last - last[-1]), rcond=None)[0]
    return last[-1] + powers[len(last) :] @ cubics


SLOWEST = 0.1
"""Share of the rows of a joint that shows the noise of its positions."""
SURELY_MOVED = 4.0
"""Deviations of an encoder's noise from which a joint has moved."""


def encoder_noise(q: Array, smooth: Array) -> Array:
    """(n) standard deviation of the noise of positions (N, n), from what a low-pass takes away.

    From the median of the slowest rows: elsewhere, and where a joint starts or stops, a low-pass
    takes away motion. Not less than half the last digit of the encoder: at rest it changes too
    seldom to be seen in a median.
    """
    speed = np.abs(np.gradient(smooth, axis=0))
    slow = speed <= np.quantile(speed, SLOWEST, axis=0)
    noise = 1.4826 * np.nanmedian(np.where(slow, np.abs(q - smooth), np.nan), axis=0)
    steps = np.abs(np.diff(q, axis=0))
    digit = np.where(steps > 0, steps, np.inf).min(axis=0)
    return np.maximum(noise, np.where(np.isfinite(digit), digit, 0.0) / 2)


def without_noise(q: Array, noise: Array) -> Array:
    """Positions (N, n) with a dead band of `SURELY_MOVED` deviations (n) of their noise.

    Noise does not move a joint at rest, and one that starts does not move before, as behind a
    low-pass. Each position follows the recorded one where that is farther away and stays where it
    is closer, forward and backward in time: the mean is neither late nor early.
    """
    forward, backward = np.array(q, order="C"), np.array(q[::-1], order="C")
    for way in (forward, backward):
        _hold(way, SURELY_MOVED * noise)
    return (forward + backward[::-1]) / 2


@compiled()
def _hold(q: Array, band: Array) -> None:
    for j in range(q.shape[1]):
        now = q[0, j]
        for i in range(q.shape[0]):
            now = min(max(now, q[i, j] - band[j]), q[i, j] + band[j])
            q[i, j] = now


def motion_bandwidth(q: Array, rate_hz: float) -> float:
    """The frequency [Hz] below which 99 % of the velocity's power lies, median joint.

    Only the band in which arms are driven counts: above it lies noise, which differentiation
    makes large. In the band what stands clearly above that noise counts.
    """
    taper = np.hanning(len(q))[:, None]
    spectrum = np.square(np.abs(np.fft.rfft((q - q.mean(axis=0)) * taper, axis=0)))
    frequency = np.fft.rfftfreq(len(q), 1.0 / rate_hz)
    driven = frequency <= max(HIGHEST_MOTION_HZ, frequency[1])
    beyond, spectrum, frequency = spectrum[~driven], spectrum[driven], frequency[driven]
    if len(beyond):
        spectrum = np.where(spectrum > ABOVE_NOISE * beyond.mean(axis=0), spectrum, 0.0)
    power = spectrum * np.square(frequency)[:, None]
    total = power.sum(axis=0)
    moving = total > 1e-4 * total.max(initial=0.0)
    if total.max(initial=0.0) == 0:
        return float(frequency[1])
    cumulative = np.cumsum(power[:, moving], axis=0) / total[moving]
    edges = frequency[np.argmax(cumulative >= 0.99, axis=0)]
    return float(max(np.median(edges), frequency[1]))


def default_cutoff(q: Array, rate_hz: float) -> float:
    """A cut-off [Hz] from the motion's spectrum, at most 0.8 of half the rate."""
    wanted = max(HARMONIC_FACTOR * motion_bandwidth(q, rate_hz), LOWEST_DEFAULT_HZ)
    return float(min(wanted, NYQUIST_SHARE * rate_hz / 2))


REACH = 6.0
"""Periods of the cut-off after which the response has decayed to 1e-6 (order 4)."""
UNUSED = 0.5
"""Periods of the cut-off beside the ends of a record that are not used."""
ORDERS = (1, 2, 3, 4)
SMOOTHED_DB = -110.0
"""Power of the torque in the upper half of the band, over its strongest line, below which no
current or torque sensor can have written it: their noise is 40 dB and more above."""

END_DB = -60.0
"""Power over the strongest line below which a smoothed torque has ended."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TorqueFilter:
    """A Butterworth low-pass, forward and backward.

    Raises:
        InputError: A cut-off that is not positive, or an order that is not in `ORDERS`.
    """

    cutoff_hz: float
    order: int

    def __post_init__(self) -> None:
        if not 0 < self.cutoff_hz < 1e6:
            raise InputError("the torque filter's cut-off must be positive", value=self.cutoff_hz)
        if self.order not in ORDERS:
            raise InputError("the torque filter's order", value=self.order, limit=ORDERS)

    def reach(self, rate_hz: float) -> int:
        """Samples to either side that an output still depends on."""
        return int(np.ceil(REACH * rate_hz / self.cutoff_hz))

    def settled(self, rate_hz: float) -> int:
        """Samples at an end that what lies beyond it has shaped."""
        return int(np.ceil(UNUSED * rate_hz / self.cutoff_hz))

    def passed(self, values: Array, t: Array, rate_hz: float) -> Array:
        """What the filter makes of signals (..., N) with stamps t (N) [s], on a grid of a rate.

        Each stretch between gaps passes on its own. A rate that shows nothing of what the filter
        takes away shows the signals as they are.
        """
        if self.cutoff_hz >= rate_hz / 2:
            return np.array(values)
        butter = scipy_part("signal").butter
        sections: Array = butter(self.order, self.cutoff_hz, fs=rate_hz, output="sos")
        out = np.array(values)
        for part in stretches(t, GAP_STEPS / rate_hz):
            if part.stop - part.start > 2:
                padding = int(2 * rate_hz / self.cutoff_hz)
                out[..., part] = _stretch(sections, values[..., part], t[part], rate_hz, padding)
        return out

    def describe(self) -> str:
        """In words."""
        return (
            f"the record's torque was low-passed at {self.cutoff_hz:.3g} Hz "
            f"(order {self.order}, both ways): the model passes the same filter"
        )


def _stretch(sections: Array, values: Array, t: Array, rate_hz: float, padding: int) -> Array:
    count = round((t[-1] - t[0]) * rate_hz) + 1
    grid: Array = float(t[0]) + np.arange(count, dtype=np.float64) / rate_hz
    uniform = count == len(t) and np.abs(grid - t).max() < 1e-3 / rate_hz
    flat = values.reshape(-1, len(t))
    if not uniform:
        flat = linear(t, flat.T, grid).T
    padding = min(len(grid) - 2, padding)
    passed: Array = scipy_part("signal").sosfiltfilt(sections, flat, axis=-1, padlen=padding)
    if not uniform:
        passed = linear(grid, passed.T, t).T
    return passed.reshape(values.shape)


def was_smoothed(signals: UniformSignals) -> bool:
    """Whether the torque has nothing left in the upper half of its band, noise included."""
    level = _levels(signals.torque)
    return bool((level[len(level) // 2 :].mean(axis=0) < 10 ** (SMOOTHED_DB / 10)).all())


def torque_end(signals: UniformSignals) -> float:
    """The frequency [Hz] above which no joint's torque has more than `END_DB` left."""
    level = _levels(signals.torque)
    last = int(np.flatnonzero((level > 10 ** (END_DB / 10)).any(axis=1))[-1])
    return max(last, 1) / len(level) * signals.rate_hz / 2


def _levels(torque: Array) -> Array:
    """(f, n) power of each line over the strongest line of its joint; ones where it has none."""
    share = np.arange(len(torque), dtype=np.float64)[:, None] / max(len(torque) - 1, 1)
    level: Array = torque - torque[0] - share * (torque[-1] - torque[0])
    tapered = level * np.hanning(len(torque))[:, None]
    power = np.square(np.abs(np.fft.rfft(tapered, axis=0)))
    strongest = power.max(axis=0)
    return np.divide(power, strongest, out=np.ones_like(power), where=strongest > 0)
