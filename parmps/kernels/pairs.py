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
    size : float
        Edge of a cell, m.
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
            k = int((position[i, d] - lower[d]) / size)
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
def find_pairs(position, kind, normal, rows, reach, lower, shape, solids, wall_pairs, first, other):
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
    lower, shape
        The cell grid, of edge ``reach``; as in `sort_into_cells`.
    solids : (m, 2, 3) float64, m
        Corners of the baffles.
    wall_pairs : bool
        Whether walls are also neighbours of walls; the papers' scheme needs that.
    first : (rows + 1,) int64
        Filled: where the neighbours of each particle begin in ``other``.
    other : (capacity,) int32
        Filled: the neighbours.

    Returns
    -------
    int
        Number of pairs; where it is above the capacity, the lists are not complete.
    """
    start, order = sort_into_cells(position, lower, reach, shape)
    sorted_position = np.empty_like(position)
    for k in range(order.shape[0]):
        sorted_position[k] = position[order[k]]
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
        cx = min(max(int((x - lower[0]) / reach), 0), shape[0] - 1)
        cy = min(max(int((y - lower[1]) / reach), 0), shape[1] - 1)
        cz = min(max(int((z - lower[2]) / reach), 0), shape[2] - 1)
        low, high = max(cz - 1, 0), min(cz + 2, shape[2])
        for a in range(max(cx - 1, 0), min(cx + 2, shape[0])):
            for b in range(max(cy - 1, 0), min(cy + 2, shape[1])):
                line = (a * shape[1] + b) * shape[2]
                for k in range(start[line + low], start[line + high]):
                    dx = sorted_position[k, 0] - x
                    dy = sorted_position[k, 1] - y
                    dz = sorted_position[k, 2] - z
                    if dx * dx + dy * dy + dz * dz >= reach2:
                        continue
                    j = order[k]
                    if j == i or kind[j] == 3:
                        continue
                    if kind[i] == 0:
                        if kind[j] != 0 and dx * normal[j, 0] + dy * normal[j, 1] + dz * normal[j, 2] >= 0.0:
                            continue
                    elif kind[j] == 0:
                        if dx * normal[i, 0] + dy * normal[i, 1] + dz * normal[i, 2] <= 0.0:
                            continue
                    elif not wall_pairs:
                        continue
                    if baffled and kind[i] == 0 and kind[j] == 0:
                        if crosses_solid(x, y, z, x + dx, y + dy, z + dz, solids):
                            continue
                    if count < capacity:
                        other[count] = j
                    count += 1
        first[i + 1] = count
    return count
