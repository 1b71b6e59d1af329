"""Snapshots of the particles in their tank, side by side on the same scale, and animations of them."""

import numpy as np

from parmps.errors import InputError
from parmps.figures.results import read_frame, read_job, read_times
from parmps.figures.style import FLUID_COLOURS, SOLID, WIDTH, new_figure, set_title
from parmps.motion import Motion
from parmps.particles import FLUID
from parmps.slabs import output_errors
from parmps.stl import read_surface

FIELDS = ("pressure", "speed", "fluid", "surface")
SCALE_FRAMES = 20
"""Frames that the colour scale of an animation is found from."""
OPEN_HEIGHT = 1.25
"""Heights of an open tank that are shown: liquid may splash over."""


class View:
    """How a run is drawn: which slice, in which frame of reference, on which scale.

    Parameters
    ----------
    job : Job
    field : str
        Of `FIELDS`.
    earth : bool
        Whether the tank is drawn where it is and as it is tilted; else in its own frame.
    across : float, optional
        In 3D: place of the slice across the width, m; the middle by default.
    """

    def __init__(self, job, field, earth, across=None):
        self.job, self.field = job, field
        moves = earth and job.motion
        self.motion = Motion(job.motion, job.gravity, job.dimension, job.tank) if moves else None
        self.across = (job.tank.size[1] / 2 if across is None else across) if job.dimension == 3 else 0.0
        self.outline, self.solids = _outline(job, self.across)
        self.edges = _cut_surface(job.tank.surface, self.across) if job.tank.shape == "stl" else []

    def to_earth(self, points, time):
        """Take points of the tank to where they are drawn.

        Parameters
        ----------
        points : (n, 3) float64
            m.
        time : float
            s.

        Returns
        -------
        (n, 2) float64
            x and z, m.
        """
        return self.placed(points, time)[:, [0, 2]]

    def placed(self, points, time):
        """As `to_earth`, in three dimensions: (n, 3), m."""
        if self.motion is None:
            return points
        state = self.motion.at(time)
        return state.origin + points @ state.rotation.T

    def turn(self, time):
        """Angle of the tank in the picture, positive when the right end is down.

        Parameters
        ----------
        time : float
            s.

        Returns
        -------
        float
            deg.
        """
        if self.motion is None:
            return 0.0
        along = self.motion.at(time).rotation[:, 0]
        return float(np.degrees(np.arctan2(-along[2], along[0])))

    def limits(self, times):
        """Box that holds the tank at some times.

        Parameters
        ----------
        times : sequence of float
            s.

        Returns
        -------
        low, high : (2,) float64
            m.
        """
        reach = self.outline * (1.0, 1.0, 1.0 if self.job.tank.lid else OPEN_HEIGHT)
        points = np.concatenate([self.to_earth(reach, time) for time in times])
        margin = 0.02 * np.ptp(points, axis=0).max()
        return points.min(axis=0) - margin, points.max(axis=0) + margin

    def liquid(self, frame):
        """Liquid particles of the slice: where they are drawn, and the rows of the frame."""
        arrays = frame.arrays
        near = np.abs(arrays["position"][:, 1] - self.across) <= 0.5 * self.job.spacing * (1.0 + 1e-9)
        rows = np.flatnonzero((arrays["type"] == FLUID) & (near | (self.job.dimension == 2)))
        return self.to_earth(arrays["position"][rows], frame.time), rows

    def values(self, frame, rows=None):
        """What colours the liquid: one number a particle, in the unit of the colour bar; of `liquid` by default."""
        rows = self.liquid(frame)[1] if rows is None else rows
        if self.field == "pressure":
            return frame.arrays["pressure"][rows] * 1e-3
        if self.field == "speed":
            return np.linalg.norm(frame.arrays["velocity"][rows], axis=1)
        return frame.arrays[self.field][rows].astype(float)


LABELS = {"pressure": ("Pressure [kPa]", "viridis"), "speed": ("Speed [m/s]", "plasma")}


def _outline(job, across):
    """Corners of the tank's section at a place across the width, and of the baffles in it; y is that place."""
    length, height = job.tank.length, job.tank.height
    low, high = _heights(job, across)
    corners = [(0.0, low), (length, low), (length, high), (0.0, high)]
    chamfer, round_in = job.tank.chamfer, {"cylinder": 2, "sphere": 3}.get(job.tank.shape)
    if round_in == job.dimension:
        angle = np.linspace(0.0, 2.0 * np.pi, 97)
        corners = (length + (high - low) * np.cos(angle)) / 2.0, (height + (high - low) * np.sin(angle)) / 2.0
        corners = np.column_stack(corners)
    elif chamfer is not None and job.dimension == 2:
        (a, b), (c, d) = chamfer.bottom or (0.0, 0.0), chamfer.top or (0.0, 0.0)
        corners = [(a, 0.0), (length - a, 0.0), (length, b), (length, height - d)]
        corners += [(length - c, height), (c, height), (0.0, height - d), (0.0, b)]
    solids = []
    for baffle in job.tank.baffles:
        half = baffle.thickness / 2
        for first, last in _spans(job, baffle, across):
            x = (baffle.x - half, baffle.x + half) if baffle.vertical else (first, last)
            z = (first, last) if baffle.vertical else (baffle.z - half, baffle.z + half)
            solids.append([(x[0], z[0]), (x[1], z[0]), (x[1], z[1]), (x[0], z[1])])
    return _points(corners, across), [_points(solid, across) for solid in solids]


