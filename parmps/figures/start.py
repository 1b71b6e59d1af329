"""The particles at the start of a job, as ``plan --png`` draws them."""

import numpy as np

from parmps.figures.style import FLUID_COLOURS, new_figure, save
from parmps.particles import DUMMY, FLUID, WALL
from parmps.simulation import wall_layers
from parmps.tank import place


def draw_plan(job, path):
    """Draw the particles at the start; of a 3D tank, the layer in the middle of the width.

    Parameters
    ----------
    job : Job
    path : path-like
        Of the picture.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    from matplotlib.collections import EllipseCollection
    from matplotlib.patches import Patch, Rectangle

    start = place(job, job.scheme.wall, layers=wall_layers(job.scheme))
    l0 = start.spacing
    y = start.position[:, 1]
    middle = 0.5 * job.tank.size[1] if job.dimension == 3 else 0.0
    nearest = y[np.abs(y - middle).argmin()]
    layer = np.abs(y - nearest) < 0.4 * l0
    at, kind, fluid = start.position[layer][:, [0, 2]], start.kind[layer], start.fluid[layer]
    low, high = at.min(axis=0) - l0, at.max(axis=0) + l0
    figure = new_figure(7.0 * (high[1] - low[1]) / (high[0] - low[0]) + 1.2)
    axes = figure.add_subplot()
    groups = [(kind == DUMMY, "0.8", "dummy"), (kind == WALL, "0.45", "wall")]
    for number, liquid in enumerate(job.fluids):
        groups.append(((kind == FLUID) & (fluid == number), FLUID_COLOURS[number % len(FLUID_COLOURS)], liquid.name))
    for chosen, colour, _ in groups:
        size = np.full(chosen.sum(), l0)
        axes.add_collection(
            EllipseCollection(
                size,
                size,
                np.zeros(len(size)),
                units="xy",
                offsets=at[chosen],
                offset_transform=axes.transData,
                facecolors=colour,
                linewidths=0,
            )
        )
    axes.add_patch(Rectangle((0, 0), job.tank.length, job.tank.height, fill=False, linewidth=0.8))
    for solid in start.geometry.solids:
        if solid.low[1] <= middle <= solid.high[1] or job.dimension == 2:
            x, z = solid.low[0], solid.low[2]
            axes.add_patch(Rectangle((x, z), solid.high[0] - x, solid.high[2] - z, fill=False, linewidth=0.8))
    patches = [Patch(color=colour, label=label) for chosen, colour, label in groups if chosen.any()]
    axes.legend(handles=patches, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    axes.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x [m]", ylabel="z [m]")
    axes.set_title(job.title, loc="left")
    save(figure, path)
