"""Surface tension at the free surface: the pressure that it gives the liquid there.

All liquids are one here; each has its own tension. The normals are fitted to the particles of the surface, not taken
from a smoothed density as those of interfaces are: nothing outside tells a place where particles are few from one
where the surface recedes, and a drop blew up within a quarter of its period. So there is no noise of the density to
smooth, either.
"""

import numpy as np

from parmps.kernels import surface


def find_surface_pressure(sim):
    """Pressure at the free surface, sigma times its curvature (Young and Laplace).

    The curvature is at most that of a drop of one spacing in radius.
    """
    p, w = sim.particles, sim.work
    index = np.flatnonzero((w.surface[: p.liquid] != 0) & (p.kind[: p.liquid] == 0)).astype(np.int32)
    w.surface_links.find(sim, index)
    images = (index, *w.surface_links.images, w.surface_links.strength)
    normal, bend = np.zeros((len(p), 3)), np.empty(len(index))
    surface.fit_normals(w.surface_normal, w.asymmetry, w.surface, *images, sim.dimension, normal)
    sim.domain.exchange(normal)
    surface.curvature(normal, *images, sim.surface_distance, sim.dimension, bend)
    most = (sim.dimension - 1) / sim.l0
    w.above[:] = 0.0
    w.above[index] = sim.liquids.surface_tension[p.fluid[index]] * np.clip(bend, -most, most)
    sim.domain.exchange(w.above)
    w.inward[:] = 0.0
    row = (index, *sim.pairs.wet, sim.l0, sim.scheme.radius, sim.lattice.row_density, w.inward)
    surface.crowd_out(p.position, p.kind, w.asymmetry, w.surface, normal, *row)
