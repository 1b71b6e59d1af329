"""Neighbour lists of a rank's particles."""

import numpy as np

from parmps.kernels.pairs import bounds, find_pairs, mark_beside_walls, sort_into_cells, strengths


class Pairs:
    """Neighbours of the rows within one radius.

    The lists are made anew each step: with cell-sorted particles that costs less than checking the longer
    lists that a skin needs, since violent flow moves particles by a fifth of a spacing a step.

    Parameters
    ----------
    reach : float
        Greatest distance, m.
    solids : (m, 2, 3) float64, m
        Corners of the baffles, which no pair reaches through.
    wall_pairs : bool
        Whether wall particles have walls and dummies as neighbours.

    Attributes
    ----------
    lists : (first, other)
        Neighbours of particle i are ``other[first[i]:first[i + 1]]``.
    wet : (first, last, other)
        Those without the dummies: ``other[first[i]:last[i]]``.
    square : (capacity,) float32, m2
        Squared distances of the pairs.
    count : int
        Number of pairs.
    """

    def __init__(self, reach, solids, wall_pairs=False):
        self._reach = reach
        self._solids = solids
        self._wall_pairs = wall_pairs
        self._other = np.empty(0, np.uint32)
        self.square = np.empty(0, np.float32)
        self._second = np.empty(0, np.float32)
        self.lists = self.wet = None
        self.count = 0

    def find(self, particles):
        """Make the lists.

        Parameters
        ----------
        particles : Particles
        """
        cells, rows = sorted_cells(particles, self._reach), particles.rows
        first, last = np.empty(rows + 1, np.uint32), np.empty(rows, np.uint32)
        while True:
            self.count = find_pairs(
                particles.position,
                particles.kind,
                particles.normal,
                particles.depth,
                rows,
                self._reach,
                *cells,
                self._solids,
                self._wall_pairs,
                first,
                last,
                self._other,
                self.square,
            )
            if self.count >= 0:
                break
            capacity = 2 * len(self._other) + 32 * rows + 1024
            self._other, self.square = np.empty(capacity, np.uint32), np.empty(capacity, np.float32)
        self.lists = first, self._other
        self.wet = first, last, self._other

    def weigh(self, l0, radius, second):
        """Turn the squares of the distances into weights over squares, W / r^2, for two radii.

        Parameters
        ----------
        l0 : float
            Spacing, m.
        radius, second : float
            In spacings.

        Returns
        -------
        (capacity,) float32, 1/m2
            For the first radius, in the place of ``square``.
        (capacity,) float32, 1/m2
            For the second one; the same array if the radii are equal.
        """
        if second == radius:
            strengths(self.square, self.count, l0, radius, self.square)
            return self.square, self.square
        if len(self._second) < len(self.square):
            self._second = np.empty_like(self.square)
        strengths(self.square, self.count, l0, second, self._second)
        strengths(self.square, self.count, l0, radius, self.square)
        return self.square, self._second


def sorted_cells(particles, reach):
    """Sort particles into cells of the size of a radius, a quarter of it along z; larger where spray flies far.

    Parameters
    ----------
    particles : Particles
    reach : float
        The radius, m.

    Returns
    -------
    tuple
        ``lower, size, shape, start, order, at, beside`` of `find_pairs`.
    """
    lower, upper = bounds(particles.position, particles.kind, len(particles))
    if not np.all(lower <= upper):
        lower = upper = np.zeros(3)
    size = reach * np.array([1.0, 1.0, 0.25])
    shape = np.floor((upper - lower) / size).astype(np.int64) + 1
    most = 8 * len(particles) + 64
    while shape.prod() > most:
        axis = np.argmax(shape)
        shape[axis] = (shape[axis] + 1) // 2
        size[axis] *= 2.0
    grid = lower, size, shape
    cells = sort_into_cells(particles.position, particles.kind, *grid)
    return (*grid, *cells, mark_beside_walls(cells[0], shape, int(reach / size[2]) + 1))
