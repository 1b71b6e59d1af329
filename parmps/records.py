"""Reading of recorded motions: tables as loggers, spreadsheets and Fortran write them, and OpenFOAM's."""

import os
import re
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from parmps.errors import InputError
from parmps.fields import nearest, show

TRANSLATIONS = ("surge", "sway", "heave")
ROTATIONS = ("roll", "pitch", "yaw")
COLUMNS = {f"{kind} [m]": kind for kind in TRANSLATIONS} | {f"{kind} [deg]": kind for kind in ROTATIONS}
TIME_COLUMN = "time [s]"

MAX_FILE_BYTES = 64 * 2**20
HEAD = 10_000
"""Characters that show of which kind a file is."""
MIN_ROWS = 2
MIN_INTERVAL = 1e-6  # s; closer rows would make the curve's derivatives meaningless
MAX_VALUE = 1e6  # s, m or deg

_NAME = re.compile(r"\s*(\w+)\s*\[\s*(\w+)\s*\]\s*")
_TABULATED = re.compile(r"\s*\d*\s*\(\s*\(")
"""How OpenFOAM's list of rows begins: the number of rows, which may be missing, and two brackets."""
_ROW = re.compile(r"\(([^()]*)\(\s*\(([^()]*)\)\s*\(([^()]*)\)\s*\)\s*\)")
_WANTED = "a list of (time ((surge sway heave) (roll pitch yaw)))"
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eEdD][-+]?\d+)?")


class Table(NamedTuple):
    """A recorded motion as its file has it.

    Attributes
    ----------
    time : (n,) float64, s
    columns : dict of str to (n,) float64
        Values by kind of motion, m or deg.
    outer : bool
        As OpenFOAM has it: turns come before displacements, which are along the axes of the earth, and roll after
        pitch after yaw.
    """

    time: np.ndarray
    columns: dict
    outer: bool


def read_motion_file(path, key="motion"):
    """Read a recorded motion.

    Parameters
    ----------
    path : str
        Text, one header row and numbers: ``time [s]`` and at least one of ``surge [m]``, ``sway [m]``,
        ``heave [m]``, ``roll [deg]``, ``pitch [deg]``, ``yaw [deg]``, in any order. Cells are separated by commas,
        semicolons, tabs or spaces, and may be quoted; but for commas as separators, decimals may have one; an
        exponent is marked by E or D. Blank lines and lines that begin with ``#`` are passed over. Or a list of
        ``(time ((surge sway heave) (roll pitch yaw)))``, OpenFOAM's tabulated6DoFMotion.
    key : str
        Key of the job file that names it, for messages.

    Returns
    -------
    Table

    Raises
    ------
    InputError
        Names the file, line and column that cannot be used.
    """
    return _read(path, key, state_of(path, key))


def state_of(path, key):
    """Tell the states of a file apart.

    Parameters
    ----------
    path, key : str
        As in :func:`read_motion_file`.

    Returns
    -------
    tuple of int

    Raises
    ------
    InputError
        There is no such file.
    """
    if not os.path.isfile(path):
        raise InputError(key, f"{path}: no such file")
    stat = os.stat(path)
    return stat.st_mtime_ns, stat.st_size, stat.st_ino


@lru_cache(maxsize=8)
def _read(path, key, _state):
    """Read a file, once for each of its states: checks, plan and run all ask for it."""
    text = _text(path, key)
    outer = _TABULATED.match(_bare(text[:HEAD])) is not None
    names, lines, cells = _tabulated(_bare(text), path, key) if outer else _separated(text, path, key)
    # float() also takes digit groups such as 1_000, which no logger means
    table = None if "_" in text else _plain_numbers(cells)
    if table is None:
        table = _numbers(cells, names, lines, path, key)
    if len(table) < MIN_ROWS:
        raise InputError(key, f"{path}: got {len(table)} rows of values, must be at least {MIN_ROWS}")
    time = table[:, names.index(TIME_COLUMN)]
    early = np.flatnonzero(np.diff(time) < MIN_INTERVAL)
    if len(early):
        k = early[0] + 1
        raise InputError(
            key,
            f"{path}, line {lines[k]}, column '{TIME_COLUMN}': got {time[k]:g} after {time[k - 1]:g}, must grow by "
            f"{MIN_INTERVAL:g} s or more",
        )
    columns = {COLUMNS[name]: column for name, column in zip(names, table.T, strict=True) if name != TIME_COLUMN}
    for column in (time, *columns.values()):
        column.flags.writeable = False  # all who ask get the same
    return Table(time, columns, outer)


