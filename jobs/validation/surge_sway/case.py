"""Small sloshing in both horizontal modes at once, from rest, against linear theory and potential flow."""

import functools

import numpy as np
from potential import PotentialFlow, surge_response
from results import rms

TITLE = "Linear sloshing in both horizontal modes"
SPACINGS = (0.0375, 0.025)
MODES = {"along": (1, 0), "across": (0, 1)}
TARGETS = {f"{name} [%]": 6.0 for name in MODES}


def linear(job, side, time):
    """First mode along a side, 0 or 1, by linear theory, which knows no coupling of the two: (n,) float64, m."""
    motion = job.motion[side]
    scene = (job.tank.size[side], job.fluids[0].depth, job.gravity, motion.amplitude, motion.omega)
    return surge_response(0.0, time, *scene, modes=1)


@functools.lru_cache
def nonlinear(job, end, samples):
    """The first modes along both sides in nonlinear potential flow: (samples, 2) float64, m."""
    (length, width, _), motion = job.tank.size, job.motion
    flow = PotentialFlow(length, job.fluids[0].depth, job.gravity, order=3, modes=8, width=width)
    speed, omega = (np.array([getattr(m, name) for m in motion]) for name in ("amplitude", "omega"))
    flow.potential = -speed[0] * omega[0] * (flow.x - length / 2.0) - speed[1] * omega[1] * (flow.y - width / 2.0)
    modes = flow.run(np.linspace(0.0, end, samples), 0.02, lambda t: -speed * omega**2 * np.sin(omega * t))
    return np.stack([modes[:, m, n] for m, n in MODES.values()], axis=1)


def measure(results):
    """Rms error of both modes over the rms of linear theory, and of nonlinear potential flow."""
    job, time = results.job, results.frames
    signal, flow = results.modes(MODES.values()), nonlinear(job, float(time[-1]), len(time))
    found = {}
    for side, name in enumerate(MODES):
        theory = linear(job, side, time)
        found[f"{name} [%]"] = 100.0 * rms(signal[:, side] - theory) / rms(theory)
        found[f"{name}, potential [%]"] = 100.0 * rms(signal[:, side] - flow[:, side]) / rms(flow[:, side])
        found[f"{name}, its own [%]"] = 100.0 * rms(flow[:, side] - theory) / rms(theory)
    found["volume [%]"] = 100.0 * results.record["volume_drift"]
    return found


def plot(figure, runs):
    """Both modes over time."""
    panels = figure.subplots(2, 1, sharex=True)
    for side, (panel, name) in enumerate(zip(panels, MODES, strict=True)):
        for number, ((_, preset, spacing), results) in enumerate(runs.items()):
            time = results.frames
            if number == 0:
                theory = linear(results.job, side, time)
                panel.plot(time, 1e3 * theory, color="black", linewidth=2.0, alpha=0.5, label="linear theory")
            signal = results.modes(MODES.values())[:, side]
            panel.plot(time, 1e3 * signal, linewidth=1.0, label=f"{preset}, {1e3 * spacing:g} mm")
        panel.set_ylabel(f"First mode {name} [mm]")
        panel.grid(alpha=0.3)
    panels[0].legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    panels[1].set_xlabel("Time [s]")
