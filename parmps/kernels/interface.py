"""Interfaces between liquids."""

import math

import numpy as np
from numba import njit

from parmps.kernels.compiled import compiled
from parmps.kernels.density import inverse_of, times
from parmps.kernels.weight import smooth_weight, weight

LINKS_FLOOR = 0.2
"""Least eigenvalue of the moment matrices of links, where the mean of the eigenvalues is 1."""
PROFILE_FLOOR = 1e-3
"""Added to sqrt(1 - (2 c)^2) for a colour c that is all one liquid's, whose slope is rounding."""


@njit(inline="always")
def pressure_jump(tension, own_bend, its_bend):
    """Jump of the pressure from a particle of one liquid to one of another, sigma kappa (Young and Laplace), Pa.

    Parameters
    ----------
    tension : float, N/m
        Between the two liquids; 0 within one.
    own_bend, its_bend : float, 1/m
        Curvature of the interface at the two particles, each positive where its own liquid is convex.

    Returns
    -------
    float
    """
    return 0.5 * tension * (its_bend - own_bend)


@njit(inline="always")
def _length(x, y, z):
    return math.sqrt(x * x + y * y + z * z)


@compiled
def label_walls(position, first, other, kind, begin, end, fluid, nearest):
    """Give each wall particle the number of the liquid nearest to it.

    With one density on both ends, layers at rest have their exact pressure on the links to the wall, too.

    Parameters
    ----------
    position : (n, 3) float64, m
    first, other
        Neighbour lists.
    kind : (n,) int8
    begin, end : int
        Range of the wall particles.
    fluid : (n,) int8
        Number of each particle's liquid; filled for the range.
    nearest : (rows,) int32
        Filled for the range: the particle nearest to the wall particle, -1 for none.
    """
    for i in range(begin, end):
        least = math.inf
        nearest[i] = -1
        for k in range(first[i], first[i + 1]):
            j = other[k]
            if kind[j] != 0:
                continue
            dx = position[j, 0] - position[i, 0]
            dy = position[j, 1] - position[i, 1]
            dz = position[j, 2] - position[i, 2]
            r2 = dx * dx + dy * dy + dz * dz
            if r2 < least:
                least = r2
                fluid[i] = fluid[j]
                nearest[i] = j


@compiled
def find_near(first, last, other, kind, fluid, meeting, rows, state):
    """Tell the liquid particles that have a neighbour on the other side of an interface.

    Parameters
    ----------
    first, last, other
        Neighbour lists.
    kind, fluid : (n,) int8
    meeting : (liquids, liquids) int8
        Table of `Liquids`.
    rows : int
    state : (n,) int8
        Filled for the rows: the greatest of ``meeting`` with their neighbours.
    """
    for i in range(rows):
        mine = fluid[i]
        found = 0
        for k in range(first[i], last[i]):
            j = other[k]
            if fluid[j] != mine and kind[j] == 0:
                found = max(found, meeting[mine, fluid[j]])
        state[i] = found


@compiled
def list_near(first, last, other, kind, state, rows, room):
    """List the particles near interfaces, and those that take part in the curvature of interfaces under tension.

    These are the ones near such interfaces and their neighbours.

    Parameters
    ----------
    first, last, other, kind, rows
        As in `find_near`.
    state : (n,) int8
        As made by `find_near`.
    room : (rows,) int32
        Filled: first those that are near and take no part, then those that do both, then those that take part.

    Returns
    -------
    int, int, int
        How many of them there are.
    """
    part = np.zeros(rows, np.int8)
    for i in range(rows):
        tense = state[i] == 2
        for k in range(first[i], last[i] if kind[i] == 0 else first[i]):
            if state[other[k]] == 2:
                tense = True
                break
        part[i] = (2 if state[i] != 0 else 3) if tense else state[i]
    count = 0
    ends = np.zeros(4, np.int64)
    for group in range(1, 4):
        for i in range(rows):
            if part[i] == group:
                room[count] = i
                count += 1
        ends[group] = count
    return ends[1], ends[2] - ends[1], ends[3] - ends[2]


