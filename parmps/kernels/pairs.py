"""Neighbour search on cell-sorted particles, in linear time."""

import numpy as np
from numba import njit

from parmps.kernels.compiled import compiled
from parmps.kernels.lanes import LANES, append_near
from parmps.kernels.walls import beside_solid, crosses_solid

CLOSEST = np.float32(1e-20)
"""Square of the least distance, in spacings, that weights over squares tell: they must be finite."""


@compiled
def sort_into_cells(position, kind, lower, size, shape):
    """Sort particles by their kind and the cell that they lie in (counting sort).

    Parameters
    ----------
    position : (n, 3) float64, m
    kind : (n,) int8
        0 fluid, 1 wall, 2 dummy, 3 out of the tank (in no cell).
    lower : (3,) float64, m
        Lower corner of the grid; particles outside are put into the nearest cell.
    size : (3,) float64, m
        Edges of a cell.
    shape : (3,) int64
        Number of cells along each axis.

    Returns
    -------
    start : (3 cells + 1,) uint32
        Where each cell begins in ``order``: first those of the fluid, then of the walls, then of the dummies.
    order : (n + LANES,) uint32
        Particle indices, cell by cell, ascending within a cell; room at the end.
    at : (3, n + LANES) float64, m
        Positions in that order.
    """
    n = position.shape[0]
    cells = 3 * shape[0] * shape[1] * shape[2]
    cell = np.empty(n, np.uint32)
    px, py, pz = 1.0 / size[0], 1.0 / size[1], 1.0 / size[2]
    start = np.zeros(cells + 2, np.uint32)
    for i in range(n):
        cell[i] = cells
        if kind[i] != 3:
            a = min(max(int((position[i, 0] - lower[0]) * px), 0), shape[0] - 1)
            b = min(max(int((position[i, 1] - lower[1]) * py), 0), shape[1] - 1)
            c = min(max(int((position[i, 2] - lower[2]) * pz), 0), shape[2] - 1)
            cell[i] = ((kind[i] * shape[0] + a) * shape[1] + b) * shape[2] + c
        start[cell[i] + 1] += 1
    for c in range(1, start.shape[0]):
        start[c] += start[c - 1]
    place = start[:-1].copy()
    order, at = np.empty(n + LANES, np.uint32), np.empty((3, n + LANES))
    for i in range(n):
        k = place[cell[i]]
        place[cell[i]] += 1
        order[k] = i
        at[0, k], at[1, k], at[2, k] = position[i, 0], position[i, 1], position[i, 2]
    return start[:-1], order, at


@compiled
def mark_beside_walls(start, shape, span):
    """Tell the cells whose particles may have walls or dummies as neighbours.

    Parameters
    ----------
    start : (3 cells + 1,) uint32
        As made by `sort_into_cells`.
    shape : (3,) int64
    span : int
        How many cells along z a neighbour can be away.

    Returns
    -------
    (shape) bool
    """
    nx, ny, nz = shape[0], shape[1], shape[2]
    cells = nx * ny * nz
    column = np.empty((nx, ny, nz), np.bool_)  # such particles in the same column of cells
    for a in range(nx):
        for b in range(ny):
            line = cells + (a * ny + b) * nz
            for c in range(nz):
                low, high = line + max(c - span, 0), line + min(c + span + 1, nz)
                column[a, b, c] = start[high] > start[low] or start[high + cells] > start[low + cells]
    beside = np.zeros((nx, ny, nz), np.bool_)
    for a in range(nx):
        for b in range(ny):
            for p in range(max(a - 1, 0), min(a + 2, nx)):
                for q in range(max(b - 1, 0), min(b + 2, ny)):
                    for c in range(nz):
                        beside[a, b, c] |= column[p, q, c]
    return beside


