"""The particles of a rank: a structure of arrays, its own particles first, those of the halo behind."""

import math

import numpy as np

FLUID, WALL, DUMMY, OUT = 0, 1, 2, 3
"""Kinds: liquid; wall in the pressure equation; wall behind it; liquid that left the tank."""

FIELDS = {
    "id": (np.int64, ()),
    "kind": (np.int8, ()),
    "fluid": (np.int8, ()),
    "parent": (np.int64, ()),
    "position": (np.float64, (3,)),
    "velocity": (np.float64, (3,)),
    "pressure": (np.float64, ()),
    "acceleration": (np.float64, (3,)),
    "normal": (np.float64, (3,)),
    "depth": (np.float64, ()),
    "compression": (np.float64, ()),
    "separated": (np.int8, ()),
}
"""Name: (type, shape) of what a particle carries from step to step, and from rank to rank.

``acceleration`` is grad P / rho less the body force, a mean of the last steps, in m/s2; ``compression`` the last volume
error, n/n0 - 1; ``parent`` the id of the wall particle that a dummy stands behind; ``normal`` and ``depth`` belong to
walls, and ``separated`` tells those that the liquid has left.
"""

PARTICLE_BYTES = sum(np.dtype(dtype).itemsize * math.prod(shape) for dtype, shape in FIELDS.values())
"""Bytes of all fields of a particle."""


class Particles:
    """Arrays of `FIELDS`, one row a particle.

    Parameters
    ----------
    arrays : dict of str to array
        Some of the fields; the others are zero.

    Attributes
    ----------
    owned : int
        Number of particles that the rank owns: rows ``[:owned]``, fluid, then walls, then dummies.
    liquid, rows : int
        End of the fluid, and of the rows of the pressure equation (fluid and walls), among the owned.
    """

    def __init__(self, arrays):
        count = len(arrays["id"])
        for name, (dtype, shape) in FIELDS.items():
            value = arrays.get(name)
            value = np.zeros((count, *shape), dtype) if value is None else np.ascontiguousarray(value, dtype)
            setattr(self, name, value)
        self._count_owned(count)

    def _count_owned(self, owned):
        self.owned = owned
        kinds = np.bincount(self.kind[:owned] % OUT, minlength=3)  # those out of the tank stay with the fluid
        self.liquid = int(kinds[FLUID])
        self.rows = int(kinds[FLUID] + kinds[WALL])

    def __len__(self):
        return len(self.id)

    def arrays(self):
        """Fields of the owned particles.

        Returns
        -------
        dict of str to array
        """
        return {name: getattr(self, name)[: self.owned] for name in FIELDS}

    def take(self, order):
        """Keep some of the particles, all of them owned, in a given order.

        Parameters
        ----------
        order : (n,) int
        """
        for name in FIELDS:
            setattr(self, name, np.ascontiguousarray(getattr(self, name)[order]))
        self._count_owned(len(order))

    def resize(self, count):
        """Make room for a halo behind the owned particles, its values undefined.

        Parameters
        ----------
        count : int
            Number of particles with the halo.
        """
        for name in FIELDS:
            old = getattr(self, name)
            if len(old) != count:
                new = np.zeros((count, *old.shape[1:]), old.dtype)
                new[: self.owned] = old[: self.owned]
                setattr(self, name, new)
