"""Loads: what the liquid does to its walls, step by step, as pressure at places and as force and moment on bodies.

Walls do not move, so that which of a rank's wall particles count for a load, and how much, is found once a distribution
of the particles; a step then costs one product of a sparse matrix and the fields on the walls (`kernels/loads`). The
sums over all ranks become values for many steps at once.
"""

import numpy as np

from parmps.errors import InputError
from parmps.faces import faces
from parmps.kernels.loads import linear_sums, liquid_sums, wall_fields
from parmps.kernels.walls import wall_distance

AT_WALL = 0.5  # in spacings; a pressure probe nearer to a wall than this measures the wall's pressure
FLATNESS = 0.1  # in spacings; the wall that a pressure probe measures is that even, but for its curvature
SAME_WALL = 0.5  # least cosine of a pressure probe's normal and a particle's; edges have diagonal ones
FAR = 2.0  # in spacings; where a wall has no particle that near, it is another wall of the same plane, or none at all
PRESSURE, WET, DENSITY, WET_DENSITY, ONE, FRICTION = range(6)  # fields on the walls; friction has three


class WallLayer:
    """A rank's wall particles.

    Parameters
    ----------
    position, normal : (k, 3) float64, m and 1
    depth : (k,) float64, m

    Attributes
    ----------
    surface : (k, 3) float64, m
        Points of the wall that they belong to.
    """

    def __init__(self, position, normal, depth):
        self.position, self.normal, self.depth = position, normal, depth
        self.surface = position + depth[:, None] * normal
        self._faces = None

    def faces(self, geometry):
        """Bodies and areas that the particles stand for, as `parmps.lattice.faces` gives them; found once."""
        if self._faces is None:
            self._faces = faces(geometry, self.position, self.normal, self.depth)
        return self._faces


class Steps:
    """The tank's frame in many steps.

    Parameters
    ----------
    frames : list of FrameState
        One a step.

    Attributes
    ----------
    force : (steps, 3) float64, m/s2
        Body force at the tank's origin.
    turn : None or (steps, 3, 3) float64, 1/s2
        What the body force at x is less by: x times this; None where the tank does not turn.
    """

    def __init__(self, frames):
        self._frames = frames
        vectors = np.array([(frame.force, frame.omega, frame.alpha) for frame in frames])
        self.force, self.turn = vectors[:, 0], None
        if vectors[:, 1:].any():
            axes, omega, alpha = np.eye(3), vectors[:, 1:2], vectors[:, 2:]
            self.turn = np.cross(alpha, axes) + np.cross(omega, np.cross(omega, axes))

    @property
    def rotation(self):
        """Take tank-frame components to earth-frame components: (steps, 3, 3) float64."""
        return np.array([frame.rotation for frame in self._frames])

    def force_at(self, at):
        """Body force at a point of the tank, (3,) float64 in m: (steps, 3) float64, m/s2."""
        return self.force if self.turn is None else self.force - at @ self.turn


