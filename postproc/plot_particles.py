"""Draw the particles of a run at one time, in the tank frame.

usage: python postproc/plot_particles.py DIR [--time T] [--field pressure|speed|fluid]

Reads DIR/particles.vtkhdf, also while the run goes on, takes the frame nearest to T (the last one by
default) and writes DIR/particles_FIELD.png. Of a 3D run it draws the layer in the middle of the width.
"""

import argparse
import sys
from pathlib import Path

import h5py
import matplotlib
import numpy as np
import yaml

matplotlib.use("Agg")
from matplotlib import pyplot
from matplotlib.collections import EllipseCollection
from matplotlib.patches import Patch

FLUID, WALL, DUMMY = 0, 1, 2
WALL_COLOUR, DUMMY_COLOUR = "0.45", "0.8"
FLUID_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9")
"""Okabe and Ito's palette, distinguishable by the colour-blind."""


def read_frame(path, time=None):
    """Read the committed frame nearest to a time.

    Parameters
    ----------
    path : path-like
        ``particles.vtkhdf``.
    time : float, optional
        s; the last frame if not given.

    Returns
    -------
    time : float
        Of the frame, s.
    spacing : float
        Initial particle spacing of the job, m.
    names : list of str
        Names of the fluids.
    arrays : dict of str to ndarray
        ``position`` (n, 3), m, and all point data.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If there is no frame yet.
    """
    with h5py.File(path, "r") as file:
        group = file["VTKHDF"]
        times = group["Steps/Values"][()]
        if not len(times):
            raise ValueError(f"{path} has no frame yet")
        frame = len(times) - 1 if time is None else int(np.abs(times - time).argmin())
        first = group["Steps/PointOffsets"][frame]
        part = slice(first, first + group["NumberOfPoints"][0])
        arrays = {name: array[part] for name, array in group["PointData"].items()}
        arrays["position"] = group["Points"][part]
        job = yaml.safe_load(file["parmps/attributes/job"].asstr()[()])
    names = [fluid.get("name", f"fluid {index}") for index, fluid in enumerate(job["fluids"])]
    return float(times[frame]), float(job["spacing"]), names, arrays


def middle_layer(arrays, spacing):
    """Keep the particles in the middle of the width; all of them in 2D.

    Parameters
    ----------
    arrays : dict of str to ndarray
        As returned by `read_frame`.
    spacing : float
        m.

    Returns
    -------
    dict of str to ndarray
    """
    y = arrays["position"][:, 1]
    keep = np.abs(y - 0.5 * (y.min() + y.max())) <= 0.5 * spacing * (1.0 + 1e-9)
    return {name: array[keep] for name, array in arrays.items()}


def draw(figure, time, spacing, names, arrays, field):
    """Draw one frame.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        An empty figure.
    time, spacing, names, arrays
        As returned by `read_frame`.
    field : str
        ``pressure``, ``speed`` or ``fluid``.
    """
    x, z = arrays["position"][:, 0], arrays["position"][:, 2]
    kind = arrays["type"]
    width, height = np.ptp(x), np.ptp(z)
    figure.set_size_inches(9.0, 7.0 * height / width + 1.2)
    axes = figure.add_subplot()

    def discs(chosen, **style):
        return axes.add_collection(
            EllipseCollection(
                *(np.full(chosen.sum(), size) for size in (spacing, spacing, 0.0)),
                units="xy",
                offsets=np.column_stack([x, z])[chosen],
                offset_transform=axes.transData,
                linewidths=0,
                **style,
            )
        )

    discs(kind == DUMMY, facecolors=DUMMY_COLOUR)
    discs(kind == WALL, facecolors=WALL_COLOUR)
    liquid = kind == FLUID
    if field == "fluid":
        present = np.unique(arrays["fluid"][liquid])
        patches = []
        for index in present:
            colour = FLUID_COLOURS[index % len(FLUID_COLOURS)]
            discs(liquid & (arrays["fluid"] == index), facecolors=colour)
            patches.append(Patch(color=colour, label=names[index]))
        patches.append(Patch(color=WALL_COLOUR, label="wall"))
        axes.legend(handles=patches, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    else:
        values, label, colours = scalar_field(arrays, field)
        # A few isolated particles must not wash out the picture: the scale stops at the 99.5th percentile.
        values = values[liquid]
        top = max(np.percentile(values, 99.5), 1e-12) if len(values) else 1.0
        below, above = np.min(values, initial=0.0) < 0.0, np.max(values, initial=0.0) > top
        extend = {(0, 0): "neither", (0, 1): "max", (1, 0): "min", (1, 1): "both"}[below, above]
        shown = discs(liquid, array=values, cmap=colours, clim=(0.0, top))
        figure.colorbar(shown, ax=axes, label=label, extend=extend, shrink=0.85)
    axes.set_aspect("equal")
    axes.set_xlim(x.min() - spacing, x.max() + spacing)
    axes.set_ylim(z.min() - spacing, z.max() + spacing)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("z [m]")
    axes.set_title(f"t = {time:.3f} s", loc="left")


def scalar_field(arrays, field):
    """Return a field with its label and colour map.

    Parameters
    ----------
    arrays : dict of str to ndarray
        As returned by `read_frame`.
    field : str
        ``pressure`` or ``speed``.

    Returns
    -------
    values : (n,) float64
        In the unit of the label.
    label : str
        Name and unit.
    colours : str
        Name of the colour map.
    """
    if field == "pressure":
        return arrays["pressure"] * 1e-3, "Pressure [kPa]", "viridis"
    return np.linalg.norm(arrays["velocity"], axis=1), "Speed [m/s]", "plasma"


def main(arguments=None):
    """Run the command.

    Parameters
    ----------
    arguments : list of str, optional
        In place of the command line.

    Returns
    -------
    int
        Exit status: 0, or 2 if the particles could not be read.
    """
    parser = argparse.ArgumentParser(description="Draw the particles of a run into DIR/particles_FIELD.png.")
    parser.add_argument("directory", metavar="DIR", type=Path, help="output directory of the run")
    parser.add_argument("--time", metavar="T", type=float, help="s; the last frame by default")
    parser.add_argument("--field", choices=("pressure", "speed", "fluid"), default="pressure")
    options = parser.parse_args(arguments)
    try:
        time, spacing, names, arrays = read_frame(options.directory / "particles.vtkhdf", options.time)
    except (OSError, KeyError, ValueError) as error:
        print(f"plot_particles: {error}", file=sys.stderr)
        return 2
    figure = pyplot.figure(layout="constrained")
    draw(figure, time, spacing, names, middle_layer(arrays, spacing), options.field)
    picture = options.directory / f"particles_{options.field}.png"
    figure.savefig(picture, dpi=150)
    pyplot.close(figure)
    print(picture)
    return 0


if __name__ == "__main__":
    sys.exit(main())
