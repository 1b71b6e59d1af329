"""Numba kernels over plain arrays: no MPI, no PETSc, no configuration objects."""
