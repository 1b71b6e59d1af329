"""Interfaces between liquids."""

import math

from numba import njit

from parmps.kernels.compiled import compiled
from parmps.kernels.weight import smooth_weight, weight


@njit(inline="always")
def pressure_jump(own, its, tension, own_bend, its_bend):
    """Jump of the pressure from a particle of one liquid to one of another, sigma kappa (Young and Laplace), Pa.

    Parameters
    ----------
    own, its : int
        Numbers of the two liquids; no jump within one.
    tension : (liquids, liquids) float64, N/m
    own_bend, its_bend : float, 1/m
        Curvature of the interface at the two particles, each positive where its own liquid is convex.

    Returns
    -------
    float
    """
    if own == its:
        return 0.0
    return 0.5 * tension[own, its] * (its_bend - own_bend)


@compiled
def label_walls(position, first, other, kind, begin, end, fluid):
    """Give each wall particle the number of the liquid nearest to it.

    With one density on both ends, layers at rest have their exact pressure on the links to the wall, too.

    Parameters
    ----------
    position : (n, 3) float64, m
    first, other
        Neighbour lists.
    kind : (n,) int8
    begin, end : int
        Range of the wall particles.
    fluid : (n,) int8
        Number of each particle's liquid; filled for the range.
    """
    for i in range(begin, end):
        least = math.inf
        for k in range(first[i], first[i + 1]):
            j = other[k]
            if kind[j] != 0:
                continue
            dx = position[j, 0] - position[i, 0]
            dy = position[j, 1] - position[i, 1]
            dz = position[j, 2] - position[i, 2]
            r2 = dx * dx + dy * dy + dz * dz
            if r2 < least:
                least = r2
                fluid[i] = fluid[j]
