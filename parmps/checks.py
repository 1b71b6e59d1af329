"""Checks that involve several keys of a job."""

import math
import os

import numpy as np
from scipy.optimize import brentq

from parmps.errors import InputError
from parmps.fields import nearest
from parmps.hull import build_hull
from parmps.level import upwards
from parmps.mesh import Mesh
from parmps.records import read_motion_file
from parmps.stl import read_surface

TOLERANCE = 1e-9  # relative; forgives the rounding of decimal input such as 0.1 + 0.2
MAX_POINTS = 1e12  # thousands of times what anyone has computed
COLUMN_POINTS = 401  # of a gauge's column, where a tank that is no box may have room for liquid
SHORTEST = 1e-9
"""Shortest interval of results in runs: times are rounded to 12 digits (`run.Schedule`), and steps lie between."""
UNITS = {"mm": 1e-3, "cm": 1e-2, "in": 0.0254, "ft": 0.3048}
"""Lengths in m that surfaces are drawn in by mistake."""
UPPER = {"bottom": "top", "left": "right"}
"""Keys of a baffle's ends."""


def check_job(job):
    """Refuse a job whose keys contradict each other.

    Parameters
    ----------
    job : Job

    Raises
    ------
    InputError
        Names the key, what was found and what is allowed.
    """
    _check_tank(job)
    for number, baffle in enumerate(job.tank.baffles):
        _check_baffle(job, baffle, f"tank.baffles[{number}]")
    _check_unique(["tank", *job.tank.baffle_names], "tank.baffles", first=-1)
    _check_fluids(job)
    _check_initial(job)
    _check_interfaces(job)
    for number, item in enumerate(job.motion):
        _check_motion(job, item, f"motion[{number}]")
    if job.initial.kind == "standing_wave" and upwards(job) is not None:
        raise InputError("initial.kind", "a standing wave needs a tank that is upright at the start (motion)")
    _check_probes(job)
    _check_scheme(job)
    _check_intervals(job)


def _check_intervals(job):
    shortest = SHORTEST * job.time.end
    for name in ("particles_every", "probes_every", "checkpoint_every"):
        every = getattr(job.output, name)
        if every < shortest:
            raise InputError(
                f"output.{name}",
                f"got {every:g} s, must be at least {shortest:g} s, {SHORTEST:g} of time.end: times have 12 digits",
            )


def _check_tank(job):
    tank = job.tank
    points = math.prod(side / job.spacing for side in tank.size)
    if points > MAX_POINTS:
        reason = f"{points:.2g} points of the lattice in the tank, must be at most {MAX_POINTS:.0e}"
        raise InputError("spacing", f"got {job.spacing:g} m, which means {reason}")
    layout = "[length, height]" if job.dimension == 2 else "[length, width, height]"
    if len(tank.size) != job.dimension:
        raise InputError("tank.size", f"got {list(tank.size)}, must be {layout} in {job.dimension}D (m)")
    for key, shape in (("chamfer", "prism"), ("surface", "stl")):
        if getattr(tank, key) is not None and tank.shape != shape:
            raise InputError(f"tank.{key}", f"a {tank.shape} has none; it belongs to shape: {shape}")
    if tank.shape in ("sphere", "stl") and job.dimension == 2:
        raise InputError("tank.shape", f"got '{tank.shape}', must be box, prism or cylinder in 2D")
    if tank.shape in ("cylinder", "sphere", "stl") and not tank.lid:
        raise InputError("tank.lid", f"got false, must be true: a {tank.shape} tank is closed")
    around = {"cylinder": tank.size[-2:], "sphere": tank.size}.get(tank.shape, tank.size[:1])
    if max(around) - min(around) > TOLERANCE * max(around):
        raise InputError(
            "tank.size",
            f"got {list(tank.size)}, the last {len(around)} must be equal, the diameter of the {tank.shape}",
        )
    if tank.shape == "prism":
        _check_chamfer(tank)
    elif tank.shape == "stl":
        _check_surface(tank)


