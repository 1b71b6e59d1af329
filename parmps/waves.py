"""Linear waves of layered liquids in a rectangular tank: any number of layers, free surface or lid.

The flow of each layer is potential. Between its lower boundary, moving with w_0 cos(k x), and its upper one,
moving with w_1 cos(k x), the kinetic energy per half length is rho / (2 k) [coth(k h) (w_0^2 + w_1^2) -
2 w_0 w_1 / sinh(k h)], and the elevations a_i of the layers' tops store g (rho_i - rho_i+1) + sigma_i k^2 times
a_i^2 / 2 (Lamb, Hydrodynamics, sections 231 and 266, for two layers). With the symmetric matrices M and K of
these two energies, M a'' + K a = Q: the modes are those of a symmetric eigenvalue problem, and negative
eigenvalues are rates of growth of the instability of Rayleigh and Taylor.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh


class Layers(NamedTuple):
    """Layers of liquid, the lowest first.

    Attributes
    ----------
    depth : (n,) float64, m
    density : (n,) float64, kg/m3
    gravity : float, m/s2
    tension : (n,) float64, N/m
        At the top of each layer.
    lid : bool
        Whether the top of the uppermost layer is a wall.
    """

    depth: np.ndarray
    density: np.ndarray
    gravity: float
    tension: np.ndarray
    lid: bool = False

    @property
    def free(self):
        """Number of boundaries that move."""
        return len(self.depth) - self.lid


def layers_of(job):
    """Layers of a job whose liquids are given by their depth.

    Parameters
    ----------
    job : Job

    Returns
    -------
    Layers
    """
    depth = np.array(job.depths)
    tension = np.zeros(len(depth))
    names = [fluid.name for fluid in job.fluids]
    for interface in job.interfaces:
        a, b = sorted(names.index(name) for name in interface.between)
        if b == a + 1:
            tension[a] = interface.surface_tension
    full = job.tank.lid and depth.sum() > job.tank.height - 0.5 * job.spacing
    if not full:
        tension[-1] = job.fluids[-1].surface_tension
    density = np.array([fluid.density for fluid in job.fluids])
    return Layers(depth, density, job.gravity, tension, full)


def matrices(layers, k):
    """Kinetic and potential energy of the elevations of the layers' tops.

    Parameters
    ----------
    layers : Layers
    k : float, rad/m
        Wave number.

    Returns
    -------
    M, K : (free, free) float64
        kg/m2 and N/m3: the energies per area are half of a' M a' and a K a, and half of that again by the mean of
        cos^2.
    """
    n = len(layers.depth)
    kh = k * layers.depth
    own = layers.density / (k * np.tanh(kh))
    cross = -layers.density * 2.0 * np.exp(-kh) / (k * -np.expm1(-2.0 * kh))  # 1 / sinh without overflow
    mass = np.diag(own + np.append(own[1:], 0.0)) + np.diag(cross[1:], 1) + np.diag(cross[1:], -1)
    above = np.append(layers.density[1:], 0.0)
    stiffness = np.diag(layers.gravity * (layers.density - above) + layers.tension * k * k)
    free = slice(0, n - layers.lid)
    return mass[free, free], stiffness[free, free]


def modes(layers, k):
    """Free waves of one wave number.

    Parameters
    ----------
    layers : Layers
    k : float, rad/m

    Returns
    -------
    omega2 : (free,) float64, 1/s2
        Squared angular frequencies, the greatest first; negative where the mode grows.
    shape : (free, free) float64
        Column j: elevations of the layers' tops in mode j, the greatest of them 1.
    """
    mass, stiffness = matrices(layers, k)
    omega2, shape = eigh(stiffness, mass)
    shape = shape / shape[np.abs(shape).argmax(axis=0), np.arange(len(shape))]
    return omega2[::-1], shape[:, ::-1]


def velocity(layers, k, speed, x, z, layer):
    """Velocity of the potential flow between boundaries that move with given speeds.

    w = [w_1 sinh k(z - b) + w_0 sinh k(t - z)] / sinh(k h) times cos(k x) in a layer from b to t = b + h.

    Parameters
    ----------
    layers : Layers
    k : float, rad/m
    speed : (free,) float64, m/s
        Amplitudes of the vertical speeds of the layers' tops.
    x, z : (m,) float64, m
    layer : (m,) int
        Number of the layer that each point is in.

    Returns
    -------
    horizontal, vertical : (m,) float64, m/s
    """
    boundary = np.concatenate([[0.0], speed, np.zeros(int(layers.lid))])
    bottom = np.concatenate([[0.0], np.cumsum(layers.depth)])
    h, low, high = layers.depth[layer], boundary[layer], boundary[layer + 1]
    above, below = z - bottom[layer], bottom[layer + 1] - z
    # sinh and cosh over sinh(k h) without the overflow of short waves
    scale = -1.0 / np.expm1(-2.0 * k * h)
    up, up_back = np.exp(k * (above - h)), np.exp(-k * (above + h))
    down, down_back = np.exp(k * (below - h)), np.exp(-k * (below + h))
    w = scale * (high * (up - up_back) + low * (down - down_back))
    u = scale * (high * (up + up_back) - low * (down + down_back))
    return -u * np.sin(k * x), w * np.cos(k * x)
