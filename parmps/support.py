"""Support: how far what is around a particle keeps it from moving on its own.

Divergence and pressure gradient both have the particle's own value times the first moment A of its neighbourhood, by
which pressure speeds a particle of velocity v up, by (v . A) A. Among its like, the pressure of the neighbours
outweighs that. It does not where they are lighter, nor beside a gap of a full tank before it is a free surface:
particles thrown into such tanks went from 1 to 26 m/s and more. So the less support a particle has, the less
its own velocity and pressure count for it, and the less its velocity changes where it is shifted.
"""

import numpy as np

from parmps.kernels import density, support
from parmps.liquids import Liquids


def matters(job):
    """Tell whether particles of a job can have little support.

    Parameters
    ----------
    job : Job

    Returns
    -------
    bool
    """
    fitted = job.scheme.gradient == "corrected" and job.scheme.position == "start"
    return fitted and (job.full or Liquids(job).sheet is not None)


def find_support(sim):
    """Find the particles of little support: beside gaps of a full tank, or in a lighter liquid.

    Beside a gap, support falls from whole at half the asymmetry of a free surface's particle to none at all of it.
    """
    p, w = sim.particles, sim.work
    w.support[:] = 1.0
    if sim.job.full:
        size = np.linalg.norm(w.asymmetry[: p.liquid], axis=1) / sim.lattice.asymmetry
        w.support[: p.liquid] = np.clip(2.0 - 2.0 * size, 0.0, 1.0)
    near = w.near_interface
    if near is not None:
        links = (near.index, *sim.pairs.wet, sim.strength)
        support.support_by_mass(p.kind, p.fluid, sim.liquids.share, *links, w.support)
        near.slipping = near.index[(near.slips[near.index] != 0) & (w.support[near.index] == 1.0)]
    w.weak = np.flatnonzero(w.support[: p.liquid] < 1.0).astype(np.int32)


def correct_flow(sim):
    """Set the velocity gradient, and with it the divergence, of particles of little support."""
    p, w = sim.particles, sim.work
    inverse, sums = np.empty((len(w.weak), 6)), np.empty((len(w.weak), 9))
    links = (w.weak, *sim.pairs.wet, sim.strength, sim.lattice.density, sim.dimension)
    support.flow_around(p.position, w.intermediate, w.support, *links, inverse, sums)
    density.invert(inverse, sim.scheme.divergence_floor, sim.dimension, inverse)
    support.solve_flow(w.weak, inverse, sums, w.gradient)
