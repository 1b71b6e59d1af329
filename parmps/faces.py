"""The face area that each particle of the wall layer stands for."""

import numpy as np
from scipy.spatial import cKDTree

from parmps.kernels.walls import distances
from parmps.lattice import ROUNDING, distance_to_box

FINE = {2: 16, 3: 4}
"""By dimension, samples in a spacing along each axis of a face, where a baffle meets a curved or sloped wall."""
TURN = 0.5
"""Distance in spacings that counts as much as two normals at right angles, over the root of 2, where faces meet."""
BEFORE = 1e-3
"""In spacings; how far before a face is what it belongs to."""


def faces(geometry, position, normal, depth):
    """Find the face area that each particle of the wall layer stands for.

    The areas of a face's particles add up to the face: a particle at a convex edge of a baffle has a part of
    each of the faces that meet there, one in a concave corner has none.

    Parameters
    ----------
    geometry : Geometry
    position : (n, 3) float64, m
        Particles of the wall layer (kind 1).
    normal : (n, 3) float64
    depth : (n,) float64, m

    Returns
    -------
    owner : (n,) int64
        0 for the tank, k for its k-th baffle.
    area : (n, 3) float64, m2 (m in 2D)
        Directed out of the liquid: times the pressure, it is the force on the wall.
    """
    surface = position + depth[:, None] * normal
    near = BEFORE * geometry.spacing
    owner = np.zeros(len(position), np.int64)
    for number, solid in enumerate(geometry.solids, start=1):
        # the tank's own particles keep clear of baffles by more than this
        for box in solid.boxes:
            owner[np.abs(distance_to_box(surface, box)) < near] = number
    if geometry.hull is not None and geometry.solids:
        return owner, _sampled(geometry, surface, normal, owner)
    area = np.zeros_like(position)
    low, high = geometry.walls.container
    edges = [axis.edges for axis in geometry.axes]
    mine = owner == 0
    if geometry.hull is None:
        area[mine] = _face_area(position[mine], surface[mine], normal[mine], high[None], low[None], edges, near)
        area[mine & (np.count_nonzero(np.abs(normal) > ROUNDING, axis=1) > 1)] = 0.0
    else:
        area[mine] = _hull_area(geometry, position[mine], normal[mine])
    for number, solid in enumerate(geometry.solids, start=1):
        mine = owner == number
        low, high = solid.box
        lower, upper = np.vstack([low, solid.openings[:, 1]]), np.vstack([high, solid.openings[:, 0]])
        edges = [axis.edges for axis in solid.axes]
        area[mine] = _face_area(position[mine], surface[mine], normal[mine], lower, upper, edges, near)
    return owner, area


def _sampled(geometry, surface, normal, owner):
    """Areas from samples of the faces inside the tank and outside of the baffles, each of the nearest particle.

    Baffles meet curved and sloped walls in the middle of the particles' faces: whole ones count what no liquid touches.
    """
    tight, area = geometry.walls._replace(open_top=False), np.zeros_like(surface)
    sets = [_hull_samples(geometry), *(_solid_samples(geometry, solid) for solid in geometry.solids)]
    for number, (point, out) in enumerate(sets):
        unit = out / np.linalg.norm(out, axis=1)[:, None]
        wet = distances(point - BEFORE * geometry.spacing * unit, tight)[0] > 0.0
        mine = np.flatnonzero(owner == number)
        if not len(mine) or not wet.any():
            continue
        turn = TURN * geometry.spacing
        tree = cKDTree(np.hstack([surface[mine], turn * normal[mine]]))
        nearest = tree.query(np.hstack([point[wet], -turn * unit[wet]]))[1]
        np.add.at(area, mine[nearest], out[wet])
    return area


