"""Particles of a job at the start: liquid on a lattice, and the layers of wall particles around it."""

import itertools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from parmps import waves
from parmps.errors import InputError
from parmps.kernels.walls import distances
from parmps.lattice import ROUNDING, Geometry, build_geometry, distance_to_box
from parmps.level import arrange_level, hull_contents, starts_level
from parmps.packing import BAND, CLEARANCE, REACH, pack, pack_around
from parmps.particles import DUMMY, FLUID, WALL
from parmps.states import point, read_state, three
from parmps.wall_layers import place_walls

FLUID_CLEARANCE = 0.75  # least distance of the liquid from a baffle, in spacings, where walls are on the wall line
FITS = 0.1  # a cell of which a baffle leaves less, or takes less, is none or whole
BESIDE = 3.5  # in spacings; how far from a baffle that cuts the lattice the liquid is evened out
SCATTER = (0.8191725, 0.6710436, 0.5497005)  # powers of the root of x^4 = x + 1: even in any stretch (Roberts 2018)
CHUNK = 2**20  # lattice points handled at once
EMPTY_SHARES = 2**62  # more shares than particles: the first one is empty


@dataclass(frozen=True)
class Placement:
    """Particles at the start, or one rank's share of them; liquid first, in the order of their ids.

    Attributes
    ----------
    position : (n, 3) float64, m
        y is 0 in 2D.
    kind : (n,) int8
        0 fluid, 1 wall layer, 2 dummy.
    fluid : (n,) int8
        Number of the liquid; 0 for walls.
    normal : (n, 3) float64
        Unit vector from the wall into the liquid; 0 for fluid.
    depth : (n,) float64, m
        Distance below the wall surface; position + depth * normal lies on it. 0 for fluid.
    volume : (n,) float64, m3 (m2 in 2D)
        Of a fluid particle, so that each liquid's sum is the volume it fills; 0 for walls.
    parent : (n,) int64
        For a dummy particle, the id of the wall particle it belongs to; else -1.
    id : (n,) int64
        Number of the particle among all.
    total : int
        Number of particles of all shares.
    total_fluid : int
        Number of fluid particles of all shares.
    geometry : Geometry
    """

    position: np.ndarray
    kind: np.ndarray
    fluid: np.ndarray
    normal: np.ndarray
    depth: np.ndarray
    volume: np.ndarray
    parent: np.ndarray
    id: np.ndarray
    total: int
    total_fluid: int
    geometry: Geometry

    @property
    def spacing(self):
        """Effective particle spacing l0, m."""
        return self.geometry.spacing


def place(job, wall, part=0, parts=1, layers=3):
    """Place the particles of a job, or one of several nearly equal shares of them.

    A share is a range of ids, and liquid is numbered along x last, so that it is a slab of the tank. Only the
    wall particles, few beside the liquid, are all held for a moment by each caller; of a tank that is no box,
    also the points of its cross-section, or where it is not straight along x, or tilted, of all its inside.

    Parameters
    ----------
    job : Job
    wall : {"half", "line"}
        Wall particles half a spacing outside the wall, or on it with the first liquid one spacing inside.
    part, parts : int
        Which share of how many; ids and positions do not depend on them.
    layers : int
        Wall layer plus dummy layers: 3 for a reach of 2.1 spacings, 5 for 4.01.

    Returns
    -------
    Placement

    Raises
    ------
    InputError
        The spacing does not fit the tank, no liquid fits, liquids overlap, or they would run out of a tilted tank.
    """
    geometry = build_geometry(job, wall, layers)
    walls = place_walls(geometry)
    read = read_state(job, geometry) if job.initial.kind == "file" else None
    moved = None if read else _moved(job, geometry, walls["position"])
    whole = _place_level(job, geometry, walls["position"], moved) if starts_level(job) else read
    counts = np.bincount(whole["fluid"], minlength=len(job.fluids)) if whole else _count_fluids(job, geometry, moved)
    total_fluid = int(counts.sum())
    if total_fluid == 0:
        raise InputError("fluids", f"no particle fits at the spacing of {job.spacing:g} m")
    total = total_fluid + len(walls["kind"])
    start, stop = total * part // parts, total * (part + 1) // parts
    share = range(min(start, total_fluid), min(stop, total_fluid))
    if whole:
        liquid = {name: whole[name][share.start : share.stop] for name in ("position", "fluid")}
    else:
        liquid = _place_fluids(job, geometry, share, moved)
    n = len(liquid["fluid"])
    contents = whole.get("content") if whole else None
    if contents is None:
        contents = [_filled_volume(job, geometry, k, count) for k, count in enumerate(counts)]
    volume = np.array(contents) / np.maximum(counts, 1)
    cut = slice(max(start - total_fluid, 0), max(stop - total_fluid, 0))
    walls = {name: values[cut] for name, values in walls.items()}
    m = len(walls["kind"])
    parent = np.where(walls["parent"] < 0, -1, walls["parent"] + total_fluid)
    return Placement(
        position=np.concatenate([liquid["position"], walls["position"]]),
        kind=np.concatenate([np.zeros(n, np.int8), walls["kind"]]),
        fluid=np.concatenate([liquid["fluid"], np.zeros(m, np.int8)]),
        normal=np.concatenate([np.zeros((n, 3)), walls["normal"]]),
        depth=np.concatenate([np.zeros(n), walls["depth"]]),
        volume=np.concatenate([volume[liquid["fluid"]], np.zeros(m)]),
        parent=np.concatenate([np.full(n, -1), parent]),
        id=np.arange(start, stop),
        total=total,
        total_fluid=total_fluid,
        geometry=geometry,
    )