@compiled
def find_pairs(
    position,
    kind,
    normal,
    depth,
    rows,
    reach,
    lower,
    size,
    shape,
    start,
    order,
    at,
    beside,
    solids,
    wall_pairs,
    first,
    last,
    other,
    square,
):
    """List the neighbours of the first particles: fluid, then walls, then dummies.

    No pair reaches through a solid, so that liquid on the two sides of a thin baffle does not interact. A wall
    particle is where its surface is, so that one at the edge of a baffle is seen from around it; away from
    solids it is seen from the side that its normal points to.

    Parameters
    ----------
    position : (n, 3) float64, m
    kind : (n,) int8
        0 fluid, 1 wall, 2 dummy, 3 out of the tank (has no neighbours).
    normal : (n, 3) float64
        Of walls and dummies, into the liquid.
    depth : (n,) float64, m
        Of walls and dummies below their surface.
    rows : int
        Number of particles to find neighbours for: fluid and walls.
    reach : float
        Greatest distance of a pair, m.
    lower, size, shape
        The cell grid, as in `sort_into_cells`; edges along x and y are not less than ``reach``. Along z, where
        cells that follow each other are one stretch of the sorted particles, short edges cost nothing and
        leave fewer candidates.
    start, order, at
        As made by `sort_into_cells`.
    beside : (shape) bool
        As made by `mark_beside_walls`; in other cells, walls are not looked for.
    solids : (m, 2, 3) float64, m
        Corners of what hides.
    wall_pairs : bool
        Whether walls are also neighbours of walls; the papers' scheme needs that.
    first : (rows + 1,) uint32
        Filled: where the neighbours of each particle begin in ``other``.
    last : (rows,) uint32
        Filled: where its dummies begin.
    other : (capacity,) uint32
        Filled: the neighbours. Particles at one place do not see each other.
    square : (capacity,) float32, m2
        Filled: the squares of the distances.

    Returns
    -------
    int
        Number of pairs, or -1 where the capacity does not suffice.
    """
    ex, ey, ez = 1.0 / size[0], 1.0 / size[1], 1.0 / size[2]
    sx, sy, sz = at[0], at[1], at[2]
    reach2 = reach * reach
    capacity = other.shape[0]
    count = np.uint64(0)  # unsigned, as all indices here: a negative one would count from the end, at a cost
    first[0] = 0
    for i in range(rows):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        cx = min(max(int((x - lower[0]) * ex), 0), shape[0] - 1)
        cy = min(max(int((y - lower[1]) * ey), 0), shape[1] - 1)
        cz = min(max(int((z - lower[2]) * ez), 0), shape[2] - 1)
        low = min(max(int((z - lower[2] - reach) * ez), 0), shape[2] - 1)
        high = min(max(int((z - lower[2] + reach) * ez), 0), shape[2] - 1) + 1
        liquid = kind[i] == 0
        groups = 0 if kind[i] == 3 else 3 if (liquid and beside[cx, cy, cz]) or wall_pairs else 1
        last[i] = count
        for group in range(groups):
            here = count
            for a in range(max(cx - 1, 0), min(cx + 2, shape[0])):
                for b in range(max(cy - 1, 0), min(cy + 2, shape[1])):
                    line = ((group * shape[0] + a) * shape[1] + b) * shape[2]
                    k0, k1 = start[line + low], start[line + high]
                    if count + k1 - k0 + LANES > capacity:
                        return -1
                    for k in range(k0, k1, LANES):
                        count = append_near(
                            sx, sy, sz, order, np.uint64(k), np.uint64(k1), x, y, z, reach2, other, square, count
                        )
            if liquid and group == 0:
                if beside_solid(x, y, z, reach, solids):
                    count = _keep_unhidden(i, position, solids, here, count, other, square)
            elif liquid or group == 0:
                count = _keep_before_walls(
                    i, position, normal, depth, liquid, reach, solids, here, count, other, square
                )
            if group < 2:
                last[i] = count
        first[i + 1] = count
    return np.int64(count)


@compiled
def _keep_unhidden(i, position, solids, begin, end, other, square):
    """Drop the neighbours of particle i that a baffle hides; return the new end."""
    count = begin
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(begin, end):
        j = other[k]
        if not crosses_solid(x, y, z, position[j, 0], position[j, 1], position[j, 2], solids):
            other[count], square[count] = j, square[k]
            count += np.uint64(1)
    return count


