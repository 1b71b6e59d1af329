"""Number density, asymmetry and moments of the neighbourhood: all that depends on positions alone."""

import math

import numpy as np
from numba import njit

from parmps.kernels.compiled import added_together, compiled
from parmps.kernels.weight import smooth_weight, spline_weight

ABREAST = 1e-6
"""In radii; walls that are so little behind a particle are beside it, which rounding must not decide."""


@compiled
def wet_walls(position, normal, first, last, other, strength, l0, begin, end, wet):
    """Tell how far walls are under the surface: dry ones have all of their liquid on one side, and none near.

    A wall particle in line with the surface row has one of its particles a spacing away, one above it has none nearer
    than 1.4 spacings. Neither have those of a corner under water, but their liquid is in front of them.

    Parameters
    ----------
    position : (n, 3) float64, m
    normal : (n, 3) float64
        Of walls, into the liquid.
    first, last, other
        Neighbour lists.
    strength : (pairs,) float32, 1/m2
        W / r_ij^2, as made by `strengths`.
    l0 : float
        Spacing, m.
    begin, end : int
        Range of the wall particles.
    wet : (n,) float64
        Filled for these: from 0, dry, to 1, wet.
    """
    for i in range(begin, end):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        n = tx = ty = tz = 0.0
        nearest = math.inf
        for k in range(first[i], last[i]):
            j, s = other[k], strength[k]
            dx, dy, dz = position[j, 0] - x, position[j, 1] - y, position[j, 2] - z
            r = math.sqrt(dx * dx + dy * dy + dz * dz)
            nearest = min(nearest, r)
            s *= r
            n += s * r
            front = dx * normal[i, 0] + dy * normal[i, 1] + dz * normal[i, 2]
            tx += s * (dx - front * normal[i, 0])
            ty += s * (dy - front * normal[i, 1])
            tz += s * (dz - front * normal[i, 2])
        share = math.sqrt(tx * tx + ty * ty + tz * tz) / max(n, 1e-300)
        found = max((0.55 - share) / 0.25, (1.35 - nearest / l0) / 0.25)
        wet[i] = min(max(found, 0.0), 1.0) if n > 0.0 else 0.0


@compiled
def moments(position, wet, first, last, other, strength, l0, n0, dimension, density, asymmetry, lean, matrix):
    """Sum the weights around each particle of the rows.

    Parameters
    ----------
    position : (n, 3) float64, m
    wet : (n,) float64
        Share with which neighbours count in the number density, the asymmetry and the lean: dry walls do not.
    first, last, other
        Neighbour lists, as made by `find_pairs`.
    strength : (pairs,) float32, 1/m2
        W / r_ij^2, as made by `strengths`.
    l0 : float
        Spacing, m.
    n0 : float
        Lattice number density.
    dimension : int
    density : (rows,) float64
        Filled: n_i = sum W ([004], number density).
    asymmetry : (rows, 3) float64
        Filled: F_i = D/n0 sum W (r_i - r_j)/r_ij ([002] eq. 13).
    lean : (rows, 3) float64
        Filled: -sum W (r_j - r_i)/r_ij^2, in 1/spacings, over fluid and wet wall particles: what the missing
        neighbours would add. Next to a wall it is upright like elsewhere in the surface, since dry walls do not count.
    matrix : (rows, 6) float64
        Filled: D/n0 sum W (r_j - r_i)(r_j - r_i)^T / r_ij^2, as xx, xy, xz, yy, yz, zz, over fluid and wall
        particles; the identity on the lattice (Duan 2018).
    """
    scale = dimension / n0
    for i in range(density.shape[0]):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        n = fx = fy = fz = qx = qy = qz = 0.0
        xx = xy = xz = yy = yz = zz = 0.0
        for k in range(first[i], last[i]):
            j, s = other[k], strength[k]
            dx, dy, dz = position[j, 0] - x, position[j, 1] - y, position[j, 2] - z
            r2 = dx * dx + dy * dy + dz * dz
            share = wet[j]
            n += share * s * r2
            r = share * math.sqrt(r2)
            sx, sz = s * dx, s * dz
            fx -= r * sx
            fz -= r * sz
            qx -= share * sx
            qz -= share * sz
            xx += sx * dx
            xz += sx * dz
            zz += sz * dz
            if dimension == 3:
                sy = s * dy
                fy -= r * sy
                qy -= share * sy
                xy += sx * dy
                yy += sy * dy
                yz += sy * dz
        for k in range(last[i], first[i + 1]):
            j = other[k]
            dx, dy, dz = position[j, 0] - x, position[j, 1] - y, position[j, 2] - z
            r2 = dx * dx + dy * dy + dz * dz
            n += strength[k] * r2
            s = strength[k] * math.sqrt(r2)
            fx -= s * dx
            fy -= s * dy
            fz -= s * dz
        density[i] = n
        asymmetry[i, 0], asymmetry[i, 1], asymmetry[i, 2] = scale * fx, scale * fy, scale * fz
        lean[i, 0], lean[i, 1], lean[i, 2] = l0 * qx, l0 * qy, l0 * qz
        matrix[i, 0], matrix[i, 1], matrix[i, 2] = scale * xx, scale * xy, scale * xz
        matrix[i, 3], matrix[i, 4], matrix[i, 5] = scale * yy, scale * yz, scale * zz