class Loads:
    """Loads on this rank, all by one product of a matrix and the fields on its walls.

    Parameters
    ----------
    loads : list
        Objects with ``columns``, ``sums`` (how many), ``on_wall`` and ``values(sums, frames)``; those on walls have
        ``nearest`` and ``forms``, the others ``partial``.
    domain : Domain
    viscous : bool
        Whether the liquid's friction on the walls is measured: it acts, and a load has it.

    Attributes
    ----------
    friction : bool
        That, where there is such a load.
    """

    def __init__(self, loads, domain, viscous=True):
        self.loads, self.domain = loads, domain
        self.count = sum(load.sums for load in loads)
        self.friction = viscous and any(isinstance(load, ForceLoad) for load in loads)
        # as `sums` has them: walls first
        self._order = sorted(loads, key=lambda load: not load.on_wall)
        self._ends = np.cumsum([load.sums for load in self._order])
        self._particles, self._settled = None, False

    def bind(self, particles):
        """Find what the rank's wall particles count for each load; collective at the first time.

        Parameters
        ----------
        particles : Particles

        Raises
        ------
        InputError
            On all ranks: no particle measures a load.
        """
        part = slice(particles.liquid, particles.rows)
        layer = WallLayer(particles.position[part], particles.normal[part], particles.depth[part])
        on_wall = [load for load in self.loads if load.on_wall]
        if not self._settled:
            near = self.domain.max(np.array([-load.nearest(layer) for load in on_wall] or [0.0]))
            for load, distance in zip(on_wall, -near, strict=False):
                load.settle(distance)
            self._settled = True
        self._surface, self._step = layer.surface, layer.depth[:, None] * layer.normal
        self._fields = np.zeros((FRICTION + 3, len(layer.depth)))
        self._fields[ONE] = 1.0
        forms = [form for load in on_wall for form in load.forms(layer)]
        if not self.friction:
            forms = [[part for part in form if part[0] < FRICTION] for form in forms]
        self._start = np.cumsum([0, *(sum(len(index) for _, index, _ in form) for form in forms)])
        parts = [part for form in forms for part in form]
        place = [field * len(layer.depth) + index for field, index, _ in parts]
        self._place = np.concatenate([np.empty(0, np.int64), *place])
        self._weight = np.concatenate([np.empty(0), *(weight for _, _, weight in parts)])
        self._particles = particles

    def sums(self, particles, density, frame, friction):
        """Sum over this rank's particles.

        Parameters
        ----------
        particles : Particles
            The same object from one distribution to the next.
        density : (liquids,) float64, kg/m3
        frame : FrameState
            Of the tank.
        friction : None or (k, 3) float64, N, in 2D N/m
            Of the liquid on the wall particles; None where it is not measured.

        Returns
        -------
        (count,) float64
        """
        p = particles
        if p is not self._particles:
            self.bind(p)
        part, fields = slice(p.liquid, p.rows), self._fields
        motion = (frame.force, frame.alpha, frame.omega)
        wall_fields(p.pressure[part], density[p.fluid[part]], self._surface, self._step, *motion, fields[:ONE])
        if friction is not None:
            fields[FRICTION:] = friction.T
        sums = np.empty(self.count)
        of_walls = sums[: len(self._start) - 1]
        linear_sums(self._start, self._place, self._weight, fields.ravel(), of_walls)
        at = len(of_walls)
        for load in self.loads:
            if not load.on_wall:
                load.partial(p, density, sums[at : at + load.sums])
                at += load.sums
        return sums

    def values(self, sums, frames):
        """Turn the sums of all ranks into values.

        Parameters
        ----------
        sums : (steps, count) float64
        frames : list of FrameState
            One a step.

        Returns
        -------
        (steps, signals) float64
            In the order of the loads.
        """
        frames, found = Steps(frames), {}
        for load, end in zip(self._order, self._ends, strict=True):
            found[load] = load.values(sums[:, end - load.sums : end], frames)
        return np.concatenate([found[load] for load in self.loads], axis=1)


def pressure_columns(name, where):
    """Columns of a pressure and what they are, as they stand in run.json.

    Parameters
    ----------
    name : str
        Of the probe.
    where : str

    Returns
    -------
    dict of str to str
    """
    return {
        f"{name} [Pa]": f"pressure {where}, mean over the sampling interval around the time",
        f"{name}.max [Pa]": f"pressure {where}, highest value of a step in that interval",
    }


