"""What all figures share: colours, panels, and how a figure is saved."""

import warnings
from pathlib import Path

try:
    import matplotlib
except ImportError:
    from parmps.errors import InputError

    raise InputError("", "figures need matplotlib: pip install matplotlib") from None

from parmps.slabs import output_errors

# What a title asks for and the font has not is drawn as a box, which says enough.
warnings.filterwarnings("ignore", r"Glyph \d+ .* missing from")
matplotlib.rcParams["figure.max_open_warning"] = 0  # a report holds all its figures before it is written

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Okabe and Ito's palette, distinguishable by the colour-blind; without its yellow, too pale for lines."""
FLUID_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9")
"""The same in an order for areas."""
LINES = ("-", "--", ":", "-.")
"""Line styles of several runs in one panel."""
REFERENCE = {"color": "black", "linewidth": 1.0}
SOLID = "0.35"
"""Colour of tanks and baffles."""

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

WIDTH = 9.0
"""Of a figure, inches."""


def new_figure(height, show=False):
    """Make an empty figure.

    Parameters
    ----------
    height : float
        Inches.
    show : bool
        Whether it is to be shown in a window as well.

    Returns
    -------
    matplotlib.figure.Figure
    """
    if not show:
        matplotlib.use("Agg")
    from matplotlib import pyplot  # after the choice of the backend

    return pyplot.figure(figsize=(WIDTH, height), layout="constrained")


def save(figure, path):
    """Write a figure to a file and close it.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    path : path-like
        Its ending chooses the format; PNG without one.

    Returns
    -------
    Path

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    from matplotlib import pyplot

    path = Path(path) if Path(path).suffix else Path(path).with_suffix(".png")
    with output_errors(path):
        figure.savefig(path, dpi=150)
    pyplot.close(figure)
    return path


def finish_panel(panel, legend=True):
    """Give a panel of curves its grid and legend.

    Parameters
    ----------
    panel : matplotlib.axes.Axes
    legend : bool
        Whether it needs one.
    """
    panel.grid(alpha=0.3)
    panel.spines[["top", "right"]].set_visible(False)
    if legend:
        key = panel.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
        for text in key.get_texts():
            text.set_parse_math(False)  # names may hold dollar signs


def set_title(figure, title):
    """Write the title of a figure above all panels, as it stands in the job or sweep.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    title : str
        None if empty.
    """
    if title:
        figure.suptitle(title, x=0.01, ha="left", fontsize="large", parse_math=False)


def panel_key(name, unit):
    """Tell what the signals of one panel share, such that panels sort in their order.

    Parameters
    ----------
    name, unit : str
        Of a signal. Forces and moments whose name ends in x, y or z are kept apart by that component, and those
        on baffles from those on the tank: the weight of the liquid would flatten the others.

    Returns
    -------
    tuple
        Rank of the unit, unit, component and part of the tank.
    """
    known = list(QUANTITIES)
    load = unit.startswith("N")
    component = name[-1:] if load and name[-1:] in ("x", "y", "z") else ""
    part = "on baffles" if load and name.count(".") > 1 and not name.endswith(f".tank.{name[-2:]}") else ""
    return (known.index(unit) if unit in known else len(known), unit, component, part)


def scaled_label(key, largest):
    """Choose the scale of a panel, and its label.

    Parameters
    ----------
    key : tuple
        As returned by `panel_key`.
    largest : float
        Greatest absolute value shown.

    Returns
    -------
    scale : float
        To multiply values by.
    label : str
        Quantity and unit.
    """
    _, unit, component, part = key
    scale, prefix = (1e-3, "k") if unit.startswith(("Pa", "N")) and largest >= 2000.0 else (1.0, "")
    quantity = " ".join(filter(None, [QUANTITIES.get(unit, "Signal"), component]))
    return scale, "\n".join(filter(None, [quantity, part, f"[{prefix}{unit or '-'}]"]))
