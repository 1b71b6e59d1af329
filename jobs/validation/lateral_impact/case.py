"""Lateral impacts in shallow sloshing against the repetitions of SPHERIC benchmark 10."""

from pathlib import Path

import numpy as np

TITLE = "Lateral impact, SPHERIC 10"
SPACINGS = (0.0066, 0.0033)
VARIANTS = {
    "water": [],
    # sunflower oil, as the benchmark gives it; 0.8 of the first frequency
    "oil": ["fluids[0].density=900", "fluids[0].kinematic_viscosity=5.0e-5", "motion[0].omega=4.0924", "time.end=8.0"],
}
RECORD = {
    name: 100.0 * np.loadtxt(Path(__file__).with_name(f"{name}.txt"), skiprows=2) for name in ("water", "oil")
}
"""Pa, (repetitions, 4)."""
TARGETS = {**{f"peak {n} [std]": 2.0 for n in range(1, 5)}, "period [%]": 2.0}


def peaks(time, pressure, period):
    """Time and height of the highest pressure around each of the first four impacts.

    An impact is where the pressure, averaged over 20 ms, is highest in a period; the sensor is dry or nearly so
    between them.
    """
    share = max(int(round(0.02 / (time[1] - time[0]))), 1)
    smooth = np.convolve(pressure, np.full(share, 1.0 / share), "same")
    first = int(np.argmax(smooth > 0.3 * smooth.max()))
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
    share = max(int(round(duration / (results.time[1] - results.time[0]))), 1)
    return np.convolve(results.probe("sensor"), np.full(share, 1.0 / share), "same")


def measure(results):
    """Peaks in standard deviations of the repetitions from their means, and the time between impacts."""
    variant = "water" if results.job.fluids[0].density > 950.0 else "oil"
    record = RECORD[variant]
    period = 2.0 * np.pi / results.job.motion[0].omega
    found = {}
    for name, pressure in (("resolved", resolved(results)), ("peak", results.probe("sensor"))):
        time, height = peaks(results.time, pressure, period)
        deviation = (height - record.mean(axis=0)[: len(height)]) / record.std(axis=0)[: len(height)]
        found |= {f"{name} {n} [std]": value for n, value in enumerate(deviation, 1)}
    found |= {f"peak {n} [kPa]": 1e-3 * value for n, value in enumerate(height, 1)}
    found["period [%]"] = 100.0 * (np.diff(time).mean() / period - 1.0)
    found["volume [%]"] = 100.0 * results.record["volume_drift"]
    return found


def plot(figure, runs):
    """Pressure as it is and as far as it is resolved, with mean and two standard deviations of the peaks."""
    panels = figure.subplots(len(VARIANTS), 1)
    for panel, variant in zip(panels, VARIANTS, strict=True):
        mine = {key: results for key, results in runs.items() if key[0] == variant}
        for (_, preset, spacing), results in mine.items():
            label = f"{preset}, {1e3 * spacing:g} mm"
            lines = panel.plot(results.time, 1e-3 * resolved(results), linewidth=1.2, label=f"{label}, resolved")
            panel.plot(results.time, 1e-3 * results.probe("sensor"), linewidth=0.4, color=lines[0].get_color())
        if mine:
            results = next(iter(mine.values()))
            when, _ = peaks(results.time, results.probe("sensor"), 2.0 * np.pi / results.job.motion[0].omega)
            record = 1e-3 * RECORD[variant]
            style = {"fmt": "ks", "capsize": 4, "label": "experiment, 2 standard deviations"}
            panel.errorbar(when, record.mean(axis=0)[: len(when)], 2.0 * record.std(axis=0)[: len(when)], **style)
        panel.set_ylim(-0.5, 12.0 if variant == "water" else 2.0)
        panel.set_ylabel(f"{variant}: pressure [kPa]")
        panel.grid(alpha=0.3)
    panels[0].legend(fontsize="small", loc="upper left")
    panels[-1].set_xlabel("Time [s]")
