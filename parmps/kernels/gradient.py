"""Pressure gradients."""

import math

import numpy as np

from parmps.kernels.compiled import compiled
from parmps.kernels.interface import pressure_jump


@compiled
def corrected_gradient(
    position,
    pressure,
    surface,
    lean,
    first,
    last,
    other,
    strength,
    inverse,
    surface_distance,
    n0,
    dimension,
    rows,
    out,
    fluid,
    volume,
    tension,
    bend,
    above,
    enclosed,
    force,
    mass,
):
    """Gradient from P_j - P_i with the inverse moment matrix, exact for linear fields (Duan 2018).

    In the surface, zero pressure, or that of surface tension, on the surface above the particle takes part with the
    missing neighbours' weight, as in the pressure equation; its moment must be in ``inverse``.

    Beside walls away from the surface the sum is over what the pressure has beyond that of liquid at rest,
    rho f . (r_j - r_i), whose gradient is known. Where the moment matrix is exact that is the same; in corners, where
    its eigenvalues had to be raised, only the gradient of that is too small, and liquid at rest has its weight.

    Parameters
    ----------
    position : (n, 3) float64, m
    pressure : (n,) float64, Pa
    surface : (n,) int8
    lean : (rows, 3) float64
        As in `moments`.
    first, last, other
        Neighbour lists.
    strength : (pairs,) float32, 1/m2
        W / r_ij^2, as made by `strengths`.
    inverse : (rows, 6) float64
        Inverse moment matrices, the missing neighbours' moments included.
    surface_distance : float
        From surface particles to the free surface, m.
    n0 : float
        Lattice number density.
    dimension, rows : int
    out : (n, 3) float64, Pa/m
        Filled for the rows.
    fluid, volume, tension, bend, above
        As in `poisson_rows`: with several liquids it is grad P / rho, times the reference density.
    enclosed : (rows,) int8
        1 for particles beside walls and away from the surface, as made by `mark_enclosed`.
    force : (n, 3) float64, m/s2
        Body force f.
    mass : float, kg/m3
        Density, or the reference density of ``volume``.
    """
    scale = dimension / n0
    for i in range(rows):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        gx = gy = gz = 0.0
        here = pressure[i]
        fx = fy = fz = 0.0
        if enclosed[i] != 0:
            fx, fy, fz = mass * force[i, 0], mass * force[i, 1], mass * force[i, 2]
        mine, own = 0, 1.0
        if fluid is not None:
            mine = fluid[i]
            own = volume[mine, mine]
        for k in range(first[i], last[i]):
            j = other[k]
            there = pressure[j]
            b = own
            if fluid is not None and fluid[j] != mine:
                b = volume[mine, fluid[j]]
                if tension is not None:
                    there -= pressure_jump(tension[mine, fluid[j]], bend[i], bend[j])
            dx, dy, dz = position[j, 0] - x, position[j, 1] - y, position[j, 2] - z
            s = strength[k] * (b * (there - here) - fx * dx - fy * dy - fz * dz)
            gx += s * dx
            gz += s * dz
            if dimension == 3:
                gy += s * dy
        if surface[i] != 0:
            s = here / surface_distance
            if above is not None:
                s = (here - above[i]) / surface_distance
            s *= own
            gx -= s * lean[i, 0]
            gy -= s * lean[i, 1]
            gz -= s * lean[i, 2]
        out[i, 0] = fx + scale * (inverse[i, 0] * gx + inverse[i, 1] * gy + inverse[i, 2] * gz)
        out[i, 1] = fy + scale * (inverse[i, 1] * gx + inverse[i, 3] * gy + inverse[i, 4] * gz)
        out[i, 2] = fz + scale * (inverse[i, 2] * gx + inverse[i, 4] * gy + inverse[i, 5] * gz)


@compiled
def add_missing_moment(matrix, surface, lean, n0, dimension, out):
    """Moment matrices with the moment of the missing neighbours of surface particles.

    Parameters
    ----------
    matrix : (rows, 6) float64
        As in `moments`.
    surface : (n,) int8
    lean : (rows, 3) float64
        As in `moments`.
    n0 : float
    dimension : int
    out : (rows, 6) float64
        Filled.
    """
    for i in range(matrix.shape[0]):
        s = 0.0
        if surface[i] != 0:
            size = math.sqrt(lean[i, 0] ** 2 + lean[i, 1] ** 2 + lean[i, 2] ** 2)
            s = dimension / (n0 * size + 1e-300)
        out[i, 0] = matrix[i, 0] + s * lean[i, 0] * lean[i, 0]
        out[i, 1] = matrix[i, 1] + s * lean[i, 0] * lean[i, 1]
        out[i, 2] = matrix[i, 2] + s * lean[i, 0] * lean[i, 2]
        out[i, 3] = matrix[i, 3] + s * lean[i, 1] * lean[i, 1]
        out[i, 4] = matrix[i, 4] + s * lean[i, 1] * lean[i, 2]
        out[i, 5] = matrix[i, 5] + s * lean[i, 2] * lean[i, 2]


