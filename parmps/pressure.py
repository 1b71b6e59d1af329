"""Linear solvers: the pressure, by conjugate gradients with multigrid kept over many steps, and implicit viscosity.

The only module that knows PETSc. All its options can be given on the command line, with the prefix ``-ppe_`` for
the pressure and ``-viscosity_`` for the velocity.
"""

import ctypes
import math
import sys
from contextlib import contextmanager

import numpy as np
import petsc4py
from mpi4py import MPI  # for the handle of the communicator alone

from parmps.errors import DivergedError, InputError
from parmps.installation import fitting
from parmps.kernels.poisson import sort_rows

PREFIXES = ("ppe_", "viscosity_")
"""Of the options of the two solvers."""

# Signals are Python's: PETSc would end the run at SIGTERM, and print of an inner error where a pipe is closed.
# It need not look for rows with equal columns (inodes), either, in every step: there are none. Nor keep what the coarse
# matrices were made with, half as much as the pressure matrix in 3D: they are made once. Of
# unused options it need not speak at its end: `unused_options` knows those of the command line.
given = sys.argv[1:] if any(a.startswith(tuple(f"-{prefix}" for prefix in PREFIXES)) for a in sys.argv) else []
options = ("-no_signal_handler", "-mat_no_inode", "-mat_product_clear")
options = [word for option in options for word in (option, "true")] + ["-options_left", "false"]
with fitting("petsc4py"):
    petsc4py.init([sys.argv[0], *options, *given])
    from petsc4py import PETSc

VISCOUS_TOLERANCE = 1e-6
"""Residual of the velocity's equation relative to its right-hand side; its matrix is so well conditioned that a
tighter tolerance than the pressure's costs little."""

PRESSURE_OPTIONS = {
    "ksp_type": "cg",
    "ksp_max_it": 500,
    "ksp_norm_type": "unpreconditioned",
    "pc_type": "gamg",
    "pc_gamg_threshold": -1.0,  # no entries are zero: none to drop from a copy
    "pc_gamg_coarse_eq_limit": 600,  # fewer levels, that is messages, and a factorisation that still costs nothing
    "mg_levels_ksp_max_it": 1,
    # Eigenvalues of D^-1 A, a matrix of links, are below 2, which ten iterations take for 1.36 to 1.6; with PETSc's
    # margin of 1.1, one that is alone, of two light particles in heavy liquid, grows in the smoother.
    "mg_levels_ksp_chebyshev_esteig": "0,0.1,0,1.4",
    "mg_levels_pc_type": "jacobi",
    "mg_coarse_sub_pc_factor_shift_type": "nonzero",
}

WIDE = 3.0
"""Radius, in l0, from which on links alone join enough particles to one of the next level. Those of neighbours besides,
as PETSc takes them for the finest level, would be too many: 17 iterations instead of 7 with the papers' 4.01."""

VISCOSITY_OPTIONS = {"ksp_type": "cg", "ksp_max_it": 2000, "pc_type": "jacobi"}


