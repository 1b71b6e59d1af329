"""Neighbour search on cell-sorted particles, in linear time."""

import math

import numpy as np

from parmps.kernels.compiled import compiled
from parmps.kernels.walls import crosses_solid
from parmps.kernels.weight import weight


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
    per = 1.0 / size
    start = np.zeros(shape[0] * shape[1] * shape[2] + 1, np.int64)
    for i in range(n):
        c = 0
        for d in range(3):
            k = int((position[i, d] - lower[d]) * per[d])
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
def find_pairs(
    position, kind, normal, rows, reach, lower, size, shape, solids, wall_pairs, first, last, other, square
):
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
    last : (rows,) int64
        Filled: where its dummies begin, which come after all others.
    other : (capacity,) int32
        Filled: the neighbours. Particles at one place do not see each other.
    square : (capacity,) float64, m2
        Filled: the squares of the distances.

    Returns
    -------
    int
        Number of pairs, or -1 where the capacity does not suffice.
    """
    start, order = sort_into_cells(position, lower, size, shape)
    n = order.shape[0]
    sx, sy, sz = np.empty(n), np.empty(n), np.empty(n)
    solid = np.zeros(n + 1, np.int32)  # number of particles before this one that are not fluid
    for k in range(n):
        i = order[k]
        sx[k], sy[k], sz[k] = position[i, 0], position[i, 1], position[i, 2]
        solid[k + 1] = solid[k] + (kind[i] != 0)
    ex, ey, ez = 1.0 / size[0], 1.0 / size[1], 1.0 / size[2]
    reach2 = reach * reach
    baffled = solids.shape[0] > 0
    capacity = other.shape[0]
    count = 0
    first[0] = 0
    for i in range(rows):
        if kind[i] == 3:
            first[i + 1] = last[i] = count
            continue
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        cx = min(max(int((x - lower[0]) * ex), 0), shape[0] - 1)
        cy = min(max(int((y - lower[1]) * ey), 0), shape[1] - 1)
        low = min(max(int((z - lower[2] - reach) * ez), 0), shape[2] - 1)
        high = min(max(int((z - lower[2] + reach) * ez), 0), shape[2] - 1) + 1
        begin = count
        plain = kind[i] == 0 and solids.shape[0] == 0
        for a in range(max(cx - 1, 0), min(cx + 2, shape[0])):
            for b in range(max(cy - 1, 0), min(cy + 2, shape[1])):
                line = (a * shape[1] + b) * shape[2]
                k0, k1 = start[line + low], start[line + high]
                if count + k1 - k0 > capacity:
                    return -1
                plain &= solid[k0] == solid[k1]
                for k in range(k0, k1):  # without branches, which could not be predicted
                    dx, dy, dz = sx[k] - x, sy[k] - y, sz[k] - z
                    r2 = dx * dx + dy * dy + dz * dz
                    other[count], square[count] = order[k], r2
                    count += (r2 < reach2) & (r2 > 0.0)
        last[i] = count
        if not plain:
            end, count = count, begin
            dummies = 0
            for k in range(begin, end):
                j = other[k]
                if (kind[i] != 0 or kind[j] != 0 or baffled) and not _sees(
                    i, j, position, kind, normal, solids, wall_pairs
                ):
                    continue
                r2 = square[k]
                if kind[j] == 2:
                    dummies += 1
                elif dummies:  # changes places with the first dummy
                    m = count - dummies
                    other[count], square[count] = other[m], square[m]
                    other[m], square[m] = j, r2
                    count += 1
                    continue
                other[count], square[count] = j, r2
                count += 1
            last[i] = count - dummies
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


@compiled
def strengths(square, count, l0, reach, out):
    """Weights over squared distances, W / r^2, which the operators of first order share ([004] eqs. 4 to 6).

    One loop over all pairs, which vector registers do.

    Parameters
    ----------
    square : (capacity,) float64, m2
        As made by `find_pairs`.
    count : int
        Number of pairs.
    l0 : float
        Spacing, m.
    reach : float
        Radius r_e, in spacings; weights of pairs beyond it are 0.
    out : (capacity,) float64, 1/m2
        Filled; may be ``square`` itself.
    """
    to_spacings = 1.0 / (l0 * l0)
    for k in range(count):
        r2 = square[k] * to_spacings
        out[k] = max(weight(math.sqrt(r2), reach), 0.0) / r2 * to_spacings
