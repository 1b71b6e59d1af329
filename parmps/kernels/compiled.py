"""How kernels are compiled."""

from numba import njit

compiled = njit(cache=True, error_model="numpy", fastmath={"contract", "arcp", "nsz"}, nogil=True)
"""Decorator of all kernels: compiled once and kept on disk; NaN and infinity keep their meaning.

Sums keep their order, too: they are over a dozen neighbours each, too few for vector registers to pay.
"""

added_together = njit(
    inline="never", error_model="numpy", fastmath={"contract", "arcp", "nsz", "reassoc"}, nogil=True
)
"""Decorator of a loop over hundreds of terms, which vector registers add in another order."""
