"""Lateral impacts in a rolling tank: peaks of the pressure against the repetitions of SPHERIC benchmark 10."""

from pathlib import Path

import numpy as np

RECORD = {
    name: 100.0 * np.loadtxt(Path(__file__).with_name("lateral_impact") / f"{name}.txt", skiprows=2)
    for name in ("water", "oil")
}
"""Pa, (repetitions, 4)."""
PERIODS = {"water": 1.6313, "oil": 1.5324}
"""Of the roll, s."""
QUIET = 1.25
"""Periods before the first impact; until then the liquid rises once at the sensor without one."""
TARGETS = {**{f"peak {n} [std]": 2.0 for n in range(1, 5)}, "period [%]": 2.0}


def liquid(job):
    """Which of the two liquids a job has."""
    return "water" if job.fluids[0].density > 950.0 else "oil"


def mean(time, pressure, duration):
    """Moving mean over a duration in s."""
    share = max(int(round(duration / (time[1] - time[0]))), 1)
    return np.convolve(pressure, np.full(share, 1.0 / share), "same")


def peaks(time, pressure, period):
    """Time and height of the highest pressure around each of the first four impacts.

    An impact is where the pressure, averaged over 20 ms, is highest in a period; the sensor is dry or nearly so
    between them.

    Parameters
    ----------
    time, pressure : (n,) float64, s and Pa
    period : float
        s.

    Returns
    -------
    (4,) float64, s
    (4,) float64, Pa
    """
    smooth = mean(time, pressure, 0.02)
    first = int(np.argmax((smooth > 0.3 * smooth.max()) & (time > QUIET * period)))
    found = []
    for number in range(4):
        middle = time[first] + number * period
        part = np.flatnonzero(np.abs(time - middle) < 0.35 * period)
        if len(part):
            found.append(part[pressure[part].argmax()])
    return time[found], pressure[found]


def resolved(results):
    """Pressure of the sensor as far as its course is resolved, Pa: means over the time of a spacing at sqrt(g h)."""
    job = results.job
    duration = job.spacing / np.sqrt(job.gravity * job.fluids[0].depth)
    return mean(results.time, results.probe("sensor"), duration)


def measure(results):
    """Peaks, as they are and resolved, in standard deviations from the mean of the repetitions, and their period."""
    name = liquid(results.job)
    record, period = RECORD[name], PERIODS[name]
    found = {}
    for label, pressure in (("resolved", resolved(results)), ("peak", results.probe("sensor"))):
        time, height = peaks(results.time, pressure, period)
        deviation = (height - record.mean(axis=0)[: len(height)]) / record.std(axis=0)[: len(height)]
        found |= {f"{label} {n} [std]": value for n, value in enumerate(deviation, 1)}
        found |= {f"{label} {n} [kPa]": 1e-3 * value for n, value in enumerate(height, 1)}
    found["first [s]"] = time[0]
    found["period [%]"] = 100.0 * (np.diff(time).mean() / period - 1.0)
    found["volume [%]"] = 100.0 * results.record["volume_drift"]
    return found


def plot(panel, runs, highest):
    """Draw pressures as they are and as far as they are resolved, with mean and two standard deviations of the peaks.

    Parameters
    ----------
    panel : matplotlib.axes.Axes
    runs : dict of str to Results
        By label, of one liquid.
    highest : float
        End of the pressure's axis, kPa.
    """
    for label, results in runs.items():
        lines = panel.plot(results.time, 1e-3 * resolved(results), linewidth=1.2, label=f"{label}, resolved")
        panel.plot(results.time, 1e-3 * results.probe("sensor"), linewidth=0.4, color=lines[0].get_color())
    if runs:
        results = next(iter(runs.values()))
        name = liquid(results.job)
        when, _ = peaks(results.time, results.probe("sensor"), PERIODS[name])
        record = 1e-3 * RECORD[name]
        style = {"fmt": "ks", "capsize": 4, "label": "experiment, 2 standard deviations"}
        panel.errorbar(when, record.mean(axis=0)[: len(when)], 2.0 * record.std(axis=0)[: len(when)], **style)
        panel.set_ylabel(f"{name}: pressure [kPa]")
    panel.set_ylim(-0.04 * highest, highest)
    panel.grid(alpha=0.3)
    panel.legend(fontsize="small", loc="upper left")
