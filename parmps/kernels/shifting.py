"""Motion of the particles, with shifting and the walls' limits."""

import math

import numpy as np
from numba import njit

from parmps.kernels.compiled import compiled
from parmps.kernels.energy import SHIFTING, SURFACE, WALLS, WORK, work_along
from parmps.kernels.walls import beside_solid, wall_distance

BEYOND = 1.0
"""How far the velocity gradient of a surface particle is extrapolated towards the surface, over how far it is from
there to the mean of its neighbours below. On the lattice, in waves of 20 spacings and more, 0.95 to 1.1."""
SMOOTH = 0.25
"""Share of what the gradient alone gives up to which what the extrapolation adds is believed; none of it at twice that.
In a wave of 16 spacings it adds as much. Where a jet leaves a wall it adds more than there was, and that is no flow
but the difference of two neighbourhoods: volume grows."""


@njit(inline="always")
def carried(g, x, y, z):
    """Velocity difference over a distance, by a gradient."""
    return (
        g[0] * x + g[1] * y + g[2] * z,
        g[3] * x + g[4] * y + g[5] * z,
        g[6] * x + g[7] * y + g[8] * z,
    )


@njit(inline="always")
def velocity_above(i, kind, surface, gradient, x, y, z, first, last, other, strength, change):
    """How much faster than a surface particle the liquid above it is, from its velocity gradient and those below.

    The own gradient is fitted to what is below, and in a wave is that of 0.36 spacings below the particle; the mean
    over the neighbours that are not of the surface is that of 1.02 spacings below. What the difference adds is left
    out where it is not small: there the flow changes within a spacing.

    Parameters
    ----------
    i : int
        The particle.
    kind, surface : (n,) int8
    gradient : (n, 9) float64, 1/s
    x, y, z : float
        From the particle to the place above it, m.
    first, last, other
        Neighbour lists.
    strength : (pairs,) float32, 1/m2
        W / r_ij^2, as made by `strengths`.
    change : (9,) float64, 1/s
        Room for the difference of the gradients.

    Returns
    -------
    float, float, float
        m/s.
    """
    total = 0.0
    for c in range(9):
        change[c] = 0.0
    for k in range(first[i], last[i]):
        j = other[k]
        if kind[j] == 0 and surface[j] == 0:
            total += strength[k]
            for c in range(9):
                change[c] += strength[k] * (gradient[i, c] - gradient[j, c])
    ex, ey, ez = carried(gradient[i], x, y, z)
    fx, fy, fz = carried(change, x, y, z)
    share = BEYOND / max(total, 1e-300)
    plain = math.sqrt(ex * ex + ey * ey + ez * ez)
    more = share * math.sqrt(fx * fx + fy * fy + fz * fz)
    share *= min(1.0, max(0.0, 2.0 - more / max(SMOOTH * plain, 1e-300)))
    return ex + share * fx, ey + share * fy, ez + share * fz


@compiled
def move(
    position,
    velocity,
    kind,
    asymmetry,
    surface,
    surface_normal,
    lean,
    gradient,
    l0,
    surface_lean,
    surface_distance,
    shift,
    dt,
    rows,
    beyond,
    inward,
    first,
    last,
    other,
    strength,
    fluid,
    mass,
    field,
    booked,
):
    """R += dt v + shift l0 F, tangential at the surface; surface particles move as the surface above them does.

    The asymmetry F points away from crowded neighbours, so that shifting along it evens the spacing (Lind
    2012, Khayyer 2017: along the surface only, where there is one); the velocity is interpolated to the shifted
    place.

    A surface particle goes with the velocity of the surface, which is v + d dv/dn at a distance d; with v alone the
    surface would lag by a relative k d behind a wave of wave number k, and with the gradient fitted to what is below
    the particle still by 0.6 l0 k^2 d.

    Parameters
    ----------
    position, velocity : (n, 3) float64, m and m/s
    kind, surface : (n,) int8
    asymmetry : (n, 3) float64
    surface_normal : (rows, 3) float64
        Unit normals near the surface, 0 elsewhere.
    lean : (rows, 3) float64
        As in `moments`.
    gradient : (n, 9) float64, 1/s
        Of the velocity.
    l0 : float
        Spacing, m.
    surface_lean : float
        |lean| of a particle in a flat surface.
    surface_distance : float
        From surface particles to the free surface, m.
    shift : float
        Share of the asymmetry by which particles are shifted in this step.
    dt : float
        s.
    rows : int
    beyond : None or (rows, 3) float64
        As made by `interface.moment_beyond`: particles beside another liquid move as the interface does.
    inward : None or (n,) float64
        Asymmetry along the normal that shifts surface particles all the same, as made by `surface.crowd_out`.
    first, last, other
        Neighbour lists.
    strength : (pairs,) float32, 1/m2
        W / r_ij^2, as made by `strengths`.
    fluid, mass, field, booked
        As in `energy.book_acceleration`; the way dt v is booked there.
    """
    change = np.empty(9)
    shifted = lifted = work = 0.0
    for i in range(rows):
        if kind[i] != 0:
            continue
        sx, sy, sz = shift * asymmetry[i, 0], shift * asymmetry[i, 1], shift * asymmetry[i, 2]
        nx, ny, nz = surface_normal[i, 0], surface_normal[i, 1], surface_normal[i, 2]
        along = sx * nx + sy * ny + sz * nz
        if inward is not None:
            along -= shift * inward[i]
        sx -= along * nx
        sy -= along * ny
        sz -= along * nz
        size = math.sqrt(sx * sx + sy * sy + sz * sz)
        reach = min(1.0, 0.05 / max(size, 1e-300)) * l0
        px = dt * velocity[i, 0] + reach * sx
        py = dt * velocity[i, 1] + reach * sy
        pz = dt * velocity[i, 2] + reach * sz
        g, m = gradient[i], mass[fluid[i]]
        if surface[i] != 0 or beyond is not None:
            half, towards = 0.5 * l0, beyond
            if surface[i] != 0:
                half, towards = surface_distance, lean
            x, y, z = towards[i, 0], towards[i, 1], towards[i, 2]
            size = math.sqrt(x * x + y * y + z * z)
            half *= min(size / surface_lean, 1.0) / max(size, 1e-300)
            x, y, z = half * x, half * y, half * z
            if surface[i] != 0:
                ex, ey, ez = velocity_above(
                    i, kind, surface, gradient, x, y, z, first, last, other, strength, change
                )
            else:
                ex, ey, ez = carried(g, x, y, z)
            size = dt * math.sqrt(ex * ex + ey * ey + ez * ez)
            limit = dt * min(1.0, 0.05 * l0 / max(size, 1e-300))
            ex, ey, ez = limit * ex, limit * ey, limit * ez
            px += ex
            py += ey
            pz += ez
            here = m * work_along(position[i, 0], position[i, 1], position[i, 2], field, ex, ey, ez)
            lifted -= here
            work += here
        here = m * reach * work_along(position[i, 0], position[i, 1], position[i, 2], field, sx, sy, sz)
        ex, ey, ez = carried(g, sx, sy, sz)
        u, v, w = velocity[i, 0], velocity[i, 1], velocity[i, 2]
        half = 0.5 * reach
        shifted += m * reach * (ex * (u + half * ex) + ey * (v + half * ey) + ez * (w + half * ez)) - here
        work += here
        velocity[i, 0] += reach * ex
        velocity[i, 1] += reach * ey
        velocity[i, 2] += reach * ez
        position[i, 0] += px
        position[i, 1] += py
        position[i, 2] += pz
    booked[SHIFTING] += shifted
    booked[SURFACE] += lifted
    booked[WORK] += work


