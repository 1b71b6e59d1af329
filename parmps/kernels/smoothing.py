"""Several liquids as the papers treat them: smoothed density, and surface tension as a force in a layer ([000])."""

import math

import numpy as np

from parmps.kernels.compiled import compiled
from parmps.kernels.weight import weight


@compiled
def smooth_mass_density(position, kind, fluid, density, first, last, other, strength, reach, rows, out, fraction):
    """Smooth the density where liquids meet, <rho>_i = sum rho_j W / sum W over i and its neighbours ([000] eq. 12).

    Walls do not count. Away from other liquids the density is the own one, to the last digit.

    Parameters
    ----------
    position : (n, 3) float64, m
    kind, fluid : (n,) int8
    density : (liquids,) float64, kg/m3
    first, last, other
        Neighbour lists.
    strength : (pairs,) float32, 1/m2
        W / r_ij^2, as made by `strengths`.
    reach : float
        Radius r_e of those weights, in spacings.
    rows : int
    out : (n,) float64, kg/m3
        Filled for the rows.
    fraction : (n,) float64
        Filled for the rows: share of the own liquid among the neighbours, by weight; 1 without any.
    """
    for i in range(rows):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        own = density[fluid[i]]
        total = strange = excess = 0.0
        for k in range(first[i], last[i]):
            j = other[k]
            if kind[j] != 0:
                continue
            dx, dy, dz = position[j, 0] - x, position[j, 1] - y, position[j, 2] - z
            w = strength[k] * (dx * dx + dy * dy + dz * dz)
            total += w
            if fluid[j] != fluid[i]:
                strange += w
                excess += w * (density[fluid[j]] - own)
        out[i] = own + excess / (total + weight(0.0, reach))
        fraction[i] = 1.0 - strange / total if total > 0.0 else 1.0


@compiled
def surface_force(
    position, kind, fluid, tension, first, last, other, strength, l0, reach, n0, dimension, rows, out
):
    """Surface tension as a force per volume, sigma kappa grad C ([000] eqs. 16 to 18; Duan 2015).

    The colour C is 0 in the particle's own liquid and 1 in those that have a tension with it; its gradient is
    [000] eq. 4, with the tension of each pair. The curvature is that of the contour through the particle of the colour
    smoothed, f = sum C_j G_ij / sum G_ij, with a Gaussian G = exp(-9 r^2 / r_s^2), whose derivatives are exact:
    kappa = -div(grad f / |grad f|), in 2D eq. 18 with the exponent 3/2 on 1 + y'^2. Without the denominator an
    interface would bend where the liquid ends, at walls and the free surface.

    Parameters
    ----------
    position, kind, fluid, first, last, other, strength, l0, rows
        As in `smooth_mass_density`.
    tension : (liquids, liquids) float64, N/m
    reach : float
        Radius r_s, in spacings, no more than that of the lists.
    n0 : float
        Lattice number density of ``strength``.
    dimension : int
    out : (n, 3) float64, N/m3
        Filled for the rows. No curvature is taken for stronger than that of a disc or ball of radius l0.
    """
    a = 9.0 / reach**2
    most = dimension - 1.0
    # sums of G and its derivatives: 1, x, y, z, xx, xy, xz, yy, yz, zz; over all, and where the colour is 1
    whole, part, f = np.empty(10), np.empty(10), np.empty(10)
    for i in range(rows):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        gx = gy = gz = 0.0
        for k in range(first[i], last[i]):
            j = other[k]
            if kind[j] != 0 or fluid[j] == fluid[i]:
                continue
            s = strength[k] * tension[fluid[i], fluid[j]]
            gx += s * (position[j, 0] - x)
            gy += s * (position[j, 1] - y)
            gz += s * (position[j, 2] - z)
        if gx == 0.0 and gy == 0.0 and gz == 0.0:
            out[i] = 0.0
            continue
        whole[:] = part[:] = 0.0
        _add_gaussian(whole, a, 0.0, 0.0, 0.0)
        for k in range(first[i], last[i]):
            j = other[k]
            if kind[j] != 0:
                continue
            dx, dy, dz = (position[j, 0] - x) / l0, (position[j, 1] - y) / l0, (position[j, 2] - z) / l0
            if dx * dx + dy * dy + dz * dz >= reach * reach:
                continue
            _add_gaussian(whole, a, dx, dy, dz)
            if tension[fluid[i], fluid[j]] > 0.0:
                _add_gaussian(part, a, dx, dy, dz)
        f[0] = part[0] / whole[0]
        for d in range(1, 4):
            f[d] = (part[d] - f[0] * whole[d]) / whole[0]
        m = 4
        for d in range(1, 4):
            for e in range(d, 4):
                f[m] = (part[m] - f[0] * whole[m] - f[d] * whole[e] - f[e] * whole[d]) / whole[0]
                m += 1
        if dimension == 2:  # G falls along y, too, where there is nothing
            f[7] = 0.0
        slope2 = f[1] ** 2 + f[2] ** 2 + f[3] ** 2
        along = f[4] * f[1] ** 2 + f[7] * f[2] ** 2 + f[9] * f[3] ** 2
        along += 2.0 * (f[5] * f[1] * f[2] + f[6] * f[1] * f[3] + f[8] * f[2] * f[3])
        bend = along - (f[4] + f[7] + f[9]) * slope2
        bound = most * slope2 * math.sqrt(slope2)
        kappa = min(max(bend, -bound), bound) / (slope2 * math.sqrt(slope2)) if slope2 > 0.0 else 0.0
        scale = kappa / l0 * dimension / n0
        out[i, 0], out[i, 1], out[i, 2] = scale * gx, scale * gy, scale * gz


@compiled
def _add_gaussian(sums, a, dx, dy, dz):
    """Add G = exp(-a d^2) and its derivatives by the place it is looked at from, which is d before its centre."""
    g = math.exp(-a * (dx * dx + dy * dy + dz * dz))
    slope, bend = 2.0 * a * g, 4.0 * a * a * g
    sums[0] += g
    sums[1] += slope * dx
    sums[2] += slope * dy
    sums[3] += slope * dz
    sums[4] += bend * dx * dx - slope
    sums[5] += bend * dx * dy
    sums[6] += bend * dx * dz
    sums[7] += bend * dy * dy - slope
    sums[8] += bend * dy * dz
    sums[9] += bend * dz * dz - slope
