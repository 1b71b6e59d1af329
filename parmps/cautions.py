"""What is legal in a job but looks wrong. Runs and `plan` say it before they start, run.log and run.json keep it.

Each function gives sentences that begin with the key and have the numbers that look wrong.
"""

import math

import numpy as np

from parmps.checks import TOLERANCE, total_depth


def cautions(job):
    """List what is legal in a job but looks wrong.

    Parameters
    ----------
    job : Job

    Returns
    -------
    list of str
    """
    return [*_resolution_cautions(job), *_frequency_cautions(job), *_value_cautions(job)]


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
        if abs(item.omega - frequency1) <= 0.1 * frequency1:
            yield (
                f"motion[{number}].omega: {item.omega:g} rad/s is close to the first sloshing mode's "
                f"{frequency1:.3g} Hz and far from its {omega1:.3g} rad/s; if {item.omega:g} is in Hz, "
                f"write omega: {2 * math.pi * item.omega:.5g}"
            )


def _value_cautions(job):
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
