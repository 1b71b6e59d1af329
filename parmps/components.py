"""Parts of the liquid that no free surface holds: their pressure is known only up to a constant.

A closed tank that is completely full, and a full compartment beside a partly filled one, have no particle of
known pressure. Their block of the pressure matrix is singular: its right-hand side is made to sum to zero, a
shift of the diagonal far below the solver's tolerance holds the block at its last pressure, and the level of the
pressure is set afterwards so that its least value is zero.
"""

import numpy as np

from parmps.kernels.graph import join, number_parts
from parmps.kernels.poisson import row_sums

SHIFT = 1e-9
"""Relative shift of the diagonal."""


class Floating:
    """The rows of this rank in parts without a known pressure.

    Parameters
    ----------
    label : (rows,) int64
        Part of each row, numbered alike on all ranks, or -1 where a free surface holds the pressure.
    count : int
        Number of such parts.
    held : bool
        Whether any row, of any rank, was held by a free surface when they were found.
    """

    def __init__(self, label, count, held=False):
        self.count, self._held = count, held
        self._rows = np.flatnonzero(label >= 0)
        self._label = label[self._rows]

    def outdated(self, domain, surface):
        """Whether a part has got a free surface since, or the rest of the liquid has got or lost its own.

        A tank that is nearly full closes and opens from step to step; solved as if it were still open, a closed one
        has a singular matrix.

        Parameters
        ----------
        domain : Domain
        surface : (rows,) bool or int8
            Particles of the free surface.

        Returns
        -------
        bool
        """
        opened, held = domain.max(np.array([surface[self._rows].any(), surface.any()], float))
        return opened > 0.0 or (held > 0.0) != self._held

    def fix(self, domain, blocks, rhs, pressure):
        """Make the singular blocks of the matrix regular and their equations consistent with the last pressure.

        Rows of weak links are held at their last pressure, and all rows are, very softly. The rest of the right-hand
        side is made to sum to zero, so that nothing drives the level away from the last one: the preconditioner, made
        of the matrix of an earlier step with other weak rows, would not find another one. Rows that have no links any
        more are no part of the sum: what they took would drive the others, against the soft hold alone.

        Parameters
        ----------
        domain : Domain
        blocks : Blocks
            The matrix, whose diagonal is changed.
        rhs : (rows,) float64
            Changed.
        pressure : (rows,) float64, Pa
            The last one.
        """
        if self.count == 0:
            return
        sums = np.empty(len(rhs))
        row_sums(blocks.first, blocks.values, blocks.halo_first, blocks.halo_values, sums)
        held = sums * pressure
        alone = (np.diff(blocks.first) + np.diff(blocks.halo_first))[self._rows] == 1
        self._alone, self._linked = self._rows[alone], (self._rows[~alone], self._label[~alone])
        rhs[self._alone] = held[self._alone]
        rows, label = self._linked
        sums = domain.sum(
            np.array(
                [np.bincount(label, (rhs - held)[rows], self.count), np.bincount(label, minlength=self.count)],
                dtype=float,  # on all ranks: np.bincount makes whole numbers of no rows
            )
        )
        softly = SHIFT * blocks.values[blocks.at_diagonal[rows]]
        blocks.values[blocks.at_diagonal[rows]] += softly
        rhs[rows] += softly * pressure[rows] - (sums[0] / np.maximum(sums[1], 1.0))[label]

    def level(self, domain, pressure):
        """Set the least pressure of each part to zero, and that of rows without links, as `fix` found them.

        Parameters
        ----------
        domain : Domain
        pressure : (rows,) float64, Pa
            Changed.
        """
        if self.count == 0:
            return
        pressure[self._alone] = 0.0
        rows, label = self._linked
        least = np.full(self.count, np.inf)
        np.minimum.at(least, label, pressure[rows])
        pressure[rows] -= domain.min(least)[label]


def floating_components(domain, row, column, blocks, held):
    """Find the connected parts of the pressure equation that have no particle of known pressure.

    Parameters
    ----------
    domain : Domain
    row : (n,) int64
        Global row of each particle, own and halo, -1 for none.
    column : (n,) int
        Column of each particle of the halo, as in ``blocks``, -1 for none.
    blocks : Blocks
        The matrix of this rank's rows.
    held : (rows,) bool or int8
        Rows whose pressure is tied to a known one: particles of the free surface.

    Returns
    -------
    Floating
    """
    rows = len(blocks.first) - 1
    beyond = np.flatnonzero(column >= 0).astype(np.int32)
    beyond = beyond[np.argsort(column[beyond])]
    part = np.arange(len(row))
    join(blocks.first, blocks.columns, part)
    join(blocks.halo_first, beyond[blocks.halo_columns[: blocks.halo_first[-1]]], part)
    parts = number_parts(part)
    # Ranks agree on labels, and on what is held, by passing the least label and the most held along.
    label = np.where(row >= 0, row, np.iinfo(np.int64).max)
    tied = np.zeros(len(row), np.int64)
    tied[:rows] = held != 0
    # Dry wall particles, and liquid particles alone, have no pressure.
    alone = np.diff(blocks.first) + np.diff(blocks.halo_first) == 1
    tied[:rows][alone] = 1
    while True:
        least = np.full(parts, np.iinfo(np.int64).max)
        most = np.zeros(parts, np.int64)
        np.minimum.at(least, part, label)
        np.maximum.at(most, part, tied)
        changed = int(np.any(least[part] != label) or np.any(most[part] != tied)) if parts else 0
        if parts:
            label, tied = least[part], most[part]
        before = label.copy(), tied.copy()
        domain.exchange(label, tied)
        changed |= int(np.any(before[0] != label) or np.any(before[1] != tied))
        if not domain.max(changed):
            break
    free = tied[:rows] == 0
    names = sorted(set().union(*domain.gather(set(label[:rows][free].tolist()))))
    number = np.full(rows, -1)
    number[free] = np.searchsorted(names, label[:rows][free])
    return Floating(number, len(names), bool(domain.max(float(np.any(held)))))
