"""What a job would take: particles, memory, time steps, and the stages that would run. Solves nothing."""

import math

import numpy as np

from parmps import waves
from parmps.errors import InputError
from parmps.expectation import changed_settings, error_class, expected_cost, expected_errors, read_table
from parmps.hull import build_hull, hull_axes
from parmps.kernels.weight import lattice
from parmps.level import starts_level
from parmps.liquids import Liquids
from parmps.machine import available_memory, free_disk
from parmps.motion import STANDARD_GRAVITY, Motion
from parmps.output import FRAME_BYTES, POINT_BYTES
from parmps.particles import PARTICLE_BYTES
from parmps.simulation import (
    CAPILLARY_STEP,
    HALO_MARGIN,
    IMPLICIT_GAIN,
    VISCOUS_STEP,
    WAVE_STEP,
    Work,
    flow_limits,
    wall_layers,
)
from parmps.stages import make_plan
from parmps.tank import count_particles, standing_wave

EXACT_CELLS, ROUND_CELLS = 1e7, 1e6
"""Points of the lattice in the tank up to which particles are counted: beyond, that takes too long. Tanks that are not
straight along their length have fewer, since all their particles are placed for it."""
PROGRAM_BYTES = 258e6
"""Memory of a rank without particles, as measured: Python, the compiled kernels and the libraries."""
ENTRY_BYTES = 12
"""Of an entry of the pressure matrix: its value and its column."""
HIERARCHY = 3.0
"""Memory of the multigrid hierarchy while it is set up, in pressure matrices: the coarser levels, the solver's vectors,
and what their making takes for a moment (graph, prolongation, triple product). Measured as what the peak has beside the
rest: with it the sum is within 3 % of the 3D tank's at 18, 12 and 6 mm, 51 000 to 994 000 particles, on one and two
ranks."""
CELL_BYTES, PAIRED_BYTES, WALL_BYTES = 250.0, 16e3, 400.0
"""Memory while particles are placed, which every rank takes whole: of a point of the lattice in a tank that no lattice
fits, of a wall particle of such a tank in 3D, whose neighbours are moved until they are even, and of any wall particle.
Above what was measured for balls and cubes of 30 and 50 spacings, by a tenth to three tenths."""
SIGNAL_BYTES, TIME_BYTES = 14, 20
"""Of a number and of a time in probes.csv."""
REFUSED = "more than there is: a run on this machine alone is refused without --force"
SAMPLES = 400
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
    layers, most = wall_layers(job.scheme), ROUND_CELLS if _placed_whole(job) else EXACT_CELLS
    exact = math.prod(job.tank.size) / job.spacing**job.dimension <= most
    counts, spacing = count_particles(job, job.scheme.wall, layers) if exact else estimate_particles(job, layers)
    lines = [f"{job.title or 'untitled job'}: {job.dimension}D, {domain.size} rank(s), scheme {job.scheme.preset}"]
    lines += ["", "Particles" if exact else "Particles (an estimate)", *_particle_lines(counts, spacing, exact)]
    lines += ["", "Memory (an estimate)", *_memory_lines(job, counts, domain.size)]
    lines += ["", "Disk (an estimate)", *_disk_lines(job, counts)]
    if job.motion:
        lines += ["", "Motion, at most", *_motion_lines(job)]
    steps = step_estimate(job, spacing)
    lines += ["", "Time steps (an estimate)", *_step_lines(job, steps)]
    lines += ["", "Accuracy and cost (by the trade study)", *_trade_lines(job, counts, spacing, steps)]
    lines += ["", "Stages of a step", *_stage_lines(make_plan(job, domain.size))]
    return "\n".join(lines)


def _placed_whole(job):
    """Whether all particles are placed to count them: the tank is tilted, or no box and straight along no axis."""
    hull = build_hull(job.tank, job.spacing)
    return starts_level(job) or (hull is not None and hull.dimension == job.dimension)


