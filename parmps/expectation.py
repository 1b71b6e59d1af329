"""Errors and costs to expect, from the runs of the trade study (``make trade``) in trade.csv."""

import csv
import math
from pathlib import Path
from typing import NamedTuple

from parmps.scheme import Scheme, expand_scheme

TABLE = Path(__file__).with_name("trade.csv")
CLASSES = (1.0, 3.0, 10.0, 30.0)
"""Bounds between the classes of errors, %."""


class Expectation(NamedTuple):
    """What a value is expected to be.

    Attributes
    ----------
    value : float
    beyond : str
        Where it is that of the nearest run, and of which; empty between two runs.
    """

    value: float
    beyond: str


def read_table(path=TABLE):
    """Read the runs of the study.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    list of dict
        One a run, numbers as float.
    str
        By what and with what code and machine they were measured.
    """
    with open(path, newline="", encoding="utf-8") as file:
        source = file.readline().removeprefix("#").strip()
        rows = list(csv.DictReader(file))
    names = set(rows[0]) - {"scene", "preset"} if rows else set()
    return [row | {name: float(row[name]) for name in names} for row in rows], source


def interpolate(points, at, unit, slope=0.0):
    """Value at a place between measured ones, by straight lines between the logarithms.

    Parameters
    ----------
    points : list of (float, float)
        Place and value of each run, at least one.
    at : float
    unit : str
        Of the places.
    slope : float
        Power of the place by which the value goes on beyond the outermost runs.

    Returns
    -------
    Expectation
    """
    points = sorted(points)
    for (low, first), (high, last) in zip(points, points[1:], strict=False):
        if low <= at <= high and low < high:
            share = math.log(at / low) / math.log(high / low)
            return Expectation(first ** (1.0 - share) * last**share, "")
    place, value = min(points, key=lambda point: abs(math.log(at / point[0])))
    return Expectation(value * (at / place) ** slope, "" if at == place else f"measured with {place:g} {unit}")


def expected_errors(table, preset, dimension, rows):
    """Errors that a preset had in each scene of the study, interpolated for a number of rows.

    Parameters
    ----------
    table : list of dict
        As returned by `read_table`.
    preset : str
    dimension : int
    rows : float
        Rows of particles over the depth of the liquid.

    Returns
    -------
    dict of str to Expectation
        By scene, %.
    """
    mine = [row for row in table if (row["preset"], row["dimension"]) == (preset, dimension)]
    return {
        scene: interpolate([(r["rows"], r["error [%]"]) for r in mine if r["scene"] == scene], rows, "rows")
        for scene in dict.fromkeys(row["scene"] for row in mine)
    }


def expected_cost(table, preset, dimension, particles):
    """CPU-seconds of a step on one core, interpolated for a number of particles; in proportion beyond the runs.

    Parameters
    ----------
    table, preset, dimension
        As for `expected_errors`.
    particles : int
        Walls included.

    Returns
    -------
    Expectation or None
        s; None if the preset was not measured in so many dimensions.
    """
    points = [
        (row["particles"], row["CPU time [s]"] / row["steps"])
        for row in table
        if (row["preset"], row["dimension"]) == (preset, dimension)
    ]
    return interpolate(points, particles, "particles", slope=1.0) if points else None


def error_class(error):
    """Name the class of an error.

    Parameters
    ----------
    error : float
        %.

    Returns
    -------
    str
        Such as ``1 to 3 %``.
    """
    if error < CLASSES[0]:
        return f"below {CLASSES[0]:g} %"
    for low, high in zip(CLASSES, CLASSES[1:], strict=False):
        if error < high:
            return f"{low:g} to {high:g} %"
    return f"above {CLASSES[-1]:g} %"


def changed_settings(scheme):
    """Names of the settings that a scheme does not have from its preset.

    Parameters
    ----------
    scheme : Scheme

    Returns
    -------
    list of str
    """
    own = Scheme(**expand_scheme(scheme.preset))
    return [name for name in Scheme.model_fields if getattr(scheme, name) != getattr(own, name)]
