"""Viscous flow in a long full tank that is turned ever faster, against the exact solution between plates."""

import numpy as np
from results import rms

TITLE = "Viscous flow between plates (spin-up)"
SPACINGS = (0.004, 0.002)
ACCELERATION = 6.0
"""rad/s2, of spin.csv."""
TARGETS = {"late [%]": 1.0, "early [%]": 1.0}


def profile(z, time, height, viscosity):
    """Velocity along the plates, m/s, at heights z from the middle.

    With constant angular acceleration a the vorticity source is 2 a: u' = 2 a z + nu u_zz without net flux (a
    positive turn takes the right end down, so that the upper half of the liquid stays behind, to the left). From
    rest: u = -(a / 3 nu) z (h^2/4 - z^2) less the series of its sines, which decay with nu (2 pi n / h)^2.
    """
    n = np.arange(1, 40)[:, None]
    k = 2.0 * np.pi * n / height
    # z (h^2/4 - z^2) = sum b_n sin(k z), b_n = -12 (-1)^n / (k^3)
    series = -12.0 * (-1.0) ** n / k**3 * np.sin(k * z) * -np.expm1(-viscosity * k**2 * time)
    return -ACCELERATION / (3.0 * viscosity) * series.sum(axis=0)


def middle(results, time):
    """Height from the middle, m, and velocity along the plates of the liquid in the middle sixth of the tank, m/s."""
    length, height = results.job.tank.size
    liquid = results.liquid(time)
    chosen = np.abs(liquid["position"][:, 0] - length / 2.0) < length / 12.0
    return liquid["position"][chosen, 2] - height / 2.0, liquid["velocity"][chosen, 0]


def measure(results):
    """Rms error of the velocity over the rms of the exact one, while it grows and when it is nearly steady."""
    height, viscosity = results.job.tank.height, results.job.fluids[0].kinematic_viscosity
    found = {}
    for name, time in (("early", 0.1), ("late", 1.0)):
        z, u = middle(results, time)
        exact = profile(z, time, height, viscosity)
        found[f"{name} [%]"] = 100.0 * rms(u - exact) / rms(exact)
        found[f"{name} size [%]"] = 100.0 * (u @ exact / (exact @ exact) - 1.0)
    return found


def plot(figure, runs):
    """Profiles in the middle of the tank."""
    panels = figure.subplots(1, 2, sharey=True)
    for panel, time in zip(panels, (0.1, 1.0), strict=True):
        for (_, preset, spacing), results in runs.items():
            z, u = middle(results, time)
            panel.plot(u, z, ".", markersize=3, label=f"{preset}, {1e3 * spacing:g} mm")
        height, viscosity = results.job.tank.height, results.job.fluids[0].kinematic_viscosity
        z = np.linspace(-height / 2.0, height / 2.0, 101)
        panel.plot(profile(z, time, height, viscosity), z, color="black", label="exact")
        panel.set_title(f"t = {time:g} s")
        panel.set_xlabel("Velocity [m/s]")
        panel.grid(alpha=0.3)
    panels[0].set_ylabel("Height from the middle [m]")
    panels[0].legend(fontsize="small")
