"""Interfaces between liquids."""

import math

import numpy as np
from numba import njit

from parmps.kernels.compiled import compiled
from parmps.kernels.density import invert
from parmps.kernels.weight import smooth_weight, weight


@njit(inline="always")
def pressure_jump(tension, own_bend, its_bend):
    """Jump of the pressure from a particle of one liquid to one of another, sigma kappa (Young and Laplace), Pa.

    Parameters
    ----------
    tension : float, N/m
        Between the two liquids; 0 within one.
    own_bend, its_bend : float, 1/m
        Curvature of the interface at the two particles, each positive where its own liquid is convex.

    Returns
    -------
    float
    """
    return 0.5 * tension * (its_bend - own_bend)


@njit(inline="always")
def held_pressure(i, pressure, surface, above):
    """Pressure of a particle; in the surface without suction below that of the surface itself, which only noise makes.

    Parameters
    ----------
    i : int
    pressure : (n,) float64, Pa
    surface : (n,) int8
    above : None or (n,) float64, Pa
        As in `poisson_rows`.

    Returns
    -------
    float
    """
    if surface[i] == 0:
        return pressure[i]
    if above is None:
        return max(pressure[i], 0.0)
    return max(pressure[i], min(above[i], 0.0))


@njit(inline="always")
def _length(x, y, z):
    return math.sqrt(x * x + y * y + z * z)


@compiled
def label_walls(position, first, other, kind, begin, end, fluid, nearest):
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
    nearest : (rows,) int32
        Filled for the range: the particle nearest to the wall particle, -1 for none.
    """
    for i in range(begin, end):
        least = math.inf
        nearest[i] = -1
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
                nearest[i] = j


@compiled
def find_near(first, other, kind, fluid, sheet, rows, near):
    """List the liquid particles that have a neighbour on the other side of an interface.

    Parameters
    ----------
    first, other
        Neighbour lists.
    kind, fluid : (n,) int8
    sheet : (liquids, liquids) bool
        Whether the velocity can jump between two liquids.
    rows : int
    near : (rows,) int32
        Filled from the start.

    Returns
    -------
    int
        Number of such particles.
    """
    count = 0
    for i in range(rows):
        for k in range(first[i], first[i + 1]):
            j = other[k]
            if kind[j] == 0 and sheet[fluid[i], fluid[j]]:
                near[count] = i
                count += 1
                break
    return count


@compiled
def widen(first, other, kind, fraction, rows, near):
    """List the liquid particles that have a neighbour near an interface, or are near one.

    Parameters
    ----------
    first, other
        Neighbour lists.
    kind : (n,) int8
    fraction : (n,) float64
        As made by `smooth_fraction`; 1 away from interfaces.
    rows : int
    near : (rows,) int32
        Filled from the start.

    Returns
    -------
    int
        Number of such particles.
    """
    count = 0
    for i in range(rows):
        found = fraction[i] < 1.0
        for k in range(first[i], first[i + 1]):
            if kind[other[k]] == 0 and fraction[other[k]] < 1.0:
                found = True
                break
        if found and kind[i] == 0:
            near[count] = i
            count += 1
    return count


@compiled
def image_links(position, kind, normal, depth, near, first, last, other, reach, begin, index, offset, image, mirror):
    """List the liquid neighbours of particles near interfaces, and those neighbours' images behind walls.

    With the images, interfaces stand at right angles on walls, whatever the arrangement of the wall's particles. As
    an image is further than its original, all images within reach are those of neighbours, or of the particle itself.
    In a corner, walls at right angles to each other mirror one after the other. A wall mirrors what is before it:
    beside a baffle's end, images would fall on their originals.

    Parameters
    ----------
    position : (n, 3) float64, m
    kind : (n,) int8
    normal, depth
        Of the walls, as in `reflect_at_walls`.
    near : (m,) int32
        The particles.
    first, last, other
        Neighbour lists.
    reach : float, m
    begin : (m + 1,) int64
        Filled: where the links of each particle begin.
    index : (capacity,) int32
        Filled: the neighbour, or the original of the image; there are at most 8 links a neighbour.
    offset : (capacity, 3) float64, m
        Filled: the way to it.
    image : (capacity,) int8
        Filled: 0 for a neighbour, bit b for an image made by wall b.
    mirror : (m, 3, 3) float64
        Filled: normals of the walls, 0 for none.
    """
    count = 0
    begin[0] = 0
    for a in range(near.shape[0]):
        i = near[a]
        for k in range(first[i], last[i]):
            j = other[k]
            dx = position[j, 0] - position[i, 0]
            dy = position[j, 1] - position[i, 1]
            dz = position[j, 2] - position[i, 2]
            if kind[j] == 0 and dx * dx + dy * dy + dz * dz < reach * reach:
                index[count], image[count] = j, 0
                offset[count, 0], offset[count, 1], offset[count, 2] = dx, dy, dz
                count += 1
        mirror[a] = 0.0
        for wall in range(3):
            least, height = math.inf, 0.0
            n = mirror[a, wall]
            for k in range(first[i], last[i]):
                j = other[k]
                if kind[j] == 0 or _parallel(normal[j], mirror[a], wall):
                    continue
                dx = position[j, 0] - position[i, 0]
                dy = position[j, 1] - position[i, 1]
                dz = position[j, 2] - position[i, 2]
                r2 = dx * dx + dy * dy + dz * dz
                above = -(dx * normal[j, 0] + dy * normal[j, 1] + dz * normal[j, 2]) - depth[j]
                if r2 < least and above > 0.05 * reach:
                    least, height = r2, above
                    n[0], n[1], n[2] = normal[j, 0], normal[j, 1], normal[j, 2]
            if least == math.inf:
                break
            for k in range(begin[a] - 1, count):
                dx = dy = dz = 0.0
                original, made = i, 0
                if k >= begin[a]:
                    dx, dy, dz = offset[k, 0], offset[k, 1], offset[k, 2]
                    original, made = index[k], image[k]
                far = 2.0 * (height + dx * n[0] + dy * n[1] + dz * n[2])
                if far < 0.1 * reach:
                    continue
                dx, dy, dz = dx - far * n[0], dy - far * n[1], dz - far * n[2]
                r2 = dx * dx + dy * dy + dz * dz
                if r2 < reach * reach:
                    index[count], image[count] = original, made | (1 << wall)
                    offset[count, 0], offset[count, 1], offset[count, 2] = dx, dy, dz
                    count += 1
        begin[a + 1] = count


@njit(inline="always")
def _parallel(normal, walls, count):
    """Whether a normal is not at right angles to the first walls' normals."""
    for wall in range(count):
        n = walls[wall]
        if abs(normal[0] * n[0] + normal[1] * n[1] + normal[2] * n[2]) > 0.1:
            return True
    return False


