"""Even arrangements of particles next to walls and interfaces that no lattice fits."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from parmps.kernels.packing import sum_asymmetry
from parmps.kernels.weight import lattice

ROUNDING = 1e-6
"""In spacings; forgives the rounding of decimal input."""
REACH = 2.1
"""Radius of the neighbourhood whose asymmetry is evened out, in spacings: that of the scheme's shifting."""
STEPS = 100
RENEW = 10
"""Steps between two searches for neighbours, and"""
MARGIN = 0.6
"""how far beyond the radius these look, in spacings."""
SHARE = 0.15
"""Of the asymmetry that a step removes."""
LARGEST = 0.1
"""Way of a particle in one step, in spacings."""
BAND = 4.0
"""Distance from the walls beyond which the lattice is kept, in spacings."""
CLEARANCE = {"half": 0.4, "line": 0.8, "interface": 0.4}
"""Least distance from a wall or from an interface, in spacings."""


@dataclass(frozen=True)
class Arrangement:
    """Where particles stand in a hull and outside it, in the hull's coordinates.

    Attributes
    ----------
    points : (n, d) float64, m
        Inside, in ascending order of the first coordinate.
    layer : (n,) int64
        Layer of liquid that each point lies in, bottom first; above the liquid, the number of layers.
    content : (layers + 1,) float64, m2 or m3
        Of each layer, and above them.
    shells : tuple of Shell
        Wall layer and dummies.
    parents : tuple of (m,) int64
        For each shell, the point of the wall layer that each of its points is nearest to.
    """

    points: np.ndarray
    layer: np.ndarray
    content: np.ndarray
    shells: tuple
    parents: tuple


