"""Surface tension at the free surface: its curvature, and the pressure that the liquid has at it."""

import numpy as np

from parmps.interfaces import SMOOTHINGS, Links
from parmps.kernels import interface, surface

NORMALS = 1

def find_surface_pressure(sim):
    """Pressure at the free surface, sigma times its curvature (Young and Laplace)."""
    p, w, near = sim.particles, sim.work, sim.work.near_surface
    found = np.flatnonzero((w.surface[: p.liquid] != 0) & (p.kind[: p.liquid] == 0))
    near.room[: len(found)] = found
    near.reset(len(found))
    links = Links(sim, near)
    images = (near.index, links.begin, links.index, links.offset, links.image, links.mirror, links.strength)
    surface.fit_normals(w.surface_normal, w.asymmetry, w.surface, *images, sim.dimension, near.normal)
    for _ in range(NORMALS):
        sim.domain.exchange(near.normal)
        surface.smooth_normals(near.normal.copy(), *images, near.normal)
    sim.domain.exchange(near.normal)
    bend = np.zeros(len(p))
    surface.curvature(near.normal, *images, sim.surface_distance, sim.dimension, bend)
    one = np.zeros_like(sim.liquids.viscosity, dtype=bool)
    weights = (links.begin, links.index, links.offset, links.strength, sim.scheme.radius)
    for _ in range(SMOOTHINGS):
        sim.domain.exchange(bend)
        interface.smooth_curvature(p.fluid, one, bend.copy(), near.normal, near.index, *weights, bend)
    w.above[:] = 0.0
    w.above[near.index] = sim.liquids.surface_tension[p.fluid[near.index]] * bend[near.index]
    sim.domain.exchange(w.above)
