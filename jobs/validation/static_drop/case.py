"""A drop at rest: the pressure of Laplace, and the currents that errors of the curvature drive."""

import numpy as np

TITLE = "Static drop"
SPACINGS = (0.02,)
FREE = "kinematic_viscosity: 0.001, surface_tension: 1.0}]"


def ball(spacings):
    """A ball of so many spacings in radius in a bath."""
    return [
        "dimension=3",
        f"spacing={0.3 / spacings:g}",
        "tank={size: [1.0, 1.0, 1.0]}",
        "fluids=[{name: drop, region: {ball: {centre: [0.5, 0.5, 0.5], radius: 0.3}}, kinematic_viscosity: 0.001},"
        " {name: bath, depth: 1.0, kinematic_viscosity: 0.001}]",
        "time.end=16",
    ]


def free_ball(spacings):
    """The same in empty space."""
    return [
        *ball(spacings), "tank={size: [1.4, 1.4, 1.4]}", "interfaces=[]",
        f"fluids=[{{name: drop, region: {{ball: {{centre: [0.7, 0.7, 0.7], radius: 0.3}}}}, {FREE}",
    ]  # fmt: skip


FREE_VARIANTS = {
    "2D, free surface": [
        "interfaces=[]", f"fluids=[{{name: drop, region: {{disc: {{centre: [0.5, 0.5], radius: 0.25}}}}, {FREE}",
    ],
    **{f"3D, free surface, {spacings} spacings": free_ball(spacings) for spacings in (6, 8, 10)},
}  # fmt: skip
VARIANTS = {
    "2D": [],
    "2D, density 1000 : 1": ["fluids[1].density=1"],
    **{f"3D, {spacings} spacings": ball(spacings) for spacings in (6, 10)},
    **FREE_VARIANTS,
}
NOT_IN_PAPERS = tuple(FREE_VARIANTS)
TARGETS = {"jump [%]": 2.0, "capillary number [1e-3]": 1.0}


def radius(results):
    """Of the disc or ball with the volume of the drop's particles, m."""
    job, number = results.job, results.liquid(0.0)["fluid"]
    share = np.mean(number == 0) if job.interfaces else len(number) * job.spacing**job.dimension
    volume = share * (np.prod(job.tank.size) if job.interfaces else 1.0)
    return np.sqrt(volume / np.pi) if job.dimension == 2 else (0.75 * volume / np.pi) ** (1.0 / 3.0)


def tension(job):
    """Of the interface or the free surface, N/m."""
    return job.interfaces[0].surface_tension if job.interfaces else job.fluids[0].surface_tension


def jump(results, time):
    """Pressure in the drop less that in the bath, or that of empty space, over Laplace's."""
    job, liquid, r0 = results.job, results.liquid(time), radius(results)
    centre = liquid["position"][liquid["fluid"] == 0].mean(axis=0)
    r = np.linalg.norm(liquid["position"] - centre, axis=1)
    found = liquid["pressure"][r < 0.7 * r0].mean()
    if job.interfaces:
        found -= liquid["pressure"][r > 1.3 * r0].mean()
    return found / ((job.dimension - 1) * tension(job) / r0)


def capillary(results, time):
    """Greatest speed times viscosity over surface tension."""
    job, speed = results.job, np.linalg.norm(results.liquid(time)["velocity"], axis=1).max()
    viscosity = max(fluid.density * fluid.kinematic_viscosity for fluid in job.fluids)
    return viscosity * speed / tension(job)


def measure(results):
    """Mean jump and currents in the last quarter of the run."""
    late = results.frames[results.frames >= 0.75 * results.frames[-1]]
    return {
        "jump [%]": 100.0 * (np.mean([jump(results, t) for t in late]) - 1.0),
        "capillary number [1e-3]": 1e3 * np.mean([capillary(results, t) for t in late]),
        "volume [%]": 100.0 * results.record["volume_drift"],
    }


def plot(figure, runs):
    """Jump and capillary number over time."""
    above, below = figure.subplots(2, 1, sharex=True)
    for (variant, preset, _), results in runs.items():
        above.plot(results.frames, [jump(results, t) for t in results.frames], label=f"{variant}, {preset}")
        below.semilogy(results.frames[1:], [capillary(results, t) for t in results.frames[1:]])
    above.set_ylabel("Pressure jump / Laplace's")
    above.set_ylim(0.8, 1.2)
    above.legend(fontsize="small")
    below.set_ylabel("Capillary number")
    below.set_xlabel("Time [s]")
    for panel in (above, below):
        panel.grid(alpha=0.3)