def _cut_surface(path, across):
    """Edges (n, 2, 3), m, at which a slice cuts a surface of triangles."""
    triangles = read_surface(path).triangles
    above = triangles[:, :, 1] > across
    cut = triangles[above.any(axis=1) & ~above.all(axis=1)]
    above = cut[:, :, 1] > across
    alone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), above.argmin(axis=1))
    tip, *others = (cut[np.arange(len(cut)), (alone + k) % 3] for k in range(3))
    share = [((across - tip[:, 1]) / (other[:, 1] - tip[:, 1]))[:, None] for other in others]
    return np.stack([tip + s * (other - tip) for s, other in zip(share, others, strict=True)], axis=1)


def _spans(job, baffle, across):
    """Parts of a plate that a slice cuts: from where to where along its height (vertical) or length, m."""
    size = job.tank.size
    width = baffle.width or (0.0, size[1])
    if job.dimension == 3 and not width[0] <= across <= width[1]:
        return []
    holes = baffle.openings
    if baffle.ring is not None:
        plane = (1, 2) if baffle.vertical else (0, 1)
        holes = [([baffle.ring] * 2, [size[axis] - baffle.ring for axis in plane])]
        parts = [_heights(job, across) if baffle.vertical else (0.0, job.tank.length)]
    else:
        parts = [(baffle.bottom, baffle.top) if baffle.vertical else (baffle.left, baffle.right)]
    across_first = 0 if baffle.vertical else 1  # the corners of an opening are (y, z) or (x, y)
    for low, high in holes:
        if low[across_first] < across < high[across_first]:
            along = 1 - across_first
            cut = [((first, min(last, low[along])), (max(first, high[along]), last)) for first, last in parts]
            parts = [part for pair in cut for part in pair if part[0] < part[1]]
    return parts


def _heights(job, across):
    """Lowest and highest point of the inside at a place across the width of a 3D tank, m."""
    tank = job.tank
    if job.dimension == 2:
        return 0.0, tank.height
    if tank.shape in ("cylinder", "sphere"):
        half = np.sqrt(max(across * (tank.height - across), 0.0))
        return tank.height / 2.0 - half, tank.height / 2.0 + half
    to_side = min(across, tank.size[1] - across)
    legs = (tank.chamfer.bottom, tank.chamfer.top) if tank.chamfer else (None, None)
    rise, fall = (max(1.0 - to_side / pair[0], 0.0) * pair[1] if pair else 0.0 for pair in legs)
    return rise, tank.height - fall


def _points(corners, across):
    x, z = np.array(corners, float).T
    return np.column_stack([x, np.full(len(x), across), z])


def scale_top(view, frames):
    """Find the greatest value of a common colour scale.

    Parameters
    ----------
    view : View
    frames : iterable of Frame

    Returns
    -------
    float
        The greatest of the frames' 99.5th percentiles: a few isolated particles must not wash out the picture.
    """
    tops = [np.percentile(values, 99.5) for values in map(view.values, frames) if len(values)]
    return max([*tops, 1e-12])


def draw_panel(axes, view, frame, top, limits):
    """Draw one frame.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    view : View
    frame : Frame
    top : float
        Of the colour scale.
    limits : tuple
        As `View.limits` returns them.

    Returns
    -------
    matplotlib collection
        The coloured particles, for a colour bar.
    """
    from matplotlib.collections import EllipseCollection, LineCollection
    from matplotlib.patches import Polygon

    at, rows = view.liquid(frame)
    sizes = [np.full(len(at), size) for size in (view.job.spacing, view.job.spacing, 0.0)]
    shown = EllipseCollection(*sizes, units="xy", offsets=at, offset_transform=axes.transData, linewidths=0)
    if view.field in LABELS:
        shown.set(array=view.values(frame), cmap=LABELS[view.field][1], clim=(0.0, top))
    else:
        shown.set_facecolor(np.array(FLUID_COLOURS)[view.values(frame).astype(int) % len(FLUID_COLOURS)])
    axes.add_collection(shown)
    tank, lid = view.to_earth(view.outline, frame.time), view.job.tank.lid
    if not lid:
        half = len(tank) // 2 + 1  # the corners run from the bottom round; an open tank has none along its top
        tank = np.roll(tank, len(tank) - half, axis=0)
    if view.job.tank.shape == "stl":
        axes.add_collection(
            LineCollection([view.to_earth(edge, frame.time) for edge in view.edges], colors=SOLID, linewidths=1.6)
        )
    else:
        axes.add_patch(Polygon(tank, closed=lid, fill=False, edgecolor=SOLID, linewidth=1.6, joinstyle="round"))
    for solid in view.solids:
        axes.add_patch(Polygon(view.to_earth(solid, frame.time), facecolor=SOLID, edgecolor=SOLID, linewidth=0.8))
    low, high = limits
    axes.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    angle = view.turn(frame.time)
    tilt = f", tank turned by {angle:+.1f}°" if abs(angle) > 0.05 else ""
    axes.set_title(f"t = {frame.time:.3f} s{tilt}", loc="left", fontsize="medium")
    return shown


