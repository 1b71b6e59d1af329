"""Points around a hull."""

from typing import NamedTuple

import numpy as np


class Shell(NamedTuple):
    """Points evenly spaced on a curve or surface parallel to the walls, outside of them.

    Attributes
    ----------
    position : (n, d) float64, m
    surface : (n, d) float64, m
        Nearest point of the wall.
    normal : (n, d) float64
        Into the tank; in a corner of a polygon, towards the corner.
    area : (n, d) float64, m or m2
        Wall that the point stands for, directed out of the liquid; 0 in corners.
    """

    position: np.ndarray
    surface: np.ndarray
    normal: np.ndarray
    area: np.ndarray
