"""A drop on a floor: the cap that the wetting angle makes of it, and Laplace's pressure in it."""

import numpy as np
from scipy.spatial import cKDTree

TITLE = "Drop on a floor"
SPACINGS = (0.01,)
VARIANTS = {
    "60 deg": ["interfaces[0].wetting_angle=60", "fluids[0].region.box=[[0.2, 0], [0.6, 0.12]]"],
    "90 deg": [],
    "120 deg": ["interfaces[0].wetting_angle=120", "fluids[0].region.box=[[0.25, 0], [0.55, 0.25]]"],
    "60 deg, density 2 : 1": [
        "interfaces[0].wetting_angle=60", "fluids[0].region.box=[[0.2, 0], [0.6, 0.12]]", "fluids[1].density=500",
    ],
    "60 deg, 3D": [
        "dimension=3", "spacing=0.025", "tank={size: [1.2, 1.2, 0.6]}", "interfaces[0].wetting_angle=60",
        "fluids[0].region.box=[[0.25, 0.25, 0], [0.95, 0.95, 0.25]]",
    ],
}  # fmt: skip
NOT_IN_PAPERS = ("60 deg", "120 deg", "60 deg, density 2 : 1", "60 deg, 3D")
TARGETS = {"height [%]": 5.0, "base [%]": 5.0, "jump [%]": 5.0}


def cap(job):
    """Radius of the circle or sphere that the cap with the drop's content is part of, m, and the cosine of its angle.

    Area r^2 (theta - sin theta cos theta), volume pi r^3 (1 - cos theta)^2 (2 + cos theta) / 3.
    """
    low, high = np.array(job.fluids[0].region.box)
    content = np.prod(high - low)
    angle = np.radians(job.interfaces[0].wetting_angle)
    cosine = np.cos(angle)
    if job.dimension == 2:
        return np.sqrt(content / (angle - np.sin(angle) * cosine)), cosine
    return (3.0 * content / (np.pi * (1.0 - cosine) ** 2 * (2.0 + cosine))) ** (1.0 / 3.0), cosine


def sides(results, time):
    """Places of the drop's particles and the bath's beside the interface, m: two arrays (., dimension)."""
    liquid = results.liquid(time)
    axes = [0, 2] if results.job.dimension == 2 else [0, 1, 2]
    drop, bath = (liquid["position"][liquid["fluid"] == number][:, axes] for number in (0, 1))
    reach = 1.3 * results.job.spacing
    return drop[cKDTree(bath).query(drop)[0] < reach], bath[cKDTree(drop).query(bath)[0] < reach]


def fitted(results, time):
    """Radius and height of the centre above the floor of the circle or sphere that fits both sides best, m."""
    at = np.concatenate(sides(results, time))
    *centre, rest = np.linalg.lstsq(np.c_[2.0 * at, np.ones(len(at))], (at**2).sum(axis=1), rcond=None)[0]
    return np.sqrt(rest + np.dot(centre, centre)), centre[-1]


def jump(results, time):
    """Pressure in the drop less that in the bath, over Laplace's."""
    job, liquid = results.job, results.liquid(time)
    radius, cosine = cap(job)
    drop = liquid["fluid"] == 0
    centre = liquid["position"][drop].mean(axis=0)
    centre[2] = -radius * cosine
    far = np.linalg.norm(liquid["position"] - centre, axis=1) > 1.3 * radius
    found = liquid["pressure"][drop].mean() - liquid["pressure"][~drop & far].mean()
    return found * radius / ((job.dimension - 1) * job.interfaces[0].surface_tension)


def measure(results):
    """Means of the last quarter of the run."""
    late = results.frames[results.frames >= 0.75 * results.frames[-1]]
    radius, cosine = cap(results.job)
    found, up = np.mean([fitted(results, time) for time in late], axis=0)
    return {
        "height [%]": 100.0 * ((found + up) / (radius * (1.0 - cosine)) - 1.0),
        "base [%]": 100.0 * (np.sqrt(found**2 - up**2) / (radius * np.sqrt(1.0 - cosine**2)) - 1.0),
        "jump [%]": 100.0 * (np.mean([jump(results, time) for time in late]) - 1.0),
        "angle off [deg]": np.degrees(np.arccos(-up / found)) - results.job.interfaces[0].wetting_angle,
    }


def plot(figure, runs):
    """Both sides of the interface at the end, and the cap."""
    panels = figure.subplots(len(runs), 1, sharex=True, squeeze=False)[:, 0]
    for panel, ((variant, preset, _), results) in zip(panels, runs.items(), strict=True):
        radius, cosine = cap(results.job)
        middle = results.job.tank.size[0] / 2
        for at, name in zip(sides(results, results.frames[-1]), ("drop", "bath"), strict=True):
            # in 3D, by the distance from the axis
            across = np.linalg.norm(at[:, :-1] - middle, axis=1) if at.shape[1] == 3 else at[:, 0] - middle
            panel.plot(across / radius, at[:, -1] / radius, ".", markersize=3, label=name)
        angle = np.linspace(-np.arccos(cosine), np.arccos(cosine), 200)
        panel.plot(np.sin(angle), np.cos(angle) - cosine, color="black", linewidth=0.8, label="theory")
        panel.set_aspect("equal")
        panel.set_ylim(0.0, None)
        panel.set_title(f"{variant}, {preset}", fontsize="small")
        panel.grid(alpha=0.3)
    panels[0].legend(fontsize="x-small")
    panels[-1].set_xlabel("x / R")
