"""What a checkpoint may be continued with: the same job, files of the same contents, and a state that can be."""

import hashlib
import json
from typing import Annotated

import numpy as np
from pydantic import BaseModel, Field, StrictFloat, StrictInt, ValidationError

from parmps.errors import InputError, OutputError
from parmps.fields import dotted
from parmps.particles import DUMMY, FIELDS, FLUID, OUT, WALL
from parmps.records import read_motion_file

FREE_KEYS = ("time.end", "output")
"""Dotted keys of the job that a restart may change. Probes may be added, and motion files may go on otherwise."""
FAR = 1000.0
"""In sides of the tank; liquid that got so far from it would have a thousand times the energy of its fall over it."""

GREAT = 1e300
"""No counter gets near it."""

_BLOCK = 2**24
_MISSING = "nothing"
_Count = Annotated[StrictInt, Field(ge=0)]
_Finite = Annotated[StrictFloat, Field(allow_inf_nan=False)]


class _Table(BaseModel, extra="forbid"):
    columns: list[str]
    rows: _Count
    last: _Finite | None
    sha256: str


class _Frames(BaseModel, extra="forbid"):
    frames: _Count
    last: _Finite | None


class _Results(BaseModel, extra="forbid"):
    table: _Table
    particles: _Frames


class _File(BaseModel, extra="forbid"):
    path: str
    sha256: str
    rows: str | None = None


class _Probe(BaseModel, extra="allow"):
    name: str


class _Job(BaseModel, extra="allow"):
    probes: list[_Probe]


class _Worst(BaseModel, extra="forbid"):
    stage: str | None
    time: _Finite | None


class _Ledger(BaseModel, extra="forbid"):
    totals: list[_Finite]
    least: list[_Finite]
    gains: list[_Finite]
    scale: _Finite
    tension: _Finite
    gained_most: _Finite
    volume_most: _Finite
    volume_time: _Finite
    worst: _Worst


class _Attributes(BaseModel):
    """What is in the header of a checkpoint; who adds more to it looks at it himself."""

    version: str
    job: _Job
    inputs: dict[str, _File]
    results: _Results
    counters: dict[str, StrictInt | StrictFloat]
    left: list[tuple[_Count, tuple[_Finite, _Finite, _Finite], _Count]]
    ledger: _Ledger


class Inputs:
    """Contents of the files that a job reads, as they are now.

    Parameters
    ----------
    job : Job

    Raises
    ------
    InputError
        A file cannot be read.
    """

    def __init__(self, job):
        self._files = {key: (path, _file_sum(key, path)) for key, path in job.input_files.items()}
        self._records = {}
        for number, item in enumerate(job.motion):
            if item.kind == "file":
                key = f"motion[{number}].path"
                time, columns = read_motion_file(item.path, key)[:2]
                self._records[key] = time - (item.start or 0.0), columns

    def until(self, time):
        """Tell a checkpoint what was read.

        Parameters
        ----------
        time : float
            Of the checkpoint, s.

        Returns
        -------
        dict of str to dict
            By key: ``path``, ``sha256`` of the file, and ``rows``: of those of a recorded motion up to this time, or
            None.
        """
        rows = {key: _rows_sum(*record, time) for key, record in self._records.items()}
        return {
            key: {"path": path, "sha256": content, "rows": rows.get(key)}
            for key, (path, content) in self._files.items()
        }


def check_attributes(path, header, job, version, inputs, counters):
    """Refuse to continue another job, the work of another version of the code, or what no run can have left.

    Parameters
    ----------
    path : path-like
        The checkpoint.
    header : Header
        Of the checkpoint.
    job : dict
        The job to run, with its defaults, as plain data.
    version : str
        Version of the running code.
    inputs : Inputs
        Of the job to run.
    counters : dict
        Those of a simulation at its start: names and types.

    Raises
    ------
    InputError
        Naming the key that differs, with the value or file in the checkpoint and now.
    OutputError
        If the header holds what cannot be.
    """
    written = header.attributes.get("version")
    if written != version:
        raise InputError("restart", f"the checkpoint was written by parmps {written}, this is {version}")
    try:
        attributes = _Attributes.model_validate(header.attributes)
    except ValidationError as error:
        problem = error.errors()[0]
        raise OutputError(path, f"is damaged: {dotted(problem['loc'])}: {problem['msg']}") from None
    _check_counters(path, attributes.counters, counters)
    time = attributes.counters["time"]
    now = inputs.until(time)
    # The checkpoint's job went through JSON, which knows no tuples.
    files = attributes.inputs.keys() & now.keys()
    _check_job(header.attributes["job"], json.loads(json.dumps(job)), files)
    _check_inputs(attributes.inputs, now, time)
    end = job["time"]["end"]
    if time > end:
        raise InputError("time.end", f"got {end:g} s, must be at least {time:g} s, the time of the checkpoint")


