"""A disc that is stretched into an ellipse, against the exact solution."""

import numpy as np
from results import rms
from scipy.integrate import solve_ivp

from parmps.tank import place

TITLE = "Stretching drop"
SPACINGS = (0.025, 0.0125)
RADIUS, RATE = 0.5, 1.0
"""m and 1/s."""
CENTRE = np.array([1.5, 0.0, 1.5])
TARGETS = {"energy [%]": 2.0, "length [%]": 1.0}


def initial(job):
    """The particles of the job with the velocity (-A x, A z)."""
    placement = place(job, "half")
    position = placement.position[: placement.total_fluid]
    return position, RATE * (position - CENTRE) * [-1.0, 0.0, 1.0]


def exact(time):
    """Half axes along x and z, m, strain rate A, 1/s, and the pressure in the middle over the density, m2/s2.

    With the velocity (-A x, A z) and the pressure p0 (1 - x^2/a^2 - z^2/b^2), the momentum equation gives
    A' = A^2 (a^2 - b^2) / (a^2 + b^2), p0 = rho A^2 a^2 b^2 / (a^2 + b^2), and a' = -A a, a b = R^2
    (Monaghan 1994, J. Comput. Phys. 110:399).
    """

    def rates(_, state):
        a, strain = state
        b = RADIUS**2 / a
        return [-strain * a, strain**2 * (a * a - b * b) / (a * a + b * b)]

    a, strain = solve_ivp(rates, (0.0, max(time, 1e-9)), [RADIUS, RATE], rtol=1e-10, atol=1e-12).y[:, -1]
    b = RADIUS**2 / a
    return a, b, strain, strain**2 * (a * b) ** 2 / (a * a + b * b)


def axes(results, time):
    """Half axes from the second moments of the particles, m: those of an ellipse are a^2/4 and b^2/4."""
    position = results.liquid(time)["position"]
    return 2.0 * np.std(position[:, [0, 2]], axis=0)


def measure(results):
    """Length of the ellipse, its energy and pressure at the end, and the drift of its area."""
    time = results.frames[-1]
    a, b, strain, pressure = exact(time)
    liquid, start = results.liquid(time), results.liquid(0.0)
    offset = liquid["position"] - CENTRE
    wanted = offset * strain * [-1.0, 0.0, 1.0]
    across, along = axes(results, time)
    # the particles of the start do not fill a disc exactly
    first = axes(results, 0.0)
    inside = (offset[:, 0] / a) ** 2 + (offset[:, 2] / b) ** 2 < 0.25
    theory = 1000.0 * pressure * (1.0 - (offset[:, 0] / a) ** 2 - (offset[:, 2] / b) ** 2)
    return {
        "length [%]": 100.0 * (along / first[1] / (b / RADIUS) - 1.0),
        "area [%]": 100.0 * (across * along / (first[0] * first[1]) - 1.0),
        "velocity [%]": 100.0 * rms(liquid["velocity"] - wanted) / rms(wanted),
        "energy [%]": 100.0 * (np.sum(liquid["velocity"] ** 2) / np.sum(start["velocity"] ** 2) - 1.0),
        "pressure [%]": 100.0 * rms((liquid["pressure"] - theory)[inside]) / (1000.0 * pressure),
    }


def plot(figure, runs):
    """The ellipse at the end, and its half axes over time."""
    shape, history = figure.subplots(1, 2)
    for number, ((_, preset, spacing), results) in enumerate(runs.items()):
        position = results.liquid(results.frames[-1])["position"] - CENTRE
        if number == 0:
            shape.plot(position[:, 0], position[:, 2], ".", markersize=2, label=f"{preset}, {1e3 * spacing:g} mm")
        values = np.array([axes(results, t) for t in results.frames])
        history.plot(results.frames, values[:, 1], linewidth=1.0, label=f"{preset}, {1e3 * spacing:g} mm")
    a, b, _, _ = exact(results.frames[-1])
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    shape.plot(a * np.cos(angle), b * np.sin(angle), color="black", label="exact")
    history.plot(results.frames, [exact(t)[1] for t in results.frames], "k--", label="exact")
    shape.set_aspect("equal")
    shape.set_xlabel("x [m]")
    shape.set_ylabel("z [m]")
    history.set_xlabel("Time [s]")
    history.set_ylabel("Half length [m]")
    for panel in (shape, history):
        panel.grid(alpha=0.3)
        panel.legend(fontsize="small")