@compiled
def image_links(
    position, kind, normal, depth, near, first, last, other, reach, begin, index, offset, image, mirror, height
):
    """List the liquid neighbours of particles near interfaces, and those neighbours' images behind walls.

    With the images, interfaces stand at right angles on walls, whatever the arrangement of the wall's particles. As
    an image is further than its original, all images within reach are those of neighbours, or of the particle itself.
    In a corner, walls at right angles to each other mirror one after the other. A wall mirrors what is before it:
    beside a baffle's end, images would fall on their originals.

    Parameters
    ----------
    position : (n, 3) float64, m
    kind : (n,) int8
    normal, depth
        Of the walls, as in `reflect_at_walls`.
    near : (m,) int32
        The particles.
    first, last, other
        Neighbour lists.
    reach : float, m
    begin : (m + 1,) int64
        Filled: where the links of each particle begin.
    index : (capacity,) int32
        Filled: the neighbour, or the original of the image; there are at most 8 links a neighbour.
    offset : (3, capacity) float64, m
        Filled: the way to it.
    image : (capacity,) int8
        Filled: 0 for a neighbour, bit b for an image made by wall b.
    mirror : (m, 3, 3) float64
        Filled: normals of the walls that there are, into the liquid.
    height : (m, 3) float64, m
        Filled: those of the particle above these walls.
    """
    count = 0
    begin[0] = 0
    x, y, z = offset[0], offset[1], offset[2]
    reach2 = reach * reach
    for a in range(near.shape[0]):
        i = near[a]
        beside = last[i]  # walls follow the liquid
        for k in range(first[i], last[i]):
            j = other[k]
            if kind[j] != 0:
                beside = k
                break
            x[count] = position[j, 0] - position[i, 0]
            y[count] = position[j, 1] - position[i, 1]
            z[count] = position[j, 2] - position[i, 2]
            index[count], image[count] = j, 0
            count += x[count] * x[count] + y[count] * y[count] + z[count] * z[count] < reach2
        for wall in range(3 if beside < last[i] else 0):
            least = math.inf
            n = mirror[a, wall]
            for k in range(beside, last[i]):
                j = other[k]
                if _parallel(normal[j], mirror[a], wall):
                    continue
                dx = position[j, 0] - position[i, 0]
                dy = position[j, 1] - position[i, 1]
                dz = position[j, 2] - position[i, 2]
                r2 = dx * dx + dy * dy + dz * dz
                above = -(dx * normal[j, 0] + dy * normal[j, 1] + dz * normal[j, 2]) - depth[j]
                if r2 < least and above > 0.05 * reach:
                    least, height[a, wall] = r2, above
                    n[0], n[1], n[2] = normal[j, 0], normal[j, 1], normal[j, 2]
            if least == math.inf:
                break
            for k in range(begin[a] - 1, count):
                dx = dy = dz = 0.0
                original, made = i, 0
                if k >= begin[a]:
                    dx, dy, dz = x[k], y[k], z[k]
                    original, made = index[k], image[k]
                far = 2.0 * (height[a, wall] + dx * n[0] + dy * n[1] + dz * n[2])
                if far < 0.1 * reach:
                    continue
                dx, dy, dz = dx - far * n[0], dy - far * n[1], dz - far * n[2]
                if dx * dx + dy * dy + dz * dz < reach2:
                    index[count], image[count] = original, made | (1 << wall)
                    x[count], y[count], z[count] = dx, dy, dz
                    count += 1
        begin[a + 1] = count


@njit(inline="always")
def _parallel(normal, walls, count):
    """Whether a normal is not at right angles to the first walls' normals."""
    for wall in range(count):
        n = walls[wall]
        if abs(normal[0] * n[0] + normal[1] * n[1] + normal[2] * n[2]) > 0.1:
            return True
    return False


@njit(inline="always")
def mirrored(x, y, z, image, walls):
    """Vector of a particle as its image has it: image bits and walls' normals as made by `image_links`."""
    for wall in range(3):
        if image & (1 << wall):
            n = walls[wall]
            across = 2.0 * (x * n[0] + y * n[1] + z * n[2])
            x, y, z = x - across * n[0], y - across * n[1], z - across * n[2]
    return x, y, z


@njit(inline="always")
def _tilted(x, y, z, tilt, image, walls):
    """Mirrored unit normal of an image, turned by the walls that made it: by twice the tilt.

    So the mean of the original's and the image's angles is the wetting angle, whatever the noise; normals tilted by a
    sum of vectors were, where noisy, on the mean beyond it, and a straight interface at 30 degrees curved by 5. Less
    where the normal is almost across the wall and hardly tells which way to turn.
    """
    for wall in range(3):
        if image & (1 << wall):
            n = walls[wall]
            up = x * n[0] + y * n[1] + z * n[2]
            x, y, z = x - up * n[0], y - up * n[1], z - up * n[2]
            along = _length(x, y, z) + 1e-300
            angle = 2.0 * tilt * min(1.0, 2.0 * along / math.cos(tilt))
            cosine, sine = math.cos(angle), math.sin(angle)
            size, up = cosine - sine * up / along, cosine * up + sine * along
            x, y, z = size * x + up * n[0], size * y + up * n[1], size * z + up * n[2]
    return x, y, z


@compiled
def link_weights(offset, count, l0, reach, strength):
    """Weights of links over their squared lengths, W / r^2.

    Parameters
    ----------
    offset : (3, capacity) float64, m
        As made by `image_links`.
    count : int
        Number of links.
    l0 : float
        Spacing, m.
    reach : float
        In spacings.
    strength : (capacity,) float64, 1/m2
        Filled.
    """
    x, y, z = offset[0], offset[1], offset[2]
    for k in range(count):
        r2 = x[k] * x[k] + y[k] * y[k] + z[k] * z[k]
        strength[k] = weight(math.sqrt(r2) / l0, reach) / r2


