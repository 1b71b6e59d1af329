"""Rows of the pressure Poisson equation."""

import math

import numpy as np

from parmps.kernels.compiled import compiled
from parmps.kernels.interface import pressure_jump

WEAKEST_WALL = 0.08
"""Least sum of weights of a wall particle's links: that of a particle in the corner of a 3D tank."""


@compiled
def poisson_rows(
    position,
    kind,
    surface,
    lean,
    link_force,
    wall_force,
    source,
    pressure,
    column,
    first,
    last,
    other,
    strength,
    l0,
    n0,
    lam,
    dimension,
    density,
    wall_share,
    surface_distance,
    ghost,
    row_first,
    columns,
    values,
    halo_first,
    halo_columns,
    halo_values,
    at_diagonal,
    rhs,
    fluid,
    volume,
    share,
    tension,
    bend,
    mass_density,
    above,
):
    """Assemble sum_j c W_ij [P_i - P_j + rho f_ij . (r_j - r_i)] = -rho s_i, with c = 2D/(n0 lambda l0^2).

    The Laplacian is the papers' ([004] eq. 7). The body force is balanced link by link, with f_ij the mean of
    the two ends, so that a hydrostatic pressure solves the equation exactly however disordered the particles
    are. Links to walls count ``wall_share``: on a lattice the wall particles, which have no links among
    themselves, carry twice the flux along the wall that an even reflection would, so half is right.

    Between liquids of different density the equation is one of accelerations: the link's specific volume
    2 / (rho_i + rho_j) stands for 1 / rho, and f_ij is the mean by mass, so that layers at rest have their
    pressure exactly and a tangential acceleration that jumps with the density does no harm. Surface tension
    is a jump of the pressure on the links across the interface, balanced as exactly.

    In the surface, ``ghost`` closes the support with particles of zero pressure on the free surface
    above the particle (after Shibata 2015): their weight is that of the missing first moment, so that pressure-free
    liquid stays free of pressure and liquid at rest has its pressure exactly. They are where the gradient has them,
    along ``lean``. With surface tension they have the
    pressure of the surface instead, so that one of constant curvature drives no current. Without them the particle's
    pressure is zero (Dirichlet), eliminated symmetrically.

    Parameters
    ----------
    position : (n, 3) float64, m
    kind, surface : (n,) int8
    lean : (rows, 3) float64
        As in `moments`; used in the surface.
    link_force : (n, 3) float64, m/s2
        f of fluid particles, for links among them.
    wall_force : (n, 3) float64, m/s2
        f of fluid particles, for links to walls.
    source : (rows,) float64, 1/s2
        s: divergence over the time step, with the volume term.
    pressure : (n,) float64, Pa
        Of the step before.
    column : (n,) int32
        Column of each particle of the halo.
    first, last, other
        Neighbour lists.
    strength : (pairs,) float32, 1/m2
        W / r_ij^2 with the radius of the Laplacian, as made by `strengths`.
    l0 : float
        Spacing, m.
    n0, lam : float
        Lattice constants of that radius.
    dimension : int
    density : float
        rho, kg/m3, or the reference density of ``volume``.
    wall_share : float
    surface_distance : float
        From surface particles to the free surface, m.
    ghost : bool
    row_first : (rows + 1,) int32
        Filled: where each row begins.
    columns, values : (capacity,) int32 and float64
        Filled: the matrix among this rank's rows, with local columns.
    halo_first, halo_columns, halo_values
        Filled: the rest of the matrix, with the columns of ``column``.
    at_diagonal : (rows,) int32
        Filled: where in ``values`` the diagonal is.
    rhs : (rows,) float64
        Filled.
    fluid : None or (n,) int8
        Number of each particle's liquid, that of the liquid next to it for a wall; None for a single liquid.
    volume, share, tension
        Tables of `Liquids`.
    bend : None or (n,) float64, 1/m
        Curvature of the interface near each particle, positive where its own liquid is convex; None without
        surface tension.
    mass_density : None or (n,) float64, kg/m3
        Density of each particle, instead of ``fluid`` and the tables: a link's specific volume is 2 / (rho_i + rho_j)
        of these, and no body force may be balanced on it.
    above : None or (n,) float64, Pa
        Pressure on the free surface above its particles; None for zero.
    """
    scale = 2.0 * dimension / (n0 * lam * l0 * l0)
    rows = rhs.shape[0]
    count = beyond = np.uint64(0)  # unsigned, as all indices here: a negative one would count from the end, at a cost
    row_first[0] = halo_first[0] = 0
    for i in range(rows):
        if kind[i] == 3 or (surface[i] != 0 and not ghost):
            columns[count], values[count] = i, scale * n0
            at_diagonal[i] = count
            count += np.uint64(1)
            rhs[i] = 0.0
            row_first[i + 1], halo_first[i + 1] = count, beyond
            continue
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        at_diagonal[i] = count
        count += np.uint64(1)
        diagonal = flux = jumps = held = 0.0
        own = 1.0
        mine = its = 0
        if fluid is not None:
            mine = fluid[i]
            own = volume[mine, mine]
        if mass_density is not None:
            own = density / mass_density[i]
        liquid = kind[i] == 0
        hx, hy, hz = link_force[i, 0], link_force[i, 1], link_force[i, 2]
        for k in range(first[i], last[i]):
            s = strength[k]
            if s == 0.0:
                continue
            j = other[k]
            dx, dy, dz = position[j, 0] - x, position[j, 1] - y, position[j, 2] - z
            w = s * (dx * dx + dy * dy + dz * dz)
            if fluid is not None:
                its = fluid[j]
            if liquid and kind[j] == 0:
                a = 0.5
                if fluid is not None:
                    a = share[mine, its]
                b = 1.0 - a
                fx, fy, fz = a * hx + b * link_force[j, 0], a * hy + b * link_force[j, 1], a * hz + b * link_force[j, 2]
                flux += w * (fx * dx + fy * dy + fz * dz)
            else:
                w *= wall_share
                f = i if liquid else j
                flux += w * (wall_force[f, 0] * dx + wall_force[f, 1] * dy + wall_force[f, 2] * dz)
            if fluid is not None:
                w *= volume[mine, its]
                if tension is not None and mine != its:
                    jumps += w * pressure_jump(tension[mine, its], bend[i], bend[j])
            if mass_density is not None:
                w *= 2.0 * density / (mass_density[i] + mass_density[j])
            diagonal += w
            if not ghost and surface[j] != 0:
                continue
            if j < rows:
                columns[count], values[count] = j, -scale * w
                count += np.uint64(1)
            else:
                halo_columns[beyond], halo_values[beyond] = column[j], -scale * w
                beyond += np.uint64(1)
        if surface[i] != 0:
            total = mx = my = mz = 0.0
            for k in range(first[i], first[i + 1]):
                j = other[k]
                dx, dy, dz = position[j, 0] - x, position[j, 1] - y, position[j, 2] - z
                w = strength[k] * (dx * dx + dy * dy + dz * dz)
                total += w
                mx -= w * dx
                my -= w * dy
                mz -= w * dz
            missing = math.sqrt(mx * mx + my * my + mz * mz)
            w = own * max(missing / surface_distance, n0 - total)
            diagonal += w
            if above is not None:
                jumps -= w * above[i]
            qx, qy, qz = lean[i, 0], lean[i, 1], lean[i, 2]
            size = math.sqrt(qx * qx + qy * qy + qz * qz)
            if size > 0.0:
                flux += missing / size * (hx * qx + hy * qy + hz * qz)
        if kind[i] != 0:
            # Weak links come and go with every step; with the diagonal following them down to nothing, the
            # preconditioner of an earlier step would magnify these rows. So they are held at the last
            # pressure. A dry wall particle has no links, and no pressure.
            if 0.0 < diagonal < own * WEAKEST_WALL:
                held = scale * (own * WEAKEST_WALL - diagonal) * pressure[i]
            diagonal = max(diagonal, own * WEAKEST_WALL)
        elif diagonal == 0.0:  # a fluid particle alone
            diagonal = own * n0
        columns[at_diagonal[i]], values[at_diagonal[i]] = i, scale * diagonal
        rhs[i] = held - scale * jumps - density * (source[i] + scale * flux)
        row_first[i + 1], halo_first[i + 1] = count, beyond