def _check_surface(tank):
    if tank.surface is None:
        raise InputError("tank.surface", "missing; shape: stl needs the path of a surface")
    extent = read_surface(tank.surface).extents
    if np.abs(extent - tank.size).max() > 0.01 * max(tank.size):
        unit = next((name for name, long in UNITS.items() if np.allclose(extent * long, tank.size, rtol=0.01)), None)
        raise InputError(
            "tank.size",
            f"got {list(tank.size)}, but {tank.surface} is {' x '.join(f'{side:.4g}' for side in extent)} m large; "
            f"the file must be in m{f' and is in {unit}' if unit else ''}",
        )


def _check_chamfer(tank):
    if tank.chamfer is None or (tank.chamfer.bottom is None and tank.chamfer.top is None):
        raise InputError("tank.chamfer", "missing; a prism needs chamfers at its bottom, top or both")
    across = tank.size[-2]
    rise = 0.0
    for edge in ("bottom", "top"):
        legs = getattr(tank.chamfer, edge)
        if legs is None:
            continue
        rise += legs[1]
        if 2 * legs[0] > across * (1 + TOLERANCE):
            raise InputError(
                f"tank.chamfer.{edge}[0]",
                f"got {legs[0]:g} m, must be at most half of the tank's {across:g} m",
            )
    if rise > tank.height * (1 + TOLERANCE):
        raise InputError(
            "tank.chamfer",
            f"the chamfers' heights sum to {rise:g} m, must be at most the tank's {tank.height:g} m",
        )


def _check_baffle(job, baffle, key):
    names = ("x", "bottom", "top", "z", "left", "right", "ring")
    given = [name for name in names if getattr(baffle, name) is not None]
    if given not in (["x", "bottom", "top"], ["z", "left", "right"], ["x", "ring"], ["z", "ring"]):
        raise InputError(
            key,
            f"got {', '.join(given) or 'neither'}, must be x, bottom and top (vertical), z, left and right "
            "(horizontal), or x or z and ring",
        )
    half = baffle.thickness / 2
    if baffle.vertical:
        extents = {"x": (0, baffle.x - half, baffle.x + half), "bottom": (-1, baffle.bottom, baffle.top)}
    else:
        extents = {"z": (-1, baffle.z - half, baffle.z + half), "left": (0, baffle.left, baffle.right)}
    if baffle.ring is not None:
        _check_ring(job, baffle, key)
        extents = {name: extent for name, extent in extents.items() if extent[1] is not None}
    if baffle.width is not None:
        if job.dimension == 2:
            raise InputError(f"{key}.width", "a 2D tank has no width")
        extents["width"] = (1, *baffle.width)
    for name, (axis, low, high) in extents.items():
        side = job.tank.size[axis]
        if low >= high:
            raise InputError(f"{key}.{name}", f"got {low:g} m to {high:g} m, the first must be the lower")
        over = high > side * (1 + TOLERANCE)
        if low < -TOLERANCE * side or over:
            raise InputError(
                f"{key}.{UPPER.get(name, name) if over else name}",
                f"the baffle reaches from {low:g} m to {high:g} m, outside the tank's 0 m to {side:g} m",
            )


    if baffle.openings:
        _check_openings(job, baffle, key)


def _check_ring(job, baffle, key):
    if job.dimension == 2 or job.tank.shape not in ("box", "prism"):
        found = f"{job.dimension}D {job.tank.shape}"
        raise InputError(f"{key}.ring", f"needs a 3D tank of shape box or prism, not a {found}")
    if baffle.width is not None or baffle.openings:
        raise InputError(f"{key}.ring", "a ring goes all around the tank and has no width or openings")
    side = min(job.tank.size[1:] if baffle.vertical else job.tank.size[:2])
    if 2 * baffle.ring >= side:
        raise InputError(f"{key}.ring", f"got {baffle.ring:g} m, must be less than half of {side:g} m")


def _check_openings(job, baffle, key):
    if job.dimension == 2:
        raise InputError(f"{key}.openings", "a 2D plate has none; give the parts between them as baffles")
    across = baffle.width or (0.0, job.tank.size[1])
    plate = (across, (baffle.bottom, baffle.top)) if baffle.vertical else ((baffle.left, baffle.right), across)
    for number, corners in enumerate(baffle.openings):
        for low, high, (first, last) in zip(*corners, plate, strict=True):
            if low >= high:
                raise InputError(f"{key}.openings[{number}]", "the first corner must be the lower")
            if low <= first or high >= last:
                raise InputError(
                    f"{key}.openings[{number}]",
                    f"reaches from {low:g} m to {high:g} m, must lie inside the plate's {first:g} m to {last:g} m",
                )


