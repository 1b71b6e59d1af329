"""Case 3 of Zhang, Wan & Hino: wave heights at both walls, at first against linear theory with the baffle."""

import functools

import numpy as np
from results import rms
from scipy import sparse
from scipy.sparse.linalg import splu

TITLE = "Case 3 of Zhang, Wan & Hino: baffled tank"
SPACINGS = (0.02, 0.015)
LINEAR = 0.5
"""s, until when the waves are low enough for linear theory."""
CELLS = 80
"""Cells of linear theory's grid over the depth."""


@functools.lru_cache
def linear(job, end, samples):
    """Linear elevation at the left gauge in the same tank, from rest, m: (samples,) float64.

    The flow is odd about the baffle, which is thin: one half of the tank is enough, with the potential 0 in the gap
    below the baffle and no flow through the baffle. Finite volumes give the vertical velocity K phi at the surface of
    the flow with the potential phi there; each eigenvector of K, which is symmetric, is a wave (see `surge_response`).
    """
    surge, baffle, depth = job.motion[0], job.tank.baffles[0], job.fluids[0].depth
    half = job.tank.length / 2.0
    d = depth / CELLS
    columns = round(half / d)
    wide = half / columns
    rise, run = wide / d, d / wide
    links = [_chain(columns, run), _chain(CELLS, rise)]
    laplacian = sparse.kron(links[0], sparse.eye(CELLS)) + sparse.kron(sparse.eye(columns), links[1])
    top = np.arange(columns) * CELLS + CELLS - 1
    gap = (columns - 1) * CELLS + np.flatnonzero((np.arange(CELLS) + 0.5) * d < baffle.bottom)
    held = np.zeros(columns * CELLS)
    held[top] += 2.0 * rise
    held[gap] += 2.0 * run
    solve = splu((laplacian + sparse.diags(held)).tocsc()).solve
    load = np.zeros((columns * CELLS, columns))
    load[top, np.arange(columns)] = 2.0 * rise
    operator = (2.0 * rise * np.eye(columns) - 2.0 * rise * solve(load)[top]) / wide
    values, vectors = np.linalg.eigh((operator + operator.T) / 2.0)
    x = (np.arange(columns) + 0.5) * wide - half
    time, omega = np.linspace(0.0, end, samples), surge.omega
    strength = surge.amplitude * values * (vectors.T @ x)
    own = np.sqrt(job.gravity * values)
    p = strength * omega**2 / (own**2 - omega**2)
    r = -(strength + p) * omega / own
    waves = p * np.sin(omega * time)[:, None] + r * np.sin(own * time[:, None])
    at = np.array([np.interp(job.probes[0].at[0] - half, x, vector) for vector in vectors.T])
    return waves @ at


def _chain(count, weight):
    """Matrix of cells in a row, each linked to the next."""
    inner = np.full(count - 1, -weight)
    diagonal = np.zeros(count)
    diagonal[1:] += weight
    diagonal[:-1] += weight
    return sparse.diags([inner, diagonal, inner], [-1, 0, 1])


def walls(results):
    """Elevation above the still level at both walls, m: (samples, 2) float64."""
    return np.stack([results.probe("left"), results.probe("right")], axis=1) - results.job.fluids[0].depth


def measure(results):
    """Rms error of the left elevation over that of linear theory, at first, and the range at both walls."""
    time, eta = results.time, walls(results)
    theory, early = linear(results.job, float(time[-1]), len(time)), time <= LINEAR
    found = {f"linear, {LINEAR:g} s [%]": 100.0 * rms((eta[:, 0] - theory)[early]) / rms(theory[early])}
    for side, name in enumerate(("left", "right")):
        found[f"{name}, lowest [mm]"] = 1e3 * eta[:, side].min()
        found[f"{name}, highest [mm]"] = 1e3 * eta[:, side].max()
    found["volume [%]"] = 100.0 * results.record["volume_drift"]
    return found


def plot(figure, runs):
    """Elevation at both walls, and the liquid in the middle of the tank at the highest wave."""
    panels = figure.subplots(3, 1)
    for number, ((_, preset, spacing), results) in enumerate(runs.items()):
        eta = walls(results)
        if number == 0:
            theory, early = linear(results.job, float(results.time[-1]), len(results.time)), results.time <= 2 * LINEAR
            panels[0].plot(
                results.time[early], 1e3 * theory[early], color="black", linewidth=2.0, alpha=0.5, label="linear theory"
            )
        for panel, values in zip(panels, eta.T, strict=False):
            panel.plot(results.time, 1e3 * values, linewidth=0.9, label=f"{preset}, {1e3 * spacing:g} mm")
    for panel, name in zip(panels, ("Left", "Right"), strict=False):
        panel.set_ylabel(f"{name} wall [mm]")
        panel.grid(alpha=0.3)
    panels[0].legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    panels[1].set_xlabel("Time [s]")
    time = results.time[eta[:, 0].argmax()]
    x, y, z = results.liquid(time)["position"].T
    middle = np.abs(y - results.job.tank.size[1] / 2.0) < 2.0 * results.job.spacing
    panels[2].scatter(x[middle], z[middle], s=2.0, c=results.liquid(time)["pressure"][middle])
    panels[2].set_aspect("equal")
    panels[2].set_ylabel(f"z [m], {time:.2f} s")
    panels[2].set_xlabel("x [m]")
