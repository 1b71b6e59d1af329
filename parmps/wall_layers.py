"""Wall and dummy particles: layers around the tank and inside its baffles, which meet without gaps."""

import numpy as np
from scipy.spatial import cKDTree

from parmps.kernels.walls import Walls, distances
from parmps.lattice import ROUNDING, distance_to_box
from parmps.particles import DUMMY, WALL

WALL_CLEARANCE = {"half": 0.01, "line": 0.5}  # least distance of the tank's wall particles from a baffle, in spacings
UNDER_BAFFLE = 0.3  # in spacings; with walls on the wall line, a hull's particles this deep under a baffle are left out
CORNER = 0.5  # in spacings; particles nearer than this to the one in a corner are left out for it
STRETCH = 0.1  # share of a spacing by which layers on a stretched lattice may be deeper
ORPHAN = -2
"""Number of the parent of dummies that have lost theirs."""
def place_walls(geometry):
    """Place all wall and dummy particles.

    Parameters
    ----------
    geometry : Geometry

    Returns
    -------
    dict of str to ndarray
        ``position``, ``kind``, ``normal`` and ``depth`` as in `parmps.tank.Placement`; ``parent`` is the number of a
        dummy's wall particle among these, -1 for wall particles.
    """
    pieces = [_container_walls(geometry) if geometry.hull is None else _hull_walls(geometry)]
    pieces += [_solid_walls(geometry, number) for number in range(len(geometry.solids))]
    if geometry.wall == "half":
        pieces = _meet(geometry, pieces)
    walls, offset = [], 0
    for piece in pieces:
        order = np.argsort(piece["key"])
        at = np.searchsorted(piece["key"], piece["parent_key"], sorter=order)
        parent = order[np.minimum(at, len(order) - 1)] if len(order) else at
        found = (piece["key"][parent] == piece["parent_key"]) & piece["keep"][parent]
        dummy = piece["kind"] == DUMMY
        kept = piece["keep"]
        if geometry.wall == "line":  # a wall particle that another solid hides takes its dummies along
            kept = kept & (~dummy | found)
        renumbered = np.cumsum(kept) - 1 + offset
        wall = {name: piece[name][kept] for name in ("position", "kind", "normal", "depth")}
        wall["parent"] = np.where(dummy, np.where(found, renumbered[parent], ORPHAN), -1)[kept]
        walls.append(wall)
        offset += int(kept.sum())
    walls = {name: np.concatenate([wall[name] for wall in walls]) for name in walls[0]}
    orphans, layer = np.flatnonzero(walls["parent"] == ORPHAN), np.flatnonzero(walls["kind"] == WALL)
    if len(orphans):
        nearest = cKDTree(walls["position"][layer]).query(walls["position"][orphans])[1]
        walls["parent"][orphans] = layer[nearest]
    return walls


# ---- where the tank and its baffles meet


def _meet(geometry, pieces):
    """Let the layers of the tank and its baffles end where they meet, with a particle in each corner between them.

    The layer k of all solids together is where the distance from the nearest of them is -(k - 1/2) spacings, that of
    several being the least of theirs: the parallels of two walls go on until they meet (mitre). The particles of a
    baffle that are within half a spacing of there move along its face to there, and so each face has its own; those of
    the other wall that are nearer than that to these are left out.
    """
    l0 = geometry.spacing
    tank = geometry.walls._replace(solids=np.empty((0, 2, 3)), open_top=False)
    whole = geometry.walls._replace(open_top=False)
    everywhere = np.array([[-np.inf] * 3, [np.inf] * 3])
    bodies = [tank] + [Walls(everywhere, solids=np.array(solid.boxes)) for solid in geometry.solids]
    # the lattice of a baffle goes on into the walls of a box
    first = 1 if geometry.hull is None else 0
    for j in range(1, len(bodies)):
        for i in range(first, j):
            corners = _corner_points(pieces[j], bodies[i], l0)
            if not len(corners["level"]):
                continue
            tree = cKDTree(_with_level(corners["position"], corners["level"], l0))
            near = tree.query(_with_level(pieces[i]["position"], pieces[i]["level"], l0))[0] < CORNER * l0
            pieces[i]["keep"] &= ~near
            # one is enough where several come together
            double = tree.query_pairs(CORNER * l0, output_type="ndarray")
            corners["keep"] = _picked(len(corners["level"]), double)
            pieces[j] = {name: np.concatenate([pieces[j][name], corners[name]]) for name in pieces[j]}
    for j in range(first, len(bodies)):
        piece, depth = pieces[j], (pieces[j]["level"] - 0.5) * l0
        for i in range(first, len(bodies)):
            if i != j:
                piece["keep"] &= distances(piece["position"], bodies[i])[0] > -depth - STRETCH * piece["level"] * l0
        _end_on_walls(piece, whole, l0)
    return pieces