def _text(path, key):
    """The text of a file: UTF-8, or Latin-1, which any bytes are."""
    try:
        with open(path, "rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        raise InputError(key, f"{path}: cannot be read: {error.strerror}") from None
    if len(data) > MAX_FILE_BYTES:
        raise InputError(key, f"{path}: must be at most {MAX_FILE_BYTES // 2**20} MiB")
    try:
        if data.startswith((b"\xff\xfe", b"\xfe\xff")):
            return data.decode("utf-16")
        if b"\0" in data:
            raise InputError(key, f"{path}: has zero bytes; must be text")
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _bare(text):
    """Text without C comments and OpenFOAM's header, with all its lines."""
    skipped = r"/\*.*?\*/|//[^\n]*|FoamFile\s*\{[^}]*\}"
    return re.sub(skipped, lambda found: "\n" * found[0].count("\n"), text, flags=re.DOTALL)


def _separated(text, path, key):
    """Names of the columns, and the number and cells of each line of a table with a header."""
    for mark in ('"', "'"):
        text = text.replace(mark, "")
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    rows = [(n, line) for n, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")]
    if not rows:
        raise InputError(key, f"{path}, line 1: the header row must name '{TIME_COLUMN}' and at least one motion")
    number, header = rows[0]
    above = [(n, line.strip("# ")) for n, line in enumerate(lines[: number - 1], 1) if TIME_COLUMN in line]
    if above and TIME_COLUMN not in header:  # numpy writes the header as a comment
        number, header = above[-1]
    else:
        rows.pop(0)
    separator = next((mark for mark in (";", "\t", ",") if mark in header), None)
    if separator is None and _NAME.search(header):  # names have a space themselves
        names = [f"{name} [{unit}]" for name, unit in _NAME.findall(header)]
        if _NAME.sub("", header):
            names = [header]
    else:
        names = header.split(separator)
    names = [" ".join(name.split()) for name in names]
    trailing = len(names) > 1 and names[-1] == ""
    names = names[:-1] if trailing else names
    _check_header(names, f"{path}, line {number}", key)
    cells = [line.split(separator) for _, line in rows]
    for (number, _), row in zip(rows, cells, strict=True):
        if len(row) == len(names) + 1 and not row[-1].strip():
            row.pop()
        if len(row) != len(names):
            marks = {";": "semicolons", "\t": "tabs", ",": "commas", None: "spaces"}[separator]
            raise InputError(
                key,
                f"{path}, line {number}: got {len(row)} values separated by {marks}, must be {len(names)} as in the "
                "header",
            )
    if separator != "," and "," in text:
        _decimal_points(cells, rows, path, key)
    return names, [number for number, _ in rows], cells


def _decimal_points(cells, rows, path, key):
    """Put points for decimal commas, in place."""
    with_comma = next((k for k, row in enumerate(cells) if any("," in cell for cell in row)), None)
    if with_comma is None:
        return
    with_point = next((k for k, row in enumerate(cells) if any("." in cell for cell in row)), None)
    if with_point is not None:
        raise InputError(
            key,
            f"{path}, lines {rows[with_comma][0]} and {rows[with_point][0]}: numbers have decimal commas and points; "
            "must have one of them",
        )
    for row in cells:
        row[:] = [cell.replace(",", ".") for cell in row]


def _tabulated(text, path, key):
    """Names, lines and cells of OpenFOAM's list."""
    names, lines, cells = [TIME_COLUMN, *COLUMNS], [], []
    begin, at, end = 0, text.index("(") + 1, text.rindex(")")
    for found in _ROW.finditer(text, at, end):
        _check_gap(text, at, found.start(), path, key)
        last = lines[-1] if lines else 1
        lines.append(last + text.count("\n", begin, found.start()))
        cells.append([cell for part in found.groups() for cell in part.split()])
        if len(cells[-1]) != len(names):
            raise InputError(key, f"{path}, line {lines[-1]}: got {show(found[0])}, must be {_WANTED}")
        begin, at = found.start(), found.end()
    _check_gap(text, at, end, path, key)
    return names, lines, cells


def _check_gap(text, begin, end, path, key):
    """Refuse what is between two rows of OpenFOAM's list."""
    found = text[begin:end].strip()
    if found:
        line = text.count("\n", 0, text.index(found, begin)) + 1
        raise InputError(key, f"{path}, line {line}: got {show(found)}, must be {_WANTED}")


def _plain_numbers(cells):
    """Convert cells to numbers, (n, columns); None if there are others."""
    try:
        table = np.array([[float(cell) for cell in row] for row in cells])
    except ValueError:
        return None
    return table if len(table) and np.abs(table).max() <= MAX_VALUE else None


def _numbers(cells, names, lines, path, key):
    """Convert cells to numbers, those of Fortran as well, (n, columns)."""
    return np.array(
        [
            [_number(cell, f"{path}, line {n}, column '{name}'", key) for cell, name in zip(row, names, strict=True)]
            for n, row in zip(lines, cells, strict=True)
        ]
    )


def _number(text, where, key):
    """Convert one cell to a number."""
    text = text.strip()
    value = float(re.sub("[dD]", "e", text)) if _NUMBER.fullmatch(text) else np.nan
    if not abs(value) <= MAX_VALUE:
        raise InputError(key, f"{where}: got {show(text)}, must be a number of at most {MAX_VALUE:g}")
    return value


def _check_header(names, where, key):
    allowed = [TIME_COLUMN, *COLUMNS]
    for number, name in enumerate(names):
        if name not in allowed:
            raise InputError(key, f"{where}: unknown column {show(name)}{nearest(name, allowed)}")
        if name in names[:number]:
            raise InputError(key, f"{where}: column '{name}' is given twice")
    if TIME_COLUMN not in names or len(names) < 2:
        raise InputError(key, f"{where}: the header row must name '{TIME_COLUMN}' and at least one motion")
