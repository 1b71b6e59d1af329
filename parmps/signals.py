"""Signals of a run: tables like ``probes.csv``, and what is measured on a signal in a window of time."""

import csv
import re

import numpy as np

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


def cycles(values):
    """Split a signal into its cycles, each from one upward crossing of the mean to the next.

    Ripples about the mean do not end a cycle: a crossing counts once the signal has been below the mean by
    half of its standard deviation.

    Parameters
    ----------
    values : (n,) float64

    Returns
    -------
    list of slice
        The whole cycles; empty if there is none.
    """
    swing = values - values.mean()
    threshold = 0.5 * swing.std()
    starts, armed = [], False
    for index, value in enumerate(swing):
        if value < -threshold:
            armed = True
        elif armed and value >= 0.0:
            starts.append(index)
            armed = False
    return [slice(a, b) for a, b in zip(starts, starts[1:], strict=False)]


def peaks(time, values):
    """Find the greatest value of each whole cycle.

    Parameters
    ----------
    time, values : (n,) float64

    Returns
    -------
    times, heights : (cycles,) float64
    """
    at = np.array([part.start + int(np.argmax(values[part])) for part in cycles(values)], int)
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


def _mean_peaks(time, values):
    heights = peaks(time, values)[1]
    return heights.mean() if len(heights) else np.nan


MEASURES = {
    "max": ("greatest value", "{}", lambda time, values: values.max()),
    "min": ("least value", "{}", lambda time, values: values.min()),
    "mean": ("mean in time", "{}", lambda time, values: np.trapz(values, time) / (time[-1] - time[0])),
    "mean_peaks": ("mean of the greatest values of the whole cycles", "{}", _mean_peaks),
    "rms": ("root mean square about the mean", "{}", lambda time, values: values.std()),
    "frequency": ("dominant frequency", "Hz", _frequency),
    "impulse": ("integral over time", "{} s", lambda time, values: np.trapz(values, time)),
}
"""What can be measured: meaning, unit by that of the signal, and the function of time and values."""

LEAST_SAMPLES = 4


def measure(kind, time, values, begin=None, end=None):
    """Measure a signal in a window of time.

    Parameters
    ----------
    kind : str
        Of `MEASURES`.
    time, values : (n,) float64
        Time (s) and signal.
    begin, end : float, optional
        The window, s; the whole signal by default.

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
    return float(MEASURES[kind][2](time[inside], values[inside]))