def _table(rows):
    """Lines of a table, its columns aligned."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return ["  " + "  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows]


# Particles and memory


def _particle_lines(counts, spacing, exact):
    rows = [(name, f"{counts[name]:>12}") for name in ("fluid", "wall", "dummy", "total")]
    how = "as it fits the tank" if exact else "of the job"
    return [*_table(rows), f"  spacing {spacing * 1e3:.6g} mm, {how}"]


def estimate_particles(job, layers):
    """Estimate the particles of a job whose tank is too large to place them for counting.

    Parameters
    ----------
    job : Job
    layers : int
        Wall layer plus dummy layers.

    Returns
    -------
    dict of str to int
        As in `count_particles`: the volume of the liquid and the surface of tank and baffles, in spacings.
        The walls are taken for those of a box, and baffles take nothing from the liquid.
    float
        Spacing of the job, m.
    """
    sides = np.array(job.tank.size) / job.spacing
    layered = _content_below(job, sum(depth or 0.0 for depth in job.depths))
    regions = sum(_volume(job, fluid.region) for fluid in job.fluids if fluid.region is not None)
    liquid = (layered + regions) / job.spacing**job.dimension
    surface = 2.0 * sum(np.prod(np.delete(sides, axis)) for axis in range(len(sides)))
    for baffle in job.tank.baffles:
        surface += 2.0 * _baffle_face(job, baffle) / job.spacing ** (job.dimension - 1)
    counts = {"fluid": round(liquid), "wall": round(surface), "dummy": round((layers - 1) * surface)}
    return {**counts, "total": sum(counts.values())}, job.spacing


def _baffle_face(job, baffle):
    """Area of one side of a baffle, m2 (length in 2D, m)."""
    length, width, height = job.tank.size if job.dimension == 3 else (job.tank.length, 1.0, job.tank.height)
    if baffle.ring is not None:
        across = height if baffle.vertical else length
        return across * width - max(across - 2.0 * baffle.ring, 0.0) * max(width - 2.0 * baffle.ring, 0.0)
    along = baffle.top - baffle.bottom if baffle.vertical else baffle.right - baffle.left
    low, high = baffle.width or (0.0, width)
    return along * (high - low) - sum((b[0] - a[0]) * (b[1] - a[1]) for a, b in baffle.openings)


def _content_below(job, level):
    """Volume of the tank below a level, m3 (m2 in 2D)."""
    hull = build_hull(job.tank, job.spacing)
    if hull is None:
        return math.prod(job.tank.size[:-1]) * level
    return hull.content_below(level) * (job.tank.length if hull.dimension < job.dimension else 1.0)


def _volume(job, region):
    """Volume of a region, m3 (m2 in 2D)."""
    if region.box is not None:
        return math.prod(high - low for low, high in zip(*region.box, strict=True))
    if job.dimension == 2:
        return math.pi * region.disc.radius**2
    return 4.0 / 3.0 * math.pi * region.ball.radius**3


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
    pairs = rows * lattice(dimension, reach).neighbours
    entries = pairs + rows
    centres = liquid if scheme.position == "start" else rows
    per_centre, per_row, per_particle = _work_bytes(job)
    return {
        "program": PROGRAM_BYTES,
        # the particles, and the copy of the last good state
        "particles": PARTICLE_BYTES * (2.0 * owned + halo),
        "fields of a step": per_centre * centres + per_row * rows + per_particle * (owned + halo),
        # number and squared distance of each neighbour, and a weight where the radii differ
        "neighbour lists": 8.0 * pairs + 4.0 * pairs * (scheme.radius != scheme.laplacian_radius),
        "pressure matrix": ENTRY_BYTES * entries,
        "multigrid hierarchy": HIERARCHY * ENTRY_BYTES * entries,
    }


def _work_bytes(job):
    """Bytes a particle with moments, a row and a particle of the arrays that live for one step."""
    plan = make_plan(job, 1)
    stages = {stage.name for stage in (*plan.solve, *plan.move)}
    size = []
    for counts in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)):
        work = Work(*counts, stages)
        arrays = [*vars(work).values(), *(vars(work.near_interface).values() if work.near_interface else ())]
        size.append(sum(array.nbytes for array in arrays if isinstance(array, np.ndarray)))
    return [each - size[0] for each in size[1:]]


def _memory_lines(job, counts, ranks):
    parts = memory_estimate(job, counts, ranks)
    each = sum(parts.values())
    placing = placing_estimate(job, counts)
    rows = [(name, _bytes(size)) for name, size in parts.items()]
    if placing > each - parts["program"]:
        each = placing + parts["program"]
        rows.append(("placing the particles, before all but the program", _bytes(placing)))
    available = available_memory() or math.inf
    rows += [("a rank", _bytes(each)), (f"all {ranks} rank(s)", _bytes(ranks * each))]
    rows.append(("available on this machine", _bytes(available)))
    reach = max(job.scheme.radius, job.scheme.laplacian_radius)
    near = lattice(job.dimension, reach).neighbours
    return [
        *_table(rows),
        *[f"  {REFUSED}"] * (ranks * each > available),
        f"  from the sizes of all fields, {near} neighbours within {reach:g} l0 on the lattice,",
        f"  a square or cube of particles a rank, and {HIERARCHY:g} matrices for the making of the hierarchy",
    ]


def _bytes(size):
    return f"{size / 1e6:>12.1f} MB"


def placing_estimate(job, counts):
    """Estimate the memory in which every rank places the particles, before it has its share of them.

    Parameters
    ----------
    job : Job
    counts : dict of str to int
        As in `count_particles`.

    Returns
    -------
    float
        Bytes.
    """
    hull, size = build_hull(job.tank, job.spacing), WALL_BYTES * (counts["wall"] + counts["dummy"])
    if hull is None:
        return size
    size += CELL_BYTES * math.prod(job.tank.size[a] / job.spacing for a in _sides(hull, job))
    return size + PAIRED_BYTES * counts["wall"] * (hull.dimension == 3)


def _sides(hull, job):
    """Numbers in `tank.size` of a hull's axes."""
    return [min(axis, job.dimension - 1) for axis in hull_axes(hull, job.dimension)]


