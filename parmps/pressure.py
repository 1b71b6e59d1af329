"""The pressure solver: a distributed PETSc matrix, conjugate gradients, and multigrid kept over many steps.

The only module that knows PETSc. All its options can be given on the command line with the prefix ``-ppe_``.
"""

import sys

import numpy as np
import petsc4py

petsc4py.init([sys.argv[0], *(a for a in sys.argv[1:])] if any(a.startswith("-ppe_") for a in sys.argv) else [])
from petsc4py import PETSc  # noqa: E402

from parmps.errors import DivergedError  # noqa: E402

EXCESS_ITERATIONS = 20
"""Iterations beyond those of a fresh hierarchy that pay for a new one: its set-up costs about three solves."""

DEFAULTS = {
    "ksp_type": "cg",
    "ksp_max_it": 500,
    "pc_type": "gamg",
    "pc_gamg_threshold": 0.0,
    "mg_levels_ksp_max_it": 2,
    "mg_levels_pc_type": "jacobi",
    "mg_coarse_sub_pc_factor_shift_type": "nonzero",
}


class PressureSolver:
    """Solves the pressure equation, step after step.

    Parameters
    ----------
    comm : mpi4py.MPI.Comm
    tolerance : float
        Of the residual relative to the right-hand side.

    Attributes
    ----------
    iterations : int
        Of the last solve.
    rebuilds : int
        How often the multigrid hierarchy was set up.
    """

    def __init__(self, comm, tolerance):
        self._comm = PETSc.Comm(comm)
        options = PETSc.Options("ppe_")
        for name, value in DEFAULTS.items():
            if not options.hasName(name):
                options[name] = value
        self._tolerance = tolerance
        self._ksp = None
        self._matrix = None
        self.iterations = 0
        self.rebuilds = 0
        self._fresh = None
        self._excess = 0

    def new_layout(self, rows):
        """Begin a new distribution of the rows; forgets the hierarchy.

        Parameters
        ----------
        rows : int
            Number of rows of this rank.
        """
        self.close()
        self._rows = rows
        self._ksp = PETSc.KSP().create(self._comm)
        self._ksp.setOptionsPrefix("ppe_")
        self._ksp.setTolerances(rtol=self._tolerance)
        self._ksp.setInitialGuessNonzero(True)
        self._ksp.setFromOptions()
        self._x = PETSc.Vec().createMPI((rows, None), comm=self._comm)
        self._b = self._x.duplicate()
        self._fresh = None

    def solve(self, row_first, columns, values, rhs, guess):
        """Solve for the pressure.

        Parameters
        ----------
        row_first : (rows + 1,) int32
        columns : (entries,) int32
            Global column numbers.
        values : (entries,) float64
        rhs : (rows,) float64
        guess : (rows,) float64
            Where to begin.

        Returns
        -------
        (rows,) float64

        Raises
        ------
        DivergedError
            On all ranks, with PETSc's reason.
        """
        old = self._matrix
        size = (self._rows, None)
        self._matrix = PETSc.Mat().createAIJ((size, size), csr=(row_first, columns, values), comm=self._comm)
        self._matrix.setOption(PETSc.Mat.Option.SPD, True)
        self._x.array[:] = guess
        self._b.array[:] = rhs
        if self._fresh is None or self._excess >= EXCESS_ITERATIONS:
            self._renew()
        self._ksp.setOperators(self._matrix)
        self._ksp.solve(self._b, self._x)
        if self._ksp.getConvergedReason() < 0 and self._excess > 0:
            # The hierarchy may have aged too fast to notice: try once more with a new one.
            self._renew()
            self._x.array[:] = guess
            self._ksp.setOperators(self._matrix)
            self._ksp.solve(self._b, self._x)
        if old is not None:
            old.destroy()
        self.iterations = self._ksp.getIterationNumber()
        reason = self._ksp.getConvergedReason()
        if reason < 0:
            raise DivergedError(
                f"the pressure solver did not converge: {_REASONS.get(reason, reason)} "
                f"after {self.iterations} iterations"
            )
        if self._fresh is None:
            self._fresh = self.iterations
        self._excess += max(self.iterations - self._fresh, 0)
        return self._x.array.copy()

    def renew(self):
        """Set the hierarchy up again at the next solve, so that it does not depend on the past."""
        self._fresh = None

    def _renew(self):
        self._ksp.getPC().setReusePreconditioner(False)
        self._ksp.setOperators(self._matrix)
        self._ksp.setUp()
        self._ksp.getPC().setReusePreconditioner(True)
        self._fresh, self._excess = None, 0
        self.rebuilds += 1

    def multiply_seconds(self, repeats):
        """Measure a product with the last matrix, which costs of the solver are compared with.

        Parameters
        ----------
        repeats : int

        Returns
        -------
        float
            Seconds a product.
        """
        start = PETSc.Log.getTime()
        for _ in range(repeats):
            self._matrix.mult(self._x, self._b)
        return (PETSc.Log.getTime() - start) / repeats

    def close(self):
        """Free PETSc's objects, which no garbage collector does in time."""
        if self._ksp is not None:
            for thing in (self._ksp, self._x, self._b):
                thing.destroy()
            self._ksp = None
        if self._matrix is not None:
            self._matrix.destroy()
            self._matrix = None


_REASONS = {
    value: name.lower().replace("_", " ")
    for name, value in vars(PETSc.KSP.ConvergedReason).items()
    if isinstance(value, int) and value < 0
}


def petsc_version():
    """Version of PETSc.

    Returns
    -------
    str
    """
    return ".".join(str(number) for number in PETSc.Sys.getVersion())


def empty_rows(rows, entries):
    """Arrays for a matrix of so many rows and entries at most.

    Parameters
    ----------
    rows, entries : int

    Returns
    -------
    row_first, columns, values
    """
    index = PETSc.IntType
    return np.zeros(rows + 1, index), np.empty(entries, index), np.empty(entries)
