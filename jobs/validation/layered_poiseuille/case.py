"""Two viscous layers in a long full tank that is turned ever faster, against the exact profile between plates."""

import numpy as np
from results import rms

TITLE = "Two viscous layers between plates"
SPACINGS = (0.005, 0.0025)
ACCELERATION = 2.0
"""rad/s2, of spin.csv."""
VARIANTS = {f"ratio {ratio}": [f"fluids[1].kinematic_viscosity={1e-3 * ratio}"] for ratio in (1, 10, 100)}
TARGETS = {"velocity [%]": 2.0}


def profile(z, height, viscosity):
    """Steady velocity along the plates, m/s, at heights z from the middle, where the layers meet.

    nu_i u'' = 2 a z + c, so u = (a z^3 / 3 + c z^2 / 2 + s z + b) / nu_i: b / nu_i, the speed at z = 0, and
    s, the stress there, are common to both layers. c, s and b / nu from no slip and no flux.
    """
    h = height / 2.0
    low, high = 1.0 / np.array(viscosity)
    matrix = [
        [0.5 * h * h * low, -h * low, 1.0],
        [0.5 * h * h * high, h * high, 1.0],
        [h**3 / 6.0 * (low + high), 0.5 * h * h * (high - low), 2.0 * h],
    ]
    cubic = ACCELERATION / 3.0
    sides = [cubic * h**3 * low, -cubic * h**3 * high, -cubic * h**4 / 4.0 * (high - low)]
    c, s, speed = np.linalg.solve(matrix, sides)
    return (cubic * z**3 + 0.5 * c * z * z + s * z) * np.where(z < 0.0, low, high) + speed


def middle(results):
    """Height from the middle, m, and velocity along the plates in the middle sixth of the tank at the end, m/s."""
    length, height = results.job.tank.size
    liquid = results.liquid(results.frames[-1])
    chosen = np.abs(liquid["position"][:, 0] - length / 2.0) < length / 12.0
    return liquid["position"][chosen, 2] - height / 2.0, liquid["velocity"][chosen, 0], liquid["fluid"][chosen]


def exact(job, z):
    """The exact profile of a job's liquids."""
    return profile(z, job.tank.height, [fluid.kinematic_viscosity for fluid in job.fluids])


def measure(results):
    """Rms error of the velocity over the rms of the exact one."""
    z, u, number = middle(results)
    wanted = exact(results.job, z)
    found = {"velocity [%]": 100.0 * rms(u - wanted) / rms(wanted)}
    for layer, fluid in enumerate(results.job.fluids):
        own = number == layer
        found[f"{fluid.name} [%]"] = 100.0 * rms((u - wanted)[own]) / rms(wanted[own])
    return found


def plot(figure, runs):
    """Profiles in the middle of the tank."""
    panels = figure.subplots(1, len(VARIANTS), sharey=True)
    for (variant, preset, spacing), results in runs.items():
        panel = panels[list(VARIANTS).index(variant)]
        z, u, _ = middle(results)
        panel.plot(u, z, ".", markersize=3, label=f"{preset}, {1e3 * spacing:g} mm")
        z = np.linspace(-0.5, 0.5, 201) * results.job.tank.height
        panel.plot(exact(results.job, z), z, color="black", linewidth=0.8)
        panel.set_title(variant, fontsize="small", loc="left")
    for panel in panels:
        panel.set_xlabel("Velocity [m/s]")
        panel.grid(alpha=0.3)
    panels[0].set_ylabel("Height from the middle [m]")
    panels[0].legend(fontsize="small")