class WallPressure:
    """Pressure averaged over an area of the wall.

    The wall particles of that wall within the radius (two spacings if the job gives none), weighted by
    (1 - r^2 / R^2)^2. The mean is moved from the particles' centroid to the probe along the body force, so that a
    hydrostatic pressure is exact. Parts of the wall without liquid count as 0. The radius is at least one spacing, and
    half a spacing more than the distance of the nearest particle: on the tip of a plate of two spacings, particles
    stand at its two edges alone.

    Parameters
    ----------
    probe : parmps.scene.PressureProbe
    at : (3,) float64, m
        On the wall.
    normal : (3,) float64
        Out of the wall.
    spacing : float, m
    key : str
        Of the job, for a message.
    """

    on_wall, peaks, signals, sums = True, True, 1, 6

    def __init__(self, probe, at, normal, spacing, key):
        self.at, self.normal, self.spacing, self.key = at, normal, spacing, key
        self.radius = max(probe.radius or 2.0 * spacing, spacing)
        self.columns = pressure_columns(probe.name, f"on the wall at {list(probe.at)} m")

    def _of_wall(self, layer):
        """The particles of the probe's wall, and their distances from the probe."""
        index = np.flatnonzero(layer.normal @ self.normal > SAME_WALL)
        offset, normal = layer.surface[index] - self.at, layer.normal[index]
        # the chord of a circle or a ball is at right angles to the sum of the normals at its ends
        height = 0.5 * np.einsum("ij,ij->i", offset, self.normal + normal)
        level = np.minimum(np.abs(offset @ self.normal), np.abs(height)) < FLATNESS * self.spacing
        return index[level], offset[level]

    def nearest(self, layer):
        """Distance of the nearest of the rank's particles of this wall, m; infinite without any."""
        return np.linalg.norm(self._of_wall(layer)[1], axis=1).min(initial=np.inf)

    def settle(self, nearest):
        """Choose the radius, given the distance of the nearest particle of all ranks, m.

        Raises
        ------
        InputError
            If that is no particle of this wall.
        """
        if nearest > FAR * self.spacing:
            raise InputError(
                f"{self.key}.at",
                f"the wall there is too small for particles {self.spacing:g} m apart (spacing): the nearest of its "
                f"particles is {nearest:.3g} m away, must be at most {FAR * self.spacing:g} m",
            )
        self.radius = max(self.radius, nearest + 0.5 * self.spacing)

    def forms(self, layer):
        """Weights of the sums over weights, wet weights, pressures, and density times the way from the probe."""
        index, offset = self._of_wall(layer)
        weight = np.maximum(1.0 - np.sum(offset**2, axis=1) / self.radius**2, 0.0) ** 2
        used = weight > 0.0
        index, offset, weight = index[used], offset[used], weight[used]
        ways = [[(DENSITY, index, weight * offset[:, axis])] for axis in range(3)]
        return [[(field, index, weight)] for field in (ONE, WET, PRESSURE)] + ways

    def values(self, sums, frames):
        """Pressure, Pa: (steps, 1) float64; 0 where there is no liquid."""
        weight, wet, pressure = sums.T[:3]
        correction = -np.einsum("sa,sa->s", sums[:, 3:], frames.force_at(self.at))
        return ((wet > 0.0) * (pressure + correction * wet / weight) / weight)[:, None]


class LiquidPressure:
    """Pressure averaged over a disc (2D) or ball (3D) in the liquid, weighted and moved as by `WallPressure`.

    Parameters
    ----------
    probe : parmps.scene.PressureProbe
    at : (3,) float64, m
    spacing : float, m
    """

    on_wall, peaks, signals, sums = False, True, 1, 5

    def __init__(self, probe, at, spacing):
        self.at, self.radius = at, max(probe.radius or 2.0 * spacing, spacing)
        self.columns = pressure_columns(probe.name, f"in the liquid at {list(probe.at)} m")

    def partial(self, particles, density, out):
        """Sum weights, pressures, and density times the way from the probe: fills (5,) float64."""
        p = particles
        liquid_sums(p.position, p.pressure, p.kind, p.fluid, density, p.liquid, self.at, self.radius, out)

    def values(self, sums, frames):
        """Pressure, Pa: (steps, 1) float64; 0 where there is no liquid."""
        correction = -np.einsum("sa,sa->s", sums[:, 2:], frames.force_at(self.at))
        return ((sums[:, 1] + correction) / np.where(sums[:, 0] > 0.0, sums[:, 0], 1.0))[:, None]