@compiled
def tell_sides(fluid, sheet, near, begin, index, offset, l0, reach, side, share, own, colour):
    """Tell the links across an interface, weigh all for smoothing by the smooth weight, and smooth the colour once.

    Parameters
    ----------
    fluid : (n,) int8
    sheet
        Table of `Liquids`.
    near : (m,) int32
        Particles near an interface.
    begin, index, offset
        As made by `image_links`.
    l0 : float
        Spacing, m.
    reach : float
        In spacings.
    side : (capacity,) float64
        Filled: -1 for links to another liquid, 1 for others.
    share : (capacity,) float64
        Filled: what each link has in the smoothed value, negative for other liquids (see `smooth`).
    own : (m,) float64
        Filled: what the particle itself has.
    colour : (n,) float64
        Filled for those particles: the share of the own liquid in the neighbourhood, less a half. It is 1/2 away from
        interfaces, 0 on them, and for a neighbour in another liquid the reverse of its own.
    """
    x, y, z = offset[0], offset[1], offset[2]
    for k in range(begin[near.shape[0]]):
        share[k] = smooth_weight(math.sqrt(x[k] * x[k] + y[k] * y[k] + z[k] * z[k]) / l0, reach)
    for a in range(near.shape[0]):
        mine = fluid[near[a]]
        total = value = 1.0
        for k in range(begin[a], begin[a + 1]):
            side[k] = -1.0 if sheet[mine, fluid[index[k]]] else 1.0
            total += share[k]
            share[k] *= side[k]
            value += share[k]
        own[a] = 1.0 / total
        for k in range(begin[a], begin[a + 1]):
            share[k] *= own[a]
        colour[near[a]] = 0.5 * own[a] * value


@compiled
def smooth(near, begin, index, share, own, lift, values):
    """Smooth values that are reversed across interfaces: the colour function, or the curvature.

    Parameters
    ----------
    near : (m,) int32
        The particles.
    begin, index
        As made by `image_links`.
    share, own
        As made by `tell_sides` or `curvature`.
    lift : None or (capacity,) float64
        What images have more than their originals, as made by `lift_images`; None for nothing.
    values : (n,) float64
        Changed for those particles.
    """
    fresh = np.empty(near.shape[0])
    for a in range(near.shape[0]):
        value = own[a] * values[near[a]]
        for k in range(begin[a], begin[a + 1]):
            if lift is None:
                value += share[k] * values[index[k]]
            else:
                value += share[k] * (values[index[k]] + lift[k])
        fresh[a] = value
    for a in range(near.shape[0]):
        values[near[a]] = fresh[a]


@compiled
def normals(colour, lift, near, begin, offset, index, side, strength, l0, dimension, out):
    """Normals of the interface, out of each particle's own liquid.

    They are as long as the colour function is steep: short where they are not certain, as in the middle of a thin
    layer.

    Parameters
    ----------
    colour : (n,) float64
        As made by `tell_sides`.
    lift
        As in `smooth`.
    near, begin, index, offset
        As in `image_links`.
    side : (capacity,) float64
        As made by `tell_sides`.
    strength : (capacity,) float64, 1/m2
        As made by `link_weights`.
    l0 : float
        Spacing, m.
    dimension : int
    out : (n, 3) float64, 1/spacings
        Filled for those particles.
    """
    x, y, z = offset[0], offset[1], offset[2]
    for a in range(near.shape[0]):
        i = near[a]
        here = colour[i]
        gx = gy = gz = 0.0
        xx = xy = xz = yy = yz = zz = 0.0
        for k in range(begin[a], begin[a + 1]):
            dx, dz = x[k], z[k]
            sx, sz = strength[k] * dx, strength[k] * dz
            drop = here - side[k] * colour[index[k]]
            if lift is not None:
                drop -= side[k] * lift[k]
            xx += sx * dx
            xz += sx * dz
            zz += sz * dz
            gx += drop * sx
            gz += drop * sz
            if dimension == 3:
                dy = y[k]
                sy = strength[k] * dy
                xy += sx * dy
                yy += sy * dy
                yz += sy * dz
                gy += drop * sy
        total = xx + yy + zz
        if total == 0.0:
            out[i, 0] = out[i, 1] = out[i, 2] = 0.0
            continue
        c = dimension / total
        m = inverse_of(c * xx, c * xy, c * xz, c * yy, c * yz, c * zz, LINKS_FLOOR, dimension)
        c *= l0
        gx, gy, gz = times(m, gx, gy, gz)
        out[i, 0], out[i, 1], out[i, 2] = c * gx, c * gy, c * gz


