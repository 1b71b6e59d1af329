"""Draw the probe signals of a run: one panel a quantity, force and moment by component.

usage: python postproc/plot_probes.py DIR [--reference FILE.csv] [--show]

Reads DIR/probes.csv, also while the run goes on, and writes DIR/probes.png. A reference file has the same
form: `time [s]`, then columns `name [unit]`; each is drawn in black in the panel of its quantity.
"""

import argparse
import csv
import re
import sys
from pathlib import Path

import matplotlib
import numpy as np

QUANTITIES = {
    "Pa": "Pressure",
    "m": "Height",
    "N": "Force",
    "N/m": "Force per width",
    "N m": "Moment",
    "N m/m": "Moment per width",
    "m/s": "Velocity",
}
"""What a unit stands for, in the order of the panels."""

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Okabe and Ito's palette, distinguishable by the colour-blind; without its yellow, too pale for lines."""

REFERENCE_STYLES = ("--", ":", "-.")


def read_signals(path):
    """Read a table of signals.

    Parameters
    ----------
    path : path-like
        CSV file: time in s, then columns with the header ``name [unit]``.

    Returns
    -------
    time : (n,) float64
        s.
    signals : list of tuple
        Name (str), unit (str) and values (n,) of each column.

    Raises
    ------
    ValueError
        If the file holds no rows, or something else than numbers below its header.
    """
    with open(path, newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    if not rows:
        raise ValueError(f"{path} has no rows yet")
    values = np.array(rows, dtype=float)
    signals = []
    for column, title in enumerate(header[1:], start=1):
        name, unit = re.fullmatch(r"(.*?)\s*(?:\[(.*)\])?", title).groups(default="")
        signals.append((name, unit, values[:, column]))
    return values[:, 0], signals


def panel_key(name, unit):
    """Return what the signals of one panel share, such that panels sort in their order.

    Parameters
    ----------
    name, unit : str
        Of a signal. Forces and moments whose name ends in x, y or z are kept apart by that component: the
        weight of the liquid would flatten the others.

    Returns
    -------
    tuple
        Rank of the unit, unit and component.
    """
    known = list(QUANTITIES)
    component = name[-1:] if unit.startswith("N") and name[-1:] in ("x", "y", "z") else ""
    return (known.index(unit) if unit in known else len(known), unit, component)


def draw(figure, run, reference=None):
    """Draw signals into a figure, those of one quantity into one panel.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        An empty figure.
    run, reference : tuple
        What `read_signals` returned for the run, and for the reference if there is one.
    """
    tables = [run] if reference is None else [run, reference]
    keys = sorted({panel_key(name, unit) for _, signals in tables for name, unit, _ in signals})
    figure.set_size_inches(9.0, 1.0 + 2.2 * len(keys))
    panels = figure.subplots(len(keys), 1, sharex=True, squeeze=False)[:, 0]
    for panel, key in zip(panels, keys, strict=True):
        curves = [
            [(time, name, values) for name, unit, values in signals if panel_key(name, unit) == key]
            for time, signals in tables
        ]
        draw_panel(panel, key, *curves)
    time = run[0]
    panels[-1].set_xlabel("Time [s]")
    panels[-1].set_xlim(time[0], max(time[-1], time[0] + 1e-9))
    figure.align_ylabels(panels)


def draw_panel(panel, key, run, reference=()):
    """Draw the signals of one quantity: those of the run in colour, those of the reference black and broken.

    Parameters
    ----------
    panel : matplotlib.axes.Axes
        Where to draw.
    key : tuple
        As returned by `panel_key`.
    run, reference : sequence of tuple
        Time (n,), s, name and values (n,) of each signal.
    """
    _, unit, component = key
    largest = max(np.nanmax(np.abs(values), initial=0.0) for _, _, values in [*run, *reference])
    scale, prefix = (1e-3, "k") if unit.startswith(("Pa", "N")) and largest >= 2000.0 else (1.0, "")
    for index, (time, name, values) in enumerate(run):
        panel.plot(time, scale * values, color=COLOURS[index % len(COLOURS)], linewidth=1.2, label=name)
    for index, (time, name, values) in enumerate(reference):
        style = REFERENCE_STYLES[index % len(REFERENCE_STYLES)]
        panel.plot(time, scale * values, style, color="black", linewidth=1.0, label=f"{name} (reference)")
    quantity = " ".join([QUANTITIES.get(unit, "Signal"), component]).strip()
    panel.set_ylabel(f"{quantity}\n[{prefix}{unit or '-'}]")
    panel.grid(alpha=0.3)
    panel.spines[["top", "right"]].set_visible(False)
    panel.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)


def main(arguments=None):
    """Run the command.

    Parameters
    ----------
    arguments : list of str, optional
        In place of the command line.

    Returns
    -------
    int
        Exit status: 0, or 2 if the signals could not be read.
    """
    parser = argparse.ArgumentParser(description="Draw the probe signals of a run into DIR/probes.png.")
    parser.add_argument("directory", metavar="DIR", type=Path, help="output directory of the run")
    parser.add_argument("--reference", metavar="FILE.csv", type=Path, help="signals to draw beside them")
    parser.add_argument("--show", action="store_true", help="open a window as well")
    options = parser.parse_args(arguments)
    if not options.show:
        matplotlib.use("Agg")
    from matplotlib import pyplot  # after the choice of the backend

    files = [options.directory / "probes.csv", options.reference]
    try:
        tables = [read_signals(file) for file in files if file is not None]
    except (OSError, ValueError) as error:
        print(f"plot_probes: {error}", file=sys.stderr)
        return 2
    figure = pyplot.figure(layout="constrained")
    draw(figure, *tables)
    picture = options.directory / "probes.png"
    figure.savefig(picture, dpi=150)
    print(picture)
    if options.show:
        pyplot.show()
    pyplot.close(figure)
    return 0


if __name__ == "__main__":
    sys.exit(main())