class _Solver:
    """What the solvers share: PETSc's objects for one distribution of the rows, and one solution.

    Parameters
    ----------
    comm : mpi4py.MPI.Comm
    prefix : str
        Of the options on the command line.
    options : dict
        Those that are used where none are given.
    tolerance : float
        Of the residual relative to the right-hand side.
    """

    def __init__(self, comm, prefix, options, tolerance):
        self._comm = PETSc.Comm(comm)
        self._prefix = prefix
        self._options = options
        self._tolerance = tolerance
        self._ksp = None
        self.iterations = 0

    @contextmanager
    def _own_options(self):
        """Have PETSc find the solver's own options where none are given; other solvers shall not find them.

        What PETSc makes of those on the command line is told as a mistake in it.
        """
        given = " ".join(f"-{name} {value}" for name, value in _given_options(self._prefix).items())
        database = PETSc.Options(self._prefix)
        own = {name: value for name, value in self._options.items() if not database.hasName(name)}
        for name, value in own.items():
            database[name] = value
        try:
            yield
        except PETSc.Error as error:
            if not given:
                raise
            reason = str(error).splitlines()[-1].split("] ")[-1]
            raise InputError("command line", f"PETSc refuses {given}: {reason}") from None
        finally:
            for name in own:
                del database[name]

    def new_layout(self, rows):
        """Begin a new distribution of the rows; forgets the preconditioner.

        Parameters
        ----------
        rows : int
            Number of rows of this rank.
        """
        self.close()
        self._ksp = PETSc.KSP().create(self._comm)
        self._ksp.setOptionsPrefix(self._prefix)
        # the guess may be far from the solution: a few particles in flight, after an impact
        self._ksp.setTolerances(rtol=self._tolerance, divtol=1e50)
        self._ksp.setInitialGuessNonzero(True)
        with self._own_options():
            self._ksp.setFromOptions()
        self._x = PETSc.Vec().createMPI((rows, None), comm=self._comm)
        self._b = self._x.duplicate()
        self._matrix = PETSc.Mat().create(self._comm)

    def new_halo(self, beyond):
        """Begin a new set of other ranks' rows that this rank's may be linked to.

        Parameters
        ----------
        beyond : (columns,) int
            Their numbers, ascending.
        """
        rows = self._x.getLocalSize()
        self._beyond = beyond[: len(beyond) if rows else 0].astype(PETSc.IntType)
        # A first matrix with entries only for PETSc to set up the messages by, once for all.
        self._frame = Blocks(rows, 0, len(self._beyond))
        self._frame.halo_first[1:] = len(self._beyond)
        self._frame.halo_columns[:] = self._beyond
        self._frame.halo_values[:] = 0.0
        _make(self._matrix, self._x.getSizes(), self._frame)

    def _run(self, rhs, guess):
        """Solve with the matrix; whether it converged."""
        self._x.array[:] = guess
        self._b.array[:] = rhs
        self._ksp.setOperators(self._matrix)
        self._ksp.solve(self._b, self._x)
        self.iterations = self._ksp.getIterationNumber()
        return self._ksp.getConvergedReason() > 0

    def _fail(self, what):
        reason = self._ksp.getConvergedReason()
        raise DivergedError(
            f"the {what} solver did not converge: {_REASONS.get(reason, reason)} after {self.iterations} iterations"
        )

    def close(self):
        """Free PETSc's objects, which no garbage collector does in time."""
        if self._ksp is not None:
            for thing in (self._ksp, self._x, self._b, self._matrix):
                thing.destroy()
            self._ksp = None


class VelocitySolver(_Solver):
    """Solves the implicit viscous step.

    Parameters
    ----------
    comm : mpi4py.MPI.Comm
    """

    def __init__(self, comm):
        super().__init__(comm, "viscosity_", VISCOSITY_OPTIONS, VISCOUS_TOLERANCE)

    def solve(self, blocks, density, velocity, axes):
        """Solve for the velocity, one component after the other.

        Parameters
        ----------
        blocks : Blocks
            The matrix.
        density : (rows,) float64
            Of the particles' liquids, as the matrix has it.
        velocity : (rows, 3) float64, m/s
            Before the viscous step, replaced by that after it.
        axes : sequence of int
            Components to solve for.

        Raises
        ------
        DivergedError
            On all ranks, with PETSc's reason.
        """
        _fill(self._matrix, blocks, len(self._beyond))
        for axis in axes:
            if not self._run(density * velocity[:, axis], velocity[:, axis]):
                self._fail("viscosity")
            velocity[:, axis] = self._x.array


