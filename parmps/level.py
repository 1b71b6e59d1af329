"""Liquid at rest in a tank that is tilted at the start: level layers, on a lattice turned with gravity."""

import itertools
import math
from typing import NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt, label
from scipy.optimize import brentq
from scipy.spatial import cKDTree

from parmps.errors import InputError
from parmps.kernels.walls import distances
from parmps.motion import Motion
from parmps.packing import BAND, CLEARANCE, REACH, ROUNDING, pack

UPRIGHT = 0.1
"""Rise of the level surface across the tank, in spacings, that is none: half of it at either end."""
CELL = 0.9
"""Largest cell that volumes are summed over, in spacings: the thinnest baffle holds the centres of some."""
NARROWEST = 1e-3
"""In cells; a cell's extent along gravity has at least this share from each axis, so that no width is 0."""
TOUCHING = 0.5
"""In spacings; of two particles as near as that, one is left out: of a thin plate's faces, or beside a region."""
SHORE = 0.5
"""In spacings; how far from an upright wall the uppermost row ends. Nearer to walls that it meets at a small angle, as
near as `packing.CLEARANCE`, so that thin ends hold what they can."""
NEXT = 1.6
"""In spacings; how far on a point of the lattice hands the share of its cell that it does not stand for."""


class Level(NamedTuple):
    """Liquid below level surfaces.

    Attributes
    ----------
    position : (n, 3) float64, m
        In ascending order of x.
    layer : (n,) int64
        Layer of liquid of each particle, bottom first.
    """

    position: np.ndarray
    layer: np.ndarray


def upwards(job):
    """Direction against gravity in a tank that is tilted at the start, if that moves the surfaces of its layers.

    Acceleration does not enter: liquid that rests when the tank sets out is level on the earth.

    Parameters
    ----------
    job : Job

    Returns
    -------
    (3,) float64 or None
        None where the tank is upright, a single liquid fills it, or there are no layers or no gravity.
    """
    layered = [depth for depth in job.depths if depth is not None]
    if job.gravity == 0.0 or not layered or (job.full and len(layered) == 1):
        return None
    up = Motion(job.motion, job.gravity, job.dimension, job.tank).at(0.0).rotation[2]
    sides = job.tank.size if job.dimension == 3 else (job.tank.length, 0.0, job.tank.height)
    rise = abs(up[0]) * sides[0] + abs(up[1]) * sides[1]
    return None if up[2] > 0.0 and rise <= UPRIGHT * job.spacing else up


def starts_level(job):
    """Whether a job starts with layers that are level in a tilted tank.

    Parameters
    ----------
    job : Job

    Returns
    -------
    bool
    """
    return job.initial.kind in ("level", "rest", "velocity") and upwards(job) is not None


def arrange_level(job, geometry, walls, regions):
    """Fill a tilted tank with layers whose surfaces are level.

    Each layer has the volume that its depth has in the upright tank; spaces that baffles close off keep their own.
    In each layer, and in the air above, those points of a lattice along gravity that are deepest inside are kept, as
    many as the volume asks for, and moved until they are even beside the walls (see `packing.arrange`). The uppermost
    row is half a spacing below the surface and parallel to it: a staircase would slosh.

    Parameters
    ----------
    job : Job
    geometry : Geometry
    walls : (m, 3) float64, m
        All wall and dummy particles.
    regions : (k, 3) float64, m
        Particles of liquids given by a region, which displace those of the layers.

    Returns
    -------
    Level

    Raises
    ------
    InputError
        Liquid stands above the rim of an open tank.
    """
    up, cells = upwards(job), _cells(geometry, geometry.walls)
    tops = np.cumsum([depth for depth in job.depths if depth is not None])
    pieces = []
    turn = _turned(geometry, up)
    for part in range(1, cells.part.max() + 1):
        own = (cells.part == part) & (cells.weight > 0.0)
        upright = _Heights(cells.centre[own], cells.weight[own], cells.steps, np.array([0.0, 0.0, 1.0]))
        tilted = _Heights(cells.centre[own], cells.weight[own], cells.steps, up)
        below = np.array([upright.below(top) for top in tops])
        planes = np.array([tilted.level(volume) for volume in below])
        _check_rim(geometry, cells, part, planes[-1], up)
        volumes = np.diff(below, prepend=0.0)
        pieces.append(_choose(geometry, cells, part, tilted, planes, volumes, turn, regions))
    at, layer, low, high = (np.concatenate(arrays) for arrays in zip(*pieces, strict=True))
    at = _even_out(geometry, at, low, high, turn, walls, regions)
    liquid = layer < len(tops)
    position, layer = at[liquid], layer[liquid]
    order = np.argsort(position[:, 0], kind="stable")
    return Level(position[order], layer[order])


