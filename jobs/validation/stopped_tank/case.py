"""Waves in a tank with a baffle that has stopped rolling: nothing is left that could feed them."""

import numpy as np
from results import rms

TITLE = "A rolling tank that stops"
SPACINGS = (0.02, 0.01)
STILL = 12.0
"""s; the tank stands still from 11.5 s on."""
WINDOW = 4.0
"""s; three to nine periods of the waves that are seen."""
TARGETS = {"growth [%]": 5.0}


def modes(results):
    """Amplitudes of the modes cos(n pi x / L) of the elevation, n = 1 to 13: (samples, 13) float64, m."""
    eta = results.probes("eta")
    count = eta.shape[1]
    x = (np.arange(count) + 0.5) / count
    shapes = np.cos(np.pi * x[:, None] * np.arange(1, count // 2 + 1))
    return 2.0 / count * np.nan_to_num(eta - np.nanmean(eta, axis=1, keepdims=True)) @ shapes


def wave(results, begin):
    """Amplitude of all modes together in the window that begins at a time, m."""
    chosen = (results.time >= begin) & (results.time < begin + WINDOW)
    found = modes(results)[chosen]
    return np.sqrt(2.0) * rms(np.linalg.norm(found - found.mean(axis=0), axis=1))


def measure(results):
    """Waves right after the stop and at the end, and by how much they are higher at the end, if they are."""
    early, late = wave(results, STILL), wave(results, results.time[-1] - WINDOW)
    return {
        "growth [%]": 100.0 * max(late / early - 1.0, 0.0),
        "early [mm]": 1e3 * early,
        "late [mm]": 1e3 * late,
        "volume [%]": 100.0 * results.record["volume_drift"],
    }


def plot(figure, runs):
    """Amplitude of all modes by time."""
    panel = figure.subplots()
    for (_, preset, spacing), results in runs.items():
        begins = np.arange(0.0, results.time[-1] - WINDOW + 0.01, 1.0)
        values = [1e3 * wave(results, begin) for begin in begins]
        panel.plot(begins + WINDOW / 2.0, values, label=f"{preset}, {1e3 * spacing:g} mm")
    panel.axvline(11.5, color="black", linewidth=0.8)
    panel.set_yscale("log")
    panel.set_xlabel("Time [s]")
    panel.set_ylabel("Waves [mm]")
    panel.grid(alpha=0.3, which="both")
    panel.legend(fontsize="small")
