"""Liquid at the start from a file: ``particles.vtkhdf`` of an earlier run, or an HDF5 file of plain arrays."""

import numpy as np
from scipy.spatial import cKDTree

from parmps.errors import InputError
from parmps.hdf5 import member, numbers, opened, read
from parmps.kernels.walls import distances
from parmps.particles import FLUID

COINCIDENT = 0.1  # in spacings; two particles nearer than this push each other apart violently
WALLS = 8  # in spacings; the particles of walls reach less far around the tank
CROWD = 2.0  # times as many particles as fit into the tank and its walls are more than any liquid's


def read_state(job, geometry):
    """Read and check the liquid of the job's state file.

    Parameters
    ----------
    job : Job
    geometry : Geometry

    Returns
    -------
    dict of str to array
        ``position`` (n, 3), m, ``velocity`` (n, 3), m/s, and ``fluid`` (n,).

    Raises
    ------
    InputError
        It is no state file, or its liquid cannot be in this tank.
    """
    path = job.initial.path

    def refused(reason):
        return InputError("initial.path", f"{path}: {reason}")

    most = int(CROWD * np.prod([side / geometry.spacing + 2 * WALLS for side in job.tank.size]))
    try:
        with opened(path) as file:
            state = _read_vtkhdf(file, most) if "VTKHDF" in file else _read_arrays(file, most)
    except (OSError, KeyError, IndexError, ValueError, RuntimeError, TypeError) as error:
        raise refused(f"not a state file: {error.args[0] if isinstance(error, KeyError) else error}") from None
    position, velocity, fluid = state["position"], state["velocity"], state["fluid"]
    if not (np.isfinite(position).all() and np.isfinite(velocity).all()):
        raise refused("has values that are not finite")
    if geometry.dimension == 2 and (position[:, 1].any() or velocity[:, 1].any()):
        raise refused("has motion or positions along y, must have none in 2D")
    if len(fluid) and not (fluid.min() >= 0 and fluid.max() < len(job.fluids) and (fluid % 1 == 0).all()):
        raise refused(f"numbers of fluids must be 0 to {len(job.fluids) - 1}")
    outside = distances(position, geometry.walls._replace(open_top=False))[0] < 0.0
    if outside.any():
        at = point(geometry, position[np.argmax(outside)])
        raise refused(f"the particle at {at} is outside the tank or in a baffle")
    pair = _coincident(position, COINCIDENT * geometry.spacing)
    if pair is not None:
        a, b = (point(geometry, position[number]) for number in pair)
        raise refused(f"the particles at {a} and {b} coincide: nearer than {COINCIDENT:g} spacings")
    return {"position": position, "velocity": velocity, "fluid": fluid.astype(np.int8)}


def point(geometry, position):
    """Write a place as a job does.

    Parameters
    ----------
    geometry : Geometry
    position : (3,) float64, m

    Returns
    -------
    str
    """
    axes = (0, 2) if geometry.dimension == 2 else (0, 1, 2)
    return "[" + ", ".join(f"{position[axis]:g}" for axis in axes) + "] m"


def three(vectors):
    """Give vectors three components: two are x and z.

    Parameters
    ----------
    vectors : (n, 2) or (n, 3) array

    Returns
    -------
    (n, 3) float64
    """
    vectors = np.asarray(vectors, dtype=float)
    return np.insert(vectors, 1, 0.0, axis=1) if vectors.shape[1] == 2 else vectors


def _coincident(position, least):
    """Two particles nearer than a distance, or None.

    Those in a cell whose diagonal is that distance are; with at most one a cell, the pairs are few.
    """
    cells = np.floor(position / (least / np.sqrt(3.0))).astype(np.int64)
    order = np.lexsort(cells.T)
    same = np.flatnonzero((cells[order[1:]] == cells[order[:-1]]).all(axis=1))
    if len(same):
        return order[same[0]], order[same[0] + 1]
    pairs = cKDTree(position).query_pairs(least, output_type="ndarray")
    return pairs[0] if len(pairs) else None


def _check_shape(name, data, rows, entry):
    if data.shape not in [(rows, *shape) for shape in entry]:
        wanted = " or ".join(str((rows, *shape)) for shape in entry)
        raise ValueError(f"'{name}' has the shape {data.shape}, must be {wanted}")


def _check_count(count, most):
    if count > most:
        raise ValueError(f"it has {count} particles, more than twice as many as fit into the tank and its walls")


def _read_vtkhdf(file, most):
    """Fluid particles of the last frame of particles.vtkhdf."""
    group = member(file, "VTKHDF")
    frame = int(np.asarray(member(group, "Steps").attrs["NSteps"]).reshape(())) - 1
    if frame < 0:
        raise ValueError("it has no frame")
    offsets, counts = numbers(group, "Steps/PointOffsets", "iu"), numbers(group, "NumberOfPoints", "iu")
    if offsets.ndim != 1 or frame >= len(offsets) or counts.ndim != 1 or not len(counts):
        raise ValueError("its frames are not where it says")
    first, count = int(offsets[frame]), int(counts[0])
    _check_count(count, most)
    arrays = {
        "type": numbers(group, "PointData/type", "iu"),
        "position": numbers(group, "Points", "f"),
        "velocity": numbers(group, "PointData/velocity", "f"),
        "fluid": numbers(group, "PointData/fluid", "iu"),
    }
    for name, data in arrays.items():
        _check_shape(name, data, len(arrays["type"]), [(3,)] if name in ("position", "velocity") else [()])
    if not 0 <= first <= first + count <= len(arrays["type"]):
        raise ValueError("its frames are not where it says")
    rows = slice(first, first + count)
    liquid = read(arrays.pop("type"), rows) == FLUID
    return {name: read(data, rows)[liquid] for name, data in arrays.items()}


def _read_arrays(file, most):
    """Fluid particles from arrays at the top level; without ``fluid``, all are of the first."""
    arrays = {name: numbers(file, name, "fiu") for name in ("position", "velocity")}
    if "fluid" in file:
        arrays["fluid"] = numbers(file, "fluid", "iufb")
    count = arrays["position"].shape[0] if arrays["position"].ndim else 0
    _check_count(count, most)
    for name, data in arrays.items():
        _check_shape(name, data, count, [()] if name == "fluid" else [(2,), (3,)])
    state = {name: read(data) for name, data in arrays.items()}
    state |= {name: three(state[name]) for name in ("position", "velocity")}
    return {"fluid": np.zeros(count, np.int8), **state}
