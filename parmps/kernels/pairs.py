"""Neighbour search on cell-sorted particles, in linear time."""

import numpy as np

from parmps.kernels.compiled import compiled
from parmps.kernels.walls import crosses_solid


@compiled
def sort_into_cells(position, lower, size, shape):
    """Sort particles by the cell that they lie in (counting sort).

    Parameters
    ----------
    position : (n, 3) float64, m
    lower : (3,) float64, m
        Lower corner of the grid; particles outside are put into the nearest cell.
    size : (3,) float64, m
        Edges of a cell.
    shape : (3,) int64
        Number of cells along each axis.

    Returns
    -------
    start : (cells + 1,) int64
        Where each cell begins in ``order``.
    order : (n,) int32
        Particle indices, cell by cell, ascending within a cell.
    """
    n = position.shape[0]
    cell = np.empty(n, np.int64)
    start = np.zeros(shape[0] * shape[1] * shape[2] + 1, np.int64)
    for i in range(n):
        c = 0
        for d in range(3):
            k = int((position[i, d] - lower[d]) / size[d])
            c = c * shape[d] + min(max(k, 0), shape[d] - 1)
        cell[i] = c
        start[c + 1] += 1
    for c in range(1, start.shape[0]):
        start[c] += start[c - 1]
    place = start[:-1].copy()
    order = np.empty(n, np.int32)
    for i in range(n):
        order[place[cell[i]]] = i
        place[cell[i]] += 1
    return start, order


@compiled
def find_pairs(position, kind, normal, rows, reach, lower, size, shape, solids, wall_pairs, first, other):
    """List the neighbours of the first ``rows`` particles.

    A wall particle is seen only from the side that its normal points to, and no pair reaches through a solid,
    so that liquid on the two sides of a thin baffle does not interact.

    Parameters
    ----------
    position : (n, 3) float64, m
    kind : (n,) int8
        0 fluid, 1 wall, 2 dummy, 3 out of the tank (has no neighbours).
    normal : (n, 3) float64
        Of walls and dummies, into the liquid.
    rows : int
        Number of particles to find neighbours for: fluid, then walls.
    reach : float
        Greatest distance of a pair, m.
    lower, size, shape
        The cell grid, as in `sort_into_cells`; edges along x and y are not less than ``reach``. Along z, where
        cells that follow each other are one stretch of the sorted particles, short edges cost nothing and
        leave fewer candidates.
    solids : (m, 2, 3) float64, m
        Corners of the baffles.
    wall_pairs : bool
        Whether walls are also neighbours of walls; the papers' scheme needs that.
    first : (rows + 1,) int64
        Filled: where the neighbours of each particle begin in ``other``.
    other : (capacity,) int32
        Filled: the neighbours, ascending.

    Returns
    -------
    int
        Number of pairs, or -1 where the capacity does not suffice.
    """
    start, order = sort_into_cells(position, lower, size, shape)
    n = order.shape[0]
    sx, sy, sz = np.empty(n), np.empty(n), np.empty(n)
    solid = np.empty(n, np.bool_)
    for k in range(n):
        i = order[k]
        sx[k], sy[k], sz[k] = position[i, 0], position[i, 1], position[i, 2]
        solid[k] = kind[i] != 0
    reach2 = reach * reach
    baffled = solids.shape[0] > 0
    capacity = other.shape[0]
    count = 0
    first[0] = 0
    for i in range(rows):
        if kind[i] == 3:
            first[i + 1] = count
            continue
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        cx = min(max(int((x - lower[0]) / size[0]), 0), shape[0] - 1)
        cy = min(max(int((y - lower[1]) / size[1]), 0), shape[1] - 1)
        low = min(max(int((z - lower[2] - reach) / size[2]), 0), shape[2] - 1)
        high = min(max(int((z - lower[2] + reach) / size[2]), 0), shape[2] - 1) + 1
        begin = count
        walls = kind[i] != 0
        for a in range(max(cx - 1, 0), min(cx + 2, shape[0])):
            for b in range(max(cy - 1, 0), min(cy + 2, shape[1])):
                line = (a * shape[1] + b) * shape[2]
                k0, k1 = start[line + low], start[line + high]
                if count + k1 - k0 > capacity:
                    return -1
                for k in range(k0, k1):  # without branches, which could not be predicted
                    dx, dy, dz = sx[k] - x, sy[k] - y, sz[k] - z
                    near = dx * dx + dy * dy + dz * dz < reach2 and order[k] != i
                    other[count] = order[k]
                    count += near
                    walls |= near and solid[k]
        if walls or baffled:
            end, count = count, begin
            for k in range(begin, end):
                j = other[k]
                if _sees(i, j, position, kind, normal, solids, wall_pairs):
                    other[count] = j
                    count += 1
        for k in range(begin + 1, count):  # ascending: short, and nearly sorted already
            j, m = other[k], k
            while m > begin and other[m - 1] > j:
                other[m] = other[m - 1]
                m -= 1
            other[m] = j
        first[i + 1] = count
    return count


@compiled
def _sees(i, j, position, kind, normal, solids, wall_pairs):
    """Whether particle j is a neighbour of i, apart from the distance."""
    if kind[j] == 3:
        return False
    dx = position[j, 0] - position[i, 0]
    dy = position[j, 1] - position[i, 1]
    dz = position[j, 2] - position[i, 2]
    if kind[i] == 0:
        if kind[j] != 0:
            return dx * normal[j, 0] + dy * normal[j, 1] + dz * normal[j, 2] < 0.0
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        return solids.shape[0] == 0 or not crosses_solid(x, y, z, x + dx, y + dy, z + dz, solids)
    if kind[j] == 0:
        return dx * normal[i, 0] + dy * normal[i, 1] + dz * normal[i, 2] > 0.0
    return wall_pairs


@compiled
def bounds(position, kind):
    """Corners of the box around all particles that did not leave the tank.

    Parameters
    ----------
    position : (n, 3) float64, m
    kind : (n,) int8

    Returns
    -------
    (2, 3) float64, m
        Infinite, upper below lower, if there are none.
    """
    box = np.empty((2, 3))
    box[0], box[1] = np.inf, -np.inf
    for i in range(position.shape[0]):
        if kind[i] != 3:
            for d in range(3):
                box[0, d] = min(box[0, d], position[i, d])
                box[1, d] = max(box[1, d], position[i, d])
    return box
