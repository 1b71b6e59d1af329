"""Small roll of the three layers of paper 000's tank against linear theory."""

import functools

import numpy as np
from layered_waves import layer_modes, roll_response
from results import rms

from parmps.waves import layers_of

TITLE = "Small roll of three layers"
SPACINGS = (0.02, 0.01, 0.005)
NAMES = ("WD", "CW", "surface")
TARGETS = {f"{name}{way} [%]": 5.0 for way in (" at the wall", " by centres") for name in NAMES}


@functools.lru_cache
def theory(job, end, samples):
    """Elevations at the left wall, and by the centres of the liquids, m: two (samples, 3)."""
    motion = job.motion[0]
    motion = (np.radians(motion.amplitude_deg), motion.omega, 0.0, np.linspace(0.0, end, samples))
    return [roll_response(layers_of(job), job.tank.length, *motion, power=power) for power in (0, 2)]


def elevations(results):
    """The same by the probes."""
    measured = np.stack([results.probe(name) for name in NAMES], axis=1)
    return measured - measured[0]


def measure(results):
    """Rms difference over the rms of theory, for each boundary of the layers, by gauges and by the liquids' centres."""
    wall, _ = theory(results.job, float(results.time[-1]), len(results.time))
    _, mode = theory(results.job, float(results.frames[-1]), len(results.frames))
    centres = layer_modes(results)
    ways = {" at the wall": (elevations(results), wall), " by centres": (centres - centres[0], mode)}
    found = {}
    for way, (signal, wanted) in ways.items():
        for i, name in enumerate(NAMES):
            found[f"{name}{way} [%]"] = 100.0 * rms(signal[:, i] - wanted[:, i]) / rms(wanted[:, i])
    found["volume [%]"] = 100.0 * results.record["volume_drift"]
    return found


def plot(figure, runs):
    """Elevations at the wall, and by the centres, over time."""
    panels = figure.subplots(3, 2, sharex=True, sharey="row")
    for (_, preset, spacing), results in runs.items():
        wall, _ = theory(results.job, float(results.time[-1]), len(results.time))
        _, mode = theory(results.job, float(results.frames[-1]), len(results.frames))
        for i, row in enumerate(panels[::-1]):
            for panel, time, signal in zip(
                row, (results.time, results.frames), (elevations(results), layer_modes(results)), strict=True
            ):
                panel.plot(time, 1e3 * (signal[:, i] - signal[0, i]), label=f"{preset}, {1e3 * spacing:g} mm")
    for i, row in enumerate(panels[::-1]):
        row[0].plot(results.time, 1e3 * wall[:, i], "k--", linewidth=0.8, label="linear theory")
        row[1].plot(results.frames, 1e3 * mode[:, i], "k--", linewidth=0.8)
        row[0].set_ylabel(f"{NAMES[i]} [mm]")
        for panel in row:
            panel.grid(alpha=0.3)
    panels[0, 0].legend(fontsize="small")
    for panel, title in zip(panels[0], ("at the left wall", "by the liquids' centres"), strict=True):
        panel.set_title(title, fontsize="small", loc="left")
    for panel in panels[-1]:
        panel.set_xlabel("Time [s]")
