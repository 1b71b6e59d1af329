"""A jet that leaves the edge of a block: no suction on it, and no energy from nothing."""

import numpy as np
from scipy.integrate import trapezoid

TITLE = "Jet at the edge of a block"
SPACINGS = (0.02, 0.01, 0.005)
TARGETS = {"suction [%]": 10.0, "impulse on top [Pa s]": 30.0, "pull [N/m]": 1.0, "energy gained [%]": 0.5}
STRUCK = 0.4, 0.56
"""s, from when on the jet is at the block, and until the first of it may fall back."""


def column(job):
    """Pressure rho g h under the column at the start, Pa."""
    return 1000.0 * job.gravity * job.fluids[0].region.box[1][1]


def energy(results):
    """Kinetic and potential energy of the liquid in each frame, over that of the first: (frames,) float64."""
    found = []
    for time in results.frames:
        liquid = results.liquid(time)
        kinetic = 0.5 * np.einsum("ij,ij->i", liquid["velocity"], liquid["velocity"])
        found.append((kinetic + results.job.gravity * liquid["position"][:, 2]).sum())
    return np.array(found) / found[0]


def measure(results):
    """Greatest suction on top of the block over the column's pressure, its impulse, pull on the block, and energy."""
    time, top, pull = results.time, results.probe("P5"), results.probe("load.baffle1.Fx")
    struck = (time >= STRUCK[0]) & (time <= STRUCK[1])
    return {
        "suction [%]": 100.0 * max(-top[time <= STRUCK[1]].min(), 0.0) / column(results.job),
        "impulse on top [Pa s]": max(-trapezoid(top[struck], time[struck]), 0.0),
        "pull [N/m]": max(pull.max(), 0.0),
        "energy gained [%]": 100.0 * max(energy(results).max() - 1.0, 0.0),
        "P3, 0.45 to 0.7 s [Pa]": results.probe("P3")[(time > 0.45) & (time < 0.7)].mean(),
    }


def plot(figure, runs):
    """Pressures before and on the block, and the liquid's energy."""
    panels = figure.subplots(1, 3)
    for (_, preset, spacing), results in runs.items():
        label = f"{preset}, {1e3 * spacing:g} mm"
        for panel, name in zip(panels, ("P3", "P5"), strict=False):
            panel.plot(results.time, results.probe(name) / column(results.job), linewidth=0.8, label=label)
            panel.set_title(f"{name}, $p/(\\rho g H)$", fontsize="medium")
        panels[2].plot(results.frames, energy(results), linewidth=0.8, label=label)
    panels[2].set_title("Energy over that at the start", fontsize="medium")
    for panel in panels:
        panel.set_xlabel("Time [s]")
        panel.grid(alpha=0.3)
    panels[0].legend(fontsize="small")