def count_particles(job, wall, layers=3):
    """Count the particles of a job without placing the liquid.

    Parameters
    ----------
    job : Job
    wall, layers
        As in `place`.

    Returns
    -------
    dict of str to int
        ``fluid``, ``wall``, ``dummy`` and ``total``.
    float
        Effective spacing l0, m.

    Raises
    ------
    InputError
        As in `place`.
    """
    shares = place(job, wall, part=0, parts=EMPTY_SHARES, layers=layers)
    kinds = np.bincount(place_walls(shares.geometry)["kind"], minlength=3)
    counts = {"fluid": shares.total_fluid, "wall": int(kinds[WALL]), "dummy": int(kinds[DUMMY])}
    return {**counts, "total": shares.total}, shares.spacing


# ---- liquid


def _all_filled(job, geometry):
    """Whether every site of the layers in use holds liquid, so that its number is the particle's id."""
    return not len(geometry.walls.solids) and not any(fluid.region for fluid in job.fluids)


def _sites(job, geometry):
    """Places that liquid can have at the start.

    Returns
    -------
    layers : (m,) int64
        Layer of liquid of each site in one period: the sites repeat along the axes across it.
    count : int
        Number of sites.
    locate : function
        Positions (n, 3) of sites, given their numbers.
    """
    used = len(geometry.layer_rows) + any(fluid.region is not None for fluid in job.fluids)
    x, y, z = (axis.points for axis in geometry.axes)
    packed = geometry.arrangement
    if packed is None:
        layers = np.searchsorted(geometry.layer_rows, np.arange(len(z)), side="right")
        layers = layers[layers < used]

        def locate(index):
            column, row = np.divmod(index, len(layers))
            i, j = np.divmod(column, len(y))
            return np.stack([x[i], y[j], z[row]], axis=1)

        return layers, len(x) * len(y) * len(layers), locate
    chosen = packed.layer < used
    points = packed.points[chosen]
    along = x if 0 not in geometry.hull_axes else np.zeros(1)

    def locate(index):
        i, number = np.divmod(index, len(points))
        position = np.zeros((len(index), 3))
        position[:, 0] = along[i]
        position[:, geometry.hull_axes] = points[number]
        return position

    return packed.layer[chosen], len(along) * len(points), locate


def _site_chunks(job, geometry, start=0):
    """Yield a bounded number of sites at a time: their numbers, positions, and liquids, -1 for none."""
    layers, size, locate = _sites(job, geometry)
    for first in range(start, size, CHUNK):
        index = np.arange(first, min(first + CHUNK, size))
        position = locate(index)
        fluid = _fluid_at(job, geometry, position, layers[index % len(layers)])
        if len(geometry.walls.solids):
            _keep_off_baffles(geometry, position, fluid)
        yield index, position, fluid


def _chunks(job, geometry, moved, start=0):
    """Yield the liquid, from a bounded number of sites at a time: position and fluid."""
    for index, position, fluid in _site_chunks(job, geometry, start):
        if moved is not None:
            here = (moved.site >= index[0]) & (moved.site <= index[-1])
            at = moved.site[here] - index[0]
            position[at], fluid[at] = moved.position[here], moved.fluid[here]
        yield position[fluid >= 0], fluid[fluid >= 0]


