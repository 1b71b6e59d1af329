"""What is legal in a job but looks wrong. Runs and `plan` say it before they start, run.log and run.json keep it.

Each function gives sentences that begin with the key and have the numbers that look wrong.
"""

import math

import numpy as np

from parmps.checks import TOLERANCE, total_depth
from parmps.motion import STANDARD_GRAVITY, Motion
from parmps.openings import narrow_openings
from parmps.records import read_motion_file
from parmps.stl import read_surface

LARGEST = 500.0
"""Length beyond which a tank looks wrong, m: longer than any ship."""
MUCH_ACCELERATION = 2.0
"""Acceleration of the tank, in that of gravity, beyond which it looks wrong: tanks that slosh have less than one."""
FEW_DEGREES, FEWER_DEGREES, LEAST_DEGREES = 1.0, 0.2, 0.005
"""Greatest angles that look like radians, where the particles do not resolve them and anyway; and the least, since
less would be no motion in radians either."""
UNRESOLVED = 0.1
"""Displacement of the tank's farthest corner, in spacings, that particles do not resolve."""
MUCH_SWING = 0.02
"""Overshoot of a spline, in the range of the record, that deserves a word."""


def cautions(job):
    """List what is legal in a job but looks wrong.

    Parameters
    ----------
    job : Job

    Returns
    -------
    list of str
    """
    return [
        *_tank_cautions(job),
        *_resolution_cautions(job),
        *_frequency_cautions(job),
        *_motion_cautions(job),
        *_record_cautions(job),
        *_value_cautions(job),
    ]


def _tank_cautions(job):
    if max(job.tank.size) > LARGEST:
        yield f"tank.size: {max(job.tank.size):g} m is longer than any tank; is it in mm?"
    if job.tank.shape == "stl":
        yield from (f"tank.surface: {remark}" for remark in read_surface(job.tank.surface).remarks)

    for key, what, width in narrow_openings(job):
        yield (
            f"{key}: {what} is {width:.4g} m wide or less, {width / job.spacing:.2g} spacings; below 2 spacings little "
            "or no liquid flows through"
        )


