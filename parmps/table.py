"""Probe signals in ``probes.csv``: lines that appear whole, and that a checkpoint knows."""

import csv
import errno
import hashlib
import io
import os
from itertools import pairwise
from pathlib import Path

import numpy as np

from parmps.errors import OutputError
from parmps.output import ELSEWHERE, write_text
from parmps.slabs import open_regular, output_errors

LONGEST_LINE = 2**24
"""Bytes; ten thousand signals take a fiftieth of it."""
GAP = 1.5
"""Over the usual time from row to row, from which on rows are missing between two; a missing one makes 2."""


class ProbeTable:
    """A header, then one line a sampling time.

    Every line reaches the file by one write, so a reader finds whole lines only. Times are written so that
    they read back as the same number, signals with ten digits.

    Parameters
    ----------
    path : path-like
        The file, replaced if it exists.
    columns : sequence of str
        Signals in the order of the values, ``name [unit]``.
    lines : sequence of str
        Lines that it begins with below the header.

    Raises
    ------
    OutputError
        If it cannot be written.
    """

    def __init__(self, path, columns, lines=()):
        self.path = Path(path)
        self.columns = tuple(columns)
        text = "".join([_header_line(columns), *lines])
        write_text(path, text)
        self._rows = len(lines)
        self._last = float(lines[-1].split(",", 1)[0]) if lines else None
        self._content = hashlib.sha256(text.encode())
        with output_errors(self.path):
            self._descriptor = open_regular(self.path, os.O_WRONLY | os.O_APPEND)

    def mark(self):
        """Tell a checkpoint what belongs to it.

        Returns
        -------
        dict
            ``columns``; ``rows``, their number; ``last``, the time of the last one, s, or None; ``sha256`` of the
            header and the rows.
        """
        content = self._content.hexdigest()
        return {"columns": list(self.columns), "rows": self._rows, "last": self._last, "sha256": content}

    def write(self, time, values):
        """Append one line.

        Parameters
        ----------
        time : float
            s.
        values : sequence of float
            One value a signal, in the units of the header.

        Raises
        ------
        OutputError
            If the line cannot be written; the lines before it stay as they were.
        ValueError
            If the number of values is not that of the columns.
        """
        if len(values) != len(self.columns):
            raise ValueError(f"{len(values)} values for {len(self.columns)} signals")
        data = _line([repr(float(time)), *(f"{value:.10g}" for value in values)]).encode()
        with output_errors(self.path):
            written = os.write(self._descriptor, data)
            if written < len(data):
                os.ftruncate(self._descriptor, os.fstat(self._descriptor).st_size - written)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self._content.update(data)
        self._rows, self._last = self._rows + 1, float(time)

    def sync(self):
        """Wait until the lines are on the disk; call before a checkpoint relies on them.

        Raises
        ------
        OutputError
            If the disk did not take them.
        """
        with output_errors(self.path):
            os.fsync(self._descriptor)

    def close(self):
        """Close the file."""
        os.close(self._descriptor)


def kept_lines(path, columns, mark):
    """Read the lines that belong to a checkpoint, for a table that goes on after them.

    Parameters
    ----------
    path : path-like
        The table of the run to continue; it stays as it is.
    columns : sequence of str
        Signals of the run to come, ``name [unit]``: those of the checkpoint, and new ones, which are ``nan`` up to
        there.
    mark : dict
        What `ProbeTable.mark` told at the checkpoint.

    Returns
    -------
    list of str
        For a new `ProbeTable`.

    Raises
    ------
    OutputError
        If the file is missing, or does not hold what belongs to the checkpoint.
    """
    known = mark["columns"]
    with output_errors(path), open(open_regular(path), "rb") as file:
        lines, torn = _lines(file, mark["rows"] + 1)
    rows = _picked(lines, known)
    content = "".join([_header_line(known), *(_line(cells) for cells in rows)])
    if len(rows) < mark["rows"] or hashlib.sha256(content.encode()).hexdigest() != mark["sha256"]:
        raise OutputError(path, f"{_difference(lines, torn, mark)}; {ELSEWHERE}")
    places = [known.index(name) + 1 if name in known else None for name in columns]
    return [_line([cells[0], *("nan" if at is None else cells[at] for at in places)]) for cells in rows]


def _header_line(columns):
    """Return the first line of a table, names quoted where CSV needs it."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(["time [s]", *columns])
    return text.getvalue()


def _line(cells):
    return ",".join(cells) + "\n"


def _lines(file, count):
    """Read the first whole lines of a file, up to a number, and what is torn by a power failure where they end."""
    lines = []
    while len(lines) < count:
        line = file.readline(LONGEST_LINE)
        if not line.endswith(b"\n"):
            return lines, line
        lines.append(line.decode("utf-8", "replace"))
    return lines, b""


def _picked(lines, columns):
    """Cells of the time and of some columns, a list a row; the rows end before one that lacks any."""
    names = next(csv.reader(lines[:1]), [])
    if any(name not in names for name in columns):
        return []
    places = [0, *(names.index(name) for name in columns)]
    rows = []
    for line in lines[1:]:
        cells = line.removesuffix("\n").split(",")
        if len(cells) != len(names):
            break
        rows.append([cells[place] for place in places])
    return rows


def _difference(lines, torn, mark):
    """Say how a table differs from what belongs to a checkpoint."""
    wanted, last = mark["rows"], mark["last"]
    names = next(csv.reader(lines[:1]), [])
    lost = [name for name in mark["columns"] if name not in names]
    if lost:
        return f"lacks the column {lost[0]} of the checkpoint" if names else "has no header"
    nul = [number for number, line in enumerate(lines) if "\0" in line]
    if nul:
        return f"holds NUL bytes in row {nul[0]} of the {wanted} that belong to the checkpoint"
    found = len(lines) - 1
    times = np.array([_time(line) for line in lines[1:]])
    if found < wanted:
        begin = f"after t = {times[-1]:g} s" if found else "all"
        how = ", NUL bytes are in their place" if b"\0" in torn else ""
        return (
            f"has {found} of the {wanted} rows that belong to the checkpoint: those {begin} up to t = {last:g} s "
            f"are missing{how}"
        )
    steps = np.diff(times)
    for (one, other), step in zip(pairwise(times), steps, strict=True):
        if step > GAP * np.nanmedian(steps):
            return f"has a gap from t = {one:g} to {other:g} s"
    return f"was changed: its {wanted} rows up to t = {last:g} s are not those that belong to the checkpoint"


def _time(line):
    """Time of a row, s; NaN where it is no number."""
    try:
        return float(line.split(",", 1)[0])
    except ValueError:
        return np.nan
