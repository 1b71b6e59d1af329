"""Rows of the linear system of an implicit viscous step."""

import math

from parmps.kernels.compiled import compiled
from parmps.kernels.weight import weight


@compiled
def viscosity_rows(
    position,
    kind,
    normal,
    depth,
    diffusion,
    column,
    first,
    other,
    l0,
    reach,
    n0,
    lam,
    dimension,
    row_first,
    columns,
    values,
    halo_first,
    halo_columns,
    halo_values,
):
    """Assemble I - dt nu lap with the operator of `add_viscosity`: symmetric, and no slip in the diagonal.

    The velocity of a wall particle is minus a multiple of the fluid particle's, so that walls are no unknowns;
    their rows, and those of particles out of the tank, are the identity.

    Parameters
    ----------
    position : (n, 3) float64, m
    kind : (n,) int8
    normal, depth
        Of the walls, as in `reflect_at_walls`.
    diffusion : float
        dt nu, m2.
    column : (n,) int32
        Global row number of each particle, -1 for none.
    first, other
        Neighbour lists.
    l0 : float
        Spacing, m.
    reach, n0, lam : float
        Radius in spacings, and its lattice constants.
    dimension : int
    row_first, columns, values, halo_first, halo_columns, halo_values
        Filled: the matrix in two blocks, as by `poisson_rows`.
    """
    scale = diffusion * 2.0 * dimension / (n0 * lam * l0 * l0)
    rows = row_first.shape[0] - 1
    count = beyond = 0
    row_first[0] = halo_first[0] = 0
    for i in range(rows):
        diagonal = 0.0
        at_diagonal = -1
        for k in range(first[i], first[i + 1] if kind[i] == 0 else first[i]):
            j = other[k]
            if kind[j] == 2:
                continue
            if j > i and at_diagonal < 0:
                at_diagonal = count
                count += 1
            dx = (position[j, 0] - position[i, 0]) / l0
            dy = (position[j, 1] - position[i, 1]) / l0
            dz = (position[j, 2] - position[i, 2]) / l0
            r2 = dx * dx + dy * dy + dz * dz
            if r2 >= reach * reach:
                continue
            w = scale * weight(math.sqrt(r2), reach)
            if kind[j] != 0:
                below = depth[j] / l0
                height = -(dx * normal[j, 0] + dy * normal[j, 1] + dz * normal[j, 2]) - below
                diagonal += w * (1.0 + min(below / max(height, 1e-3), 1.5))
                continue
            diagonal += w
            if j < rows:
                columns[count], values[count] = j, -w
                count += 1
            else:
                halo_columns[beyond], halo_values[beyond] = column[j], -w
                beyond += 1
        if at_diagonal < 0:
            at_diagonal = count
            count += 1
        columns[at_diagonal], values[at_diagonal] = i, 1.0 + diagonal
        row_first[i + 1], halo_first[i + 1] = count, beyond