@compiled
def rotate(a, v, p, q):
    """Turn the pair (p, q) of a symmetric matrix so that a[p, q] vanishes (Jacobi rotation).

    Parameters
    ----------
    a, v : (3, 3) float64
        The matrix, and the product of the rotations so far; both are changed.
    p, q : int
    """
    if a[p, q] == 0.0:
        return
    theta = (a[q, q] - a[p, p]) / (2.0 * a[p, q])
    t = 1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0))
    if theta < 0.0:
        t = -t
    c = 1.0 / math.sqrt(t * t + 1.0)
    s = t * c
    for k in range(3):
        a[k, p], a[k, q] = c * a[k, p] - s * a[k, q], s * a[k, p] + c * a[k, q]
    for k in range(3):
        a[p, k], a[q, k] = c * a[p, k] - s * a[q, k], s * a[p, k] + c * a[q, k]
        v[k, p], v[k, q] = c * v[k, p] - s * v[k, q], s * v[k, p] + c * v[k, q]


@compiled
def _inverse_with_floor(xx, xy, xz, yy, yz, zz, floor):
    """Inverse of a symmetric matrix, its eigenvalues raised to ``floor`` at least: six floats, as `inverse_of`."""
    a, v = np.empty((3, 3)), np.zeros((3, 3))
    a[0, 0], a[0, 1], a[0, 2] = xx, xy, xz
    a[1, 0], a[1, 1], a[1, 2] = xy, yy, yz
    a[2, 0], a[2, 1], a[2, 2] = xz, yz, zz
    v[0, 0] = v[1, 1] = v[2, 2] = 1.0
    for _ in range(5):  # converges quadratically
        rotate(a, v, 0, 2)
        rotate(a, v, 0, 1)
        rotate(a, v, 1, 2)
    ex, ey, ez = 1.0 / max(a[0, 0], floor), 1.0 / max(a[1, 1], floor), 1.0 / max(a[2, 2], floor)
    return (
        ex * v[0, 0] * v[0, 0] + ey * v[0, 1] * v[0, 1] + ez * v[0, 2] * v[0, 2],
        ex * v[0, 0] * v[1, 0] + ey * v[0, 1] * v[1, 1] + ez * v[0, 2] * v[1, 2],
        ex * v[0, 0] * v[2, 0] + ey * v[0, 1] * v[2, 1] + ez * v[0, 2] * v[2, 2],
        ex * v[1, 0] * v[1, 0] + ey * v[1, 1] * v[1, 1] + ez * v[1, 2] * v[1, 2],
        ex * v[1, 0] * v[2, 0] + ey * v[1, 1] * v[2, 1] + ez * v[1, 2] * v[2, 2],
        ex * v[2, 0] * v[2, 0] + ey * v[2, 1] * v[2, 1] + ez * v[2, 2] * v[2, 2],
    )