def _check_fluids(job):
    _check_unique([fluid.name for fluid in job.fluids], "fluids")
    for number, fluid in enumerate(job.fluids):
        key = f"fluids[{number}]"
        if sum(value is not None for value in (fluid.depth, fluid.fill, fluid.region)) != 1:
            raise InputError(f"{key}.depth", "each fluid must have exactly one of depth, fill and region")
        if fluid.region is not None:
            _check_region(job, fluid.region, f"{key}.region")
    shares = sum(fluid.fill or 0.0 for fluid in job.fluids)
    if shares > 1.0 + TOLERANCE:
        raise InputError("fluids", f"overfull: fill sums to {shares:g}, must be at most 1")
    total = total_depth(job)
    if total > job.tank.height * (1 + TOLERANCE):
        raise InputError(
            "fluids",
            f"overfull: depths sum to {total:g} m, must be at most the tank's height {job.tank.height:g} m",
        )


def _check_region(job, region, key):
    shapes = [name for name in ("box", "disc", "ball") if getattr(region, name) is not None]
    allowed = ("box", "disc") if job.dimension == 2 else ("box", "ball")
    if len(shapes) != 1 or shapes[0] not in allowed:
        found = ", ".join(shapes) or "none"
        raise InputError(
            key, f"got {found}, must be exactly one of {' and '.join(allowed)} in {job.dimension}D"
        )
    name = shapes[0]
    if name == "box":
        low, high = region.box
        for corner, point in enumerate(region.box):
            _check_in_box(job, point, f"{key}.box[{corner}]")
        if any(a >= b for a, b in zip(low, high, strict=True)):
            raise InputError(
                f"{key}.box", f"got {list(low)} to {list(high)} m, the first corner must be the lower"
            )
        return
    sphere = getattr(region, name)
    _check_in_box(job, sphere.centre, f"{key}.{name}.centre")
    reach = min(min(x, side - x) for x, side in zip(sphere.centre, job.tank.size, strict=True))
    if sphere.radius > reach + TOLERANCE * max(job.tank.size):
        raise InputError(
            f"{key}.{name}.radius",
            f"got {sphere.radius:g} m, must be at most {reach:g} m to lie inside the tank",
        )


def _check_initial(job):
    initial = job.initial
    if initial.kind == "standing_wave":
        if job.gravity == 0.0:
            raise InputError("initial.kind", "a standing wave needs gravity")
        if any(depth is None for depth in job.depths):
            raise InputError("initial.kind", "a standing wave needs fluids given by their depth")
    elif initial.kind == "velocity":
        _check_fluid_name(job, initial.fluid, "initial.fluid")
        _check_components(job, initial.value, "initial.value", "m/s")
    elif initial.kind == "file" and not os.path.isfile(initial.path):
        raise InputError("initial.path", f"{initial.path}: no such file")


def _check_interfaces(job):
    pairs = []
    for number, interface in enumerate(job.interfaces):
        key = f"interfaces[{number}].between"
        _check_pair(job, interface.between, key)
        if set(interface.between) in pairs:
            raise InputError(key, f"the interface between {' and '.join(interface.between)} is given twice")
        pairs.append(set(interface.between))
        missing = "surface_tension > 0" if interface.surface_tension == 0.0 else "scheme.position: start"
        if interface.wetting_angle != 90.0 and (interface.surface_tension == 0.0 or job.scheme.position != "start"):
            raise InputError(
                f"interfaces[{number}].wetting_angle",
                f"got {interface.wetting_angle:g}, must be 90 (deg) without {missing}",
            )


def _check_motion(job, item, key):
    if job.dimension == 2 and item.kind == "yaw":
        raise InputError(f"{key}.kind", "got 'yaw', must be surge, sway, heave, roll, pitch or file in 2D")
    if getattr(item, "centre", None) is not None:
        _check_components(job, item.centre, f"{key}.centre", "m")
    if item.kind == "file":
        _check_record(job, item, key)
    elif (item.omega is None) == (item.period is None):
        found = "neither" if item.omega is None else "both"
        raise InputError(f"{key}.omega", f"got {found}, must be exactly one of omega (rad/s) and period (s)")


