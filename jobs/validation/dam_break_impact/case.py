"""Impact of a dam break on a wall against Lobovsky et al. 2014."""

from pathlib import Path

import numpy as np
from results import read_reference

TITLE = "Dam break: impact"
SPACINGS = (0.01, 0.005)
HEIGHT = 0.3
"""m, of the column."""
SENSORS = ("P1", "P3")
RECORD = {name: read_reference(Path(__file__).with_name(f"{name}.csv")) for name in SENSORS}
TARGETS = {f"{name} {what}": bound for name in SENSORS for what, bound in (("arrival [%]", 2.0), ("impulse [%]", 10.0))}


def scaled(results, name):
    """Time t sqrt(g / H) and pressure p / (rho g H) of a sensor."""
    gravity = results.job.gravity
    return results.time * np.sqrt(gravity / HEIGHT), results.probe(name) / (1000.0 * gravity * HEIGHT)


def arrival(time, pressure):
    """Time at which the pressure first passes a quarter of rho g H, from a line between samples."""
    at = int(np.argmax(pressure >= 0.25))
    if at == 0:
        return time[-1]
    share = (0.25 - pressure[at - 1]) / (pressure[at] - pressure[at - 1])
    return time[at - 1] + share * (time[at] - time[at - 1])


def measure(results):
    """Arrival, impulse over the record and the peak, each over that of the record."""
    found = {}
    for name, (when, wanted) in ((name, RECORD[name].T) for name in SENSORS):
        order = np.argsort(when, kind="stable")
        when, wanted = when[order], wanted[order]
        time, pressure = scaled(results, name)
        within = np.linspace(when[0], when[-1], 2000)
        impulse = np.interp(within, time, pressure).mean() / np.interp(within, when, wanted).mean()
        found[f"{name} arrival [%]"] = 100.0 * (arrival(time, pressure) / arrival(when, wanted) - 1.0)
        found[f"{name} impulse [%]"] = 100.0 * (impulse - 1.0)
        found[f"{name} peak [%]"] = 100.0 * (pressure[time < 4.0].max() / wanted[when < 4.0].max() - 1.0)
    return found


def plot(figure, runs):
    """Pressure of both sensors."""
    panels = figure.subplots(len(SENSORS), len(SPACINGS), sharex=True, sharey="row")
    for row, name in zip(panels, SENSORS, strict=True):
        for panel, size in zip(row, SPACINGS, strict=True):
            panel.plot(*RECORD[name].T, color="black", linewidth=2.0, alpha=0.5, label="experiment")
            for (_, preset, spacing), results in runs.items():
                if spacing == size:
                    panel.plot(*scaled(results, name), linewidth=0.8, label=preset)
            panel.set_ylim(-0.3, 4.0)
            panel.grid(alpha=0.3)
            panel.set_title(f"{name}, {1e3 * size:g} mm")
        row[0].set_ylabel("$p/(\\rho g H)$")
    panels[0, -1].legend(fontsize="small")
    for panel in panels[-1]:
        panel.set_xlabel("$t\\sqrt{g/H}$")
        panel.set_xlim(0.0, 7.0)