@compiled
def link_weights(offset, l0, reach, smooth, strength):
    """Smooth weights of links, and W / r^2, which several smoothings and gradients share.

    Parameters
    ----------
    offset : (links, 3) float64, m
        As made by `image_links`.
    l0 : float
        Spacing, m.
    reach : float
        In spacings.
    smooth : (links,) float64
        Filled.
    strength : (links,) float64, 1/m2
        Filled.
    """
    for k in range(smooth.shape[0]):
        r2 = offset[k, 0] ** 2 + offset[k, 1] ** 2 + offset[k, 2] ** 2
        r = math.sqrt(r2) / l0
        smooth[k], strength[k] = smooth_weight(r, reach), weight(r, reach) / r2


@compiled
def smooth_fraction(fluid, sheet, fraction, near, begin, index, smooth, out):
    """Smooth the share of a particle's own liquid in its neighbourhood, by the smooth weight.

    From 1 everywhere, as without smoothing, it makes the colour function, smoothed once.

    Parameters
    ----------
    fluid : (n,) int8
    sheet
        As in `find_near`.
    fraction : (n,) float64
    near : (m,) int32
        Particles near an interface.
    begin, index
        As made by `image_links`.
    smooth : (links,) float64
        As made by `link_weights`.
    out : (n,) float64
        Filled for those particles.
    """
    for a in range(near.shape[0]):
        i = near[a]
        total, value = 1.0, fraction[i]
        for k in range(begin[a], begin[a + 1]):
            j, w = index[k], smooth[k]
            total += w
            value += w * (1.0 - fraction[j] if sheet[fluid[i], fluid[j]] else fraction[j])
        out[i] = value / total