def _check_record(job, item, key):
    table = read_motion_file(item.path, f"{key}.path")
    first, last = table.time[0], table.time[-1]
    if item.start is None and first >= job.time.end:
        raise InputError(
            f"{key}.start",
            f"missing; {item.path} begins at {first:g} s, after the run's end at {job.time.end:g} s (time.end): the "
            f"tank would stand still; start: {first:g} begins the run there",
        )
    if item.start is not None and not first <= item.start < last:
        raise InputError(
            f"{key}.start", f"got {item.start:g} s, must be within {item.path}, from {first:g} s to before {last:g} s"
        )
    start = item.start or 0.0
    if job.time.end > last - start + TOLERANCE * max(job.time.end, abs(start)):
        raise InputError(
            "time.end",
            f"got {job.time.end:g} s, must be at most {last - start:g} s, where {item.path} ends ({key}); what comes "
            "after is not known",
        )
    if job.dimension == 2:
        _check_plane(table, item, key)


def _check_plane(table, item, key):
    """Refuse a record of more than one plane in 2D."""
    moving = [kind for kind, values in table.columns.items() if np.any(values)]
    if "yaw" in moving:
        raise InputError(f"{key}.path", f"{item.path}: column yaw must be absent or zero in 2D")
    pairs = [("surge", "sway"), ("roll", "pitch")]
    if table.outer:  # a turn about x belongs to the plane y-z
        pairs += [("surge", "roll"), ("sway", "pitch")]
    for pair in pairs:
        if set(pair) <= set(moving):
            raise InputError(
                f"{key}.path", f"{item.path}: one of the columns {' and '.join(pair)} must be absent or zero in 2D"
            )


def _check_probes(job):
    _check_unique([probe.name for probe in job.probes], "probes")
    for number, probe in enumerate(job.probes):
        key = f"probes[{number}]"
        if probe.kind == "pressure":
            _check_inside(job, probe.at, f"{key}.at")
            _check_outside_baffles(job, probe.at, f"{key}.at")
        elif probe.kind == "panel":
            _check_panel(job, probe.corners, f"{key}.corners")
        elif probe.kind == "force" and probe.about is not None:
            _check_components(job, probe.about, f"{key}.about", "m")
        elif probe.kind in ("elevation", "interface"):
            layout = "[x]" if job.dimension == 2 else "[x, y]"
            if len(probe.at) != job.dimension - 1:
                raise InputError(
                    f"{key}.at", f"got {list(probe.at)}, must be {layout} in {job.dimension}D (m)"
                )
            _check_within(probe.at, job.tank.size[:-1], f"{key}.at")
            if probe.fixed_to == "tank":
                _check_column(job, probe.at, f"{key}.at")
        if probe.kind in ("pressure", "panel"):
            _check_unique([f"{probe.name}.max", *(other.name for other in job.probes)], "probes", first=-1)
        elif probe.kind == "interface":
            _check_pair(job, probe.between, f"{key}.between")
        elif probe.kind == "liquid":
            _check_fluid_name(job, probe.fluid, f"{key}.fluid")


def _check_scheme(job):
    """Refuse settings that contradict each other; where the limits are, jobs/extremes shows."""
    scheme = job.scheme
    limit = scheme.radius + 1.0
    if scheme.surface == "ghost" and scheme.laplacian_radius > limit * (1 + TOLERANCE):
        raise InputError(
            "scheme.laplacian_radius",
            f"got {scheme.laplacian_radius:g} l0, must be at most {limit:g} l0, one more than scheme.radius, with "
            "surface: ghost, since only the particles that scheme.radius finds in the surface are given neighbours "
            "above it",
        )
    if len(job.fluids) > 1 and scheme.position == "start" and scheme.gradient != "corrected":
        raise InputError(
            "scheme.gradient",
            f"got '{scheme.gradient}', must be corrected with several fluids and position: start, whose densities are "
            "sharp",
        )
    _check_gradient(scheme)
    wanted = {"position": "start", "gradient": "corrected", "surface": "ghost"}
    missing = ", ".join(f"scheme.{key}: {value}" for key, value in wanted.items() if getattr(scheme, key) != value)
    for number, fluid in enumerate(job.fluids):
        if fluid.surface_tension > 0.0 and missing:
            raise InputError(
                f"fluids[{number}].surface_tension", f"got {fluid.surface_tension:g}, must be 0 without {missing}"
            )


