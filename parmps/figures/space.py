"""Pictures of 3D tanks as a whole, which PyVista draws; it is not needed for anything else."""

import numpy as np

from parmps.errors import InputError
from parmps.figures.results import read_frame
from parmps.figures.snapshots import LABELS
from parmps.figures.style import FLUID_COLOURS
from parmps.kernels.walls import distances
from parmps.lattice import build_geometry
from parmps.particles import FLUID
from parmps.slabs import output_errors

PIXELS = (1400, 1000)
MAX_NODES = 2_000_000
"""Of the grid that the walls are found on."""


def draw_space(directory, view, time, path):
    """Draw the liquid as spheres in its tank, whose walls and baffles are translucent.

    Parameters
    ----------
    directory : path-like
        Output directory of the run.
    view : View
    time : float or None
        s; None for the last frame.
    path : path-like
        Of the picture, a PNG.

    Returns
    -------
    path-like

    Raises
    ------
    InputError
        If PyVista is missing, the run is 2D, or the results cannot be read.
    OutputError
        If the picture cannot be written.
    """
    try:
        import pyvista
    except ImportError:
        raise InputError("", "pictures in space need PyVista: pip install pyvista") from None
    job, frame = view.job, read_frame(directory, time)
    if job.dimension == 2:
        raise InputError("", "pictures in space are of 3D runs; of a 2D run: plot particles")
    plotter = pyvista.Plotter(off_screen=True, window_size=PIXELS)
    plotter.set_background("white")
    _add_liquid(plotter, view, frame)
    walls = _walls(job)
    walls.points = view.placed(np.asarray(walls.points), frame.time)
    plotter.add_mesh(walls, color="grey", opacity=0.15, show_scalar_bar=False)
    plotter.add_text(f"{job.title}\nt = {frame.time:.3f} s", font_size=12, color="black")
    titles = {f"{axis}title": f"{axis} [m]" for axis in "xyz"}
    plotter.show_bounds(**titles, location="outer", fmt="%.2f", color="black", font_size=14, use_3d_text=False)
    plotter.enable_parallel_projection()
    plotter.view_vector((0.5, -1.0, 0.35), (0.0, 0.0, 1.0))
    with output_errors(path):
        plotter.screenshot(str(path))
    plotter.close()
    return path


def _add_liquid(plotter, view, frame):
    """Add a sphere a particle, coloured by the view's field."""
    import pyvista

    rows = np.flatnonzero(frame.arrays["type"] == FLUID)
    cloud = pyvista.PolyData(view.placed(frame.arrays["position"][rows], frame.time))
    cloud["value"] = view.values(frame, rows)
    ball = pyvista.Sphere(radius=0.5 * view.job.spacing, theta_resolution=12, phi_resolution=12)
    balls = cloud.glyph(scale=False, orient=False, geom=ball)
    if view.field in LABELS:
        label, colours = LABELS[view.field]
        bar = {"title": label, "color": "black", "vertical": True, "position_x": 0.9, "position_y": 0.2, "height": 0.6}
        limits = (0.0, max(np.percentile(cloud["value"], 99.5), 1e-12))
        plotter.add_mesh(balls, scalars="value", cmap=colours, clim=limits, scalar_bar_args=bar)
        return
    names = [fluid.name for fluid in view.job.fluids] if view.field == "fluid" else ["inside", "free surface"]
    colours = (FLUID_COLOURS * 4)[: len(names)]
    limits = (-0.5, len(names) - 0.5)
    plotter.add_mesh(balls, scalars="value", cmap=list(colours), clim=limits, show_scalar_bar=False)
    key = [[name, colour] for name, colour in zip(names, colours, strict=True)]
    plotter.add_legend(key, bcolor="white", size=(0.2, 0.08))


def _walls(job):
    """Surface of all walls and baffles, where the distance to them is nought, in the tank's frame."""
    import pyvista

    geometry = build_geometry(job, job.scheme.wall)
    size = np.array(job.tank.size)
    step = max(0.25 * job.spacing, float(np.cbrt(np.prod(size) / MAX_NODES)))
    counts = np.ceil(size / step).astype(int) + 3
    grid = pyvista.ImageData(dimensions=counts, spacing=[step] * 3, origin=[-step] * 3)
    grid["distance"] = distances(np.asarray(grid.points, float), geometry.walls)[0]
    return grid.contour([0.0], scalars="distance")
