"""Charts of a sweep: one figure a measure, over what the cases change."""

import csv
import textwrap

import numpy as np

from parmps.campaign import measure_names, results_path
from parmps.errors import InputError
from parmps.figures.style import COLOURS, LINES, REFERENCE, finish_panel, new_figure, save, set_title
from parmps.sweep import NAME, parameters

MARKERS = ("o", "s", "^", "D", "v", "P")
BARS = 0.7
"""Width of the bars of one value, over the distance to those of the next."""
AXIS_LETTERS, LEAST_LETTERS = 100, 8
"""How many letters there is room for along the axis, and how short a line is at least."""
LONGEST = 40
"""Letters of a value; of one that is longer, such as a list of baffles, the first case is shown that has it."""


def draw_sweep(sweep):
    """Draw all measures of a sweep from its ``results.csv``.

    Parameters
    ----------
    sweep : Sweep

    Returns
    -------
    dict of str to matplotlib.figure.Figure
        By the name of the measure; none where no case is done.

    Raises
    ------
    InputError
        If the table or a reference cannot be read.
    """
    names = len(parameters(sweep))
    header, rows = read_table(results_path(sweep))
    keys, widths = header[1 : names + 1], [len(measure_names(item)) for item in sweep.measures]
    places = names + 1 + np.cumsum([0, *widths[:-1]])
    done = [row for row in rows if row[-1] == "done"]
    figures = {}
    for item, place in zip(sweep.measures, places, strict=True):
        values = [row for row in done if row[place] != ""]
        if not values:
            continue
        parts = [_shown([row[column] for row in values], [row[0] for row in values]) for column in range(1, names + 1)]
        heights = np.array([float(row[place]) for row in values])
        reference = read_table(item.reference) if item.reference else None
        if keys[0] == NAME:  # which stands for all that a case changes
            named = [cell or row[0] for cell, row in zip(parts[0], values, strict=True)]
            figure = draw_measure(["case"], [named], header[place], heights, reference)
        else:
            figure = draw_measure(keys, parts, header[place], heights, reference, sweep.sample is not None)
        set_title(figure, sweep.title)
        figures[item.name] = figure
    return figures


def save_sweep(sweep):
    """Draw all measures of a sweep into files.

    Parameters
    ----------
    sweep : Sweep

    Returns
    -------
    list of Path
        The pictures, ``MEASURE.png`` beside the table.

    Raises
    ------
    InputError, OutputError
        As `draw_sweep`, or if a picture cannot be written.
    """
    beside = results_path(sweep).with_name
    return [save(figure, beside(f"{name}.png")) for name, figure in draw_sweep(sweep).items()]


