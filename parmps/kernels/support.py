"""Particles of little support: the mass around them, and the flow around them."""

import numpy as np
from numba import njit

from parmps.kernels.compiled import compiled
from parmps.kernels.density import times


@njit(inline="always")
def add_moment(matrix, s, dx, dy, dz):
    """Add s d d^T to a matrix of moments: (6,) float64."""
    matrix[0] += s * dx * dx
    matrix[1] += s * dx * dy
    matrix[2] += s * dx * dz
    matrix[3] += s * dy * dy
    matrix[4] += s * dy * dz
    matrix[5] += s * dz * dz


@compiled
def support_by_mass(kind, fluid, share, near, first, last, other, strength, out):
    """Reduce the support of particles near interfaces where the mass around them is little.

    Parameters
    ----------
    kind, fluid : (n,) int8
    share
        Table of `Liquids`.
    near : (m,) int32
        The particles.
    first, last, other
        Neighbour lists.
    strength : (pairs,) float32, 1/m2
        W / r_ij^2, as made by `strengths`.
    out : (n,) float64
        Of those particles at most 1 where at least half of the neighbourhood is as heavy, or all of it a third as
        heavy, towards 0 for a particle alone in a light liquid.
    """
    for i in near:
        total = mass = 0.0
        for k in range(first[i], last[i]):
            j = other[k]
            if kind[j] != 0:
                continue
            total += strength[k]
            mass += strength[k] * min(2.0 * share[fluid[j], fluid[i]], 1.0)
        out[i] = min(out[i], 2.0 * mass / total) if total > 0.0 else 0.0


@compiled
def flow_around(
    position, velocity, support, weak, first, last, other, strength, n0, dimension, matrix, sums
):
    """Sums for the gradient of the velocity around particles of little support, whose own velocity hardly counts.

    Least squares with a free value at the particle: u_j - u_i = grad u . d + e, with e held to 0 by the support c,
    which leaves the share 1 - c of the mean in the sums.

    Parameters
    ----------
    position : (n, 3) float64, m
    velocity : (n, 3) float64, m/s
    support : (n,) float64
    weak : (m,) int32
        The particles.
    first, last, other, strength
        As in `support_by_mass`.
    n0 : float
    dimension : int
    matrix : (m, 6) float64
        Filled: moments.
    sums : (m, 9) float64
        Filled: right-hand sides, as in `velocity_gradient`.
    """
    scale = dimension / n0
    change = np.empty(3)
    for a in range(weak.shape[0]):
        i = weak[a]
        matrix[a] = sums[a] = change[:] = 0.0
        total, mx, my, mz = 1e-300, 0.0, 0.0, 0.0
        for k in range(first[i], last[i]):
            j, s = other[k], scale * strength[k]
            dx, dy = position[j, 0] - position[i, 0], position[j, 1] - position[i, 1]
            dz = position[j, 2] - position[i, 2]
            total += s
            mx += s * dx
            my += s * dy
            mz += s * dz
            add_moment(matrix[a], s, dx, dy, dz)
            for b in range(3):
                u = s * (velocity[j, b] - velocity[i, b])
                change[b] += u
                sums[a, 3 * b] += u * dx
                sums[a, 3 * b + 1] += u * dy
                sums[a, 3 * b + 2] += u * dz
        free = (1.0 - support[i]) / total
        add_moment(matrix[a], -free, mx, my, mz)
        for b in range(3):
            u = free * change[b]
            sums[a, 3 * b] -= u * mx
            sums[a, 3 * b + 1] -= u * my
            sums[a, 3 * b + 2] -= u * mz


@compiled
def solve_flow(weak, inverse, sums, out):
    """Gradient of the velocity from the sums of `flow_around`.

    Parameters
    ----------
    weak, sums
        As in `flow_around`.
    inverse : (m, 6) float64
    out : (n, 9) float64, 1/s
        Filled for those particles.
    """
    for a in range(weak.shape[0]):
        i, m = weak[a], inverse[a]
        for b in range(3):
            x, y, z = sums[a, 3 * b], sums[a, 3 * b + 1], sums[a, 3 * b + 2]
            out[i, 3 * b], out[i, 3 * b + 1], out[i, 3 * b + 2] = times(m, x, y, z)
