"""The state of a run in ``checkpoint.h5``: whole or absent, checked when read, for any number of ranks.

A checkpoint is a slab file (see `parmps.slabs`) of per-particle arrays. Each writer fills one slab; a
restart on as many ranks gives each rank its own slab back, bit for bit, and a restart on another number
shares the slabs out whole (`share_slabs`). Nothing here knows MPI; the order of calls is `create` on one
process, barrier, `write_slab` on every process, barrier, `commit` on one.

The header is one JSON text. It and every array of every slab carry a CRC-32, so that truncated or altered
files are refused and the damaged part is named. The file is HDF5 for whoever wants to look into it, but is
read back without the HDF5 library, which may crash on an altered file: a line in front of the HDF5 content
(in its user block) gives the place and the checksum of the header, and the header the places of the arrays.
"""

import contextlib
import json
import math
import os
import re
import zlib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from pydantic import BaseModel, ConfigDict

from parmps.errors import InputError, OutputError
from parmps.slabs import (
    create_dataset,
    create_file,
    open_regular,
    output_errors,
    sync_directory,
    temporary_name,
    write_at,
)

FORMAT_VERSION = 5
"""Raised whenever a file of the earlier layout could not be continued."""

MAX_HEADER_BYTES = 2**26
"""Of a whole job, and the places of half a million particles that left the tank."""

_USER_BLOCK = 512
_TITLE = "parmps checkpoint"
_OWN = os.O_RDWR | os.O_NOFOLLOW
"""How a file that this module made is opened again."""


