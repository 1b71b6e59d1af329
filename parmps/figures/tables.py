"""Tables of a run: what its signals reach, and when, against the motion of the tank."""

import numpy as np

from parmps.signals import measure, peak_measures, peaks

COLUMNS = (
    ("mean", "{}"),
    ("min", "{}"),
    ("max", "{}"),
    ("at", "s"),
    ("mean of peaks", "{}"),
    ("cycle", "s"),
    ("amplitude", "{}"),
    ("phase", "deg"),
    ("peaks", "{}"),
    ("deviation of peaks", "{}"),
    ("error of their mean", "{}"),
)
"""Columns of the table of peaks and their units; amplitude and phase are those of the motion's frequency."""


def forcing(job):
    """Angular frequency of the tank's motion with the greatest speed at the tank's far corner.

    Parameters
    ----------
    job : Job

    Returns
    -------
    float or None
        rad/s; None if no motion is a sine.
    """
    reach = float(np.hypot(*job.tank.size[-2:]))
    speeds = {}
    for item in job.motion:
        if item.kind != "file" and item.rate > 0.0:
            size = item.amplitude if hasattr(item, "amplitude") else np.radians(item.amplitude_deg) * reach
            speeds[item.rate] = max(speeds.get(item.rate, 0.0), abs(size) * item.rate)
    return max(speeds, key=speeds.get, default=None)


def response(time, values, omega):
    """Fit a + b sin(omega t + phase) to a signal, by least squares.

    Parameters
    ----------
    time, values : (n,) float64
    omega : float
        rad/s.

    Returns
    -------
    amplitude : float
        b >= 0.
    phase : float
        deg, from -180 to 180.
    """
    matrix = np.column_stack([np.ones(len(time)), np.sin(omega * time), np.cos(omega * time)])
    _, sine, cosine = np.linalg.lstsq(matrix, values, rcond=None)[0]
    return float(np.hypot(sine, cosine)), float(np.degrees(np.arctan2(cosine, sine)))


def peak_rows(time, signals, omega=None, period=None):
    """Measure every signal.

    Parameters
    ----------
    time : (n,) float64
        s.
    signals : list of tuple
        As `parmps.signals.read_signals` returns them.
    omega : float, optional
        Frequency of the motion, rad/s, for amplitude and phase.
    period : float, optional
        Of the motion, s, if it has one; peaks are then one a period.

    Returns
    -------
    list of tuple
        Name, unit and the values of `COLUMNS`, NaN where there is none.
    """
    rows = []
    for name, unit, values in signals:
        moments, heights = peaks(time, values, period)
        cycle = np.diff(moments).mean() if len(moments) > 1 else np.nan
        fit = response(time, values, omega) if omega else (np.nan, np.nan)
        extremes = [measure(kind, time, values) for kind in ("mean", "min", "max")]
        mean, *scatter = peak_measures(heights)
        rows.append((name, unit, (*extremes, time[values.argmax()], mean, cycle, *fit, *scatter)))
    return rows


def peak_table(rows):
    """Lay the table of peaks out as text.

    Parameters
    ----------
    rows : list of tuple
        As returned by `peak_rows`.

    Returns
    -------
    list of list of str
        A header row and one row a signal.
    """
    header = ["signal", "unit", *(f"{name} [{unit}]" if unit != "{}" else name for name, unit in COLUMNS)]
    cells = [[name, unit, *("-" if np.isnan(v) else f"{v:.5g}" for v in values)] for name, unit, values in rows]
    return [header, *cells]


def aligned(table):
    """Align the columns of a table for a terminal.

    Parameters
    ----------
    table : list of list of str

    Returns
    -------
    str
    """
    widths = [max(len(row[column]) for row in table) for column in range(len(table[0]))]
    lines = []
    for row in table:
        left = [cell.ljust(width) for cell, width in zip(row[:2], widths, strict=False)]
        lines.append("  ".join([*left, *(cell.rjust(width) for cell, width in zip(row[2:], widths[2:], strict=True))]))
    return "\n".join(line.rstrip() for line in lines)
