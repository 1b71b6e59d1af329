"""The two 2D cases of Zhang, Wan & Hino against linear theory and nonlinear potential flow."""

import functools

import numpy as np
from potential import PotentialFlow, surge_response
from results import rms

TITLE = "Cases 1 and 2 of Zhang, Wan & Hino"
SPACINGS = (0.008, 0.004)
VARIANTS = {
    "case 1": [],
    "case 2": [
        "tank={size: [0.57, 0.5], baffles: [{x: 0.285, bottom: 0.0, top: 0.15, thickness: 0.006}]}",
        "fluids[0].depth=0.18",
        "motion=[{kind: surge, amplitude: 0.1, omega: 3.53}]",
        "probes[1].at=[0.285]",
        "probes[2].at=[0.56]",
    ],
}
LINEAR, SMOOTH = 1.0, 2.5
"""s, until when the wave is low enough for linear theory, and for potential flow without breaking."""


@functools.lru_cache
def potential(job, end, samples):
    """Elevation at both walls in nonlinear potential flow, m: (samples, 2) float64, NaN from where it breaks."""
    surge, length = job.motion[0], job.tank.length
    flow = PotentialFlow(length, job.fluids[0].depth, job.gravity, order=3, modes=12)
    flow.potential = -surge.amplitude * surge.omega * (flow.x - length / 2.0)
    times = np.linspace(0.0, end, samples)
    force = surge.amplitude * surge.omega**2
    with np.errstate(all="ignore"):
        modes = flow.run(times, 0.01, lambda t: -force * np.sin(surge.omega * t))
    eta = np.stack([flow.elevation(modes, job.probes[i].at[0]) for i in (0, 2)], axis=1)
    return np.where(np.abs(eta) < job.fluids[0].depth, eta, np.nan)


def walls(results):
    """Elevation above the still level at both walls, m: (samples, 2) float64."""
    return np.stack([results.probe("left"), results.probe("right")], axis=1) - results.job.fluids[0].depth


def measure(results):
    """Case 1: rms error of wall elevation and pressure over the rms of theory; both: range of the left elevation."""
    job, time, eta = results.job, results.time, walls(results)
    found = {"left, lowest [mm]": 1e3 * eta[:, 0].min(), "left, highest [mm]": 1e3 * eta[:, 0].max()}
    found["volume [%]"] = 100.0 * results.record["volume_drift"]
    if job.tank.baffles:
        return found
    surge = job.motion[0]
    scene = (job.tank.length, job.fluids[0].depth, job.gravity, surge.amplitude, surge.omega)
    theory = np.stack([surge_response(job.probes[i].at[0], time, *scene) for i in (0, 2)], axis=1)
    early, smooth = time <= LINEAR, time <= SMOOTH
    flow = potential(job, float(time[-1]), len(time))
    smooth &= np.isfinite(flow).all(axis=1)
    return {
        "linear, 1 s [%]": 100.0 * rms((eta - theory)[early]) / rms(theory[early]),
        "its own, 1 s [%]": 100.0 * rms((flow - theory)[early]) / rms(theory[early]),
        "potential, 2.5 s [%]": 100.0 * rms((eta - flow)[smooth]) / rms(flow[smooth]),
        **found,
    }


def plot(figure, runs):
    """Elevation at the left wall, and in case 1 the pressure."""
    panels = figure.subplots(3, 1, sharex=True)
    drawn = False
    for (variant, preset, spacing), results in runs.items():
        label = f"{preset}, {1e3 * spacing:g} mm"
        panel = panels[0 if variant == "case 1" else 2]
        if variant == "case 1" and not drawn:
            flow = potential(results.job, float(results.time[-1]), len(results.time))
            panel.plot(results.time, flow[:, 0], color="black", linewidth=2.0, alpha=0.5, label="potential flow")
            drawn = True
        panel.plot(results.time, walls(results)[:, 0], linewidth=0.9, label=label)
        if variant == "case 1":
            panels[1].plot(results.time, 1e-3 * results.probe("P1"), linewidth=0.7, label=label)
    for panel, text in zip(panels, ("Case 1: left wall [m]", "Case 1: P1 [kPa]", "Case 2: left wall [m]"), strict=True):
        panel.set_ylabel(text)
        panel.grid(alpha=0.3)
    panels[0].legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    panels[-1].set_xlabel("Time [s]")
