"""Measurements: pressure at a point, height of the free surface, force on the tank and its baffles.

A probe turns the particles that one rank owns into sums, and the sums over all ranks into values, so that
all probes together need one reduction. The particles come as a state with these attributes, of owned
particles only: ``position``, ``velocity``, ``normal`` (n, 3), ``pressure``, ``kind``, ``fluid``, ``surface``,
``depth`` (n,), and ``spacing`` (m), ``frame`` (the tank's, a `FrameState`) and ``density`` (kg/m3, one value or (n,));
for a liquid also ``volume`` (m3), ``compression`` and ``fraction`` (n,), the share of the particle's own liquid in its
neighbourhood.
"""

import math

import numpy as np

from parmps.kernels.walls import distances, hidden_from_column, wall_distance
from parmps.kernels.weight import spline_weight
from parmps.lattice import faces
from parmps.tank import FLUID, WALL

AT_WALL = 0.5  # in spacings; a pressure probe nearer to a wall than this measures the wall's pressure
NODES = 4  # of the profile of a gauge, per spacing
FLATNESS = 0.1  # in spacings; the wall that a pressure probe measures is that even, but for its curvature
SAME_WALL = 0.5  # least cosine of a pressure probe's normal and a particle's; edges have diagonal ones
LEAST_ROW = 1.0 / 3.0  # of the row in the surface; where a gauge sees less of it, it has no place for the surface
BAND = 2.0  # in lattice steps; how far from the end of the main body a gauge looks for the row of its surface
EVEN = 0.1  # in lattice steps; along which particles are spread less, a gauge sees no slope
ROW, COLUMN = np.triu_indices(3)
MAX_VOID = 1.5  # in spacings; a smaller gap in the liquid below a gauge is a passing void, not a surface


def build_probes(job, geometry):
    """Make the probes of a job.

    Parameters
    ----------
    job : Job
    geometry : Geometry

    Returns
    -------
    list
        Objects with ``columns`` (list of str, with units), ``partial(state)`` that returns local sums as a
        1-D float64 array of fixed length, and ``value(sums)`` that returns one value per column.
    """
    kinds = {"pressure": PressureGauge, "elevation": ElevationGauge, "force": ForceGauge}
    names = [fluid.name for fluid in job.fluids]
    of_liquids = {"interface": InterfaceGauge, "liquid": LiquidProbe}
    return [
        of_liquids[probe.kind](probe, geometry, names)
        if probe.kind in of_liquids
        else kinds[probe.kind](probe, geometry)
        for probe in job.probes
    ]


def surface_pressure(state, chosen):
    """Pressure of wall particles carried along the body force to the wall surface that they belong to.

    Parameters
    ----------
    state : object
        See the module.
    chosen : (n,) bool or (k,) int64
        The particles.

    Returns
    -------
    pressure : (k,) float64, Pa
        Unchanged where it is 0: such a particle has no liquid next to it.
    surface : (k, 3) float64, m
        The points on the wall.
    """
    step = state.depth[chosen, None] * state.normal[chosen]
    pressure, surface = state.pressure[chosen], state.position[chosen] + step
    jump = _density(state, chosen) * np.einsum("ij,ij->i", step, state.frame.force_at(surface))
    return np.where(pressure != 0.0, pressure + jump, 0.0), surface


def _density(state, chosen):
    density = np.asarray(state.density, dtype=float)
    return density[chosen] if density.ndim else density