@compiled
def tell_tilt(fluid, wetting, near, begin, index, side, strength, tilt):
    """Tell how far walls turn interfaces: as the liquids across ask for, or else as for the neighbours.

    Parameters
    ----------
    fluid : (n,) int8
    wetting : (liquids, liquids) float64, rad
        Table of `Liquids`.
    near, begin, index, side, strength
        As in `normals`.
    tilt : (n,) float64, rad
        Changed for those particles: a right angle less the wetting angle inside the own liquid; 0 for not known.
    """
    fresh = np.empty(near.shape[0])
    for a in range(near.shape[0]):
        mine = fluid[near[a]]
        total = value = beside = within = 0.0
        for k in range(begin[a], begin[a + 1]):
            j = index[k]
            if side[k] < 0.0:
                total += strength[k]
                value += strength[k] * wetting[mine, fluid[j]]
            elif tilt[j] != 0.0:
                beside += strength[k]
                within += strength[k] * tilt[j]
        if total > 0.0:
            fresh[a] = value / total
        else:
            fresh[a] = within / beside if beside > 0.0 else 0.0
    for a in range(near.shape[0]):
        tilt[near[a]] = fresh[a]


@compiled
def lift_images(colour, normal, tilt, near, begin, index, offset, image, mirror, height, l0, out):
    """How much more of the own colour images have than their originals, so that interfaces meet walls at an angle.

    Where contours of the colour c meet a wall at the angle theta inside the own liquid, -grad c is along n = n_wall
    cos theta + n_t sin theta, with n_wall into the liquid and n_t along the wall (Brackbill, Kothe & Zemach 1992, wall
    adhesion): into the wall, c rises by cot theta |grad_t c|, and an image is twice its original's height deeper. The
    slope is not the same all that way. Across a smoothed interface the colour is about half the sine of a phase that
    rises evenly, so the phase is continued: by the slope over the square root of 1 - (2 c)^2, and to where the colour
    is all one liquid's. With the original's slope alone, drops met the floor at 63 and 117 instead of 60 and 120
    degrees. Where an interface runs along a wall and does not meet it, images are plain ones.

    Parameters
    ----------
    colour : (n,) float64
        As made by `tell_sides`.
    normal : (n, 3) float64, 1/spacings
        As made by `normals` of this colour.
    tilt : (n,) float64, rad
        As made by `tell_tilt`.
    near, begin, index, offset, image, mirror, height
        As in `image_links`.
    l0 : float
        Spacing, m.
    out : (capacity,) float64
        Filled.
    """
    for a in range(near.shape[0]):
        for k in range(begin[a], begin[a + 1]):
            out[k] = 0.0
            if image[k] == 0:
                continue
            j = index[k]
            x, y, z = normal[j, 0], normal[j, 1], normal[j, 2]
            rise = 0.0
            for wall in range(3):
                if image[k] & (1 << wall):
                    n = mirror[a, wall]
                    up = x * n[0] + y * n[1] + z * n[2]
                    deep = height[a, wall] + offset[0, k] * n[0] + offset[1, k] * n[1] + offset[2, k] * n[2]
                    rise -= 2.0 * deep / l0 * math.tan(tilt[j]) * _length(x - up * n[0], y - up * n[1], z - up * n[2])
            twice = min(max(2.0 * colour[j], -1.0), 1.0)
            phase = math.asin(twice) + 2.0 * rise / (math.sqrt(1.0 - twice * twice) + PROFILE_FLOOR)
            out[k] = 0.5 * math.sin(min(max(phase, -0.5 * math.pi), 0.5 * math.pi)) - colour[j]


@compiled
def moment_beyond(near, begin, offset, image, side, strength, slips, l0, out):
    """First moment of what lies beyond the interface, where the liquids slip.

    Parameters
    ----------
    near, begin, offset, image, side, strength, l0
        As in `normals`.
    slips : (n,) int8
        As made by `find_slip`.
    out : (rows, 3) float64
        Filled for those particles: sum W (r_j - r_i) / r_ij^2 over the other liquids, in 1/spacings.
    """
    for a in range(near.shape[0]):
        i = near[a]
        qx = qy = qz = 0.0
        for k in range(begin[a], begin[a + 1] if slips[i] else begin[a]):
            s = strength[k] if side[k] < 0.0 and image[k] == 0 else 0.0
            qx += s * offset[0, k]
            qy += s * offset[1, k]
            qz += s * offset[2, k]
        out[i, 0], out[i, 1], out[i, 2] = l0 * qx, l0 * qy, l0 * qz