class Moved(NamedTuple):
    """Particles that do not stand on their sites.

    Attributes
    ----------
    site : (n,) int64
    position : (n, 3) float64, m
    fluid : (n,) int8
    """

    site: np.ndarray
    position: np.ndarray
    fluid: np.ndarray


def _moved(job, geometry, walls):
    """All particles that do not stand on their sites, or None."""
    found = [_even_out_beside_baffles(job, geometry, walls), _round_interfaces(job, geometry)]
    found = [each for each in found if each is not None]
    return Moved(*map(np.concatenate, zip(*found, strict=True))) if found else None


def _round_interfaces(job, geometry):
    """Even out the particles around discs and balls with surface tension, or None where there are none.

    The lattice makes staircases of them, which have a curvature of their own: a drop of 20 spacings oscillates 14 %
    too slowly. Near walls, and where the liquid around does not reach far enough, the lattice is kept. What is around
    may be nothing: then it is the empty sites that hold the particles in place.
    """
    names = [fluid.name for fluid in job.fluids]
    tense = [{*map(names.index, pair.between)} for pair in job.interfaces if pair.surface_tension > 0.0]
    tense += [{number, -1} for number, fluid in enumerate(job.fluids) if fluid.surface_tension > 0.0]
    spheres = {
        number: fluid.region.disc or fluid.region.ball
        for number, fluid in enumerate(job.fluids)
        if fluid.region is not None and not fluid.region.box and any(number in pair for pair in tense)
    }
    if not spheres:
        return None
    axes, l0 = [0, 2] if geometry.dimension == 2 else [0, 1, 2], geometry.spacing

    def depth(position, sphere):
        return sphere.radius - np.linalg.norm(position[:, axes] - sphere.centre, axis=1)

    pieces, within = [], dict.fromkeys(spheres, 0)
    for index, position, fluid in _site_chunks(job, geometry):
        near = np.zeros(len(index), bool)
        for number, sphere in spheres.items():
            below = depth(position, sphere)
            near |= np.abs(below) < (BAND + REACH) * l0
            within[number] += np.count_nonzero(below >= (BAND + REACH) * l0)
        pieces.append((index[near], position[near], fluid[near]))
    site, position, fluid = (np.concatenate(arrays) for arrays in zip(*pieces, strict=True))
    gap = distances(position, geometry.walls._replace(open_top=False))[0]
    inside = {}
    for number, sphere in spheres.items():
        below = depth(position, sphere)
        near = np.flatnonzero(np.abs(below) < (BAND + REACH) * l0)
        others = set(fluid[near]) - {number}
        if gap[near].min(initial=np.inf) < REACH * l0 or any({number, other} not in tense for other in others):
            continue
        # those nearest to the centre, as many as the content asks for
        count = round(_ball(geometry, sphere.radius) / l0**geometry.dimension) - within[number]
        order = near[np.lexsort((site[near], -np.rint(below[near] / (ROUNDING * l0))))]
        chosen, others = order[:count], order[count:]
        lost = others[fluid[others] == number]
        others = others[fluid[others] != number]
        fluid[lost] = fluid[others[cKDTree(position[others]).query(position[lost])[1]]]
        fluid[chosen] = number
        inside[number] = fluid == number
    if not inside:
        return None
    balls = [(np.array(spheres[number].centre), spheres[number].radius) for number in inside]
    position[:, axes] = pack_around(position[:, axes], np.stack(list(inside.values()), axis=1), balls, l0)
    return Moved(site, position, fluid)


def _ball(geometry, radius):
    """Content of a ball, m3, or a disc, m2."""
    return np.pi * radius**2 if geometry.dimension == 2 else 4 / 3 * np.pi * radius**3


def _fluid_at(job, geometry, position, layer):
    """Find the number of the liquid at lattice points, -1 for none: (n,) int8."""
    found = np.full(len(position), -1, np.int8)
    layers = itertools.count()
    for number, fluid in enumerate(job.fluids):
        here = layer == next(layers) if fluid.region is None else _in_region(geometry, fluid.region, position)
        # a region displaces layers; no two regions share a place
        alike = [k for k in range(number) if (job.fluids[k].region is None) == (fluid.region is None)]
        twice = here & np.isin(found, alike)
        if twice.any():
            at = position[np.argmax(twice)]
            other = job.fluids[found[np.argmax(twice)]].name
            raise InputError(
                f"fluids[{number}]", f"overlaps '{other}': both have a particle at {point(geometry, at)}"
            )
        found[here & (found < 0) if fluid.region is None else here] = number
    return found