class PressureSolver(_Solver):
    """Solves the pressure equation, step after step.

    Parameters
    ----------
    comm : mpi4py.MPI.Comm
    tolerance : float
        Of the estimated error relative to the last pressure, or, where that says nothing, to the error at first.
    excess : float
        Iterations beyond those of a fresh multigrid hierarchy, summed over solves, that pay for a new one.
    radius : float
        Within which particles are linked, l0.

    Attributes
    ----------
    iterations : int
        Of the last solve.
    rebuilds : int
        How often the multigrid hierarchy was set up.
    """

    def __init__(self, comm, tolerance, excess, radius):
        wide = {"pc_gamg_aggressive_coarsening": 0} if radius > WIDE else {}
        super().__init__(comm, "ppe_", PRESSURE_OPTIONS | wide, tolerance)
        self._most_excess = excess
        self._guess = self._change = None
        self.rebuilds = 0
        self._fresh = None
        self._excess = 0

    def new_layout(self, rows):
        """As of every solver; the multigrid hierarchy is forgotten too."""
        super().new_layout(rows)
        self._guess, self._change = self._x.duplicate(), self._x.duplicate()
        self._ksp.setConvergenceTest(self._judge)
        self._fresh = None

    def _judge(self, ksp, iteration, residual):
        """Whether the error is small enough.

        The first change of the pressure is nearly the error that there was, which then falls as the residual does.
        The preconditioned residual tells no more, and costs a cycle of multigrid that nothing uses.
        """
        reasons = PETSc.KSP.ConvergedReason
        if not math.isfinite(residual):
            return reasons.DIVERGED_NANORINF
        if iteration == 0:
            self._first = residual
            return reasons.CONVERGED_ATOL if residual == 0.0 else reasons.CONVERGED_ITERATING
        if iteration == 1:
            self._change.waxpy(-1.0, self._guess, self._x)
            change = max(self._change.norm(), 1e-300)
            self._enough = self._tolerance * self._first * max(self._guess.norm() / change, 1.0)
        return reasons.CONVERGED_ATOL if residual <= self._enough else reasons.CONVERGED_ITERATING

    def solve(self, blocks, rhs, guess):
        """Solve for the pressure.

        Parameters
        ----------
        blocks : Blocks
            The matrix; its arrays become PETSc's until the next solve.
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
        _fill(self._matrix, blocks, len(self._beyond))
        self._guess.array[:] = guess
        if self._fresh is None or self._excess >= self._most_excess:
            self._renew(blocks)
        converged = self._run(rhs, guess)
        if not converged and self._fresh is not None:
            # The hierarchy may have aged too fast to notice: try once more with a new one.
            self._renew(blocks)
            converged = self._run(rhs, guess)
        if not converged:
            self._fail("pressure")
        if self._fresh is None:
            self._fresh = self.iterations
        self._excess += max(self.iterations - self._fresh, 0)
        return self._x.array.copy()

    def _renew(self, blocks):
        """Set the hierarchy up from the present matrix.

        The finest level stays that of each step's matrix: what no longer fits the particles is smooth.
        """
        blocks.sort()
        fresh = PETSc.PC().create(self._comm)
        fresh.setOptionsPrefix(self._prefix)
        with self._own_options():
            fresh.setFromOptions()
            self._ksp.setPC(fresh)  # frees the old one first
            self._ksp.setOperators(self._matrix)
            self._ksp.setUp()
        fresh.setReusePreconditioner(True)
        _give_back_memory()
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
        """As of every solver."""
        super().close()
        for thing in (self._guess, self._change):
            if thing is not None:
                thing.destroy()
        self._guess = self._change = None


def unused_options():
    """Options of the solvers on the command line that nothing has asked for, once all solvers have been set up.

    Returns
    -------
    list of str
        Their names, with the dash.
    """
    found = []
    for name in (name for prefix in PREFIXES for name in _given_options(prefix)):
        used = ctypes.c_int()
        _check(_LIBRARY.PetscOptionsUsed(None, name.encode(), ctypes.byref(used)))
        if not used.value:
            found.append(f"-{name}")
    return found


def _given_options(prefix):
    """Options with a prefix: name without the dash, and value."""
    return {name: value for name, value in PETSc.Options().getAll().items() if name.startswith(prefix)}


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


class Blocks:
    """This rank's rows of a matrix: the block among them and the one that couples to other ranks.

    Parameters
    ----------
    rows, entries, beyond : int
        Number of rows, and of entries of each block at most.

    Attributes
    ----------
    first, columns, values
        Block among the rank's rows, compressed rows with local columns.
    halo_first, halo_columns, halo_values
        The other block, with the columns that the halo's rows are numbered by.
    at_diagonal : (rows,) int
        Where the diagonal is in ``values``.
    """

    def __init__(self, rows, entries, beyond):
        index = PETSc.IntType
        self.first, self.columns, self.values = np.zeros(rows + 1, index), np.empty(entries, index), np.empty(entries)
        self.halo_first = np.zeros(rows + 1, index)
        self.halo_columns, self.halo_values = np.empty(beyond, index), np.empty(beyond)
        self.at_diagonal = np.zeros(rows, index)

    def sort(self):
        """Make the columns of each row ascending, as the set-up of multigrid needs them; forgets `at_diagonal`."""
        sort_rows(self.first, self.columns, self.values)
        sort_rows(self.halo_first, self.halo_columns, self.halo_values)

    @property
    def arrays(self):
        """The six arrays of the two blocks."""
        return self.first, self.columns, self.values, self.halo_first, self.halo_columns, self.halo_values


_C = ctypes.CDLL(None)
if hasattr(_C, "mallopt"):  # glibc
    # Loading PETSc turns off that large arrays have pages of their own, which go back to the system with them: in the
    # heap, what is freed between others stays, a sixth of a 3D run's peak. From 4 MB on, where NumPy's pages are huge.
    _M_MMAP_THRESHOLD, _M_MMAP_MAX = -3, -4  # malloc.h
    _C.mallopt(_M_MMAP_MAX, 65536)  # as by default
    _C.mallopt(_M_MMAP_THRESHOLD, 4 * 2**20)


def _give_back_memory():
    """Give what has been freed back to the system, where the C library is one that keeps it (glibc).

    What multigrid needs for a moment comes in small pieces, which would stay with this process: in 3D half as much as
    the pressure matrix again.
    """
    if hasattr(_C, "malloc_trim"):
        _C.malloc_trim(0)


_LIBRARY = ctypes.CDLL(PETSc.__file__)  # petsc4py has no name for these functions of PETSc
_pointer = ctypes.c_void_p
_INDEX = ctypes.c_int if PETSc.IntType().itemsize == 4 else ctypes.c_int64


def _check(status):
    if status:
        raise PETSc.Error(status)


def _make(matrix, rows, blocks):
    """Make a matrix of arrays whose halo has global columns, which PETSc numbers anew, in place of what it was.

    ``rows`` are those of this rank and of all, which PETSc would add up each time.
    """
    raw = _pointer()
    own, total = map(_INDEX, rows)
    arrays = [_address(array) for array in blocks.arrays]
    comm = _handle(matrix.comm)
    _check(_LIBRARY.MatCreateMPIAIJWithSplitArrays(comm, own, own, total, total, *arrays, ctypes.byref(raw)))
    _check(_LIBRARY.MatHeaderReplace(_pointer(matrix.handle), ctypes.byref(raw)))
    matrix.setOption(PETSc.Mat.Option.SPD, True)


def _fill(matrix, blocks, beyond):
    """Replace the two blocks of a matrix by new arrays; its messages to other ranks stay as they are.

    ``beyond`` is the number of columns of the halo.
    """
    parts, columns, rows = (_pointer(), _pointer()), _pointer(), len(blocks.first) - 1
    _check(_LIBRARY.MatMPIAIJGetSeqAIJ(_pointer(matrix.handle), *map(ctypes.byref, (*parts, columns))))
    arrays = [_address(array) for array in blocks.arrays]
    alone = _handle(PETSc.COMM_SELF)
    for part, width, three in zip(parts, (rows, beyond), (arrays[:3], arrays[3:]), strict=True):
        raw = _pointer()
        _check(_LIBRARY.MatCreateSeqAIJWithArrays(alone, _INDEX(rows), _INDEX(width), *three, ctypes.byref(raw)))
        _check(_LIBRARY.MatHeaderReplace(part, ctypes.byref(raw)))
    matrix.stateIncrease()


def _address(array):
    return array.ctypes.data_as(_pointer)


def _handle(comm):
    """The communicator as C passes it: a pointer with Open MPI, an int with MPICH."""
    mpi = comm.tompi4py()
    kind = ctypes.c_int if MPI._sizeof(mpi) == 4 else ctypes.c_void_p
    return kind(kind.from_address(MPI._addressof(mpi)).value)  # a copy: the object ends here
