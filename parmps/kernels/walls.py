"""Distance to the walls, and what a baffle hides, one point or segment at a time."""

from typing import NamedTuple

import numpy as np
from numba import njit

CHORD = 1e-6  # share of a segment that must lie inside a box; less is a touch, or rounding


class Walls(NamedTuple):
    """The walls of a tank and its baffles: liquid is where all parts of the tank allow it, outside the solids.

    Attributes
    ----------
    container : (2, 3) float64, m
        Lower and upper corner of the tank; infinite along y in 2D, where y then does not matter.
    open_top : bool
        Whether the tank has no lid, so that its upper face is no wall.
    solids : (m, 2, 3) float64, m
        Lower and upper corners of the baffles, infinite where they pass through a wall.
    planes : (k, 4) float64, 1 and m
        Chamfers: unit normal into the tank, and the offset o; the distance is n . r - o.
    rounds : (k, 7) float64
        Cylinders and spheres: centre (m), 1 for each axis in which it is round and 0 for that along which it
        is straight, radius (m).
    field : (a, b, c) float32, m
        Distance from a surface without formula, at the nodes of a grid; empty for none.
    frame : (4,) float64, m
        First node of the grid, and its step.
    """

    container: np.ndarray
    open_top: bool = False
    solids: np.ndarray = np.empty((0, 2, 3))
    planes: np.ndarray = np.empty((0, 4))
    rounds: np.ndarray = np.empty((0, 7))
    field: np.ndarray = np.empty((0, 0, 0), np.float32)
    frame: np.ndarray = np.zeros(4)


@njit(cache=True, error_model="numpy")
def wall_distance(x, y, z, walls):
    """Signed distance of a point to the nearest wall surface, and the direction into the liquid region.

    A point inside several of the walls and solids gets the surface of the one that it is deepest in.

    Parameters
    ----------
    x, y, z : float64, m
    walls : Walls

    Returns
    -------
    distance : float64, m
        Positive in the liquid region, negative inside walls and solids.
    nx, ny, nz : float64
        Unit vector from the nearest wall surface into the liquid region.
    """
    container = walls.container
    high_z = np.inf if walls.open_top else container[1, 2]
    distance, nx, ny, nz = _outward(
        x, y, z, container[0, 0], container[0, 1], container[0, 2], container[1, 0], container[1, 1], high_z
    )
    distance, nx, ny, nz = -distance, -nx, -ny, -nz
    for plane in walls.planes:
        other = plane[0] * x + plane[1] * y + plane[2] * z - plane[3]
        if other < distance:
            distance, nx, ny, nz = other, plane[0], plane[1], plane[2]
    for part in walls.rounds:
        ox, oy, oz = part[3] * (part[0] - x), part[4] * (part[1] - y), part[5] * (part[2] - z)
        radius = np.sqrt(ox * ox + oy * oy + oz * oz)
        if part[6] - radius < distance:
            distance = part[6] - radius
            nx, ny, nz = ox / radius, oy / radius, oz / radius
    if walls.field.size > 0:
        other, ox, oy, oz = _sampled(x, y, z, walls.field, walls.frame)
        if other < distance:
            distance, nx, ny, nz = other, ox, oy, oz
    for solid in walls.solids:
        other, ox, oy, oz = _outward(
            x, y, z, solid[0, 0], solid[0, 1], solid[0, 2], solid[1, 0], solid[1, 1], solid[1, 2]
        )
        if other < distance:
            distance, nx, ny, nz = other, ox, oy, oz
    return distance, nx, ny, nz


@njit(cache=True, error_model="numpy")
def _outward(x, y, z, x0, y0, z0, x1, y1, z1):
    """Signed distance to a box, positive outside, and the unit vector of its increase."""
    # per axis: how far beyond the nearer face, and that face's outward direction
    dx, sx = (x0 - x, -1.0) if x0 - x > x - x1 else (x - x1, 1.0)
    dy, sy = (y0 - y, -1.0) if y0 - y > y - y1 else (y - y1, 1.0)
    dz, sz = (z0 - z, -1.0) if z0 - z > z - z1 else (z - z1, 1.0)
    if dx > 0.0 or dy > 0.0 or dz > 0.0:
        px, py, pz = max(dx, 0.0), max(dy, 0.0), max(dz, 0.0)
        distance = np.sqrt(px * px + py * py + pz * pz)
        return distance, sx * px / distance, sy * py / distance, sz * pz / distance
    if dx >= dy and dx >= dz:
        return dx, sx, 0.0, 0.0
    if dz >= dy:
        return dz, 0.0, 0.0, sz
    return dy, 0.0, sy, 0.0