def _keep_off_baffles(geometry, position, fluid):
    """Take liquid out of baffles, in place: as much as they displace where a site stands for the space around it.

    Of sites whose cells a baffle cuts, that share is kept which is outside, evenly along its faces.
    With all that are a quarter of a spacing away, two rings in a tank of 13 rows displaced 13 % of the liquid too much.
    """
    l0 = geometry.spacing
    if geometry.wall == "line":  # the liquid keeps a spacing from its walls
        for box in geometry.walls.solids:
            fluid[distance_to_box(position, box) < (FLUID_CLEARANCE - ROUNDING) * l0] = -1
        return
    share = _share_outside(geometry, position)
    cut = np.flatnonzero((share < 1.0 - ROUNDING) & (fluid >= 0))
    at, share = position[cut], share[cut]
    gaps = np.stack([distance_to_box(at, box) for box in geometry.walls.solids])
    nearest = gaps.argmin(axis=0)
    line = np.zeros((len(cut), 3), int)  # the sites of a line follow each other along a face
    along = np.zeros(len(cut))
    for number, (low, high) in enumerate(geometry.walls.solids):
        here = nearest == number
        cell = np.floor(at[here] / l0).astype(int)  # sites are half a spacing off the walls
        thin = int(np.argmin(high - low))
        inner = 2 if thin != 2 else 0
        line[here] = np.delete(np.column_stack([np.full(len(cell), number), cell]), inner + 1, axis=1)
        along[here] = at[here, inner]
    order = np.lexsort((along, *line.T))
    line, share = line[order], share[order]
    begins = np.concatenate([[True], (line[1:] != line[:-1]).any(axis=1)])[: len(cut)]
    before = np.cumsum(share) - share
    since = before - before[begins][np.cumsum(begins) - 1] + (line @ SCATTER % 1.0)
    fluid[cut[order[np.floor(since + share + ROUNDING) == np.floor(since + ROUNDING)]]] = -1


def _share_outside(geometry, position):
    """Share of the cell of one spacing around each point that is outside of the baffles, (n,) float64; what fits, fits.

    A plate of no thickness is a spacing and a tenth thick, so that it cuts the cells beside it by a twentieth.
    """
    half, inside = geometry.spacing / 2, np.zeros(len(position))
    for low, high in geometry.walls.solids:
        sides = np.minimum(high, position + half) - np.maximum(low, position - half)
        inside += np.prod(np.clip(sides / geometry.spacing, 0.0, 1.0), axis=1)
    return np.where(inside < FITS, 1.0, np.where(inside > 1.0 - FITS, 0.0, 1.0 - inside))


def _even_out_beside_baffles(job, geometry, walls):
    """Even out the liquid beside baffles that cut the lattice, or None where none does.

    Liquid given by regions, which may have free sides there, is only moved off the baffles.
    """
    l0 = geometry.spacing
    if not len(geometry.walls.solids) or geometry.wall == "line":
        return None
    pieces, reach = [], (BESIDE + REACH) * l0
    for index, position, fluid in _site_chunks(job, geometry):
        gap = np.min([distance_to_box(position, box) for box in geometry.walls.solids], axis=0)
        near = (gap < reach) & (fluid >= 0)
        pieces.append((index[near], position[near], fluid[near], gap[near]))
    site, position, fluid, gap = (np.concatenate(arrays) for arrays in zip(*pieces, strict=True))
    cut = position[np.abs(_share_outside(geometry, position) - 0.5) < 0.5 - ROUNDING]
    if not len(cut):
        return None
    clearance, axes = CLEARANCE["half"] * l0, [0, 2] if geometry.dimension == 2 else [0, 1, 2]

    def distance(at):
        point = np.zeros((len(at), 3))
        point[:, axes] = at
        gap, normal = distances(point, geometry.walls)
        return gap, normal[:, axes]

    layered = np.array([each.region is None for each in job.fluids])[fluid]
    beside = (gap < (BESIDE - ROUNDING) * l0) & (cKDTree(cut).query(position)[0] < (BESIDE + 0.5 - ROUNDING) * l0)
    low, high = np.zeros(len(site)), np.zeros(len(site))
    for number in np.unique(fluid):  # the surface of a layer stays where it is
        low[fluid == number] = position[fluid == number, 2].min()
        high[fluid == number] = position[fluid == number, 2].max()
    began = position.copy()
    for _ in range(20):  # in a corner, one wall after the other
        off, normal = distances(position[beside], geometry.walls)
        position[beside] += np.maximum(clearance - off, 0.0)[:, None] * normal
    lost = np.zeros(len(site), bool)
    lost[beside] = distances(position[beside], geometry.walls)[0] < 0.9 * clearance
    lost |= np.linalg.norm(position - began, axis=1) > l0
    fluid[lost] = -1
    moves = beside & layered & ~lost
    if moves.any():
        around = walls[cKDTree(position[moves]).query(walls)[0] < reach]
        # the faces of a thin plate have their wall particles in one place
        double = cKDTree(around).query_pairs((0.5 + ROUNDING) * l0, output_type="ndarray")[:, 1]
        around = np.delete(around, np.unique(double), axis=0)
        fixed = np.concatenate([position[~moves & ~lost], around])[:, axes]
        bounds = low[moves], high[moves]
        position[np.ix_(moves, axes)] = pack(position[moves][:, axes], fixed, l0, distance, clearance, *bounds)
    return Moved(site[beside], position[beside], fluid[beside])