def disk_estimate(job, counts):
    """Estimate the disk that the results take.

    Parameters
    ----------
    job : Job
    counts : dict of str to int
        As in `count_particles`.

    Returns
    -------
    dict of str to float
        Bytes by file. While a checkpoint is written, the last one is still there.
    """
    samples, frames = (
        math.ceil(job.time.end / every * (1.0 - 1e-12)) + 1
        for every in (job.output.probes_every, job.output.particles_every)
    )
    bodies = 2 + len(job.tank.baffles)  # the tank, each baffle, and all of them
    loads = 3 * (job.dimension - 1) * bodies
    signals = {"force": loads, "pressure": 2, "panel": 2, "liquid": 3 + job.dimension}
    columns = sum(signals.get(probe.kind, 1) for probe in job.probes)
    return {
        "particles.vtkhdf": frames * (float(POINT_BYTES) * counts["total"] + FRAME_BYTES),
        "probes.csv": samples * float(TIME_BYTES + SIGNAL_BYTES * columns),
        "checkpoint.h5": 2.0 * PARTICLE_BYTES * counts["total"],
    }


def _disk_lines(job, counts):
    parts = disk_estimate(job, counts)
    free = free_disk(job.output.directory)
    rows = [*((name, _bytes(size)) for name, size in parts.items()), ("all", _bytes(sum(parts.values())))]
    return [*_table([*rows, ("free", _bytes(free))]), *[f"  {REFUSED}"] * (sum(parts.values()) > free)]


