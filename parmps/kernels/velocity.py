"""Body force, velocities at the walls, velocity gradient, and contacts of close particles."""

import math

import numpy as np
from numba import njit

from parmps.kernels.compiled import compiled
from parmps.kernels.density import times


@compiled
def body_force(position, velocity, kind, force, alpha, omega, out):
    """Force per mass in the moving tank frame: uniform part, Euler, centrifugal and Coriolis terms.

    f = force - alpha x r - omega x (omega x r) - 2 omega x v (Goldstein, Classical Mechanics, section 4.10).

    Parameters
    ----------
    position, velocity : (n, 3) float64, m and m/s
    kind : (n,) int8
    force : (3,) float64, m/s2
        Gravity less the acceleration of the tank's origin, in tank axes.
    alpha, omega : (3,) float64, rad/s2 and rad/s
    out : (n, 3) float64, m/s2
        Filled for fluid particles.
    """
    for i in range(position.shape[0]):
        if kind[i] != 0:
            continue
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        # omega x r + 2 v, to be turned once more by omega
        cx = omega[1] * z - omega[2] * y + 2.0 * velocity[i, 0]
        cy = omega[2] * x - omega[0] * z + 2.0 * velocity[i, 1]
        cz = omega[0] * y - omega[1] * x + 2.0 * velocity[i, 2]
        out[i, 0] = force[0] - (alpha[1] * z - alpha[2] * y) - (omega[1] * cz - omega[2] * cy)
        out[i, 1] = force[1] - (alpha[2] * x - alpha[0] * z) - (omega[2] * cx - omega[0] * cz)
        out[i, 2] = force[2] - (alpha[0] * y - alpha[1] * x) - (omega[0] * cy - omega[1] * cx)


@compiled
def greatest_speed(velocity, rows):
    """Greatest magnitude of the first velocities, infinite where one is not a finite number.

    Parameters
    ----------
    velocity : (n, 3) float64, m/s
    rows : int

    Returns
    -------
    float
        m/s.
    """
    greatest = total = 0.0
    for i in range(rows):
        square = velocity[i, 0] ** 2 + velocity[i, 1] ** 2 + velocity[i, 2] ** 2
        total += square
        greatest = max(greatest, square)
    return math.sqrt(greatest) if math.isfinite(total) else math.inf


@compiled
def predict(kind, velocity, last, force, limit, dt, out, intermediate):
    """Pressure acceleration grad P / rho to expect: the body force and what it last was beyond that, up to ``limit``.

    Parameters
    ----------
    kind : (n,) int8
    velocity : (n, 3) float64, m/s
    last, force : (n, 3) float64, m/s2
        The last grad P / rho less the body force of its time, and the present body force.
    limit : float
        m/s2.
    dt : float
        s.
    out : (n, 3) float64, m/s2
        Filled.
    intermediate : (n, 3) float64, m/s
        Filled: the velocity at the end of the step if the body force and ``out`` were all that acts; 0 but for fluid.
    """
    for i in range(out.shape[0]):
        size = math.sqrt(last[i, 0] ** 2 + last[i, 1] ** 2 + last[i, 2] ** 2)
        share = min(1.0, limit / max(size, 1e-300))
        for d in range(3):
            out[i, d] = force[i, d] + share * last[i, d]
            intermediate[i, d] = velocity[i, d] - dt * share * last[i, d] if kind[i] == 0 else 0.0


@compiled
def accelerate(intermediate, change, predicted, force, dt, rows, acceleration, velocity):
    """New velocity v = v* + change + dt (a - grad P / rho), and the next prediction of grad P / rho.

    That is the mean of this prediction a and what came of it: with the latter alone, rows next to a ragged
    surface would answer too strong a prediction with too weak a pressure, and swing with every step.

    Parameters
    ----------
    intermediate : (n, 3) float64, m/s
        v*.
    change : (rows, 3) float64, m/s
        By damping.
    predicted, force : (n, 3) float64, m/s2
        a, and the body force.
    dt : float
        s.
    rows : int
    acceleration : (n, 3) float64, m/s2
        grad P / rho; replaced by the next prediction less the body force.
    velocity : (n, 3) float64, m/s
        Filled for the rows.
    """
    for i in range(rows):
        for d in range(3):
            velocity[i, d] = intermediate[i, d] + change[i, d] + dt * (predicted[i, d] - acceleration[i, d])
            acceleration[i, d] = 0.5 * (acceleration[i, d] + predicted[i, d]) - force[i, d]