@compiled
def find_slip(velocity, kind, fluid, sheet, near, first, last, other, limit, slips):
    """Tell the particles near interfaces whose liquid slides along the other one slowly enough to do so as a sheet.

    Parameters
    ----------
    velocity : (n, 3) float64, m/s
    kind, fluid, sheet, near, first, last, other
        As in `own_gradient`.
    limit : float, m/s
        Greatest difference between the mean velocities of a particle's neighbours in its own liquid and in others.
    slips : (n,) int8
        Filled for those particles: 1 where the difference is no greater.
    """
    for i in near:
        mine = fluid[i]
        ox, oy, oz = velocity[i, 0], velocity[i, 1], velocity[i, 2]
        bx = by = bz = 0.0
        within, across = 1.0, 0.0
        for k in range(first[i], last[i]):  # without branches, which could not be predicted
            j = other[k]
            liquid = 1.0 if kind[j] == 0 else 0.0
            theirs = liquid if sheet[mine, fluid[j]] else 0.0
            ours = liquid - theirs
            u, v, w = velocity[j, 0], velocity[j, 1], velocity[j, 2]
            across += theirs
            bx += theirs * u
            by += theirs * v
            bz += theirs * w
            within += ours
            ox += ours * u
            oy += ours * v
            oz += ours * w
        a, b = 1.0 / within, 1.0 / max(across, 1.0)
        slips[i] = _length(a * ox - b * bx, a * oy - b * by, a * oz - b * bz) <= limit


@compiled
def own_gradient(
    position, velocity, kind, fluid, slips, sheet, near, first, last, other, strength, floor, n0, dimension, out
):
    """Gradient of the velocity of a particle's own liquid, which can jump at the interface.

    Parameters
    ----------
    position, velocity, kind, fluid, first, last, other, strength
        As in `velocity_gradient`.
    slips : (n,) int8
        As made by `find_slip`; other liquids count as the own one unless both particles slip.
    sheet
        Table of `Liquids`.
    near : (m,) int32
        The particles, all of which slip.
    floor : float
        Least eigenvalue of the moment matrices.
    n0 : float
    dimension : int
    out : (n, 9) float64, 1/s
        Filled for those particles, as in `velocity_gradient`.
    """
    scale = dimension / n0
    for i in near:
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        u, v, w = velocity[i, 0], velocity[i, 1], velocity[i, 2]
        mine = fluid[i]
        xx = xy = xz = yy = yz = zz = 0.0
        uxx = uxy = uxz = vxx = vxy = vxz = wxx = wxy = wxz = 0.0
        for k in range(first[i], last[i]):
            j = other[k]
            across = (kind[j] == 0) & (slips[j] != 0) & sheet[mine, fluid[j]]
            s = 0.0 if across else scale * strength[k]
            dx, dz = position[j, 0] - x, position[j, 2] - z
            du, dw = velocity[j, 0] - u, velocity[j, 2] - w
            sx, sz = s * dx, s * dz
            xx += sx * dx
            xz += sx * dz
            zz += sz * dz
            uxx += du * sx
            uxz += du * sz
            wxx += dw * sx
            wxz += dw * sz
            if dimension == 3:
                dy, dv = position[j, 1] - y, velocity[j, 1] - v
                sy = s * dy
                xy += sx * dy
                yy += sy * dy
                yz += sy * dz
                uxy += du * sy
                vxx += dv * sx
                vxy += dv * sy
                vxz += dv * sz
                wxy += dw * sy
        m = inverse_of(xx, xy, xz, yy, yz, zz, floor, dimension)
        out[i, 0], out[i, 1], out[i, 2] = times(m, uxx, uxy, uxz)
        out[i, 3], out[i, 4], out[i, 5] = times(m, vxx, vxy, vxz)
        out[i, 6], out[i, 7], out[i, 8] = times(m, wxx, wxy, wxz)


@compiled
def divergence(
    position,
    velocity,
    gradient,
    kind,
    fluid,
    slips,
    sheet,
    normal,
    near,
    first,
    last,
    other,
    strength,
    inverse,
    n0,
    dimension,
    out,
):
    """Divergence of the velocity at an interface, where its tangential part jumps and its normal part has a kink.

    On a link to another liquid the tangential difference is what the own gradient says, and the normal one
    that of twice the way to the interface, in the middle of the link: the mean of what the two sides' gradients
    say there, n . [v_j - v_i + (grad v_i - grad v_j)(r_j - r_i) / 2].

    Parameters
    ----------
    position, velocity, kind, fluid, slips, sheet, near, first, last, other, strength, n0, dimension
        As in `own_gradient`.
    gradient : (n, 9) float64, 1/s
        Of each particle's own liquid.
    normal : (n, 3) float64
        As made by `normals`.
    inverse : (rows, 6) float64
        Inverse moment matrices of all neighbours.
    out : (rows,) float64, 1/s
        Filled for those particles.
    """
    scale = dimension / n0
    for i in near:
        total = 0.0
        m, g, n = inverse[i], gradient[i], normal[i]
        for k in range(first[i], last[i]):
            j = other[k]
            dx = position[j, 0] - position[i, 0]
            dy = position[j, 1] - position[i, 1]
            dz = position[j, 2] - position[i, 2]
            u = velocity[j, 0] - velocity[i, 0]
            v = velocity[j, 1] - velocity[i, 1]
            w = velocity[j, 2] - velocity[i, 2]
            if kind[j] == 0 and slips[j] != 0 and sheet[fluid[i], fluid[j]]:
                h = gradient[j]
                ox = g[0] * dx + g[1] * dy + g[2] * dz
                oy = g[3] * dx + g[4] * dy + g[5] * dz
                oz = g[6] * dx + g[7] * dy + g[8] * dz
                # beyond what the own gradient says: the normal part alone
                u -= 0.5 * (ox + h[0] * dx + h[1] * dy + h[2] * dz)
                v -= 0.5 * (oy + h[3] * dx + h[4] * dy + h[5] * dz)
                w -= 0.5 * (oz + h[6] * dx + h[7] * dy + h[8] * dz)
                nx, ny, nz = n[0] - normal[j, 0], n[1] - normal[j, 1], n[2] - normal[j, 2]
                along = (u * nx + v * ny + w * nz) / (nx * nx + ny * ny + nz * nz + 1e-300)
                u = ox + along * nx
                v = oy + along * ny
                w = oz + along * nz
            s = scale * strength[k]
            total += s * (
                u * (m[0] * dx + m[1] * dy + m[2] * dz)
                + v * (m[1] * dx + m[3] * dy + m[4] * dz)
                + w * (m[2] * dx + m[4] * dy + m[5] * dz)
            )
        out[i] = total