def needs(job, ranks):
    """Estimate what a run takes of a machine, without placing a particle.

    Parameters
    ----------
    job : Job
    ranks : int

    Returns
    -------
    memory : float
        Bytes of each rank.
    disk : dict of str to float
        As in `disk_estimate`.
    """
    counts, _ = estimate_particles(job, wall_layers(job.scheme))
    parts = memory_estimate(job, counts, ranks)
    run = sum(parts.values()) - parts["program"]
    return parts["program"] + max(run, placing_estimate(job, counts)), disk_estimate(job, counts)


def check_machine(job, ranks, ranks_here, directory, kept):
    """Refuse a run that takes more than the machine has, before it takes anything.

    Parameters
    ----------
    job : Job
    ranks, ranks_here : int
        Of the run, and of those on this machine.
    directory : path-like
        Of the results.
    kept : float
        Bytes of results that are there already and go on.

    Raises
    ------
    InputError
    """
    each, disk = needs(job, ranks)
    available = available_memory()
    if available is not None and ranks_here * each > available:
        raise InputError(
            "spacing",
            f"got {job.spacing:g} m, with which the run takes about {ranks_here * each / 1e9:.3g} GB of memory for "
            f"{ranks_here} rank(s) on this machine; {available / 1e9:.3g} GB are available. --force runs it all the "
            "same",
        )
    free, largest = free_disk(directory) + kept, max(disk, key=disk.get)
    if sum(disk.values()) > free:
        intervals = {"particles.vtkhdf": "output.particles_every", "probes.csv": "output.probes_every"}
        raise InputError(
            intervals.get(largest, "spacing"),
            f"the results take about {sum(disk.values()) / 1e9:.3g} GB of disk, {largest} {disk[largest] / 1e9:.3g} GB "
            f"of it; {directory} has {free / 1e9:.3g} GB. --force runs it all the same",
        )
# Motion


def _motion_lines(job):
    rows = []
    for part in Motion(job.motion, job.gravity, job.dimension, job.tank).parts:
        value, rate, acceleration, felt = part.extremes(job.time.end)
        unit, scale = ("m", 1.0) if part.centre is None else ("deg", 180.0 / math.pi)
        gravities = f"{felt / STANDARD_GRAVITY:.3g} g"
        if part.centre is not None:
            gravities = f"{scale * acceleration:.4g} deg/s2, {gravities} at the farthest corner"
        item = job.motion[part.number]
        rounding = part.law.curve.resolution if item.kind == "file" else 0.0
        rows.append(
            (
                f"motion[{part.number}] {part.kind}",
                f"{scale * value:.4g} {unit}",
                f"{scale * rate:.4g} {unit}/s",
                gravities,
                f"recorded in steps of {rounding:.3g} {unit}, which are smoothed" if rounding else "",
            )
        )
    return _table(rows)


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
    wave = math.sqrt(job.gravity * _depth(job))
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


def _depth(job):
    """Depth of the liquid, m; that of the tank for regions."""
    return min(sum(depth or job.tank.height for depth in job.depths), job.tank.height)


def _bound(job, spacing, force, speed):
    """Step and the bound that governs it; the bounds are those of `Simulation.choose_step`."""
    control, liquids = job.time, Liquids(job)
    bounds = [(job.output.probes_every, "output.probes_every")]
    if control.max_step is not None:
        bounds.append((control.max_step, "time.max_step"))
    courant, steady = flow_limits(job, job.full)
    if speed > 0.0:
        bounds.append((courant * spacing / speed, f"cfl: {courant:g} l0/u"))
    if force > 0.0:
        bounds.append((steady * math.sqrt(spacing / force), f"body force: {steady:g} sqrt(l0/f)"))
    if liquids.capillary_rate > 0.0:
        step = CAPILLARY_STEP * math.sqrt(spacing**3 / liquids.capillary_rate)
        bounds.append((step, "surface tension: sqrt((rho_1 + rho_2) l0^3 / (4 pi sigma))"))
    if force > 0.0 and job.scheme.position == "moved":
        wave = math.sqrt(force * _depth(job))
        bounds.append((WAVE_STEP * spacing / wave, f"explicit move: {WAVE_STEP:g} l0/sqrt(f h)"))
    plan = make_plan(job, 1)
    if any(stage.name == "viscosity" for stage in (*plan.solve, *plan.move)):
        explicit = VISCOUS_STEP * spacing**2 / liquids.viscous_rate
        if min(bounds)[0] <= IMPLICIT_GAIN * explicit:
            bounds.append((explicit, f"viscosity: {VISCOUS_STEP:g} l0^2/nu"))
    step, bound = min(bounds)
    every = job.output.probes_every  # reached in a whole number of steps
    return every / math.ceil(every / step * (1.0 - 1e-9)), bound


