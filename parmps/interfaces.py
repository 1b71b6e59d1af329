"""What happens at the interfaces of several liquids: the stages of a step that a scene with one liquid has not.

Across an interface between different densities the tangential velocity and acceleration jump, and the normal ones
have a kink. Operators that see one smooth field there lower the frequency of interfacial waves by about k l0 and
damp them. So particles near an interface take their own liquid's gradients, joined by the normal component alone.
"""

import numpy as np

from parmps.kernels import interface

OWN_FLOOR = 0.25
"""Least eigenvalue of the moment matrices over the own liquid alone; a flat interface leaves 1/2."""
SHIFT_ACROSS, SHIFT_TOGETHER = 0.15, 0.05
"""Shares of the shifting that act across an interface: of what the two sides do not have in common, and of what they
do, which moves the interface."""
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
    curved : slice
        Of the particles in ``room`` that take part in the curvature of interfaces under tension.
    state : (count,) int8
        0 away from interfaces, 2 near one under tension.
    colour : (count,) float64
        Share of the own liquid in the neighbourhood, less a half; 1/2 away from interfaces.
    normal : (count, 3) float64, 1/spacings
        Normals out of the own liquid, as long as the colour is steep; 0 away from interfaces.
    beyond : (rows, 3) float64
        First moment of the neighbours in other liquids, in 1/spacings; 0 away from interfaces.
    divergence : (rows,) float64, 1/s
        Filled near interfaces alone.
    slips : (count,) int8
        1 where the liquids slide along each other as a sheet.
    slipping : (k,) int32
        The particles that slip and have support, as found with that.
    links : Links
        Of all that are listed.
    """

    def __init__(self, rows, count):
        self.room = np.empty(rows, np.int32)
        self.index = self.room[:0]
        self.curved = slice(0, 0)
        self.state = np.zeros(count, np.int8)
        self.colour = np.full(count, 0.5)
        self.normal = np.zeros((count, 3))
        self.beyond = np.zeros((rows, 3))
        self.divergence = np.empty(rows)
        self.slips = np.zeros(count, np.int8)
        self.slipping = self.index
        self.links = Links()

    def forget(self):
        """Forget the particles of the step before; the halo's come anew from the ranks that own them."""
        self.colour[self.room[: self.curved.stop]] = 0.5
        self.normal[self.index] = 0.0
        self.beyond[self.index] = 0.0
        self.slips[self.index] = 0

    def list(self, lone, both, about):
        """Number the particles in `room`.

        Parameters
        ----------
        lone, both, about : int
            Those near interfaces, those near interfaces under tension or beside such particles, and the rest of these.
        """
        self.index = self.room[: lone + both]
        self.curved = slice(lone, lone + both + about)


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

    Attributes
    ----------
    begin : (m + 1,) int64
    index, offset, image, mirror, height
        As made by `interface.image_links`.
    strength
        As made by `interface.link_weights`.
    side, share, own
        As made by `interface.tell_sides`, where that is called.
    lift : (capacity,) float64
        As made by `interface.lift_images`, where that is called.
    """

    def __init__(self):
        self._resize(0)

    def _resize(self, capacity):
        self.index, self.image = np.empty(capacity, np.int32), np.empty(capacity, np.int8)
        self.offset = np.empty((3, capacity))
        self.strength, self.side, self.share, self.lift = np.empty((4, capacity))

    def find(self, sim, near):
        """List the links.

        Parameters
        ----------
        sim : Simulation
        near : (m,) int32
            The particles.
        """
        p, (first, last, other) = sim.particles, sim.pairs.wet
        count = len(near)
        most = 2**sim.dimension * int((last[near] - first[near] + 1).sum())
        if most > len(self.index):
            self._resize(most + most // 8)
        self.begin, self.own = np.empty(count + 1, np.int64), np.empty(count)
        self.mirror, self.height = np.empty((count, 3, 3)), np.empty((count, 3))
        reach = sim.scheme.radius * sim.l0
        lists = (near, first, last, other)
        into = (self.begin, self.index, self.offset, self.image, self.mirror, self.height)
        interface.image_links(p.position, p.kind, p.normal, p.depth, *lists, reach, *into)
        interface.link_weights(self.offset, self.begin[-1], sim.l0, sim.scheme.radius, self.strength)

    @property
    def images(self):
        """What kernels that see images read."""
        return self.begin, self.index, self.offset, self.image, self.mirror


def find_interfaces(sim):
    """Find the particles near interfaces, and the interfaces' normals."""
    p, liquids, near = sim.particles, sim.liquids, sim.work.near_interface
    links, reach = near.links, sim.scheme.radius
    near.forget()
    interface.find_near(*sim.pairs.wet, p.kind, p.fluid, liquids.meeting, p.liquid, near.state)
    if liquids.tension is None:
        found = np.flatnonzero(near.state[: p.liquid])
        near.room[: len(found)] = found
        near.list(len(found), 0, 0)
    else:
        sim.domain.exchange(near.state)
        near.list(*interface.list_near(*sim.pairs.wet, p.kind, near.state, p.liquid, near.room))
    index, listed = near.index, near.room[: near.curved.stop]
    links.find(sim, listed)
    sides = (links.side, links.share, links.own)
    interface.tell_sides(
        p.fluid, liquids.sheet, listed, links.begin, links.index, links.offset, sim.l0, reach, *sides, near.colour
    )
    sim.domain.exchange(near.colour)
    weights = (links.side, links.strength)
    interface.normals(
        near.colour, None, index, links.begin, links.offset, links.index, *weights, sim.l0, sim.dimension, near.normal
    )
    limit = SLIP * sim.l0 * sim.grid_number / sim.dt
    interface.find_slip(p.velocity, p.kind, p.fluid, liquids.sheet, index, *sim.pairs.wet, limit, near.slips)
    interface.moment_beyond(
        index, links.begin, links.offset, links.image, *weights, near.slips, sim.l0, near.beyond
    )
    sim.domain.exchange(near.normal, near.slips)