def _check_counters(path, found, counters):
    if found.keys() != counters.keys():
        raise OutputError(path, "is damaged: its counters are not those of a run")
    for name, value in found.items():
        if isinstance(counters[name], int):
            fine = isinstance(value, int) and 0 <= value < 2**53
        elif name == "step_min":  # infinite before the first step
            fine = value > 0.0
        else:
            fine = abs(value) < GREAT and (name != "time" or value >= 0.0)
        if not fine:
            raise OutputError(path, f"is damaged: its counter {name} is {value!r:.40}")


def _check_job(before, job, files):
    differences = list(_differences(before, job, "", files))
    if differences:
        key, before, now = differences[0]
        message = (
            f"{before} in the checkpoint, {now} in the job; only time.end and output may change, probes be added, and "
            "recorded motions go on otherwise"
        )
        if len(differences) > 1:
            message += "; also different: " + ", ".join(other for other, _, _ in differences[1:])
        raise InputError(key, message)


def _check_inputs(before, now, time):
    for key, file in now.items():
        was = before.get(key)
        if was is None:
            raise InputError(key, f"{file['path']}: the checkpoint does not know what was in it")
        if file["sha256"] == was.sha256:
            continue
        where = file["path"] if file["path"] == was.path else f"{file['path']} (in the checkpoint {was.path})"
        if file["rows"] is None:
            raise InputError(key, f"{where}: its contents are not those that the run up to the checkpoint read")
        if file["rows"] != was.rows:
            reason = f"its rows up to t = {time:g} s, the time of the checkpoint, are not those that the run read"
            raise InputError(key, f"{where}: {reason}; only later ones may change")


def _differences(before, now, key, files):
    """Yield (dotted key, value before, value now) for every leaf that differs; files are told apart by contents."""
    if key in FREE_KEYS or key in files or before == now:
        return
    if key == "probes":
        others = {probe["name"]: probe for probe in now}
        for number, probe in enumerate(before):
            yield from _differences(probe, others.get(probe["name"], _MISSING), f"probes[{number}]", files)
    elif isinstance(before, dict) and isinstance(now, dict):
        for name in [*before, *(name for name in now if name not in before)]:
            inner = f"{key}.{name}" if key else name
            yield from _differences(before.get(name, _MISSING), now.get(name, _MISSING), inner, files)
    elif isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        for index, (one, other) in enumerate(zip(before, now, strict=True)):
            yield from _differences(one, other, f"{key}[{index}]", files)
    else:
        yield key, before, now


def _file_sum(key, path):
    try:
        content = hashlib.sha256()
        with open(path, "rb") as file:
            while block := file.read(_BLOCK):
                content.update(block)
        return content.hexdigest()
    except OSError as error:
        raise InputError(key, f"{path}: cannot be read: {error.strerror}") from None


def _rows_sum(time, columns, until):
    """Checksum of the rows of a record up to a time, which is in s."""
    count = np.searchsorted(time, until, side="right")
    content = hashlib.sha256(time[:count].tobytes())
    for name in sorted(columns):
        content.update(name.encode() + columns[name][:count].tobytes())
    return content.hexdigest()


def check_particles(path, arrays, totals, job):
    """Refuse particles that no run can have left.

    Parameters
    ----------
    path : path-like
        The checkpoint.
    arrays : dict of str to ndarray
        Fields of some of its particles.
    totals : dict of str to int
        Number of ``fluid`` particles, whose ids come first, and of all, ``total``.
    job : Job

    Raises
    ------
    OutputError
        Naming the field.
    """
    ids, kind = arrays["id"], arrays["kind"]
    liquid = ids < totals["fluid"]
    middle = 0.5 * np.array(job.tank.size if job.dimension == 3 else (job.tank.length, 0.0, job.tank.height))
    allowed = {
        "id": np.sort(ids)[1:] > np.sort(ids)[:-1],
        "kind": np.where(liquid, (kind == FLUID) | (kind == OUT), (kind == WALL) | (kind == DUMMY)),
        "fluid": (arrays["fluid"] >= 0) & (arrays["fluid"] < len(job.fluids)),
        "parent": (arrays["parent"] >= -1) & (arrays["parent"] < totals["total"]),
    }
    for name, values in arrays.items():
        fine = allowed.get(name, np.isfinite(values))
        if name == "id":
            fine = np.append(fine, (ids >= 0) & (ids < totals["total"]))
        if name == "position":
            fine = np.abs(values - middle) <= FAR * max(job.tank.size)
        if not np.all(fine):
            raise OutputError(path, f"is damaged: the {name} of some of its particles cannot be")


def check_arrays(path, header, totals):
    """Refuse arrays that are not those of this job's particles.

    Parameters
    ----------
    path : path-like
        The checkpoint.
    header : Header
    totals : dict of str to int
        As for `check_particles`.

    Raises
    ------
    OutputError
    """
    wanted = {name: (np.dtype(dtype).str, shape) for name, (dtype, shape) in FIELDS.items()}
    if header.arrays != wanted:
        raise OutputError(path, "is damaged: its arrays are not those of a run")
    if header.total != totals["total"]:
        raise OutputError(path, f"is damaged: it holds {header.total} particles, the job has {totals['total']}")