@compiled
def pressure_gradient(
    position,
    pressure,
    force,
    kind,
    surface,
    lean,
    density,
    support,
    near,
    first,
    last,
    other,
    strength,
    l0,
    surface_distance,
    n0,
    dimension,
    floor,
    out,
    fluid,
    volume,
    tension,
    bend,
    normal,
    above,
):
    """Acceleration grad P / rho at an interface, where its tangential part jumps with the density.

    Least squares for the acceleration a of the own liquid beyond the body force f: on a link of volume b the
    pressure says b (P_j - P_i) = (f + a') . d', where d' is d with its part along the interface multiplied by
    b rho_i, since P itself is continuous there. Where surface tension makes it jump, the jump changes along the
    interface: what continues the own side to the neighbour is P_j with the jump there, not that in the middle of the
    link, which the pressure equation has. The difference acts along the interface. Particles of little support take
    part in no jump, and their own pressure hardly counts, as in `support.flow_around`.

    Parameters
    ----------
    position, kind, near, first, last, other, strength, n0, dimension
        As in `divergence`.
    l0, surface_distance : float
        Spacing, and distance from surface particles to the free surface, m.
    pressure : (n,) float64, Pa
    force : (n, 3) float64, m/s2
        Of fluid particles.
    surface, lean
        As in `corrected_gradient`.
    density : float, kg/m3
        Of the liquid, or the reference density of ``volume``.
    support : (n,) float64
        1 but for particles of little support.
    floor : float
        Least eigenvalue of the moment matrices.
    out : (n, 3) float64, m/s2
        Filled for those particles.
    fluid, volume, tension, bend
        As in `poisson_rows`.
    normal : None or (n, 3) float64
        As made by `normals`; None for a single liquid.
    above
        As in `poisson_rows`.
    """
    scale = dimension / n0
    per, per_pressure = 1.0 / l0, 1.0 / (density * l0)
    for i in near:
        xx = xy = xz = yy = yz = zz = gx = gy = gz = mx = my = mz = mean = 0.0
        total = 1e-300
        here = pressure[i]
        own = b = 1.0
        mine = its = 0
        if fluid is not None:
            mine = fluid[i]
            own = volume[mine, mine]
        for k in range(first[i], last[i]):
            j = other[k]
            dx = (position[j, 0] - position[i, 0]) * per
            dy = (position[j, 1] - position[i, 1]) * per
            dz = (position[j, 2] - position[i, 2]) * per
            there = pressure[j]
            if fluid is not None:
                its = fluid[j]
                b = volume[mine, its]
                if tension is not None and mine != its:
                    there -= pressure_jump(tension[mine, its], bend[i], bend[j])
            if normal is not None and kind[j] == 0 and mine != its and support[i] == 1.0:
                nx = normal[i, 0] - normal[j, 0]
                ny = normal[i, 1] - normal[j, 1]
                nz = normal[i, 2] - normal[j, 2]
                along = (dx * nx + dy * ny + dz * nz) / (nx * nx + ny * ny + nz * nz + 1e-300)
                t = b / own
                if tension is not None:  # from the middle of the link, where the jump is taken, to its end
                    rest = -0.5 * tension[mine, its] * (bend[i] + bend[j]) * b * per_pressure
                    rest *= scale * l0 * l0 * strength[k] * t
                    gx += rest * (dx - along * nx)
                    gy += rest * (dy - along * ny)
                    gz += rest * (dz - along * nz)
                dx = t * dx + (1.0 - t) * along * nx
                dy = t * dy + (1.0 - t) * along * ny
                dz = t * dz + (1.0 - t) * along * nz
            q = b * (there - here) * per_pressure - force[i, 0] * dx - force[i, 1] * dy - force[i, 2] * dz
            s = scale * l0 * l0 * strength[k]
            total += s
            mean += s * q
            mx += s * dx
            my += s * dy
            mz += s * dz
            gx += s * q * dx
            gy += s * q * dy
            gz += s * q * dz
            xx += s * dx * dx
            xy += s * dx * dy
            xz += s * dx * dz
            yy += s * dy * dy
            yz += s * dy * dz
            zz += s * dz * dz
        if surface[i] != 0:
            qx, qy, qz = lean[i, 0], lean[i, 1], lean[i, 2]
            size = math.sqrt(qx * qx + qy * qy + qz * qz) + 1e-300
            s = scale / size
            drop = here
            if above is not None:
                drop -= above[i]
            q = -own * drop * size / (density * surface_distance)
            q -= force[i, 0] * qx + force[i, 1] * qy + force[i, 2] * qz
            total += s
            mean += s * q
            mx += s * qx
            my += s * qy
            mz += s * qz
            gx += s * q * qx
            gy += s * q * qy
            gz += s * q * qz
            xx += s * qx * qx
            xy += s * qx * qy
            xz += s * qx * qz
            yy += s * qy * qy
            yz += s * qy * qz
            zz += s * qz * qz
        free = (1.0 - support[i]) / total
        xx, xy, xz = xx - free * mx * mx, xy - free * mx * my, xz - free * mx * mz
        yy, yz, zz = yy - free * my * my, yz - free * my * mz, zz - free * mz * mz
        gx, gy, gz = gx - free * mean * mx, gy - free * mean * my, gz - free * mean * mz
        m = inverse_of(xx, xy, xz, yy, yz, zz, floor, dimension)
        out[i, 0] = force[i, 0] + m[0] * gx + m[1] * gy + m[2] * gz
        out[i, 1] = force[i, 1] + m[1] * gx + m[3] * gy + m[4] * gz
        out[i, 2] = force[i, 2] + m[2] * gx + m[4] * gy + m[5] * gz


