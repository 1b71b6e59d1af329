"""Viscosity: the explicit step, and the rows of the linear system of an implicit one."""

from numba import njit

from parmps.kernels.compiled import compiled
from parmps.kernels.velocity import ghost_ratio


@njit(inline="always")
def _link(i, j, k, position, kind, normal, depth, strength, l0):
    """Weight of a link of fluid particle i; a wall's velocity is a multiple of the fluid's, which the weight holds."""
    dx = position[j, 0] - position[i, 0]
    dy = position[j, 1] - position[i, 1]
    dz = position[j, 2] - position[i, 2]
    w = strength[k] * (dx * dx + dy * dy + dz * dz)
    if kind[j] != 0:
        height = -(dx * normal[j, 0] + dy * normal[j, 1] + dz * normal[j, 2]) - depth[j]
        w *= 1.0 + ghost_ratio(depth[j], height, l0)
    return w


@njit(inline="always")
def _between(i, j, kind, viscosity, fluid):
    """Kinematic viscosity of fluid particle i in its interaction with j: its own one at a wall."""
    if fluid is None:
        return viscosity[0, 0]
    return viscosity[fluid[i], fluid[j] if kind[j] == 0 else fluid[i]]


@compiled
def add_viscosity(
    position,
    velocity,
    kind,
    normal,
    depth,
    viscosity,
    first,
    last,
    other,
    strength,
    l0,
    n0,
    lam,
    dimension,
    dt,
    rows,
    out,
    fluid=None,
):
    """Add dt nu lap v, lap v = 2D/(n0 lambda) sum (v_j - v_i) W ([004] eq. 7), with no slip at the walls.

    A wall particle has the velocity that makes the one of the fluid particle vanish linearly at the wall's
    surface (Morris 1997).

    Parameters
    ----------
    position, velocity : (n, 3) float64, m and m/s
    kind : (n,) int8
    normal, depth
        Of the walls, as in `reflect_at_walls`.
    viscosity : (liquids, liquids) float64
        Kinematic, m2/s, as in `Liquids`.
    first, last, other
        Neighbour lists.
    strength : (pairs,) float64, 1/m2
        W / r_ij^2, as made by `strengths`.
    l0 : float
        Spacing, m.
    n0, lam : float
        Lattice constants of the radius.
    dimension : int
    dt : float
        s.
    rows : int
    out : (n, 3) float64, m/s
        Velocity that is added to, for the rows.
    fluid : None or (n,) int8
        As in `poisson_rows`.
    """
    scale = dt * 2.0 * dimension / (n0 * lam * l0 * l0)
    for i in range(rows):
        ax = ay = az = 0.0
        for k in range(first[i], last[i]):
            j = other[k]
            w = scale * _link(i, j, k, position, kind, normal, depth, strength, l0)
            w *= _between(i, j, kind, viscosity, fluid)
            if kind[j] == 0:
                ax += w * (velocity[j, 0] - velocity[i, 0])
                ay += w * (velocity[j, 1] - velocity[i, 1])
                az += w * (velocity[j, 2] - velocity[i, 2])
            else:
                ax -= w * velocity[i, 0]
                ay -= w * velocity[i, 1]
                az -= w * velocity[i, 2]
        out[i, 0] += ax
        out[i, 1] += ay
        out[i, 2] += az


@compiled
def viscosity_rows(
    position,
    kind,
    normal,
    depth,
    viscosity,
    density,
    column,
    first,
    last,
    other,
    strength,
    l0,
    n0,
    lam,
    dimension,
    dt,
    row_first,
    columns,
    values,
    halo_first,
    halo_columns,
    halo_values,
    fluid=None,
):
    """Assemble rho (I - dt nu lap) with the operator of `add_viscosity`: symmetric, and no slip in the diagonal.

    The density makes the rows of two liquids symmetric, since rho_i nu_ij is their dynamic viscosity. Walls are no
    unknowns; their rows, and those of particles out of the tank, have the diagonal alone.

    Parameters
    ----------
    position, kind, normal, depth, viscosity, first, last, other, strength, l0, n0, lam, dimension, dt, fluid
        As in `add_viscosity`.
    density : (liquids,) float64
        In any unit.
    column : (n,) int32
        Column of each particle of the halo.
    row_first, columns, values, halo_first, halo_columns, halo_values
        Filled: the matrix in two blocks, as by `poisson_rows`.
    """
    scale = dt * 2.0 * dimension / (n0 * lam * l0 * l0)
    rows = row_first.shape[0] - 1
    count = beyond = 0
    row_first[0] = halo_first[0] = 0
    for i in range(rows):
        own = density[0] if fluid is None else density[fluid[i]]
        diagonal = own
        at_diagonal = count
        count += 1
        for k in range(first[i], last[i] if kind[i] == 0 else first[i]):
            if strength[k] == 0.0:
                continue
            j = other[k]
            w = own * scale * _link(i, j, k, position, kind, normal, depth, strength, l0)
            w *= _between(i, j, kind, viscosity, fluid)
            diagonal += w
            if kind[j] != 0:
                continue
            if j < rows:
                columns[count], values[count] = j, -w
                count += 1
            else:
                halo_columns[beyond], halo_values[beyond] = column[j], -w
                beyond += 1
        columns[at_diagonal], values[at_diagonal] = i, diagonal
        row_first[i + 1], halo_first[i + 1] = count, beyond