def _resolution_cautions(job):
    spacing = job.spacing
    for axis, side in enumerate(job.tank.size):
        if spacing > side:
            yield f"spacing: {spacing:g} m is larger than the tank's side of {side:g} m (tank.size[{axis}])"
    for number, thickness in enumerate(job.depths):
        depth = thickness or np.inf
        rows = depth / spacing
        if rows < 5:
            yield (
                f"fluids[{number}].depth: {depth:g} m at a spacing of {spacing:g} m is {rows:.1f} rows "
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
    particles = math.prod(side / spacing for side in sides) * total_depth(job) / spacing
    if particles > 1e9:
        yield f"spacing: {spacing:g} m means about {particles:.2g} particles"


def _frequency_cautions(job):
    depth = total_depth(job)
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
        if item.omega is not None and abs(item.omega - frequency1) <= 0.1 * frequency1:
            yield (
                f"motion[{number}].omega: {item.omega:g} rad/s is close to the first sloshing mode's "
                f"{frequency1:.3g} Hz and far from its {omega1:.3g} rad/s; if {item.omega:g} is in Hz, "
                f"write omega: {2 * math.pi * item.omega:.5g}"
            )


def _motion_cautions(job):
    """Displacements, turns and accelerations that no tank has as a rule."""
    longest = max(job.tank.size)
    for part in Motion(job.motion, job.gravity, job.dimension, job.tank).parts:
        item, key = job.motion[part.number], f"motion[{part.number}]"
        recorded = item.kind == "file"
        value = part.extremes(job.time.end)[0] if recorded else abs(part.law.amplitude)
        if part.centre is None and value > longest * (1 + TOLERANCE):
            place = f"{key}.path: a {part.kind} of {value:.4g} m" if recorded else f"{key}.amplitude: {value:.4g} m"
            yield f"{place} is more than the tank's longest side, {longest:g} m"
        angle, moved = math.degrees(value), value * part.arm
        few = FEW_DEGREES if moved < UNRESOLVED * job.spacing else FEWER_DEGREES
        if part.centre is not None and LEAST_DEGREES <= angle < few:
            place = f"{key}.path: a {part.kind} of" if recorded else f"{key}.amplitude_deg:"
            yield (
                f"{place} {angle:.3g} deg moves the tank's farthest corner by {moved * 1e3:.2g} mm, at a spacing of "
                f"{job.spacing * 1e3:g} mm; if it is in radians, {math.degrees(angle):.3g} deg are meant"
            )
        if _felt(part, job) > MUCH_ACCELERATION:
            yield _acceleration_caution(item, key, part, _felt(part, job))


def _acceleration_caution(item, key, part, felt):
    where = "the tank" if part.centre is None else "the tank's farthest corner"
    if item.kind == "file":
        units = "times in s and its values in m" if part.centre is None else "times in s and its angles in deg"
        return f"{key}.path: its {part.kind} accelerates {where} by {felt:.3g} g at most; are its {units}?"
    meant = ""
    if item.omega is not None and felt * math.radians(1.0) ** 2 < MUCH_ACCELERATION:
        meant = f"; if {item.omega:g} is in degrees per second, write omega: {math.radians(item.omega):.4g}"
    given = f"omega: {item.omega:g} rad/s" if item.period is None else f"period: {item.period:g} s"
    return f"{key}.{given} accelerates {where} by {felt:.3g} g at most{meant}"


def _record_cautions(job):
    """What a record does not tell of the motion."""
    for number, item in enumerate(job.motion):
        if item.kind != "file" or item.start is not None:
            continue
        time = read_motion_file(item.path, f"motion[{number}].path").time
        if time[0] > 1.5 * (time[1] - time[0]):
            yield (
                f"motion[{number}].path: the record begins at {time[0]:g} s, and the tank rests until then; "
                f"start: {time[0]:g} would begin the run there"
            )
    for part in Motion(job.motion, job.gravity, job.dimension, job.tank).parts:
        if job.motion[part.number].kind == "file":
            yield from _curve_cautions(part, job)


def _curve_cautions(part, job):
    key, unit, curve = f"motion[{part.number}].path", "m" if part.centre is None else "deg", part.law.curve
    if curve.swing is not None:
        at, value, low, high = curve.swing
        if max(value - high, low - value) > MUCH_SWING * np.ptp(curve.nodes.value):
            yield (
                f"{key}: a spline would swing to a {part.kind} of {value:.3g} {unit} at {at:.3g} s, between rows of "
                f"{low:g} and {high:g} {unit}; the curve stays between such rows, more of them would tell where it goes"
            )
    if curve.scatter:
        yield (
            f"{key}: its {part.kind} scatters by {curve.scatter:.2g} {unit} from row to row, more than its rounding "
            f"explains; the tank is given that, {_felt(part, job):.2g} g at most"
        )


def _felt(part, job):
    """Greatest acceleration of the tank by a part of its motion, in that of gravity."""
    return part.extremes(job.time.end)[3] / STANDARD_GRAVITY


def _value_cautions(job):
    for number, fluid in enumerate(job.fluids):
        if fluid.density < 50:
            yield f"fluids[{number}].density: {fluid.density:g} kg/m3 is no liquid's; is it in g/cm3?"
        if fluid.kinematic_viscosity > 0.1:
            yield (
                f"fluids[{number}].kinematic_viscosity: {fluid.kinematic_viscosity:g} m2/s is more than "
                "100 000 times that of water; is it in mm2/s?"
            )
    for number, probe in enumerate(job.probes):
        if probe.kind == "pressure" and probe.radius is not None and probe.radius < job.spacing * (1 - TOLERANCE):
            yield (
                f"probes[{number}].radius: {probe.radius:g} m is less than the spacing of {job.spacing:g} m; the "
                "pressure is averaged over at least one spacing"
            )
    for name in ("particles_every", "probes_every"):
        every = getattr(job.output, name)
        if every > job.time.end:
            yield f"output.{name}: {every:g} s is longer than the run of {job.time.end:g} s (time.end)"
