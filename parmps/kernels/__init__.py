"""Numba kernels over plain arrays: no MPI, no PETSc, no configuration objects."""

from parmps.kernels.cache import find_place

find_place()  # before the first kernel asks for it