def _key(figure, axes, view, shown, low, high):
    """Add the colour bar, or the legend of the liquids."""
    if view.field in LABELS:
        extend = {(0, 0): "neither", (0, 1): "max", (1, 0): "min", (1, 1): "both"}[low, high]
        figure.colorbar(shown, ax=axes, label=LABELS[view.field][0], extend=extend, shrink=0.85, pad=0.02)
        return
    from matplotlib.patches import Patch

    names = [fluid.name for fluid in view.job.fluids] if view.field == "fluid" else ["inside", "free surface"]
    patches = [Patch(color=colour, label=name) for colour, name in zip(FLUID_COLOURS * 4, names, strict=False)]
    figure.legend(handles=patches, loc="outside right center", frameon=False)


def draw_snapshots(directory, view, times):
    """Draw the frames nearest to some times, all on one scale.

    Parameters
    ----------
    directory : path-like
        Output directory of the run.
    view : View
    times : sequence of float or None
        s; None for the last frame.

    Returns
    -------
    matplotlib.figure.Figure
    """
    frames = [read_frame(directory, time) for time in times]
    limits = view.limits([frame.time for frame in frames])
    top = scale_top(view, frames)
    columns = 1 if len(frames) == 1 else 2
    rows = -(-len(frames) // columns)
    figure, panels = _figure(view, limits, rows, columns)
    for panel, frame in zip(panels.flat, frames, strict=False):
        shown = draw_panel(panel, view, frame, top, limits)
    for panel in panels.flat[len(frames) :]:
        panel.set_axis_off()
    values = np.concatenate([view.values(frame) for frame in frames])
    _key(figure, panels, view, shown, np.min(values, initial=0.0) < 0.0, np.max(values, initial=0.0) > top)
    return figure


def _figure(view, limits, rows, columns):
    """Make a figure of panels with the shape of the tank, and label its outer axes."""
    width, height = limits[1] - limits[0]
    panel_width = (WIDTH - 2.0) / columns
    figure = new_figure(rows * (panel_width * height / width + 0.45) + 1.0)
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for panel in panels[-1]:
        panel.set_xlabel("x [m]")
    for panel in panels[:, 0]:
        panel.set_ylabel("z [m]")
    set_title(figure, view.job.title)
    return figure, panels


def animate(directory, view, path, per_second, first=None, last=None):
    """Write an animation of a run.

    Parameters
    ----------
    directory : path-like
        Output directory of the run.
    view : View
    path : path-like
        ``.gif``, or ``.mp4``, which needs ffmpeg.
    per_second : float
        Frames a second.
    first, last : float, optional
        Part of the run, s.

    Raises
    ------
    InputError
        If ffmpeg is missing, or the part holds no frame.
    OutputError
        If the file cannot be written.
    """
    from matplotlib import animation, pyplot

    times = read_times(directory)
    times = times[(times >= (-np.inf if first is None else first)) & (times <= (np.inf if last is None else last))]
    if not len(times):
        raise InputError("", "no frame in that part of the run")
    if str(path).endswith(".mp4") and not animation.FFMpegWriter.isAvailable():
        raise InputError("", "MP4 needs ffmpeg on the PATH; without it: --format gif")
    writer = animation.FFMpegWriter if str(path).endswith(".mp4") else animation.PillowWriter
    some = times[:: max(len(times) // SCALE_FRAMES, 1)]
    top, limits = scale_top(view, (read_frame(directory, time) for time in some)), view.limits(times)
    figure, panels = _figure(view, limits, 1, 1)
    axes = panels[0, 0]
    shown = draw_panel(axes, view, read_frame(directory, times[0]), top, limits)
    _key(figure, panels, view, shown, False, True)
    figure.canvas.draw()
    figure.set_layout_engine("none")  # the panel must not move from frame to frame
    film = writer(fps=per_second)
    with output_errors(path), film.saving(figure, str(path), dpi=80):
        for time in times:
            for artist in [*axes.collections, *axes.patches]:
                artist.remove()
            draw_panel(axes, view, read_frame(directory, time), top, limits)
            film.grab_frame()
    pyplot.close(figure)


def make_view(directory, field, earth=True, across=None):
    """Prepare to draw a run.

    Parameters
    ----------
    directory : path-like
        Output directory of the run.
    field, earth, across
        As `View` takes them.

    Returns
    -------
    View
    """
    job = read_job(directory)
    if across is not None and (job.dimension == 2 or not 0.0 <= across <= job.tank.size[1]):
        width = f"from 0 m to {job.tank.size[1]:g} m" if job.dimension == 3 else "left out in 2D"
        raise InputError("--across", f"got {across:g} m, must be {width}")
    return View(job, field, earth, across)
