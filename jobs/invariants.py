"""What must hold in any state of a simulation: what `make extremes` and `make hunt` look at."""

import numpy as np

from parmps.kernels.walls import distances
from parmps.kernels.weight import spline_weight
from parmps.particles import FLUID
from parmps.stages import smooth_density

INSIDE = 1 / 3
"""Share of the liquid that must be away from the surface for its volume to be judged."""


def broken_state(sim):
    """Tell what is broken in the present state: values, particles or walls.

    Parameters
    ----------
    sim : Simulation

    Returns
    -------
    None or str
    """
    p = sim.particles
    liquid = p.kind[: p.liquid] == FLUID
    arrays = p.position[: p.liquid], p.velocity[: p.liquid], p.pressure[: p.rows]
    finite = sim.domain.min(float(all(np.isfinite(a).all() for a in arrays)))
    if not finite:
        return "not finite"
    if sim.domain.sum(float(p.liquid)) != sim.totals["fluid"]:
        return "particles lost"
    at, walls = p.position[: p.liquid][liquid], sim.geometry.walls
    if walls.open_top:
        at = at[at[:, 2] <= walls.container[1, 2]]  # above the rim there are none
    if sim.domain.min(float(distances(at, walls)[0].min(initial=0.0))) < -1e-9 * sim.l0:
        return "a particle beyond a wall"
    return None


def energy_gain(sim, surface):
    """Energy beyond what was supplied, that of surfaces under tension included, over that of the liquid.

    Parameters
    ----------
    sim : Simulation
    surface : float
        Energy of surfaces at the start, as `surface_energy` told it, J.

    Returns
    -------
    float
    """
    drift, scale = sim.energy_drift(), sim.energy_scale + sim.largest_kinetic
    return (drift * scale + surface_energy(sim) - surface) / max(scale + surface, 1e-300)


def surface_energy(sim):
    """Energy of the interfaces and of the free surface, J (J/m in 2D): the tension times their area.

    That of interfaces is the integral of the colour's slope, which the papers' scheme has not.
    """
    w, energy = sim.work, 0.0
    if w.bend is not None:
        slope = np.linalg.norm(w.near_interface.normal[: sim.particles.liquid], axis=1)
        area = sim.domain.sum(float(slope.sum())) * sim.l0 ** (sim.dimension - 1)
        energy += float(sim.liquids.tension.max()) * area
    if w.above is not None:
        energy += float(sim.liquids.surface_tension.max()) * surface_area(sim)
    return energy


def surface_area(sim):
    """Area of the free surface, m2 (m in 2D): each of its particles has what its density along the surface leaves.

    As in `kernels.density.row_density`, walls continue the row, and what is above or below does not count.
    """
    p, w, (first, other) = sim.particles, sim.work, sim.pairs.lists
    row = np.flatnonzero(w.surface[: p.liquid])
    count = (first[row + 1] - first[row]).astype(int)
    mine = np.repeat(np.arange(len(row)), count)
    its = other[np.repeat(first[row], count) + np.arange(len(mine)) - np.repeat(np.cumsum(count) - count, count)]
    known = (p.kind[its] != FLUID) | (w.surface[its] != 0)
    mine, its = mine[known], its[known]
    apart = (p.position[its] - p.position[row[mine]]) / sim.l0
    up = np.abs(np.einsum("ij,ij->i", apart, w.surface_normal[row[mine]]))
    along = np.sqrt(np.maximum(np.einsum("ij,ij->i", apart, apart) - up**2, 0.0))
    share = np.clip(np.where(p.kind[its] == FLUID, 2.0 - 2.0 * up, 1.0 - up), 0.0, 1.0)
    reach = sim.scheme.radius
    density = spline_weight.py_func(0.0, reach) + np.bincount(
        mine, share * spline_weight.py_func(along, reach), len(row)
    )
    return sim.domain.sum(float((sim.lattice.row_density / density).sum())) * sim.l0 ** (sim.dimension - 1)


def volume(sim):
    """Relative excess of the volume; in spray there is no inside, where alone it is measured, and it counts as 0."""
    inside = sim.domain.sum(float(np.count_nonzero(smooth_density(sim)[1])))
    return sim.volume_drift() if inside > INSIDE * sim.totals["fluid"] else 0.0
