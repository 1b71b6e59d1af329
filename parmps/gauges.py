"""Gauges: height of the free surface and of interfaces, and what a liquid is made of, at an instant.

A gauge turns the particles that one rank owns into sums, and the sums over all ranks into values. The particles come
as a state with these attributes, of owned particles only: ``position``, ``velocity`` (n, 3), ``kind``, ``fluid``,
``surface`` (n,), and ``frame`` (the tank's, a `FrameState`); for a liquid also ``density`` (kg/m3, one value or (n,)),
``volume`` (m3), ``compression`` and ``fraction`` (n,), the share of the particle's own liquid in its neighbourhood.
"""

import math

import numpy as np

from parmps.kernels.walls import distances, hidden_from_column
from parmps.kernels.weight import spline_weight
from parmps.particles import FLUID

NODES = 4  # of the profile of a gauge, per spacing
LEAST_ROW = 1.0 / 3.0  # of the row in the surface; where a gauge sees less of it, it has no place for the surface
BAND = 2.0  # in lattice steps; how far from the end of the main body a gauge looks for the row of its surface
EVEN = 0.1  # in lattice steps; along which particles are spread less, a gauge sees no slope
ROW, COLUMN = np.triu_indices(3)
BESIDE = 0.93  # greatest share of the own liquid in the row beside an interface: 0.85 on the lattice, 1.0 in the next
THIN_BAND = 0.8  # in lattice steps; as BAND for the rows beside an interface, less than from there to the next ones
WIDTH, SLOPE_WIDTH = 2.0, 4.0  # in lattice steps; knots of the weights for the height of an interface and its slope
DOUBT = 0.03  # slope of an interface of which half is believed: at a wall, rows at rest make 0.02 of their own
MAX_VOID = 1.5  # in spacings; a smaller gap in the liquid below a gauge is a passing void, not a surface
_STANDS = {"tank": "the tank", "earth": "the tank at rest"}


def _place(at):
    """Where a column stands, in words."""
    return ", ".join(f"{axis} = {x:g} m" for axis, x in zip("xy", at, strict=False))


