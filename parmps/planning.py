"""What a job would take: particles, memory, time steps, and the stages that would run. Solves nothing."""

import math

import numpy as np

from parmps import waves
from parmps.kernels.weight import lattice
from parmps.liquids import Liquids
from parmps.motion import Motion
from parmps.particles import DUMMY, FIELDS, FLUID, WALL
from parmps.simulation import HALO_MARGIN, STEADY_STEP, VISCOUS_STEP, Work, wall_layers
from parmps.slabs import output_errors
from parmps.stages import make_plan
from parmps.tank import count_particles, place, standing_wave

PROGRAM_BYTES = 250e6
"""Memory of a rank without particles: Python, the compiled kernels and the libraries."""
ENTRY_BYTES = 12
"""Of an entry of the pressure matrix: its value and its column."""
HIERARCHY = 2.0
"""Matrices that the multigrid hierarchy keeps, in pressure matrices: a copy, and the coarser levels."""
SAMPLES = 2000
"""Times at which the motion is looked at."""


def plan_text(job, domain):
    """Describe what a run of a job would take and do.

    Parameters
    ----------
    job : Job
    domain : Domain
        Its number of ranks is planned for.

    Returns
    -------
    str
        Several lines, for people.
    """
    counts, spacing = count_particles(job, job.scheme.wall, wall_layers(job.scheme))
    lines = [f"{job.title or 'untitled job'}: {job.dimension}D, {domain.size} rank(s), scheme {job.scheme.preset}"]
    lines += ["", "Particles", *_particle_lines(counts, spacing)]
    lines += ["", "Memory (an estimate)", *_memory_lines(job, counts, domain.size)]
    lines += ["", "Time steps (an estimate)", *_step_lines(job, spacing)]
    lines += ["", "Stages of a step", *_stage_lines(make_plan(job, domain.size))]
    return "\n".join(lines)