def _corners(geometry, region):
    """Corners of a region's bounding box, in three components: (2, 3) float64, m."""
    sphere = region.disc or region.ball
    if sphere:
        centre = np.array(sphere.centre)
        corners = np.array([centre - sphere.radius, centre + sphere.radius])
    else:
        corners = np.array(region.box)
    return corners if geometry.dimension == 3 else np.insert(corners, 1, (-0.5, 0.5), axis=1)


def _in_region(geometry, region, position):
    low, high = _corners(geometry, region)
    sphere = region.disc or region.ball
    rounding = ROUNDING * geometry.spacing
    if sphere:
        offset = position - (low + high) / 2
        return np.linalg.norm(offset, axis=1) < sphere.radius - rounding
    # regions that share a face share no particle; on lattice planes the upper face counts, as for a depth
    shift = rounding if geometry.wall == "line" else -rounding
    return ((position > low + shift) & (position < high + shift)).all(axis=1)


def _count_fluids(job, geometry, moved):
    """Particles of each liquid: (fluids,) int64."""
    if _all_filled(job, geometry):
        layers, size, _ = _sites(job, geometry)
        return np.bincount(layers, minlength=len(job.fluids)) * (size // len(layers))
    return sum(np.bincount(fluid, minlength=len(job.fluids)) for _, fluid in _chunks(job, geometry, moved))


def _place_level(job, geometry, walls, moved):
    """All liquid of a tank that is tilted: layers with level surfaces, and regions where they are in the tank.

    Position and fluid as in `Placement`, and the volume of each liquid.
    """
    layers = [number for number, fluid in enumerate(job.fluids) if fluid.region is None]
    regions = [(np.empty((0, 3)), np.empty(0, np.int8))]
    if len(layers) < len(job.fluids):
        for position, fluid in _chunks(job, geometry, moved):
            own = ~np.isin(fluid, layers)
            regions.append((position[own], fluid[own]))
    within, region = (np.concatenate(arrays) for arrays in zip(*regions, strict=True))
    level = arrange_level(job, geometry, walls, within)
    position = np.concatenate([level.position, within])
    fluid = np.concatenate([np.array(layers)[level.layer], region]).astype(np.int8)
    order = np.argsort(position[:, 0], kind="stable")
    counts = np.bincount(fluid, minlength=len(job.fluids))
    content = [_filled_volume(job, geometry, k, count) for k, count in enumerate(counts)]
    if geometry.hull is not None and not len(within):
        content = hull_contents(job, geometry)
    return {"position": position[order], "fluid": fluid[order], "content": content}


def _place_fluids(job, geometry, share, moved):
    """Fluid particles with ids in a range."""
    positions, fluids = [np.empty((0, 3))], [np.empty(0, np.int8)]
    before = share.start if _all_filled(job, geometry) else 0
    for position, fluid in _chunks(job, geometry, moved, before) if len(share) else ():
        part = slice(max(share.start - before, 0), max(share.stop - before, 0))
        positions.append(position[part])
        fluids.append(fluid[part])
        before += len(fluid)
        if before >= share.stop:
            break
    return {"position": np.concatenate(positions), "fluid": np.concatenate(fluids)}


def _filled_volume(job, geometry, number, count):
    """Volume that a liquid fills at the start, m3 (m2 in 2D)."""
    fluid = job.fluids[number]
    if geometry.hull is not None:
        return count * _site_volume(job, geometry, number)
    low, high = (np.array([getattr(axis, end) for axis in geometry.axes]) for end in ("low", "high"))
    if geometry.dimension == 2:
        low[1], high[1] = -0.5, 0.5
    if fluid.region is None:
        if any(other.region for other in job.fluids):  # they may displace a part of the layer
            return count * geometry.spacing**geometry.dimension
        low[2] = sum(depth or 0.0 for depth in job.depths[:number])
        high[2] = low[2] + job.depths[number]
        return _volume_outside(low, high, geometry.walls.solids)
    low, high = _corners(geometry, fluid.region)
    sphere = fluid.region.disc or fluid.region.ball
    if not sphere:
        return _volume_outside(low, high, geometry.walls.solids)
    whole = np.prod(high - low)
    if _volume_outside(low, high, geometry.walls.solids) < whole:
        # what a baffle cuts out of a ball has no simple volume
        return count * geometry.spacing**geometry.dimension
    return _ball(geometry, sphere.radius)


def _site_volume(job, geometry, number):
    """Volume that a particle of a liquid in a hull stands for, m3 (m2 in 2D)."""
    if job.depths[number] is None:
        return geometry.spacing**geometry.dimension
    layer = sum(depth is not None for depth in job.depths[:number])
    packed = geometry.arrangement
    share = packed.content[layer] / max(np.count_nonzero(packed.layer == layer), 1)
    return share if 0 in geometry.hull_axes else share * geometry.axes[0].step


def _volume_outside(low, high, boxes):
    """Volume of a box without the union of others."""
    boxes = np.clip(boxes, low, high)
    cuts = [np.unique(np.concatenate([[low[a], high[a]], boxes[:, :, a].ravel()])) for a in range(3)]
    free = np.ones([len(cut) - 1 for cut in cuts], bool)
    for box in boxes:
        first, last = (
            [int(np.searchsorted(cuts[a], corner[a])) for a in range(3)] for corner in box
        )
        free[tuple(slice(f, g) for f, g in zip(first, last, strict=True))] = False
    x, y, z = (np.diff(cut) for cut in cuts)
    return float(np.einsum("ijk,i,j,k", free.astype(float), x, y, z))


# ---- initial state


def initial_velocity(job, placement):
    """Velocity of the particles at the start, relative to a tank at rest.

    A standing wave starts flat: the elevation of a layer's top is A_n sin(omega t) cos(k x) with k = mode pi /
    length, so that the velocity is that of linear theory (`waves.velocity`) at the instant of its zero.

    Parameters
    ----------
    job : Job
    placement : Placement

    Returns
    -------
    (n, 3) float64, m/s
        0 for walls.

    Raises
    ------
    InputError
        A state file cannot be read.
    """
    velocity = np.zeros_like(placement.position)
    liquid = placement.kind == FLUID
    initial = job.initial
    if initial.kind == "standing_wave":
        velocity[liquid] = _standing_wave(job, placement.position[liquid], placement.fluid[liquid])
    elif initial.kind == "velocity":
        names = [fluid.name for fluid in job.fluids]
        chosen = liquid & (placement.fluid == names.index(initial.fluid))
        velocity[chosen] = three(np.array([initial.value]))
    elif initial.kind == "file":
        velocity[liquid] = read_state(job, placement.geometry)["velocity"][placement.id[liquid]]
    return velocity


def _standing_wave(job, position, fluid):
    k, omega, shape = standing_wave(job)
    speed = job.initial.amplitude * omega * shape
    velocity = np.zeros_like(position)
    velocity[:, 0], velocity[:, 2] = waves.velocity(
        waves.layers_of(job), k, speed, position[:, 0], position[:, 2], fluid
    )
    return velocity


def standing_wave(job):
    """Linear wave that a job starts with.

    Parameters
    ----------
    job : Job

    Returns
    -------
    k : float, rad/m
    omega : float, rad/s
    shape : (n,) float64
        Elevations of the layers' tops over the greatest of them.

    Raises
    ------
    InputError
        There is no such wave.
    """
    initial = job.initial
    k = initial.mode * np.pi / job.tank.length
    layers = waves.layers_of(job)
    if layers.free == 0:
        raise InputError("initial.kind", "a standing wave needs a boundary that moves; one liquid fills the tank")
    omega2, shape = waves.modes(layers, k)
    if initial.branch > len(omega2):
        most = len(omega2)
        raise InputError("initial.branch", f"got {initial.branch}, must be at most {most}, the boundaries that move")
    at = initial.branch - 1
    if omega2[at] <= 0.0:
        raise InputError("initial.kind", "a standing wave needs layers that are stable: the heavier ones below")
    return k, float(np.sqrt(omega2[at])), shape[:, at]
