"""Signals of a run: tables like ``probes.csv``, and what is measured on a signal in a window of time."""

import csv
import re

import numpy as np
from scipy.integrate import trapezoid

from parmps.errors import InputError

_TITLE = re.compile(r"(.*?)\s*(?:\[([^][]*)\])?")


def read_signals(path):
    """Read a table of signals.

    Parameters
    ----------
    path : path-like
        CSV file: time in s, then columns with the header ``name [unit]``.

    Returns
    -------
    time : (n,) float64
        s.
    signals : list of tuple
        Name (str), unit (str) and values (n,) of each column.

    Raises
    ------
    InputError
        If the file cannot be read, holds no rows, or something else than numbers below its header.
    """
    try:
        with open(path, newline="", encoding="utf-8") as file:
            header, *rows = csv.reader(file)
        values = np.array(rows, dtype=float)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError("", f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    except ValueError as error:
        raise InputError("", f"{path}: must be a header and rows of as many numbers: {error}") from None
    if values.ndim != 2 or values.shape[1] != len(header):
        reason = "the header and the rows differ in length" if rows else "has no rows yet"
        raise InputError("", f"{path} {reason}")
    signals = []
    for column, title in enumerate(header[1:], start=1):
        name, unit = _TITLE.fullmatch(title).groups(default="")
        signals.append((name, unit, values[:, column]))
    return values[:, 0], signals


def find_signal(signals, title):
    """Find a signal by its name, or its name and unit.

    Parameters
    ----------
    signals : list of tuple
        As `read_signals` returned them.
    title : str
        ``P1`` or ``P1 [Pa]``.

    Returns
    -------
    tuple
        Name, unit and values.

    Raises
    ------
    InputError
        If there is none.
    """
    for name, unit, values in signals:
        if title in (name, f"{name} [{unit}]"):
            return name, unit, values
    raise InputError("", f"no column '{title}'; there are {', '.join(name for name, _, _ in signals)}")


def principal(signals):
    """Leave out what repeats other signals: highest values beside means, and the tank's loads where they are all.

    Parameters
    ----------
    signals : list of tuple
        As `read_signals` returned them.

    Returns
    -------
    list of tuple
    """
    known = {name: values for name, _, values in signals}

    def repeats(name, values):
        whole, _, last = name.rpartition(".")
        if last == "max":
            return whole in known
        total = known.get(f"{whole.removesuffix('.tank')}.{last}")
        return whole.endswith(".tank") and total is not None and np.array_equal(total, values)

    return [signal for signal in signals if not repeats(signal[0], signal[2])]


SMOOTHING = 1.0 / 8.0
"""Standard deviation of the Gaussian that takes the noise off a signal before it is cut into cycles, in periods: a
sine keeps three quarters of its amplitude, ripples of a quarter of its period a hundredth."""
SWING = 0.5
"""How far from its mean, in standard deviations, a smoothed signal goes to both sides in a cycle."""


def _smooth(time, values, period):
    """Signal without noise shorter than a period, s: (n,) float64."""
    even = np.linspace(time[0], time[-1], len(time))
    samples = np.interp(even, time, values)
    mirrored = np.concatenate([samples, samples[::-1]])
    frequency = np.fft.rfftfreq(len(mirrored), even[1] - even[0])
    weight = np.exp(-0.5 * (2.0 * np.pi * frequency * SMOOTHING * period) ** 2)
    return np.interp(time, even, np.fft.irfft(np.fft.rfft(mirrored) * weight, len(mirrored))[: len(even)])


def cycles(time, values, period=None):
    """Split a signal into its cycles.

    With the period of what drives it, they are of about this length, from a trough of the smoothed signal to the next
    one. Without, they are from one upward crossing of the mean to the next, once the signal, smoothed over an eighth
    of its dominant period, has gone by half of its standard deviation to either side: noise cuts neither.

    Parameters
    ----------
    time, values : (n,) float64
    period : float, optional
        s.

    Returns
    -------
    list of slice
        The whole cycles; empty if there is none.
    """
    if np.ptp(values) == 0.0:
        return []
    if period is not None:
        return _forced_cycles(time, values, period)
    smooth = _smooth(time, values, 1.0 / _frequency(time, values))
    swing = smooth - smooth.mean()
    threshold = SWING * swing.std()
    starts, low, crossing = [], False, None
    for index, value in enumerate(swing):
        if value < 0.0:
            low, crossing = low or value < -threshold, None
        elif crossing is None:
            crossing = index
        if low and value > threshold:
            starts.append(crossing)
            low = False
    return [slice(a, b) for a, b in zip(starts, starts[1:], strict=False)]


def _forced_cycles(time, values, period):
    """Cycles of a known period, between the troughs nearest to half a period from the crests of its harmonic."""
    smooth, turn = _smooth(time, values, period), 2.0 * np.pi * time / period
    crest = np.angle(np.sum((values - values.mean()) * np.exp(1j * turn))) / (2.0 * np.pi)
    number = np.arange(np.floor(time[0] / period) - 1, np.ceil(time[-1] / period) + 2)
    cuts = []
    for nominal in (number + crest + 0.5) * period:
        near = np.flatnonzero(np.abs(time - nominal) <= 0.25 * period)
        if len(near):
            cuts.append(near[np.argmin(smooth[near])])
    ends = sorted({0, *cuts, len(time)})
    parts = [slice(a, b) for a, b in zip(ends, ends[1:], strict=False)]
    return [part for part in parts if time[part.stop - 1] - time[part.start] >= 0.5 * period and _whole(values, part)]


def _whole(values, part):
    """Whether the signal's ends cut nothing from a cycle's peak."""
    top = part.start + int(np.argmax(values[part]))
    return 0 < top < len(values) - 1


def peaks(time, values, period=None):
    """Find the greatest value of each whole cycle.

    Parameters
    ----------
    time, values : (n,) float64
    period : float, optional
        Of what drives the signal, s.

    Returns
    -------
    times, heights : (cycles,) float64
    """
    at = np.array([part.start + int(np.argmax(values[part])) for part in cycles(time, values, period)], int)
    return time[at], values[at]


def spectrum(time, values):
    """Amplitude spectrum of a signal about its mean, with a Hann window, and zeros behind for a smooth curve.

    Parameters
    ----------
    time : (n,) float64
        s; uneven samples are interpolated to as many even ones.
    values : (n,) float64

    Returns
    -------
    frequency : (2 n + 1,) float64
        Hz.
    amplitude : (2 n + 1,) float64
        A sine that fills the window shows its own amplitude.
    """
    even = np.linspace(time[0], time[-1], len(time))
    window = np.hanning(len(time))
    samples = np.interp(even, time, values)
    weighted = window * (samples - np.average(samples, weights=window))
    frequency = np.fft.rfftfreq(4 * len(time), even[1] - even[0])
    return frequency, 2.0 * np.abs(np.fft.rfft(weighted, 4 * len(time))) / window.sum()


def _frequency(time, values):
    """Frequency of the highest line of the spectrum, Hz: the top of a parabola through three logarithms."""
    frequency, amplitude = spectrum(time, values)
    top = int(np.argmax(amplitude[1:])) + 1
    if amplitude[top] == 0.0:
        return np.nan
    if top == len(amplitude) - 1:
        return frequency[top]
    low, middle, high = np.log(np.maximum(amplitude[top - 1 : top + 2], 1e-300))
    return frequency[1] * (top + 0.5 * (low - high) / (low - 2.0 * middle + high))


def peak_measures(heights):
    """Mean of peaks, their number, their standard deviation, and the standard error of the mean.

    The error is that of peaks that do not depend on each other.

    Parameters
    ----------
    heights : (n,) float64

    Returns
    -------
    tuple of float
        NaN where there are too few.
    """
    count = len(heights)
    mean = heights.mean() if count else np.nan
    deviation = heights.std(ddof=1) if count > 1 else np.nan
    return mean, float(count), deviation, deviation / np.sqrt(max(count, 1))


def _of_peaks(number):
    return lambda time, values, period: peak_measures(peaks(time, values, period)[1])[number]


MEASURES = {
    "max": ("greatest value", "{}", lambda time, values, period: values.max()),
    "min": ("least value", "{}", lambda time, values, period: values.min()),
    "mean": ("mean in time", "{}", lambda time, values, period: trapezoid(values, time) / (time[-1] - time[0])),
    "mean_peaks": ("mean of the greatest values of the whole cycles", "{}", _of_peaks(0)),
    "peak_count": ("number of these peaks", "", _of_peaks(1)),
    "peak_deviation": ("standard deviation of these peaks", "{}", _of_peaks(2)),
    "peak_error": ("standard error of their mean", "{}", _of_peaks(3)),
    "rms": ("root mean square about the mean", "{}", lambda time, values, period: values.std()),
    "frequency": ("dominant frequency", "Hz", lambda time, values, period: _frequency(time, values)),
    "impulse": ("integral over time", "{} s", lambda time, values, period: trapezoid(values, time)),
}
"""What can be measured: meaning, unit by that of the signal, and the function of time, values and forcing period."""

BESIDE = {"mean_peaks": {"peak_count": "number", "peak_deviation": "deviation", "peak_error": "standard error"}}
"""Measures that a table gives beside one, and what it calls them."""

LEAST_SAMPLES = 4


def measure(kind, time, values, begin=None, end=None, period=None):
    """Measure a signal in a window of time.

    Parameters
    ----------
    kind : str
        Of `MEASURES`.
    time, values : (n,) float64
        Time (s) and signal.
    begin, end : float, optional
        The window, s; the whole signal by default.
    period : float, optional
        Of what drives the signal, s; peaks are then one a period.

    Returns
    -------
    float
        NaN where the signal has no cycle to measure.

    Raises
    ------
    InputError
        If the window holds fewer than four samples.
    """
    low, high = (-np.inf if begin is None else begin), (np.inf if end is None else end)
    inside = (time >= low) & (time <= high)
    if inside.sum() < LEAST_SAMPLES:
        found = f"{inside.sum()} samples from {low:g} s to {high:g} s"
        raise InputError("", f"{found}; at least {LEAST_SAMPLES} are needed")
    return float(MEASURES[kind][2](time[inside], values[inside], period))
