"""Small surge sloshing from rest against the linear solution and against nonlinear potential flow."""

import functools

import numpy as np
from potential import PotentialFlow, surge_response
from results import rms

TITLE = "Linear surge sloshing from rest"
SPACINGS = (0.01, 0.005)
# first mode: sqrt(g k tanh(k h)) = 5.3138 rad/s; amplitudes such that the wave is some 20 mm high at each ratio
VARIANTS = {
    "0.6": ["motion[0].amplitude=0.01", "motion[0].omega=3.1883"],
    "0.9": ["motion[0].amplitude=0.002", "motion[0].omega=4.7824"],
    "1.2": ["motion[0].amplitude=0.003", "motion[0].omega=6.3765"],
}
TARGETS = {"linear [%]": 3.0}


def linear(job, x, time):
    """Elevation by linear theory, m."""
    surge = job.motion[0]
    scene = (job.tank.length, job.fluids[0].depth, job.gravity, surge.amplitude, surge.omega)
    return surge_response(x, time, *scene)


def linear_mode(job, time):
    """First mode of the elevation by linear theory, with the small shares of others that the centre has, m."""
    total = 0.0
    for n in range(1, 40, 2):
        surge = job.motion[0]
        scene = (job.tank.length, job.fluids[0].depth, job.gravity, surge.amplitude, surge.omega)
        upto, before = (surge_response(0.0, time, *scene, modes=m) for m in (n, n - 2))
        total = total + (upto - before) / n**2
    return total


@functools.lru_cache
def nonlinear(job, end, samples):
    """Elevation at the gauges in nonlinear potential flow, m: (samples, gauges) float64."""
    surge, length = job.motion[0], job.tank.length
    flow = PotentialFlow(length, job.fluids[0].depth, job.gravity, order=4, modes=32)
    omega = surge.omega
    flow.potential = -surge.amplitude * omega * (flow.x - length / 2.0)
    modes = flow.run(np.linspace(0.0, end, samples), 0.01, lambda t: -surge.amplitude * omega**2 * np.sin(omega * t))
    return np.stack([flow.elevation(modes, probe.at[0]) for probe in job.probes], axis=1)


def measure(results):
    """Rms errors over the rms of the reference: both walls, 0.1 m from them, and the centre of the liquid."""
    job, time = results.job, results.time
    eta = np.stack([results.probe(probe.name) for probe in job.probes], axis=1) - job.fluids[0].depth
    theory = np.stack([linear(job, probe.at[0], time) for probe in job.probes], axis=1)
    flow = nonlinear(job, float(time[-1]), len(time))
    mode = linear_mode(job, results.frames)
    return {
        "linear [%]": 100.0 * rms((eta - theory)[:, :2]) / rms(theory[:, :2]),
        "its own [%]": 100.0 * rms((flow - theory)[:, :2]) / rms(theory[:, :2]),
        "potential [%]": 100.0 * rms((eta - flow)[:, :2]) / rms(flow[:, :2]),
        "0.1 m inside [%]": 100.0 * rms((eta - flow)[:, 2:]) / rms(flow[:, 2:]),
        "centre [%]": 100.0 * rms(results.first_mode() - mode) / rms(mode),
        "mean at walls [mm]": 1e3 * eta[:, :2].mean(),
        "mean inside [mm]": 1e3 * eta[:, 2:].mean(),
        "volume [%]": 100.0 * results.record["volume_drift"],
    }


def plot(figure, runs):
    """Elevation at the left wall by ratio."""
    panels = figure.subplots(len(VARIANTS), 1, sharex=True)
    for panel, variant in zip(panels, VARIANTS, strict=True):
        wanted = None
        for (name, preset, spacing), results in runs.items():
            if name != variant:
                continue
            if wanted is None:
                wanted = linear(results.job, results.job.probes[0].at[0], results.time)
                panel.plot(results.time, 1e3 * wanted, color="black", linewidth=2.0, alpha=0.5, label="linear theory")
            eta = results.probe("left") - results.job.fluids[0].depth
            panel.plot(results.time, 1e3 * eta, linewidth=1.0, label=f"{preset}, {1e3 * spacing:g} mm")
        panel.set_ylabel(f"Left wall [mm]\nratio {variant}")
        panel.grid(alpha=0.3)
    panels[0].legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    panels[-1].set_xlabel("Time [s]")
