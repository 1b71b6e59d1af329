"""Picture of the particles at the start, before anything runs."""

import numpy as np

from parmps.figures.style import FLUID_COLOURS, new_figure, save, set_title
from parmps.kernels.walls import distances
from parmps.particles import DUMMY, FLUID, WALL
from parmps.simulation import wall_layers
from parmps.tank import place

OUTLINE = 600
"""Points along each side of a picture at which the distance to the walls is evaluated."""


def draw_plan(job, path):
    """Draw the particles at the start; of a 3D tank, the layers in the middle of its width and of its length.

    Parameters
    ----------
    job : Job
    path : path-like
        Of the picture.

    Returns
    -------
    Path

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    from matplotlib.patches import Patch

    start = place(job, job.scheme.wall, layers=wall_layers(job.scheme))
    views = [0] if job.dimension == 2 else [0, 1]
    sides = [job.tank.size[axis] + 6.0 * start.spacing for axis in views]
    figure = new_figure(7.0 * (job.tank.height + 6.0 * start.spacing) / sum(sides) + 1.2)
    panels = figure.subplots(1, len(views), squeeze=False, width_ratios=sides)
    groups = [("0.8", "dummy", start.kind == DUMMY), ("0.45", "wall", start.kind == WALL)]
    for number, liquid in enumerate(job.fluids):
        here = (start.kind == FLUID) & (start.fluid == number)
        groups.append((FLUID_COLOURS[number % len(FLUID_COLOURS)], liquid.name, here))
    for axis, axes in zip(views, panels[0], strict=True):
        _draw_layer(axes, job, start, axis, groups)
    patches = [Patch(color=colour, label=label) for colour, label, chosen in groups if chosen.any()]
    panels[0, -1].legend(handles=patches, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    set_title(figure, job.title)
    return save(figure, path)


def _draw_layer(axes, job, start, axis, groups):
    """Draw the particles of the layer in the middle of a tank, seen along y (axis 0 is drawn) or x (axis 1)."""
    from matplotlib.collections import EllipseCollection

    l0, across = start.spacing, 1 - axis
    middle = 0.5 * job.tank.size[across] if job.dimension == 3 else 0.0
    thickness = 0.51 if start.geometry.hull is None else 0.75  # next to a hull, layers are not plane
    layer = np.abs(start.position[:, across] - middle) < thickness * l0
    for colour, _, chosen in groups:
        at = start.position[layer & chosen][:, [axis, 2]]
        sizes = [np.full(len(at), size) for size in (l0, l0, 0.0)]
        axes.add_collection(
            EllipseCollection(
                *sizes, units="xy", offsets=at, offset_transform=axes.transData, facecolors=colour, linewidths=0
            )
        )
    low, high = (end(start.position[layer][:, [axis, 2]], axis=0) for end in (np.min, np.max))
    nodes = [np.linspace(a, b, OUTLINE) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1).reshape(-1, 2)
    point = np.full((len(grid), 3), middle)
    point[:, [axis, 2]] = grid
    gap = distances(point, start.geometry.walls)[0].reshape(OUTLINE, OUTLINE)
    axes.contour(*nodes, gap.T, levels=[0.0], colors="black", linewidths=0.8)
    limits = {"xlim": (low[0] - l0, high[0] + l0), "ylim": (low[1] - l0, high[1] + l0)}
    axes.set(aspect="equal", xlabel=f"{'xy'[axis]} [m]", ylabel="z [m]", **limits)