@compiled
def paper_gradient(position, pressure, first, other, strength, n0, dimension, minimum, rows, out):
    """Gradient of the papers: D/n0 sum (P_j + P_i) or (P_j - P_min) (r_j - r_i) W / r_ij^2.

    The sum is [002] eq. 5 and [004] eq. 5; P_min, the least pressure of the neighbourhood, is [000] eq. 8.

    Parameters
    ----------
    position : (n, 3) float64, m
    pressure : (n,) float64, Pa
        Of fluid, wall and dummy particles.
    first, other
        Neighbour lists.
    strength : (pairs,) float32, 1/m2
        W / r_ij^2, as made by `strengths`.
    n0 : float
        Lattice number density.
    dimension : int
    minimum : bool
        Whether to take P_j - P_min.
    rows : int
    out : (n, 3) float64, Pa/m
        Filled for the rows.
    """
    scale = dimension / n0
    for i in range(rows):
        offset = pressure[i]
        if minimum:
            for k in range(first[i], first[i + 1]):
                offset = min(offset, pressure[other[k]])
            offset = -offset
        gx = gy = gz = 0.0
        for k in range(first[i], first[i + 1]):
            j = other[k]
            s = strength[k] * (pressure[j] + offset)
            gx += s * (position[j, 0] - position[i, 0])
            gy += s * (position[j, 1] - position[i, 1])
            gz += s * (position[j, 2] - position[i, 2])
        out[i, 0], out[i, 1], out[i, 2] = scale * gx, scale * gy, scale * gz


@compiled
def residual_damping(
    position,
    velocity,
    kind,
    gradient,
    first,
    last,
    other,
    strength,
    n0,
    dimension,
    base,
    slope,
    rows,
    out,
    fluid,
    share,
    sheet,
    slips,
    normal,
):
    """Velocity change that damps what a linear field cannot explain.

    dv_i = 1/n0 sum e W [v_j - v_i - (grad v_i + grad v_j)/2 (r_j - r_i)] over fluid particles. The bracket
    is of third order in the distance for smooth fields and of first order for noise between neighbours, and
    antisymmetric, so that momentum is kept. The strength e = base + slope |bracket|, at most 0.3, is greater
    where flows collide.

    Parameters
    ----------
    position, velocity : (n, 3) float64, m and m/s
    kind : (n,) int8
    gradient : (n, 9) float64, 1/s
        As in `velocity_gradient`.
    first, last, other
        Neighbour lists.
    strength : (pairs,) float32, 1/m2
        W / r_ij^2, as made by `strengths`.
    n0 : float
        Lattice number density.
    dimension : int
    base, slope : float, 1 and s/m
        Share of the residual removed in this step.
    rows : int
    out : (n, 3) float64, m/s
        Filled for the rows.
    fluid, share
        As in `poisson_rows`: heavier particles change less.
    sheet, slips, normal
        As in `interface.divergence`.
    """
    most = np.uint64(0)
    for i in range(rows):
        most = max(most, last[i] - first[i])
    ahead = np.empty(most, np.uint32)  # pairs of a particle with those that follow it: each is evaluated once
    out[:rows] = 0.0
    base, slope, greatest = base / n0, slope / n0, 0.3 / n0
    for i in range(rows):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        u, v, w = velocity[i, 0], velocity[i, 1], velocity[i, 2]
        ax = ay = az = 0.0
        g0, g1, g2 = gradient[i, 0], gradient[i, 1], gradient[i, 2]
        g3, g4, g5 = gradient[i, 3], gradient[i, 4], gradient[i, 5]
        g6, g7, g8 = gradient[i, 6], gradient[i, 7], gradient[i, 8]
        h = gradient
        count = np.uint64(0)
        for k in range(first[i], last[i]):  # without branches, which could not be predicted
            ahead[count] = k
            count += np.uint64(other[k] > i)
        for m in range(count):
            k = ahead[m]
            j = other[k]
            if kind[j] != 0:
                continue
            dx, dy, dz = position[j, 0] - x, position[j, 1] - y, position[j, 2] - z
            s = strength[k] * (dx * dx + dy * dy + dz * dz)
            dx, dy, dz = 0.5 * dx, 0.5 * dy, 0.5 * dz
            rx = velocity[j, 0] - u - (g0 + h[j, 0]) * dx - (g2 + h[j, 2]) * dz
            rz = velocity[j, 2] - w - (g6 + h[j, 6]) * dx - (g8 + h[j, 8]) * dz
            ry = 0.0
            if dimension == 3:
                rx -= (g1 + h[j, 1]) * dy
                rz -= (g7 + h[j, 7]) * dy
                ry = velocity[j, 1] - v - (g3 + h[j, 3]) * dx - (g4 + h[j, 4]) * dy - (g5 + h[j, 5]) * dz
            # tangentially, liquids may slip
            if sheet is not None and slips[i] * slips[j] != 0 and sheet[fluid[i], fluid[j]]:
                nx, ny, nz = normal[i, 0] - normal[j, 0], normal[i, 1] - normal[j, 1], normal[i, 2] - normal[j, 2]
                along = (rx * nx + ry * ny + rz * nz) / (nx * nx + ny * ny + nz * nz + 1e-300)
                rx, ry, rz = along * nx, along * ny, along * nz
            s *= min(base + slope * math.sqrt(rx * rx + ry * ry + rz * rz), greatest)
            here = there = s
            if fluid is not None and fluid[i] != fluid[j]:
                here *= 2.0 * share[fluid[j], fluid[i]]
                there *= 2.0 * share[fluid[i], fluid[j]]
            ax += here * rx
            ay += here * ry
            az += here * rz
            if j < rows:
                out[j, 0] -= there * rx
                out[j, 1] -= there * ry
                out[j, 2] -= there * rz
        out[i, 0] += ax
        out[i, 1] += ay
        out[i, 2] += az
