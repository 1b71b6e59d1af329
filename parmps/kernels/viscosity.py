"""Viscosity: the explicit step, and the rows of the linear system of an implicit one."""

from numba import njit

from parmps.kernels.compiled import compiled
from parmps.kernels.velocity import ghost_ratio


@njit(inline="always")
def _reversed(dx, dy, dz, nx, ny, nz, depth, l0):
    """Velocity that a wall particle at (dx, dy, dz) lacks, over that of the fluid particle: 1 and what is beyond."""
    return 1.0 + ghost_ratio(depth, -(dx * nx + dy * ny + dz * nz) - depth, l0)


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
    fluid,
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
    strength : (pairs,) float32, 1/m2
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
    own = 0
    for i in range(rows):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        vx, vy, vz = velocity[i, 0], velocity[i, 1], velocity[i, 2]
        ax = ay = az = 0.0
        if fluid is not None:
            own = fluid[i]
        alike = viscosity[own, own]
        for k in range(first[i], last[i]):
            j = other[k]
            dx, dy, dz = position[j, 0] - x, position[j, 1] - y, position[j, 2] - z
            w = strength[k] * (dx * dx + dy * dy + dz * dz)
            if kind[j] == 0:
                w *= viscosity[own, fluid[j]] if fluid is not None and fluid[j] != own else alike
                ax += w * (velocity[j, 0] - vx)
                az += w * (velocity[j, 2] - vz)
                if dimension == 3:
                    ay += w * (velocity[j, 1] - vy)
            else:
                w *= alike
                w *= _reversed(dx, dy, dz, normal[j, 0], normal[j, 1], normal[j, 2], depth[j], l0)
                ax -= w * vx
                ay -= w * vy
                az -= w * vz
        out[i, 0] += scale * ax
        out[i, 1] += scale * ay
        out[i, 2] += scale * az


@compiled
def add_transpose(
    position,
    kind,
    gradient,
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
    fluid,
):
    """Add dt div (nu (grad v)^T): with `add_viscosity` that is the divergence of the stress 2 nu e.

    Each pair's v_j - v_i is completed by the transpose of its linear part, (G_i + G_j)^T (r_j - r_i) / 2, to twice the
    strain along r_j - r_i. Inside the liquid the sum vanishes with the divergence. At a free surface it makes the
    stress vanish instead of the normal derivative of the velocity (Colagrossi et al. 2011, Phys. Rev. E 84:026705),
    and in liquid that turns as a whole it is the opposite of what `add_viscosity` adds, pair by pair.

    Parameters
    ----------
    position, kind, viscosity, first, last, other, strength, l0, n0, lam, dimension, dt, rows, out, fluid
        As in `add_viscosity`.
    gradient : (n, 9) float64, 1/s
        G, of the fluid particles, as made by `velocity_gradient`. Walls have that of the fluid particle.
    """
    scale = dt * dimension / (n0 * lam * l0 * l0)
    own = 0
    for i in range(rows):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        sx = sy = sz = ax = ay = az = 0.0  # sums of nu W (r_j - r_i) and of nu W G_j^T (r_j - r_i)
        if fluid is not None:
            own = fluid[i]
        alike = viscosity[own, own]
        for k in range(first[i], last[i]):
            j = other[k]
            dx, dy, dz = position[j, 0] - x, position[j, 1] - y, position[j, 2] - z
            w = strength[k] * (dx * dx + dy * dy + dz * dz)
            if kind[j] != 0:
                w *= 2.0 * alike
                sx, sy, sz = sx + w * dx, sy + w * dy, sz + w * dz
                continue
            w *= viscosity[own, fluid[j]] if fluid is not None and fluid[j] != own else alike
            sx, sy, sz = sx + w * dx, sy + w * dy, sz + w * dz
            ax += w * (gradient[j, 0] * dx + gradient[j, 6] * dz)
            az += w * (gradient[j, 2] * dx + gradient[j, 8] * dz)
            if dimension == 3:
                ax += w * gradient[j, 3] * dy
                ay += w * (gradient[j, 1] * dx + gradient[j, 4] * dy + gradient[j, 7] * dz)
                az += w * gradient[j, 5] * dy
        out[i, 0] += scale * (ax + gradient[i, 0] * sx + gradient[i, 3] * sy + gradient[i, 6] * sz)
        out[i, 1] += scale * (ay + gradient[i, 1] * sx + gradient[i, 4] * sy + gradient[i, 7] * sz)
        out[i, 2] += scale * (az + gradient[i, 2] * sx + gradient[i, 5] * sy + gradient[i, 8] * sz)


@compiled
def wall_friction(
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
    begin,
    end,
    fluid,
    out,
):
    """Viscous force of the liquid on wall particles: what `add_viscosity` takes from it at the walls.

    Parameters
    ----------
    position, velocity, kind, normal, depth, first, last, other, strength, l0, n0, lam, dimension
        As in `add_viscosity`.
    viscosity : (liquids,) float64, kg m2/s
        Kinematic, times the mass of a particle (in 2D a metre of it).
    begin, end : int
        Range of the wall particles.
    fluid : (n,) int8
        Number of each particle's liquid.
    out : (end - begin, 3) float64, N, in 2D N/m
        Filled.
    """
    scale = 2.0 * dimension / (n0 * lam * l0 * l0)
    for j in range(begin, end):
        fx = fy = fz = 0.0
        for k in range(first[j], last[j]):
            i = other[k]
            if kind[i] != 0:
                continue
            dx = position[j, 0] - position[i, 0]
            dy = position[j, 1] - position[i, 1]
            dz = position[j, 2] - position[i, 2]
            w = viscosity[fluid[i]] * strength[k] * (dx * dx + dy * dy + dz * dz)
            w *= _reversed(dx, dy, dz, normal[j, 0], normal[j, 1], normal[j, 2], depth[j], l0)
            fx += w * velocity[i, 0]
            fy += w * velocity[i, 1]
            fz += w * velocity[i, 2]
        out[j - begin, 0], out[j - begin, 1], out[j - begin, 2] = scale * fx, scale * fy, scale * fz


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
    fluid,
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
    own = its = 0
    for i in range(rows):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        if fluid is not None:
            own = fluid[i]
        diagonal = density[own]
        at_diagonal = count
        count += 1
        for k in range(first[i], last[i] if kind[i] == 0 else first[i]):
            if strength[k] == 0.0:
                continue
            j = other[k]
            dx, dy, dz = position[j, 0] - x, position[j, 1] - y, position[j, 2] - z
            w = density[own] * scale * strength[k] * (dx * dx + dy * dy + dz * dz)
            if kind[j] != 0:
                w *= _reversed(dx, dy, dz, normal[j, 0], normal[j, 1], normal[j, 2], depth[j], l0)
                diagonal += w * viscosity[own, own]
                continue
            if fluid is not None:
                its = fluid[j]
            w *= viscosity[own, its]
            diagonal += w
            if j < rows:
                columns[count], values[count] = j, -w
                count += 1
            else:
                halo_columns[beyond], halo_values[beyond] = column[j], -w
                beyond += 1
        columns[at_diagonal], values[at_diagonal] = i, diagonal
        row_first[i + 1], halo_first[i + 1] = count, beyond
