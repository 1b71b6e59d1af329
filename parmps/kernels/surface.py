"""Curvature of the free surface, from the particles in it alone."""

import math

from parmps.kernels.compiled import compiled
from parmps.kernels.density import inverse_of, times
from parmps.kernels.interface import mirrored
from parmps.kernels.weight import spline_weight

FLOOR = 0.2
"""Least eigenvalue of the moment matrices; 1 along an even surface."""
CROWDED = 1.2
"""Density of the row of particles below the surface, over that of the lattice, from which on it is too dense."""


@compiled
def fit_normals(guess, asymmetry, surface, near, begin, index, offset, image, mirror, strength, dimension, out):
    """Normals of the lines, or planes, through the particles of the surface: least squares of their heights.

    However dense the particles stand along the surface: normals of a smoothed density would lean towards where they
    are few, and what stretches the surface would stretch it further.

    Parameters
    ----------
    guess : (rows, 3) float64
        Unit normals that the heights are taken along, 0 for none.
    asymmetry : (n, 3) float64
        As in `moments`; particles that look the other way belong to another surface.
    surface : (n,) int8
    near : (m,) int32
        Particles in the surface.
    begin, index, offset, image, mirror
        As made by `interface.image_links`.
    strength : (capacity,) float64, 1/m2
        As made by `interface.link_weights`.
    dimension : int
    out : (n, 3) float64
        Filled for those particles: unit normals out of the liquid.
    """
    x, y, z = offset[0], offset[1], offset[2]
    for a in range(near.shape[0]):
        i = near[a]
        nx, ny, nz = guess[i, 0], guess[i, 1], guess[i, 2]
        total = 1.0
        mx = my = mz = mh = gx = gy = gz = 0.0
        xx = xy = xz = yy = yz = zz = 0.0
        for k in range(begin[a], begin[a + 1]):
            j = index[k]
            if surface[j] == 0:
                continue
            ax, ay, az = mirrored(asymmetry[j, 0], asymmetry[j, 1], asymmetry[j, 2], image[k], mirror[a])
            if ax * nx + ay * ny + az * nz <= 0.0:
                continue
            dx, dy, dz = x[k], y[k], z[k]
            s = strength[k] * (dx * dx + dy * dy + dz * dz)
            h = dx * nx + dy * ny + dz * nz
            dx, dy, dz = dx - h * nx, dy - h * ny, dz - h * nz
            total += s
            mh += s * h
            mx += s * dx
            my += s * dy
            mz += s * dz
            gx += s * h * dx
            gy += s * h * dy
            gz += s * h * dz
            xx += s * dx * dx
            xy += s * dx * dy
            xz += s * dx * dz
            yy += s * dy * dy
            yz += s * dy * dz
            zz += s * dz * dz
        size = xx + yy + zz
        out[i, 0], out[i, 1], out[i, 2] = nx, ny, nz
        if size == 0.0:
            continue
        scale, f = (dimension - 1) / size, 1.0 / total
        gx, gy, gz = gx - f * mh * mx, gy - f * mh * my, gz - f * mh * mz
        gx, gy, gz = scale * gx, scale * gy, scale * gz
        xx, xy, xz = scale * (xx - f * mx * mx), scale * (xy - f * mx * my), scale * (xz - f * mx * mz)
        yy, yz, zz = scale * (yy - f * my * my), scale * (yz - f * my * mz), scale * (zz - f * mz * mz)
        m = inverse_of(xx, xy, xz, yy, yz, zz, FLOOR, dimension)
        gx, gy, gz = times(m, gx, gy, gz)
        nx, ny, nz = nx - gx, ny - gy, nz - gz
        size = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
        out[i, 0], out[i, 1], out[i, 2] = size * nx, size * ny, size * nz


@compiled
def curvature(normal, near, begin, index, offset, image, mirror, strength, distance, dimension, out):
    """Curvature of the surface, the divergence of its normals; positive where the liquid is convex.

    From the differences of normals and of places on the surface, which are above the particles by ``distance``: on a
    circle or a sphere the two are parallel, and their ratio is the curvature exactly.

    Parameters
    ----------
    normal : (n, 3) float64
        Unit normals of particles in the surface; 0 elsewhere.
    near, begin, index, offset, image, mirror, strength
        As in `fit_normals`.
    distance : float
        From surface particles to the free surface, m.
    dimension : int
    out : (m,) float64, 1/m
        Filled.
    """
    for a in range(near.shape[0]):
        i = near[a]
        ox, oy, oz = normal[i, 0], normal[i, 1], normal[i, 2]
        change = total = 0.0
        for k in range(begin[a], begin[a + 1]):
            j = index[k]
            x, y, z = mirrored(normal[j, 0], normal[j, 1], normal[j, 2], image[k], mirror[a])
            if x * ox + y * oy + z * oz <= 0.0:
                continue
            mx, my, mz = x + ox, y + oy, z + oz
            x, y, z = x - ox, y - oy, z - oz
            dx, dy, dz = offset[0, k] + distance * x, offset[1, k] + distance * y, offset[2, k] + distance * z
            up = (dx * mx + dy * my + dz * mz) / (mx * mx + my * my + mz * mz)
            dx, dy, dz = dx - up * mx, dy - up * my, dz - up * mz
            s = strength[k]
            change += s * (x * dx + y * dy + z * dz)
            total += s * (dx * dx + dy * dy + dz * dz)
        out[a] = (dimension - 1) * change / total if total > 0.0 else 0.0


@compiled
def crowd_out(position, kind, asymmetry, surface, normal, near, first, last, other, l0, reach, full, out):
    """Find what leaves a crowded row: particles that lie deeper in it than their neighbours do.

    A surface that contracts squeezes its row, which leaves the next one behind, down to where its particles see none
    below them. Their asymmetry pushes those that lie deeper into the liquid, once its mean over the row is taken off.

    Parameters
    ----------
    position : (n, 3) float64, m
    kind : (n,) int8
    asymmetry : (n, 3) float64
    surface : (n,) int8
    normal : (n, 3) float64
        As made by `fit_normals`.
    near : (m,) int32
        Particles in the surface.
    first, last, other
        Neighbour lists.
    l0 : float
        Spacing, m.
    reach, full : float
        As in `density.row_density`.
    out : (n,) float64
        Filled for those particles: asymmetry along the normal that shifts them, 0 or less.
    """
    for i in near:
        out[i] = 0.0
        if last[i] > first[i] and kind[other[last[i] - 1]] != 0:
            continue  # walls follow the liquid, and the asymmetry beside them is another
        nx, ny, nz = normal[i, 0], normal[i, 1], normal[i, 2]
        own = asymmetry[i, 0] * nx + asymmetry[i, 1] * ny + asymmetry[i, 2] * nz
        total = spline_weight(0.0, reach)
        mean = total * own
        for k in range(first[i], last[i]):
            j = other[k]
            if surface[j] == 0:
                continue
            dx, dy = position[j, 0] - position[i, 0], position[j, 1] - position[i, 1]
            dz = position[j, 2] - position[i, 2]
            up = dx * nx + dy * ny + dz * nz
            along = math.sqrt(max(dx * dx + dy * dy + dz * dz - up * up, 0.0)) / l0
            share = max(min(2.0 - 2.0 * abs(up) / l0, 1.0), 0.0) * spline_weight(along, reach)
            total += share
            mean += share * (asymmetry[j, 0] * nx + asymmetry[j, 1] * ny + asymmetry[j, 2] * nz)
        if total > CROWDED * full:
            out[i] = min(own - mean / total, 0.0)
