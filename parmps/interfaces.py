"""What happens at the interfaces of several liquids: the stages of a step that a scene with one liquid has not.

Across an interface between different densities the tangential velocity and acceleration jump, and the normal ones
have a kink. Operators that see one smooth field there lower the frequency of interfacial waves by about k l0 and
damp them. So particles near an interface take their own liquid's gradients, joined by the normal component alone.
"""

import numpy as np

from parmps.kernels import density, interface

OWN_FLOOR = 0.25
"""Least eigenvalue of the moment matrices over the own liquid alone; a flat interface leaves 1/2."""
SHIFT_ACROSS = 0.05
"""Share of the shifting that acts across an interface."""
SMOOTHINGS = 3
"""How often the colour function, and the curvature of its contours, are smoothed."""
SLIP = 1.0
"""Greatest difference of velocities that counts as slip, over l0 times the rate of the shortest waves, sqrt(f / l0).

A faster sheet rolls up at the scale of the spacing (Kelvin and Helmholtz). Its liquids are one field to the operators.
"""
UNCERTAIN = 0.02
"""Slope of the fraction, per spacing, below which a normal says little; the second row has 0.1."""


class Near:
    """Arrays for the particles near interfaces, which live for one step.

    Parameters
    ----------
    rows, count : int
        Own particles in the pressure equation, and all with the halo.

    Attributes
    ----------
    room : (rows,) int32
        Room for the list of the particles.
    index : (m,) int32
        The particles.
    fraction : (count,) float64
        Share of the own liquid in the neighbourhood; 1 away from interfaces.
    normal : (count, 3) float64, 1/spacings
        Normals out of the own liquid, as long as the fraction is steep; 0 away from interfaces.
    beyond : (rows, 3) float64
        First moment of the neighbours in other liquids, in 1/spacings; 0 away from interfaces.
    divergence : (rows,) float64, 1/s
        Filled near interfaces alone.
    slips : (count,) int8
        1 where the liquids slide along each other as a sheet.
    slipping : (k,) int32
        The particles that slip and have support, as found with that.
    """

    def __init__(self, rows, count):
        self.room = np.empty(rows, np.int32)
        self.index = self.room[:0]
        self.fraction = np.ones(count)
        self.normal = np.zeros((count, 3))
        self.beyond = np.zeros((rows, 3))
        self.divergence = np.empty(rows)
        self.slips = np.zeros(count, np.int8)
        self.slipping = self.index

    def reset(self, count):
        """Forget the particles of the step before.

        Parameters
        ----------
        count : int
            Number of particles near interfaces now, listed in `room`.
        """
        self.index = self.room[:count]
        self.fraction[:] = 1.0
        self.normal[:] = 0.0
        self.beyond[:] = 0.0
        self.slips[:] = 0


def label_walls(sim):
    """Find the liquid next to each wall particle."""
    p = sim.particles
    nearest = sim.work.nearest
    interface.label_walls(p.position, *sim.pairs.lists, p.kind, p.liquid, p.rows, p.fluid, nearest)
    sim.domain.exchange(p.fluid)


def share_with_walls(sim, values):
    """Give wall particles the value of the liquid next to them, and all values to neighbouring ranks.

    Parameters
    ----------
    sim : Simulation
    values : (n,) float64
    """
    nearest = sim.work.nearest[sim.particles.liquid : sim.particles.rows]
    sim.domain.exchange(values)
    wet = np.flatnonzero(nearest >= 0)
    values[sim.particles.liquid + wet] = values[nearest[wet]]
    sim.domain.exchange(values)


class Links:
    """Liquid neighbours of particles near interfaces or the free surface, with images behind walls.

    Parameters
    ----------
    sim : Simulation
    near : (m,) int32
        The particles.

    Attributes
    ----------
    begin, index, offset, image, mirror
        As made by `interface.image_links`.
    smooth, strength
        As made by `interface.link_weights`.
    """

    def __init__(self, sim, near):
        p, (first, last, other) = sim.particles, sim.pairs.wet
        count = len(near)
        capacity = 2**sim.dimension * int((last[near] - first[near] + 1).sum())
        self.begin, self.index = np.empty(count + 1, np.int64), np.empty(capacity, np.int32)
        self.offset, self.image = np.empty((capacity, 3)), np.empty(capacity, np.int8)
        self.mirror = np.empty((count, 3, 3))
        reach = sim.scheme.radius * sim.l0
        walls = (p.normal, p.depth)
        lists = (near, first, last, other)
        into = (self.begin, self.index, self.offset, self.image, self.mirror)
        interface.image_links(p.position, p.kind, *walls, *lists, reach, *into)
        self.smooth, self.strength = np.empty((2, self.begin[-1]))
        interface.link_weights(self.offset, sim.l0, sim.scheme.radius, self.smooth, self.strength)


def smooth_fraction(sim, fraction, near, links):
    """Smooth the fraction of the own liquid among the particles near interfaces.

    Parameters
    ----------
    sim : Simulation
    fraction : (n,) float64
    near : Near
        Has the result.
    links : Links
    """
    common = (sim.particles.fluid, sim.liquids.sheet)
    interface.smooth_fraction(*common, fraction, near.index, links.begin, links.index, links.smooth, near.fraction)
    sim.domain.exchange(near.fraction)


def find_normals(sim, near, links):
    """Normals of the interfaces, from the smoothed fraction.

    Parameters
    ----------
    sim : Simulation
    near : Near
        Has the fraction, and the result.
    links : Links
    """
    between = (links.begin, links.index, links.offset, links.image, links.strength)
    common = (sim.particles.fluid, sim.liquids.sheet)
    into = (near.normal, near.beyond)
    interface.normals(*common, near.fraction, near.index, *between, sim.l0, sim.dimension, *into)
    sim.domain.exchange(near.normal)