class PressureGauge:
    """Pressure averaged over an area of the wall, or in the liquid over a disc (2D) or ball (3D).

    A probe within half a spacing of a wall reads the wall particles of that wall within its radius (two
    spacings if the job gives none, and never less than one), weighted by (1 - r^2 / R^2)^2. The mean is
    moved from the particles' centroid to the probe along the body force, so that a hydrostatic pressure is
    exact. Parts of the wall without liquid count as 0. Any other probe reads the liquid around it.

    Parameters
    ----------
    probe : parmps.scene.PressureProbe
    geometry : Geometry
    """

    def __init__(self, probe, geometry):
        self.columns = [f"{probe.name} [Pa]"]
        at = np.array(probe.at if geometry.dimension == 3 else [probe.at[0], 0.0, probe.at[1]])
        spacing = geometry.spacing
        self.radius = max(probe.radius or 2.0 * spacing, spacing)
        distance, *normal = wall_distance(*at, geometry.walls)
        self.on_wall = abs(distance) <= AT_WALL * spacing
        self.normal = np.array(normal)
        self.at = at - distance * self.normal if self.on_wall else at
        self.flatness = FLATNESS * spacing

    def partial(self, state):
        """Sum weights, wet weights, weighted pressure and its first-order correction: (4,) float64."""
        # the depth of the wall layer is less than one spacing
        reach = self.radius + state.spacing
        near = np.flatnonzero((np.abs(state.position - self.at) <= reach).all(axis=1))
        near = near[state.kind[near] == (WALL if self.on_wall else FLUID)]
        pressure, surface = surface_pressure(state, near)
        offset = surface - self.at
        weight = np.maximum(1.0 - np.sum(offset**2, axis=1) / self.radius**2, 0.0) ** 2
        if self.on_wall:
            # the chord of a circle or a ball is at right angles to the sum of the normals at its ends
            normal = state.normal[near]
            height = 0.5 * np.einsum("ij,ij->i", offset, self.normal + normal)
            level = np.minimum(np.abs(offset @ self.normal), np.abs(height)) < self.flatness
            weight = weight * (level & (normal @ self.normal > SAME_WALL))
            wet = weight * (pressure != 0.0)
        else:
            wet = weight
        correction = -_density(state, near) * (offset @ state.frame.force_at(self.at))
        return np.array([weight.sum(), wet.sum(), weight @ pressure, weight @ correction])

    def value(self, sums):
        """Pressure, Pa: (1,) float64; 0 where there is no liquid."""
        weight, wet, pressure, correction = sums
        if wet == 0.0:
            return np.zeros(1)
        return np.array([(pressure + correction * wet / weight) / weight])


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
        self.columns = [f"{probe.name} [m]"]
        axes = geometry.axes
        self.geometry, self.earth = geometry, probe.fixed_to == "earth"
        self.at = np.array(probe.at if geometry.dimension == 3 else [probe.at[0], 0.0])
        self.steps = np.array([axis.step for axis in axes])
        self.base = 0.0  # height of the lowest node
        self.reach = self._diagonal() if self.earth else 0.0
        height = 2.0 * self.reach if self.earth else axes[2].high
        self.nodes = np.linspace(0.0, height, int(np.ceil(NODES * height / self.steps[2])) + 1)
        self.solid = np.ones(len(self.nodes), bool)  # what is none of the liquid's in the tank's own column is a baffle
        self.boxes = geometry.walls.solids[:0] if self.earth else geometry.walls.solids
        if self.earth:
            return
        near = [np.abs(axis.points - at) for axis, at in zip(axes, self.at, strict=False)]
        x, y = (axes[a].points[near[a] < 2 * self.steps[a]] for a in (0, 1))
        grid = np.meshgrid(x, y, axes[2].points, indexing="ij")
        lattice = np.stack(grid, axis=-1).reshape(-1, 3)
        lattice = lattice[distances(lattice, geometry.walls)[0] > 0.0]
        self.full = self._profile(lattice)

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

    def _seen(self, state):
        """Liquid near the column: positions along its axes, (k, 3) float64, m, and numbers of the particles, (k,)."""
        number = np.flatnonzero(state.kind == FLUID)
        position = state.position[number]
        if self.earth:
            self._stand(state.frame)
            position = self._on_earth(position, state.frame)
        near = (np.abs(position[:, :2] - self.at) < 2 * self.steps[:2]).all(axis=1)
        return position[near], number[near]

    def partial(self, state):
        """Sum the particles near the gauge over the nodes of its profile, and moments of those in the surface.

        Returns
        -------
        (10 nodes,) float64
            The profile, and of the surface's particles by the node nearest to them the sums of their weights times
            1, x, y, x^2, xy, y^2, z, xz and yz, from the gauge and from the node up, in lattice steps.
        """
        position, number = self._seen(state)
        row = position[state.surface[number] != 0]
        row = row[~hidden_from_column(*self.at, row, self.boxes)]
        node = np.clip(np.rint(row[:, 2] / self.nodes[1]).astype(int), 0, len(self.nodes) - 1)
        x, y = self._from_gauge(row)
        z, weight = (row[:, 2] - self.nodes[node]) / self.steps[2], _spline(x) * _spline(y)
        terms = (1.0, x, y, x * x, x * y, y * y, z, x * z, y * z)
        moments = [np.bincount(node, weight * term, len(self.nodes)) for term in terms]
        return np.concatenate([self._profile(position), *moments])

    def value(self, sums):
        """Height, m: (1,) float64; 0 where the column is dry."""
        height = self._height(sums) if sums.any() else None
        return np.zeros(1) if height is None else self.base + height

    def _height(self, sums):
        """Height of the surface above the lowest node, m: (1,) float64, or None without one."""
        profile, *moments = sums.reshape(-1, len(self.nodes))
        end = self._end_of_body(profile)
        return end if end is None else self._fit(end, np.array(moments))

    def _fit(self, end, moments):
        """Height of the surface above the row near the end of the main body, m: (1,) float64; that end without one."""
        above = (self.nodes - end) / self.steps[2] + 0.5  # the middle of the row
        near = np.abs(above) < BAND
        flat, upright = moments[:6, near], moments[6:, near] + above[near] * moments[:3, near]
        matrix = np.zeros((3, 3))
        matrix[ROW, COLUMN] = matrix[COLUMN, ROW] = flat.sum(axis=1)
        if matrix[0, 0] < LEAST_ROW:
            return end
        matrix[[1, 2], [1, 2]] += EVEN**2 * matrix[0, 0]
        height, *slope = np.linalg.solve(matrix, upright.sum(axis=1))
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

    Both liquids near the gauge are spread over heights as by `ElevationGauge`. The interface is the height with
    the least of the upper liquid below it and of the lower one above it, so that drops of one in the other
    count as little as they hold; there the two profiles cross. Where one of the two is missing, it is the end of
    the other one.

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

    def partial(self, state):
        """Profiles of the lower and the upper liquid, one after the other: (2 nodes,) float64."""
        position, number = self._seen(state)
        return np.concatenate([self._profile(position[state.fluid[number] == f]) for f in self.pair])

    def _height(self, sums):
        """Height of the interface above the lowest node, m: (1,) float64."""
        lower, upper = sums.reshape(2, -1)
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
        self.columns = [f"{probe.name}.{signal}" for signal in signals]

    def partial(self, state):
        """Sum volume, particles, positions, energy and strayed ones: (7,) float64."""
        own = (state.kind == FLUID) & (state.fluid == self.number)
        position, velocity = state.position[own], state.velocity[own]
        mass = state.volume[own] * _density(state, own)
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


