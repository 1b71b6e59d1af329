"""Reading what a run left behind, for figures: its job, its signals, its frames."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from parmps.errors import InputError
from parmps.hdf5 import opened
from parmps.loader import parse_job

MOST_DIFFERENCES = 3
"""Settings that a name of a run can tell."""


class Frame(NamedTuple):
    """The particles at one time.

    Attributes
    ----------
    time : float
        s.
    arrays : dict of str to ndarray
        ``position`` (n, 3), m, and all point data.
    """

    time: float
    arrays: dict


def read_job(directory):
    """Read the job of a run.

    Parameters
    ----------
    directory : path-like
        Output directory.

    Returns
    -------
    Job

    Raises
    ------
    InputError
        If there is none, or it is not valid here: its motion file is no longer in its place.
    """
    return parse_job(_open(directory, lambda file: file["parmps/attributes/job"].asstr()[()]), source="the run's job")


def run_names(directories):
    """Name runs by what differs between their jobs.

    Parameters
    ----------
    directories : list of path-like

    Returns
    -------
    list of str
        Their titles, if no two are alike; else such as ``depth = 0.1``; the directories where jobs cannot be read, or
        differ in nothing or in too much to name.
    """
    try:
        settings = [_settings(read_job(directory).model_dump(mode="json")) for directory in directories]
    except InputError:
        return [str(directory) for directory in directories]
    titles = [each.pop("title") for each in settings]
    if all(titles) and len(set(titles)) == len(titles):
        return titles
    keys = list(dict.fromkeys(key for each in settings for key in each if not key.startswith("output.")))
    differing = [key for key in keys if len({each.get(key) for each in settings}) > 1]
    names = [", ".join(f"{key.split('.')[-1]} = {each.get(key, 'none')}" for key in differing) for each in settings]
    if len(differing) > MOST_DIFFERENCES or len(set(names)) < len(names):
        return [str(directory) for directory in directories]
    return names


def _settings(value, key=""):
    """All settings of a job, by their dotted keys."""
    if isinstance(value, dict):
        parts = {f"{key}.{name}".removeprefix("."): part for name, part in value.items()}
    elif isinstance(value, list):
        parts = {f"{key}[{number}]": part for number, part in enumerate(value)}
    else:
        return {key: value}
    return {name: each for at, part in parts.items() for name, each in _settings(part, at).items()}


def read_times(directory):
    """Times of all frames of a run.

    Parameters
    ----------
    directory : path-like
        Output directory.

    Returns
    -------
    (frames,) float64
        s.

    Raises
    ------
    InputError
        If there is no frame yet.
    """
    times = _open(directory, lambda file: file["VTKHDF/Steps/Values"][()])
    if not len(times):
        raise InputError("", f"{_path(directory)} has no frame yet")
    return times


def read_frame(directory, time=None):
    """Read the frame nearest to a time.

    Parameters
    ----------
    directory : path-like
        Output directory.
    time : float, optional
        s; the last frame if not given.

    Returns
    -------
    Frame

    Raises
    ------
    InputError
        If it cannot be read.
    """
    times = read_times(directory)
    number = len(times) - 1 if time is None else int(np.abs(times - time).argmin())

    def read(file):
        group = file["VTKHDF"]
        first = group["Steps/PointOffsets"][number]
        part = slice(first, first + group["NumberOfPoints"][0])
        arrays = {name: array[part] for name, array in group["PointData"].items()}
        return arrays | {"position": group["Points"][part]}

    return Frame(float(times[number]), _open(directory, read))


def _path(directory):
    return Path(directory) / "particles.vtkhdf"


def _open(directory, read):
    path = _path(directory)
    if not path.exists():
        raise InputError("", f"{path}: no such file")
    try:
        with opened(path) as file:
            return read(file)
    except (OSError, KeyError, ValueError) as error:
        raise InputError("", f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
