"""The lattice of a tank: where its axes put particles, and the tank and its baffles as boxes.

Positions always have the three components x, y, z. A 2D tank is a slice in the x-z plane: its y axis has the
single point 0, is one unit wide and has no walls, so areas and volumes are per unit width.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from parmps.errors import InputError
from parmps.hull import Polygon, build_hull, hull_axes
from parmps.kernels.walls import Walls
from parmps.mesh import Mesh
from parmps.packing import ROUNDING, Arrangement, arrange

MAX_STRETCH = 0.1  # relative; a lattice stretched more is no longer near the spacing asked for
INSET = {"half": 0.5, "line": 0.0}  # depth of the wall layer below the wall surface, in spacings
THINNEST_BAFFLE = 1.1  # in spacings; a thinner one is modelled as thick as this
SIGHT = 0.2  # in spacings; how near to the edge of a baffle particles see each other past it
# With wall particles on the wall line, [004] (case 3) resolves a baffle of 1.2 spacings by one column.
SHEET, SHEET_BELOW = 0.1, 1.5  # in spacings: thickness of such a column, and of what it stands for


@dataclass(frozen=True)
class Axis:
    """The lattice points of a tank along one axis.

    Attributes
    ----------
    low, high : float, m
        Wall surfaces; infinite along y in 2D.
    points : (n,) float64, m
        Lattice points inside the tank.
    edges : (n + 1,) float64, m
        Bounds of the share of a wall face that each point stands for; they reach from wall to wall.
    below, above : (layers,) float64, m
        Lattice points beyond the lower and the upper wall, nearest first; empty where there is no wall.
    """

    low: float
    high: float
    points: np.ndarray
    edges: np.ndarray
    below: np.ndarray
    above: np.ndarray

    @property
    def step(self):
        """Distance between the lowest lattice points, m."""
        points = self.points if len(self.points) > 1 else self.edges
        return float(points[1] - points[0])

    @property
    def all_points(self):
        """Points below, inside and above the tank in ascending order, m: (below + n + above,) float64."""
        return np.concatenate([self.below[::-1], self.points, self.above])


@dataclass(frozen=True)
class SolidAxis:
    """The lattice points of a baffle along one axis, with those in the walls that it touches.

    Attributes
    ----------
    points : (n,) float64, m
    edges : (inside + 1,) float64, m
        Bounds of the share of a face that each point inside the tank stands for.
    rank : (n,) int64
        Number of points between each point and the nearest free face; very large in the tank's walls or
        where no face is free.
    to_face : (n,) float64, m
        From the point to that face, signed.
    outward : (n,) int64
        Direction of that face, -1 or 1.
    beyond : (n,) int64
        Count of points into a wall of the tank: positive beyond the lower wall, negative beyond the upper.
    to_wall : (n,) float64, m
        From the point to the surface of that wall, signed.
    """

    points: np.ndarray
    edges: np.ndarray
    rank: np.ndarray
    to_face: np.ndarray
    outward: np.ndarray
    beyond: np.ndarray
    to_wall: np.ndarray


@dataclass(frozen=True)
class Solid:
    """A baffle as a box, perhaps with openings through it.

    Attributes
    ----------
    low, high : (3,) float64, m
        Corners, cut off at the tank's walls; along y in 2D those of the axis.
    free_low, free_high : (3,) bool
        Whether liquid can touch the lower and the upper face along each axis.
    axes : tuple of 3 SolidAxis
    openings : (k, 2, 3) float64, m
        Corners of the openings, infinite along the thickness.
    """

    low: np.ndarray
    high: np.ndarray
    free_low: np.ndarray
    free_high: np.ndarray
    axes: tuple
    openings: np.ndarray

    @property
    def box(self):
        """Corners, infinite where the baffle touches a wall: (2, 3) float64, m."""
        low = np.where(self.free_low, self.low, -np.inf)
        return np.array([low, np.where(self.free_high, self.high, np.inf)])

    @cached_property
    def boxes(self):
        """The baffle as boxes that overlap: all that fit between its openings and can grow no further, (m, 2, 3)."""
        if not len(self.openings):
            return self.box[None]
        cuts = [np.unique([*self.box[:, a], *self.openings[:, :, a].ravel()]) for a in self.across]
        middle = [(c[:-1] + c[1:]) / 2 for c in (np.clip(cut, -1e9, 1e9) for cut in cuts)]
        free = np.zeros([len(m) for m in middle], bool)
        for opening in self.openings:
            inside = [(m > opening[0, a]) & (m < opening[1, a]) for m, a in zip(middle, self.across, strict=True)]
            free |= np.outer(*inside)
        found = []
        for first in range(len(free)):
            for last in range(first, len(free)):
                closed = np.concatenate([[False], ~free[first : last + 1].any(axis=0), [False]])
                starts, stops = np.flatnonzero(closed[1:] != closed[:-1]).reshape(-1, 2).T
                found += [(first, last + 1, start, stop) for start, stop in zip(starts, stops, strict=True)]
        largest = [r for r in found if not any(_within(r, other) for other in found if other != r)]
        boxes = np.tile(self.box, (len(largest), 1, 1))
        for box, (first, last, start, stop) in zip(boxes, largest, strict=True):
            box[:, self.across[0]] = cuts[0][[first, last]]
            box[:, self.across[1]] = cuts[1][[start, stop]]
        return boxes

    @property
    def across(self):
        """The two axes in the plane of the openings."""
        return [a for a in range(3) if np.isfinite(self.openings[0, :, a]).all()]


def _within(inner, outer):
    return outer[0] <= inner[0] and inner[1] <= outer[1] and outer[2] <= inner[2] and inner[3] <= outer[3]


@dataclass(frozen=True)
class Geometry:
    """A tank's lattice and its walls; small, and the same on every rank.

    Attributes
    ----------
    dimension : int
    wall : str
        ``half`` or ``line``.
    layers : int
        Wall layer plus dummy layers.
    spacing : float, m
        Effective spacing: geometric mean of the lattice's spacings in the liquid.
    axes : tuple of 3 Axis
    layer_rows : tuple of int
        Number of the lowest row above each layer of liquid, bottom layer first.
    walls : Walls
        Tank and baffles for the kernels.
    solids : tuple of Solid
        The baffles.
    hull : Polygon, Round, Mesh or None
        None where the tank is a box.
    hull_axes : tuple of int
        Axes of the tank that are the hull's; the tank is straight along the others.
    arrangement : Arrangement or None
        Points in and around the hull, instead of the lattice.
    """

    dimension: int
    wall: str
    layers: int
    spacing: float
    axes: tuple
    layer_rows: tuple
    walls: Walls
    solids: tuple
    hull: object
    hull_axes: tuple
    arrangement: Arrangement | None

    @property
    def inset(self):
        """Depth of the wall layer below the wall surface, m."""
        return INSET[self.wall] * self.spacing

    @property
    def obstacles(self):
        """What hides particles from each other: the baffles without their rims, (m, 2, 3) float64, m.

        On the lattice, lines of sight touch the edges of a baffle. With whole baffles, neighbours came and went with
        every step there, and liquid over an edge was taken for the free surface.
        """
        solids = self.walls.solids
        rim = np.minimum(SIGHT * self.spacing, (solids[:, 1] - solids[:, 0]) / 4)
        return np.stack([solids[:, 0] + rim, solids[:, 1] - rim], axis=1)


def build_geometry(job, wall, layers=3):
    """Lay the lattice of a tank.

    With ``half`` walls the lattice is stretched along each axis so that a whole number of columns fits the
    tank and a whole number of rows each layer of liquid; the rows above the liquid fill the rest of the
    height. With ``line`` walls it is stretched so that the wall lines or planes are lattice planes.

    Parameters
    ----------
    job : Job
    wall : {"half", "line"}
        Wall particles half a spacing outside the wall, or on it.
    layers : int
        Wall layer plus dummy layers.

    Returns
    -------
    Geometry

    Raises
    ------
    InputError
        The lattice would have to be stretched by more than 10 %.
    """
    size, spacing, top = job.tank.size, job.spacing, layers if job.tank.lid else 0
    _check_stretch(job, wall)
    depths = [depth for depth in job.depths if depth is not None]
    x = _axis(_edges(size[0], spacing), size[0], wall, layers, layers)
    y = _flat_axis()
    if job.dimension == 3:
        y = _axis(_edges(size[1], spacing), size[1], wall, layers, layers)
    z_edges, layer_rows = _rows(depths, size[-1], spacing, wall)
    z = _axis(z_edges, size[-1], wall, layers, top)
    axes = (x, y, z)
    steps = [axis.step for axis in axes]
    if wall == "half" and depths:
        steps[2] = sum(depths) / layer_rows[-1]
    if job.dimension == 2:
        steps.pop(1)
    mean = float(np.prod(steps) ** (1 / job.dimension))
    container = np.array([[axis.low for axis in axes], [axis.high for axis in axes]])
    solids = tuple(_solid(baffle, axes, mean, wall, job.tank.lid) for baffle in job.tank.baffles)
    boxes = np.concatenate([np.empty((0, 2, 3)), *[solid.boxes for solid in solids]])
    walls = Walls(container, not job.tank.lid, boxes)
    hull = build_hull(job.tank, spacing)
    if hull is None:
        return Geometry(job.dimension, wall, layers, mean, axes, layer_rows, walls, solids, None, (), None)
    across = hull_axes(hull, job.dimension)
    arrangement = arrange(
        hull, [axes[a] for a in across], layer_rows, np.cumsum(depths), mean, INSET[wall], layers
    )
    walls = walls._replace(**_hull_walls(hull, across))
    return Geometry(job.dimension, wall, layers, mean, axes, layer_rows, walls, solids, hull, across, arrangement)


def _hull_walls(hull, across):
    """A hull as the kernels know it: fields of `Walls`."""
    if isinstance(hull, Polygon):
        # the other edges are the container's
        sloped = hull.wall & (np.abs(hull.normals) > ROUNDING).all(axis=1)
        planes = np.zeros((sloped.sum(), 4))
        planes[:, across] = hull.normals[sloped]
        planes[:, 3] = hull.offsets[sloped]
        return {"planes": planes}
    if isinstance(hull, Mesh):
        return {"field": hull.sampled.field, "frame": hull.sampled.frame}
    part = np.zeros((1, 7))
    part[0, across] = hull.centre
    part[0, np.add(across, 3)] = 1.0
    part[0, 6] = hull.radius
    return {"rounds": part}


def _count(length, spacing):
    return max(round(length / spacing), 1)


def _edges(length, spacing):
    return np.linspace(0.0, length, _count(length, spacing) + 1)


def _check_stretch(job, wall):
    lengths = {f"tank.size[{axis}]": side for axis, side in enumerate(job.tank.size)}
    if wall == "half":
        del lengths[f"tank.size[{job.dimension - 1}]"]
        names = ["the depth by fluids[{}].fill" if fluid.fill else "fluids[{}].depth" for fluid in job.fluids]
        layers = {name.format(n): depth for n, (name, depth) in enumerate(zip(names, job.depths, strict=True)) if depth}
        # without layers, the rows fit the height
        lengths |= layers or {f"tank.size[{job.dimension - 1}]": job.tank.height}

    def stretch(length, spacing):
        return abs(length / _count(length, spacing) / spacing - 1)

    limit = MAX_STRETCH + ROUNDING
    bad = next((key for key, length in lengths.items() if stretch(length, job.spacing) > limit), None)
    if bad is None:
        return
    # five particles along the shortest length always fit
    shortest = min(lengths.values())
    fitting = (shortest / n for n in range(_count(shortest, job.spacing), 1000))
    fits = next(
        h for h in fitting if h <= job.spacing and all(stretch(side, h) <= limit for side in lengths.values())
    )
    raise InputError(
        "spacing",
        f"got {job.spacing:g} m, which does not divide {bad} = {lengths[bad]:g} m within "
        f"{100 * MAX_STRETCH:g} %; {float(f'{fits:.4g}'):g} m does",
    )


def _rows(depths, height, spacing, wall):
    """Bounds of the rows, and the number of rows up to the top of each layer of liquid."""
    levels = np.cumsum(depths)
    if wall == "line":
        edges = _edges(height, spacing)
        step = edges[1]
        return edges, tuple(int(level / step + ROUNDING) for level in levels)
    lows = np.concatenate([[0.0], levels])
    pieces = [
        np.linspace(low, low + depth, _count(depth, spacing) + 1)[:-1]
        for low, depth in zip(lows, depths, strict=False)
    ]
    rest = height - lows[-1]
    above = round(rest / spacing)
    # less than half a row above the liquid stays empty
    pieces.append(np.linspace(lows[-1], height if above else lows[-1], above + 1))
    return np.concatenate(pieces), tuple(np.cumsum([len(piece) for piece in pieces[:-1]]).tolist())


def _axis(edges, high, wall, layers_below, layers_above):
    first, last = edges[1] - edges[0], edges[-1] - edges[-2]
    low = 0.0
    if wall == "half":
        points, inner = (edges[:-1] + edges[1:]) / 2, edges[1:-1]
    else:
        points = edges[1:-1]
        # the particles next to a corner stand for the corner's share too
        inner = (points[:-1] + points[1:]) / 2
    edges = np.concatenate([[low], inner, [high]])
    below = low - first * (np.arange(layers_below) + INSET[wall])
    above = high + last * (np.arange(layers_above) + INSET[wall])
    return Axis(low, high, points, edges, below, above)


def _flat_axis():
    none = np.empty(0)
    return Axis(-np.inf, np.inf, np.zeros(1), np.array([-0.5, 0.5]), none, none)


def _solid(baffle, axes, spacing, wall, lid):
    # A thinner plate would put the wall particles of its two sides upon or beyond one another.
    half = max(baffle.thickness, THINNEST_BAFFLE * spacing) / 2
    if wall == "line" and baffle.thickness < (SHEET_BELOW - ROUNDING) * spacing:
        half = SHEET * spacing / 2
    y = axes[1]
    across = (y.low, y.high) if baffle.width is None else baffle.width
    length, height = axes[0].high, axes[2].high
    plane = (1, 2) if baffle.vertical else (0, 1)
    openings = np.array([[[-np.inf] * 3, [np.inf] * 3]] * len(baffle.openings)).reshape(-1, 2, 3)
    openings[:, :, plane] = np.array(baffle.openings).reshape(-1, 2, 2)
    if baffle.ring is not None:
        openings = np.array([[[-np.inf] * 3, [np.inf] * 3]])
        openings[0, :, plane] = [(baffle.ring, axes[a].high - baffle.ring) for a in plane]
    if baffle.vertical:
        up = (0.0, height) if baffle.ring is not None else (baffle.bottom, baffle.top)
        extents = ((baffle.x - half, baffle.x + half), across, up)
    else:
        along = (0.0, length) if baffle.ring is not None else (baffle.left, baffle.right)
        extents = (along, across, (baffle.z - half, baffle.z + half))
    low, high = np.array(extents, dtype=float).T
    near = ROUNDING * spacing
    free_low = np.array([low[a] > axis.low + near for a, axis in enumerate(axes)])
    free_high = np.array([high[a] < axis.high - near for a, axis in enumerate(axes)])
    free_high[2] |= not lid
    solid_axes = tuple(
        _solid_axis(axis, low[a], high[a], free_low[a], free_high[a], openings[:, :, a], spacing, wall)
        for a, axis in enumerate(axes)
    )
    return Solid(low, high, free_low, free_high, solid_axes, openings)


def _solid_axis(axis, low, high, free_low, free_high, openings, spacing, wall):
    cuts = np.unique(openings[np.isfinite(openings)])
    if len(cuts):
        points, edges = _cut_points(np.array([low, *cuts, high]), spacing, wall)
        inside = slice(0 if free_low or wall == "half" else 1, None if free_high or wall == "half" else -1)
        points = points[inside]
    elif free_low or free_high:
        points = _solid_points(low, high, free_low, free_high, spacing, wall)
        edges = np.concatenate([[low], (points[:-1] + points[1:]) / 2, [high]])
    else:
        points, edges = axis.points, axis.edges
    n = len(points)
    below = axis.below[:0] if free_low else axis.below
    above = axis.above[:0] if free_high else axis.above
    far = np.iinfo(np.int32).max
    from_low = np.arange(n) if free_low else np.full(n, far)
    from_high = np.arange(n)[::-1] if free_high else np.full(n, far)
    lower = from_low <= from_high
    wide = (len(below), len(above))
    return SolidAxis(
        points=np.concatenate([below[::-1], points, above]),
        edges=edges,
        rank=np.pad(np.minimum(from_low, from_high), wide, constant_values=far),
        to_face=np.pad(np.where(lower, low - points, high - points), wide),
        outward=np.pad(np.where(lower, -1, 1), wide),
        beyond=np.concatenate([np.arange(wide[0], 0, -1), np.zeros(n, int), -np.arange(1, wide[1] + 1)]),
        to_wall=np.concatenate([axis.low - below[::-1], np.zeros(n), axis.high - above]),
    )


def _cut_points(cuts, spacing, wall):
    """Points along an axis, and the bounds of their shares, with a lattice of its own between any two cuts."""
    counts = [max(_count(b - a, spacing), 2) for a, b in zip(cuts[:-1], cuts[1:], strict=True)]
    pieces = [np.linspace(a, b, n + 1)[:-1] for a, b, n in zip(cuts[:-1], cuts[1:], counts, strict=True)]
    nodes = np.append(np.concatenate(pieces), cuts[-1])
    middle = (nodes[:-1] + nodes[1:]) / 2
    if wall == "half":
        return middle, nodes
    return nodes, np.concatenate([nodes[:1], middle, nodes[-1:]])


def _solid_points(low, high, free_low, free_high, spacing, wall):
    """Points along an axis with a free end; at two free ends there are always two, which may cross."""
    count = _count(high - low, spacing)
    step = (high - low) / count
    at_free, at_wall = INSET[wall] * spacing, step if wall == "line" else step / 2
    if free_low and free_high:
        count = max(count + (wall == "line"), 2)
    first = low + (at_free if free_low else at_wall)
    last = high - (at_free if free_high else at_wall)
    if count == 1:
        return np.array([first if free_low else last])
    return np.linspace(first, last, count)


def distance_to_box(position, box):
    """Distance of points to a box.

    Parameters
    ----------
    position : (n, 3) float64, m
    box : (2, 3) float64, m
        Lower and upper corner, which may be infinite.

    Returns
    -------
    (n,) float64, m
        Positive outside; inside, minus the distance to the nearest face.
    """
    beyond = np.maximum(box[0] - position, position - box[1])
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return np.where(outside > 0.0, outside, beyond.max(axis=1))