def _check_gradient(scheme):
    """Refuse a pressure gradient where it feeds energy to liquid at rest, as measured beside a baffle.

    P_j + P_i pushes particles apart even where the pressure is uniform, and with the pressure of position: start, which
    may be suction, blows up in 20 ms. The corrected gradient pushes nothing apart: with position: moved it gains 20 to
    30 % of energy in 0.6 s, and where the pressure of the surface's row is zero (dirichlet) 7 %, or blows up.
    """
    wanted = {"sum": {"position": "moved"}, "corrected": {"position": "start", "surface": "ghost"}}
    missing = [
        f"scheme.{key}: {value}"
        for key, value in wanted.get(scheme.gradient, {}).items()
        if getattr(scheme, key) != value
    ]
    if missing:
        raise InputError(
            "scheme.gradient",
            f"got '{scheme.gradient}' (given, or by the preset), which needs {' and '.join(missing)}: "
            "liquid at rest gains energy without",
        )


def _check_unique(names, key, first=0):
    """Refuse a name that is there twice; the first one has the number given."""
    for number, name in enumerate(names):
        if name in names[:number]:
            raise InputError(f"{key}[{number + first}].name", f"'{name}' is taken; names must be unique")


def _check_fluid_name(job, name, key):
    names = [fluid.name for fluid in job.fluids]
    if name not in names:
        raise InputError(key, f"got '{name}', no such fluid{nearest(name, names)}")


def _check_pair(job, between, key):
    for number, name in enumerate(between):
        _check_fluid_name(job, name, f"{key}[{number}]")
    if between[0] == between[1]:
        raise InputError(key, f"got '{between[0]}' twice, must be two different fluids")


def _check_components(job, vector, key, unit):
    if len(vector) != job.dimension:
        layout = "[x, z]" if job.dimension == 2 else "[x, y, z]"
        raise InputError(key, f"got {list(vector)}, must be {layout} in {job.dimension}D ({unit})")


def _check_within(point, sides, key):
    for axis, (x, side) in enumerate(zip(point, sides, strict=True)):
        if not -TOLERANCE * side <= x <= side * (1 + TOLERANCE):
            raise InputError(f"{key}[{axis}]", f"got {x:g}, must be inside the tank: 0 to {side:g} (m)")


def _check_in_box(job, point, key):
    """Refuse a point outside the tank's outer box."""
    _check_components(job, point, key, "m")
    _check_within(point, job.tank.size, key)


def _check_inside(job, point, key):
    """Refuse a point outside the tank, chamfers included."""
    _check_in_box(job, point, key)
    hull = build_hull(job.tank, job.spacing)
    if hull is None:
        return
    at = np.array([point[-hull.dimension :]])
    # a few points do not need the samples, which may be larger than the memory at this spacing
    gap = hull.exact_distance(at)[0] if isinstance(hull, Mesh) else hull.distance(at)[0][0]
    if gap < -hull.rounding:
        raise InputError(key, f"got {list(point)} m, which lies outside the tank's {job.tank.shape}")


def _check_outside_baffles(job, point, key):
    """Refuse a point inside a baffle, which belongs to none of its faces."""
    number = _baffle_at(job, point)
    if number is not None:
        baffle = job.tank.baffles[number]
        centre = baffle.x if baffle.vertical else baffle.z
        raise InputError(
            key,
            f"got {list(point)} m, which lies inside tank.baffles[{number}]; its faces are at "
            f"{centre - baffle.thickness / 2:g} m and {centre + baffle.thickness / 2:g} m",
        )


def _check_panel(job, corners, key):
    """Refuse corners that make no rectangle across one axis."""
    for number, corner in enumerate(corners):
        _check_in_box(job, corner, f"{key}[{number}]")
    equal = [axis for axis, (a, b) in enumerate(zip(*corners, strict=True)) if a == b]
    if len(equal) != 1:
        found = [list(corner) for corner in corners]
        raise InputError(key, f"got {found} m, must be equal along one axis and different along the others")