@njit(inline="always")
def inverse_of(xx, xy, xz, yy, yz, zz, floor, dimension):
    """Inverse of a moment matrix, its eigenvalues raised to ``floor`` at least.

    Where neighbours are few, the correction would magnify noise, and the pressure would feed energy to the
    liquid next to a ragged surface; with bounded eigenvalues it does not.

    Parameters
    ----------
    xx, xy, xz, yy, yz, zz : float
        As in `moments`.
    floor : float
    dimension : int
        In 2D the y axis takes no part.

    Returns
    -------
    xx, xy, xz, yy, yz, zz : float
    """
    if dimension == 2:
        yy = 1.0
    cxx = yy * zz - yz * yz
    cxy = xz * yz - xy * zz
    cxz = xy * yz - xz * yy
    determinant = xx * cxx + xy * cxy + xz * cxz
    sx, sy, sz = xx - floor, yy - floor, zz - floor
    minor = sx * sy - xy * xy
    last = sz * minor + xy * (xz * yz) + xz * (xy * yz) - sx * yz * yz - sy * xz * xz
    if sx >= 0.0 and minor >= 0.0 and last >= 0.0:  # no eigenvalue is below the floor (Sylvester)
        return (
            cxx / determinant,
            cxy / determinant,
            cxz / determinant,
            (xx * zz - xz * xz) / determinant,
            (xy * xz - xx * yz) / determinant,
            (xx * yy - xy * xy) / determinant,
        )
    return _inverse_with_floor(xx, xy, xz, yy, yz, zz, floor)


@njit(inline="always")
def times(m, x, y, z):
    """Product of a symmetric matrix, given as `inverse_of` gives it, and a vector: three floats."""
    return m[0] * x + m[1] * y + m[2] * z, m[1] * x + m[3] * y + m[4] * z, m[2] * x + m[4] * y + m[5] * z


@compiled
def invert(matrix, floor, dimension, inverse):
    """Invert the moment matrices, as `inverse_of` does.

    Parameters
    ----------
    matrix : (rows, 6) float64
        As in `moments`.
    floor : float
    dimension : int
    inverse : (rows, 6) float64
        Filled; may be ``matrix`` itself.
    """
    for i in range(matrix.shape[0]):
        xx, xy, xz = matrix[i, 0], matrix[i, 1], matrix[i, 2]
        yy, yz, zz = matrix[i, 3], matrix[i, 4], matrix[i, 5]
        m = inverse_of(xx, xy, xz, yy, yz, zz, floor, dimension)
        inverse[i, 0], inverse[i, 1], inverse[i, 2] = m[0], m[1], m[2]
        inverse[i, 3], inverse[i, 4], inverse[i, 5] = m[3], m[4], m[5]


@added_together
def _sum_bells(candidates, count, x, y, z, reach, walls):
    """Sum of `smooth_weight` over the first candidates; of walls, over those that face the particle."""
    total = 0.0
    for k in range(count):
        dx, dy, dz = x - candidates[0, k], y - candidates[1, k], z - candidates[2, k]
        bell = smooth_weight(math.sqrt(dx * dx + dy * dy + dz * dz), reach)
        if walls:
            front = dx * candidates[3, k] + dy * candidates[4, k] + dz * candidates[5, k]
            bell = bell if front > ABREAST * reach else 0.0
        total += bell
    return total


@compiled
def _copy(values, out):
    for k in range(len(values)):
        out[k] = values[k]


