"""Checks that involve several keys of a job, and warnings about input that is legal but looks wrong."""

import math
import os

import numpy as np

from parmps.errors import InputError
from parmps.fields import nearest
from parmps.motion import read_motion_file

TOLERANCE = 1e-9  # relative; forgives the rounding of decimal input such as 0.1 + 0.2
OUT_OF_PLANE = ("sway", "yaw")


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
    _check_fluids(job)
    _check_initial(job)
    _check_interfaces(job)
    for number, item in enumerate(job.motion):
        _check_motion(job, item, f"motion[{number}]")
    _check_probes(job)


def _check_tank(job):
    tank = job.tank
    layout = "[length, height]" if job.dimension == 2 else "[length, width, height]"
    if len(tank.size) != job.dimension:
        raise InputError("tank.size", f"got {list(tank.size)}, must be {layout} in {job.dimension}D (m)")
    if tank.shape == "box":
        if tank.chamfer is not None:
            raise InputError("tank.chamfer", "a box has no chamfers; use shape: prism")
        return
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
    vertical = {"x": baffle.x, "bottom": baffle.bottom, "top": baffle.top}
    horizontal = {"z": baffle.z, "left": baffle.left, "right": baffle.right}
    given = [name for name, value in (vertical | horizontal).items() if value is not None]
    if sorted(given) not in (sorted(vertical), sorted(horizontal)):
        raise InputError(
            key,
            f"got {', '.join(given) or 'neither'}, must be x, bottom and top (vertical) or z, left and right",
        )
    half = baffle.thickness / 2
    if baffle.vertical:
        extents = {"x": (0, baffle.x - half, baffle.x + half), "bottom": (-1, baffle.bottom, baffle.top)}
    else:
        extents = {"z": (-1, baffle.z - half, baffle.z + half), "left": (0, baffle.left, baffle.right)}
    if baffle.width is not None:
        if job.dimension == 2:
            raise InputError(f"{key}.width", "a 2D tank has no width")
        extents["width"] = (1, *baffle.width)
    for name, (axis, low, high) in extents.items():
        side = job.tank.size[axis]
        if low >= high:
            raise InputError(f"{key}.{name}", f"got {low:g} m to {high:g} m, the first must be the lower")
        if low < -TOLERANCE * side or high > side * (1 + TOLERANCE):
            raise InputError(
                f"{key}.{name}",
                f"the baffle reaches from {low:g} m to {high:g} m, outside the tank's 0 m to {side:g} m",
            )


def _check_fluids(job):
    _check_unique([fluid.name for fluid in job.fluids], "fluids")
    for number, fluid in enumerate(job.fluids):
        key = f"fluids[{number}]"
        if (fluid.depth is None) == (fluid.region is None):
            raise InputError(f"{key}.depth", "each fluid must have either a depth or a region")
        if fluid.region is not None:
            _check_region(job, fluid.region, f"{key}.region")
    total = _total_depth(job)
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
        if any(fluid.depth is None for fluid in job.fluids):
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


def _check_motion(job, item, key):
    if job.dimension == 2 and item.kind in OUT_OF_PLANE:
        raise InputError(f"{key}.kind", f"got '{item.kind}', must be surge, heave, roll, pitch or file in 2D")
    if getattr(item, "centre", None) is not None:
        _check_components(job, item.centre, f"{key}.centre", "m")
    if item.kind != "file":
        return
    time, columns = read_motion_file(item.path, f"{key}.path")
    for kind in OUT_OF_PLANE:
        if job.dimension == 2 and np.any(columns.get(kind, 0.0)):
            raise InputError(f"{key}.path", f"{item.path}: column {kind} must be absent or zero in 2D")
    if job.time.end > time[-1] + TOLERANCE * job.time.end:
        raise InputError(
            "time.end",
            f"got {job.time.end:g} s, must be at most {time[-1]:g} s, where {item.path} ends ({key})",
        )


def _check_probes(job):
    _check_unique([probe.name for probe in job.probes], "probes")
    for number, probe in enumerate(job.probes):
        key = f"probes[{number}]"
        if probe.kind == "pressure":
            _check_inside(job, probe.at, f"{key}.at")
        elif probe.kind in ("elevation", "interface"):
            layout = "[x]" if job.dimension == 2 else "[x, y]"
            if len(probe.at) != job.dimension - 1:
                raise InputError(
                    f"{key}.at", f"got {list(probe.at)}, must be {layout} in {job.dimension}D (m)"
                )
            _check_within(probe.at, job.tank.size[:-1], f"{key}.at")
        if probe.kind == "interface":
            _check_pair(job, probe.between, f"{key}.between")
        elif probe.kind == "liquid":
            _check_fluid_name(job, probe.fluid, f"{key}.fluid")