@compiled
def normals(fluid, sheet, fraction, near, begin, index, offset, image, strength, l0, dimension, out, beyond):
    """Normals of the interface, out of each particle's own liquid, and the first moment of what lies beyond.

    They are as long as the fraction of the own liquid is steep: short where they are not certain, as in the middle
    of a thin layer.

    Parameters
    ----------
    fluid, sheet, near, begin, index, offset, image
        As in `smooth_fraction` and `image_links`.
    fraction : (n,) float64
        As made by `smooth_fraction`; 1 away from interfaces.
    strength : (links,) float64, 1/m2
        As made by `link_weights`.
    l0 : float
        Spacing, m.
    dimension : int
    out : (n, 3) float64, 1/spacings
        Filled for those particles.
    beyond : (rows, 3) float64
        Filled for those particles: sum W (r_j - r_i) / r_ij^2 over the other liquids, in 1/spacings.
    """
    matrix, inverse = np.empty((1, 6)), np.empty((1, 6))
    for a in range(near.shape[0]):
        i = near[a]
        gx = gy = gz = qx = qy = qz = 0.0
        xx = xy = xz = yy = yz = zz = 0.0
        for k in range(begin[a], begin[a + 1]):
            j = index[k]
            dx, dy, dz = offset[k, 0], offset[k, 1], offset[k, 2]
            s = strength[k]
            other = sheet[fluid[i], fluid[j]]
            if other and image[k] == 0:
                qx += s * dx
                qy += s * dy
                qz += s * dz
            xx += s * dx * dx
            xy += s * dx * dy
            xz += s * dx * dz
            yy += s * dy * dy
            yz += s * dy * dz
            zz += s * dz * dz
            s *= fraction[i] - (1.0 - fraction[j] if other else fraction[j])
            gx += s * dx
            gy += s * dy
            gz += s * dz
        beyond[i, 0], beyond[i, 1], beyond[i, 2] = l0 * qx, l0 * qy, l0 * qz
        out[i], total = 0.0, xx + yy + zz
        if total == 0.0:
            continue
        s = dimension / total
        matrix[0, 0], matrix[0, 1], matrix[0, 2] = s * xx, s * xy, s * xz
        matrix[0, 3], matrix[0, 4], matrix[0, 5] = s * yy, s * yz, s * zz
        invert(matrix, 0.2, dimension, inverse)
        m, scale = inverse[0], l0 * dimension / total
        out[i, 0] = scale * (m[0] * gx + m[1] * gy + m[2] * gz)
        out[i, 1] = scale * (m[1] * gx + m[3] * gy + m[4] * gz)
        out[i, 2] = scale * (m[2] * gx + m[4] * gy + m[5] * gz)


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
def find_slip(velocity, kind, fluid, sheet, near, first, last, other, limit, slips):
    """Tell the particles near interfaces whose liquid slides along the other one slowly enough to do so as a sheet.

    Parameters
    ----------
    velocity : (n, 3) float64, m/s
    kind, fluid, sheet, near, first, last, other
        As in `own_moments`.
    limit : float, m/s
        Greatest difference between the mean velocities of a particle's neighbours in its own liquid and in others.
    slips : (n,) int8
        Filled for those particles: 1 where the difference is no greater.
    """
    for i in near:
        ox, oy, oz = velocity[i, 0], velocity[i, 1], velocity[i, 2]
        bx = by = bz = 0.0
        within, across = 1, 0
        for k in range(first[i], last[i]):
            j = other[k]
            if kind[j] != 0:
                continue
            if sheet[fluid[i], fluid[j]]:
                bx += velocity[j, 0]
                by += velocity[j, 1]
                bz += velocity[j, 2]
                across += 1
            else:
                ox += velocity[j, 0]
                oy += velocity[j, 1]
                oz += velocity[j, 2]
                within += 1
        a, b = 1.0 / within, 1.0 / max(across, 1)
        slips[i] = _length(a * ox - b * bx, a * oy - b * by, a * oz - b * bz) <= limit


