"""Walls that liquid leaves: which they are, and the links that they no longer have."""

import math

from parmps.kernels.compiled import compiled
from parmps.kernels.weight import weight


@compiled
def limit_tension(velocity, kind, fluid, density, head, capillary, first, last, other, begin, end, pressure):
    """Bound the tension by rho (v^2 / 2 + head) + capillary: of a wall, with the fastest liquid that it is linked to.

    Parameters
    ----------
    velocity : (n, 3) float64, m/s
    kind, fluid : (n,) int8
    density : (liquids,) float64, kg/m3
    head : float, m2/s2
        Of the body force over the tank.
    capillary : float, Pa
        Tension that surface tension makes.
    first, last, other
        Neighbour lists.
    begin, end : int
        Range of the wall particles, after the liquid.
    pressure : (n,) float64, Pa
        Changed.
    """
    for i in range(end):
        if pressure[i] >= 0.0:
            continue
        least = 0.0
        if i < begin:
            u = velocity[i]
            least = -density[fluid[i]] * (0.5 * (u[0] * u[0] + u[1] * u[1] + u[2] * u[2]) + head)
        else:
            for k in range(first[i], last[i]):
                j = other[k]
                if kind[j] == 0:
                    u = velocity[j]
                    square = u[0] * u[0] + u[1] * u[1] + u[2] * u[2]
                    least = min(least, -density[fluid[j]] * (0.5 * square + head))
        pressure[i] = max(pressure[i], least - capillary)


@compiled
def let_go(
    position,
    velocity,
    normal,
    kind,
    surface,
    force,
    density,
    fluid,
    first,
    last,
    other,
    l0,
    reach,
    begin,
    end,
    adhesion,
    pressure,
    separated,
):
    """Tell which walls at the air liquid leaves, and which it comes back to.

    A wall particle that has liquid of the free surface near is at the air. It would pull where its pressure, carried by
    the body force to the liquid that it is linked to, is negative. Liquid comes back to a wall that it left where it
    moves towards it.

    Parameters
    ----------
    position, velocity : (n, 3) float64, m and m/s
    normal : (n, 3) float64
        Of walls, into the liquid.
    kind, surface : (n,) int8
    force : (n, 3) float64, m/s2
        Body force on the liquid.
    density : (liquids,) float64, kg/m3
    fluid : (n,) int8
    first, last, other
        Neighbour lists.
    l0, reach : float
        Spacing, m, and radius of the weight, in spacings.
    begin, end : int
        Range of the wall particles.
    adhesion : (liquids,) float64, Pa
        Tension that opens a gap of one spacing in radius against the surface tension.
    pressure : (n,) float64, Pa
        Changed: walls that would pull have none.
    separated : (n,) int8
        Changed for the range: 1 for walls that liquid has left.
    """
    for i in range(begin, end):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        total = jump = away = 0.0
        exposed = False
        for k in range(first[i], last[i]):
            j = other[k]
            if kind[j] != 0:
                continue
            dx, dy, dz = position[j, 0] - x, position[j, 1] - y, position[j, 2] - z
            # not from the strengths: those of separated walls are cut
            w = weight(math.sqrt(dx * dx + dy * dy + dz * dz) / l0, reach)
            total += w
            jump += w * density[fluid[j]] * (force[j, 0] * dx + force[j, 1] * dy + force[j, 2] * dz)
            jump += w * adhesion[fluid[j]]
            exposed |= surface[j] != 0
            u, v = velocity[j], normal[i]
            away += w * (u[0] * v[0] + u[1] * v[1] + u[2] * v[2])
        if separated[i] != 0:
            separated[i] = total > 0.0 and away >= 0.0
        elif exposed and total * pressure[i] + jump < 0.0:
            separated[i] = 1
            pressure[i] = 0.0


@compiled
def cut_links(first, last, other, separated, strength):
    """Take the weight of the links to walls that liquid has left.

    Parameters
    ----------
    first, last, other
        Neighbour lists.
    separated : (n,) int8
    strength : (pairs,) float32, 1/m2
        Changed.
    """
    for i in range(len(last)):
        for k in range(first[i], last[i]):
            if separated[i] != 0 or separated[other[k]] != 0:
                strength[k] = 0.0
