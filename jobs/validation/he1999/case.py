"""Bubble and spike of the instability of Rayleigh and Taylor against He, Chen & Zhang (1999)."""

from pathlib import Path

import numpy as np
from results import read_reference, rms

from parmps.tank import place

TITLE = "Rayleigh-Taylor, He et al. 1999"
SPACINGS = (0.005, 0.0025)
TARGETS = {"bubble [%]": 5.0, "spike [%]": 5.0}
WAVES = 6
"""In the tank's length."""
BESIDE = (WAVES / 2 - 0.5, WAVES / 2 + 0.5)
"""Where the spikes beside the middle are, in waves."""
REFERENCE = Path(__file__).parent / "he1999.csv"


def initial(job):
    """Liquids at rest below and above the wave."""
    placement = place(job, "half")
    position = placement.position[: placement.total_fluid]
    width = job.tank.length / WAVES
    wave = 2.0 * width + 0.1 * width * np.cos(2.0 * np.pi * position[:, 0] / width)
    return position, np.zeros_like(position), (position[:, 2] > wave).astype(np.int8)


def heights(results):
    """Bubble and spike over the tank's height: (frames, 2)."""
    job = results.job
    width, half = job.tank.length / WAVES, 0.5 * job.spacing
    found = []
    for time in results.frames:
        liquid = results.liquid(time)
        x, z, number = liquid["position"][:, 0], liquid["position"][:, 2], liquid["fluid"]
        bubble = z[(number == 0) & (np.abs(x - 0.5 * WAVES * width) < width / 8.0)].max() + half
        spikes = [z[(number == 1) & (np.abs(x - n * width) < width / 8.0)].min() - half for n in BESIDE]
        found.append([bubble, np.mean(spikes)])
    return np.array(found) / job.tank.height


def scaled_time(results):
    """Time over sqrt(W / g) of the frames."""
    return results.frames / np.sqrt(results.job.tank.length / WAVES / results.job.gravity)


def measure(results):
    """Rms difference from the paper over the way that each goes in it."""
    time, found, paper = scaled_time(results), heights(results), read_reference(REFERENCE)
    errors = {}
    for column, name in enumerate(("bubble", "spike")):
        wanted = paper[:, column + 1]
        error = rms(np.interp(paper[:, 0], time, found[:, column]) - wanted)
        errors[f"{name} [%]"] = 100.0 * error / abs(wanted[-1] - wanted[0])
    errors["volume [%]"] = 100.0 * results.record["volume_drift"]
    return errors


def plot(figure, runs):
    """Heights over time, and the liquids at the end of one run."""
    left, right = figure.subplots(1, 2, width_ratios=(2.0, 1.0))
    for (_, preset, spacing), results in runs.items():
        for column, line in enumerate(("-", "--")):
            label = f"{('bubble', 'spike')[column]}, {preset}, {1e3 * spacing:g} mm"
            left.plot(scaled_time(results), heights(results)[:, column], line, label=label)
    paper = read_reference(REFERENCE)
    left.plot(paper[:, 0], paper[:, 1:], "k.", markersize=4)
    left.set_xlabel("Time over sqrt(W / g)")
    left.set_ylabel("Height over 4 W")
    left.legend(fontsize="small")
    left.grid(alpha=0.3)
    liquid = results.liquid(results.frames[-1])
    for number, colour in enumerate(("#E69F00", "#0072B2")):
        at = liquid["position"][liquid["fluid"] == number]
        right.plot(at[:, 0], at[:, 2], ".", markersize=1.5, color=colour)
    right.set_aspect("equal")