@njit(inline="always")
def ghost_ratio(depth, height, l0):
    """Speed beyond a wall's surface over that before it, reversed, of a velocity that is 0 on the surface.

    Parameters
    ----------
    depth, height : float, m
        Of the wall particle below the surface, and of the liquid above it.
    l0 : float
        Spacing, m.

    Returns
    -------
    float
        depth / height, at most 1.5: liquid that is too near a wall must not be thrown off.
    """
    return min(depth / max(height, 1e-3 * l0), 1.5)


@compiled
def reflect_at_walls(
    position, velocity, kind, normal, depth, first, last, other, strength, l0, begin, end, sticks, out
):
    """Velocity of wall particles that makes the wall impermeable, and frictionless or without slip.

    The liquid's velocity near the wall particle (weighted mean) with its normal component, or all of it, extrapolated
    linearly through zero at the wall's surface, so that a linear velocity field keeps its divergence.

    Parameters
    ----------
    position, velocity : (n, 3) float64, m and m/s
    kind : (n,) int8
    normal : (n, 3) float64
    depth : (n,) float64, m
        Of the wall particle below the wall's surface.
    first, last, other
        Neighbour lists.
    strength : (pairs,) float32, 1/m2
        W / r_ij^2, as made by `strengths`.
    l0 : float
        Spacing, m.
    begin, end : int
        Range of the wall particles.
    sticks : bool
        Whether the liquid does not slip.
    out : (n, 3) float64, m/s
        Filled for the range.
    """
    for i in range(begin, end):
        total = vx = vy = vz = height = 0.0
        for k in range(first[i], last[i]):
            j = other[k]
            if kind[j] != 0:
                continue
            dx = position[j, 0] - position[i, 0]
            dy = position[j, 1] - position[i, 1]
            dz = position[j, 2] - position[i, 2]
            w = strength[k] * (dx * dx + dy * dy + dz * dz)
            total += w
            vx += w * velocity[j, 0]
            vy += w * velocity[j, 1]
            vz += w * velocity[j, 2]
            height += w * (dx * normal[i, 0] + dy * normal[i, 1] + dz * normal[i, 2])
        out[i, 0] = out[i, 1] = out[i, 2] = 0.0
        if total > 0.0:
            vx, vy, vz = vx / total, vy / total, vz / total
            ratio = ghost_ratio(depth[i], height / total - depth[i], l0)
            if sticks:
                out[i, 0], out[i, 1], out[i, 2] = -ratio * vx, -ratio * vy, -ratio * vz
                continue
            back = (1.0 + ratio) * (vx * normal[i, 0] + vy * normal[i, 1] + vz * normal[i, 2])
            out[i, 0] = vx - back * normal[i, 0]
            out[i, 1] = vy - back * normal[i, 1]
            out[i, 2] = vz - back * normal[i, 2]


@compiled
def velocity_gradient(position, velocity, first, last, other, strength, inverse, n0, dimension, rows, out):
    """Corrected gradient of the velocity, exact for linear fields; its trace is the divergence.

    grad v = D/n0 sum (v_j - v_i) (M_i (r_j - r_i))^T W / r_ij^2, over fluid and wall particles (Duan 2018).

    Parameters
    ----------
    position, velocity : (n, 3) float64, m and m/s
    first, last, other
        Neighbour lists.
    strength : (pairs,) float32, 1/m2
        W / r_ij^2, as made by `strengths`.
    inverse : (rows, 6) float64
        M_i, as made by `invert`.
    n0 : float
    dimension, rows : int
    out : (n, 9) float64, 1/s
        Filled for the rows: dv_a/dx_b at 3 a + b.
    """
    scale = dimension / n0
    for i in range(rows):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        u, v, w = velocity[i, 0], velocity[i, 1], velocity[i, 2]
        uxx = uxy = uxz = vxx = vxy = vxz = wxx = wxy = wxz = 0.0
        for k in range(first[i], last[i]):
            j, s = other[k], strength[k]
            dx, dz = s * (position[j, 0] - x), s * (position[j, 2] - z)
            du, dw = velocity[j, 0] - u, velocity[j, 2] - w
            uxx += du * dx
            uxz += du * dz
            wxx += dw * dx
            wxz += dw * dz
            if dimension == 3:
                dy, dv = s * (position[j, 1] - y), velocity[j, 1] - v
                uxy += du * dy
                vxx += dv * dx
                vxy += dv * dy
                vxz += dv * dz
                wxy += dw * dy
        xx, xy, xz = scale * inverse[i, 0], scale * inverse[i, 1], scale * inverse[i, 2]
        yy, yz, zz = scale * inverse[i, 3], scale * inverse[i, 4], scale * inverse[i, 5]
        m = xx, xy, xz, yy, yz, zz
        out[i, 0], out[i, 1], out[i, 2] = times(m, uxx, uxy, uxz)
        out[i, 3], out[i, 4], out[i, 5] = times(m, vxx, vxy, vxz)
        out[i, 6], out[i, 7], out[i, 8] = times(m, wxx, wxy, wxz)


