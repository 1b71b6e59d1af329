"""A rotating square patch: its invariants, and its pressure at the start."""

import numpy as np

from parmps.tank import place

TITLE = "Rotating square patch"
SPACINGS = (0.025, 0.0125)
CENTRE, TURN = np.array([2.0, 0.0, 2.0]), 1.0
"""m and rad/s."""
TARGETS = {"energy [%]": 2.0, "angular momentum [%]": 2.0}


def initial(job):
    """The particles of the job with the velocity of a rigid turn."""
    placement = place(job, "half")
    position = placement.position[: placement.total_fluid]
    return position, np.cross([0.0, TURN, 0.0], position - CENTRE)


def central_pressure():
    """Pressure in the middle at the start over rho omega^2 L^2.

    lap p = 2 rho omega^2 with p = 0 around the unit square: -32/pi^4 sum over odd m, n of (-1)^((m+n)/2 - 1) /
    (m n (m^2 + n^2)) (Le Touze et al. 2013, Int. J. Numer. Methods Fluids 73:660, their series in the middle).
    """
    m, n = np.meshgrid(np.arange(1, 400, 2), np.arange(1, 400, 2))
    return float(-32.0 / np.pi**4 * np.sum((-1.0) ** ((m + n) / 2 - 1) / (m * n * (m**2 + n**2))))


def history(results):
    """Kinetic energy and angular momentum over those of the start in each frame: (frames, 2) float64."""
    rows = []
    for time in results.frames:
        liquid = results.liquid(time)
        turn = np.cross(liquid["position"] - CENTRE, liquid["velocity"])[:, 1]
        rows.append([np.sum(liquid["velocity"] ** 2), turn.sum()])
    return np.array(rows) / rows[0]


def measure(results):
    """Invariants at the end, and the pressure in the middle soon after the start, over that at the start."""
    # at t = 0 there is none yet: a rigid turn has no divergence, and the pressure comes of its growth
    liquid = results.liquid(0.1)
    near = np.linalg.norm(liquid["position"] - CENTRE, axis=1) < 1.5 * results.job.spacing
    energy, turn = history(results)[-1] - 1.0
    return {
        "energy [%]": 100.0 * energy,
        "angular momentum [%]": 100.0 * turn,
        "pressure at 0.1 s [%]": 100.0 * (liquid["pressure"][near].mean() / (1000.0 * central_pressure()) - 1.0),
    }


def plot(figure, runs):
    """The patch at three times, and its energy."""
    panels = figure.subplots(2, 2).ravel()
    (_, preset, spacing), results = max(runs.items(), key=lambda item: (-item[0][2], item[0][1] == "balanced"))
    for panel, time in zip(panels, (0.5, 1.0, 2.0), strict=False):
        liquid = results.liquid(time)
        position = liquid["position"] - CENTRE
        shown = panel.scatter(position[:, 0], position[:, 2], 1.0, liquid["pressure"], vmin=-200.0, vmax=200.0)
        panel.set_aspect("equal")
        panel.set_title(f"{preset}, {1e3 * spacing:g} mm, t = {time:g} s", fontsize="small")
    figure.colorbar(shown, ax=panels[:3], label="Pressure [Pa]")
    for (_, preset, spacing), results in runs.items():
        panels[3].plot(results.frames, history(results)[:, 0], label=f"{preset}, {1e3 * spacing:g} mm")
    panels[3].set_xlabel("Time [s]")
    panels[3].set_ylabel("Energy over that of the start")
    panels[3].grid(alpha=0.3)
    panels[3].legend(fontsize="small")