class ElevationGauge:
    """Height of the free surface of the main body of liquid above the tank bottom.

    Every particle near the gauge spreads over cubic B-splines of one lattice step along each axis. Divided
    by what the full lattice gives there, this is how full the tank is at each height: 1 inside the liquid,
    about 1/2 at the surface. The main body is the longest stretch more than half full, but for voids smaller than
    1.5 spacings, so that spray above it does not count. A dry column reads 0.

    The surface is half a spacing from the particles of its row, as for the pressure: a straight line, or a plane, is
    fitted to those within two spacings of the gauge and of the body's end, with the same weights. How full
    the tank is depends on how far the columns stand from a wall, and read 0.04 spacings high there, as much low
    elsewhere, and half a spacing times the steepness of a crest high at the crest.

    A gauge that is fixed to the earth stays where it is when the tank moves: particles are seen in the earth's
    frame, and the height is that above the tank bottom at rest.

    Parameters
    ----------
    probe : parmps.scene.ElevationProbe
    geometry : Geometry
    """

    def __init__(self, probe, geometry):
        self.columns = {f"{probe.name} [m]": self._description(probe)}
        axes = geometry.axes
        self.geometry, self.earth = geometry, probe.fixed_to == "earth"
        self.at = np.array(probe.at if geometry.dimension == 3 else [probe.at[0], 0.0])
        self.steps = np.array([axis.step for axis in axes])
        self.base = 0.0  # height of the lowest node
        self.reach = self._diagonal() if self.earth else 0.0
        self.hull = geometry.walls._replace(solids=geometry.walls.solids[:0])
        self.ceiling = math.inf  # above the lowest node
        height = 2.0 * self.reach if self.earth else axes[2].high
        self.nodes = np.linspace(0.0, height, int(np.ceil(NODES * height / self.steps[2])) + 1)
        self.solid = np.ones(len(self.nodes), bool)  # what is none of the liquid's in the tank's own column is a baffle
        self.boxes = geometry.walls.solids[:0] if self.earth else geometry.walls.solids
        if self.earth:
            return
        self.ceiling = self._roof(np.column_stack([np.tile(self.at, (len(self.nodes), 1)), self.nodes]))
        near = [np.abs(axis.points - at) for axis, at in zip(axes, self.at, strict=False)]
        x, y = (axes[a].points[near[a] < 2 * self.steps[a]] for a in (0, 1))
        grid = np.meshgrid(x, y, axes[2].points, indexing="ij")
        lattice = np.stack(grid, axis=-1).reshape(-1, 3)
        lattice = lattice[distances(lattice, geometry.walls)[0] > 0.0]
        self.full = self._profile(lattice)

    def _description(self, probe):
        """What the column is."""
        return f"height of the free surface above the bottom of {_STANDS[probe.fixed_to]} at {_place(probe.at)}"

    def _roof(self, line):
        """Height above the lowest node, m, where the column leaves a closed tank; infinite where nothing closes it.

        Parameters
        ----------
        line : (nodes, 3) float64, m
            The nodes in the tank's frame.
        """
        rounding = 1e-6 * self.geometry.spacing
        inside = np.flatnonzero(distances(line, self.hull)[0] > -rounding)
        if not len(inside):
            return math.inf
        last = inside[-1]
        if last == len(line) - 1:
            return math.inf if self.hull.open_top else self.nodes[-1]
        low, high = 0.0, 1.0
        while (high - low) * self.nodes[1] > rounding:
            middle = 0.5 * (low + high)
            point = line[[last]] + middle * (line[[last + 1]] - line[[last]])
            low, high = (middle, high) if distances(point, self.hull)[0][0] > -rounding else (low, middle)
        return self.nodes[last] + low * self.nodes[1]

    def _from_gauge(self, position):
        """Horizontal places of particles from the gauge, in lattice steps: (2, n) float64."""
        return ((position[:, :2] - self.at) / self.steps[:2]).T

    def _profile(self, position):
        """Spread particles over the nodes: (nodes,) float64."""
        position = position[~hidden_from_column(*self.at, position, self.boxes)]
        x, y = self._from_gauge(position)
        weight = _spline(x) * _spline(y)
        step = self.nodes[1]
        reach = int(np.ceil(2 * self.steps[2] / step))
        nearest = np.rint(position[:, 2] / step).astype(int)
        node = nearest[:, None] + np.arange(-reach, reach + 1)
        share = weight[:, None] * _spline((node * step - position[:, 2, None]) / self.steps[2])
        inside = (node >= 0) & (node < len(self.nodes))
        return np.bincount(node[inside], share[inside], minlength=len(self.nodes))

    def _diagonal(self):
        """Of the box around the tank, m."""
        finite = self.geometry.axes if self.geometry.dimension == 3 else self.geometry.axes[::2]
        return math.hypot(*(axis.high - axis.low for axis in finite))

    def _stand(self, frame):
        """Find where the column of a gauge on the earth is in the tank: what would be full there, and baffles."""
        self.base = frame.origin[2] - self.reach
        line = np.column_stack([np.tile(self.at, (len(self.nodes), 1)), self.base + self.nodes])
        line = (line - frame.origin) @ frame.rotation
        self.ceiling = self._roof(line)
        axes = self.geometry.axes
        lowest = np.array([axis.points[0] for axis in axes])
        around = np.stack(np.meshgrid(*[np.arange(-4, 5)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        shape = tuple(len(axis.points) for axis in axes)
        site = (np.rint((line - lowest) / self.steps).astype(int)[:, None] + around).reshape(-1, 3)
        site = site[((site >= 0) & (site < shape)).all(axis=1)]
        number = np.unique(np.ravel_multi_index(tuple(site.T), shape))  # far faster than unique rows
        lattice = lowest + np.stack(np.unravel_index(number, shape), axis=1) * self.steps
        lattice = lattice[distances(lattice, self.geometry.walls)[0] > 0.0]
        self.full = self._profile(self._on_earth(lattice, frame))
        low, high = self.geometry.walls.solids[:, 0, None], self.geometry.walls.solids[:, 1, None]
        self.solid = ((line >= low) & (line <= high)).all(axis=2).any(axis=0)

    def _on_earth(self, position, frame):
        """Places along the earth's axes, heights above the lowest node: (n, 3) float64, m."""
        return position @ frame.rotation.T + frame.origin - [0.0, 0.0, self.base]

    def _seen(self, state, width):
        """Find the liquid near the column.

        Parameters
        ----------
        state : object
            See the module.
        width : float
            Between the knots of the widest weights, in lattice steps.

        Returns
        -------
        position : (k, 3) float64, m
            Along the column's axes.
        number : (k,) int
            Of the particles.
        """
        number = np.flatnonzero(state.kind == FLUID)
        position = state.position[number]
        if self.earth:
            self._stand(state.frame)
            position = self._on_earth(position, state.frame)
        near = (np.abs(position[:, :2] - self.at) < 2 * width * self.steps[:2]).all(axis=1)
        return position[near], number[near]

    def _moments(self, row, width):
        """Moments of the particles of a row by the node nearest to them: (9, nodes) float64.

        Sums of their weights times 1, x, y, x^2, xy, y^2, z, xz and yz, from the gauge and from the node up, in
        lattice steps.

        Parameters
        ----------
        row : (k, 3) float64, m
            The particles.
        width : float
            Between the knots of the weights, in lattice steps.
        """
        node = np.clip(np.rint(row[:, 2] / self.nodes[1]).astype(int), 0, len(self.nodes) - 1)
        x, y = self._from_gauge(row)
        z, weight = (row[:, 2] - self.nodes[node]) / self.steps[2], _spline(x / width) * _spline(y / width)
        terms = (1.0, x, y, x * x, x * y, y * y, z, x * z, y * z)
        return np.array([np.bincount(node, weight * term, len(self.nodes)) for term in terms])

    def _row_near(self, end, side, band, moments):
        """Sum moments over the nodes near the middle of a row.

        Parameters
        ----------
        end : (1,) float64, m
            Height where the liquid ends.
        side : float
            From the row's middle up to there, in lattice steps.
        band : float
            In lattice steps.
        moments : (9, nodes) float64
            As made by `_moments`.

        Returns
        -------
        flat : (6,) float64
            The first six.
        upright : (3,) float64
            Those with z, from the row's middle up.
        """
        above = (self.nodes - end) / self.steps[2] + side
        near = np.abs(above) < band
        flat, upright = moments[:6, near], moments[6:, near] + above[near] * moments[:3, near]
        return flat.sum(axis=1), upright.sum(axis=1)

    def partial(self, state):
        """Sum the particles near the gauge over the nodes of its profile, and moments of those in the surface.

        Returns
        -------
        (10 nodes,) float64
            The profile, and the moments of the surface's particles.
        """
        position, number = self._seen(state, 1.0)
        row = position[state.surface[number] != 0]
        row = row[~hidden_from_column(*self.at, row, self.boxes)]
        return np.concatenate([self._profile(position), *self._moments(row, 1.0)])

    def value(self, sums):
        """Height, m: (1,) float64, at most that of the lid; 0 where the column is dry."""
        height = self._height(sums) if sums.any() else None
        return np.zeros(1) if height is None else self.base + np.minimum(height, self.ceiling)

    def _height(self, sums):
        """Height of the surface above the lowest node, m: (1,) float64, or None without one."""
        profile, *moments = sums.reshape(-1, len(self.nodes))
        end = self._end_of_body(profile)
        return end if end is None else self._fit(end, np.array(moments))

    def _fit(self, end, moments):
        """Height of the surface above the row near the end of the main body, m: (1,) float64; that end without one."""
        flat, upright = self._row_near(end, 0.5, BAND, moments)
        matrix = np.zeros((3, 3))
        matrix[ROW, COLUMN] = matrix[COLUMN, ROW] = flat
        if matrix[0, 0] < LEAST_ROW:
            return end
        matrix[[1, 2], [1, 2]] += EVEN**2 * matrix[0, 0]
        height, *slope = np.linalg.solve(matrix, upright)
        slope = np.array(slope) * self.steps[2] / self.steps[:2]
        height += 0.5 * math.hypot(1.0, *slope) - 0.5
        return end + self.steps[2] * np.clip(height, -1.0, 1.0)

    def _end_of_body(self, sums):
        """Height above the lowest node where the main body of liquid ends, m: (1,) float64, or None without one."""
        # a baffle in the column counts as full
        empty = self.full < 1e-3
        fill = np.where(empty, self.solid, sums / np.where(empty, 1.0, self.full)) - 0.5
        wet = np.concatenate([[False], fill >= 0.0, [False]])
        starts, stops = np.flatnonzero(wet[1:] != wet[:-1]).reshape(-1, 2).T
        if not len(starts):
            return None
        gap = starts[1:] - stops[:-1] > MAX_VOID * NODES
        starts, stops = starts[np.append(True, gap)], stops[np.append(gap, True)]
        top = stops[np.argmax(stops - starts)]
        if top == len(fill):
            return self.nodes[-1:]
        part = fill[top - 1] / (fill[top - 1] - fill[top])
        return np.array([self.nodes[top - 1] + part * self.nodes[1]])


class InterfaceGauge(ElevationGauge):
    """Height of the interface between two liquids above the tank bottom.

    Both liquids near the gauge are spread over heights as by `ElevationGauge`. The interface is near the height with
    the least of the upper liquid below it and of the lower one above it, so that drops of one in the other
    count as little as they hold; there the two profiles cross. Where one of the two is missing, it is the end of
    the other one.

    There it is midway between the two rows beside it, however thick they are, or half a spacing from the only one
    where a liquid is but one row thick. Where the profiles cross depends on how the columns of the two liquids stand
    from the gauge: along a wave of half a spacing at a wall the crossing was 0.08 spacings off, the middle is 0.04.
    Particles of the rows differ by 0.05 and more beside a wall, so that their mean height is over four spacings,
    and the slope by which that is carried to the gauge over eight.

    Parameters
    ----------
    probe : parmps.scene.InterfaceProbe
    geometry : Geometry
    names : list of str
        Of the liquids, the lowest first.
    """

    def __init__(self, probe, geometry, names):
        super().__init__(probe, geometry)
        self.pair = sorted(names.index(name) for name in probe.between)

    def _description(self, probe):
        """What the column is."""
        between, tank = " and ".join(probe.between), _STANDS[probe.fixed_to]
        return f"height of the interface between {between} above the bottom of {tank} at {_place(probe.at)}"

    def partial(self, state):
        """Profiles of the lower and the upper liquid, and moments of the rows that may be beside their interface.

        Returns
        -------
        (38 nodes,) float64
            Both profiles, and for each of the two the moments of its row with the weights for the height and those
            for the slope.
        """
        position, number = self._seen(state, SLOPE_WIDTH)
        fluid, share = state.fluid[number], state.fraction[number]
        beside = (share >= 0.5) & (share < BESIDE) & ~hidden_from_column(*self.at, position, self.boxes)
        close = (np.abs(self._from_gauge(position)) < 2.0).all(axis=0)
        profiles = [self._profile(position[close & (fluid == f)]) for f in self.pair]
        rows = [position[beside & (fluid == f)] for f in self.pair]
        moments = [self._moments(row, width) for row in rows for width in (WIDTH, SLOPE_WIDTH)]
        return np.concatenate([*profiles, *np.concatenate(moments)])

    def _height(self, sums):
        """Height of the interface above the lowest node, m: (1,) float64."""
        lower, upper, *moments = sums.reshape(-1, len(self.nodes))
        end = self._end_of_lower(lower, upper)
        if not (lower.any() and upper.any()):
            return end
        return self._between(end, np.array(moments).reshape(2, 2, 9, -1))

    def _between(self, end, moments):
        """Height midway between the rows on both sides, m: (1,) float64; the profiles' without such rows."""
        matrix, upright, rows = np.zeros((2, 2)), np.zeros(2), []
        for side, (height, slope) in zip((0.5, -0.5), moments, strict=True):
            flat, up = self._row_near(end, side, THIN_BAND, height)
            if flat[0] < LEAST_ROW:
                continue
            rows.append([side, up[0] / flat[0], *flat[1:3] / flat[0]])
            flat, up = self._row_near(end, side, THIN_BAND, slope)
            x, y = middle = flat[1:3] / flat[0]
            matrix += [[flat[3] - x * flat[1], flat[4] - x * flat[2]], [flat[4] - y * flat[1], flat[5] - y * flat[2]]]
            matrix += EVEN**2 * flat[0] * np.eye(2)
            upright += up[1:] - up[0] * middle
        if not rows:
            return end
        slope = np.linalg.solve(matrix, upright)
        slope *= slope @ slope / (slope @ slope + DOUBT**2)
        side, height, *middle = np.mean(rows, axis=0)
        height += side * (math.hypot(1.0, *slope * self.steps[2] / self.steps[:2]) - 1.0) - slope @ middle
        return end + self.steps[2] * np.clip(height, -1.0, 1.0)

    def _end_of_lower(self, lower, upper):
        """Height above the lowest node where the profiles cross, m: (1,) float64."""
        if not lower.any():
            return self._end(np.flatnonzero(upper)[0], upper, -1)
        if not upper.any():
            return self._end(np.flatnonzero(lower)[-1], lower, 1)
        excess = lower - upper
        wrong = np.concatenate([[0.0], np.cumsum(-excess)])  # the more the liquids are sorted, the less
        least = np.flatnonzero(wrong <= wrong.min() + 1e-9 * np.abs(wrong).max())
        cut = int(least[len(least) // 2])  # all nodes before it belong to the lower liquid
        if cut in (0, len(excess)):
            return self.nodes[[min(cut, len(excess) - 1)]]
        a, b = excess[cut - 1], excess[cut]
        part = a / (a - b) if a > b else 0.5
        return np.array([self.nodes[cut - 1] + part * self.nodes[1]])

    def _end(self, node, profile, outwards):
        """Where a profile falls to half of what is full, near its last node."""
        half = 0.5 * np.median(profile[profile > 0.0])
        while profile[node] < half:
            node -= outwards
        return self.nodes[[node]]


def _spline(x):
    """Cubic B-spline: its values at distances of one add up to 1."""
    return spline_weight.py_func(np.abs(x), 2.0)


class LiquidProbe:
    """Volume, centre of mass and energy of one liquid, and how much of it has strayed into others.

    The volume is that of its particles, less what they are compressed. The energy is kinetic, relative to the
    tank, and potential by the body force at the tank's origin, above its bottom corner there. Strayed is the
    share of the particles in neighbourhoods that are mostly another liquid.

    Parameters
    ----------
    probe : parmps.scene.LiquidProbe
    geometry : Geometry
    names : list of str
        Of the liquids, the lowest first.
    """

    def __init__(self, probe, geometry, names):
        self.number = names.index(probe.fluid)
        self.axes = [0, 2] if geometry.dimension == 2 else [0, 1, 2]
        volume, energy = ("m2", "J/m") if geometry.dimension == 2 else ("m3", "J")
        signals = [f"volume [{volume}]", *(f"{'xyz'[a]} [m]" for a in self.axes), f"energy [{energy}]", "strayed [-]"]
        meanings = [
            f"volume of {probe.fluid}",
            *(f"centre of mass of {probe.fluid} along {'xyz'[a]} of the tank" for a in self.axes),
            f"kinetic energy of {probe.fluid} relative to the tank and potential energy above the tank's origin",
            f"share of the particles of {probe.fluid} among mostly another liquid",
        ]
        titles = [f"{probe.name}.{signal}" for signal in signals]
        self.columns = dict(zip(titles, meanings, strict=True))

    def partial(self, state):
        """Sum volume, particles, positions, energy and strayed ones: (7,) float64."""
        own = (state.kind == FLUID) & (state.fluid == self.number)
        position, velocity = state.position[own], state.velocity[own]
        mass = state.volume[own] * np.broadcast_to(state.density, own.shape)[own]
        energy = mass @ (0.5 * np.einsum("ij,ij->i", velocity, velocity) - position @ state.frame.force)
        volume = np.sum(state.volume[own] / (1.0 + state.compression[own]))
        strayed = np.count_nonzero(state.fraction[own] < 0.5)
        return np.array([volume, len(position), *position.sum(axis=0), energy, strayed])

    def value(self, sums):
        """One value a column: (columns,) float64; zeros where the liquid has no particle."""
        volume, count, *centre, energy, strayed = sums
        if count == 0.0:
            return np.zeros(len(self.columns))
        return np.array([volume, *(centre[a] / count for a in self.axes), energy, strayed / count])