@compiled
def _bring_together(group, cell, low, high, shape, start, at, facing, count, candidates):
    """Append the particles of one kind around a cell to the candidates of `_sum_bells`, in a larger array if needed."""
    for a in range(max(cell[0] - 1, 0), min(cell[0] + 2, shape[0])):
        for b in range(max(cell[1] - 1, 0), min(cell[1] + 2, shape[1])):
            line = ((group * shape[0] + a) * shape[1] + b) * shape[2]
            begin, end = np.int64(start[line + low]), np.int64(start[line + high])
            new = slice(count, count + end - begin)
            if new.stop > candidates.shape[1]:
                larger = np.empty((6, 2 * new.stop))
                larger[:, :count] = candidates[:, :count]
                candidates = larger
            for d in range(3):
                _copy(at[d, begin:end], candidates[d, new])
                if group > 0:
                    _copy(facing[d, begin:end], candidates[3 + d, new])
            count = new.stop
    return count, candidates


@compiled
def smooth_density(skip, normal, reach, lower, size, shape, start, order, at, beside, density):
    """Sum the smooth weight around fluid particles, themselves included, over the fluid and the walls that face them.

    What may be near the particles of a cell is brought together once. To sum over all of it, several at a time, takes
    less than to pick the neighbours first.

    Parameters
    ----------
    skip : (n,) int8
        Particles that are marked are left out.
    normal : (n, 3) float64
        Of walls and dummies, into the liquid; baffles hide nothing else.
    reach : float
        Radius of the weight, m.
    lower, size, shape, start, order, at, beside
        As in `find_pairs`.
    density : (rows,) float64
        Filled, but for those left out and those out of the tank.
    """
    rows, span = density.shape[0], int(reach / size[2]) + 1
    candidates = np.empty((6, 0))
    facing = np.empty((3, len(order)))
    for k in range(start[shape[0] * shape[1] * shape[2]], start[-1]):
        for d in range(3):
            facing[d, k] = normal[order[k], d]
    for cx in range(shape[0]):
        for cy in range(shape[1]):
            for cz in range(shape[2]):
                cell = (cx * shape[1] + cy) * shape[2] + cz
                mine = order[start[cell] : start[cell + 1]]
                wanted = False
                for i in mine:
                    wanted |= i < rows and skip[i] == 0
                if not wanted:
                    continue
                low, high = max(cz - span, 0), min(cz + span + 1, shape[2])
                for walls in range(2 if beside[cx, cy, cz] else 1):
                    count = 0
                    for group in range(1, 3) if walls else range(1):
                        count, candidates = _bring_together(
                            group, (cx, cy, cz), low, high, shape, start, at, facing, count, candidates
                        )
                    for k in range(len(mine)):
                        i, m = mine[k], start[cell] + k
                        if i < rows and skip[i] == 0:
                            total = _sum_bells(candidates, count, at[0, m], at[1, m], at[2, m], reach, walls == 1)
                            density[i] = total if walls == 0 else density[i] + total


@compiled
def mark_surface(density, asymmetry, n0, threshold, surface):
    """Tell the particles of the free surface ([004] eq. 17 and the density window below it).

    A particle of n <= 0.8 n0 is in the surface, one of n >= 0.97 n0 is not; between them it is where the
    asymmetry |F| exceeds 0.9 |F|0.

    Parameters
    ----------
    density : (rows,) float64
    asymmetry : (rows, 3) float64
    n0 : float
    threshold : float
        0.9 |F|0.
    surface : (n,) int8
        Filled for the rows: 1 in the surface, 0 elsewhere.
    """
    for i in range(density.shape[0]):
        n = density[i] / n0
        f2 = asymmetry[i, 0] ** 2 + asymmetry[i, 1] ** 2 + asymmetry[i, 2] ** 2
        surface[i] = n <= 0.8 or (n < 0.97 and f2 > threshold * threshold)