@compiled
def own_moments(position, kind, fluid, slips, sheet, near, first, last, other, strength, n0, dimension, matrix):
    """Moment matrices over the neighbours in a particle's own liquid and walls, as in `moments`.

    Parameters
    ----------
    position, kind, fluid, first, last, other, strength
        As in `moments`.
    slips : (n,) int8
        As made by `find_slip`; other liquids count as the own one unless both particles slip.
    sheet : (liquids, liquids) bool
        Whether the velocity can jump between two liquids.
    near : (m,) int32
        The particles, all of which slip.
    n0 : float
    dimension : int
    matrix : (m, 6) float64
        Filled.
    """
    scale = dimension / n0
    for a in range(near.shape[0]):
        i = near[a]
        xx = xy = xz = yy = yz = zz = 0.0
        for k in range(first[i], last[i]):
            j = other[k]
            if kind[j] == 0 and slips[j] != 0 and sheet[fluid[i], fluid[j]]:
                continue
            dx = position[j, 0] - position[i, 0]
            dy = position[j, 1] - position[i, 1]
            dz = position[j, 2] - position[i, 2]
            s = scale * strength[k]
            xx += s * dx * dx
            xy += s * dx * dy
            xz += s * dx * dz
            yy += s * dy * dy
            yz += s * dy * dz
            zz += s * dz * dz
        matrix[a, 0], matrix[a, 1], matrix[a, 2] = xx, xy, xz
        matrix[a, 3], matrix[a, 4], matrix[a, 5] = yy, yz, zz


@compiled
def own_gradient(
    position, velocity, kind, fluid, slips, sheet, near, first, last, other, strength, inverse, n0, dimension, out
):
    """Gradient of the velocity of a particle's own liquid, which can jump at the interface.

    Parameters
    ----------
    position, kind, fluid, slips, sheet, near, first, last, other, strength, n0, dimension
        As in `own_moments`.
    velocity : (n, 3) float64, m/s
    inverse : (m, 6) float64
        Inverse of those moments.
    out : (n, 9) float64, 1/s
        Filled for those particles, as in `velocity_gradient`.
    """
    scale = dimension / n0
    g = np.empty((3, 3))
    d = np.empty(3)
    for a in range(near.shape[0]):
        i = near[a]
        g[:] = 0.0
        for k in range(first[i], last[i]):
            j = other[k]
            if kind[j] == 0 and slips[j] != 0 and sheet[fluid[i], fluid[j]]:
                continue
            s = scale * strength[k]
            for b in range(3):
                d[b] = position[j, b] - position[i, b]
            for b in range(3):
                for c in range(3):
                    g[b, c] += s * (velocity[j, b] - velocity[i, b]) * d[c]
        m = inverse[a]
        for b in range(3):
            out[i, 3 * b] = g[b, 0] * m[0] + g[b, 1] * m[1] + g[b, 2] * m[2]
            out[i, 3 * b + 1] = g[b, 0] * m[1] + g[b, 1] * m[3] + g[b, 2] * m[4]
            out[i, 3 * b + 2] = g[b, 0] * m[2] + g[b, 1] * m[4] + g[b, 2] * m[5]


