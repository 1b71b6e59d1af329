"""Water at rest against hydrostatics."""

import numpy as np
from results import rms

TITLE = "Water at rest"
SPACINGS = (0.01, 0.005)
TILT = np.radians(30.0)
VARIANTS = {
    "plain": [],
    "baffle": ["tank.baffles=[{x: 0.15, bottom: 0.0, top: 0.15, thickness: 0.02}]"],
    "tilted": ["motion=[{kind: file, path: tilt.csv}]"],
}
_WITHIN = {"plain": 1.0, "baffle": 2.0, "tilted": 2.0}
TARGETS = {
    "pressure [% of rho g h]": {name: 0.3 * share for name, share in _WITHIN.items()},
    "speed [% of sqrt(g h)]": {name: 0.1 * share for name, share in _WITHIN.items()},
    "volume [%]": {name: 0.1 * share for name, share in _WITHIN.items()},
}
SETTLED = 5.0
"""s; a tilted surface starts as a staircase."""


def level_plane(job):
    """Unit vector upwards in the tank frame, and the height of the surface along it, m."""
    length, depth = job.tank.length, job.fluids[0].depth
    if not job.motion:
        return np.array([0.0, 0.0, 1.0]), depth
    # the right end is down, and the surface passes through the middle of the still one
    up = np.array([-np.sin(TILT), 0.0, np.cos(TILT)])
    return up, up @ [length / 2, 0.0, depth]


def initial(job):
    """In the tilted tank, liquid below the level surface on the lattice of the walls."""
    if not job.motion:
        return None
    count = np.rint(np.array(job.tank.size) / job.spacing).astype(int)
    x, z = np.meshgrid(*((np.arange(n) + 0.5) * job.spacing for n in count), indexing="ij")
    position = np.stack([x, 0.0 * x, z], axis=-1).reshape(-1, 3)
    up, level = level_plane(job)
    position = position[position @ up < level]
    return position, np.zeros_like(position)


def _errors(results):
    """Times of the frames, s, and the rms pressure error and speed of the liquid in each, %."""
    job = results.job
    up, level = level_plane(job)
    weight, unit = 1000.0 * job.gravity * job.fluids[0].depth, np.sqrt(job.gravity * job.fluids[0].depth)
    rows = []
    for time in results.frames:
        liquid = results.liquid(time)
        error = liquid["pressure"] - 1000.0 * job.gravity * (level - liquid["position"] @ up)
        rows.append([100.0 * rms(error) / weight, 100.0 * rms(np.linalg.norm(liquid["velocity"], axis=1)) / unit])
    return results.frames, np.array(rows)


def measure(results):
    """Rms over all particles and frames after the first second (tilted: after 5 s), and the drift of the volume."""
    time, rows = _errors(results)
    after = time >= (SETTLED if results.job.motion else 1.0)
    found = {"pressure [% of rho g h]": rms(rows[after, 0]), "speed [% of sqrt(g h)]": rms(rows[after, 1])}
    found["volume [%]"] = 100.0 * results.record["volume_drift"]
    if not results.job.motion:
        level = results.probes("level")
        found["mean level [%]"] = 100.0 * (level[results.time >= 1.0].mean() / results.job.fluids[0].depth - 1.0)
    return found


def plot(figure, runs):
    """History of the errors at the coarser spacing."""
    panels = figure.subplots(2, len(VARIANTS), sharex="col", sharey="row", squeeze=False)
    for column, variant in enumerate(VARIANTS):
        for (name, preset, spacing), results in runs.items():
            if name != variant or preset == "papers":
                continue
            time, rows = _errors(results)
            for panel, values in zip(panels[:, column], rows.T, strict=True):
                panel.semilogy(time[1:], values[1:], label=f"{preset}, {1e3 * spacing:g} mm", linewidth=1.0)
        panels[0, column].set_title(variant)
        panels[1, column].set_xlabel("Time [s]")
        for panel, key in zip(panels[:, column], TARGETS, strict=False):
            panel.axhline(TARGETS[key][variant], color="black", linestyle="--", linewidth=0.8)
            panel.grid(alpha=0.3)
    panels[0, 0].set_ylabel("Pressure error [% of ρgh]")
    panels[1, 0].set_ylabel("Speed [% of √(gh)]")
    panels[0, 0].legend(fontsize="small")
