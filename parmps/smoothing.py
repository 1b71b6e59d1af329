"""Stages of several liquids in the papers' scheme ([000]), which smooths what jumps at their interfaces.

The viscosity between two liquids, the harmonic mean of theirs, is in the tables of `Liquids` and in both schemes.
"""

from parmps.interfaces import share_with_walls
from parmps.kernels import smoothing


def smooth_mass_density(sim):
    """Density of each particle, smoothed where liquids meet ([000] eq. 12); walls have that of the liquid next to them.

    Nothing but the pressure gradient and surface tension has it: the masses of the particles stay what they are.
    """
    p, w = sim.particles, sim.work
    density = sim.liquids.density
    w.mass_density[:] = density[p.fluid]
    smoothing.smooth_mass_density(
        p.position,
        p.kind,
        p.fluid,
        density,
        *sim.pairs.wet,
        sim.strength,
        sim.scheme.radius,
        p.liquid,
        w.mass_density,
        w.fraction,
    )
    share_with_walls(sim, w.mass_density)


def mass_density(sim, which):
    """Density by which forces per volume are divided.

    Parameters
    ----------
    sim : Simulation
    which : slice or (m,) int
        Of the particles.

    Returns
    -------
    float or (m,) float64, kg/m3
        A single number where all liquids have the same.
    """
    smooth = sim.work.mass_density
    return sim.liquids.reference if smooth is None else smooth[which]


def add_surface_tension(sim):
    """Add the change of velocity by the contoured continuum surface force ([000] eqs. 15 to 18).

    The paper prints no radius for the smoothed colour. The widest that there are neighbours for has the least noise.
    """
    p, s, w = sim.particles, sim.scheme, sim.work
    own = slice(0, p.liquid)
    smoothing.surface_force(
        p.position,
        p.kind,
        p.fluid,
        sim.liquids.tension,
        *sim.pairs.wet,
        sim.strength,
        sim.l0,
        max(s.radius, s.laplacian_radius),
        sim.lattice.density,
        sim.dimension,
        p.liquid,
        w.change,
    )
    energy = sim.ledger.kinetic(p, w.intermediate)
    velocity = w.intermediate[own].T
    velocity += w.change[own].T * (sim.dt / mass_density(sim, own))
    sim.ledger.book("tension", sim.ledger.kinetic(p, w.intermediate) - energy)