@compiled
def hold_shifting(
    position,
    kind,
    surface,
    fluid,
    sheet,
    normal,
    near,
    first,
    last,
    other,
    strength,
    share,
    together,
    uncertain,
    n0,
    dimension,
    asymmetry,
):
    """Leave of the asymmetry, as in `moments`, the own liquid's part along the interface, and shares of it across.

    Across, the mean of both sides, each of which has half the say, would move the interface; what differs from it
    closes gaps between the liquids and evens out their rows.

    Parameters
    ----------
    surface : (n,) int8
        Particles in the surface do not count in that mean.
    position, kind, fluid, sheet, near, first, last, other, strength, n0, dimension
        As in `own_gradient`.
    normal : (n, 3) float64
        As made by `normals`.
    share, together : float
        Shares of what differs and of the mean.
    uncertain : float
        Length of a normal below which it says little: the other liquid counts, too, and across it there is more.
    asymmetry : (n, 3) float64
        Changed for those particles.
    """
    scale = dimension / n0
    fresh = np.empty((near.shape[0], 3))
    for a in range(near.shape[0]):
        i = near[a]
        mine = fluid[i]
        nx, ny, nz = normal[i, 0], normal[i, 1], normal[i, 2]
        ox = oy = oz = 0.0
        ours = theirs = within = across = 0.0
        for k in range(first[i], last[i]):
            j = other[k]
            if kind[j] != 0:
                continue
            dx = position[j, 0] - position[i, 0]
            dy = position[j, 1] - position[i, 1]
            dz = position[j, 2] - position[i, 2]
            r = _length(dx, dy, dz)
            s = scale * strength[k] * r
            part = s * r if surface[j] == 0 else 0.0
            there = part * (asymmetry[j, 0] * nx + asymmetry[j, 1] * ny + asymmetry[j, 2] * nz)
            if sheet[mine, fluid[j]]:
                ox -= s * dx
                oy -= s * dy
                oz -= s * dz
                theirs += part
                across += there
            else:
                ours += part
                within += there
        wx, wy, wz = asymmetry[i, 0], asymmetry[i, 1], asymmetry[i, 2]
        steep2 = nx * nx + ny * ny + nz * nz
        bound = max(steep2, uncertain * uncertain)
        certain = steep2 / bound
        common = 0.5 * (within / (ours + 1e-300) + across / (theirs + 1e-300))
        here = wx * nx + wy * ny + wz * nz
        along = ox * nx + oy * ny + oz * nz - here + share * (here - common) + together * common
        along /= bound
        fresh[a, 0] = wx - certain * ox + along * nx
        fresh[a, 1] = wy - certain * oy + along * ny
        fresh[a, 2] = wz - certain * oz + along * nz
    for a in range(near.shape[0]):
        i = near[a]
        asymmetry[i, 0], asymmetry[i, 1], asymmetry[i, 2] = fresh[a, 0], fresh[a, 1], fresh[a, 2]


