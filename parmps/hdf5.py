"""HDF5 files that others may have written: what is in them is looked at before any of it is read.

A file may name data elsewhere (links, external storage, virtual datasets), say that it holds more than any memory, or
hold a kilobyte that unpacks to terabytes. Here data are arrays of numbers in the file itself, of a size that the
caller allows.
"""

import math
import os
import zlib
from contextlib import contextmanager

import h5py

from parmps.slabs import open_regular

NAMES = {"i": "whole numbers", "u": "whole numbers", "f": "numbers", "b": "truth values", "S": "text", "V": "records"}
LEAST_CHUNK = 2**20
"""Entries that a chunk, the unit of what is unpacked at once, may have in any case."""
FRAME = 64
"""Bytes that filters may add to a chunk."""


@contextmanager
def opened(path):
    """Open a regular file as HDF5, to be read.

    Parameters
    ----------
    path : path-like

    Yields
    ------
    h5py.File

    Raises
    ------
    OSError
        If there is no such file, or it is not HDF5.
    """
    os.close(open_regular(path))
    with h5py.File(path, "r") as file:
        yield file


def member(group, name):
    """Find what a group itself holds.

    Parameters
    ----------
    group : h5py.Group
    name : str
        Parts separated by ``/``.

    Returns
    -------
    h5py.Group or h5py.Dataset

    Raises
    ------
    KeyError
        If there is none.
    ValueError
        If the name leads elsewhere.
    """
    found = group
    for part in name.split("/"):
        link = found.get(part, getlink=True) if isinstance(found, h5py.Group) else None
        if link is None:
            raise KeyError(f"it has no '{name}'")
        if not isinstance(link, h5py.HardLink):
            raise ValueError(f"'{name}' is a link, must be in the file itself")
        found = found[part]
    return found


def numbers(group, name, kinds):
    """Find an array of numbers whose data are in the file, plain or packed by gzip.

    Parameters
    ----------
    group : h5py.Group
    name : str
        As for `member`.
    kinds : str
        Of NumPy: "i" and "u" for whole numbers, "f".

    Returns
    -------
    h5py.Dataset

    Raises
    ------
    KeyError, ValueError
        If there is none, or it is something else.
    """
    data = member(group, name)
    if not isinstance(data, h5py.Dataset) or data.shape is None:
        raise ValueError(f"'{name}' is not an array")
    try:
        kind = data.dtype.kind
    except TypeError:
        raise ValueError(f"'{name}' holds something that is not known here") from None
    if kind not in kinds or data.dtype.itemsize > 8:
        holds = "references" if h5py.check_ref_dtype(data.dtype) else NAMES.get(kind, "text or other objects")
        raise ValueError(f"'{name}' holds {holds}, must be {NAMES[kinds[0]]}")
    layout = data.id.get_create_plist()
    if layout.get_layout() == h5py.h5d.VIRTUAL or layout.get_external_count():
        raise ValueError(f"'{name}' has its data in other files, must be in the file itself")
    return data


def read(data, rows=slice(None)):
    """Read rows of an array, which the caller knows not to be too many.

    Parameters
    ----------
    data : h5py.Dataset
        As `numbers` gave it.
    rows : slice

    Returns
    -------
    ndarray

    Raises
    ------
    ValueError
        If it is packed in a way that may hide more than it says.
    """
    if data.chunks is not None:
        wanted = len(range(*rows.indices(len(data)))) * math.prod(data.shape[1:])
        _check_chunks(data, max(wanted, LEAST_CHUNK))
    return data[rows]


def _check_chunks(data, most):
    """Refuse chunks that unpack to more than they say; the library itself goes on until memory ends."""
    size = math.prod(data.chunks)
    if size > most:
        raise ValueError(f"'{data.name}' is stored in chunks of {size} entries, must be at most {most}")
    size *= data.dtype.itemsize
    layout = data.id.get_create_plist()
    filters = [layout.get_filter(number)[0] for number in range(layout.get_nfilters())]
    packed = [number for number, code in enumerate(filters) if code == h5py.h5z.FILTER_DEFLATE]
    plain = (h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32)
    if len(packed) > 1 or any(code not in plain for code in filters):
        raise ValueError(f"'{data.name}' is packed in an unusual way, must be plain or packed by gzip")
    for number in range(data.id.get_num_chunks()):
        chunk = data.id.get_chunk_info(number)
        unpacked = not packed or chunk.filter_mask >> packed[0] & 1
        if chunk.size > size + size // 100 + FRAME or not (unpacked or _unpacks_to(data, chunk, size + FRAME)):
            raise ValueError(f"'{data.name}' unpacks to more than it says")


def _unpacks_to(data, chunk, size):
    """Whether a chunk packed by gzip unpacks to at most so many bytes."""
    unpack = zlib.decompressobj()
    try:
        unpack.decompress(data.id.read_direct_chunk(chunk.chunk_offset)[1], size)
    except zlib.error:
        return False
    return unpack.eof or not unpack.unconsumed_tail