def _motion_extremes(job):
    """Greatest body force (m/s2) and greatest speed (m/s) of the tank's corners during the run."""
    motion = Motion(job.motion, job.gravity, job.dimension, job.tank)
    if not motion.moves:
        return job.gravity, 0.0
    frames = [motion.at(t) for t in np.linspace(0.0, job.time.end, SAMPLES)]
    speed = max(np.linalg.norm(frame.velocity_at(motion.corners), axis=1).max() for frame in frames)
    return max(frame.greatest_force(motion.corners) for frame in frames), float(speed)


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


def _step_lines(job, estimate):
    rows = [("flow", "speed", "step", "steps in all", "governed by")]
    for name, speed, step, bound in estimate:
        steps = f"{math.ceil(job.time.end / step * (1.0 - 1e-9))}"
        rows.append((name, f"{speed:.3g} m/s", f"{step * 1e3:.3g} ms", steps, bound))
    return [*_table(rows), f"  for {job.time.end:g} s; a whole number of steps reaches each probe sample"]


# Accuracy and cost


def _trade_lines(job, counts, spacing, estimate):
    """What the study's scenes would have for an error with so many rows, and what so many steps cost."""
    table, source = read_table()
    preset, rows = job.scheme.preset, _rows(job, spacing)
    errors = expected_errors(table, preset, job.dimension, rows)
    cost = expected_cost(table, preset, job.dimension, counts["total"])
    if cost is None:
        return [f"  {preset} was not measured in {job.dimension}D"]
    lines = _table(
        [("error in the study's", "class", f"at {rows:.3g} rows")]
        + [(name, error_class(e.value), f"{e.value:.2g} %  {e.beyond}") for name, e in errors.items()]
    )
    steps = [math.ceil(job.time.end / step * (1.0 - 1e-9)) for _, _, step, _ in estimate]
    seconds = " to ".join(f"{count * cost.value:.2g}" for count in sorted({min(steps), max(steps)}))
    lines.append(f"  {seconds} CPU-seconds for the steps above, in all ranks, {1e3 * cost.value:.2g} ms a step")
    if cost.beyond:
        lines.append(f"  {cost.beyond}, continued in proportion")
    lines.append("  scenes unlike these (impacts, baffles, several liquids) may err more")
    changed = changed_settings(job.scheme)
    if changed:
        lines.append(f"  {preset} as it is: what {', '.join(changed)} change was not measured together")
    return [*lines, f"  {source}"]


def _rows(job, spacing):
    """Rows of particles over the depth of the liquid, or over the height of the tallest region."""
    heights = []
    for fluid in job.fluids:
        if fluid.region is None:
            continue
        if fluid.region.box is not None:
            heights.append(fluid.region.box[1][-1] - fluid.region.box[0][-1])
        else:
            heights.append(2.0 * (fluid.region.disc or fluid.region.ball).radius)
    layered = sum(depth for depth in job.depths if depth is not None)
    return max([layered, *heights]) / spacing


# Stages


def _stage_lines(plan):
    rows = [(str(number), stage.name, stage.reason) for number, stage in enumerate((*plan.solve, *plan.move), 1)]
    lines = _table(rows)
    if plan.solve:
        lines.insert(len(plan.solve), "  -- results are written here, where pressure and positions belong to one time")
    if plan.left_out:
        lines += ["Left out", *_table(plan.left_out)]
    return lines