@compiled
def relax_volume(compression, gradient, slowest, per_strain, grid, fastest, divergence):
    """Take from the divergence what removes the volume error, faster where the flow deforms.

    Strain s = |sym grad v| disorders the particles, and the divergence, which weighs near pairs most, then vanishes
    while they take more room. The rate is ``per_strain`` s where s is well above that of waves of a spacing, and falls
    as s^2 below. It is the same from one measurement to the next: each change of the divergence takes an impulse of
    the pressure.

    Parameters
    ----------
    compression : (n,) float64
        Last measured volume error: density over that of the lattice, less 1.
    gradient : (n, 9) float64, 1/s
        Of the velocity.
    slowest : float, 1/s
        Least rate.
    per_strain : float
        Rate over s^2 / (s + sqrt(f / l0)).
    grid : float, 1/s
        sqrt(f / l0).
    fastest : float, 1/s
        Greatest rate.
    divergence : (rows,) float64, 1/s
        Changed.
    """
    for i in range(divergence.shape[0]):
        if compression[i] == 0.0:
            continue
        g = gradient[i]
        xy, xz, yz = g[1] + g[3], g[2] + g[6], g[5] + g[7]
        strain = math.sqrt(g[0] * g[0] + g[4] * g[4] + g[8] * g[8] + 0.5 * (xy * xy + xz * xz + yz * yz))
        rate = max(slowest, per_strain * strain * strain / max(strain + grid, 1e-300))
        divergence[i] -= compression[i] * min(rate, fastest)


@compiled
def add_contacts(
    position, velocity, kind, first, last, other, strength, within, least, dt, rows, out, fluid, share
):
    """Slow down fluid particles that would come nearer to each other than a least distance in this step.

    Those that are nearer already are stopped. Nothing rebounds.

    Every pair shares the impulse by mass; all pairs act at once, so that the order of the
    particles does not matter.

    Parameters
    ----------
    position, velocity : (n, 3) float64, m and m/s
    kind : (n,) int8
    first, last, other
        Neighbour lists.
    strength : (pairs,) float32, 1/m2
        W / r_ij^2, as made by `strengths`, which grows as the distance falls.
    within : float, 1/m2
        That of the distance up to which pairs are looked at.
    least : float, m
        The least distance.
    dt : float, s
    rows : int
    out : (n, 3) float64, m/s
        Velocity that is added to, for the rows.
    fluid, share
        As in `poisson_rows`.

    Returns
    -------
    int
        Number of contacts of the rows.
    """
    contacts = 0
    most = np.uint64(0)
    for i in range(rows):
        most = max(most, last[i] - first[i])
    near = np.empty(most, np.uint32)  # pairs of a particle with those that follow it: each is evaluated once
    for i in range(rows):
        count = np.uint64(0)
        for k in range(first[i], last[i]):  # without branches, which could not be predicted
            near[count] = other[k]
            count += np.uint64((strength[k] > within) & (other[k] > i))
        for m in range(count):
            j = near[m]
            if kind[j] != 0:
                continue
            dx = position[j, 0] - position[i, 0]
            dy = position[j, 1] - position[i, 1]
            dz = position[j, 2] - position[i, 2]
            closing = (
                (velocity[j, 0] - velocity[i, 0]) * dx
                + (velocity[j, 1] - velocity[i, 1]) * dy
                + (velocity[j, 2] - velocity[i, 2]) * dz
            )
            square = dx * dx + dy * dy + dz * dz
            excess = closing + max(square - least * math.sqrt(square), 0.0) / dt
            if excess < 0.0:
                contacts += 1
                here = excess / square * (0.5 if fluid is None else share[fluid[j], fluid[i]])
                out[i, 0] += here * dx
                out[i, 1] += here * dy
                out[i, 2] += here * dz
                if j < rows:
                    contacts += 1
                    there = excess / square * (0.5 if fluid is None else share[fluid[i], fluid[j]])
                    out[j, 0] -= there * dx
                    out[j, 1] -= there * dy
                    out[j, 2] -= there * dz
    return contacts