def _with_level(position, level, spacing):
    """Places and layers as points, so that those of different layers are far apart."""
    return np.column_stack([position, 10.0 * spacing * level])


def _picked(count, pairs):
    """Pick points, in their order, of which no two are a pair: (count,) bool."""
    free = np.ones(count, bool)
    for i, j in sorted(map(tuple, pairs)):
        if free[i]:
            free[j] = False
    return free


def _planes(body):
    """Faces of a body that others meet: functions that give the distance from them, and its direction."""
    if not len(body.solids):
        return [lambda at: distances(at, body)]

    def face(axis, place, side):
        normal = np.zeros(3)
        normal[axis] = side
        return lambda at: (side * (at[:, axis] - place), np.tile(normal, (len(at), 1)))

    found = {(axis, box[end, axis], 2 * end - 1) for box in body.solids for axis in range(3) for end in range(2)}
    return [face(*key) for key in sorted(found) if np.isfinite(key[1])]


def _corner_points(piece, body, spacing):
    """Move particles of a baffle along its faces to where their layer meets that of another body.

    Those that are moved are left out of ``piece``, and returned: one for each face that is met.
    """
    level, along = piece["level"], piece["along"]
    depth = (level - 0.5) * spacing
    near = np.flatnonzero(piece["keep"] & (np.abs(distances(piece["position"], body)[0] + depth) < spacing))
    corners = {name: values[:0] for name, values in piece.items()}
    moved = np.zeros(len(level), bool)
    for plane in _planes(body):
        at = piece["position"][near].copy()
        for _ in range(4):
            gap, normal = plane(at)
            way = normal * along[near]
            square = np.einsum("ij,ij->i", way, way)
            at -= ((gap + depth[near]) / np.maximum(square, 0.1))[:, None] * way
        reached = np.linalg.norm(at - piece["position"][near], axis=1) <= 0.5 * spacing
        for gap in (plane(at)[0], distances(at, body)[0]):
            reached &= np.abs(gap + depth[near]) < 0.05 * spacing
        chosen = {name: values[near[reached]] for name, values in piece.items()}
        chosen["position"] = at[reached]
        chosen["surface"] = at[reached]
        moved[near[reached]] = True
        corners = {name: np.concatenate([corners[name], chosen[name]]) for name in corners}
    piece["keep"] = piece["keep"] & ~moved
    corners["key"] = np.full(len(corners["key"]), ORPHAN)
    return corners


def _end_on_walls(piece, walls, spacing):
    """Move the surface that particles belong to out of other solids, to the nearest corner; without one, drop them."""
    beyond = np.flatnonzero(piece["keep"] & (distances(piece["surface"], walls)[0] < -10 * ROUNDING * spacing))
    at = piece["surface"][beyond].copy()
    for _ in range(50):
        gap, normal = distances(at, walls)
        at += np.maximum(-gap, 0.0)[:, None] * normal
    to_surface = at - piece["position"][beyond]
    depth = np.linalg.norm(to_surface, axis=1)
    piece["surface"][beyond], piece["depth"][beyond] = at, depth
    piece["normal"][beyond] = to_surface / np.maximum(depth, 1e-300)[:, None]
    piece["keep"][beyond[(distances(at, walls)[0] < -0.05 * spacing) | (depth < 0.1 * spacing)]] = False


# ---- the pieces


