"""The stages of a time step, and the plan that holds only those that a scene requires.

Each stage is a function of the simulation; the plan reads from top to bottom as the method does. With the
pressure solved at the step's start (the default), ``solve`` brings the pressure of time t^n and ``move`` the
step to t^(n+1): v^(n+1) = v^n + dt (f - grad P / rho), r^(n+1) = r^n + dt v^(n+1), the symplectic Euler method
([002] eqs. 15 to 18). The papers' scheme ([004]) moves first; its ``solve`` finds what results need besides the last
pressure: neighbours, smoothed densities and the free surface of the places at t^n.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from parmps import separation, support
from parmps.components import floating_components
from parmps.interfaces import (
    correct_acceleration,
    correct_divergence,
    find_curvature,
    find_interfaces,
    label_walls,
    limit_shifting,
)
from parmps.kernels import density, gradient, poisson, shifting, velocity, viscosity
from parmps.kernels.energy import book_acceleration
from parmps.kernels.weight import weight
from parmps.liquids import Liquids
from parmps.neighbors import sorted_cells
from parmps.particles import DUMMY, FLUID, WALL
from parmps.smoothing import add_surface_tension, mass_density, smooth_mass_density
from parmps.surface import find_surface_pressure

RESOLVED_LAYER = 0.25
"""Thickness, in spacings, of the boundary layer of the slowest wave from which on particles show it."""
VISCOUS_DAMPING, STRESS_DAMPING = 1e-4, 1e-3
"""Share of its amplitude that the slowest wave loses by viscosity in a period (Lamb 1932, art. 348) from which on the
scene has viscosity, and from which on its free surface bears no viscous stress. The scheme's own errors are 5e-4."""

VOLUME_EVERY = 5
"""Steps between two measurements of the volume error and of the surface row, which change slowly."""

VOLUME_OFF, VOLUME_SOON = 0.002, 2
"""Mean volume error beyond which violent flow makes room faster than that, and the steps between measurements then."""

SUPPORT = 0.8
"""Share of the smooth weight's radius within which its support must be whole: less than 0.1 % of its sum is missing
where a flat surface is further away."""

VOLUME_SHARE = 0.2
"""Share of the volume error to remove per u dt / l0, u the greatest speed, where volume_time is longer than that."""

VOLUME_STRAIN = 20.0
"""Rate at which the volume error is removed over s^2 / (s + sqrt(f / l0)), s the strain rate and f the body force. What
makes room is that strain disorders the particles; a fast rate in a calm wave would damp it."""

VOLUME_MOST = 0.5
"""Greatest share of the volume error that is removed from one measurement to the next."""

RESIDUAL_DAMPING = 2.0
"""Damping of a velocity difference that no linear field explains, per (difference) dt / l0."""

WALL_ROOM = 0.25
"""Distance from a wall, in spacings, from which on shifting brings particles no nearer: just before walls would put
them back. With 0.4 it is a ratchet that thins the rows at walls, and a prism with a ring gained 14 %."""

MOST_OVERDENSITY = 0.2
"""Density above the allowed one, over n0, beyond which particles are pushed apart no harder: a pile that goes apart
at once, as of a random start, gets more energy from it than its weight has."""


class Stage(NamedTuple):
    """One stage of a step.

    Attributes
    ----------
    name : str
        As in the timer table.
    reason : str
        Why the scene needs it.
    run : function
        Takes the `Simulation`.
    """

    name: str
    reason: str
    run: Callable


class Plan(NamedTuple):
    """The stages of a step.

    Attributes
    ----------
    project : list of Stage
        Those that lead to the pressure which an impulsive start needs, once.
    solve, move : list of Stage
        Those that lead to the pressure, after which results are written, and those that move the liquid. After the
        first, neighbours are those of the present places in every scheme: what is measured may sum over them.
    left_out : list of (str, str)
        Names of stages that the scene does not need, and why.
    """

    project: list
    solve: list
    move: list
    left_out: list