@compiled
def mark_uncovered(position, normal, wet, asymmetry, threshold, first, last, other, rows, surface):
    """Count particles that none covers among those of the free surface (after Marrone 2010).

    One in the corner between wall and surface may be squeezed until its asymmetry is too small, and a row that is
    squeezed along the surface is as dense as the inside, and far from the next. What covers a particle is a neighbour
    within 60 degrees of the way out; a wall, only where the way out is within 60 degrees of the way into it: one that
    stands beside a particle covers nothing above it.

    Parameters
    ----------
    position : (n, 3) float64, m
    normal : (n, 3) float64
        Of walls, into the liquid; 0 for liquid.
    wet : (n,) float64
        Dry walls cover none.
    asymmetry : (rows, 3) float64
        Tells the way out.
    threshold : float
        Least asymmetry that does.
    first, last, other
        Neighbour lists.
    rows : int
    surface : (n,) int8
        Set to 1 for those.
    """
    for i in range(rows):
        mx, my, mz = asymmetry[i, 0], asymmetry[i, 1], asymmetry[i, 2]
        size = math.sqrt(mx * mx + my * my + mz * mz)
        if surface[i] != 0 or size < threshold:
            continue
        covered = False
        for k in range(first[i], last[i]):
            j = other[k]
            dx, dy = position[j, 0] - position[i, 0], position[j, 1] - position[i, 1]
            dz = position[j, 2] - position[i, 2]
            r = math.sqrt(dx * dx + dy * dy + dz * dz)
            into = -(mx * normal[j, 0] + my * normal[j, 1] + mz * normal[j, 2])
            faces = into > 0.5 * size or (normal[j, 0] == 0.0 and normal[j, 1] == 0.0 and normal[j, 2] == 0.0)
            if wet[j] > 0.5 and faces and dx * mx + dy * my + dz * mz > 0.5 * size * r:
                covered = True
                break
        if not covered:
            surface[i] = 1


@compiled
def mark_enclosed(kind, surface, first, last, other, rows, enclosed):
    """Tell the particles beside walls that neither are of the free surface nor have a neighbour that is.

    Parameters
    ----------
    kind, surface : (n,) int8
    first, last, other
        Neighbour lists: walls come after the liquid.
    rows : int
    enclosed : (rows,) int8
        Filled.
    """
    for i in range(rows):
        enclosed[i] = 0
        if surface[i] != 0 or last[i] == first[i] or kind[other[last[i] - 1]] == 0:
            continue
        enclosed[i] = 1
        for k in range(first[i], last[i]):
            if surface[other[k]] != 0:
                enclosed[i] = 0
                break


@compiled
def mark_dry(kind, first, other, begin, end, surface):
    """Count wall particles that no liquid is near to those of the free surface, whose pressure is zero.

    Parameters
    ----------
    kind : (n,) int8
    first, other
        Neighbour lists.
    begin, end : int
        Range of the wall particles.
    surface : (n,) int8
        Set to 1 for the dry ones.
    """
    for i in range(begin, end):
        dry = True
        for k in range(first[i], first[i + 1]):
            if kind[other[k]] == 0:
                dry = False
                break
        if dry:
            surface[i] = 1


@compiled
def spread(flag, first, other, rows, out):
    """Mark the particles that are marked or have a marked neighbour.

    Parameters
    ----------
    flag : (n,) int8
    first, other
        Neighbour lists.
    rows : int
    out : (n,) int8
        Filled for the rows.
    """
    for i in range(rows):
        out[i] = flag[i]
        for k in range(first[i], first[i + 1]):
            if flag[other[k]] != 0:
                out[i] = 1
                break