class ForceGauge:
    """Force of the liquid on the tank and on each baffle, and its moment about the tank's bottom centre.

    The pressure at the wall times the wall's area; friction is left out.

    Parameters
    ----------
    probe : parmps.scene.ForceProbe
    geometry : Geometry
    """

    def __init__(self, probe, geometry):
        self.geometry = geometry
        names = ["", *(f"baffle{number + 1}." for number in range(len(geometry.solids)))]
        if geometry.dimension == 2:
            signals, self.used = ["Fx [N/m]", "Fz [N/m]", "My [N m/m]"], [0, 2, 4]
        else:
            signals, self.used = [f"F{a} [N]" for a in "xyz"] + [f"M{a} [N m]" for a in "xyz"], range(6)
        self.columns = [f"{probe.name}.{name}{signal}" for name in names for signal in signals]
        x, y, _ = geometry.axes
        middle = (y.low + y.high) / 2 if geometry.dimension == 3 else 0.0
        self.centre = np.array([(x.low + x.high) / 2, middle, 0.0])

    def partial(self, state):
        """Sum force and moment on the tank and each baffle: (columns,) float64."""
        wall = np.flatnonzero((state.kind == WALL) & (state.pressure != 0.0))
        pressure, surface = surface_pressure(state, wall)
        owner, area = faces(self.geometry, state.position[wall], state.normal[wall], state.depth[wall])
        force = pressure[:, None] * area
        both = np.concatenate([force, np.cross(surface - self.centre, force)], axis=1)
        count = len(self.geometry.solids) + 1
        return np.stack([np.bincount(owner, both[:, a], count) for a in self.used], axis=1).ravel()

    def value(self, sums):
        """Force (N, in 2D N/m) and moment (N m, in 2D N): (columns,) float64."""
        return sums