def _wall_piece(position, level, to_surface, lean, index, parent_index, shape):
    """Arrays of wall particles, given the vector to their surface and, where that is 0, its direction."""
    depth = np.linalg.norm(to_surface, axis=1)
    vector = np.where(depth[:, None] > 0, to_surface, lean)
    return {
        "position": position,
        "kind": np.where(level == 1, WALL, DUMMY).astype(np.int8),
        "normal": vector / np.linalg.norm(vector, axis=1)[:, None],
        "depth": depth,
        "level": level,
        "surface": position + to_surface,
        "key": np.ravel_multi_index(index.T, shape),
        "parent_key": np.ravel_multi_index(parent_index.T, shape),
    }


def _container_walls(geometry):
    """Wall particles of the tank: the lattice beyond its walls, edges and corners included."""
    axes = geometry.axes
    below = np.array([len(axis.below) for axis in axes])
    inner = np.array([len(axis.points) for axis in axes])
    ranges = [[0, len(axis.all_points)] for axis in axes]
    blocks = []
    for a in (2, 1, 0):
        # each pair of walls takes the corners that are left
        inside = [below[a], below[a] + inner[a]]
        for piece in ([0, inside[0]], [inside[1], len(axes[a].all_points)]):
            block = [np.arange(*(piece if b == a else bounds)) for b, bounds in enumerate(ranges)]
            blocks.append(np.stack(np.meshgrid(*block, indexing="ij"), axis=-1).reshape(-1, 3))
        ranges[a] = inside
    index = np.concatenate(blocks)
    into = np.clip(index, below, below + inner - 1) - index  # lattice steps to the liquid's lattice
    position = np.stack([axis.all_points[index[:, a]] for a, axis in enumerate(axes)], axis=1)
    nearest = np.clip(position, geometry.walls.container[0], geometry.walls.container[1])
    to_surface = np.where(into != 0, nearest - position, 0.0)
    parent = index + np.sign(into) * np.maximum(np.abs(into) - 1, 0)
    shape = [len(axis.all_points) for axis in axes]
    level = np.abs(into).max(axis=1)
    piece = _wall_piece(position, level, to_surface, np.sign(into), index, parent, shape)
    piece["keep"] = np.ones(len(index), bool)
    clearance = (WALL_CLEARANCE[geometry.wall] + ROUNDING) * geometry.spacing
    for box in geometry.walls.solids:
        # the wall below a baffle is the baffle's
        piece["keep"] &= distance_to_box(position + to_surface, box) >= clearance
    return piece


def _hull_walls(geometry):
    """Wall particles of a hull: its shells, and where the tank is straight along its length, those of its ends."""
    packed, across = geometry.arrangement, list(geometry.hull_axes)
    inside = len(packed.points)
    shells = packed.shells
    level = np.concatenate([np.zeros(inside, int)] + [np.full(len(s.position), k + 1) for k, s in enumerate(shells)])
    at = np.concatenate([packed.points, *[shell.position for shell in shells]])
    to_hull = np.concatenate([np.zeros_like(packed.points), *[shell.surface - shell.position for shell in shells]])
    normal = np.concatenate([np.zeros_like(packed.points), *[shell.normal for shell in shells]])
    parent = np.concatenate([np.arange(inside), *[parents + inside for parents in packed.parents]])
    if 0 in across:
        x, below, beyond = np.zeros(1), 0, np.zeros(1, int)
        to_end = np.zeros(1)
    else:
        axis = geometry.axes[0]
        x, below = axis.all_points, len(axis.below)
        steps = np.arange(len(x))
        beyond = np.clip(steps, below, below + len(axis.points) - 1) - steps
        to_end = np.where(beyond != 0, np.clip(x, axis.low, axis.high) - x, 0.0)
    i, j = (index.ravel() for index in np.meshgrid(np.arange(len(x)), np.arange(len(at)), indexing="ij"))
    outside = (beyond[i] != 0) | (level[j] > 0)
    i, j = i[outside], j[outside]
    position, to_surface, lean = (np.zeros((len(i), 3)) for _ in range(3))
    position[:, 0], to_surface[:, 0], lean[:, 0] = x[i], to_end[i], np.sign(beyond[i])
    position[:, across], to_surface[:, across], lean[:, across] = at[j], to_hull[j], normal[j]
    parent_x = i + np.sign(beyond[i]) * np.maximum(np.abs(beyond[i]) - 1, 0)
    shape = (len(x), len(at))
    piece = _wall_piece(
        position,
        np.maximum(np.abs(beyond[i]), level[j]),
        to_surface,
        lean,
        np.stack([i, j], axis=1),
        np.stack([parent_x, parent[j]], axis=1),
        shape,
    )
    piece["keep"] = np.ones(len(i), bool)
    for box in geometry.walls.solids if geometry.wall == "line" else ():
        piece["keep"] &= distance_to_box(position + to_surface, box) > -UNDER_BAFFLE * geometry.spacing
    return piece


