"""Vibrations that viscosity damps: fits and pictures of them, and free waves in a tank by finite elements."""

import numpy as np
from scipy import sparse
from scipy.sparse import linalg

GRADING = 2.8
"""Elements follow tanh of this at their ends: without, the contact line converges slowly."""


def swing(time, amplitude, decay, frequency, phase, mean=0.0):
    """A vibration that decays, about a mean."""
    return amplitude * np.exp(-decay * time) * np.sin(frequency * time + phase) + mean


def errors(s, fitted):
    """Errors of decay and period of a fitted `swing`, %, against exp(s t)."""
    return {
        "decay [%]": 100.0 * (fitted[1] / -s.real - 1.0),
        "period [%]": 100.0 * (s.imag / fitted[2] - 1.0),
    }


def plot(figure, runs, variants, signal, reference, labels):
    """Draw the signals of runs by variant, and their references.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    runs : dict of (variant, preset, spacing) to Results
    variants : iterable of str
    signal : callable
        Of a run: (frames,) float64.
    reference : callable
        Of the finest run of a variant and times.
    labels : tuple of str
        Of the references and of the axis of the signals.
    """
    panels = dict(zip(variants, figure.subplots(1, len(variants), sharey=True), strict=True))
    for (variant, preset, spacing), results in runs.items():
        panels[variant].plot(results.frames, signal(results), label=f"{preset}, {1e3 * spacing:g} mm")
    for variant, panel in panels.items():
        mine = [results for (name, *_), results in runs.items() if name == variant]
        if mine:
            t = np.linspace(0.0, mine[-1].frames[-1], 300)
            panel.plot(t, reference(mine[-1], t), "k--", linewidth=0.8, label=labels[0])
        panel.set_title(variant, fontsize="medium")
        panel.set_xlabel("Time [s]")
        panel.grid(alpha=0.3)
    panel.legend(fontsize="small", loc="upper right")
    next(iter(panels.values())).set_ylabel(labels[1])


def viscous_wave(length, depth, gravity, viscosity, elements=(24, 16)):
    """The first free wave, as exp(s t): v' = nu div(grad v + grad v^T) - grad p, div v = 0, eta' = v_z at the surface.

    Taylor-Hood elements (Q2 for the velocity, Q1 for the pressure) on a grid that is finer at all sides; weight and
    stress balance at the surface, where the elevation has the nodes of the velocity. Floor and walls hold the liquid,
    and so the contact line.

    Parameters
    ----------
    length, depth : float, m
    gravity : float, m/s2
    viscosity : float, m2/s
        Kinematic.
    elements : tuple of int
        Along the length and the depth.

    Returns
    -------
    complex
        s: the decay rate is - Re s, the angular frequency Im s, 1/s.
    """
    along, up = (_Line(size, count) for size, count in zip((length, depth), elements, strict=True))
    mass = sparse.kron(along.mass, up.mass)
    stretch, shear = sparse.kron(along.stiff, up.mass), sparse.kron(along.mass, up.stiff)
    cross = sparse.kron(along.slope, up.slope.T)
    friction = viscosity * sparse.bmat([[2 * stretch + shear, cross], [cross.T, stretch + 2 * shear]])
    parts = [(along.pressure_slope, up.pressure), (along.pressure, up.pressure_slope)]
    divergence = sparse.hstack([sparse.kron(*part) for part in parts])
    wide, high = along.mass.shape[0], up.mass.shape[0]
    top = sparse.kron(sparse.eye(wide), sparse.eye(high).tocsr()[[-1]])  # the surface's nodes of a component
    elevation = sparse.hstack([0 * top, top])
    inside = np.ones((wide, high), bool)
    inside[[0, -1]] = inside[:, 0] = False
    free = np.flatnonzero(np.tile(inside.ravel(), 2))
    b, h = divergence.tocsc()[:, free], elevation.tocsc()[:, free]
    weight = gravity * h.T @ along.mass
    system = sparse.bmat([[-friction.tocsr()[free][:, free], b.T, -weight], [b, None, None], [h, None, None]])
    inertia = sparse.block_diag([mass, mass]).tocsr()[free][:, free]
    rates = sparse.block_diag([inertia, sparse.csr_matrix((b.shape[0],) * 2), sparse.eye(wide)])
    k = np.pi / length
    inviscid = 1j * np.sqrt(gravity * k * np.tanh(k * depth))
    found = linalg.eigs(
        system.tocsc().astype(complex), 2, rates.tocsc().astype(complex), inviscid, return_eigenvectors=False
    )
    return found[np.argmin(abs(found - inviscid))]


class _Line:
    """Integrals over products of the functions of a line, and of their slopes: quadratic ones and linear ones."""

    def __init__(self, size, count):
        ends = 0.5 * size * (1.0 + np.tanh(GRADING * np.linspace(-1.0, 1.0, count + 1)) / np.tanh(GRADING))
        nodes = 2 * count + 1
        self.mass, self.stiff, self.slope = (sparse.lil_matrix((nodes, nodes)) for _ in range(3))
        self.pressure, self.pressure_slope = (sparse.lil_matrix((count + 1, nodes)) for _ in range(2))
        points, weights = np.polynomial.legendre.leggauss(3)
        quadratic = np.array([0.5 * points * (points - 1.0), 1.0 - points**2, 0.5 * points * (points + 1.0)])
        slopes = np.array([points - 0.5, -2.0 * points, points + 0.5])
        linear = 0.5 * np.array([1.0 - points, 1.0 + points])
        for e, half in enumerate(np.diff(ends) / 2.0):
            three, two = slice(2 * e, 2 * e + 3), slice(e, e + 2)
            self.mass[three, three] += half * (quadratic * weights) @ quadratic.T
            self.stiff[three, three] += (slopes * weights) @ slopes.T / half
            self.slope[three, three] += (quadratic * weights) @ slopes.T
            self.pressure[two, three] += half * (linear * weights) @ quadratic.T
            self.pressure_slope[two, three] += (linear * weights) @ slopes.T