@compiled
def divergence(
    position,
    velocity,
    gradient,
    kind,
    fluid,
    slips,
    sheet,
    normal,
    near,
    first,
    last,
    other,
    strength,
    inverse,
    n0,
    dimension,
    out,
):
    """Divergence of the velocity at an interface, where its tangential part jumps and its normal part has a kink.

    On a link to another liquid the tangential difference is what the own gradient says, and the normal one
    that of twice the way to the interface, in the middle of the link: the mean of what the two sides' gradients
    say there, n . [v_j - v_i + (grad v_i - grad v_j)(r_j - r_i) / 2].

    Parameters
    ----------
    position, velocity, kind, fluid, slips, sheet, near, first, last, other, strength, n0, dimension
        As in `own_gradient`.
    gradient : (n, 9) float64, 1/s
        Of each particle's own liquid.
    normal : (n, 3) float64
        As made by `normals`.
    inverse : (rows, 6) float64
        Inverse moment matrices of all neighbours.
    out : (rows,) float64, 1/s
        Filled for those particles.
    """
    scale = dimension / n0
    for i in near:
        total = 0.0
        m, g, n = inverse[i], gradient[i], normal[i]
        for k in range(first[i], last[i]):
            j = other[k]
            dx = position[j, 0] - position[i, 0]
            dy = position[j, 1] - position[i, 1]
            dz = position[j, 2] - position[i, 2]
            u = velocity[j, 0] - velocity[i, 0]
            v = velocity[j, 1] - velocity[i, 1]
            w = velocity[j, 2] - velocity[i, 2]
            if kind[j] == 0 and slips[j] != 0 and sheet[fluid[i], fluid[j]]:
                h = gradient[j]
                ox = g[0] * dx + g[1] * dy + g[2] * dz
                oy = g[3] * dx + g[4] * dy + g[5] * dz
                oz = g[6] * dx + g[7] * dy + g[8] * dz
                # beyond what the own gradient says: the normal part alone
                u -= 0.5 * (ox + h[0] * dx + h[1] * dy + h[2] * dz)
                v -= 0.5 * (oy + h[3] * dx + h[4] * dy + h[5] * dz)
                w -= 0.5 * (oz + h[6] * dx + h[7] * dy + h[8] * dz)
                nx, ny, nz = n[0] - normal[j, 0], n[1] - normal[j, 1], n[2] - normal[j, 2]
                along = (u * nx + v * ny + w * nz) / (nx * nx + ny * ny + nz * nz + 1e-300)
                u = ox + along * nx
                v = oy + along * ny
                w = oz + along * nz
            s = scale * strength[k]
            total += s * (
                u * (m[0] * dx + m[1] * dy + m[2] * dz)
                + v * (m[1] * dx + m[3] * dy + m[4] * dz)
                + w * (m[2] * dx + m[4] * dy + m[5] * dz)
            )
        out[i] = total


@compiled
def pressure_gradient(
    position,
    pressure,
    force,
    kind,
    surface,
    lean,
    density,
    support,
    near,
    first,
    last,
    other,
    strength,
    l0,
    surface_distance,
    n0,
    dimension,
    matrix,
    sums,
    fluid,
    volume,
    tension,
    bend,
    normal,
    above,
):
    """Sums for grad P / rho at an interface, where its tangential part jumps with the density.

    Least squares for the acceleration a of the own liquid beyond the body force f: on a link of volume b the
    pressure says b (P_j - P_i) - f . d = a' . d', where d' is d with its part along the interface multiplied by
    b rho_i, since P itself is continuous there. Particles of little support take part in no jump, and their own
    pressure hardly counts, as in `support.flow_around`.

    Parameters
    ----------
    position, kind, near, first, last, other, strength, n0, dimension
        As in `divergence`.
    l0, surface_distance : float
        Spacing, and distance from surface particles to the free surface, m.
    pressure : (n,) float64, Pa
    force : (n, 3) float64, m/s2
        Of fluid particles.
    surface, lean
        As in `corrected_gradient`.
    density : float, kg/m3
        Of the liquid, or the reference density of ``volume``.
    support : (n,) float64
        1 but for particles of little support.
    matrix : (m, 6) float64
        Filled: moments.
    sums : (m, 3) float64
        Filled: right-hand sides.
    fluid, volume, tension, bend
        As in `poisson_rows`.
    normal : None or (n, 3) float64
        As made by `normals`; None for a single liquid.
    above
        As in `poisson_rows`.
    """
    scale = dimension / n0
    for a in range(near.shape[0]):
        i = near[a]
        xx = xy = xz = yy = yz = zz = gx = gy = gz = mx = my = mz = mean = 0.0
        total = 1e-300
        here = held_pressure(i, pressure, surface, above)
        own = b = 1.0
        if fluid is not None:
            own = volume[fluid[i], fluid[i]]
        for k in range(first[i], last[i]):
            j = other[k]
            dx = (position[j, 0] - position[i, 0]) / l0
            dy = (position[j, 1] - position[i, 1]) / l0
            dz = (position[j, 2] - position[i, 2]) / l0
            there = held_pressure(j, pressure, surface, above)
            if tension is not None:
                there -= pressure_jump(tension[fluid[i], fluid[j]], bend[i], bend[j])
            if fluid is not None:
                b = volume[fluid[i], fluid[j]]
            q = b * (there - here) / (density * l0) - force[i, 0] * dx - force[i, 1] * dy - force[i, 2] * dz
            if normal is not None and kind[j] == 0 and fluid[i] != fluid[j] and support[i] == 1.0:
                nx = normal[i, 0] - normal[j, 0]
                ny = normal[i, 1] - normal[j, 1]
                nz = normal[i, 2] - normal[j, 2]
                along = (dx * nx + dy * ny + dz * nz) / (nx * nx + ny * ny + nz * nz + 1e-300)
                t = b / own
                dx = t * dx + (1.0 - t) * along * nx
                dy = t * dy + (1.0 - t) * along * ny
                dz = t * dz + (1.0 - t) * along * nz
            s = scale * l0 * l0 * strength[k]
            total += s
            mean += s * q
            mx += s * dx
            my += s * dy
            mz += s * dz
            gx += s * q * dx
            gy += s * q * dy
            gz += s * q * dz
            xx += s * dx * dx
            xy += s * dx * dy
            xz += s * dx * dz
            yy += s * dy * dy
            yz += s * dy * dz
            zz += s * dz * dz
        if surface[i] != 0:
            qx, qy, qz = lean[i, 0], lean[i, 1], lean[i, 2]
            size = math.sqrt(qx * qx + qy * qy + qz * qz) + 1e-300
            s = scale / size
            drop = here
            if above is not None:
                drop -= above[i]
            q = -own * drop * size / (density * surface_distance)
            q -= force[i, 0] * qx + force[i, 1] * qy + force[i, 2] * qz
            total += s
            mean += s * q
            mx += s * qx
            my += s * qy
            mz += s * qz
            gx += s * q * qx
            gy += s * q * qy
            gz += s * q * qz
            xx += s * qx * qx
            xy += s * qx * qy
            xz += s * qx * qz
            yy += s * qy * qy
            yz += s * qy * qz
            zz += s * qz * qz
        matrix[a, 0], matrix[a, 1], matrix[a, 2] = xx, xy, xz
        matrix[a, 3], matrix[a, 4], matrix[a, 5] = yy, yz, zz
        free = (1.0 - support[i]) / total
        add_moment(matrix[a], -free, mx, my, mz)
        sums[a, 0], sums[a, 1], sums[a, 2] = gx - free * mean * mx, gy - free * mean * my, gz - free * mean * mz