def find_interfaces(sim):
    """Find the particles near interfaces, and the interfaces' normals."""
    p, near = sim.particles, sim.work.near_interface
    near.reset(interface.find_near(*sim.pairs.lists, p.kind, p.fluid, sim.liquids.sheet, p.liquid, near.room))
    links = Links(sim, near.index)
    smooth_fraction(sim, near.fraction.copy(), near, links)
    find_normals(sim, near, links)
    limit = SLIP * sim.l0 * sim.grid_number / sim.dt
    interface.find_slip(p.velocity, p.kind, p.fluid, sim.liquids.sheet, near.index, *sim.pairs.wet, limit, near.slips)
    near.beyond[near.index[near.slips[near.index] == 0]] = 0.0
    sim.domain.exchange(near.slips)


def find_curvature(sim):
    """Curvature of the interfaces, which surface tension makes a jump of the pressure.

    It is a second derivative, and the colour function and the curvature are smoothed.
    """
    p, w, near = sim.particles, sim.work, sim.work.curved
    fraction = w.near_interface.fraction
    near.reset(interface.widen(*sim.pairs.lists, p.kind, fraction, p.liquid, near.room))
    links = Links(sim, near.index)
    for _ in range(SMOOTHINGS):
        smooth_fraction(sim, fraction, near, links)
        fraction = near.fraction.copy()
    find_normals(sim, near, links)
    common, between = (p.fluid, sim.liquids.sheet), (links.begin, links.index, links.offset)
    w.bend[:] = 0.0
    images = (*between, links.image, links.mirror, links.strength)
    interface.curvature(*common, near.normal, near.index, *images, sim.dimension, w.bend)
    weights = (*between, links.strength, sim.scheme.radius)
    for _ in range(SMOOTHINGS):
        sim.domain.exchange(w.bend)
        interface.smooth_curvature(*common, w.bend.copy(), near.normal, near.index, *weights, w.bend)
    share_with_walls(sim, w.bend)


def correct_divergence(sim):
    """Velocity gradients of the own liquid near interfaces, and the divergence that they make there.

    Returns
    -------
    index : (m,) int32
        Of the particles.
    divergence : (m,) float64, 1/s
    """
    p, w, near = sim.particles, sim.work, sim.work.near_interface
    index = near.slipping
    common = (p.kind, p.fluid, near.slips, sim.liquids.sheet)
    links = (index, *sim.pairs.wet, sim.strength)
    scale = (sim.lattice.density, sim.dimension)
    inverse = np.empty((len(index), 6))
    interface.own_moments(p.position, *common, *links, *scale, inverse)
    density.invert(inverse, OWN_FLOOR, sim.dimension, inverse)
    interface.own_gradient(p.position, w.intermediate, *common, *links, inverse, *scale, w.gradient)
    sim.domain.exchange(w.gradient)
    interface.divergence(
        p.position,
        w.intermediate,
        w.gradient,
        *common,
        near.normal,
        *links,
        w.inverse,
        *scale,
        near.divergence,
    )
    return index, near.divergence[index]


def correct_acceleration(sim):
    """Set grad P / rho where its tangential part jumps with the density, at interfaces, or support is little."""
    p, s, w, near = sim.particles, sim.scheme, sim.work, sim.work.near_interface
    index = w.weak if near is None else np.concatenate([near.slipping, w.weak])
    inverse, sums = np.empty((len(index), 6)), np.empty((len(index), 3))
    interface.pressure_gradient(
        p.position,
        p.pressure,
        w.force,
        p.kind,
        w.surface,
        w.lean,
        sim.liquids.reference,
        w.support,
        index,
        *sim.pairs.wet,
        sim.strength,
        sim.l0,
        sim.surface_distance,
        sim.lattice.density,
        sim.dimension,
        inverse,
        sums,
        sim.fluid,
        sim.liquids.volume,
        sim.liquids.tension,
        w.bend,
        None if near is None else near.normal,
        w.above,
    )
    density.invert(inverse, s.gradient_floor, sim.dimension, inverse)
    interface.solve_gradient(w.force, index, inverse, sums, p.acceleration)


def limit_shifting(sim):
    """Shift particles along an interface by their own liquid's asymmetry alone, and hardly across it.

    With the other liquid's part, rows that slide along each other interlock: a drop of 10 rows, stretched by less
    than a spacing, lagged behind its velocity by a tenth. Where the normal is not certain, in jets, both liquids count.
    Shifting across the interface as elsewhere slows and damps its waves; without any, particles gather in the rows
    beside it and leave a gap between them.
    """
    p, w, near = sim.particles, sim.work, sim.work.near_interface
    index = near.slipping
    normal, whole = near.normal[index], w.asymmetry[index]
    other = np.empty_like(whole)
    links = (index, *sim.pairs.wet, sim.strength)
    interface.asymmetry_across(
        p.position, p.kind, p.fluid, sim.liquids.sheet, *links, sim.lattice.density, sim.dimension, other
    )
    steep2 = np.einsum("ij,ij->i", normal, normal)
    bound = np.maximum(steep2, UNCERTAIN**2)
    certain = (steep2 / bound)[:, None]
    across = np.einsum("ij,ij->i", certain * other - (1.0 - SHIFT_ACROSS) * whole, normal) / bound
    w.asymmetry[index] = whole - certain * other + across[:, None] * normal
