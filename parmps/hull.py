"""Hulls of tanks that are no boxes: polygons, circles and balls; those of triangles are in :mod:`parmps.mesh`.

A hull knows the distance from its walls, its content below a level, and puts particles evenly on shells parallel
to its walls. It has two coordinates, [across, up], where it is the cross-section of a tank that is straight along
its length, and three otherwise.
"""

import math
from dataclasses import dataclass

import numpy as np

from parmps.mesh import load_hull
from parmps.shell import Shell

TOUCH = 1e-9
"""Length, in sizes of the tank, of an edge between chamfers that is none."""


@dataclass(frozen=True)
class Polygon:
    """A convex polygon.

    Attributes
    ----------
    corners : (n, 2) float64, m
        Counter-clockwise; the edge k begins at corner k.
    wall : (n,) bool
        Which edges are walls; an open top is none.
    """

    corners: np.ndarray
    wall: np.ndarray
    dimension = 2

    @property
    def rounding(self):
        """Distance that forgives the rounding of decimal input, m."""
        return TOUCH * float(np.abs(self.corners).max())

    @property
    def normals(self):
        """Unit normals of the edges into the polygon: (n, 2) float64."""
        along = np.roll(self.corners, -1, axis=0) - self.corners
        return np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1)[:, None]

    @property
    def offsets(self):
        """Distance of each edge's line from the origin along its normal: (n,) float64, m."""
        return np.einsum("ij,ij->i", self.normals, self.corners)

    def content_below(self, level):
        """Area below a level, m2.

        Parameters
        ----------
        level : float, m

        Returns
        -------
        float
        """
        a, b = self.corners, np.roll(self.corners, -1, axis=0)
        # Clip each edge's height at the level; the area is that between the edges and the z axis (Green).
        low, high = np.minimum(a[:, 1], level), np.minimum(b[:, 1], level)
        rise = np.where(a[:, 1] == b[:, 1], 1.0, b[:, 1] - a[:, 1])
        at_low = a[:, 0] + (b[:, 0] - a[:, 0]) * (low - a[:, 1]) / rise
        at_high = a[:, 0] + (b[:, 0] - a[:, 0]) * (high - a[:, 1]) / rise
        return float(np.sum((at_low + at_high) / 2 * (high - low)))

    def distance(self, point):
        """Distance from the nearest wall line.

        Parameters
        ----------
        point : (n, 2) float64, m

        Returns
        -------
        distance : (n,) float64, m
            Positive inside.
        normal : (n, 2) float64
            Of that wall, into the polygon.
        """
        to_each = (point @ self.normals.T - self.offsets)[:, self.wall]
        nearest = to_each.argmin(axis=1)
        return np.take_along_axis(to_each, nearest[:, None], axis=1)[:, 0], self.normals[self.wall][nearest]

    def shell(self, depth, spacing):
        """Points outside the walls; a point in each corner of the parallel curve, evenly spaced between them.

        Parameters
        ----------
        depth : float, m
            Of the curve below the walls.
        spacing : float, m

        Returns
        -------
        Shell
        """
        normals = self.normals
        # Where two walls meet, their parallels do: n . x = offset - depth for both.
        meet = np.stack([np.roll(normals, 1, axis=0), normals], axis=1)
        down = np.where(self.wall, depth, 0.0)
        beside = np.stack([np.roll(self.offsets - down, 1), self.offsets - down], axis=1)
        vertex = np.linalg.solve(meet, beside[:, :, None])[:, :, 0]
        pieces = []
        for k in np.flatnonzero(self.wall):
            after = (k + 1) % len(normals)
            start, end = vertex[k], vertex[after]
            length = np.linalg.norm(end - start)
            before_is_wall, after_is_wall = self.wall[k - 1], self.wall[after]
            # at an open end the last point stands half a spacing from it
            shift = 0.5 * (float(after_is_wall) - float(before_is_wall))
            count = max(round(length / spacing - shift), 1)
            at = (np.arange(count) + (0.0 if before_is_wall else 0.5)) * length / (count + shift)
            position = start + at[:, None] / length * (end - start)
            corner, edge = self.corners[k], self.corners[after] - self.corners[k]
            side = np.linalg.norm(edge)
            # beyond the ends of the edge, the nearest point of the wall is the corner
            along = np.clip((position - corner) @ edge / side**2, 0.0, 1.0)
            surface = corner + along[:, None] * edge if depth > 0.0 else position
            area = np.full(count, side / max(count - before_is_wall, 1))
            normal = np.tile(normals[k], (count, 1))
            if before_is_wall:
                area[0] = 0.0
                normal[0] += normals[k - 1]
            if depth > 0.0:
                normal = surface - position
            normal = normal / np.linalg.norm(normal, axis=1)[:, None]
            pieces.append(Shell(position, surface, normal, -area[:, None] * normals[k]))
        return Shell(*map(np.concatenate, zip(*pieces, strict=True)))