@compiled
def surface_normals(position, asymmetry, surface, first, last, other, strength, rows, lean, out):
    """Normal of the free surface near each particle: the weighted mean of the asymmetry of its neighbours in it.

    The tangential part of what is missing is noise of each particle's neighbourhood. It is taken from the lean of
    surface particles, but not where the two differ by more than 60 degrees, as in sheets and spray, which no normal
    describes.

    Parameters
    ----------
    position : (n, 3) float64, m
    asymmetry : (n, 3) float64
    surface : (n,) int8
        0 for walls.
    first, last, other
        Neighbour lists.
    strength : (pairs,) float32, 1/m2
        W / r_ij^2, as made by `strengths`.
    rows : int
    lean : (rows, 3) float64
        As in `moments`; changed.
    out : (rows, 3) float64
        Filled: a unit vector out of the liquid, or 0 away from the surface.
    """
    for i in range(rows):
        nx = ny = nz = 0.0
        if surface[i] != 0:
            nx, ny, nz = asymmetry[i, 0], asymmetry[i, 1], asymmetry[i, 2]
        for k in range(first[i], last[i]):
            j = other[k]
            if surface[j] == 0:
                continue
            dx = position[j, 0] - position[i, 0]
            dy = position[j, 1] - position[i, 1]
            dz = position[j, 2] - position[i, 2]
            w = strength[k] * (dx * dx + dy * dy + dz * dz)
            nx += w * asymmetry[j, 0]
            ny += w * asymmetry[j, 1]
            nz += w * asymmetry[j, 2]
        size = math.sqrt(nx * nx + ny * ny + nz * nz)
        if size > 0.0:
            nx, ny, nz = nx / size, ny / size, nz / size
        out[i, 0], out[i, 1], out[i, 2] = nx, ny, nz
        if surface[i] != 0:
            along = lean[i, 0] * nx + lean[i, 1] * ny + lean[i, 2] * nz
            size = math.sqrt(lean[i, 0] ** 2 + lean[i, 1] ** 2 + lean[i, 2] ** 2)
            if along > 0.5 * size:
                lean[i, 0], lean[i, 1], lean[i, 2] = along * nx, along * ny, along * nz


@compiled
def row_density(position, kind, surface, normal, first, other, l0, reach, full, rows):
    """Density of the row of particles below the free surface, over that of the lattice, where it is a row.

    Half of it times the spacing is how far the surface is above the row: one that has lost particles to the next
    is thinner. Sums a spline over the distances along the surface; walls continue the row.

    Parameters
    ----------
    position : (n, 3) float64, m
    kind, surface : (n,) int8
    normal : (rows, 3) float64
        As made by `surface_normals`.
    first, other
        Neighbour lists.
    l0 : float
        Spacing, m.
    reach : float
        Radius of the spline, in spacings.
    full : float
        Its sum over a row of the lattice.
    rows : int

    Returns
    -------
    float
        Sum over the particles of a row whose density is within a quarter of the lattice's: spray has none.
    int
        Their number.
    """
    density, count = 0.0, 0
    for i in range(rows):
        if surface[i] == 0:
            continue
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        total = spline_weight(0.0, reach)
        for k in range(first[i], first[i + 1]):
            j = other[k]
            if kind[j] == 0 and surface[j] == 0:
                continue
            dx, dy, dz = position[j, 0] - x, position[j, 1] - y, position[j, 2] - z
            up = dx * normal[i, 0] + dy * normal[i, 1] + dz * normal[i, 2]
            along = math.sqrt(max(dx * dx + dy * dy + dz * dz - up * up, 0.0)) / l0
            up = abs(up) / l0
            # a row of liquid may be rough; of walls, which stand in many rows, one counts
            share = min(2.0 - 2.0 * up, 1.0) if kind[j] == 0 else 1.0 - up
            total += max(share, 0.0) * spline_weight(along, reach)
        if abs(total / full - 1.0) < 0.25:
            density += total / full
            count += 1
    return density, count


def lattice_matrix(rows):
    """Moment matrices of the lattice, for the operators without correction.

    Parameters
    ----------
    rows : int

    Returns
    -------
    (rows, 6) float64
        Identity matrices, as xx, xy, xz, yy, yz, zz.
    """
    return np.tile([1.0, 0.0, 0.0, 1.0, 0.0, 1.0], (rows, 1))