def make_plan(job, ranks):
    """Choose the stages that a job needs.

    Parameters
    ----------
    job : Job
    ranks : int

    Returns
    -------
    Plan
    """
    scheme = job.scheme
    left_out = []

    def when(needed, name, reason, run, otherwise):
        if needed:
            return [Stage(name, reason, run)]
        left_out.append((name, otherwise))
        return []

    viscous, visible, why = viscosity_matters(job)
    liquids = Liquids(job)
    halo = when(ranks > 1, "halo", f"particles of {ranks} ranks see each other", refresh_halo, "one rank")
    search = [Stage("neighbours", "every operator sums over neighbours", find_neighbours)]
    viscosity = when(viscous, "viscosity", why, add_viscosity, why)
    strain = when(
        visible and not job.full,
        "strain",
        "a free surface bears no viscous stress",
        measure_strain,
        "the tank is full" if job.full else why,
    )
    one = "all liquids have one density" if liquids.several else "one liquid"
    label = f"walls have the density of the one of {len(job.fluids)} liquids next to them"
    contact = when(
        scheme.collision_distance > 0.0,
        "contacts",
        f"stops particles that meet within {scheme.collision_distance:g} l0",
        add_contacts,
        "collision_distance is 0",
    )
    matrices = when(
        scheme.position == "start" or scheme.gradient == "corrected",
        "matrices",
        "operators that are exact for linear fields",
        invert_moments,
        f"neither the divergence nor the gradient '{scheme.gradient}' is corrected",
    )
    if scheme.position == "moved":
        differ = liquids.contrast < 1.0
        smoothing = [
            *when(differ, "wall liquids", label, label_walls, one),
            *when(differ, "density smoothing", "density jumps between liquids", smooth_mass_density, one),
        ]
        tension = when(
            liquids.tension is not None,
            "surface tension",
            "a force in the layer where two liquids meet",
            add_surface_tension,
            "no surface tension",
        )
        found = [
            *halo,
            *search,
            *smoothing,
            Stage("density", "density error and free surface", measure_density),
        ]
        projection = [
            *found,
            *matrices,
            Stage("divergence", "source of the pressure equation", measure_divergence),
            Stage("pressure", "incompressibility", solve_pressure),
        ]
        return Plan(
            projection,
            found,
            [
                Stage("body force", "gravity and the tank's motion", add_body_force_to_liquid),
                *viscosity,
                *tension,
                *contact,
                Stage("explicit move", "the papers solve the pressure at the moved position", move_explicitly),
                *projection,
                Stage("correction", "pressure gradient moves the liquid", correct),
            ],
            left_out,
        )
    walls = when(liquids.several, "wall liquids", label, label_walls, "one liquid")
    interfaces = when(
        liquids.sheet is not None,
        "interfaces",
        "velocity and pressure gradient jump between liquids",
        find_interfaces,
        one,
    )
    around = when(
        support.matters(job),
        "support",
        "particles beside gaps of a full tank, or in a lighter liquid, must not speed themselves up",
        support.find_support,
        "neither a full tank nor liquids of different density with the corrected gradient",
    )
    curvature = when(
        liquids.tension is not None,
        "curvature",
        "surface tension makes the pressure jump",
        find_curvature,
        "no surface tension between liquids",
    )
    tense = any(fluid.surface_tension > 0.0 for fluid in job.fluids)
    above = when(
        liquids.surface_tension is not None,
        "surface pressure",
        "the pressure on the free surface is that of its curvature",
        find_surface_pressure,
        "the tank is full" if tense else "no surface tension at the free surface",
    )
    volume = when(
        scheme.volume_time is not None,
        "volume",
        f"holds the volume, within {scheme.volume_time} sqrt(L / f)",
        measure_volume,
        "volume_time is null",
    )
    apart = when(
        not job.full,
        "separation",
        "walls at the air do not pull the liquid",
        separation.let_go,
        "the tank is full",
    )
    moments = [
        Stage("density", "moments of the neighbourhood and free surface", measure_density),
        *when(
            not job.full or liquids.sheet is None,
            "surface",
            f"pressure is zero {'in gaps of the full tank' if job.full else 'on the free surface'}",
            locate_surface,
            "layers of different density fill the tank",
        ),
        *matrices,
    ]
    return Plan(
        [
            *halo,
            *search,
            *walls,
            *moments,
            *interfaces,
            *around,
            Stage("impulse", "walls stop the initial velocity at once", balance_impulse),
            Stage("divergence", "source of the pressure equation", measure_divergence),
            Stage("pressure", "incompressibility", solve_pressure),
        ],
        [
            *halo,
            *search,
            *walls,
            *moments,
            *interfaces,
            *around,
            *curvature,
            *above,
            *volume,
            Stage("body force", "gravity and the tank's motion, balanced in the pressure equation", predict),
            *strain,
            *viscosity,
            *contact,
            Stage("divergence", "source of the pressure equation", measure_divergence),
            Stage("pressure", "incompressibility", solve_pressure),
            Stage("tension", "no more than the flow at the place can make", separation.limit_tension),
            *apart,
        ],
        [
            Stage("gradient", "pressure gradient and damping of grid noise", accelerate),
            Stage("move", "new positions, with shifting towards even spacing", move),
        ],
        left_out,
    )