class _Cells(NamedTuple):
    """Cells of the box around the tank, as arrays along its axes."""

    centre: np.ndarray  # (a, b, c, 3) float64, m
    weight: np.ndarray  # (a, b, c) float64, m3 (m2 in 2D): volume in the tank outside of baffles
    part: np.ndarray  # (a, b, c) int: which of the spaces that nothing connects the cell belongs to, from 1
    steps: np.ndarray  # (3,) float64, m; 0 along y in 2D


def _cells(geometry, walls):
    """Cut the tank into cells, and find the spaces that baffles close off from each other."""
    low, high = geometry.walls.container
    flat = ~np.isfinite(low)
    sides = np.where(flat, 0.0, high - low)
    counts = np.where(flat, 1, np.ceil(sides / (CELL * geometry.spacing) - ROUNDING)).astype(int)
    steps = sides / counts
    axes = [(np.arange(n) + 0.5) * step for n, step in zip(counts, steps, strict=True)]
    centre = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    gap = distances(centre.reshape(-1, 3), walls._replace(open_top=False))[0].reshape(counts)
    width = steps[~flat].mean()
    weight = np.clip(0.5 + gap / width, 0.0, 1.0) * np.prod(steps[~flat])
    # a sheet on the wall line is thinner than a cell
    part, _ = label(gap > (0.0 if geometry.wall == "half" else 0.45 * width))
    if not part.all():
        part = part[tuple(distance_transform_edt(part == 0, return_distances=False, return_indices=True))]
    return _Cells(centre, weight, part, steps)


def hull_contents(job, geometry):
    """Volume of each layer in a hull, baffles not counted.

    Without baffles it is known exactly; cells tell what share of it these take.

    Parameters
    ----------
    job : Job
    geometry : Geometry

    Returns
    -------
    (layers,) float64, m3 (m2 in 2D)
    """
    tops = np.cumsum([depth for depth in job.depths if depth is not None])
    length = 1.0 if 0 in geometry.hull_axes else geometry.axes[0].high
    exact = geometry.arrangement.content[: len(tops)] * length
    if not len(geometry.walls.solids):
        return exact
    upright = np.array([0.0, 0.0, 1.0])
    volumes = []
    for walls in (geometry.walls, geometry.walls._replace(solids=geometry.walls.solids[:0])):
        each = _cells(geometry, walls)
        heights = _Heights(each.centre.reshape(-1, 3), each.weight.ravel(), each.steps, upright)
        volumes.append(np.diff([heights.below(top) for top in tops], prepend=0.0))
    return exact * volumes[0] / volumes[1]


class _Heights:
    """Volume of cells below planes across a direction.

    A cell lies below a plane with the share that the sum of uniform variables has below a value (Irwin and Hall).
    """

    def __init__(self, centre, weight, steps, up):
        widths = np.maximum(np.abs(up), NARROWEST) * steps
        self._widths = widths[steps > 0.0]
        height = centre @ up
        order = np.argsort(height, kind="stable")
        self._height, self._weight = height[order], weight[order]
        self._before = np.concatenate([[0.0], np.cumsum(self._weight)])
        self.low = float(height.min() - self._widths.sum() / 2)
        self.high = float(height.max() + self._widths.sum() / 2)

    def below(self, plane):
        """Volume below a plane, m3 (m2 in 2D)."""
        half = self._widths.sum() / 2
        first, last = np.searchsorted(self._height, [plane - half, plane + half])
        s = plane + half - self._height[first:last]
        share, dimension = np.zeros(len(s)), len(self._widths)
        for chosen in itertools.product((0.0, 1.0), repeat=dimension):
            share += (-1.0) ** sum(chosen) * np.maximum(s - self._widths @ chosen, 0.0) ** dimension
        share /= math.factorial(dimension) * np.prod(self._widths)
        return float(self._before[first] + self._weight[first:last] @ np.clip(share, 0.0, 1.0))

    def level(self, volume):
        """Plane below which there is a volume, m."""
        if volume <= 0.0:
            return self.low
        if volume >= self._before[-1] * (1.0 - 1e-9):
            return self.high
        return brentq(lambda plane: self.below(plane) - volume, self.low, self.high)


