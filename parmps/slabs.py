"""Slab files: HDF5 files whose rows any process may write at a byte offset known in advance.

A parallel result is a set of arrays of known total length, of which each process holds a contiguous run of
rows: a slab. One process creates the file with every dataset contiguous and allocated at once (the file is
sparse: it takes disk space only as it is filled). From then on nothing in the HDF5 structure changes, and
every process writes its rows with a plain positioned write. That needs no parallel HDF5, gathers nothing on
one process, and leaves a file that opens after a kill at any instant.

Space is not reserved ahead of a write: where a file system cannot reserve, the C library imitates it by
writing a byte in every block, which is slow and may overwrite a neighbour's rows. A full disk shows up in
the write itself instead, and what was half written is never committed.
"""

import contextlib
import errno
import os
import stat
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np

from parmps.errors import OutputError


@contextmanager
def output_errors(path):
    """Turn what the operating system or HDF5 refuses into one message that names the file.

    Parameters
    ----------
    path : path-like
        The file or directory that the block works on.

    Raises
    ------
    OutputError
        In place of an OSError, or of the RuntimeError, KeyError or ValueError that a file raises which is
        not what it should be.
    """
    try:
        yield
    except OSError as error:
        raise OutputError(path, error.strerror or str(error)) from error
    except (RuntimeError, KeyError, ValueError) as error:
        raise OutputError(path, f"cannot be used: {error}") from error


def make_directory(path):
    """Make a directory with its parents, if it is missing.

    Parameters
    ----------
    path : path-like

    Raises
    ------
    OutputError
        If something else is in the way, or it cannot be made.
    """
    with output_errors(path):
        if os.path.exists(path) and not os.path.isdir(path):
            raise OutputError(path, "is in the way: not a directory")
        os.makedirs(path, exist_ok=True)


def open_regular(path, flags=os.O_RDONLY):
    """Open a file that is one, and nothing else: a pipe would be waited for, a device read without end.

    Parameters
    ----------
    path : path-like
        The file.
    flags : int
        Of ``os.open``.

    Returns
    -------
    int
        File descriptor.

    Raises
    ------
    OSError
        If it cannot be opened, or is a directory, a pipe or a device.
    """
    descriptor = os.open(path, flags | os.O_NONBLOCK, 0o666)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError(errno.EINVAL, "is not a regular file")
    return descriptor


def temporary_name(path):
    """Name that a file has until it is whole, beside the one that it replaces.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    Path
    """
    return Path(path).with_name(Path(path).name + ".tmp")


@contextmanager
def replacing(path):
    """Make a file under its temporary name and put it in the place of the present one once it is whole.

    What has the temporary name already is removed, be it a link: where that leads to stays as it is.

    Parameters
    ----------
    path : path-like

    Yields
    ------
    Path
        The temporary name, of an empty new file.

    Raises
    ------
    OSError
        If it cannot be made or renamed; nothing is left of it then.
    """
    temporary = temporary_name(path)
    create_file(temporary)
    try:
        yield temporary
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise


def create_file(path):
    """Make a new empty file in the place of whatever has its name.

    Parameters
    ----------
    path : path-like
        A link of this name is removed, not followed.

    Raises
    ------
    OSError
        If it cannot be made.
    """
    Path(path).unlink(missing_ok=True)
    os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))


def create_dataset(group, name, shape, dtype):
    """Create a dataset with all its space at a fixed place in the file, without writing to it.

    Parameters
    ----------
    group : h5py.Group
        Where the dataset goes.
    name : str
        Name of the dataset.
    shape : tuple of int
        Full shape.
    dtype : dtype-like
        Type of the elements.

    Returns
    -------
    h5py.Dataset
    """
    properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    properties.set_layout(h5py.h5d.CONTIGUOUS)
    properties.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    properties.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    kind = h5py.h5t.py_create(np.dtype(dtype), logical=True)
    space = h5py.h5s.create_simple(tuple(int(n) for n in shape))
    return h5py.Dataset(h5py.h5d.create(group.id, name.encode(), kind, space, properties))


def write_at(descriptor, data, offset):
    """Write all of `data` at a byte offset.

    Parameters
    ----------
    descriptor : int
        File descriptor open for writing.
    data : bytes-like or ndarray
        What to write; an array must be C-contiguous.
    offset : int
        Position in the file, bytes.

    Raises
    ------
    OSError
        As the operating system reports it; part of the data may have been written.
    """
    left = memoryview(data).cast("B") if memoryview(data).nbytes else memoryview(b"")
    while left:
        written = os.pwrite(descriptor, left, offset)
        left = left[written:]
        offset += written


def sync_directory(path):
    """Make a rename inside a directory survive a power failure.

    Parameters
    ----------
    path : path-like
        The directory.
    """
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
