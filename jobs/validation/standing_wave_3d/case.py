"""A free standing wave along both sides of a tank against potential flow."""

import functools

import numpy as np
from potential import PotentialFlow
from results import rms

from parmps.tank import FLUID, place

TITLE = "Standing wave in three dimensions"
SPACINGS = (0.0375, 0.025)
AMPLITUDE = 0.02
"""m."""
PERIODS = 5
TARGETS = {"amplitude [%]": (8.0, 4.0), "period [%]": (0.8, 0.4), "volume [%]": 0.2}


def wave(job):
    """Wave number k, rad/m, of the mode (1, 1), and its angular frequency, rad/s."""
    length, width, _ = job.tank.size
    k = np.pi * np.hypot(1.0 / length, 1.0 / width)
    return k, np.sqrt(job.gravity * k * np.tanh(k * job.fluids[0].depth))


def initial(job):
    """A flat surface and the velocity of the linear wave at that instant, in the lattice of the job."""
    placement = place(job, job.scheme.wall)
    position = placement.position[placement.kind == FLUID]
    k, omega = wave(job)
    (length, width, _), (x, y, z) = job.tank.size, position.T
    kx, ky = np.pi / length, np.pi / width
    scale = AMPLITUDE * omega / (k * np.sinh(k * job.fluids[0].depth))
    velocity = scale * np.stack(
        [
            -kx * np.sin(kx * x) * np.cos(ky * y) * np.cosh(k * z),
            -ky * np.cos(kx * x) * np.sin(ky * y) * np.cosh(k * z),
            k * np.cos(kx * x) * np.cos(ky * y) * np.sinh(k * z),
        ],
        axis=1,
    )
    return position, velocity


@functools.lru_cache
def reference(job, end, samples):
    """Mode (1, 1) of the elevation in potential flow with the same start, m: (samples,) float64."""
    length, width, _ = job.tank.size
    flow = PotentialFlow(length, job.fluids[0].depth, job.gravity, order=4, modes=8, width=width)
    k, omega = wave(job)
    start = AMPLITUDE * omega / (k * np.tanh(k * job.fluids[0].depth))
    flow.potential = start * np.cos(np.pi * flow.x / length) * np.cos(np.pi * flow.y / width)
    return flow.run(np.linspace(0.0, end, samples), 0.02)[:, 1, 1]


def crossings(time, signal):
    """Times at which a signal rises through zero, from lines between samples, s; the start is one."""
    at = np.flatnonzero((signal[1:-1] < 0.0) & (signal[2:] >= 0.0)) + 1
    return np.append(0.0, time[at] - signal[at] * (time[at + 1] - time[at]) / (signal[at + 1] - signal[at]))


def measure(results):
    """Worst amplitude over the periods and mean period over those of potential flow, rms of the history, volume.

    The amplitude is the rms of a period times the root of 2.
    """
    time, signal = results.frames, results.modes([(1, 1)])[:, 0]
    flow = reference(results.job, float(time[-1]), len(time))
    _, omega = wave(results.job)
    number = np.minimum((time * omega / (2.0 * np.pi)).astype(int), PERIODS)
    error = np.array([rms(signal[number == n]) / rms(flow[number == n]) - 1.0 for n in range(PERIODS)])
    mine, theirs = crossings(time, signal), crossings(time, flow)
    count = min(len(mine), len(theirs)) - 1
    return {
        "amplitude [%]": 100.0 * error[np.abs(error).argmax()],
        "last amplitude [%]": 100.0 * error[-1],
        "period [%]": 100.0 * (mine[count] / theirs[count] - 1.0),
        "history [%]": 100.0 * rms(signal - flow) / rms(flow),
        "volume [%]": 100.0 * results.record["volume_drift"],
    }


def plot(figure, runs):
    """Mode (1, 1) over time, and its difference from potential flow."""
    above, below = figure.subplots(2, 1, sharex=True)
    for number, ((_, preset, spacing), results) in enumerate(runs.items()):
        time, signal = results.frames, results.modes([(1, 1)])[:, 0]
        flow = reference(results.job, float(time[-1]), len(time))
        if number == 0:
            above.plot(time, 1e3 * flow, color="black", linewidth=2.0, alpha=0.5, label="potential flow")
        above.plot(time, 1e3 * signal, linewidth=1.0, label=f"{preset}, {1e3 * spacing:g} mm")
        below.plot(time, 1e3 * (signal - flow), linewidth=1.0)
    above.set_ylabel("Mode (1, 1) [mm]")
    below.set_ylabel("Difference [mm]")
    below.set_xlabel("Time [s]")
    above.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    for panel in (above, below):
        panel.grid(alpha=0.3)