def _check_column(job, at, key):
    """Refuse a gauge whose column has no room for liquid: outside a round tank, or inside baffles from floor to lid."""
    low, high = 0.0, job.tank.height
    hull = build_hull(job.tank, job.spacing)
    if hull is not None:
        heights = np.linspace(low, high, COLUMN_POINTS)
        line = np.column_stack([np.tile(at, (COLUMN_POINTS, 1)), heights])[:, -hull.dimension :]
        inside = heights[hull.distance(line)[0] >= -hull.rounding]
        low, high = (inside[0], inside[-1]) if len(inside) else (0.0, 0.0)
        if high - low < job.spacing:
            room = f"{high - low:.3g} m high, less than the spacing of {job.spacing:g} m"
            raise InputError(key, f"got {list(at)} m, where the tank's {job.tank.shape} is {room}")
    ends = {low, high}
    for baffle in job.tank.baffles:
        half = baffle.thickness / 2
        levels = [baffle.bottom, baffle.top] if baffle.vertical else [baffle.z - half, baffle.z + half]
        if baffle.vertical:
            levels = [0.0, baffle.ring, job.tank.height - baffle.ring] if baffle.ring is not None else levels
            levels += [corner[-1] for opening in baffle.openings for corner in opening]
        ends.update(level for level in levels if low < level < high)
    ends = sorted(ends)
    parts = [(b - a, _baffle_at(job, (*at, 0.5 * (a + b)))) for a, b in zip(ends, ends[1:], strict=False)]
    if any(number is not None for _, number in parts) and sum(d for d, n in parts if n is None) < job.spacing:
        names = ", ".join(f"tank.baffles[{n}]" for n in dict.fromkeys(n for _, n in parts) if n is not None)
        raise InputError(key, f"got {list(at)} m, which lies inside {names} from the tank's floor to its lid")


def _baffle_at(job, point):
    """Number of the first baffle that a point lies inside; None outside of all."""
    size = job.tank.size
    for number, baffle in enumerate(job.tank.baffles):
        across = 0 if baffle.vertical else job.dimension - 1
        centre = baffle.x if baffle.vertical else baffle.z
        if baffle.thickness / 2 - abs(point[across] - centre) <= TOLERANCE * size[across]:
            continue
        others = [axis for axis in range(job.dimension) if axis != across]
        if baffle.ring is not None:
            within = any(min(point[a], size[a] - point[a]) < baffle.ring * (1 - TOLERANCE) for a in others)
        else:
            extents = {1: baffle.width or (0.0, size[1])}
            if baffle.vertical:
                extents[job.dimension - 1] = (baffle.bottom, baffle.top)
            else:
                extents[0] = (baffle.left, baffle.right)
            within = all(_inside(point[a], extents[a], size[a]) for a in others) and not any(
                all(low[k] <= point[a] <= high[k] for k, a in enumerate(others)) for low, high in baffle.openings
            )
        if within:
            return number
    return None


def _inside(x, extent, side):
    """Whether a coordinate is between the ends of a plate, or at one that is at a wall."""
    low, high = extent
    near = TOLERANCE * side
    return (x > low + near or low <= near) and (x < high - near or high >= side - near)


def layer_depths(job):
    """Find the thickness of the layers of liquid, those given by their share of the volume included.

    Parameters
    ----------
    job : Job

    Returns
    -------
    tuple of float or None
        m; None for a liquid that fills a region.
    """
    hull = build_hull(job.tank, job.spacing)
    height = job.tank.height
    depths, level = [], 0.0
    for fluid in job.fluids:
        depth = fluid.depth
        if fluid.fill is not None and hull is None:
            depth = fluid.fill * height
        elif fluid.fill is not None:
            wanted = hull.content_below(level) + fluid.fill * hull.content_below(height)
            if wanted >= hull.content_below(height) * (1.0 - TOLERANCE):
                depth = height - level
            else:
                depth = brentq(lambda z, wanted=wanted: hull.content_below(z) - wanted, level, height) - level
        depths.append(depth)
        level += depth or 0.0
    return tuple(depths)


def total_depth(job):
    """Find how deep the layers of liquid are together.

    Parameters
    ----------
    job : Job

    Returns
    -------
    float
        m; regions do not count.
    """
    return sum(depth or 0.0 for depth in job.depths)