def read_table(path):
    """Read a table of text.

    Parameters
    ----------
    path : path-like
        CSV file.

    Returns
    -------
    header : list of str
    rows : list of list of str

    Raises
    ------
    InputError
        If it cannot be read, or a row has not as many cells as the header.
    """
    try:
        with open(path, newline="", encoding="utf-8") as file:
            header, *rows = csv.reader(file)
    except (OSError, UnicodeDecodeError, ValueError, csv.Error) as error:
        raise InputError("", f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if any(len(row) != len(header) for row in rows):
        raise InputError("", f"{path}: every row must have {len(header)} cells, like the header")
    return header, rows


def draw_measure(keys, parts, label, values, reference=None, scattered=False):
    """Draw one measure over the keys that the cases change.

    Of a grid or list, the key with the most values runs along the axis, and every combination of the others is
    a curve; bars where the values are no numbers. Of a sample, every key has a panel of its own.

    Parameters
    ----------
    keys : list of str
        Titles of the keys.
    parts : list of list of str
        Their values, case by case.
    label : str
        Title of the measure.
    values : (cases,) float64
    reference : tuple, optional
        Header and rows of a table: values of some of the keys, and of the measure in the last column.
    scattered : bool
        Whether the cases are a sample.

    Returns
    -------
    matplotlib.figure.Figure
    """
    if scattered:
        return _scatter(keys, parts, label, values)
    spread = [len(set(part)) for part in parts]
    main = max(range(len(keys)), key=lambda index: (_is_number(parts[index]) and spread[index] > 1, spread[index]))
    others = [index for index in range(len(keys)) if index != main]
    figure = new_figure(4.8)
    panel = figure.add_subplot()
    curves = [tuple(parts[index][case] for index in others) for case in range(len(values))]
    distinct = list(dict.fromkeys(curves))
    titles = [short(keys[index]) for index in others]
    numeric = _is_number(parts[main])
    joined = numeric and reference is None  # a line between the points would be taken for theory
    ticks = list(dict.fromkeys(parts[main]))
    for number, curve in enumerate(distinct):
        mine = [case for case in range(len(values)) if curves[case] == curve]
        x = np.array([float(parts[main][case]) if numeric else ticks.index(parts[main][case]) for case in mine])
        style = {"color": COLOURS[number % len(COLOURS)], "label": _name(titles, curve) or None}
        if numeric:
            order = np.argsort(x)
            marker = MARKERS[number % len(MARKERS)] + ("-" if joined else "")
            panel.plot(x[order], values[mine][order], marker, **style)
        else:
            width = BARS / len(distinct)
            panel.bar(x - 0.5 * BARS + (number + 0.5) * width, values[mine], width, **style)
    if reference is not None:
        _draw_reference(panel, reference, keys[main])
    if not numeric:
        wide = max(LEAST_LETTERS, AXIS_LETTERS // len(ticks))
        names = ["\n".join(textwrap.wrap(tick, wide)) for tick in ticks]
        panel.set_xticks(range(len(ticks)), names, parse_math=False)
        panel.axhline(0.0, color="0.3", linewidth=0.8)
        panel.set_axisbelow(True)
    panel.set(xlabel=keys[main], ylabel=label)
    finish_panel(panel, legend=len(distinct) > 1 or reference is not None)
    return figure


def _scatter(keys, parts, label, values):
    columns = min(len(keys), 3)
    rows = -(-len(keys) // columns)
    figure = new_figure(0.6 + 3.0 * rows)
    panels = figure.subplots(rows, columns, sharey=True, squeeze=False)
    for panel, key, part in zip(panels.flat, keys, parts, strict=False):
        panel.plot(np.array(part, float), values, "o", color=COLOURS[0], markeredgecolor="white")
        panel.set_xlabel(key)
        finish_panel(panel, legend=False)
    for panel in panels.flat[len(keys) :]:
        panel.set_axis_off()
    for panel in panels[:, 0]:
        panel.set_ylabel(label)
    return figure


def _draw_reference(panel, reference, key):
    """Draw the reference's last column over the key's column, one curve for each combination of the others."""
    header, rows = reference
    if key not in header[:-1]:
        raise InputError("measures.reference", f"has no column '{key}'; there are {', '.join(header)}")
    main = header.index(key)
    others = [column for column in range(len(header) - 1) if column != main]
    curves = list(dict.fromkeys(tuple(row[column] for column in others) for row in rows))
    try:
        for line, curve in zip(LINES * len(curves), curves, strict=False):
            mine = [row for row in rows if tuple(row[column] for column in others) == curve]
            name = _name([short(header[column]) for column in others], curve)
            x, y = np.array([[float(row[main]), float(row[-1])] for row in mine]).T
            panel.plot(x, y, line, label=f"{header[-1].split(' [')[0]}{', ' if name else ''}{name}", **REFERENCE)
    except ValueError as error:
        raise InputError("measures.reference", f"must hold numbers: {error}") from None


def _name(titles, values):
    """Name a curve by the values of the keys that it does not run over."""
    return ", ".join(f"{title} = {value}" for title, value in zip(titles, values, strict=True))


def short(title):
    """Shorten the title of a key for a legend.

    Parameters
    ----------
    title : str
        Such as ``fluids[0].depth [m]``.

    Returns
    -------
    str
        Such as ``depth [m]``.
    """
    return title.split(".")[-1]


def _shown(cells, cases):
    """Cells of the table as a figure shows them: instead of long ones, the first case that has them."""
    first = dict(zip(reversed(cells), reversed(cases), strict=True))
    return [cell if len(cell) <= LONGEST else f"as in case {first[cell]}" for cell in cells]


def _is_number(cells):
    try:
        [float(cell) for cell in cells]
    except ValueError:
        return False
    return True
