"""Growth of the instability of Rayleigh and Taylor against linear theory, without and with surface tension."""

import numpy as np

from parmps import waves
from parmps.tank import place

TITLE = "Rayleigh-Taylor growth"
SPACINGS = (0.01, 0.005)
START = 0.0008
"""m: the elevation cos(k x) that would by now have grown, and whose velocity the run starts with."""
TENSION = ["interfaces=[{between: [light, heavy], surface_tension: 25}]"]
VARIANTS = {"no tension": [], "with tension": TENSION}
TARGETS = {"rate [%]": 5.0}


def growth(job):
    """Wave number of the first mode, rad/m, rate, 1/s, and shape."""
    k = np.pi / job.tank.length
    omega2, shape = waves.modes(waves.layers_of(job), k)
    return k, float(np.sqrt(-omega2[-1])), shape[:, -1]


def initial(job):
    """The flat layers with the velocity of the growing wave."""
    placement = place(job, "half")
    liquid = slice(0, placement.total_fluid)
    position, fluid = placement.position[liquid], placement.fluid[liquid]
    k, rate, shape = growth(job)
    velocity = np.zeros_like(position)
    velocity[:, 0], velocity[:, 2] = waves.velocity(
        waves.layers_of(job), k, START * rate * shape, position[:, 0], position[:, 2], fluid
    )
    return position, velocity, fluid


def elevation(results):
    """First mode of the interface, from the centre of the lower liquid, m: (frames,)."""
    job = results.job
    k, length = np.pi / job.tank.length, job.tank.length
    volume = np.prod(job.tank.size) / len(results.liquid(0.0)["fluid"])
    found = []
    for time in results.frames:
        liquid = results.liquid(time)
        found.append(-0.5 * k * k * volume * (liquid["position"][liquid["fluid"] == 0, 0] - length / 2.0).sum())
    return np.array(found)


def measure(results):
    """Rate from the growth of START sinh(s t) between 1.5 and 8 times START, while it is linear."""
    _, rate, _ = growth(results.job)
    signal = elevation(results) / START
    part = (signal > 1.5) & (signal < 8.0) & (results.frames < results.frames[np.argmax(signal > 8.0) or -1])
    slope = np.polyfit(results.frames[part], np.arcsinh(signal[part]), 1)[0]
    return {"rate [%]": 100.0 * (slope / rate - 1.0), "volume [%]": 100.0 * results.record["volume_drift"]}


def plot(figure, runs):
    """Elevation over time."""
    panel = figure.subplots()
    for (variant, preset, spacing), results in runs.items():
        signal = np.abs(elevation(results)) / START
        panel.semilogy(results.frames[1:], signal[1:], label=f"{variant}, {preset}, {1e3 * spacing:g} mm")
        _, rate, _ = growth(results.job)
        panel.semilogy(results.frames[1:], np.sinh(rate * results.frames[1:]), "k--", linewidth=0.8)
    panel.set_xlabel("Time [s]")
    panel.set_ylabel("Elevation over that of the start")
    panel.set_ylim(0.05, 50.0)
    panel.grid(alpha=0.3)
    panel.legend(fontsize="small")
