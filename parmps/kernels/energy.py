"""Energy that each stage of a step gives the liquid or takes from it."""

import numpy as np
from numba import njit

from parmps.kernels.compiled import compiled

PRESSURE, IMPACTS, VOLUME, VISCOSITY, TENSION, CONTACTS, DAMPING, SHIFTING, SURFACE, WALLS, LEFT, WORK = range(12)
"""Places in what the kernels book."""


@njit(inline="always")
def work_along(x, y, z, field, dx, dy, dz):
    """Work per mass of a body force that is linear in the place, along a short way.

    Parameters
    ----------
    x, y, z : float
        Where the way begins, m.
    field : (4, 3) float64
        The force at the origin, m/s2, and the matrix T of force - r T, 1/s2.
    dx, dy, dz : float
        The way, m.

    Returns
    -------
    float
        J/kg.
    """
    fx = field[0, 0] - x * field[1, 0] - y * field[2, 0] - z * field[3, 0]
    fy = field[0, 1] - x * field[1, 1] - y * field[2, 1] - z * field[3, 1]
    fz = field[0, 2] - x * field[1, 2] - y * field[2, 2] - z * field[3, 2]
    return fx * dx + fy * dy + fz * dz


@compiled
def kinetic(velocity, kind, fluid, mass, rows):
    """Kinetic energy of the liquid.

    Parameters
    ----------
    velocity : (n, 3) float64, m/s
    kind, fluid : (n,) int8
    mass : (liquids,) float64, kg
    rows : int

    Returns
    -------
    float
        J.
    """
    total = 0.0
    for i in range(rows):
        if kind[i] == 0:
            u, v, w = velocity[i, 0], velocity[i, 1], velocity[i, 2]
            total += 0.5 * mass[fluid[i]] * (u * u + v * v + w * w)
    return total


@compiled
def book_acceleration(
    position, velocity, intermediate, change, predicted, force, gradient, pressure, expansion, kind, fluid, mass,
    volume, field, dt, rows, booked,
):  # fmt: skip
    """Book what damping, pressure and body force do to the velocity in `velocity.accelerate`, before it does so.

    With the body force f, a = f - grad P / rho and what it was, a', the liquid of mass m gets from both of them
    m a . (v + a dt / 2) dt, and from f alone m f . (v + a dt) dt along its way. What the pressure gives is the
    difference, of which -m a . (a - a') dt^2 / 2 is what impacts take: flow that meets a wall or other flow stops
    at once. See `parmps.energy`.

    Parameters
    ----------
    position : (n, 3) float64, m
    velocity, intermediate : (n, 3) float64, m/s
        v at the start of the step, and after all stages but these.
    change : (rows, 3) float64, m/s
        By damping.
    predicted, force, gradient : (n, 3) float64, m/s2
        The predicted grad P / rho, the body force, and grad P / rho.
    pressure : (n,) float64, Pa
    expansion : (rows,) float64, 1/s
        Divergence that the volume's error asks for.
    kind, fluid : (n,) int8
    mass, volume : (liquids,) float64, kg and m3
        Of a particle.
    field : (4, 3) float64
        As in `work_along`.
    dt : float
        s.
    rows : int
    booked : (12,) float64, J
        Added to.
    """
    pressed = damped = struck = grown = work = 0.0
    way = np.empty(3)
    for i in range(rows):
        if kind[i] != 0:
            continue
        m, predicting, damping, pressing, strike = mass[fluid[i]], 0.0, 0.0, 0.0, 0.0
        for d in range(3):
            v, u = velocity[i, d], intermediate[i, d]
            expected, changed = dt * (force[i, d] - predicted[i, d]), change[i, d]
            rest = dt * (predicted[i, d] - gradient[i, d])
            predicting += expected * (v + 0.5 * expected)
            damping += changed * (u + 0.5 * changed)
            pressing += rest * (u + changed + 0.5 * rest)
            strike += 0.5 * (expected + rest) * rest
            way[d] = dt * (u + changed + rest)
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        here = work_along(x, y, z, field, way[0], way[1], way[2])
        work += m * here
        damped += m * damping
        struck -= m * strike
        grown += volume[fluid[i]] * pressure[i] * expansion[i] * dt
        pressed += m * (predicting + pressing - here)
    booked[PRESSURE] += pressed - struck - grown
    booked[IMPACTS] += struck
    booked[VOLUME] += grown
    booked[DAMPING] += damped
    booked[WORK] += work


@compiled
def power(position, velocity, kind, fluid, mass, field, rows):
    """Power of the body force on liquid that moves.

    Parameters
    ----------
    position, velocity, kind, fluid, mass, field, rows
        As in `book_acceleration`.

    Returns
    -------
    float
        W.
    """
    total = 0.0
    for i in range(rows):
        if kind[i] == 0:
            x, y, z = position[i, 0], position[i, 1], position[i, 2]
            u, v, w = velocity[i, 0], velocity[i, 1], velocity[i, 2]
            total += mass[fluid[i]] * work_along(x, y, z, field, u, v, w)
    return total