def pressure_load(probe, geometry, key):
    """Make the probe of a pressure: on the wall if it is within half a spacing of one, else in the liquid.

    Parameters
    ----------
    probe : parmps.scene.PressureProbe
    geometry : Geometry
    key : str
        Of the job.

    Returns
    -------
    WallPressure or LiquidPressure
    """
    at = np.array(probe.at if geometry.dimension == 3 else [probe.at[0], 0.0, probe.at[1]])
    distance, *normal = wall_distance(*at, geometry.walls)
    if abs(distance) > AT_WALL * geometry.spacing:
        return LiquidPressure(probe, at, geometry.spacing)
    normal = np.array(normal)
    return WallPressure(probe, at - distance * normal, normal, geometry.spacing, key)


class PanelPressure:
    """Mean pressure over a rectangle of a wall or a baffle.

    A wall particle counts by what the rectangle has of its share of the wall, a square (3D) or a line (2D), and with
    its pressure moved along the body force to the middle of that. Parts without liquid count as 0.

    Parameters
    ----------
    probe : parmps.scene.PanelProbe
    geometry : Geometry
    key : str
        Of the job, for a message.

    Raises
    ------
    InputError
        If the rectangle is not on a wall.
    """

    on_wall, peaks, signals, sums = True, True, 1, 5

    def __init__(self, probe, geometry, key):
        self.geometry, self.key = geometry, f"{key}.corners"
        corners = np.zeros((2, 3))
        corners[:, [0, 2] if geometry.dimension == 2 else [0, 1, 2]] = np.sort(probe.corners, axis=0)
        self.low, self.high = corners
        self.middle = corners.mean(axis=0)
        self.across = next(a for a in (0, 2, 1) if self.low[a] == self.high[a])  # in 2D, all are equal along y
        self.along = [a for a in ((0, 2) if geometry.dimension == 2 else (0, 1, 2)) if a != self.across]
        distance, *normal = wall_distance(*self.middle, geometry.walls)
        self.normal = np.array(normal)
        if abs(distance) > AT_WALL * geometry.spacing or abs(normal[self.across]) < 1.0 - FLATNESS:
            found = f"the middle of {[list(corner) for corner in probe.corners]} m is {abs(distance):.3g} m from a wall"
            raise InputError(self.key, f"{found}, must lie on one that is at right angles to {'xyz'[self.across]}")
        self.columns = pressure_columns(probe.name, f"on the panel {[list(corner) for corner in probe.corners]} m")

    def _shares(self, layer):
        """Particles of the panel, what it has of their shares of the wall, and the ways there from their points."""
        off = np.abs(layer.surface[:, self.across] - self.middle[self.across]) < 0.5 * self.geometry.spacing
        index = np.flatnonzero(off & (layer.normal @ self.normal > SAME_WALL))
        area = -layer.faces(self.geometry)[1][index] @ self.normal
        place = layer.position[index][:, self.along]
        half = 0.5 * np.maximum(area, 0.0)[:, None] ** (1.0 / len(self.along))
        low = np.maximum(place - half, self.low[self.along])
        high = np.minimum(place + half, self.high[self.along])
        share = np.prod(np.maximum(high - low, 0.0), axis=1)
        way = np.zeros((len(index), 3))
        way[:, self.along] = 0.5 * (low + high) - layer.surface[index][:, self.along]
        used = share > 0.0
        return index[used], share[used], way[used]

    def nearest(self, layer):
        """0 m where the panel has a particle; infinite without any."""
        return 0.0 if len(self._shares(layer)[0]) else np.inf

    def settle(self, nearest):
        """Refuse a panel that no particle of any rank is on.

        Raises
        ------
        InputError
            If so.
        """
        if nearest > 0.0:
            raise InputError(self.key, "no wall particle has a share of this panel; it is not on a wall")

    def forms(self, layer):
        """Weights of the sums over shares, pressures, and density times the way to the middle of each share."""
        index, share, way = self._shares(layer)
        ways = [[(WET_DENSITY, index, share * way[:, axis])] for axis in range(3)]
        return [[(ONE, index, share)], [(PRESSURE, index, share)], *ways]

    def values(self, sums, frames):
        """Pressure, Pa: (steps, 1) float64."""
        correction = np.einsum("sa,sa->s", sums[:, 2:], frames.force_at(self.middle))
        return ((sums[:, 1] + correction) / sums[:, 0])[:, None]


