"""Openings that are too narrow for particles to flow through as liquid would."""

import itertools

import numpy as np
from scipy import ndimage

from parmps.hull import build_hull, hull_axes

NARROW = 2.0
"""Width, in spacings, below which little or nothing flows: a particle keeps half a spacing from either side, and less
than two rows in between have no profile of velocity."""
SEARCHED = 1e6
"""Points of the lattice up to which the necks of a surface are looked for, whose distance is sampled for it."""
ROOM = 64
"""Samples, 2 by 2 by 2 a particle, that a part of a tank has at least."""


def narrow_openings(job):
    """Find openings narrower than two spacings.

    Holes in plates, gaps between plates and walls or other plates, the flats of a prism, and necks between the rooms
    of a surface. On curved and sloped walls a gap is taken for as wide as it is at its widest.

    Parameters
    ----------
    job : Job

    Yields
    ------
    key, what, width : str, str, float
        What is narrow and how wide it is, m. Of a kind, the narrowest.
    """
    limit = NARROW * job.spacing * (1.0 - 1e-9)
    boxes = [_box(job, baffle) for baffle in job.tank.baffles]
    for number, baffle in enumerate(job.tank.baffles):
        key = f"tank.baffles[{number}]"
        holes = [(min(np.subtract(high, low)), k) for k, (low, high) in enumerate(baffle.openings)]
        narrow = [hole for hole in holes if hole[0] < limit]
        if narrow:
            width, first = min(narrow)
            what = f"an opening ({len(narrow)} of the plate's {len(holes)} are narrow)"
            yield f"{key}.openings[{first}]", what, width
        if baffle.ring is not None:
            across = [a for a in range(3) if a != (0 if baffle.vertical else 2)]
            inner = min(job.tank.size[a] - 2.0 * baffle.ring for a in across)
            if inner < limit:
                yield f"{key}.ring", "the opening in the ring", inner
        for name, width in _wall_gaps(job, boxes[number]):
            if width < limit:
                yield key, f"the gap to the {name}", width
    slots = [
        (width, a, b) for (a, one), (b, other) in itertools.combinations(enumerate(boxes), 2)
        if 0.0 < (width := _between(one, other)) < limit
    ]  # fmt: skip
    if slots:
        width, a, b = min(slots)
        yield f"tank.baffles[{b}]", f"the gap to tank.baffles[{a}] (of {len(slots)} that are narrow)", width
    yield from _necks(job, limit)


def _box(job, baffle):
    """Lower and upper corner of a plate, (2, d) float64, m."""
    low, high = np.zeros(job.dimension), np.array(job.tank.size, float)
    across = 0 if baffle.vertical else job.dimension - 1
    centre = baffle.x if baffle.vertical else baffle.z
    low[across], high[across] = centre - baffle.thickness / 2, centre + baffle.thickness / 2
    if baffle.ring is None:
        along = job.dimension - 1 if baffle.vertical else 0
        low[along], high[along] = (baffle.bottom, baffle.top) if baffle.vertical else (baffle.left, baffle.right)
    if baffle.width is not None:
        low[1], high[1] = baffle.width
    return np.array([low, high])


def _wall_gaps(job, box):
    """Names of the walls that a plate has a gap to, and its width, m."""
    size, last = np.array(job.tank.size), job.dimension - 1
    hull, names = build_hull(job.tank, job.spacing), ["wall"] * last + ["floor"]
    for axis in range(job.dimension):
        for side in (0, 1):
            width = size[axis] - box[1, axis] if side else box[0, axis]
            if width <= 1e-9 * size[axis] or (side and axis == last and not job.tank.lid):
                continue
            middle = np.clip(box, 0.0, size).mean(axis=0)
            middle[axis] = box[side, axis]
            if hull is not None:
                at = np.array([[middle[min(a, last)] for a in hull_axes(hull, job.dimension)]])
                if hull.distance(at)[0][0] <= 0.0:  # there the plate goes into the wall
                    continue
            yield "lid" if side and axis == last else names[axis], width


def _between(one, other):
    """Width of the gap between two plates that face each other, m; 0 where they do not."""
    apart = np.maximum(one[0] - other[1], other[0] - one[1])
    return float(apart.max()) if np.count_nonzero(apart > 0.0) == 1 else 0.0


def _necks(job, limit):
    tank = job.tank
    if tank.shape == "prism":
        for edge in ("bottom", "top"):
            legs = getattr(tank.chamfer, edge)
            width = tank.size[-2] - 2.0 * legs[0] if legs else limit
            if 1e-9 * tank.size[-2] < width < limit:
                yield f"tank.chamfer.{edge}", "the flat between the chamfers", width
    elif tank.shape == "stl" and np.prod(tank.size) / job.spacing**3 <= SEARCHED:
        field = build_hull(tank, job.spacing).sampled.field
        whole, parts = (_parts(field > depth) for depth in (0.0, limit / 2))
        if parts > whole:
            yield "tank.surface", f"a neck, without which its {whole} room(s) would be {parts},", limit


def _parts(inside):
    label, count = ndimage.label(inside)
    return int(np.count_nonzero(np.bincount(label.ravel(), minlength=count + 1)[1:] >= ROOM))