def _check_rim(geometry, cells, part, plane, up):
    """Refuse liquid that would run out of an open tank."""
    if not geometry.walls.open_top:
        return
    top = (cells.part[:, :, -1] == part) & (cells.weight[:, :, -1] > 0.5 * cells.weight.max())
    rim = cells.centre[:, :, -1][top] + 0.5 * cells.steps * [0.0, 0.0, 1.0]
    if not len(rim):
        return
    lowest = (rim @ up).min() - 0.5 * (np.abs(up) * cells.steps)[:2].sum()
    if plane > lowest + UPRIGHT * geometry.spacing:
        angle = math.degrees(math.acos(np.clip(up[2], -1.0, 1.0)))
        raise InputError(
            "motion",
            f"the tank is tilted by {angle:.3g} deg at the start, where level liquid stands {plane - lowest:.3g} m "
            "above the rim of the open tank (tank.lid: false); use less liquid or less tilt, or initial: upright",
        )


def _turned(geometry, up):
    """Axes of the lattice, the last of them upwards, among the coordinates that the tank has: (d, 3) float64.

    As many as can be are the tank's own.
    """
    if geometry.dimension == 2:
        return np.array([[up[2], 0.0, -up[0]], up])
    first = np.eye(3)[np.argmin(np.abs(up))]
    first -= (first @ up) * up
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(up, first), up])


def _columns(geometry, direction, corners):
    """Lattice points along a direction across gravity, m: the tank's own where it is one of its axes."""
    axis = int(np.argmax(np.abs(direction)))
    if abs(direction[axis]) > 1.0 - ROUNDING**2:
        return np.sign(direction[axis]) * geometry.axes[axis].points
    along = corners @ direction
    count = math.ceil(np.ptp(along) / geometry.spacing) + 1
    return along.mean() + (np.arange(count) - (count - 1) / 2) * geometry.spacing


def _rows(geometry, tilted, planes, step):
    """Heights of rows, the layer of each, and the distance of the rows in each layer and in the air.

    Rows fit between two surfaces; those of the lowest layer hang from its surface, those of the air, of which a band
    is enough, stand on the uppermost, as do those of a layer that reaches the highest point of the tank.
    """
    l0 = geometry.spacing
    if geometry.wall == "line":
        rows = planes[-1] - l0 * np.arange(-BAND, math.ceil((planes[-1] - tilted.low) / l0))[::-1]
        return rows, np.searchsorted(planes, rows - ROUNDING * l0), np.full(len(planes) + 1, l0)
    bounds = [tilted.low, *planes, min(planes[-1] + BAND * l0, tilted.high)]
    rows, layers, steps = [], [], []
    for k, (low, high) in enumerate(itertools.pairwise(bounds)):
        between = k > 0 and high < tilted.high
        here = (high - low) / max(round((high - low) / step), 1) if between else step
        number = np.arange(round((high - low) / here) if between else math.ceil((high - low) / here))
        rows.append(np.sort(high - (number + 0.5) * here if k == 0 else low + (number + 0.5) * here))
        layers.append(np.full(len(number), k))
        steps.append(here)
    return np.concatenate(rows), np.concatenate(layers), np.array(steps)


