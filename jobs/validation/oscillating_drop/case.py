"""The second mode of a drop in a bath against linear theory, for density ratios of 1 to 1000."""

import numpy as np

from parmps.tank import place

TITLE = "Oscillating drop"
SPACINGS = (0.02, 0.01)
STRETCH = 0.07
"""Amplitude over the radius."""
LONGER = 0.75
"""Relative lengthening of the period over the squared amplitude; see README."""
VARIANTS = {f"ratio {ratio}": [f"fluids[1].density={1000 / ratio:g}"] for ratio in (1, 10, 1000)}
TARGETS = {"period [%]": 2.0}


def frequency(job):
    """Angular frequency of the second mode of small amplitude, rad/s."""
    r = job.fluids[0].region.disc.radius
    inner, outer = (fluid.density for fluid in job.fluids)
    q = (2.0 * r / job.tank.length) ** 4
    tension = job.interfaces[0].surface_tension
    return np.sqrt(6.0 * tension / ((inner + outer * (1.0 + q) / (1.0 - q)) * r**3))


def initial(job):
    """The round drop and its bath with the velocity of the second mode."""
    placement = place(job, "half")
    liquid = slice(0, placement.total_fluid)
    position, fluid = placement.position[liquid], placement.fluid[liquid]
    disc = job.fluids[0].region.disc
    x, z = position[:, 0] - disc.centre[0], position[:, 2] - disc.centre[1]
    angle, r = np.arctan2(z, x), np.hypot(x, z) / disc.radius
    speed = STRETCH * disc.radius * frequency(job)
    outwards, around = np.where(fluid == 0, r, r**-3.0), np.where(fluid == 0, -r, r**-3.0)
    radial, turning = speed * outwards * np.cos(2.0 * angle), speed * around * np.sin(2.0 * angle)
    velocity = np.zeros_like(position)
    velocity[:, 0] = radial * np.cos(angle) - turning * np.sin(angle)
    velocity[:, 2] = radial * np.sin(angle) + turning * np.cos(angle)
    return position, velocity, fluid


def stretch(results):
    """Amplitude of the second mode over the radius: (frames,), from int (x^2 - z^2) dV = pi R^3 a."""
    found = []
    for time in results.frames:
        liquid = results.liquid(time)
        at = liquid["position"][liquid["fluid"] == 0]
        at = at - at.mean(axis=0)
        found.append(np.mean(at[:, 0] ** 2 - at[:, 2] ** 2) / results.job.fluids[0].region.disc.radius ** 2)
    return np.array(found)


def zeros(time, signal):
    """Times of all zeros after the start, s."""
    at = np.flatnonzero(signal[1:-1] * signal[2:] < 0.0) + 1
    return time[at] - signal[at] * (time[at + 1] - time[at]) / (signal[at + 1] - signal[at])


def measure(results):
    """Mean period of the first one to two oscillations, and the loss of amplitude in half of one."""
    signal, time = stretch(results), results.frames
    at = zeros(time, signal)
    period = 2.0 * at[-1] / len(at) / (1.0 + LONGER * STRETCH**2)
    first, second = np.abs(signal[time < at[0]]).max(), np.abs(signal[(time > at[0]) & (time < at[1])]).max()
    return {
        "period [%]": 100.0 * (period * frequency(results.job) / (2.0 * np.pi) - 1.0),
        "first amplitude [%]": 100.0 * (first / STRETCH - 1.0),
        "loss in half a period [%]": 100.0 * (1.0 - second / first),
        "volume [%]": 100.0 * results.record["volume_drift"],
    }


def plot(figure, runs):
    """Stretch over time."""
    panel = figure.subplots()
    for (variant, preset, spacing), results in runs.items():
        periods = results.frames * frequency(results.job) / (2.0 * np.pi)
        panel.plot(periods, stretch(results) / STRETCH, label=f"{variant}, {preset}, {1e3 * spacing:g} mm")
    t = np.linspace(0.0, 2.0, 300)
    panel.plot(t, np.sin(2.0 * np.pi * t), "k--", linewidth=0.8, label="linear theory")
    panel.set_xlabel("Periods")
    panel.set_ylabel("Second mode over its amplitude")
    panel.legend(fontsize="small")
    panel.grid(alpha=0.3)