def _table(rows):
    """Lines of a table, its columns aligned."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return ["  " + "  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows]


# Particles and memory


def _particle_lines(counts, spacing):
    rows = [(name, f"{counts[name]:>12}") for name in ("fluid", "wall", "dummy", "total")]
    return [*_table(rows), f"  spacing {spacing * 1e3:.6g} mm, as it fits the tank"]


def memory_estimate(job, counts, ranks):
    """Estimate the memory of a rank that has its even share of the particles.

    Parameters
    ----------
    job : Job
    counts : dict of str to int
        As in `count_particles`.
    ranks : int

    Returns
    -------
    dict of str to float
        Bytes, by what takes them.
    """
    scheme, dimension = job.scheme, job.dimension
    owned = counts["total"] / ranks
    liquid = counts["fluid"] / ranks
    rows = liquid + counts["wall"] / ranks
    reach = max(scheme.radius, scheme.laplacian_radius)
    wide = scheme.volume_radius if scheme.volume_time is not None else 0.0
    # A rank's share as a square or cube, whose sides all have other ranks behind them: the most there can be.
    side = owned ** (1.0 / dimension)
    halo = ((side + 2.0 * (max(reach, wide) + HALO_MARGIN)) ** dimension - owned) if ranks > 1 else 0.0
    particle = sum(np.dtype(kind).itemsize * math.prod(shape) for kind, shape in FIELDS.values())
    pairs = rows * lattice(dimension, reach).neighbours
    # Volume drift, which every run reports at its end, needs the wide lists even where the scheme does not.
    wide_pairs = liquid * lattice(dimension, scheme.volume_radius).neighbours
    entries = pairs + rows
    per_row, per_particle = _work_bytes(Liquids(job))
    return {
        "program": PROGRAM_BYTES,
        # the particles, and the copy of the last good state
        "particles": particle * (2.0 * owned + halo),
        "fields of a step": per_row * rows + per_particle * (owned + halo),
        "neighbour lists": 4.0 * (pairs + wide_pairs),
        "pressure matrix": ENTRY_BYTES * entries,
        "multigrid hierarchy": HIERARCHY * ENTRY_BYTES * entries,
    }


def _work_bytes(liquids):
    """Bytes a row and a particle of the arrays that live for one step."""
    size = []
    for rows, count in ((0, 0), (1, 0), (0, 1)):
        work = Work(rows, count, liquids)
        arrays = [*vars(work).values(), *(vars(work.near_interface).values() if work.near_interface else ())]
        size.append(sum(array.nbytes for array in arrays if isinstance(array, np.ndarray)))
    return size[1] - size[0], size[2] - size[0]


def _memory_lines(job, counts, ranks):
    parts = memory_estimate(job, counts, ranks)
    each = sum(parts.values())
    rows = [(name, _bytes(size)) for name, size in parts.items()]
    rows += [("a rank", _bytes(each)), (f"all {ranks} rank(s)", _bytes(ranks * each))]
    reach = max(job.scheme.radius, job.scheme.laplacian_radius)
    near, far = (lattice(job.dimension, r).neighbours for r in (reach, job.scheme.volume_radius))
    return [
        *_table(rows),
        f"  from the sizes of all fields, {near} neighbours within {reach:g} l0 and {far} within "
        f"{job.scheme.volume_radius:g} l0 on the lattice,",
        "  a square or cube of particles a rank, and a hierarchy that doubles the matrix' memory twice",
    ]


def _bytes(size):
    return f"{size / 1e6:>12.1f} MB"


# Time steps


def step_estimate(job, spacing):
    """Estimate the time step at rest, at the speed of the motion, and in violent flow.

    Parameters
    ----------
    job : Job
    spacing : float
        l0, m.

    Returns
    -------
    list of (str, float, float, str)
        State of the flow, its speed (m/s), the step (s) and the bound that governs it.
    """
    force, tank_speed = _motion_extremes(job)
    depth = sum(fluid.depth or job.tank.height for fluid in job.fluids)
    wave = math.sqrt(job.gravity * min(depth, job.tank.height))
    states = [("at rest", 0.0)]
    speed = max(tank_speed, _initial_speed(job))
    if speed > 0.0:
        states.append(("at the speed of the motion or the initial state", speed))
    if wave > speed:
        states.append(("violent, sqrt(g h)", wave))
    out = []
    for name, value in states:
        step, bound = _bound(job, spacing, force, value)
        out.append((name, value, step, bound))
    return out


def _bound(job, spacing, force, speed):
    """Step and the bound that governs it; the bounds are those of `Simulation.choose_step`."""
    control, viscosity = job.time, Liquids(job).viscous_rate
    bounds = [(job.output.probes_every, "output.probes_every")]
    if control.max_step is not None:
        bounds.append((control.max_step, "time.max_step"))
    if speed > 0.0:
        bounds.append((control.cfl * spacing / speed, f"cfl: {control.cfl:g} l0/u"))
    if force > 0.0:
        bounds.append((STEADY_STEP * math.sqrt(spacing / force), f"body force: {STEADY_STEP:g} sqrt(l0/f)"))
    plan = make_plan(job, 1)
    if any(stage.name == "viscosity" for stage in (*plan.solve, *plan.move)):
        bounds.append((VISCOUS_STEP * spacing**2 / viscosity, f"viscosity: {VISCOUS_STEP:g} l0^2/nu"))
    step, bound = min(bounds)
    every = job.output.probes_every  # reached in a whole number of steps
    return every / math.ceil(every / step * (1.0 - 1e-9)), bound


def _motion_extremes(job):
    """Greatest uniform body force (m/s2) and greatest speed of the tank's corners (m/s) during the run."""
    motion = Motion(job.motion, job.gravity, job.dimension, job.tank)
    if not motion.moves:
        return job.gravity, 0.0
    size = job.tank.size if job.dimension == 3 else (job.tank.length, 0.0, job.tank.height)
    corners = np.stack(np.meshgrid(*[(0.0, side) for side in size]), axis=-1).reshape(-1, 3)
    force = speed = 0.0
    for t in np.linspace(0.0, job.time.end, SAMPLES):
        frame = motion.at(t)
        force = max(force, np.linalg.norm(frame.force))
        speed = max(speed, np.linalg.norm(frame.velocity + np.cross(frame.omega, corners), axis=1).max())
    return float(force), float(speed)


