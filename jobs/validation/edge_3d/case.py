"""Dam break on a box against SPHERIC benchmark 2: impulses of the pressure before and on the box."""

from scipy.integrate import trapezoid

TITLE = "Dam break on a box, SPHERIC 2"
SPACINGS = (0.05, 0.03, 0.02)
RECORDED = {"P1": 2536.0, "P3": 2020.0}
"""Impulses of the record from 0.4 to 0.9 s, Pa s."""
STRUCK = 0.4, 0.9
TARGETS = {"P1 impulse [%]": 15.0, "P3 impulse [%]": 15.0, "suction on top [Pa s]": 50.0, "pull [N]": 1.0}


def impulse(results, name):
    """Integral of a signal while the box is struck."""
    time = results.time
    struck = (time >= STRUCK[0]) & (time <= STRUCK[1])
    return trapezoid(results.probe(name)[struck], time[struck])


def measure(results):
    """Impulses over the recorded ones, suction on top of the box, and pull on it."""
    ratios = {name: impulse(results, name) / wanted for name, wanted in RECORDED.items()}
    found = {f"{name} impulse [%]": 100.0 * (ratio - 1.0) for name, ratio in ratios.items()}
    found["suction on top [Pa s]"] = max(-min(impulse(results, name) for name in ("P5", "P7")), 0.0)
    found["pull [N]"] = max(results.probe("load.baffle1.Fx")[results.time <= STRUCK[1]].max(), 0.0)
    return found


def plot(figure, runs):
    """Pressures at the box, and heights."""
    panels = figure.subplots(2, 3, sharex=True)
    for panel, name in zip(panels.flat, ("P1", "P3", "P5", "P7", "H2", "H4"), strict=True):
        for (_, preset, spacing), results in runs.items():
            panel.plot(results.time, results.probe(name), linewidth=0.8, label=f"{preset}, {1e3 * spacing:g} mm")
        panel.set_title(name + (" [Pa]" if name[0] == "P" else " [m]"), fontsize="medium")
        panel.grid(alpha=0.3)
    for panel in panels[1]:
        panel.set_xlabel("Time [s]")
    panels[0, 0].legend(fontsize="small")