@dataclass(frozen=True)
class Round:
    """A circle or a ball.

    Attributes
    ----------
    centre : (d,) float64, m
    radius : float, m
    """

    centre: np.ndarray
    radius: float

    @property
    def dimension(self):
        """2 for a circle, 3 for a ball."""
        return len(self.centre)

    @property
    def rounding(self):
        """Distance that forgives the rounding of decimal input, m."""
        return TOUCH * self.radius

    def content_below(self, level):
        """Area (m2) or volume (m3) below a level: of a segment of the circle, or a cap of the ball."""
        height = float(np.clip(level - self.centre[-1] + self.radius, 0.0, 2.0 * self.radius))
        if len(self.centre) == 3:
            return math.pi * height**2 * (self.radius - height / 3.0)
        half = math.acos(1.0 - height / self.radius)
        return self.radius**2 * (half - math.sin(2.0 * half) / 2.0)

    def distance(self, point):
        """Distance from the wall and its normal, as of a `Polygon`."""
        out = point - self.centre
        radius = np.linalg.norm(out, axis=1)
        return self.radius - radius, -out / np.maximum(radius, 1e-300)[:, None]

    def shell(self, depth, spacing):
        """Points evenly spaced on a wider circle, or on a Fibonacci lattice of a wider ball (Gonzalez 2010)."""
        wide = self.radius + depth
        if len(self.centre) == 2:
            count = max(round(2.0 * math.pi * wide / spacing), 3)
            angle = 2.0 * math.pi * (np.arange(count) + 0.5) / count
            out = np.stack([np.sin(angle), -np.cos(angle)], axis=1)
            share = 2.0 * math.pi * self.radius / count
        else:
            count = max(round(4.0 * math.pi * (wide / spacing) ** 2), 4)
            up = (2.0 * np.arange(count) + 1.0) / count - 1.0
            turn = math.pi * (3.0 - math.sqrt(5.0)) * np.arange(count)
            beside = np.sqrt(1.0 - up**2)
            out = np.stack([beside * np.cos(turn), beside * np.sin(turn), up], axis=1)
            share = 4.0 * math.pi * self.radius**2 / count
        surface = self.centre + self.radius * out
        return Shell(surface + depth * out, surface, -out, share * out)


def build_hull(tank, spacing):
    """Make the hull of a tank.

    Parameters
    ----------
    tank : parmps.scene.Tank
    spacing : float, m
        Of the particles.

    Returns
    -------
    Polygon, Round, Mesh or None
        None for a box.
    """
    if tank.shape == "box":
        return None
    if tank.shape == "prism":
        return _chamfered(tank)
    if tank.shape == "stl":
        return load_hull(tank.surface, spacing)
    size = np.array(tank.size)
    if tank.shape == "cylinder":
        return Round(size[-2:] / 2, float(size[-1] / 2))
    return Round(size / 2, float(size[-1] / 2))


def hull_axes(hull, dimension):
    """Coordinates of the tank that a hull's are.

    Returns
    -------
    tuple of int
        (0, 2), (1, 2) or (0, 1, 2).
    """
    return (0, 1, 2) if hull.dimension == 3 else (dimension - 2, 2)


def _chamfered(tank):
    across, up = tank.size[-2:]
    (u, v), (s, t) = ((0.0, 0.0) if legs is None else legs for legs in (tank.chamfer.bottom, tank.chamfer.top))
    right = [(across - u, 0.0), (across, v), (across, up - t), (across - s, up)]
    corners = np.array(right + [(across - x, z) for x, z in reversed(right)])
    apart = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1) > TOUCH * max(across, up)
    corners = corners[apart]
    level = (corners[:, 1] == up) & (np.roll(corners, -1, axis=0)[:, 1] == up)
    return Polygon(corners, tank.lid | ~level)