class Header(BaseModel):
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
    places : dict of str to int
        Offset of each array in the file, bytes; None if there are no particles.
    sums_place : int
        Offset of the checksums (slab, array), bytes.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    attributes: dict[str, Any]
    arrays: dict[str, tuple[str, tuple[int, ...]]]
    total: int
    slabs: list[tuple[int, int]]
    places: dict[str, int | None]
    sums_place: int


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
        JSON-able.

    Raises
    ------
    OutputError
        If the file cannot be made; the present checkpoint stays as it was.
    ValueError
        If the slabs do not cover the rows in order.
    """
    if not _cover(slabs, total):
        raise ValueError(f"slabs {slabs} do not cover {total} rows in order")
    temporary = temporary_name(path)
    with output_errors(path), _removed_on_error(path):
        create_file(temporary)
        with h5py.File(temporary, "w", userblock_size=_USER_BLOCK) as file:
            group = file.create_group("arrays")
            places = {
                name: create_dataset(group, name, (total, *shape), dtype).id.get_offset()
                for name, (dtype, shape) in arrays.items()
            }
            header = Header(
                attributes=attributes,
                arrays={name: (np.dtype(dtype).str, list(shape)) for name, (dtype, shape) in arrays.items()},
                total=int(total),
                slabs=[(int(start), int(stop)) for start, stop in slabs],
                places=places,
                sums_place=create_dataset(file, "crc32", (len(slabs), len(arrays)), "<u4").id.get_offset(),
            )
            text = json.dumps(header.model_dump()).encode()
            place = create_dataset(file, "header", (len(text),), np.uint8).id.get_offset()
        line = f"{_TITLE} {FORMAT_VERSION} {place} {len(text)} {zlib.crc32(text)}\n"
        with open(open_regular(temporary, _OWN), "r+b", buffering=0) as file:
            write_at(file.fileno(), text, place)
            write_at(file.fileno(), line.encode(), 0)


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
    temporary = temporary_name(path)
    header = read_header(temporary)
    start, stop = header.slabs[index]
    slab = {name: np.ascontiguousarray(arrays[name]) for name in header.arrays}
    sums = np.array([zlib.crc32(rows) for rows in slab.values()], "<u4")
    for name, (dtype, shape) in header.arrays.items():
        found, wanted = (slab[name].dtype.str, slab[name].shape), (dtype, (stop - start, *shape))
        if found != wanted:
            raise ValueError(f"{name} is {found}, not {wanted}")
    with output_errors(path), open(open_regular(temporary, _OWN), "r+b", buffering=0) as file:
        for name, rows in slab.items():
            if rows.size:
                write_at(file.fileno(), rows, header.places[name] + start * (rows.nbytes // len(rows)))
        write_at(file.fileno(), sums, header.sums_place + index * sums.nbytes)
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
        os.replace(temporary_name(path), path)
        sync_directory(Path(path).parent)


def discard(path):
    """Remove a new checkpoint that will not be committed, as after an error; for one process only.

    Parameters
    ----------
    path : path-like
        As given to `create`.
    """
    with contextlib.suppress(OSError):
        temporary_name(path).unlink(missing_ok=True)


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
    with output_errors(path), open(open_regular(path), "rb") as file:
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
    with output_errors(path), open(open_regular(path), "rb") as file:
        header = _parse_header(path, file)
        width = len(header.arrays)
        sums = _read_rows(file, "<u4", len(header.slabs) * width, header.sums_place)
        if len(sums) < len(header.slabs) * width:
            raise OutputError(path, "is damaged: the table of checksums is cut off")
        arrays = {}
        for column, (name, (dtype, shape)) in enumerate(header.arrays.items()):
            entry = np.dtype((dtype, shape))
            parts = [np.empty(0, entry)]
            for index in indices:
                start, stop = header.slabs[index]
                place = start * entry.itemsize + (header.places[name] or 0)
                rows = _read_rows(file, entry, stop - start, place)
                if len(rows) < stop - start or zlib.crc32(rows) != sums[index * width + column]:
                    raise OutputError(path, f"is damaged: {name} of slab {index} fails its checksum")
                parts.append(rows)
            arrays[name] = np.concatenate(parts)
    return arrays


@contextlib.contextmanager
def _removed_on_error(path):
    """Leave no half-made file behind."""
    try:
        yield
    except Exception:
        discard(path)
        raise


def _parse_header(path, file):
    """Read and verify the header of an open checkpoint."""
    title, _, numbers = file.readline(_USER_BLOCK).decode("latin-1").partition(f"{_TITLE} ")
    if title or not re.fullmatch(r"\d+ \d+ \d+ \d+\n", numbers):
        raise OutputError(path, "is damaged, or not a checkpoint")
    version, place, size, checksum = map(int, numbers.split())
    if version != FORMAT_VERSION:
        reason = f"{path} has format {version}, this parmps reads format {FORMAT_VERSION}"
        raise InputError("restart", reason)
    whole = os.fstat(file.fileno()).st_size
    text = os.pread(file.fileno(), min(size, MAX_HEADER_BYTES), min(place, whole))
    if zlib.crc32(text) != checksum:
        raise OutputError(path, "is damaged: the header fails its checksum")
    try:
        header = Header.model_validate(json.loads(text))
    except (ValueError, RecursionError):
        raise OutputError(path, "is damaged: the header is not that of a checkpoint") from None
    if not _fits(header, whole):
        raise OutputError(path, "is damaged: the header tells of slabs or arrays that cannot be")
    return header


def _cover(slabs, total):
    """Whether slabs cover all rows, in order."""
    stops = [0, *(stop for _, stop in slabs)]
    return [start for start, _ in slabs] == stops[:-1] and stops[-1] == total and sorted(stops) == stops


def _fits(header, size):
    """Whether the slabs and arrays that a header tells of can be in a file of a size, bytes."""
    if not _cover(header.slabs, header.total) or header.places.keys() != header.arrays.keys():
        return False
    parts = [(header.sums_place, 4 * len(header.slabs) * len(header.arrays))]
    for name, (dtype, shape) in header.arrays.items():
        if not re.fullmatch(r"[<|][bif][1248]", dtype) or min(shape, default=1) < 1:
            return False
        parts.append((header.places[name] or 0, header.total * math.prod(shape) * int(dtype[-1])))
    return all(place >= 0 and place + length <= size for place, length in parts)


def _read_rows(file, entry, count, place):
    """Read up to `count` entries at an offset; fewer where the file is cut off."""
    if count == 0:
        return np.empty(0, entry)
    file.seek(place)
    return np.fromfile(file, entry, count)
