"""Small roll of the three layers of paper 000's tank against linear theory."""

import functools

import numpy as np
from layered_waves import roll_response
from results import rms

from parmps.waves import layers_of

TITLE = "Small roll of three layers"
SPACINGS = (0.02, 0.01)
NAMES = ("WD", "CW", "surface")
TARGETS = {f"{name} [%]": 5.0 for name in NAMES}


@functools.lru_cache
def theory(job, end, samples):
    """Elevations at the left wall, m: (samples, 3)."""
    motion = job.motion[0]
    times = np.linspace(0.0, end, samples)
    return roll_response(
        layers_of(job), job.tank.length, np.radians(motion.amplitude_deg), motion.omega, 0.0, times
    )


def elevations(results):
    """The same by the probes."""
    measured = np.stack([results.probe(name) for name in NAMES], axis=1)
    return measured - measured[0]


def measure(results):
    """Rms difference over the rms of theory, for each boundary of the layers."""
    wanted = theory(results.job, float(results.time[-1]), len(results.time))
    error = elevations(results) - wanted
    found = {f"{name} [%]": 100.0 * rms(error[:, i]) / rms(wanted[:, i]) for i, name in enumerate(NAMES)}
    found["volume [%]"] = 100.0 * results.record["volume_drift"]
    return found


def plot(figure, runs):
    """Elevations over time."""
    panels = figure.subplots(3, 1, sharex=True)
    for (_, preset, spacing), results in runs.items():
        wanted = theory(results.job, float(results.time[-1]), len(results.time))
        for i, panel in enumerate(panels[::-1]):
            panel.plot(results.time, 1e3 * elevations(results)[:, i], label=f"{preset}, {1e3 * spacing:g} mm")
    for i, panel in enumerate(panels[::-1]):
        panel.plot(results.time, 1e3 * wanted[:, i], "k--", linewidth=0.8, label="linear theory")
        panel.set_ylabel(f"{NAMES[i]} [mm]")
        panel.grid(alpha=0.3)
    panels[0].legend(fontsize="small")
    panels[-1].set_xlabel("Time [s]")