def _choose(geometry, cells, part, tilted, planes, content, turn, regions):
    """Points of the lattice in one of the closed spaces: positions, layers, and the bounds of their heights."""
    l0, d = geometry.spacing, geometry.dimension
    sides = np.where(np.isfinite(geometry.walls.container[1]), geometry.walls.container[1], 0.0)
    corners = np.array(list(itertools.product(*[(0.0, side) for side in sides])))
    columns = [_columns(geometry, direction, corners) for direction in turn[:-1]]
    area = np.prod([np.mean(np.abs(np.diff(points))) if len(points) > 1 else l0 for points in columns])
    rows, row_layer, steps = _rows(geometry, tilted, planes, l0**d / area)
    at = np.stack(np.meshgrid(*columns, rows, indexing="ij"), axis=-1).reshape(-1, d) @ turn
    row = np.tile(np.arange(len(rows)), len(at) // max(len(rows), 1))
    inside = np.all(np.abs(at - sides / 2) < sides / 2 + l0 / 2, axis=1)
    at, row = at[inside], row[inside]
    cell = np.clip((at / np.where(cells.steps > 0.0, cells.steps, 1.0)).astype(int), 0, np.array(cells.part.shape) - 1)
    mine = cells.part[tuple(cell.T)] == part
    at, row = at[mine], row[mine]
    gap = distances(at, geometry.walls._replace(open_top=False))[0]
    top = min(planes[-1] + BAND * l0, tilted.high)
    volumes = [*content, tilted.below(top) - tilted.below(planes[-1])]
    kept = []
    for k, volume in enumerate(volumes):
        here = np.flatnonzero(row_layer[row] == k)
        if geometry.wall == "line":  # the liquid keeps a spacing from the wall
            kept.append(here[gap[here] > (0.5 + ROUNDING) * l0])
            continue
        count = round(volume / (area * steps[k]))
        kept.append(here[_deal(at[here], row[here], gap[here] / l0, l0)[:count]])
    kept = np.concatenate(kept)
    if len(regions):
        kept = kept[cKDTree(regions).query(at[kept])[0] > TOUCHING * l0]
    layer = row_layer[row[kept]]
    low = np.array([rows[row_layer == k].min(initial=np.inf) for k in range(len(volumes))])
    high = np.array([rows[row_layer == k].max(initial=-np.inf) for k in range(len(volumes))])
    low[0], high[-1] = -np.inf, np.inf
    return at[kept], layer, low[layer], high[layer]


def _deal(at, row, gap, spacing):
    """Order in which points of a lattice are kept so that each part of the tank gets what it holds.

    A point stands for the share of its cell that is inside the walls. What it has too much, or too little, where it is
    kept or not is handed on to those beside it (error diffusion of Floyd and Steinberg), from row to row, the deepest
    inside first. With the deepest of all instead, the shallow end of a tank that is tilted by a degree got a tenth
    more than it holds, and flowed.
    """
    share = np.clip(0.5 + gap, 0.0, 1.0)
    cut = np.flatnonzero((share > 0.0) & (share < 1.0))
    cut = cut[np.lexsort((-np.rint(gap[cut] / 1e-3), -row[cut]))]
    wanted = share.copy()
    for number, others in enumerate(cKDTree(at[cut]).query_ball_point(at[cut], NEXT * spacing)):
        after = [cut[other] for other in others if other > number]
        point = cut[number]
        if after:
            weight = 1.0 / np.linalg.norm(at[after] - at[point], axis=1) ** 2
            wanted[after] += (wanted[point] - (wanted[point] > 0.5)) * weight / weight.sum()
    whole = np.where(share == 1.0, np.inf, np.where(share == 0.0, gap - np.inf, wanted))
    return np.lexsort((-gap, -whole))


def _even_out(geometry, position, low, high, turn, walls, regions):
    """Move the particles near walls and regions until they are even, without crossing the surfaces of their layers."""
    l0, tank = geometry.spacing, geometry.walls._replace(open_top=False)

    moves = distances(position, tank)[0] < BAND * l0
    if len(regions):
        moves |= cKDTree(regions).query(position)[0] < BAND * l0
    if not moves.any():
        return position
    near = cKDTree(position[moves])
    around = np.concatenate([walls, regions])
    around = around[near.query(around)[0] < (BAND + REACH) * l0]
    # the faces of a thin plate have their wall particles in one place
    double = cKDTree(around).query_pairs(TOUCHING * l0, output_type="ndarray")
    around = np.delete(around, np.unique(double[:, 1]), axis=0)
    fixed = np.concatenate([position[~moves], around]) @ turn.T
    clearance, bottom, top = CLEARANCE[geometry.wall] * l0, low[moves], high[moves]

    def distance(at):
        """As pack wants it; where a wall would lift a particle out of its layer, it is moved along the surface."""
        gap, normal = distances(at @ turn, tank)
        normal = normal @ turn.T
        along = np.linalg.norm(normal[:, :-1], axis=1)
        least = clearance + (SHORE * l0 - clearance) * along**2
        lifted = at[:, -1] + np.maximum(least - gap, 0.0) * normal[:, -1]
        wedged = ((lifted > top) | (lifted < bottom)) & (gap < least) & (along > 0.0)
        way = np.minimum((least - gap)[wedged] / along[wedged], l0)
        normal[wedged, :-1] /= along[wedged, None]
        normal[wedged, -1] = 0.0
        gap[wedged] = clearance - way
        return gap, normal

    moved = pack(position[moves] @ turn.T, fixed, l0, distance, clearance, bottom, top)
    position = position.copy()
    position[moves] = moved @ turn
    return position