def _initial_speed(job):
    """Speed that the initial state gives the liquid, m/s; a file's is not looked at."""
    initial = job.initial
    if initial.kind == "velocity":
        return math.hypot(*initial.value)
    if initial.kind == "standing_wave":
        k, omega, shape = standing_wave(job)
        layers = waves.layers_of(job)
        top = np.cumsum(layers.depth)
        bottom, layer = top - layers.depth, np.arange(len(top))
        speed = initial.amplitude * omega * shape
        # greatest at a boundary of a layer, at the wall or between two
        x = np.repeat([0.0, 0.5 * math.pi / k], 2 * len(top))
        z, layer = np.tile(np.concatenate([bottom, top]), 2), np.tile(layer, 4)
        return float(np.abs(waves.velocity(layers, k, speed, x, z, layer)).max())
    return 0.0


def _step_lines(job, spacing):
    rows = [("flow", "speed", "step", "steps in all", "governed by")]
    for name, speed, step, bound in step_estimate(job, spacing):
        steps = f"{math.ceil(job.time.end / step * (1.0 - 1e-9))}"
        rows.append((name, f"{speed:.3g} m/s", f"{step * 1e3:.3g} ms", steps, bound))
    return [*_table(rows), f"  for {job.time.end:g} s; a whole number of steps reaches each probe sample"]


# Stages


def _stage_lines(plan):
    rows = [(str(number), stage.name, stage.reason) for number, stage in enumerate((*plan.solve, *plan.move), 1)]
    lines = _table(rows)
    if plan.solve:
        lines.insert(len(plan.solve), "  -- results are written here, where pressure and positions belong to one time")
    if plan.left_out:
        lines += ["Left out", *_table(plan.left_out)]
    return lines


# Picture


def draw_plan(job, path):
    """Draw the particles at the start; of a 3D tank, the layer in the middle of the width.

    Parameters
    ----------
    job : Job
    path : path-like
        Of the picture.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot
    from matplotlib.collections import EllipseCollection
    from matplotlib.patches import Patch, Rectangle

    start = place(job, job.scheme.wall, layers=wall_layers(job.scheme))
    l0 = start.spacing
    y = start.position[:, 1]
    middle = 0.5 * job.tank.size[1] if job.dimension == 3 else 0.0
    nearest = y[np.abs(y - middle).argmin()]
    layer = np.abs(y - nearest) < 0.4 * l0
    at, kind, fluid = start.position[layer][:, [0, 2]], start.kind[layer], start.fluid[layer]
    low, high = at.min(axis=0) - l0, at.max(axis=0) + l0
    figure = pyplot.figure(figsize=(9.0, 7.0 * (high[1] - low[1]) / (high[0] - low[0]) + 1.2), layout="constrained")
    axes = figure.add_subplot()
    groups = [(kind == DUMMY, "0.8", "dummy"), (kind == WALL, "0.45", "wall")]
    for number, liquid in enumerate(job.fluids):
        groups.append(((kind == FLUID) & (fluid == number), FLUID_COLOURS[number % len(FLUID_COLOURS)], liquid.name))
    for chosen, colour, _ in groups:
        size = np.full(chosen.sum(), l0)
        axes.add_collection(
            EllipseCollection(
                size,
                size,
                np.zeros(len(size)),
                units="xy",
                offsets=at[chosen],
                offset_transform=axes.transData,
                facecolors=colour,
                linewidths=0,
            )
        )
    axes.add_patch(Rectangle((0, 0), job.tank.length, job.tank.height, fill=False, linewidth=0.8))
    for solid in start.geometry.solids:
        if solid.low[1] <= middle <= solid.high[1] or job.dimension == 2:
            x, z = solid.low[0], solid.low[2]
            axes.add_patch(Rectangle((x, z), solid.high[0] - x, solid.high[2] - z, fill=False, linewidth=0.8))
    patches = [Patch(color=colour, label=label) for chosen, colour, label in groups if chosen.any()]
    axes.legend(handles=patches, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    axes.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x [m]", ylabel="z [m]")
    axes.set_title(job.title, loc="left")
    with output_errors(path):
        figure.savefig(path, dpi=150)
    pyplot.close(figure)


FLUID_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9")
"""Okabe and Ito's palette, distinguishable by the colour-blind."""