def viscosity_matters(job):
    """Tell whether viscosity changes what this scene's particles can show, by its slowest wave alone.

    Parameters
    ----------
    job : Job

    Returns
    -------
    bool
    bool
        Whether by more than the scheme's own errors, so that a free surface must bear no stress. With the Laplacian
        alone, as in the papers, free waves decay half as fast there, and liquid that turns is braked.
    str
        The reason, with numbers.
    """
    nu = Liquids(job).viscous_rate
    if nu == 0.0:
        return False, False, "the viscosity is 0"
    if job.scheme.position == "moved":
        return True, False, "the papers' scheme has it"
    if job.gravity == 0.0:
        return True, True, "without gravity there are no waves that would end before viscosity shows"
    length, depth = job.tank.length, min(job.tank.height, sum(depth or job.tank.height for depth in job.depths))
    k = math.pi / length
    rate = math.sqrt(job.gravity * k * math.tanh(k * depth))
    layer = math.sqrt(2.0 * nu / rate)
    damping = 2.0 * nu * k * k * 2.0 * math.pi / rate
    text = (
        f"boundary layers of {layer * 1e3:.2g} mm at a spacing of {job.spacing * 1e3:.2g} mm, "
        f"bulk damping {100 * damping:.2g} % a period"
    )
    resolved = layer > RESOLVED_LAYER * job.spacing
    return resolved or damping > VISCOUS_DAMPING, resolved or damping > STRESS_DAMPING, text


# Geometry


def refresh_halo(sim):
    """Send what neighbouring ranks need to know of this rank's particles.

    The halo is found anew when particles have come near that are not in it.
    """
    p = sim.particles
    if sim.domain.halo_is_stale(p, sim.halo_reach):
        sim.rebuild_halo()
    else:
        sim.domain.exchange(p.position, p.velocity, p.acceleration, p.pressure, p.separated)


def find_neighbours(sim):
    """List the neighbours within the largest radius, with their weights."""
    s = sim.scheme
    sim.pairs.find(sim.particles)
    sim.strength, sim.laplacian_strength = sim.pairs.weigh(sim.l0, s.radius, s.laplacian_radius)
    separation.cut_links(sim)


def measure_density(sim):
    """Number density, moments of the neighbourhood, and which particles are of the free surface."""
    p, s, w = sim.particles, sim.scheme, sim.work
    has_surface = "surface" in sim.seconds if s.position == "start" else not sim.job.full
    if has_surface and s.position == "start":
        density.wet_walls(p.position, p.normal, *sim.pairs.wet, sim.strength, sim.l0, p.liquid, p.rows, w.wet)
        sim.domain.exchange(w.wet)
    density.moments(
        p.position,
        w.wet,
        *sim.pairs.wet,
        sim.strength,
        sim.l0,
        sim.lattice.density,
        sim.dimension,
        w.density,
        w.asymmetry,
        w.lean,
        w.inverse,
    )
    if has_surface:  # else a gap between particles is none of the liquid
        density.mark_surface(w.density, w.asymmetry, sim.lattice.density, 0.9 * sim.lattice.asymmetry, w.surface)
        if s.position == "start":
            # low where the surface must be whole; beside cavities of violent flow it would put zero pressure inside
            threshold = (0.7 if sim.liquids.surface_tension is None else 0.3) * sim.lattice.asymmetry
            around = (p.position, p.normal, w.wet, w.asymmetry)
            density.mark_uncovered(*around, threshold, *sim.pairs.wet, p.liquid, w.surface)
        if s.position == "moved":  # the papers' wall particles can be in the surface, and then have no pressure
            density.mark_dry(p.kind, *sim.pairs.lists, p.liquid, p.rows, w.surface)
    sim.domain.exchange(w.asymmetry, w.surface)