def _check_unique(names, key):
    for number, name in enumerate(names):
        if name in names[:number]:
            raise InputError(f"{key}[{number}].name", f"'{name}' is taken; names must be unique")


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
    if job.tank.chamfer is None:
        return
    across, up = job.tank.size[-2:]
    to_side = min(point[-2], across - point[-2])
    for legs, to_edge in ((job.tank.chamfer.bottom, point[-1]), (job.tank.chamfer.top, up - point[-1])):
        if legs is not None and to_side / legs[0] + to_edge / legs[1] < 1 - TOLERANCE:
            raise InputError(key, f"got {list(point)} m, which lies outside the tank's chamfer")


def _total_depth(job):
    """Sum of the layers' depths, m."""
    return sum(fluid.depth or 0.0 for fluid in job.fluids)


def job_warnings(job):
    """List what is legal in a job but looks wrong.

    Parameters
    ----------
    job : Job

    Returns
    -------
    list of str
        One sentence each, with the key and the numbers that look wrong.
    """
    return [*_resolution_warnings(job), *_frequency_warnings(job), *_value_warnings(job)]


def _resolution_warnings(job):
    spacing = job.spacing
    for axis, side in enumerate(job.tank.size):
        if spacing > side:
            yield f"spacing: {spacing:g} m is larger than the tank's side of {side:g} m (tank.size[{axis}])"
    for number, fluid in enumerate(job.fluids):
        rows = (fluid.depth or np.inf) / spacing
        if rows < 5:
            yield (
                f"fluids[{number}].depth: {fluid.depth:g} m at a spacing of {spacing:g} m is {rows:.1f} rows "
                "of particles; at least 5 are needed to resolve a flow"
            )
    for number, baffle in enumerate(job.tank.baffles):
        if baffle.thickness < spacing * (1 - TOLERANCE):
            key = f"tank.baffles[{number}].thickness"
            yield (
                f"{key}: {baffle.thickness:g} m is less than the spacing of {spacing:g} m; the baffle is "
                "modelled as 1.1 spacings thick"
            )
    sides = job.tank.size[:-1]
    particles = math.prod(side / spacing for side in sides) * _total_depth(job) / spacing
    if particles > 1e9:
        yield f"spacing: {spacing:g} m means about {particles:.2g} particles"


def _frequency_warnings(job):
    depth = _total_depth(job)
    if depth == 0.0 or job.gravity == 0.0:
        return
    for number, item in enumerate(job.motion):
        if item.kind == "file":
            continue
        sideways = job.dimension == 3 and item.kind in ("sway", "roll")
        side = job.tank.size[1 if sideways else 0]
        wavenumber = math.pi / side
        omega1 = math.sqrt(job.gravity * wavenumber * math.tanh(wavenumber * depth))
        frequency1 = omega1 / (2 * math.pi)
        if abs(item.omega - frequency1) <= 0.1 * frequency1:
            yield (
                f"motion[{number}].omega: {item.omega:g} rad/s is close to the first sloshing mode's "
                f"{frequency1:.3g} Hz and far from its {omega1:.3g} rad/s; if {item.omega:g} is in Hz, "
                f"write omega: {2 * math.pi * item.omega:.5g}"
            )


def _value_warnings(job):
    for number, item in enumerate(job.motion):
        if item.kind in ("surge", "sway", "heave") and abs(item.amplitude) > max(job.tank.size):
            yield (
                f"motion[{number}].amplitude: {item.amplitude:g} m is more than the tank's longest side, "
                f"{max(job.tank.size):g} m"
            )
    for number, fluid in enumerate(job.fluids):
        if fluid.density < 50:
            yield f"fluids[{number}].density: {fluid.density:g} kg/m3 is no liquid's; is it in g/cm3?"
        if fluid.kinematic_viscosity > 0.1:
            yield (
                f"fluids[{number}].kinematic_viscosity: {fluid.kinematic_viscosity:g} m2/s is more than "
                "100 000 times that of water; is it in mm2/s?"
            )
    for name in ("particles_every", "probes_every"):
        every = getattr(job.output, name)
        if every > job.time.end:
            yield f"output.{name}: {every:g} s is longer than the run of {job.time.end:g} s (time.end)"
