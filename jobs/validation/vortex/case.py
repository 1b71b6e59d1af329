"""One cell of Taylor and Green's vortices, which without viscosity stands still for ever."""

import numpy as np
from results import rms

TITLE = "Taylor-Green vortex without viscosity"
SPACINGS = (0.02, 0.01)
TARGETS = {"velocity [%]": 1.0, "energy [%]": 2.0}


def exact(position):
    """Velocity (n, 3), m/s, of the stream function sin(pi x) sin(pi z) / pi: no flow through the walls."""
    x, z = np.pi * position[:, 0], np.pi * position[:, 2]
    return np.stack([np.sin(x) * np.cos(z), 0.0 * x, -np.cos(x) * np.sin(z)], axis=1)


def initial(job):
    """The vortex on a lattice."""
    points = (np.arange(round(1.0 / job.spacing)) + 0.5) * job.spacing
    x, z = np.meshgrid(points, points, indexing="ij")
    position = np.stack([x, 0.0 * x, z], axis=-1).reshape(-1, 3)
    return position, exact(position)


def history(results):
    """Kinetic energy over that of the start in each frame."""
    energy = np.array([np.mean(results.liquid(time)["velocity"] ** 2) for time in results.frames])
    return energy / energy[0]


def measure(results):
    """Error of the velocity at the end, after about one turn of the core, and the energy that was lost until then."""
    liquid = results.liquid(results.frames[-1])
    wanted = exact(liquid["position"])
    return {
        "velocity [%]": 100.0 * rms(liquid["velocity"] - wanted) / rms(wanted),
        "energy [%]": 100.0 * (history(results)[-1] - 1.0),
    }


def plot(figure, runs):
    """Energy over time, and the velocity across the middle."""
    left, right = figure.subplots(1, 2)
    for (_, preset, spacing), results in runs.items():
        left.plot(results.frames, history(results), label=f"{preset}, {1e3 * spacing:g} mm")
        liquid = results.liquid(results.frames[-1])
        near = np.abs(liquid["position"][:, 0] - 0.5) < spacing
        right.plot(liquid["velocity"][near, 0], liquid["position"][near, 2], ".", markersize=3)
    z = np.linspace(0.0, 1.0, 101)
    right.plot(np.cos(np.pi * z), z, color="black", label="exact")
    left.set_xlabel("Time [s]")
    left.set_ylabel("Kinetic energy over that of the start")
    right.set_xlabel("Velocity at the middle [m/s]")
    right.set_ylabel("z [m]")
    for panel in (left, right):
        panel.grid(alpha=0.3)
        panel.legend(fontsize="small")