def locate_surface(sim):
    """Normals of the free surface, and its mean distance from the particles below it."""
    p, w = sim.particles, sim.work
    density.surface_normals(
        p.position, w.asymmetry, w.surface, *sim.pairs.wet, sim.strength, p.liquid, w.lean, w.surface_normal
    )
    if sim.step_number % VOLUME_EVERY:
        return
    found = density.row_density(
        p.position,
        p.kind,
        w.surface,
        w.surface_normal,
        *sim.pairs.lists,
        sim.l0,
        sim.scheme.radius,
        sim.lattice.row_density,
        p.liquid,
    )
    total, count = sim.domain.sum(np.array(found))
    sim.surface_distance = 0.5 * sim.l0 * (total / count if count else 1.0)


def invert_moments(sim):
    """Inverse moment matrices of the corrected operators."""
    s, w = sim.scheme, sim.work
    gradient.add_missing_moment(w.inverse, w.surface, w.lean, sim.lattice.density, sim.dimension, w.full)
    density.invert(w.inverse, s.divergence_floor, sim.dimension, w.inverse)
    density.invert(w.full, s.gradient_floor, sim.dimension, w.full)


def measure_volume(sim):
    """Volume error from a wide and smooth density, which is free of the noise of the papers' one.

    Near the surface, where the support is cut, there is none.
    """
    p = sim.particles
    if sim.step_number % volume_every(sim):
        return
    ratio, inside = smooth_density(sim)
    p.compression[: p.liquid] = np.where(inside, np.clip(ratio - 1.0, -0.05, 0.05), 0.0)
    whole = ratio[inside]
    sums = np.array([p.compression[: p.liquid].sum(), (1.0 / whole - 1.0).sum(), float(len(whole))])
    error, off, count = sim.domain.sum(sums)
    sim.volume_error, sim.volume_off = error / max(count, 1.0), float(off / max(count, 1.0))


def volume_every(sim):
    """Steps between two measurements of the volume error."""
    return VOLUME_EVERY if abs(sim.volume_error) < VOLUME_OFF else VOLUME_SOON


def smooth_density(sim):
    """Density of the liquid by the wide smooth weight, over that of the lattice.

    Returns
    -------
    ratio : (liquid,) float64
        Where the support is whole.
    inside : (liquid,) bool
        Where the support is whole: away from the surface, which is half a spacing above its particles.
    """
    p, s, w = sim.particles, sim.scheme, sim.work
    near = w.near
    near[:] = w.surface
    for _ in range(math.ceil((SUPPORT * s.volume_radius - 0.5) / s.radius)):
        source = near.copy()
        sim.domain.exchange(source)
        density.spread(source, *sim.pairs.lists, p.liquid, near)
    reach = s.volume_radius * sim.l0
    density.smooth_density(near, p.normal, reach, *sorted_cells(p, reach), w.smooth[: p.liquid])
    full = sim.wide_lattice.smooth_density * sim.packing()
    return w.smooth[: p.liquid] / full, near[: p.liquid] == 0


# Explicit part


def predict(sim):
    """Intermediate velocity v* = v + dt (f - a), with a the predicted acceleration by the pressure.

    a is what the pressure equation balances link by link: the body force and, where the flow is smooth, what the
    pressure gradient over rho of the last steps was beyond it. The nearer a is to the coming one, the less is felt of
    the splitting of the pressure equation (Laplacian against divergence of the gradient), and of that from viscosity:
    what the pressure gradient has beyond a comes after the viscous step, and moves liquid along the walls.
    """
    p, w = sim.particles, sim.work
    sim.evaluate_body_force()
    limit = sim.scheme.predictor_limit * sim.force
    velocity.predict(p.kind, p.velocity, p.acceleration, w.force, limit, sim.dt, w.link_force, w.intermediate)


def balance_impulse(sim):
    """Take the tank's jolt and the mean of the other velocity as a body force over one step.

    The rest is left to its divergence.

    Pressure balances the body force link by link, so that a jolt of the whole tank is stopped up to the wall. By its
    divergence, a tank that began to pitch left the row beside its floor a third of the jolt.
    """
    p, w = sim.particles, sim.work
    liquid = p.kind == FLUID
    jolt = -sim.frame.velocity_at(p.position)
    own = slice(0, p.liquid)
    mean = sim.domain.sum((p.velocity[own] - jolt[own]).sum(axis=0)) / sim.totals["fluid"]
    jolt[liquid] += mean
    jolt[~liquid] = 0.0
    p.velocity[liquid] -= jolt[liquid]
    w.intermediate[:] = p.velocity
    w.force[:] = w.link_force[:] = jolt / sim.dt


