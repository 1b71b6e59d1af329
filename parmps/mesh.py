"""Hulls from closed surfaces of triangles."""

import functools
import os
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from parmps.errors import InputError
from parmps.kernels.packing import pick_apart
from parmps.kernels.triangles import exact_distance, sample_distance
from parmps.kernels.walls import Walls, distances
from parmps.packing import RENEW, SHARE, STEPS, asymmetry, neighbours
from parmps.shell import Shell
from parmps.stl import read_surface

BAND = 7.0
"""Distance from the surface that is sampled, in spacings: wall and dummy layers for a reach of 5 on one side."""
FINENESS = 2
"""Nodes of the sampled distance per spacing."""
ASIDE = 1e-7
"""How far from a point the line is that tells whether it is inside, in sizes of the tank."""
FIRST_GAP = 0.83
"""Least distance of points picked at random so that they are one spacing apart in the mean, in spacings."""


def load_hull(path, spacing):
    """Make the hull of a surface from a file; the distance is sampled once a file and spacing.

    Parameters
    ----------
    path : str
    spacing : float, m
        Of the particles.

    Returns
    -------
    Mesh
    """
    read_surface(path)
    return _load(path, os.path.getmtime(path), spacing)


@functools.lru_cache(maxsize=2)
def _load(path, _changed, spacing):
    return Mesh(read_surface(path).triangles, spacing)


@dataclass(frozen=True)
class Mesh:
    """The inside of a closed surface of triangles.

    Attributes
    ----------
    triangles : (m, 3, 3) float64, m
        Corners, counter-clockwise seen from outside.
    spacing : float, m
        Of the particles; the distance is sampled on a grid of half of it.
    """

    triangles: np.ndarray
    spacing: float
    dimension = 3

    @property
    def rounding(self):
        """Distance that forgives the rounding of the samples, m."""
        return 0.5 * self.spacing / FINENESS

    @functools.cached_property
    def sampled(self):
        """Walls that hold the sampled distance alone; an InputError where the surface crosses itself."""
        step = self.spacing / FINENESS
        low = self.triangles.min(axis=(0, 1)) - BAND * self.spacing
        shape = np.ceil((self.triangles.max(axis=(0, 1)) + BAND * self.spacing - low) / step).astype(int) + 1
        field, odd = sample_distance(self.triangles, low, step, tuple(int(n) for n in shape), BAND * self.spacing)
        if odd[3]:
            place = ", ".join(f"{x:.4g}" for x in low + step * odd[:3])
            raise InputError("tank.surface", f"crosses itself: [{place}] m is inside it {odd[3]} times, not 0 or 1")
        return Walls(np.array([[-np.inf] * 3, [np.inf] * 3]), field=field, frame=np.append(low, step))

    def content_below(self, level):
        """Volume below a level, m3: the flux of (0, 0, z - level) through the surface below it (Gauss)."""
        t = np.sort(self.triangles[:, :, 2], axis=1) - level
        a, b, c = t.T
        with np.errstate(divide="ignore", invalid="ignore"):
            above = c**3 / ((c - a) * (c - b))
            below = a**3 / ((a - b) * (a - c))
        # mean over the triangle of min(z - level, 0), which is linear on either side of the level
        mean = np.where(c <= 0.0, a + b + c, np.where(a >= 0.0, 0.0, np.where(b <= 0.0, a + b + c - above, below))) / 3
        side = self.triangles[:, 1:] - self.triangles[:, :1]
        return float(0.5 * np.cross(side[:, 0], side[:, 1])[:, 2] @ mean)

    def distance(self, point):
        """Distance from the wall and its normal, as of a `Polygon`."""
        return distances(np.ascontiguousarray(point, dtype=float), self.sampled)

    def exact_distance(self, point):
        """Distance of a few points from the wall: to every triangle, without samples."""
        point = np.ascontiguousarray(point, dtype=float)
        return exact_distance(point, self.triangles, ASIDE * float(self.triangles.max()))

    def shell(self, depth, spacing):
        """Points on a surface outside: picked at random with a least distance, then moved until they are even."""
        walls = self.sampled
        step = walls.frame[3]
        share = np.maximum(1.0 - np.abs(walls.field + depth) / step, 0.0)
        near = np.argwhere(share > 0.0)
        area = step**2 * share.sum()  # co-area formula: the gradient of the distance is 1
        random = np.random.default_rng(0)
        node = random.permutation(near) + random.uniform(-0.5, 0.5, near.shape)
        node = self._onto(walls.frame[:3] + step * node, depth)
        gap, wanted = FIRST_GAP * spacing, area / spacing**2
        for _ in range(6):
            at = node[_apart(node, gap)]
            gap *= (len(at) / wanted) ** 0.5
        for turn in range(STEPS):
            if turn % RENEW == 0:
                pairs = neighbours(at, at, spacing)
            at = self._onto(at + spacing * SHARE * asymmetry(at, at, pairs, spacing, 2), depth, 1)
        at = self._onto(at, depth)
        _, normal = self.distance(at)
        side = self.triangles[:, 1:] - self.triangles[:, :1]
        own = 0.5 * np.linalg.norm(np.cross(side[:, 0], side[:, 1]), axis=1).sum()
        return Shell(at, at + depth * normal, normal, -normal * own / len(at))

    def _onto(self, point, depth, turns=3):
        """Move points to where the distance is minus the depth, by so many steps of Newton's method."""
        for _ in range(turns):
            gap, normal = self.distance(point)
            point = point - (gap + depth)[:, None] * normal
        return point


def _apart(point, gap):
    """Pick points, in their order, that are no nearer to each other than a gap: (n,) bool."""
    pairs = np.sort(cKDTree(point).query_pairs(gap, output_type="ndarray"), axis=1)
    return pick_apart(len(point), np.ascontiguousarray(pairs[np.argsort(pairs[:, 0], kind="stable")]))