def find_curvature(sim):
    """Curvature of the interfaces under tension, which makes a jump of the pressure.

    It is a second derivative, and the colour function and the curvature are smoothed. Both sides get the same one, so
    that a constant curvature has no slope along the interface. Where wetting angles are given, images behind walls
    have the colour and the normals of an interface that goes on into the wall at that angle.
    """
    w, near = sim.work, sim.work.near_interface
    links, part, reach = near.links, near.curved, sim.scheme.radius
    index = near.room[part]
    begin, own, mirror = links.begin[part.start : part.stop + 1], links.own[part], links.mirror[part]
    colour, normal = near.colour.copy(), np.zeros_like(near.normal)
    images = (index, begin, links.index, links.offset, links.image, mirror)
    steep = (index, begin, links.offset, links.index, links.side, links.strength, sim.l0, sim.dimension, normal)
    smooth = (index, begin, links.index, links.share, own)
    lift, tilt = None, _tilt(sim, index, begin)
    for number in range(SMOOTHINGS + 1):
        if tilt is not None:
            interface.normals(colour, lift, *steep)
            sim.domain.exchange(normal)
            lift = links.lift
            interface.lift_images(colour, normal, tilt, *images, links.height[part], sim.l0, lift)
        if number < SMOOTHINGS:
            interface.smooth(*smooth, lift, colour)
            sim.domain.exchange(colour)
    interface.normals(colour, lift, *steep)
    sim.domain.exchange(normal)
    w.bend[:] = 0.0
    weights = (links.side, links.strength, reach, sim.dimension, links.share, own)
    interface.curvature(normal, tilt, *images, *weights, w.bend)
    for _ in range(SMOOTHINGS):
        sim.domain.exchange(w.bend)
        interface.smooth(*smooth, None, w.bend)
    sim.domain.exchange(w.bend)
    interface.join_sides(index, begin, links.index, links.offset, links.side, links.strength, w.bend)
    share_with_walls(sim, w.bend)


def _tilt(sim, index, begin):
    """By how much walls turn interfaces, (n,) in rad, or None where all meet them at right angles."""
    if sim.liquids.wetting is None:
        return None
    links, tilt = sim.work.near_interface.links, np.zeros(len(sim.particles))
    for _ in range(2):  # from those who see the other liquid to their neighbours
        interface.tell_tilt(
            sim.particles.fluid, sim.liquids.wetting, index, begin, links.index, links.side, links.strength, tilt
        )
        sim.domain.exchange(tilt)
    return tilt


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
    interface.own_gradient(p.position, w.intermediate, *common, *links, OWN_FLOOR, *scale, w.gradient)
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
        s.gradient_floor,
        p.acceleration,
        sim.fluid,
        sim.liquids.volume,
        sim.liquids.tension,
        w.bend,
        None if near is None else near.normal,
        w.above,
    )


def limit_shifting(sim):
    """Shift particles along an interface by their own liquid's asymmetry alone, and hardly across it.

    With the other liquid's part, rows that slide along each other interlock: a drop of 10 rows, stretched by less
    than a spacing, lagged behind its velocity by a tenth. Where the normal is not certain, in jets, both liquids count.
    Shifting that moves the interface slows and damps its waves; without any, waves of liquid at rest grow. Where it
    closes the gap between the liquids it must do more: with a twentieth of it, the two rows beside an interface of
    1000 : 1 had 33 and 35 particles instead of 25 after 10 s, and stood half a spacing too far apart.
    """
    p, near = sim.particles, sim.work.near_interface
    links = (near.slipping, *sim.pairs.wet, sim.strength)
    interface.hold_shifting(
        p.position,
        p.kind,
        sim.work.surface,
        p.fluid,
        sim.liquids.sheet,
        near.normal,
        *links,
        SHIFT_ACROSS,
        SHIFT_TOGETHER,
        UNCERTAIN,
        sim.lattice.density,
        sim.dimension,
        sim.work.asymmetry,
    )