@compiled
def asymmetry_across(position, kind, fluid, sheet, near, first, last, other, strength, n0, dimension, out):
    """Part of the asymmetry, as in `moments`, that the neighbours in other liquids make.

    Parameters
    ----------
    position, kind, fluid, sheet, near, first, last, other, strength, n0, dimension
        As in `own_moments`.
    out : (m, 3) float64
        Filled.
    """
    scale = dimension / n0
    for a in range(near.shape[0]):
        i = near[a]
        x = y = z = 0.0
        for k in range(first[i], last[i]):
            j = other[k]
            if kind[j] != 0 or not sheet[fluid[i], fluid[j]]:
                continue
            dx = position[j, 0] - position[i, 0]
            dy = position[j, 1] - position[i, 1]
            dz = position[j, 2] - position[i, 2]
            s = scale * strength[k] * _length(dx, dy, dz)
            x -= s * dx
            y -= s * dy
            z -= s * dz
        out[a, 0], out[a, 1], out[a, 2] = x, y, z


@compiled
def solve_gradient(force, near, inverse, sums, out):
    """Acceleration by the pressure: the body force and what the least squares of `pressure_gradient` add.

    Parameters
    ----------
    force : (n, 3) float64, m/s2
    near : (m,) int32
    inverse : (m, 6) float64
    sums : (m, 3) float64
    out : (n, 3) float64, m/s2
        Filled for those particles.
    """
    for a in range(near.shape[0]):
        i, m, g = near[a], inverse[a], sums[a]
        out[i, 0] = force[i, 0] + m[0] * g[0] + m[1] * g[1] + m[2] * g[2]
        out[i, 1] = force[i, 1] + m[1] * g[0] + m[3] * g[1] + m[4] * g[2]
        out[i, 2] = force[i, 2] + m[2] * g[0] + m[4] * g[1] + m[5] * g[2]


