"""Surge sloshing near resonance against the wave gauge of Faltinsen et al. 2000."""

import functools
from pathlib import Path

import numpy as np
from potential import PotentialFlow
from results import read_reference, rms

TITLE = "Faltinsen et al. 2000"
SPACINGS = (0.02, 0.01)
RECORD = read_reference(Path(__file__).with_name("reference.csv"))
TARGETS = {"shifted, 5 s [mm]": 10.0, "shifted, 9.9 s [mm]": 15.0, "late crest [%]": 15.0}
SHIFTS = np.arange(-0.05, 0.1501, 0.002)
LATE = (8.8, 9.5)
"""s; the crest of 0.141 m at 9.16 s is the highest in between."""


def errors(time, elevation, end, shifts):
    """Rms difference from the record until an end, with the computation moved later by each shift, m."""
    record = RECORD[RECORD[:, 0] <= end]
    return np.array([rms(np.interp(record[:, 0] - s, time, elevation) - record[:, 1]) for s in shifts])


@functools.lru_cache
def potential(job, end, samples):
    """Elevation at the gauge in nonlinear potential flow with the same motion, m: (samples,) float64."""
    surge = job.motion[0]
    flow = PotentialFlow(job.tank.length, job.fluids[0].depth, job.gravity, order=3, modes=12)
    force, phase = surge.amplitude * surge.omega**2, np.radians(surge.phase_deg)
    times = np.linspace(0.0, end, samples)
    modes = flow.run(times, 0.01, lambda t: -force * np.sin(surge.omega * t + phase))
    return flow.elevation(modes, job.probes[0].at[0])


def measure(results):
    """Differences as they are and with the best single shift of time, and the crest at 9.16 s."""
    time, eta = results.time, results.probe("gauge") - results.job.fluids[0].depth
    flow = potential(results.job, float(time[-1]), len(time))
    found = {}
    for end in (5.0, 9.9):
        found[f"potential, {end:g} s [mm]"] = 1e3 * rms((eta - flow)[time <= end])
        shifted = errors(time, eta, end, SHIFTS)
        found[f"raw, {end:g} s [mm]"] = 1e3 * errors(time, eta, end, [0.0])[0]
        found[f"shifted, {end:g} s [mm]"] = 1e3 * shifted.min()
        found[f"shift, {end:g} s [ms]"] = 1e3 * SHIFTS[shifted.argmin()]
    late = (RECORD[:, 0] > LATE[0]) & (RECORD[:, 0] < LATE[1])
    crest = RECORD[late, 1].max()
    found["late crest [%]"] = 100.0 * (eta[(time > LATE[0]) & (time < LATE[1])].max() / crest - 1.0)
    found["volume [%]"] = 100.0 * results.record["volume_drift"]
    found["CPU s per s"] = results.record["cpu_seconds"] / results.record["simulated_seconds"]
    return found


def plot(figure, runs):
    """Elevation at the gauge."""
    panels = figure.subplots(len(SPACINGS), 1, sharex=True)
    for panel, size in zip(panels, SPACINGS, strict=True):
        panel.plot(*RECORD.T, color="black", linewidth=2.0, alpha=0.5, label="experiment")
        mine = {key: results for key, results in runs.items() if key[2] == size}
        for results in list(mine.values())[:1]:
            flow = potential(results.job, float(results.time[-1]), len(results.time))
            panel.plot(results.time, flow, "--", color="black", linewidth=0.8, label="potential flow")
        for (_, preset, _), results in mine.items():
            eta = results.probe("gauge") - results.job.fluids[0].depth
            panel.plot(results.time, eta, linewidth=1.0, label=preset)
        panel.set_title(f"{1e3 * size:g} mm")
        panel.set_ylabel("Elevation [m]")
        panel.grid(alpha=0.3)
        panel.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    panels[-1].set_xlabel("Time [s]")