@compiled
def spare_walls(position, asymmetry, kind, first, last, other, walls, least, scale, rows):
    """Take from the shift of particles beside walls what would bring them nearer to a wall than they are to stand.

    In a corner all neighbours are on one side, and nothing else would stop the shift.

    Parameters
    ----------
    position : (n, 3) float64, m
    asymmetry : (n, 3) float64
        Changed.
    kind : (n,) int8
    first, last, other
        Neighbour lists.
    walls : Walls
    least : float
        Distance from which on particles may be shifted towards a wall, m.
    scale : float
        Shift over asymmetry, m.
    rows : int
    """
    for i in range(rows):
        if kind[i] != 0 or last[i] == first[i] or kind[other[last[i] - 1]] == 0:
            continue
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        own = wall_distance(x, y, z, walls)[0]
        px, py, pz = x + scale * asymmetry[i, 0], y + scale * asymmetry[i, 1], z + scale * asymmetry[i, 2]
        moved = False
        for _ in range(3):
            d, nx, ny, nz = wall_distance(px, py, pz, walls)
            off = min(least, own) - d
            if off <= 0.0:
                break
            moved = True
            px, py, pz = px + off * nx, py + off * ny, pz + off * nz
        if moved:
            asymmetry[i, 0], asymmetry[i, 1], asymmetry[i, 2] = (px - x) / scale, (py - y) / scale, (pz - z) / scale


@compiled
def keep_off_walls(position, velocity, kind, walls, least, rows, fluid, mass, field, booked):
    """Put particles that came too near a wall, or through it, back, and take the speed towards it.

    Parameters
    ----------
    position, velocity : (n, 3) float64, m and m/s
    kind : (n,) int8
    walls : Walls
        Tank and baffles.
    least : float
        Least distance from a wall, m.
    rows : int
    fluid, mass, field, booked
        As in `energy.book_acceleration`.

    Returns
    -------
    int
        Number of particles put back.
    """
    count = 0
    low, high = walls.container[0] + least, walls.container[1] - least
    rim = walls.container[1, 2] if walls.open_top else np.inf  # above it there is no wall
    solids, planes = walls.solids, walls.planes
    flat = len(walls.rounds) + walls.field.size == 0
    for i in range(rows):
        if kind[i] != 0:
            continue
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        if z > rim:
            continue
        if flat and low[0] <= x <= high[0] and low[1] <= y <= high[1] and low[2] <= z <= high[2]:
            clear = len(solids) == 0 or not beside_solid(x, y, z, least, solids)
            for k in range(len(planes)):
                clear &= planes[k, 0] * x + planes[k, 1] * y + planes[k, 2] * z - planes[k, 3] >= least
            if clear:
                continue  # most particles
        for _ in range(3):  # in a corner, one wall after the other
            d, nx, ny, nz = wall_distance(position[i, 0], position[i, 1], position[i, 2], walls)
            if d >= least:
                break
            count += 1
            m, bx, by, bz = mass[fluid[i]], (least - d) * nx, (least - d) * ny, (least - d) * nz
            here = m * work_along(position[i, 0], position[i, 1], position[i, 2], field, bx, by, bz)
            booked[WORK] += here
            booked[WALLS] -= here
            position[i, 0] += bx
            position[i, 1] += by
            position[i, 2] += bz
            towards = velocity[i, 0] * nx + velocity[i, 1] * ny + velocity[i, 2] * nz
            if towards < 0.0:
                booked[WALLS] -= 0.5 * m * towards * towards
                velocity[i, 0] -= towards * nx
                velocity[i, 1] -= towards * ny
                velocity[i, 2] -= towards * nz
    return count
