"""Connected parts of a graph."""

from parmps.kernels.compiled import compiled


@compiled
def root(part, i):
    """First vertex of the tree that a vertex belongs to; halves the way there for the next time."""
    while part[i] != i:
        part[i] = part[part[i]]
        i = part[i]
    return i


@compiled
def join(first, columns, part):
    """Join the trees of vertices that an edge connects (union by least vertex).

    Parameters
    ----------
    first : (rows + 1,) int
    columns : (capacity,) int
        Edges of vertex i go to ``columns[first[i]:first[i + 1]]``.
    part : (n,) int64
        Parent of each vertex in its tree, never after it; changed.
    """
    for i in range(first.shape[0] - 1):
        for k in range(first[i], first[i + 1]):
            a, b = root(part, i), root(part, columns[k])
            part[max(a, b)] = min(a, b)


@compiled
def number_parts(part):
    """Replace the parent of each vertex by the number of its tree.

    Parameters
    ----------
    part : (n,) int64
        As left by `join`; changed.

    Returns
    -------
    int
        Number of trees.
    """
    count = 0
    for i in range(part.shape[0]):
        if part[i] == i:
            part[i] = count
            count += 1
        else:  # a parent comes first, and is a number by now
            part[i] = part[part[i]]
    return count
