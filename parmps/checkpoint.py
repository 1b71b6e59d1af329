"""The state of a run in ``checkpoint.h5``: whole or absent, checked when read, for any number of ranks.

A checkpoint is a slab file (see `parmps.slabs`) of per-particle arrays. Each writer fills one slab; a
restart on as many ranks gives each rank its own slab back, bit for bit, and a restart on another number
shares the slabs out whole (`share_slabs`). Nothing here knows MPI; the order of calls is `create` on one
process, barrier, `write_slab` on every process, barrier, `commit` on one.

The header is one JSON text. It and every array of every slab carry a CRC-32, so that truncated or altered
files are refused and the damaged part is named.
"""

import contextlib
import json
import os
import zlib
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from parmps.errors import InputError, OutputError, ParmpsError
from parmps.slabs import create_dataset, output_errors, sync_directory, write_at

FORMAT_VERSION = 1
"""Raised whenever a file of the earlier layout could not be continued."""

FREE_KEYS = ("time.end", "output")
"""Dotted keys of the job that a restart may change."""

_MISSING = "nothing"


@dataclass(frozen=True)
class Header:
    """What a checkpoint says about itself.

    Attributes
    ----------
    attributes : dict
        What was given to `create`: time, step, version, job, counters and the like.
    arrays : dict of str to tuple
        Type (str) and shape (tuple) of one particle's entry, by array.
    total : int
        Particles in all slabs.
    slabs : list of tuple of int
        First row and row after the last, one pair a writer.
    """

    attributes: dict
    arrays: dict
    total: int
    slabs: list


def create(path, arrays, total, slabs, attributes):
    """Lay out a new checkpoint beside the present one; for one process only.

    Parameters
    ----------
    path : path-like
        Where the checkpoint goes when it is committed.
    arrays : dict of str to tuple
        Type and shape of one particle's entry, by array: ``{"velocity": ("<f8", (3,))}``.
    total : int
        Particles in all slabs.
    slabs : sequence of tuple of int
        First row and row after the last of every writer; together they cover all rows, in order.
    attributes : dict
        JSON-able: at least ``version`` and ``job`` for `check_compatible`.

    Raises
    ------
    OutputError
        If the file cannot be made; the present checkpoint stays as it was.
    ValueError
        If the slabs do not cover the rows in order.
    """
    stops = [0, *(stop for _, stop in slabs)]
    if [start for start, _ in slabs] != stops[:-1] or stops[-1] != total or sorted(stops) != stops:
        raise ValueError(f"slabs {slabs} do not cover {total} rows in order")
    header = {
        "attributes": attributes,
        "arrays": {name: (np.dtype(dtype).str, list(shape)) for name, (dtype, shape) in arrays.items()},
        "total": int(total),
        "slabs": [(int(start), int(stop)) for start, stop in slabs],
    }
    text = json.dumps(header).encode()
    with output_errors(path), _removed_on_error(path), h5py.File(_temporary(path), "w") as file:
        file["format"] = FORMAT_VERSION
        file["header"] = np.frombuffer(text, np.uint8)
        file["header_crc32"] = np.uint32(zlib.crc32(text))
        create_dataset(file, "crc32", (len(slabs), len(arrays)), "<u4")
        group = file.create_group("arrays")
        for name, (dtype, shape) in arrays.items():
            create_dataset(group, name, (total, *shape), dtype)