def _solid_walls(geometry, number):
    """Wall particles of a baffle: a lattice of its own, as deep into it as there are layers.

    The lattice goes on into the walls of the tank that the baffle touches, where it takes the place of
    theirs, so that liquid in the corner on either side sees its own particles only.
    """
    solid = geometry.solids[number]
    shape = [len(axis.points) for axis in solid.axes]
    index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 3)

    def along(name):
        return np.stack([getattr(axis, name)[index[:, a]] for a, axis in enumerate(solid.axes)], axis=1)

    position = along("points")
    rank, beyond, outward, to_face = (along(name) for name in ("rank", "beyond", "outward", "to_face"))
    for opening in solid.openings:
        _face_opening(opening, solid, position, index, rank, outward, to_face)
    least = rank.min(axis=1)
    level = np.maximum(least + 1, np.abs(beyond).max(axis=1))
    near = (level <= geometry.layers) & ~_inside_any(position, solid.openings)
    index, rank, beyond, least, level = index[near], rank[near], beyond[near], least[near], level[near]
    position, outward, to_face = position[near], outward[near], to_face[near]
    facing = rank == least[:, None]
    outward = np.where(facing, outward, np.sign(beyond))
    to_surface = np.where(facing, to_face, along("to_wall"))
    to_surface = np.where(facing | (beyond != 0), to_surface, 0.0)
    parent = index + np.where(facing, outward * least[:, None], 0)
    parent += np.where(~facing, np.sign(beyond) * np.maximum(np.abs(beyond) - 1, 0), 0)
    piece = _wall_piece(position, level, to_surface, outward, index, parent, shape)
    piece["keep"], piece["along"] = np.ones(len(index), bool), ~facing
    if geometry.wall == "half":
        return piece
    if geometry.hull is not None:
        piece["keep"] &= geometry.hull.distance(position[:, geometry.hull_axes])[0] > 0.0
    surface = position + to_surface
    for other, hiding in enumerate(geometry.solids):
        for box in hiding.boxes if other != number else ():
            piece["keep"] &= distance_to_box(surface, box) > -ROUNDING * geometry.spacing
    return piece


def _inside_any(position, boxes):
    inside = [((position > box[0]) & (position < box[1])).all(axis=1) for box in boxes]
    return np.any(inside, axis=0) if inside else np.zeros(len(position), bool)


def _face_opening(opening, solid, position, index, rank, outward, to_face):
    """Let the points of a baffle beside an opening face it, where it is nearer than what they face."""
    level = {a: (position[:, a] > opening[0, a]) & (position[:, a] < opening[1, a]) for a in solid.across}
    for a, b in (solid.across, solid.across[::-1]):
        points = solid.axes[a].points
        first = np.searchsorted(points, opening[0, a], side="right")
        last = np.searchsorted(points, opening[1, a], side="left") - 1
        for side, steps in ((1, first - 1 - index[:, a]), (-1, index[:, a] - last - 1)):
            nearer = level[b] & (steps >= 0) & (steps < rank[:, a])
            rank[nearer, a] = steps[nearer]
            outward[nearer, a] = side
            to_face[nearer, a] = opening[0 if side == 1 else 1, a] - position[nearer, a]
