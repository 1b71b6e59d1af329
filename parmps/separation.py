"""Separation: walls at the air do not pull the liquid.

Liquid that is thrown past an edge, or off a wall, leaves it, and air comes in between. A wall that held it instead
would pull it round the edge: at a block in a dam break with -20 to -100 kPa, and do work on it. So pressure and wall
at the air satisfy Signorini's conditions of unilateral contact, p >= 0, v.n >= 0 and p v.n = 0: a wall particle with
liquid of the free surface in reach, which would pull, is separated, that is without links to the liquid, until liquid
comes back to it. Surface tension sigma holds it to the wall as long as that pulls less than (D - 1) sigma / l0, which
opens a gap of one spacing in radius (Young and Laplace). Walls without air in reach pull as strongly as the flow at the
place can make them.
"""

import numpy as np

from parmps.kernels import separation


def limit_tension(sim):
    """Bound the tension by Bernoulli's equation at the place: rho (v^2 / 2 + f L), L the tank's longest side.

    That is what a steady flow from a free surface has at most. What is beyond it is the ringing of particles that are
    jammed in a corner, a step of pressure and a step of tension, which fed a jet at a lid with 1700 m/s.
    """
    p, liquids = sim.particles, sim.liquids
    capillary = 0.0 if liquids.tension is None else float(liquids.tension.max()) / sim.l0
    capillary += float(_adhesion(sim).max())
    head = sim.force * max(sim.job.tank.size)
    flow = (p.velocity, p.kind, p.fluid, liquids.density, head, capillary)
    separation.limit_tension(*flow, *sim.pairs.wet, p.liquid, p.rows, p.pressure)


def let_go(sim):
    """Tell which walls at the air the liquid leaves or comes back to, by the pressure and velocity of this step.

    Their links are cut from the next step on; in this one, walls that would pull have no pressure.
    """
    p, w = sim.particles, sim.work
    flow = (p.position, w.intermediate, p.normal, p.kind, w.surface, w.force, sim.liquids.density, p.fluid)
    pairs = (*sim.pairs.wet, sim.l0, sim.scheme.radius, p.liquid, p.rows)
    separation.let_go(*flow, *pairs, _adhesion(sim), p.pressure, p.separated)


def _adhesion(sim):
    """Tension that opens a gap of one spacing in radius against the surface tension of each liquid, Pa: (liquids,)."""
    tension = sim.liquids.surface_tension
    return np.zeros(len(sim.liquids.density)) if tension is None else (sim.dimension - 1) * tension / sim.l0


def cut_links(sim):
    """Take the weight of the links to walls that the liquid has left."""
    separated = sim.particles.separated
    if not separated.any():
        return
    separation.cut_links(*sim.pairs.wet, separated, sim.strength)
    if sim.laplacian_strength is not sim.strength:
        separation.cut_links(*sim.pairs.wet, separated, sim.laplacian_strength)
