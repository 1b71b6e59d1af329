"""Layers of liquid at rest: hydrostatic pressure, no motion, no mixing."""

import numpy as np
from results import rms

TITLE = "Layers at rest"
SPACINGS = (0.01,)
SHORT = ["time.end=10"]


def _layers(*densities):
    depth = (0.12, 0.13) if len(densities) == 2 else (0.08, 0.08, 0.09)
    names = ("lower", "middle", "upper") if len(densities) == 3 else ("lower", "upper")
    fluids = [
        f"{{name: {name}, depth: {d}, density: {rho}}}" for name, d, rho in zip(names, depth, densities, strict=True)
    ]
    return [f"fluids=[{', '.join(fluids)}]"]


VARIANTS = {
    "1.3": _layers(1300, 1000),
    "2": [*_layers(2000, 1000), *SHORT],
    "10": [*_layers(10000, 1000), *SHORT],
    "1000": [*_layers(1000, 1), *SHORT],
    "1.3 : 1 : 0.78": [*_layers(1300, 1000, 780), *SHORT],
}
TARGETS = {"pressure [%]": 0.5, "crossing [l0]": 1.0}


def hydrostatic(job, z):
    """Pressure at heights z, Pa."""
    pressure, top = np.zeros_like(z), 0.0
    for fluid in job.fluids:
        bottom, top = top, top + fluid.depth
        pressure += fluid.density * job.gravity * (top - np.clip(z, bottom, top))
    return pressure


def crossing(job, liquid):
    """How far the particle that went furthest is beyond its layer, in spacings."""
    tops = np.cumsum([fluid.depth for fluid in job.fluids])
    bottoms = np.concatenate([[-np.inf], tops[:-1]])
    tops[-1] = np.inf
    z, number = liquid["position"][:, 2], liquid["fluid"]
    return max(np.max(z - tops[number]), np.max(bottoms[number] - z)) / job.spacing


def state(results, time):
    """Errors at one time: rms pressure and velocity over those of the depth, and crossing."""
    job, liquid = results.job, results.liquid(time)
    floor = hydrostatic(job, np.zeros(1))[0]
    speed = np.sqrt(job.gravity * sum(fluid.depth for fluid in job.fluids))
    error = rms(liquid["pressure"] - hydrostatic(job, liquid["position"][:, 2])) / floor
    return error, np.sqrt(np.mean(np.sum(liquid["velocity"] ** 2, axis=1))) / speed, crossing(job, liquid)


def measure(results):
    """Worst over all frames, and rms speed in the first and the last fifth of the run."""
    states = np.array([state(results, t) for t in results.frames])
    fifth = len(states) // 5
    return {
        "pressure [%]": 100.0 * states[:, 0].max(),
        "crossing [l0]": states[:, 2].max(),
        "early speed [% of sqrt(gh)]": 100.0 * states[1 : fifth + 1, 1].mean(),
        "late speed [% of sqrt(gh)]": 100.0 * states[-fifth:, 1].mean(),
        "volume [%]": 100.0 * results.record["volume_drift"],
    }


def plot(figure, runs):
    """Pressure error and speed over time."""
    above, below = figure.subplots(2, 1, sharex=True)
    for (variant, preset, _), results in runs.items():
        states = np.array([state(results, t) for t in results.frames])
        above.plot(results.frames, 100.0 * states[:, 0], label=f"{variant}, {preset}")
        below.semilogy(results.frames[1:], 100.0 * states[1:, 1])
    above.set_ylabel("Pressure error [%]")
    below.set_ylabel("Rms speed [% of sqrt(gh)]")
    below.set_xlabel("Time [s]")
    above.legend(fontsize="small")
    for panel in (above, below):
        panel.grid(alpha=0.3)
