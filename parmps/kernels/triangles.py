"""Distance from a closed surface of triangles, sampled on a grid."""

import math

import numpy as np

from parmps.kernels.compiled import compiled


@compiled
def sample_distance(triangles, low, step, shape, band):
    """Signed distance from a surface at the nodes of a grid, positive inside, cut off at ``band``.

    The size is that to the nearest triangle, the sign the parity of the crossings of a line along z (which is
    moved off the nodes a little, so as not to hit edges).

    Parameters
    ----------
    triangles : (m, 3, 3) float64, m
        Corners.
    low : (3,) float64, m
        First node.
    step : float, m
    shape : tuple of 3 int
    band : float, m

    Returns
    -------
    (shape) float32, m
    """
    nearest = np.full(shape, np.float32(band * band))
    inside = np.zeros(shape, np.bool_)
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    for t in triangles:
        for a in range(3):
            lower, upper = min(t[0, a], t[1, a], t[2, a]), max(t[0, a], t[1, a], t[2, a])
            first[a] = max(int(math.ceil((lower - band - low[a]) / step)), 0)
            last[a] = min(int(math.floor((upper + band - low[a]) / step)) + 1, shape[a])
        for i in range(first[0], last[0]):
            for j in range(first[1], last[1]):
                _flip_above(t, low, step, i, j, inside)
                for k in range(first[2], last[2]):
                    d2 = _distance2(low[0] + i * step, low[1] + j * step, low[2] + k * step, t)
                    nearest[i, j, k] = min(nearest[i, j, k], np.float32(d2))
    field = np.sqrt(nearest)
    for i in range(shape[0]):
        for j in range(shape[1]):
            within = False
            for k in range(shape[2]):
                within ^= inside[i, j, k]
                if not within:
                    field[i, j, k] = -field[i, j, k]
    return field


@compiled
def _flip_above(t, low, step, i, j, inside):
    """Mark the first node above the place where a line along z crosses a triangle."""
    x, y = low[0] + (i + 1.37e-5) * step, low[1] + (j + 2.71e-5) * step
    ax, ay, bx, by = t[1, 0] - t[0, 0], t[1, 1] - t[0, 1], t[2, 0] - t[0, 0], t[2, 1] - t[0, 1]
    area = ax * by - ay * bx
    if area == 0.0:
        return
    u = ((x - t[0, 0]) * by - (y - t[0, 1]) * bx) / area
    v = (ax * (y - t[0, 1]) - ay * (x - t[0, 0])) / area
    if u < 0.0 or v < 0.0 or u + v > 1.0:
        return
    z = t[0, 2] + u * (t[1, 2] - t[0, 2]) + v * (t[2, 2] - t[0, 2])
    k = max(int(math.ceil((z - low[2]) / step)), 0)
    if k < inside.shape[2]:
        inside[i, j, k] ^= True


@compiled
def _distance2(x, y, z, t):
    """Squared distance of a point from a triangle (Ericson, Real-Time Collision Detection, section 5.1.5)."""
    px, py, pz = x - t[0, 0], y - t[0, 1], z - t[0, 2]
    ax, ay, az = t[1, 0] - t[0, 0], t[1, 1] - t[0, 1], t[1, 2] - t[0, 2]
    bx, by, bz = t[2, 0] - t[0, 0], t[2, 1] - t[0, 1], t[2, 2] - t[0, 2]
    aa, ab, bb = ax * ax + ay * ay + az * az, ax * bx + ay * by + az * bz, bx * bx + by * by + bz * bz
    pa, pb = px * ax + py * ay + pz * az, px * bx + py * by + pz * bz
    determinant = max(aa * bb - ab * ab, 1e-300)
    u, v = (bb * pa - ab * pb) / determinant, (aa * pb - ab * pa) / determinant
    if u < 0.0 or v < 0.0 or u + v > 1.0:  # the nearest point is on one of the edges
        best = np.inf
        s = min(max(pa / max(aa, 1e-300), 0.0), 1.0)
        best = min(best, (px - s * ax) ** 2 + (py - s * ay) ** 2 + (pz - s * az) ** 2)
        s = min(max(pb / max(bb, 1e-300), 0.0), 1.0)
        best = min(best, (px - s * bx) ** 2 + (py - s * by) ** 2 + (pz - s * bz) ** 2)
        cx, cy, cz = bx - ax, by - ay, bz - az
        qx, qy, qz = px - ax, py - ay, pz - az
        s = (qx * cx + qy * cy + qz * cz) / max(cx * cx + cy * cy + cz * cz, 1e-300)
        s = min(max(s, 0.0), 1.0)
        return min(best, (qx - s * cx) ** 2 + (qy - s * cy) ** 2 + (qz - s * cz) ** 2)
    return (px - u * ax - v * bx) ** 2 + (py - u * ay - v * by) ** 2 + (pz - u * az - v * bz) ** 2