@njit(cache=True, error_model="numpy")
def _sampled(x, y, z, field, frame):
    """Trilinear interpolation of a sampled distance, and the direction of its increase."""
    fx, fy, fz = (x - frame[0]) / frame[3], (y - frame[1]) / frame[3], (z - frame[2]) / frame[3]
    i = min(max(int(np.floor(fx)), 0), field.shape[0] - 2)
    j = min(max(int(np.floor(fy)), 0), field.shape[1] - 2)
    k = min(max(int(np.floor(fz)), 0), field.shape[2] - 2)
    fx, fy, fz = fx - i, fy - j, fz - k
    value = dx = dy = dz = 0.0
    for a in range(2):
        wx, ux = (fx, 1.0) if a else (1.0 - fx, -1.0)
        for b in range(2):
            wy, uy = (fy, 1.0) if b else (1.0 - fy, -1.0)
            for c in range(2):
                wz, uz = (fz, 1.0) if c else (1.0 - fz, -1.0)
                node = field[i + a, j + b, k + c]
                value += wx * wy * wz * node
                dx += ux * wy * wz * node
                dy += wx * uy * wz * node
                dz += wx * wy * uz * node
    size = max(np.sqrt(dx * dx + dy * dy + dz * dz), 1e-300)
    return value, dx / size, dy / size, dz / size


@njit(cache=True, error_model="numpy")
def distances(position, walls):
    """Signed distances of many points to the nearest wall surface, and the directions into the liquid region.

    Parameters
    ----------
    position : (n, 3) float64, m
    walls : Walls

    Returns
    -------
    distance : (n,) float64, m
    normal : (n, 3) float64
    """
    distance, normal = np.empty(len(position)), np.empty((len(position), 3))
    for i in range(len(position)):
        x, y, z = position[i]
        distance[i], normal[i, 0], normal[i, 1], normal[i, 2] = wall_distance(x, y, z, walls)
    return distance, normal


@njit(cache=True, error_model="numpy")
def beside_solid(x, y, z, reach, solids):
    """Whether a point is inside a baffle, or nearer to it than ``reach`` along every axis.

    Parameters
    ----------
    x, y, z, reach : float64, m
    solids : (m, 2, 3) float64, m
        As in `crosses_solid`.

    Returns
    -------
    bool
    """
    for solid in solids:
        if (
            solid[0, 0] - reach < x < solid[1, 0] + reach
            and solid[0, 1] - reach < y < solid[1, 1] + reach
            and solid[0, 2] - reach < z < solid[1, 2] + reach
        ):
            return True
    return False


@njit(cache=True, error_model="numpy")
def crosses_solid(x1, y1, z1, x2, y2, z2, solids):
    """Whether the segment between two points passes through a baffle from one side to another.

    For a wall or dummy particle, test the point of the wall surface that it belongs to (position plus depth
    times normal) instead of its position. A particle that has got inside a baffle is on no side yet: no
    segment from it crosses that baffle.

    Parameters
    ----------
    x1, y1, z1, x2, y2, z2 : float64, m
        The two points.
    solids : (m, 2, 3) float64, m
        Lower and upper corners of the baffles, infinite where they pass through a wall.

    Returns
    -------
    bool
    """
    for solid in solids:
        enter, leave = -np.inf, np.inf
        for axis in range(3):
            start = x1 if axis == 0 else y1 if axis == 1 else z1
            end = x2 if axis == 0 else y2 if axis == 1 else z2
            low, high = solid[0, axis], solid[1, axis]
            if start == end:
                if start <= low or start >= high:
                    leave = -np.inf
                continue
            first, last = (low - start) / (end - start), (high - start) / (end - start)
            if first > last:
                first, last = last, first
            enter, leave = max(enter, first), min(leave, last)
        if enter > -CHORD and leave < 1.0 + CHORD and leave - enter > CHORD:
            return True
    return False


@njit(cache=True, error_model="numpy")
def hidden_from_column(x, y, position, solids):
    """Tell which particles a baffle hides from a vertical line, each at its own height.

    Parameters
    ----------
    x, y : float64, m
        Where the line stands.
    position : (n, 3) float64, m
    solids : (m, 2, 3) float64, m

    Returns
    -------
    (n,) bool
    """
    hidden = np.empty(len(position), np.bool_)
    for i in range(len(position)):
        px, py, pz = position[i]
        hidden[i] = crosses_solid(x, y, pz, px, py, pz, solids)
    return hidden