def write_slab(path, index, arrays):
    """Write the rows of one writer and wait until the disk has them.

    Parameters
    ----------
    path : path-like
        As given to `create`.
    index : int
        Number of the slab.
    arrays : dict of str to ndarray
        All arrays of the checkpoint, (rows of the slab, ...).

    Raises
    ------
    OutputError
        If they cannot be written; the checkpoint must then not be committed.
    ValueError
        If the arrays are not those that `create` was told.
    """
    temporary = _temporary(path)
    with output_errors(path), h5py.File(temporary, "r") as file:
        header = _parse_header(path, file)
        offsets = {name: file["arrays"][name].id.get_offset() for name in header.arrays}
        sums_at = file["crc32"].id.get_offset()
    start, stop = header.slabs[index]
    slab = {name: np.ascontiguousarray(arrays[name]) for name in header.arrays}
    sums = np.array([zlib.crc32(rows) for rows in slab.values()], "<u4")
    for name, (dtype, shape) in header.arrays.items():
        found, wanted = (slab[name].dtype.str, slab[name].shape), (dtype, (stop - start, *shape))
        if found != wanted:
            raise ValueError(f"{name} is {found}, not {wanted}")
    with output_errors(path), open(temporary, "r+b", buffering=0) as file:
        for name, rows in slab.items():
            if rows.size:
                write_at(file.fileno(), rows, offsets[name] + start * (rows.nbytes // len(rows)))
        write_at(file.fileno(), sums, sums_at + index * sums.nbytes)
        os.fsync(file.fileno())


def commit(path):
    """Put the new checkpoint in the place of the present one; for one process, once all have written.

    Parameters
    ----------
    path : path-like
        As given to `create`.

    Raises
    ------
    OutputError
        If it cannot be renamed.
    """
    with output_errors(path):
        os.replace(_temporary(path), path)
        sync_directory(Path(path).parent)


def share_slabs(slabs, ranks, rank):
    """Give each rank a run of whole slabs; with more ranks than slabs some get none.

    Parameters
    ----------
    slabs : int
        Number of slabs in the checkpoint.
    ranks : int
        Number of ranks that read it.
    rank : int
        The rank that asks.

    Returns
    -------
    range
        Its slabs: ``range(rank, rank + 1)`` if there are as many ranks as slabs.
    """
    return range(slabs * rank // ranks, slabs * (rank + 1) // ranks)


def read_header(path):
    """Read what a checkpoint says about itself.

    Parameters
    ----------
    path : path-like
        The checkpoint.

    Returns
    -------
    Header

    Raises
    ------
    InputError
        If it was written in another format version.
    OutputError
        If it is missing, truncated or altered.
    """
    with _opened(path) as file:
        return _parse_header(path, file)


def read_slabs(path, indices):
    """Read some slabs and verify them.

    Parameters
    ----------
    path : path-like
        The checkpoint.
    indices : sequence of int
        Slabs, in the order wanted.

    Returns
    -------
    dict of str to ndarray
        All arrays, (rows of these slabs, ...).

    Raises
    ------
    InputError
        If the file was written in another format version.
    OutputError
        If it is missing, truncated or altered; the message names the array and the slab.
    """
    with _opened(path) as file:
        header = _parse_header(path, file)
        sums = file["crc32"][()]
        arrays = {}
        for column, (name, (dtype, shape)) in enumerate(header.arrays.items()):
            parts = [np.empty((0, *shape), dtype)]
            for index in indices:
                rows = file["arrays"][name][slice(*header.slabs[index])]
                # HDF5's own description of the type has no checksum; the header's has.
                if rows.dtype != dtype or zlib.crc32(np.ascontiguousarray(rows)) != sums[index, column]:
                    raise OutputError(path, f"is damaged: {name} of slab {index} fails its checksum")
                parts.append(rows)
            arrays[name] = np.concatenate(parts)
        return arrays


def check_compatible(header, job, version):
    """Refuse to continue another job, or the work of another version of the code.

    Parameters
    ----------
    header : Header
        Of the checkpoint.
    job : dict
        The job to run, with its defaults, as it was given to `create`. It may differ in `FREE_KEYS`.
    version : str
        Version of the running code.

    Raises
    ------
    InputError
        Naming what differs, with the value in the checkpoint and the one now.
    """
    written = header.attributes["version"]
    if written != version:
        raise InputError("restart", f"the checkpoint was written by parmps {written}, this is {version}")
    # The checkpoint's job went through JSON, which knows no tuples.
    differences = list(_differences(header.attributes["job"], json.loads(json.dumps(job)), ""))
    if differences:
        key, before, now = differences[0]
        message = f"{before} in the checkpoint, {now} in the job; only time.end and output may change"
        if len(differences) > 1:
            message += "; also different: " + ", ".join(other for other, _, _ in differences[1:])
        raise InputError(key, message)


def _differences(before, now, key):
    """Yield (dotted key, value before, value now) for every leaf that differs."""
    if key in FREE_KEYS or before == now:
        return
    if isinstance(before, dict) and isinstance(now, dict):
        for name in [*before, *(name for name in now if name not in before)]:
            inner = f"{key}.{name}" if key else name
            yield from _differences(before.get(name, _MISSING), now.get(name, _MISSING), inner)
    elif isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        for index, (one, other) in enumerate(zip(before, now, strict=True)):
            yield from _differences(one, other, f"{key}[{index}]")
    else:
        yield key, before, now


def _temporary(path):
    """Return the name that a checkpoint has until it is committed."""
    return Path(path).with_name(Path(path).name + ".tmp")


@contextlib.contextmanager
def _removed_on_error(path):
    """Leave no half-made file behind."""
    try:
        yield
    except Exception:
        with contextlib.suppress(OSError):
            _temporary(path).unlink(missing_ok=True)
        raise


@contextlib.contextmanager
def _opened(path):
    """Open a checkpoint for reading; whatever goes wrong then is damage, since HDF5 checks little itself."""
    with output_errors(path), open(path, "rb"):
        pass
    try:
        with h5py.File(path, "r") as file:
            yield file
    except ParmpsError:
        raise
    except Exception as error:
        raise OutputError(path, f"is damaged: {error}") from error


def _parse_header(path, file):
    """Read and verify the header of an open checkpoint."""
    written = int(file["format"][()])
    if written != FORMAT_VERSION:
        raise InputError("restart", f"{path} has format {written}, this parmps reads format {FORMAT_VERSION}")
    text = file["header"][()].tobytes()
    if zlib.crc32(text) != file["header_crc32"][()]:
        raise OutputError(path, "is damaged: the header fails its checksum")
    header = json.loads(text)
    return Header(
        attributes=header["attributes"],
        arrays={name: (dtype, tuple(shape)) for name, (dtype, shape) in header["arrays"].items()},
        total=header["total"],
        slabs=[tuple(slab) for slab in header["slabs"]],
    )