def add_body_force_to_liquid(sim):
    """v* = v + dt f."""
    p, w = sim.particles, sim.work
    sim.evaluate_body_force()
    w.link_force[:] = 0.0
    w.intermediate[:] = 0.0
    liquid = p.kind == FLUID
    w.intermediate[liquid] = p.velocity[liquid] + sim.dt * w.force[liquid]
    w.force[:] = 0.0  # the divergence of v* has it
    sim.ledger.book("pressure", sim.ledger.kinetic(p, w.intermediate) - sim.ledger.kinetic(p, p.velocity))


def measure_strain(sim):
    """Velocity gradient of the liquid, with no slip at the walls."""
    p, w = sim.particles, sim.work
    flow = p.velocity.copy()
    _reflect(sim, True, flow)
    _measure_gradient(sim, flow, w.inverse[: p.liquid])
    sim.domain.exchange(w.gradient)


def add_viscosity(sim):
    """Add the viscous change of velocity: explicit, or implicit where the explicit one needs shorter steps.

    The implicit one solves for the change by all forces of the step. With the stress that vanishes at a free surface,
    its matrix has twice the Laplacian, since that stress takes up to twice the energy that the Laplacian takes, and
    none from liquid that turns as a whole: the first then decays at steps of any length, and the second goes on.
    """
    energy = sim.ledger.kinetic(sim.particles, sim.work.intermediate)
    _change_by_viscosity(sim)
    sim.ledger.book("viscosity", sim.ledger.kinetic(sim.particles, sim.work.intermediate) - energy)


def _change_by_viscosity(sim):
    """Add the viscous change of velocity to the intermediate one."""
    p, w, operator = sim.particles, sim.work, _viscous_operator(sim)
    walls, table = (p.kind, p.normal, p.depth), sim.liquids.viscosity
    change, dt = w.intermediate, sim.dt
    if sim.implicit:
        dt = sim.divergence_time
        change = (w.intermediate[: p.rows] - p.velocity[: p.rows]) * (dt / sim.dt)
    onto = (p.liquid, change, sim.fluid)
    viscosity.add_viscosity(p.position, p.velocity, *walls, table, *operator, dt, *onto)
    stress = "strain" in sim.seconds
    if stress:
        viscosity.add_transpose(p.position, p.kind, w.gradient, table, *operator, dt, *onto)
    if not sim.implicit:
        return
    blocks, rho = sim.blocks(), sim.liquids.density / sim.liquids.reference
    operator = (*operator, 2.0 * dt if stress else dt)
    viscosity.viscosity_rows(p.position, *walls, table, rho, sim.column, *operator, *blocks.arrays, sim.fluid)
    axes = (0, 1, 2) if sim.dimension == 3 else (0, 2)
    sim.velocity_solver.solve(blocks, rho[p.fluid[: p.rows]], change, axes)
    w.intermediate[: p.liquid] = p.velocity[: p.liquid] + change[: p.liquid] * (sim.dt / dt)


def _viscous_operator(sim):
    """What all sums of viscosity are over: neighbours with their weights, and the constants of the Laplacian."""
    lat = sim.lattice
    return (*sim.pairs.wet, sim.strength, sim.l0, lat.density, lat.lam, sim.dimension)


def wall_friction(sim):
    """Viscous force of the liquid on the rank's own wall particles, between `Plan.solve` and `Plan.move`.

    Parameters
    ----------
    sim : Simulation

    Returns
    -------
    None or (k, 3) float64, N, in 2D N/m
        None where viscosity does not act.
    """
    if "viscosity" not in sim.seconds:
        return None
    p = sim.particles
    force, share = np.empty((p.rows - p.liquid, 3)), sim.particle_mass * sim.liquids.viscosity.diagonal()
    flow = (p.position, p.velocity, p.kind, p.normal, p.depth)
    viscosity.wall_friction(*flow, share, *_viscous_operator(sim), p.liquid, p.rows, p.fluid, force)
    return force


