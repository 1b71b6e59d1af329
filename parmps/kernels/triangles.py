"""Distance from a closed surface of triangles, sampled on a grid."""

import math

import numpy as np

from parmps.kernels.compiled import compiled


@compiled
def sample_distance(triangles, low, step, shape, band):
    """Signed distance from a surface at the nodes of a grid, positive inside, cut off at ``band``.

    The size is that to the nearest triangle. A line along z (which is moved off the nodes a little, so as not to hit
    edges) enters the inside where it crosses a triangle from its front and leaves where it does so from its back.

    Parameters
    ----------
    triangles : (m, 3, 3) float64, m
        Corners, counter-clockwise seen from outside.
    low : (3,) float64, m
        First node.
    step : float, m
    shape : tuple of 3 int
    band : float, m

    Returns
    -------
    field : (shape) float32, m
    odd : (4,) int64
        A node that is inside more than once, or less than not at all, and how often it is; of a surface that does not
        cross itself, all 0.
    """
    nearest = np.full(shape, np.float32(band * band))
    entered = np.zeros(shape, np.int16)
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    for t in triangles:
        for a in range(3):
            lower, upper = min(t[0, a], t[1, a], t[2, a]), max(t[0, a], t[1, a], t[2, a])
            first[a] = max(int(math.ceil((lower - band - low[a]) / step)), 0)
            last[a] = min(int(math.floor((upper + band - low[a]) / step)) + 1, shape[a])
        for i in range(first[0], last[0]):
            for j in range(first[1], last[1]):
                _enter_above(t, low, step, i, j, entered)
                for k in range(first[2], last[2]):
                    d2 = _distance2(low[0] + i * step, low[1] + j * step, low[2] + k * step, t)
                    nearest[i, j, k] = min(nearest[i, j, k], np.float32(d2))
    field, odd = np.sqrt(nearest), np.zeros(4, np.int64)
    for i in range(shape[0]):
        for j in range(shape[1]):
            within = 0
            for k in range(shape[2]):
                within += entered[i, j, k]
                if within <= 0:
                    field[i, j, k] = -field[i, j, k]
                if within != 0 and within != 1:
                    odd[:] = i, j, k, within
    return field, odd


@compiled
def exact_distance(points, triangles, aside):
    """Signed distance of points from a surface, positive inside, measured to every triangle.

    Parameters
    ----------
    points : (n, 3) float64, m
    triangles : (m, 3, 3) float64, m
        As in `sample_distance`.
    aside : float, m
        How far a line along z is moved off a point, so as not to hit edges.

    Returns
    -------
    (n,) float64, m
    """
    found = np.empty(len(points))
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        nearest, within = np.inf, 0
        for t in triangles:
            nearest = min(nearest, _distance2(x, y, z, t))
            at, way = _crossing(t, x + 1.37 * aside, y + 2.71 * aside)
            if way != 0 and at <= z:
                within += way
        found[n] = math.sqrt(nearest) if within > 0 else -math.sqrt(nearest)
    return found


@compiled
def _enter_above(t, low, step, i, j, entered):
    """Count, at the first node above it, the place where a line along z enters or leaves through a triangle."""
    z, way = _crossing(t, low[0] + (i + 1.37e-5) * step, low[1] + (j + 2.71e-5) * step)
    if way != 0:
        k = max(int(math.ceil((z - low[2]) / step)), 0)
        if k < entered.shape[2]:
            entered[i, j, k] += way


@compiled
def _crossing(t, x, y):
    """Height at which a line along z crosses a triangle, and whether it enters (1), leaves (-1) or misses it (0)."""
    ax, ay, bx, by = t[1, 0] - t[0, 0], t[1, 1] - t[0, 1], t[2, 0] - t[0, 0], t[2, 1] - t[0, 1]
    area = ax * by - ay * bx
    if area == 0.0:
        return 0.0, 0
    u = ((x - t[0, 0]) * by - (y - t[0, 1]) * bx) / area
    v = (ax * (y - t[0, 1]) - ay * (x - t[0, 0])) / area
    if u < 0.0 or v < 0.0 or u + v > 1.0:
        return 0.0, 0
    return t[0, 2] + u * (t[1, 2] - t[0, 2]) + v * (t[2, 2] - t[0, 2]), 1 if area < 0.0 else -1


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