@compiled
def _keep_before_walls(i, position, normal, depth, liquid, reach, solids, begin, end, other, square):
    """Drop the pairs of liquid with walls that it does not see, of which one is particle i; return the new end."""
    count = begin
    for k in range(begin, end):
        j = other[k]
        wet, wall = (i, j) if liquid else (j, i)
        x, y, z = position[wet, 0], position[wet, 1], position[wet, 2]
        at, n, d = position[wall], normal[wall], depth[wall]
        if beside_solid(x, y, z, reach, solids):
            seen = not crosses_solid(x, y, z, at[0] + d * n[0], at[1] + d * n[1], at[2] + d * n[2], solids)
        else:
            seen = (x - at[0]) * n[0] + (y - at[1]) * n[1] + (z - at[2]) * n[2] > 0.0
        other[count], square[count] = j, square[k]
        count += np.uint64(seen)
    return count


@compiled
def bounds(position, kind, count):
    """Corners of the box around the first particles that did not leave the tank.

    Parameters
    ----------
    position : (n, 3) float64, m
    kind : (n,) int8
    count : int

    Returns
    -------
    (2, 3) float64, m
        Infinite, upper below lower, if there are none.
    """
    box = np.empty((2, 3))
    box[0], box[1] = np.inf, -np.inf
    for i in range(count):
        if kind[i] != 3:
            for d in range(3):
                box[0, d] = min(box[0, d], position[i, d])
                box[1, d] = max(box[1, d], position[i, d])
    return box


@njit(inline="always")
def _in_box(position, i, lower, upper):
    """Whether particle i is in a box; all comparisons are done, without a branch."""
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    return (lower[0] <= x) & (x <= upper[0]) & (lower[1] <= y) & (y <= upper[1]) & (lower[2] <= z) & (z <= upper[2])


@compiled
def within(position, lower, upper):
    """Tell which particles are in a box.

    Parameters
    ----------
    position : (n, 3) float64, m
    lower, upper : (3,) float64, m
        Its corners, which belong to it.

    Returns
    -------
    (n,) bool
    """
    inside = np.empty(position.shape[0], np.bool_)
    for i in range(position.shape[0]):
        inside[i] = _in_box(position, i, lower, upper)
    return inside


@compiled
def any_within(position, known, lower, upper):
    """Tell whether a particle is in a box that is not among known ones.

    Parameters
    ----------
    position, lower, upper
        As in `within`.
    known : (n,) bool

    Returns
    -------
    bool
    """
    found = False
    for i in range(position.shape[0]):
        found |= _in_box(position, i, lower, upper) & (not known[i])
    return found


@compiled
def strengths(square, count, l0, reach, out):
    """Weights over squared distances, W / r^2, which the operators of first order share ([004] eqs. 4 to 6).

    One loop over all pairs, which vector registers do, with one division: two take a quarter longer. In single
    precision, which takes half of the memory that all operators wait for: 1e-7 of a weight is far below what the
    particles' disorder does, and both particles of a pair have the same, so that nothing loses its symmetry.

    Parameters
    ----------
    square : (capacity,) float32, m2
        As made by `find_pairs`.
    count : int
        Number of pairs.
    l0 : float
        Spacing, m.
    reach : float
        Radius r_e, in spacings; weights of pairs beyond it are 0.
    out : (capacity,) float32, 1/m2
        Filled; may be ``square`` itself.
    """
    to_spacings, end = np.float32(1.0 / (l0 * l0)), np.float32(reach)
    most, slope, level = np.float32(0.85) * to_spacings, np.float32(0.85), np.float32(0.15 * reach)
    for k in range(count):
        r2 = max(square[k] * to_spacings, CLOSEST)
        r = np.sqrt(r2)
        out[k] = most * max(end - r, np.float32(0.0)) / ((slope * r + level) * r2)  # `weight` / r2