def add_contacts(sim):
    """Stop particles that are about to overlap."""
    p, s, w = sim.particles, sim.scheme, sim.work
    energy = sim.ledger.kinetic(p, w.intermediate)
    before = w.intermediate.copy() if sim.hurried else None
    reach = min(s.collision_distance + 2.0 * sim.courant, s.radius)  # two particles that run into each other
    sim.contacts += velocity.add_contacts(
        p.position,
        p.velocity,
        p.kind,
        *sim.pairs.wet,
        sim.strength,
        weight.py_func(reach, s.radius) / (reach * sim.l0) ** 2,
        s.collision_distance * sim.l0,
        sim.dt,
        p.liquid,
        w.intermediate,
        sim.fluid,
        sim.liquids.share,
    )
    w.impulse = None if before is None else w.intermediate - before
    sim.ledger.book("contacts", sim.ledger.kinetic(p, w.intermediate) - energy)


def move_explicitly(sim):
    """r* = r + dt v*."""
    p, w = sim.particles, sim.work
    p.velocity[: p.liquid] = w.intermediate[: p.liquid]
    sim.ledger.book_way(p, p.velocity, sim.dt, sim.force_field())
    p.position[: p.liquid] += sim.dt * p.velocity[: p.liquid]
    sim.keep_inside()


# Pressure


def measure_divergence(sim):
    """Source of the pressure equation: divergence of v* and density error.

    What divergence v has, and contacts give it, is removed in the time that it came in
    (`Simulation.divergence_time`), and what v* has beyond that in the step.
    """
    p, s, w = sim.particles, sim.scheme, sim.work
    liquid = p.kind == FLUID
    w.source[:] = 0.0
    if s.position == "moved":  # [004] eq. 12
        w.intermediate[:] = np.where(liquid[:, None], p.velocity, 0.0)
        trace = flow_divergence(sim, density.lattice_matrix(p.rows))
        over = w.density[: p.rows] / sim.lattice.density
        w.source[: p.rows] = (1.0 - s.gamma) * trace / sim.dt - s.gamma * (over - 1.0) / sim.dt**2
        return
    _reflect(sim, False, w.intermediate)
    inverse = w.inverse[: p.liquid]
    if sim.hurried:
        intermediate, past = w.intermediate, p.velocity if w.impulse is None else p.velocity + w.impulse
        w.intermediate = np.where(liquid[:, None], past, intermediate)
        sim.domain.exchange(w.intermediate)
        trace = flow_divergence(sim, inverse)
        w.intermediate = intermediate
        added = flow_divergence(sim, inverse) - trace
    else:
        trace, added = flow_divergence(sim, inverse), 0.0
    flow = trace.copy()
    if s.volume_time is not None:
        velocity.relax_volume(
            p.compression,
            w.gradient,
            # faster in fast flow, where pushing particles apart makes room
            max(math.sqrt(sim.force / max(sim.job.tank.size)) / s.volume_time, VOLUME_SHARE * sim.courant / sim.dt),
            VOLUME_STRAIN,
            sim.grid_number / sim.dt,
            VOLUME_MOST / (volume_every(sim) * sim.dt),
            trace,
        )
    over = w.density[: p.liquid] / sim.lattice.density / sim.packing()
    share = min(s.separation * (sim.grid_number + sim.courant), 0.2)
    trace = trace - share * np.clip(over - s.overdensity, 0.0, MOST_OVERDENSITY) / sim.dt
    w.source[: p.liquid] = trace / sim.divergence_time + added / sim.dt
    w.expansion = (flow - trace) * (sim.dt / sim.divergence_time)


def _reflect(sim, sticks, flow):
    """Give wall particles, in ``flow``, the liquid's velocity reflected at the walls, and all of it to the halo."""
    p = sim.particles
    velocity.reflect_at_walls(
        p.position,
        p.velocity,
        p.kind,
        p.normal,
        p.depth,
        *sim.pairs.wet,
        sim.strength,
        sim.l0,
        p.liquid,
        p.rows,
        sticks,
        flow,
    )
    sim.domain.exchange(flow)


def _measure_gradient(sim, flow, inverse):
    """Gradient of a velocity, into ``sim.work.gradient``, for as many rows as there are inverse moment matrices."""
    velocity.velocity_gradient(
        sim.particles.position,
        flow,
        *sim.pairs.wet,
        sim.strength,
        inverse,
        sim.lattice.density,
        sim.dimension,
        len(inverse),
        sim.work.gradient,
    )