@compiled
def release_surface(surface, above, rows, pressure):
    """Take the tension of particles of the free surface, below what surface tension makes there.

    Parameters
    ----------
    surface : (n,) int8
    above : None or (n,) float64, Pa
        As in `poisson_rows`.
    rows : int
    pressure : (n,) float64, Pa
        Changed.
    """
    for i in range(rows):
        if surface[i] != 0:
            least = 0.0
            if above is not None:
                least = min(above[i], 0.0)
            pressure[i] = max(pressure[i], least)


@compiled
def row_sums(first, values, halo_first, halo_values, out):
    """Add up each row of a matrix in two blocks.

    Parameters
    ----------
    first, values, halo_first, halo_values
        As filled by `poisson_rows`.
    out : (rows,) float64
        Filled.
    """
    for i in range(out.shape[0]):
        total = 0.0
        for k in range(first[i], first[i + 1]):
            total += values[k]
        for k in range(halo_first[i], halo_first[i + 1]):
            total += halo_values[k]
        out[i] = total


@compiled
def sort_rows(first, columns, values):
    """Sort the entries of each row by their columns.

    Parameters
    ----------
    first : (rows + 1,) int32
    columns, values : (capacity,) int32 and float64
        Compressed rows; changed.
    """
    for i in range(first.shape[0] - 1):
        for k in range(first[i] + 1, first[i + 1]):
            column, value, m = columns[k], values[k], k
            while m > first[i] and columns[m - 1] > column:
                columns[m], values[m] = columns[m - 1], values[m - 1]
                m -= 1
            columns[m], values[m] = column, value
