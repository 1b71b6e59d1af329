"""What liquid does to walls: fields on wall particles, and sums over them that are linear in these fields."""

from parmps.kernels.compiled import compiled


@compiled
def wall_fields(pressure, density, surface, step, force, alpha, omega, out):
    """Pressure on the wall, whether there is liquid, and density, by wall particle.

    The pressure is that of the particle carried along the body force to the point of the wall that it belongs to.

    Parameters
    ----------
    pressure : (n,) float64, Pa
        Of wall particles; 0 where there is no liquid beside them.
    density : (n,) float64, kg/m3
        Of the liquid beside them.
    surface, step : (n, 3) float64, m
        The points on the wall, and the way there from the particles.
    force, alpha, omega : (3,) float64
        Body force in m/s2, angular acceleration in 1/s2 and angular velocity in 1/s of the tank, as in `FrameState`.
    out : (3, n) float64
        Filled with pressure (Pa), 1 where there is liquid and 0 elsewhere, and density.
    """
    a, b, c = alpha[0], alpha[1], alpha[2]
    p, q, r = omega[0], omega[1], omega[2]
    for i in range(len(pressure)):
        out[2, i] = density[i]
        if pressure[i] == 0.0:
            out[0, i] = out[1, i] = 0.0
            continue
        x, y, z = surface[i, 0], surface[i, 1], surface[i, 2]
        u, v, w = q * z - r * y, r * x - p * z, p * y - q * x
        fx = force[0] - (b * z - c * y) - (q * w - r * v)
        fy = force[1] - (c * x - a * z) - (r * u - p * w)
        fz = force[2] - (a * y - b * x) - (p * v - q * u)
        out[0, i] = pressure[i] + density[i] * (step[i, 0] * fx + step[i, 1] * fy + step[i, 2] * fz)
        out[1, i] = 1.0


@compiled
def linear_sums(start, place, weight, fields, out):
    """Sums of weights times fields: the product of a sparse matrix and a vector.

    Parameters
    ----------
    start : (sums + 1,) int64
        Where the entries of each sum begin, and the last ones end.
    place : (entries,) int64
        In the fields.
    weight : (entries,) float64
    fields : (fields n,) float64
        All fields, one behind the other.
    out : (sums,) float64
        Filled.
    """
    for row in range(len(out)):
        total = 0.0
        for k in range(start[row], start[row + 1]):
            total += weight[k] * fields[place[k]]
        out[row] = total


@compiled
def liquid_sums(position, pressure, kind, fluid, density, end, at, radius, out):
    """Sums over the liquid around a point, weighted by (1 - r^2 / R^2)^2.

    Parameters
    ----------
    position : (n, 3) float64, m
    pressure : (n,) float64, Pa
    kind, fluid : (n,) int8
    density : (liquids,) float64, kg/m3
    end : int
        Of the range of the liquid's particles.
    at : (3,) float64, m
    radius : float64, m
    out : (5,) float64
        Filled with the sums of weights, of pressures, and of density times the way from the point.
    """
    out[:] = 0.0
    limit = radius * radius
    for i in range(end):
        x, y, z = position[i, 0] - at[0], position[i, 1] - at[1], position[i, 2] - at[2]
        square = x * x + y * y + z * z
        if square >= limit or kind[i] != 0:
            continue
        weight = (1.0 - square / limit) ** 2
        mass = weight * density[fluid[i]]
        out[0] += weight
        out[1] += weight * pressure[i]
        out[2] += mass * x
        out[3] += mass * y
        out[4] += mass * z
