"""LNG tank and rectangular tank of Chen & Wan 2019 at three fills: pressures at the end wall, shape of the surface."""

import numpy as np

TITLE = "LNG tank and rectangular tank in pitch"
SPACINGS = (0.036, 0.024, 0.018, 0.012)
BOX = "tank={size: [0.834, 0.664, 0.477]}"
FILLS = {
    70: [],
    50: ["fluids[0].depth=0.2385", "motion[0].omega=4.7124"],
    30: ["fluids[0].depth=0.143", "motion[0].omega=4.0841"],
}
VARIANTS = {f"LNG {fill} %": changes for fill, changes in FILLS.items()}
VARIANTS |= {f"box {fill} %": [*changes, BOX] for fill, changes in FILLS.items()}
VARIANTS["LNG 70 %, 450 kg/m3"] = ["fluids[0].density=450"]
SENSORS = ("P1", "P2", "P3")
PERIODS = 3
"""The last ones, over which peaks are averaged."""
NEAR = 0.1
"""m from the end wall, within which liquid is drawn."""


def heads(results, name):
    """Pressure of a sensor over rho g: (samples,) float64, m."""
    return results.probe(name) / (results.job.fluids[0].density * results.job.gravity)


def peaks(results, name):
    """Greatest head of each of the last periods: (PERIODS,) float64, m."""
    period = 2.0 * np.pi / results.job.motion[0].omega
    back = ((results.time[-1] - results.time) / period).astype(int)
    return np.array([heads(results, name)[back == n].max() for n in range(PERIODS)])


def measure(results):
    """Mean of the peaks over full periods in heads of the liquid, which its density should not matter to."""
    found = {f"{name} [mm]": 1e3 * peaks(results, name).mean() for name in SENSORS}
    found["P3 rms [mm]"] = 1e3 * heads(results, "P3").std()
    found["volume [%]"] = 100.0 * results.record["volume_drift"]
    return found


def plot(figure, runs):
    """Histories at the finest spacing, and the liquid at the end wall at the peak of P3 and half a period later."""
    finest = min(spacing for _, _, spacing in runs)
    shown = {variant: results for (variant, _, spacing), results in runs.items() if spacing == finest}
    panels = figure.subplots(len(FILLS), 4, width_ratios=[3, 3, 1.6, 1.6])
    for row, fill in zip(panels, FILLS, strict=True):
        for variant, color in ((f"LNG {fill} %", "C0"), (f"box {fill} %", "C1")):
            if variant not in shown:
                continue
            results = shown[variant]
            for panel, name in zip(row, ("P2", "P3"), strict=False):
                panel.plot(results.time, 1e3 * heads(results, name), linewidth=0.8, color=color, label=variant)
                panel.legend(fontsize="x-small", loc="upper left")
        for panel, name in zip(row, ("P2", "P3"), strict=False):
            panel.set_ylabel(f"{name} [mm]", fontsize="small")
            panel.grid(alpha=0.3)
        _draw_end_wall(row[2:], shown.get(f"LNG {fill} %"))
    for panel in panels[-1, :2]:
        panel.set_xlabel("Time [s]")
    for panel, text in zip(panels[0, 2:], ("LNG, end wall,\nat the peak", "half a period\nlater"), strict=True):
        panel.set_title(text, fontsize="small")


def _draw_end_wall(panels, results):
    """The liquid within NEAR of the left end wall, seen along the tank."""
    for panel in panels:
        panel.set_aspect("equal")
        panel.tick_params(labelsize="x-small")
    if results is None:
        return
    period = 2.0 * np.pi / results.job.motion[0].omega
    late = results.time > results.time[-1] - 2.0 * period
    late &= results.time < results.time[-1] - 0.5 * period
    peak = results.time[late][heads(results, "P3")[late].argmax()]
    for panel, time in zip(panels, (peak, peak + 0.5 * period), strict=True):
        x, y, z = results.liquid(time)["position"].T
        near = x < NEAR
        panel.scatter(y[near], z[near], s=1.0, c=z[near])
        panel.set_xlim(0.0, results.job.tank.size[1])
        panel.set_ylim(0.0, results.job.tank.size[2])