def flow_divergence(sim, inverse):
    """Divergence of ``sim.work.intermediate``, whose gradient stays in ``sim.work.gradient``.

    Parameters
    ----------
    sim : Simulation
    inverse : (rows, 6) float64
        Inverse moment matrices.

    Returns
    -------
    (rows,) float64, 1/s
    """
    w, rows = sim.work, len(inverse)
    _measure_gradient(sim, w.intermediate, inverse)
    if w.support is not None:
        support.correct_flow(sim)
    divergence = w.gradient[:rows, 0] + w.gradient[:rows, 4] + w.gradient[:rows, 8]
    if w.near_interface is not None:
        index, values = correct_divergence(sim)
        divergence[index] = values
    return divergence


def sharp(sim, *tables):
    """What tells an operator of the liquids' sharp densities, or nothing where the papers' scheme smooths them.

    Parameters
    ----------
    sim : Simulation
    *tables : None or ndarray

    Returns
    -------
    tuple of (None or ndarray)
    """
    return tables if sim.scheme.position == "start" else (None,) * len(tables)


def solve_pressure(sim):
    """Assemble and solve the pressure equation; the free surface bears no tension."""
    p, s, w = sim.particles, sim.scheme, sim.work
    if s.position == "moved" and sim.dt < 0.5 * sim.divergence_time:
        # a short step to an output keeps the pressure: the source of [004] eq. 12 has the errors of a whole one over
        # dt^2, which blew runs up
        return
    lat = sim.laplacian_lattice
    blocks = sim.blocks()
    poisson.poisson_rows(
        p.position,
        p.kind,
        w.surface,
        w.lean,
        w.link_force,
        w.force,
        w.source,
        p.pressure,
        sim.column,
        *sim.pairs.wet,
        sim.laplacian_strength,
        sim.l0,
        lat.density,
        lat.lam,
        sim.dimension,
        sim.liquids.reference,
        0.5 if s.gradient == "corrected" else 1.0,
        sim.surface_distance,
        s.surface == "ghost",
        *blocks.arrays,
        blocks.at_diagonal,
        w.rhs,
        *sharp(sim, sim.fluid, sim.liquids.volume, sim.liquids.share, sim.liquids.tension, w.bend),
        w.mass_density,
        w.above,
    )
    if sim.check_floating():
        held = w.surface[: p.rows]
        if s.surface == "dirichlet":  # their links are eliminated, so that the next ones hold the rest
            held = np.empty_like(held)
            density.spread(w.surface, *sim.pairs.lists, p.rows, held)
        sim.floating = floating_components(sim.domain, sim.row, sim.column, blocks, held)
    sim.floating.fix(sim.domain, blocks, w.rhs, p.pressure[: p.rows])
    pressure = sim.solver.solve(blocks, w.rhs, p.pressure[: p.rows])
    # Rows without links are known exactly: 0 in the papers' surface and of dry walls. What the solver leaves of its
    # error there would look like the pressure of wet walls, by its sign and by the number of ranks.
    alone = np.flatnonzero(np.diff(blocks.first) + np.diff(blocks.halo_first) == 1)
    pressure[alone] = w.rhs[alone] / blocks.values[blocks.first[alone]]
    p.pressure[: p.rows] = pressure
    sim.floating.level(sim.domain, p.pressure[: p.rows])
    poisson.release_surface(w.surface, w.above, p.liquid, p.pressure)


# Implicit part


def accelerate(sim):
    """v^(n+1) = v* + dt (a - grad P / rho), and the damping of grid noise."""
    p, s, w = sim.particles, sim.scheme, sim.work
    pressure_gradient(sim)
    sim.domain.exchange(w.gradient)
    gradient.residual_damping(
        p.position,
        w.intermediate,
        p.kind,
        w.gradient,
        *sim.pairs.wet,
        sim.strength,
        sim.lattice.density,
        sim.dimension,
        s.damping * sim.activity,
        RESIDUAL_DAMPING * sim.dt / sim.l0,
        p.liquid,
        w.change,
        sim.fluid,
        sim.liquids.share,
        sim.liquids.sheet,
        *((None, None) if w.near_interface is None else (w.near_interface.slips, w.near_interface.normal)),
    )
    change = (w.intermediate, w.change, w.link_force, w.force)
    account = (p.pressure, w.expansion, p.kind, p.fluid, sim.ledger.mass, sim.ledger.volume, sim.force_field())
    book_acceleration(
        p.position, p.velocity, *change, p.acceleration, *account, sim.dt, p.liquid, sim.ledger.booked
    )
    velocity.accelerate(*change, sim.dt, p.liquid, p.acceleration, p.velocity)