class ForceLoad:
    """Force of the liquid on the tank and its baffles, in all and one by one, and its moment about a point.

    The pressure at the wall times the wall's area, and friction where viscosity acts.

    Parameters
    ----------
    probe : parmps.scene.ForceProbe
    geometry : Geometry
    tank : parmps.scene.Tank
    """

    on_wall, peaks = True, False

    def __init__(self, probe, geometry, tank):
        self.geometry, self.earth = geometry, probe.frame == "earth"
        flat = geometry.dimension == 2
        point = tank.bottom_centre if probe.about is None else probe.about
        self.about = np.array([point[0], 0.0, point[1]] if flat else point)
        self.used = np.array([0, 2, 4] if flat else range(6))
        self.bodies = 1 + len(geometry.solids)
        self.sums, self.signals = self.bodies * len(self.used), (1 + self.bodies) * len(self.used)
        units = ("N/m", "N m/m") if flat else ("N", "N m")
        names = {"": "the tank and its baffles", "tank.": "the tank without its baffles"}
        names |= {f"{name}.": name for name in tank.baffle_names}
        self.columns = {
            f"{probe.name}.{name}{'FM'[a // 3]}{'xyz'[a % 3]} [{units[a // 3]}]": self._meaning(a, body, point)
            for name, body in names.items()
            for a in self.used
        }

    def _meaning(self, number, body, point):
        """What a column is: body, axis, sign, point, and over what time."""
        axis = "xyz"[number % 3]
        frame = "axes of the earth" if self.earth else "axes of the tank"
        mean = "mean over the sampling interval around the time"
        if number < 3:
            return f"force of the liquid on {body} along {axis}, positive towards +{axis}; {frame}; {mean}"
        turn = {"x": "y to z", "y": "z to x", "z": "x to y"}[axis]
        about = f"the point {list(point)} m, which moves with the tank"
        return f"moment of the liquid on {body} about {axis} through {about}, positive from {turn}; {frame}; {mean}"

    def nearest(self, layer):
        """Any wall particle will do: 0."""
        return 0.0

    def settle(self, nearest):
        """Nothing to choose."""

    def forms(self, layer):
        """Weights of force and moment on the tank and on each baffle."""
        owner, area = layer.faces(self.geometry)
        arm = layer.surface - self.about
        by_pressure = np.concatenate([area, np.cross(arm, area)], axis=1)
        unit = np.eye(3)
        by_friction = np.concatenate([np.tile(unit, (len(arm), 1, 1)), np.cross(arm[:, None], unit)], axis=2)
        forms = []
        for body in range(self.bodies):
            index = np.flatnonzero(owner == body)
            for a in self.used:
                parts = [(PRESSURE, by_pressure[index, a])]
                parts += [(FRICTION + axis, by_friction[index, axis, a]) for axis in range(3)]
                forms.append([(field, index[w != 0.0], w[w != 0.0]) for field, w in parts])
        return forms

    def values(self, sums, frames):
        """Force (N, in 2D N/m) and moment (N m, in 2D N): (steps, signals) float64."""
        parts = sums.reshape(len(sums), self.bodies, -1)
        parts = np.concatenate([parts.sum(axis=1, keepdims=True), parts], axis=1)
        if self.earth:
            vectors = np.zeros((*parts.shape[:2], 6))
            vectors[:, :, self.used] = parts
            vectors = vectors.reshape(*parts.shape[:2], 2, 3)
            turned = np.einsum("sij,sbvj->sbvi", frames.rotation, vectors)
            parts = turned.reshape(*parts.shape[:2], 6)[:, :, self.used]
        return parts.reshape(len(sums), -1)
