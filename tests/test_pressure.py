"""The pressure solver by itself."""

import numpy as np
import pytest
import scipy.sparse as sparse
from mpi4py import MPI
from petsc4py import PETSc

from parmps.pressure import Blocks, PressureSolver


def links_matrix(n, place, strength):
    """Links of strength 1 to the eight nearest points of a grid of n by n, held at one side; one has another."""
    line = sparse.diags([np.ones(n - 1), np.ones(n), np.ones(n - 1)], [-1, 0, 1])
    links = (sparse.kron(line, line) - sparse.eye(n * n)).tolil()
    links[place, place + 1] = links[place + 1, place] = strength
    held = np.zeros(n * n)
    held[:n] = 3.0
    links = links.tocsr()
    return (sparse.diags(held + np.asarray(links.sum(axis=1)).ravel()) - links).tocsr()


def solve(matrix, rhs, radius=2.1):
    """Solve with a solver of its own; also the number of iterations."""
    rows = matrix.shape[0]
    solver = PressureSolver(MPI.COMM_SELF, 1e-8, 40.0, radius)
    solver.new_layout(rows)
    solver.new_halo(np.empty(0, np.int64))
    blocks = Blocks(rows, matrix.nnz, 0)
    blocks.first[:], blocks.columns[:], blocks.values[:] = matrix.indptr, matrix.indices, matrix.data
    pressure = solver.solve(blocks, rhs, np.zeros(rows))
    solver.close()
    return pressure, solver.iterations


@pytest.mark.parametrize("place", [(33, 25), (5, 5), (20, 20)])
def test_one_strong_link_does_not_break_the_smoother(place):
    """Two light particles in heavy liquid: their eigenvalue, alone near 2, is missed by an estimate of the greatest."""
    n = 40
    matrix = links_matrix(n, place[0] * n + place[1], 1e5)
    exact = np.sin(np.arange(n * n) / 300.0)
    pressure, _ = solve(matrix, matrix @ exact)
    assert np.abs(pressure - exact).max() < 1e-5


def test_solvers_keep_their_options_to_themselves():
    """PETSc has one database of options for the process, and a wide radius wants another multigrid."""
    matrix = links_matrix(60, 500, 1.0)
    rhs = np.sin(np.arange(3600.0))
    before = PETSc.Options().getAll()
    alone = solve(matrix, rhs)
    wide = solve(matrix, rhs, 4.01)
    after = solve(matrix, rhs)
    assert PETSc.Options().getAll() == before
    assert wide[1] != alone[1]
    assert after[1] == alone[1]
    np.testing.assert_array_equal(after[0], alone[0])
