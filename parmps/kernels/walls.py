"""Distance to the walls, and what a baffle hides: the tank as boxes, one point or segment at a time."""

import numpy as np
from numba import njit

CHORD = 1e-6  # share of a segment that must lie inside a box; less is a touch, or rounding


@njit(cache=True, error_model="numpy")
def wall_distance(x, y, z, container, solids, open_top):
    """Signed distance of a point to the nearest wall surface, and the direction into the liquid region.

    The liquid region is the inside of the container without the solids. A point inside several of the walls
    and solids gets the surface of the one that it is deepest in.

    Parameters
    ----------
    x, y, z : float64, m
    container : (2, 3) float64, m
        Lower and upper corner of the tank; infinite along y in 2D, where y then does not matter.
    solids : (m, 2, 3) float64, m
        Lower and upper corners of the baffles, infinite where they pass through a wall.
    open_top : bool
        Whether the tank has no lid, so that its upper face is no wall.

    Returns
    -------
    distance : float64, m
        Positive in the liquid region, negative inside walls and solids.
    nx, ny, nz : float64
        Unit vector from the nearest wall surface into the liquid region.
    """
    high_z = np.inf if open_top else container[1, 2]
    distance, nx, ny, nz = _outward(
        x, y, z, container[0, 0], container[0, 1], container[0, 2], container[1, 0], container[1, 1], high_z
    )
    distance, nx, ny, nz = -distance, -nx, -ny, -nz
    for solid in solids:
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