@compiled
def curvature(
    normal, tilt, near, begin, index, offset, image, mirror, side, strength, reach, dimension, share, own, out
):
    """Curvature of the interface near each particle, div n with n out of its own liquid; positive where it is convex.

    The divergence of the unit normal is a least-squares fit to the neighbours near the interface, those of other
    liquids reversed and images mirrored, each with the steepness of the colour function as its weight: contours of
    the smoothed colour stand for the interface ([000] eq. 18, in any dimension).

    Parameters
    ----------
    normal : (n, 3) float64
        As made by `normals`; 0 away from interfaces.
    tilt : None or (n,) float64, rad
        As made by `tell_tilt`; None for interfaces at right angles to walls.
    near, begin, index, offset, image, mirror, side, strength
        As in `normals` and `image_links`.
    reach : float
        In spacings.
    dimension : int
    share, own
        Filled: weights to smooth the curvature with, by W and the steepness (see `smooth`).
    out : (n,) float64, 1/m
        Filled for those particles.
    """
    x, y, z = offset[0], offset[1], offset[2]
    middle = weight(0.0, reach)
    for a in range(near.shape[0]):
        i = near[a]
        gxx = gxy = gxz = gyx = gyy = gyz = gzx = gzy = gzz = 0.0
        xx = xy = xz = yy = yz = zz = 0.0
        steep = _length(normal[i, 0], normal[i, 1], normal[i, 2])
        size = 1.0 / (steep + 1e-300)
        ox, oy, oz = size * normal[i, 0], size * normal[i, 1], size * normal[i, 2]
        own[a] = middle * steep
        weights = own[a] + 1e-300
        for k in range(begin[a], begin[a + 1]):
            j = index[k]
            nx, ny, nz = normal[j, 0], normal[j, 1], normal[j, 2]
            steep = _length(nx, ny, nz)
            s = steep * strength[k]
            dx, dz = x[k], z[k]
            sx, sz = s * dx, s * dz
            r2 = sx * dx + sz * dz
            size = side[k] / (steep + 1e-300)
            nx, ny, nz = size * nx, size * ny, size * nz
            if image[k] != 0:
                nx, ny, nz = mirrored(nx, ny, nz, image[k], mirror[a])
                if tilt is not None:
                    nx, ny, nz = _tilted(nx, ny, nz, tilt[i], image[k], mirror[a])
            nx, nz = nx - ox, nz - oz
            gxx += nx * sx
            gxz += nx * sz
            gzx += nz * sx
            gzz += nz * sz
            xx += dx * sx
            xz += dx * sz
            zz += dz * sz
            if dimension == 3:
                dy, ny = y[k], ny - oy
                sy = s * dy
                r2 += sy * dy
                gxy += nx * sy
                gyx += ny * sx
                gyy += ny * sy
                gyz += ny * sz
                gzy += nz * sy
                xy += dx * sy
                yy += dy * sy
                yz += dy * sz
            share[k] = side[k] * r2
            weights += r2
        own[a] /= weights
        for k in range(begin[a], begin[a + 1]):
            share[k] /= weights
        total = xx + yy + zz
        if total == 0.0:
            out[i] = 0.0
            continue
        c = dimension / total
        m = inverse_of(c * xx, c * xy, c * xz, c * yy, c * yz, c * zz, LINKS_FLOOR, dimension)
        trace = gxx * m[0] + gyy * m[3] + gzz * m[5] + (gxy + gyx) * m[1] + (gxz + gzx) * m[2] + (gyz + gzy) * m[4]
        out[i] = c * trace


@compiled
def join_sides(near, begin, index, offset, side, strength, values):
    """Give both sides of an interface the same curvature, reversed: the mean of the own and that across by W.

    That of the contours through the particles is 1 / (R - l0 / 2) on one side and 1 / (R + l0 / 2) on the other.

    Parameters
    ----------
    near, begin, index, offset, side, strength
        As in `normals`.
    values : (n,) float64
        Changed for those of the particles that have neighbours across.
    """
    x, y, z = offset[0], offset[1], offset[2]
    fresh = np.empty(near.shape[0])
    for a in range(near.shape[0]):
        total = value = 0.0
        for k in range(begin[a], begin[a + 1]):
            s = strength[k] * (x[k] * x[k] + y[k] * y[k] + z[k] * z[k]) if side[k] < 0.0 else 0.0
            total += s
            value += s * values[index[k]]
        here = values[near[a]]
        fresh[a] = 0.5 * (here - value / total) if total > 0.0 else here
    for a in range(near.shape[0]):
        values[near[a]] = fresh[a]
