"""Water at rest in 3D against hydrostatics."""

import numpy as np
from results import rms

TITLE = "Water at rest in three dimensions"
SPACINGS = (0.01,)
TARGETS = {"pressure [% of rho g h]": 0.6, "speed [% of sqrt(g h)]": 0.2, "volume [%]": 0.2}
BEGIN = 1.0
"""s, from when on errors count."""


def errors(results):
    """Mean and rms pressure error over rho g h, and rms speed over sqrt(g h), of the liquid in each frame, %."""
    job = results.job
    depth, gravity = job.fluids[0].depth, job.gravity
    rows = []
    for time in results.frames:
        liquid = results.liquid(time)
        error = liquid["pressure"] / (1000.0 * gravity * depth) - (1.0 - liquid["position"][:, 2] / depth)
        speed = np.linalg.norm(liquid["velocity"], axis=1) / np.sqrt(gravity * depth)
        rows.append([100.0 * error.mean(), 100.0 * rms(error), 100.0 * rms(speed)])
    return np.array(rows)


def measure(results):
    """Rms over the particles and the frames after the first second, means, and the drift of the volume."""
    after = results.frames >= BEGIN
    mean, pressure, speed = errors(results)[after].T
    level = results.probe("level")[results.time >= BEGIN].mean()
    return {
        "pressure [% of rho g h]": rms(pressure),
        "mean pressure [%]": mean.mean(),
        "speed [% of sqrt(g h)]": rms(speed),
        "volume [%]": 100.0 * results.record["volume_drift"],
        "mean level [%]": 100.0 * (level / results.job.fluids[0].depth - 1.0),
    }


def plot(figure, runs):
    """History of the errors."""
    panels = figure.subplots(2, 1, sharex=True)
    for (_, preset, _), results in runs.items():
        for panel, values in zip(panels, errors(results)[:, 1:].T, strict=True):
            panel.semilogy(results.frames[1:], values[1:], label=preset)
    for panel, key, text in zip(panels, TARGETS, ("Pressure error [% of ρgh]", "Speed [% of √(gh)]"), strict=False):
        panel.axhline(TARGETS[key], color="black", linestyle="--", linewidth=0.8, label="target")
        panel.set_ylabel(text)
        panel.grid(alpha=0.3)
    panels[0].legend(fontsize="small")
    panels[1].set_xlabel("Time [s]")