@compiled
def curvature(fluid, sheet, normal, near, begin, index, offset, image, mirror, strength, dimension, out):
    """Curvature of the interface near each particle, div n with n out of its own liquid; positive where it is convex.

    The divergence of the unit normal is a least-squares fit to the neighbours near the interface, those of other
    liquids reversed and images mirrored, each with the steepness of the colour function as its weight: contours of
    the smoothed colour stand for the interface ([000] eq. 18, in any dimension).

    Parameters
    ----------
    fluid, sheet, near, begin, index, offset, image, mirror, strength
        As in `normals` and `image_links`.
    normal : (n, 3) float64
        As made by `normals`; 0 away from interfaces.
    dimension : int
    out : (n,) float64, 1/m
        Filled for those particles.
    """
    matrix, inverse = np.empty((1, 6)), np.empty((1, 6))
    for a in range(near.shape[0]):
        i = near[a]
        gxx = gxy = gxz = gyx = gyy = gyz = gzx = gzy = gzz = 0.0
        xx = xy = xz = yy = yz = zz = 0.0
        size = 1.0 / (_length(normal[i, 0], normal[i, 1], normal[i, 2]) + 1e-300)
        ox, oy, oz = size * normal[i, 0], size * normal[i, 1], size * normal[i, 2]
        for k in range(begin[a], begin[a + 1]):
            j = index[k]
            nx, ny, nz = normal[j, 0], normal[j, 1], normal[j, 2]
            steep = _length(nx, ny, nz)
            if steep == 0.0:
                continue
            size = -1.0 / steep if sheet[fluid[i], fluid[j]] else 1.0 / steep
            nx, ny, nz = size * nx, size * ny, size * nz
            if image[k] != 0:
                for wall in range(3):
                    if image[k] & (1 << wall):
                        mx, my, mz = mirror[a, wall, 0], mirror[a, wall, 1], mirror[a, wall, 2]
                        across = 2.0 * (nx * mx + ny * my + nz * mz)
                        nx, ny, nz = nx - across * mx, ny - across * my, nz - across * mz
            nx, ny, nz = nx - ox, ny - oy, nz - oz
            s = steep * strength[k]
            dx, dy, dz = offset[k, 0], offset[k, 1], offset[k, 2]
            sx, sy, sz = s * dx, s * dy, s * dz
            gxx += nx * sx
            gxy += nx * sy
            gxz += nx * sz
            gyx += ny * sx
            gyy += ny * sy
            gyz += ny * sz
            gzx += nz * sx
            gzy += nz * sy
            gzz += nz * sz
            xx += dx * sx
            xy += dx * sy
            xz += dx * sz
            yy += dy * sy
            yz += dy * sz
            zz += dz * sz
        out[i], total = 0.0, xx + yy + zz
        if total == 0.0:
            continue
        s = dimension / total
        matrix[0, 0], matrix[0, 1], matrix[0, 2] = s * xx, s * xy, s * xz
        matrix[0, 3], matrix[0, 4], matrix[0, 5] = s * yy, s * yz, s * zz
        invert(matrix, 0.2, dimension, inverse)
        m = inverse[0]
        trace = gxx * m[0] + gyy * m[3] + gzz * m[5] + (gxy + gyx) * m[1] + (gxz + gzx) * m[2] + (gyz + gzy) * m[4]
        out[i] = trace * dimension / total


@compiled
def smooth_curvature(fluid, sheet, bend, normal, near, begin, index, offset, strength, reach, out):
    """Mean of the curvature over the neighbourhood, weighted by the steepness of the colour function.

    Parameters
    ----------
    fluid, sheet, normal, near, begin, index, offset, strength
        As in `curvature`.
    bend : (n,) float64, 1/m
    reach : float
        In spacings.
    out : (n,) float64, 1/m
        Filled for those particles.
    """
    for a in range(near.shape[0]):
        i = near[a]
        total = weight(0.0, reach) * _length(normal[i, 0], normal[i, 1], normal[i, 2])
        value = total * bend[i]
        for k in range(begin[a], begin[a + 1]):
            j = index[k]
            s = strength[k] * (offset[k, 0] ** 2 + offset[k, 1] ** 2 + offset[k, 2] ** 2)
            s *= _length(normal[j, 0], normal[j, 1], normal[j, 2])
            total += s
            value += -s * bend[j] if sheet[fluid[i], fluid[j]] else s * bend[j]
        out[i] = value / (total + 1e-300)
