"""What a run leaves behind: particle frames and the run summary; the signals of its probes are in `table`.

Every file can be read while the run goes on, and after a kill at any instant it holds complete frames and
complete rows only. Nothing here knows MPI: a caller passes the rows that it holds and where they go, and
puts the barriers between `ParticleFile.create`, `ParticleFile.write` on every rank, and
`ParticleFile.commit` on one.

At equal times, the checkpoint comes before output: a restart keeps what was written before its checkpoint, and writes
what is due at that time anew.
"""

import contextlib
import json
import os
import struct
import tempfile
from pathlib import Path

import h5py
import numpy as np

from parmps.errors import OutputError
from parmps.hdf5 import member, numbers, opened
from parmps.slabs import create_dataset, make_directory, open_regular, output_errors, replacing, write_at

RESULT_FILES = ("probes.csv", "particles.vtkhdf", "checkpoint.h5", "run.json", "run.log")
"""The files of an output directory."""

POINT_DATA = {
    "id": ("<i8", ()),
    "type": ("<i1", ()),
    "fluid": ("<i1", ()),
    "velocity": ("<f8", (3,)),
    "pressure": ("<f8", ()),
    "surface": ("<i1", ()),
}
"""Particle fields of a frame beside the position: type and shape of one particle's entry.

``type`` is 0 for fluid, 1 for wall and 2 for dummy particles; ``velocity`` is in m/s, ``pressure`` in Pa.
"""

POINT_BYTES = 24 + sum(np.dtype(dtype).itemsize * int(np.prod(shape)) for dtype, shape in POINT_DATA.values())
"""Of a particle in a frame."""
FRAME_BYTES = 24
"""Of a frame without particles: its time, its number of parts, and its first point."""
ELSEWHERE = "with --out DIR the run continues without this file"
"""What can be done where a result file is not what a checkpoint left."""

_PAGE = 4096
_COPY_BYTES = 1 << 24
_UNSET_COUNT = 0x5EA0_C0DE_0B5E_55ED
_NOWHERE = -1
"""HDF5's address of what has no place in the file."""


def prepare_directory(path, restart):
    """Make the output directory ready for a run, or refuse before anything is touched.

    A fresh run moves the results of an earlier one into the sub-directory ``previous`` (replacing what
    lies there), so that no checkpoint of another run can be taken for its own. A restart leaves all where
    it is.

    Parameters
    ----------
    path : path-like
        The output directory; made with its parents if missing.
    restart : bool
        Whether the run continues the results in the directory.

    Raises
    ------
    OutputError
        If something else is in the way, or if the directory cannot be written.
    """
    path = Path(path)
    make_directory(path)
    previous = path / "previous"
    if previous.is_symlink() or (previous.exists() and not previous.is_dir()):
        raise OutputError(previous, "is in the way: not a directory")
    with output_errors(path), tempfile.TemporaryFile(dir=path):
        pass  # asking for permissions is not enough: root, network and read-only file systems answer otherwise
    for name in RESULT_FILES:
        found = path / name
        if found.is_dir():
            raise OutputError(found, "a directory is in the way of a result file")
        if os.path.exists(found) and not found.is_file():
            raise OutputError(found, "is in the way of a result file: not a regular file")
        if restart and found.is_symlink() and not found.exists():
            raise OutputError(found, "is in the way of a result file: a link to nothing")
    if restart:
        return
    earlier = [path / name for name in RESULT_FILES if os.path.lexists(path / name)]
    if earlier:
        with output_errors(previous):
            previous.mkdir(exist_ok=True)
            for name in RESULT_FILES:
                (previous / name).unlink(missing_ok=True)
            for file in earlier:
                os.replace(file, previous / file.name)