def pressure_gradient(sim):
    """Set the particles' acceleration to grad P / rho."""
    p, s, w = sim.particles, sim.scheme, sim.work
    sim.domain.exchange(p.pressure)
    if s.gradient == "corrected":
        enclosed = np.empty(p.liquid, np.int8)
        density.mark_enclosed(p.kind, w.surface, *sim.pairs.wet, p.liquid, enclosed)
        gradient.corrected_gradient(
            p.position,
            p.pressure,
            w.surface,
            w.lean,
            *sim.pairs.wet,
            sim.strength,
            w.full,
            sim.surface_distance,
            sim.lattice.density,
            sim.dimension,
            p.liquid,
            p.acceleration,
            *sharp(sim, sim.fluid, sim.liquids.volume, sim.liquids.tension, w.bend),
            w.above,
            enclosed,
            w.force,
            sim.liquids.reference,
        )
    else:
        extrapolate_to_dummies(sim)
        gradient.paper_gradient(
            p.position,
            p.pressure,
            *sim.pairs.lists,
            sim.strength,
            sim.lattice.density,
            sim.dimension,
            s.gradient == "min",
            p.liquid,
            p.acceleration,
        )
    own = slice(0, p.liquid)
    acceleration = p.acceleration[own].T
    acceleration /= mass_density(sim, own)
    if w.support is not None:
        correct_acceleration(sim)


def move(sim):
    """r^(n+1) = r^n + dt v^(n+1), with shifting; surface particles move as the surface above them does."""
    p, s, w = sim.particles, sim.scheme, sim.work
    if w.support is not None:
        w.gradient[w.weak] *= w.support[w.weak, None]
        sim.domain.exchange(w.gradient)
    beyond = None
    if w.near_interface is not None:
        beyond = w.near_interface.beyond
        limit_shifting(sim)
    share = min(s.shifting * (sim.grid_number + 1.5 * sim.courant), 0.2)
    shifting.spare_walls(
        p.position,
        w.asymmetry,
        p.kind,
        *sim.pairs.wet,
        sim.geometry.walls,
        WALL_ROOM * sim.l0,
        share * sim.l0,
        p.liquid,
    )
    shifting.move(
        p.position,
        p.velocity,
        p.kind,
        w.asymmetry,
        w.surface,
        w.surface_normal,
        w.lean,
        w.gradient,
        sim.l0,
        sim.surface_lean,
        sim.surface_distance,
        share,
        sim.dt,
        p.liquid,
        beyond,
        w.inward,
        *sim.pairs.wet,
        sim.strength,
        p.fluid,
        sim.ledger.mass,
        sim.force_field(),
        sim.ledger.booked,
    )
    sim.keep_inside()


def correct(sim):
    """V = v* - dt grad P / rho, r = r* - dt^2 grad P / rho ([004] eqs. 13 and 14).

    Suction is left out, as most MPS codes do: with P_j + P_i it pulls particles together until the run blows up.
    """
    p = sim.particles
    np.maximum(p.pressure, 0.0, out=p.pressure)
    pressure_gradient(sim)
    liquid, energy = slice(0, p.liquid), sim.ledger.kinetic(p, p.velocity)
    p.velocity[liquid] -= sim.dt * p.acceleration[liquid]
    sim.ledger.book("pressure", sim.ledger.kinetic(p, p.velocity) - energy)
    sim.ledger.book_way(p, p.acceleration, -(sim.dt**2), sim.force_field())
    p.position[liquid] -= sim.dt**2 * p.acceleration[liquid]
    sim.keep_inside()


def extrapolate_to_dummies(sim):
    """Pressure of a dummy: that of the wall particle before it, with the jump of the body force between them."""
    p = sim.particles
    dummies = np.flatnonzero(p.kind == DUMMY)
    walls = np.flatnonzero(p.kind == WALL)
    order = walls[np.argsort(p.id[walls])]
    if not len(order):
        return
    place = np.minimum(np.searchsorted(p.id[order], p.parent[dummies]), len(order) - 1)
    parent = order[place]
    known = p.id[parent] == p.parent[dummies]
    dummies, parent = dummies[known], parent[known]
    start, end = p.position[parent], p.position[dummies]
    force = sim.frame.force_at(0.5 * (start + end))
    jump = mass_density(sim, parent) * np.einsum("ij,ij->i", end - start, force)
    p.pressure[dummies] = np.where(p.pressure[parent] != 0.0, p.pressure[parent] + jump, 0.0)
