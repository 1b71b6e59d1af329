"""Sums over pairs of points that are moved until they are even, and the choice of points that are apart."""

import math

import numpy as np

from parmps.kernels.compiled import compiled
from parmps.kernels.weight import weight


@compiled
def sum_asymmetry(position, other, pairs, spacing, reach, scale, both):
    """Sum W (r_i - r_j) / r_ij over pairs of points.

    Parameters
    ----------
    position : (n, d) float64, m
    other : (m, d) float64, m
    pairs : (2, k) int64
        Numbers of the points, and of the others.
    spacing : float, m
    reach : float
        Radius of the weight, in spacings.
    scale : float
        Factor of the sum.
    both : bool
        Whether the others are the points themselves, each pair given once.

    Returns
    -------
    (n, d) float64
    """
    total = np.zeros(position.shape)
    dimension = position.shape[1]
    away = np.empty(dimension)
    for k in range(pairs.shape[1]):
        i, j = pairs[0, k], pairs[1, k]
        r2 = 0.0
        for a in range(dimension):
            away[a] = position[i, a] - other[j, a]
            r2 += away[a] * away[a]
        r = max(math.sqrt(r2), 1e-3 * spacing)
        share = scale * max(weight(r / spacing, reach), 0.0) / r
        for a in range(dimension):
            total[i, a] += share * away[a]
            if both:
                total[j, a] -= share * away[a]
    return total


@compiled
def pick_apart(count, pairs):
    """Pick points, in their order, of which no two are a pair.

    Parameters
    ----------
    count : int
    pairs : (k, 2) int64
        The lower number first, in ascending order of it.

    Returns
    -------
    (count,) bool
    """
    free = np.ones(count, np.bool_)
    for k in range(len(pairs)):
        if free[pairs[k, 0]]:
            free[pairs[k, 1]] = False
    return free