def write_text(path, text):
    """Write a small file so that readers see the old one or the whole new one.

    Parameters
    ----------
    path : path-like
        The file, replaced if it exists.
    text : str
        Its content.

    Raises
    ------
    OutputError
        If it cannot be written; an earlier file stays as it was.
    """
    with output_errors(path), replacing(path) as temporary, open(temporary, "w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())


def write_json(path, content):
    """Write a JSON file so that readers see the old one or the whole new one.

    Parameters
    ----------
    path : path-like
        The file, replaced if it exists.
    content : dict
        What json can hold, and NumPy scalars and arrays.

    Raises
    ------
    OutputError
        If it cannot be written; an earlier file stays as it was.
    """
    write_text(path, json.dumps(content, indent=2, default=lambda value: value.tolist()) + "\n")


class ParticleFile:
    """Particle frames in ``particles.vtkhdf``: VTKHDF PolyData with time steps, one vertex a particle.

    The space of all frames is laid out at creation (see `parmps.slabs`). Committing a frame changes two
    numbers, the attribute ``NSteps`` and the length of ``Steps/Values`` (which VTK needs to be equal), and
    the first frame also the address of the latter, since HDF5 refuses one where there is nothing. All
    lie in the first page of the file and are written by one call, so that no kill can come between them: a
    frame is there whole or not at all. A reader that opens the file while a frame is committed reads the
    two one after the other and may find a later length than number; that window is microseconds wide.

    Parameters
    ----------
    path : path-like
        A file made by `create`, opened for writing; by every process.

    Attributes
    ----------
    path : Path
        The file.
    points : int
        Particles in every frame.
    capacity : int
        Frames that there is room for.
    """

    def __init__(self, path):
        self.path = Path(path)
        with output_errors(self.path):
            with opened(self.path) as file:
                committed = self._find(file)
            self._descriptor = open_regular(self.path, os.O_RDWR)
        if committed != self.frames or not 0 <= committed <= self.capacity:
            self.close()
            raise OutputError(self.path, "is damaged, or was rewritten by another program")

    def _find(self, file):
        """Find where things are, none of it elsewhere or beyond the file's end; return the number of frames."""
        group, size = member(file, "VTKHDF"), os.path.getsize(self.path)
        self.points = int(numbers(group, "NumberOfPoints", "i")[0])
        self.capacity = len(numbers(group, "Steps/PointOffsets", "i"))
        words = [int(word) for word in numbers(file, "parmps/commit_words", "i")[:3]]
        self._count_at, self._length_at, self._address_at = words
        self._times_at = int(numbers(file, "parmps/times_at", "i")[()])
        parts = [*((word, 8, _PAGE) for word in words), (self._times_at, 8 * self.capacity, size)]
        self._offsets = {}
        for name, (dtype, shape) in {"position": ("<f8", (3,)), **POINT_DATA}.items():
            data = numbers(group, "Points" if name == "position" else f"PointData/{name}", "if")
            if data.dtype != dtype or data.shape != (self.points * self.capacity, *shape):
                raise ValueError(f"'{data.name}' is not that of {self.capacity} frames of {self.points} particles")
            self._offsets[name] = data.id.get_offset()
            parts.append((-1 if self._offsets[name] is None else self._offsets[name], data.nbytes, size))
        if any(begin < 0 or begin + length > end for begin, length, end in parts):
            raise ValueError("it does not hold the frames that it tells of")
        return int(np.asarray(member(group, "Steps").attrs["NSteps"]).reshape(()))

    @classmethod
    def create(cls, path, points, frames, attributes):
        """Lay out a file of no committed frames; for one process only.

        Parameters
        ----------
        path : path-like
            The file, replaced at the end if it exists.
        points : int
            Particles in every frame.
        frames : int
            Frames to make room for.
        attributes : dict of str to str
            Texts to keep in the group ``/parmps``, such as the job and the version of the code.

        Raises
        ------
        OutputError
            If the file cannot be made; an earlier one stays as it was.
        ValueError
            If there are no particles or no frames.
        """
        if points < 1 or frames < 1:
            raise ValueError(f"{points} particles and {frames} frames")
        with output_errors(path), replacing(path) as temporary:
            _lay_out(temporary, points, frames, attributes)

    @classmethod
    def resume(cls, path, points, frames, mark):
        """Cut a file back to the frames of a checkpoint and make room for those to come; for one process only.

        Parameters
        ----------
        path : path-like
            The file of the run to continue.
        points : int
            Particles in every frame; must be those of the file.
        frames : int
            Frames that the run needs from the restart on.
        mark : dict
            What `mark` told at the checkpoint; later frames are dropped.

        Returns
        -------
        int
            Frames kept: the number of the next frame.

        Raises
        ------
        OutputError
            If the file cannot be continued.
        """
        kept, last = mark["frames"], mark["last"]
        with contextlib.closing(cls(path)) as old:
            if old.points != points:
                raise OutputError(path, f"holds {old.points} particles a frame, the run has {points}")
            with output_errors(path):
                times = old.times()[:kept]
                if len(times) < kept:
                    end = f", the last of them at t = {times[-1]:g} s" if len(times) else ""
                    belong = f"{kept} frames up to t = {last:g} s that belong to the checkpoint"
                    raise OutputError(path, f"has {len(times)} of the {belong}{end}; {ELSEWHERE}")
                if kept and times[-1] != last:
                    reason = f"has frame {kept} at t = {times[-1]:g} s, which the checkpoint knows at t = {last:g} s"
                    raise OutputError(path, f"{reason}; {ELSEWHERE}")
                if old.capacity >= kept + frames:
                    old._set_count(kept)
                else:
                    old._copy_into_larger(kept, kept + frames)
        return kept

    def mark(self):
        """Tell a checkpoint what belongs to it.

        Returns
        -------
        dict
            ``frames``, the number committed, and ``last``, the time of the last one, s, or None.
        """
        times = self.times()
        return {"frames": len(times), "last": float(times[-1]) if len(times) else None}

    @property
    def frames(self):
        """Committed frames (int), as the file holds them now."""
        return struct.unpack("<q", os.pread(self._descriptor, 8, self._count_at))[0]

    def times(self):
        """Return the times of the committed frames.

        Returns
        -------
        (frames,) float64
            s.
        """
        return np.frombuffer(os.pread(self._descriptor, 8 * self.frames, self._times_at), "<f8")

    def write(self, frame, start, arrays):
        """Write the rows of one process into the frame that follows the committed ones.

        Parameters
        ----------
        frame : int
            Number of the frame, from 0.
        start : int
            First row in the frame.
        arrays : dict of str to ndarray
            ``position`` (n, 3), m, and the fields of `POINT_DATA`.

        Raises
        ------
        OutputError
            If the rows cannot be written; the frame must then not be committed.
        ValueError
            If the frame or the rows are not the file's next.
        """
        if frame != self.frames or frame >= self.capacity:
            raise ValueError(f"frame {frame} of {self.capacity} is not the next after {self.frames}")
        rows = len(arrays["position"])
        if start < 0 or start + rows > self.points:
            raise ValueError(f"rows {start} to {start + rows} of {self.points}")
        columns = {name: np.asarray(arrays[name], dtype) for name, (dtype, _) in POINT_DATA.items()}
        columns["position"] = np.asarray(arrays["position"], "<f8")
        if any(len(array) != rows for array in columns.values()):
            raise ValueError(f"not every array has {rows} rows")
        with output_errors(self.path):
            for name, array in columns.items():
                stride = array.dtype.itemsize * int(np.prod(array.shape[1:]))
                offset = self._offsets[name] + (frame * self.points + start) * stride
                write_at(self._descriptor, np.ascontiguousarray(array), offset)

    def commit(self, frame, time):
        """Show a frame to readers; for one process, once all have written.

        Parameters
        ----------
        frame : int
            Number of the frame.
        time : float
            Its time, s.

        Raises
        ------
        OutputError
            If the file cannot be written.
        ValueError
            If the frame is not the next.
        """
        if frame != self.frames or frame >= self.capacity:
            raise ValueError(f"frame {frame} of {self.capacity} is not the next after {self.frames}")
        with output_errors(self.path):
            write_at(self._descriptor, struct.pack("<d", time), self._times_at + 8 * frame)
            self._set_count(frame + 1)

    def sync(self):
        """Wait until what this process wrote is on the disk; call before a checkpoint relies on it.

        Raises
        ------
        OutputError
            If the disk did not take it.
        """
        with output_errors(self.path):
            os.fsync(self._descriptor)

    def close(self):
        """Close the file; committed frames stay, an uncommitted one is forgotten."""
        os.close(self._descriptor)

    def _set_count(self, frames):
        """Change the commit words by one write inside one page."""
        address = self._times_at if frames else _NOWHERE
        words = {self._count_at: frames, self._length_at: frames, self._address_at: address}
        first, last = min(words), max(words)
        block = bytearray(os.pread(self._descriptor, last + 8 - first, first))
        for word, value in words.items():
            struct.pack_into("<q", block, word - first, value)
        write_at(self._descriptor, block, first)

    def _copy_into_larger(self, kept, frames):
        """Replace the file by one with more room that holds the first `kept` frames."""
        with opened(self.path) as file:
            group = member(file, "parmps/attributes")
            texts = {name: member(group, name).asstr()[()] for name in group}
        larger_path = self.path.with_name(self.path.name + ".larger")
        self.create(larger_path, self.points, frames, texts)
        try:
            with contextlib.closing(ParticleFile(larger_path)) as larger:
                times = self.times()[:kept]
                for name, (dtype, shape) in {"position": ("<f8", (3,)), **POINT_DATA}.items():
                    size = kept * self.points * np.dtype((dtype, shape)).itemsize
                    source, target = self._offsets[name], larger._offsets[name]
                    for done in range(0, size, _COPY_BYTES):
                        block = os.pread(self._descriptor, min(_COPY_BYTES, size - done), source + done)
                        write_at(larger._descriptor, block, target + done)
                write_at(larger._descriptor, times.tobytes(), larger._times_at)
                larger._set_count(kept)
                larger.sync()
            os.replace(larger_path, self.path)
        except OSError:
            larger_path.unlink(missing_ok=True)
            raise


def _lay_out(path, points, frames, attributes):
    """Write the structure of a particle file with no committed frame; see `ParticleFile.create`."""
    # The oldest format has no checksums on its object headers, so the commit words may change in place. What
    # is created first comes first in the file: the words fall into its first page.
    with h5py.File(path, "w", libver=("earliest", "v110")) as file:
        steps = file.create_group("VTKHDF/Steps")
        steps.attrs["NSteps"] = np.int64(_UNSET_COUNT)
        times = create_dataset(steps, "Values", (frames,), "<f8")
        header_at = h5py.h5o.get_info(times.id).addr
        times_at = times.id.get_offset()
        _lay_out_steps(steps, points, frames)
        _lay_out_points(file["VTKHDF"], points, frames)
        own = file.create_group("parmps")
        own["commit_words"] = np.zeros(3, "<i8")
        own["times_at"] = np.int64(times_at)
        for name, text in attributes.items():
            own[f"attributes/{name}"] = text
        words_at = own["commit_words"].id.get_offset()
        connectivity_at = file["VTKHDF/Vertices/Connectivity"].id.get_offset()
        offsets_at = file["VTKHDF/Vertices/Offsets"].id.get_offset()
    with open(path, "r+b", buffering=0) as raw:
        descriptor = raw.fileno()
        write_at(descriptor, np.arange(points, dtype="<i8"), connectivity_at)
        write_at(descriptor, np.arange(points + 1, dtype="<i8"), offsets_at)
        page = os.pread(descriptor, _PAGE, 0)
        count_at = page.find(struct.pack("<q", _UNSET_COUNT))
        length_at, address_at = _words_of_dataset(page, header_at, frames, times_at)
        if count_at < 0:
            raise RuntimeError("the first page does not hold all commit words")
        write_at(descriptor, struct.pack("<qqq", count_at, length_at, address_at), words_at)
        for word, value in ((count_at, 0), (length_at, 0), (address_at, _NOWHERE)):
            write_at(descriptor, struct.pack("<q", value), word)
        os.fsync(descriptor)


def _words_of_dataset(page, header_at, length, data_at):
    """Return the places of length and address of a one-dimensional dataset of 8 bytes an element.

    HDF5 file format specification, IV.A: a version 1 object header is 16 bytes long; its first message (8
    bytes, then the content) is the data space (type 1), which has the first length after 8 bytes. The layout
    message of contiguous storage (version 3, class 1) then has the address and the size in bytes.
    """
    length_at = header_at + 32
    layout_at = page.find(struct.pack("<BBqq", 3, 1, data_at, 8 * length), header_at)
    if length_at + 8 > len(page) or layout_at < 0:
        raise RuntimeError("the first page does not hold all commit words")
    version, kind = page[header_at], page[header_at + 16]
    if version != 1 or kind != 1 or struct.unpack_from("<q", page, length_at)[0] != length:
        raise RuntimeError("the object headers of this HDF5 library are not laid out as expected")
    return length_at, layout_at + 2


def _lay_out_steps(steps, points, frames):
    """Say where each frame lies: its points and point data move on, the topology is shared."""
    steps["NumberOfParts"] = np.ones(frames, "<i8")
    steps["PointOffsets"] = np.arange(frames, dtype="<i8") * points
    # zeros, which take no space where they are not written
    for name, shape in {"PartOffsets": (), "CellOffsets": (4,), "ConnectivityIdOffsets": (4,)}.items():
        create_dataset(steps, name, (frames, *shape), "<i8")
    offsets = steps.create_group("PointDataOffsets")
    for name in POINT_DATA:
        offsets[name] = steps["PointOffsets"]  # the same data under another name


def _lay_out_points(group, points, frames):
    """Create the arrays of all frames and the vertices that they share."""
    group.attrs["Version"] = np.array([2, 2], "<i8")
    group.attrs.create("Type", np.bytes_("PolyData"))
    group["NumberOfPoints"] = np.array([points], "<i8")
    create_dataset(group, "Points", (frames * points, 3), "<f8")
    point_data = group.create_group("PointData")
    for name, (dtype, shape) in POINT_DATA.items():
        create_dataset(point_data, name, (frames * points, *shape), dtype)
    for name in ("Vertices", "Lines", "Polygons", "Strips"):
        cells = points if name == "Vertices" else 0
        topology = group.create_group(name)
        topology["NumberOfCells"] = np.array([cells], "<i8")
        topology["NumberOfConnectivityIds"] = np.array([cells], "<i8")
        if cells:
            create_dataset(topology, "Offsets", (cells + 1,), "<i8")
            create_dataset(topology, "Connectivity", (cells,), "<i8")
        else:
            topology["Offsets"] = np.zeros(1, "<i8")
            topology["Connectivity"] = np.zeros(0, "<i8")