def _hull_samples(geometry):
    """Points of the tank's wall and the areas, directed out of the liquid, that they stand for."""
    fine, across = geometry.spacing / FINE[geometry.dimension], list(geometry.hull_axes)
    shell = geometry.hull.shell(0.0, fine)
    used = np.abs(shell.area).max(axis=1) > 0.0
    point, out = np.zeros((used.sum(), 3)), np.zeros((used.sum(), 3))
    point[:, across], out[:, across] = shell.position[used], shell.area[used]
    if geometry.dimension == 2 or 0 in across:
        return point, out
    along = geometry.axes[0]
    count = len(along.points) * FINE[3]
    step = (along.high - along.low) / count
    points, outs = np.tile(point, (count, 1)), np.tile(out * step, (count, 1))
    points[:, 0] = np.repeat(along.low + (np.arange(count) + 0.5) * step, len(point))
    grid = _grid([(axis.low, axis.high) for axis in geometry.axes[1:]], fine)
    grid = grid[geometry.hull.distance(grid)[0] > 0.0]
    share = geometry.arrangement.content.sum() / len(grid)
    for x, side in ((along.low, -1.0), (along.high, 1.0)):
        points = np.vstack([points, np.insert(grid, 0, x, axis=1)])
        outs = np.vstack([outs, np.tile([side * share, 0.0, 0.0], (len(grid), 1))])
    return points, outs


def _solid_samples(geometry, solid):
    """Points of a baffle's faces and the areas, directed out of the liquid, that they stand for."""
    fine, points, outs = geometry.spacing / FINE[geometry.dimension], [], []
    axes = (0, 2) if geometry.dimension == 2 else (0, 1, 2)
    low, high = geometry.walls.container
    for box in solid.boxes:
        box = np.clip(box, np.where(np.isfinite(low), low, 0.0), np.where(np.isfinite(high), high, 0.0))
        for axis in axes:
            others = [other for other in axes if other != axis]
            grid, area = _grid([box[:, other] for other in others], fine), 1.0
            for other in others:
                length = box[1, other] - box[0, other]
                area *= length / max(int(np.ceil(length / fine)), 1)
            for side in (0, 1):
                point, out = np.zeros((len(grid), 3)), np.zeros((len(grid), 3))
                point[:, others], point[:, axis] = grid, box[side, axis]
                out[:, axis] = area if side == 0 else -area
                points.append(point)
                outs.append(out)
    return np.concatenate(points), np.concatenate(outs)


def _grid(bounds, step):
    """Centres of equal cells of at most a step between bounds: (n, len(bounds)) float64."""
    axes = []
    for low, high in bounds:
        count = max(int(np.ceil((high - low) / step)), 1)
        axes.append(low + (np.arange(count) + 0.5) * (high - low) / count)
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(bounds))


def _hull_area(geometry, position, normal):
    """Area of the tank's wall that points of a hull's wall layer, or of the ends of a straight tank, stand for."""
    across, arrangement = list(geometry.hull_axes), geometry.arrangement
    points, shell = arrangement.points, arrangement.shells[0]
    _, number = cKDTree(np.concatenate([points, shell.position])).query(position[:, across])
    on_hull = number >= len(points)
    area = np.zeros_like(position)
    area[np.ix_(on_hull, across)] = shell.area[number[on_hull] - len(points)]
    along = geometry.axes[0]
    if 0 in across:
        return area
    inside = (position[:, 0] > along.low) & (position[:, 0] < along.high)
    cell = np.searchsorted(along.edges, position[:, 0], side="right") - 1
    area *= (inside * np.diff(along.edges)[np.clip(cell, 0, len(along.points) - 1)])[:, None]
    area[~on_hull, 0] = -normal[~on_hull, 0] * arrangement.content.sum() / len(points)
    return area


def _face_area(position, surface, normal, minus, plus, edges, near):
    """Area of the faces that points of them stand for, given places (k, 3) where normals are negative and positive."""
    width = np.empty_like(surface)
    for axis, bounds in enumerate(edges):
        cell = np.searchsorted(bounds, position[:, axis], side="right") - 1
        width[:, axis] = np.diff(bounds)[np.clip(cell, 0, len(bounds) - 2)]
    used = np.abs(normal) > ROUNDING
    near_minus = (np.abs(surface - minus[:, None]) < near).any(axis=0)
    near_plus = (np.abs(surface - plus[:, None]) < near).any(axis=0)
    on_face = used & np.where(normal < 0, near_minus, near_plus)
    # a normal that leans away from a face that is none belongs to a concave corner
    on_face &= (on_face == used).all(axis=1)[:, None]
    area = np.empty_like(surface)
    for axis in range(3):
        area[:, axis] = np.prod(np.delete(width, axis, axis=1), axis=1)
    return np.where(on_face, -np.sign(normal) * area, 0.0)
