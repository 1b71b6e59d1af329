"""Standing waves of layered liquids against the dispersion relation of the layers."""

import numpy as np
from layered_waves import layer_modes

from parmps.tank import standing_wave

TITLE = "Interfacial standing waves"
SPACINGS = (0.02, 0.01)
PERIODS = 3.2


def _two(density, end):
    return [f"fluids[0].density={density}", f"time.end={end}"]


TANK = [
    "gravity=9.81",
    "tank={size: [1.08, 0.9]}",
    "fluids=[{name: DCM, depth: 0.15, density: 1300, kinematic_viscosity: 0},"
    " {name: water, depth: 0.15, density: 1000, kinematic_viscosity: 0},"
    " {name: cyclohexane, depth: 0.38, density: 780, kinematic_viscosity: 0}]",
]
VARIANTS = {
    "ratio 1.1": _two(1100, 20.4),
    "ratio 1.3": _two(1300, 12.6),
    "ratio 3": _two(3000, 6.6),
    "tank, 5.204 rad/s": [*TANK, "initial.branch=1", "time.end=4.2"],
    "tank, 1.838 rad/s": [*TANK, "initial.branch=2", "time.end=11.4"],
    "tank, 1.050 rad/s": [*TANK, "initial.branch=3", "time.end=19.2"],
}
TARGETS = {"period [%]": 1.0, "loss in 3 periods [%]": 15.0}


def crossings(time, signal):
    """Times of all zeros, from lines between samples, s."""
    at = np.flatnonzero(signal[:-1] * signal[1:] < 0.0)
    return time[at] - signal[at] * (time[at + 1] - time[at]) / (signal[at + 1] - signal[at])


def measure(results):
    """Mean period against theory, and the greatest elevation of the last two of six half periods.

    A wave that stops swinging before has neither.
    """
    job, time = results.job, results.frames
    _, omega, shape = standing_wave(job)
    signal = layer_modes(results)[:, np.abs(shape).argmax()]
    zeros = np.concatenate([[0.0], crossings(time[1:], signal[1:])])
    found = {"volume [%]": 100.0 * results.record["volume_drift"], "strayed": strayed(results)}
    if len(zeros) < 7:
        return found
    period = (zeros[6] - zeros[0]) / 3.0
    late = np.abs(signal[(time >= zeros[4]) & (time <= zeros[6])]).max()
    return {
        "period [%]": 100.0 * (period * omega / (2.0 * np.pi) - 1.0),
        "loss in 3 periods [%]": 100.0 * (1.0 - late / abs(job.initial.amplitude)),
        **found,
    }


def strayed(results):
    """Particles further than one spacing beyond where theory has the interface at the end."""
    job = results.job
    k, omega, shape = standing_wave(job)
    liquid = results.liquid(results.frames[-1])
    fitted = layer_modes(results)[-1]
    tops = np.cumsum([fluid.depth for fluid in job.fluids])
    x, z, number = liquid["position"][:, 0], liquid["position"][:, 2], liquid["fluid"]
    height = tops + fitted * np.cos(k * x[:, None])
    height[:, -1] = np.inf
    own = np.arange(len(x))
    above = z > height[own, number] + job.spacing
    below = (number > 0) & (z < height[own, np.maximum(number - 1, 0)] - job.spacing)
    return int(np.count_nonzero(above | below))


def plot(figure, runs):
    """Elevation of the boundary that moves most, over periods."""
    variants = list(dict.fromkeys(variant for variant, _, _ in runs))
    panels = figure.subplots(len(variants), 1, sharex=True, squeeze=False)[:, 0]
    for (variant, preset, spacing), results in runs.items():
        panel = panels[variants.index(variant)]
        _, omega, shape = standing_wave(results.job)
        periods = results.frames * omega / (2.0 * np.pi)
        signal = layer_modes(results)[:, np.abs(shape).argmax()] / results.job.initial.amplitude
        panel.plot(periods, signal, linewidth=1.0, label=f"{preset}, {1e3 * spacing:g} mm")
        panel.set_title(variant, fontsize="small", loc="left")
    for panel in panels:
        t = np.linspace(0.0, PERIODS, 300)
        panel.plot(t, np.sin(2.0 * np.pi * t), "k--", linewidth=0.8)
        panel.grid(alpha=0.3)
        panel.legend(fontsize="x-small", loc="right")
    panels[-1].set_xlabel("Periods")