def arrange(hull, axes, layer_rows, levels, spacing, inset, layers):
    """Fill a hull with as many points as its content asks for, evenly spaced near its walls.

    In each layer of liquid, those points of the lattice that are deepest inside are kept, and moved until
    they are even.

    Parameters
    ----------
    hull : Polygon, Round or Mesh
    axes : sequence of d Axis
        Lattice along the hull's coordinates.
    layer_rows : sequence of int
        Number of the lowest row above each layer of liquid.
    levels : sequence of float
        Heights of the tops of the layers, m.
    spacing : float, m
    inset : float
        Depth of the wall layer, in spacings: 0.5, or 0 where walls are on the wall line.
    layers : int
        Wall layer plus dummy layers.

    Returns
    -------
    Arrangement
    """
    shells = tuple(hull.shell((k + inset) * spacing, spacing) for k in range(layers))
    tree = cKDTree(shells[0].position)
    parents = tuple(tree.query(shell.position)[1] for shell in shells)
    grid = np.meshgrid(*[axis.points for axis in axes], indexing="ij")
    lattice_points = np.stack(grid, axis=-1).reshape(-1, len(axes))
    gap = hull.distance(lattice_points)[0]
    rows = np.minimum([0, *layer_rows, np.iinfo(int).max], len(axes[-1].points))
    row = np.tile(np.arange(rows[-1]), len(lattice_points) // rows[-1])
    turn = _turn([len(axis.points) for axis in axes])
    bounds = np.concatenate([[0.0], levels, [axes[-1].high]])
    content = np.diff([hull.content_below(level) for level in bounds])
    heights = axes[-1].points
    chosen, layer, low, high = [], [], [], []
    for k, first, last in _blocks(rows):
        here = np.flatnonzero((row >= first) & (row < last))
        if inset:
            height = (bounds[k + 1] - bounds[k]) / (rows[k + 1] - rows[k])
            cell = height * np.prod([axis.step for axis in axes[:-1]])
            below = hull.content_below(bounds[k] + (last - rows[k]) * height) - hull.content_below(bounds[k])
            count = round(below / cell) - sum(len(block) for block, of in zip(chosen, layer, strict=True) if of[0] == k)
        else:  # the liquid keeps a spacing from the wall
            count = np.count_nonzero(gap[here] > (0.5 + ROUNDING) * spacing)
        kept = here[np.lexsort((turn[here], -np.rint(gap[here] / (1e-3 * spacing))))[:count]]
        chosen.append(kept)
        layer.append(np.full(len(kept), k))
        low.append(np.full(len(kept), heights[first]))
        high.append(np.full(len(kept), heights[last - 1]))
    chosen, layer, low, high = map(np.concatenate, (chosen, layer, low, high))
    points = lattice_points[chosen]
    moves = gap[chosen] < BAND * spacing
    fixed = np.concatenate([points[~moves], *[shell.position for shell in shells]])
    clearance = CLEARANCE["half" if inset else "line"] * spacing
    points[moves] = pack(points[moves], fixed, spacing, hull.distance, clearance, low[moves], high[moves])
    order = np.argsort(points[:, 0], kind="stable")
    return Arrangement(points[order], layer[order], content, shells, parents)


def _blocks(rows):
    """Rows that are filled together: those of each layer, but for the ones beside another layer, which stay level.

    Where rows may leave their level, the surface begins with waves of a spacing or two.

    Parameters
    ----------
    rows : sequence of int
        First row of each layer, and the end of the last.

    Yields
    ------
    layer, first, last : int
    """
    for k, (first, last) in enumerate(zip(rows[:-1], rows[1:], strict=True)):
        inner = [first + (first > rows[0]), last - (last < rows[-1])]
        cuts = sorted({first, last, *(cut for cut in inner if first <= cut <= last)})
        yield from ((k, *block) for block in zip(cuts[:-1], cuts[1:], strict=True))


def _turn(shape):
    """Order in which equally deep points of a lattice are kept, so that opposite walls and neighbours alternate."""
    index = np.indices(shape).reshape(len(shape), -1)
    opposite = np.array(shape)[:, None] - 1 - index
    row, side = index[-1], (index < opposite)[:-1].sum(axis=0)
    scattered = np.sqrt([[2.0], [3.0], [5.0]][: len(shape)]) * np.minimum(index, opposite)
    return (row + side) % 2 + scattered.sum(axis=0) % 1.0


def pack(movable, fixed, spacing, distance, clearance, low, high):
    """Move particles until their neighbourhoods are even.

    Each step shifts the particles along their asymmetry F = D/n0 sum W (r_i - r_j)/r_ij, as the scheme does
    while the liquid moves (Lind 2012); the walls and the lattice around them stay.

    Parameters
    ----------
    movable : (n, d) float64, m
    fixed : (m, d) float64, m
        Walls, and the particles that keep their places.
    spacing : float, m
    distance : function
        Distance from the walls and the normal into the tank at points (n, d).
    clearance : float, m
        Least distance from the walls.
    low, high : (n,) float64, m
        Bounds of the last coordinate, between which each particle stays: those of its layer.

    Returns
    -------
    (n, d) float64, m
    """
    at = movable.copy()
    dimension = at.shape[1]
    for step in range(STEPS):
        if step % RENEW == 0:
            own, others = neighbours(at, at, spacing), neighbours(at, fixed, spacing)
        force = SHARE * (asymmetry(at, at, own, spacing, dimension) + asymmetry(at, fixed, others, spacing, dimension))
        size = np.linalg.norm(force, axis=1)
        at += spacing * force * np.minimum(1.0, LARGEST / np.maximum(size, 1e-300))[:, None]
        for _ in range(2):
            gap, normal = distance(at)
            at += np.maximum(clearance - gap, 0.0)[:, None] * normal
        at[:, -1] = np.clip(at[:, -1], low, high)
    return at


def pack_around(points, inside, spheres, spacing):
    """Move particles near spheres, or circles, until those on either side stand evenly along them.

    Parameters
    ----------
    points : (n, d) float64, m
        All within `BAND` spacings of a sphere, and their neighbours, which stay.
    inside : (n, spheres) bool
        In which sphere each point is to be.
    spheres : sequence of (centre, radius)
        (d,) float64 and float, m.
    spacing : float, m

    Returns
    -------
    (n, d) float64, m
    """
    side = np.where(inside, 1.0, -1.0)

    def gaps(at):
        offset = np.stack([at - centre for centre, _ in spheres], axis=1)
        r = np.maximum(np.linalg.norm(offset, axis=2), 1e-3 * spacing)
        return np.array([radius for _, radius in spheres]) - r, offset / r[:, :, None]

    moves = (np.abs(gaps(points)[0]) < BAND * spacing).any(axis=1)
    side, rows = side[moves], np.arange(np.count_nonzero(moves))

    def distance(at):
        depth, outwards = gaps(at)
        nearest = np.argmin(side * depth, axis=1)
        sign = side[rows, nearest]
        return sign * depth[rows, nearest], -sign[:, None] * outwards[rows, nearest]

    at, anywhere = points.copy(), np.full(len(rows), np.inf)
    clearance = CLEARANCE["interface"] * spacing
    at[moves] = pack(points[moves], points[~moves], spacing, distance, clearance, -anywhere, anywhere)
    return at


def neighbours(position, other, spacing):
    """Pairs of points that are, or may come before the pairs are renewed, within reach of each other.

    Parameters
    ----------
    position : (n, d) float64, m
    other : (m, d) float64, m
    spacing : float, m

    Returns
    -------
    (2, k) int64
        Numbers of the points, and of the others; where these are the same array, each pair once.
    """
    reach = (REACH + MARGIN) * spacing
    if other is position:
        return cKDTree(position).query_pairs(reach, output_type="ndarray").T
    near = cKDTree(position).sparse_distance_matrix(cKDTree(other), reach, output_type="ndarray")
    return np.stack([near["i"], near["j"]])


def asymmetry(position, other, pairs, spacing, dimension):
    """Asymmetry F = D/n0 sum W (r_i - r_j)/r_ij of points among others.

    Parameters
    ----------
    position : (n, d) float64, m
    other : (m, d) float64, m
    pairs : (2, k) int64
        As made by `neighbours`.
    spacing : float, m
    dimension : int
        That of the lattice which F is scaled by; 2 for points on a surface.

    Returns
    -------
    (n, d) float64
    """
    scale = dimension / lattice(dimension, REACH).density
    return sum_asymmetry(position, other, pairs, spacing, REACH, scale, other is position)
