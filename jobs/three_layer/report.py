"""Figures 2 and 3 of Wen & Wan, and a table of amplitudes, from the runs of the four jobs beside this file.

usage: python jobs/three_layer/report.py [DIRECTORY]

DIRECTORY (out/three_layer by default) holds the runs no_baffle, baffle_075, baffle_225 and baffle_490; those that are
missing are left out. It gets snapshots.png, heights.png and amplitudes.md.
"""

import sys
from pathlib import Path

import matplotlib
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
matplotlib.use("Agg")

from matplotlib import pyplot  # noqa: E402

from parmps.figures.results import read_frame  # noqa: E402
from parmps.particles import FLUID  # noqa: E402
from parmps.signals import read_signals  # noqa: E402

RUNS = {"no_baffle": "no baffle", "baffle_075": "0.075 m", "baffle_225": "0.225 m", "baffle_490": "0.49 m"}
TIMES = (10.0, 20.0, 30.0, 40.0, 50.0)
HEIGHTS = ("surface", "CW", "WD")
COLOURS = ("#2ca02c", "#1f77b4", "#d62728")
"""Of the liquids, the lowest first."""
SHOWN = (-0.02, 0.78)
"""Heights of the snapshots, m; single drops fly higher."""
REPORTED = {
    "no_baffle": "CW 0.15 m late, surface 0.04 m",
    "baffle_075": "CW about 0.05 m",
    "baffle_225": "CW almost nothing",
    "baffle_490": "CW almost nothing",
}
"""Amplitudes that the paper's text names."""


def read_heights(directory):
    """Heights at the left wall: time (n,) and a dict of (n,), s and m."""
    time, signals = read_signals(directory / "probes.csv")
    return time, {name: values for name, _, values in signals if name in HEIGHTS}


def snapshots(runs, path):
    """Draw the liquids of every run at the paper's times (figure 2)."""
    size = (2.6 * len(TIMES), 2.3 * len(runs))
    figure, panels = pyplot.subplots(len(runs), len(TIMES), figsize=size, squeeze=False, layout="constrained")
    for row, (name, directory) in zip(panels, runs.items(), strict=True):
        for panel, wanted in zip(row, TIMES, strict=True):
            frame = read_frame(directory, wanted)
            arrays = frame.arrays
            liquid = arrays["type"] == FLUID
            at, number = arrays["position"][liquid], arrays["fluid"][liquid]
            for fluid, colour in enumerate(COLOURS):
                panel.plot(at[number == fluid, 0], at[number == fluid, 2], ".", markersize=0.6, color=colour)
            panel.set_title(f"{RUNS[name]}, {frame.time:.3g} s", fontsize="small", loc="left")
            panel.set_aspect("equal")
            panel.set_ylim(*SHOWN)
            panel.set_xticks([])
            panel.set_yticks([])
    figure.savefig(path, dpi=130)


def histories(runs, path):
    """Draw the heights of the surface and both interfaces over time (figure 3)."""
    figure, panels = pyplot.subplots(3, 1, figsize=(9.0, 8.0), sharex=True, layout="constrained")
    for name, directory in runs.items():
        time, heights = read_heights(directory)
        for panel, height in zip(panels, HEIGHTS, strict=True):
            panel.plot(time, heights[height], linewidth=1.0, label=RUNS[name])
    for panel, height in zip(panels, HEIGHTS, strict=True):
        panel.set_ylabel(f"{height} at the left wall [m]")
        panel.grid(alpha=0.3)
    panels[0].legend(fontsize="small", ncols=4)
    panels[-1].set_xlabel("Time [s]")
    figure.savefig(path, dpi=130)


def amplitude(values):
    """Half the way from the lowest to the highest value: m."""
    return 0.5 * float(np.ptp(values))


def table(runs):
    """Amplitudes in windows of 10 s beside what the paper reports: lines of Markdown."""
    windows = [(begin, begin + 10.0) for begin in (0.0, 10.0, 20.0, 30.0, 40.0)]
    titles = ["baffle", "height", *(f"{a:g} to {b:g} s" for a, b in windows), "reported"]
    lines = ["Half of highest less lowest in each window, mm.", "", "| " + " | ".join(titles) + " |"]
    lines.append("|---" * len(titles) + "|")
    for name, directory in runs.items():
        time, heights = read_heights(directory)
        for height in HEIGHTS:
            cells = [RUNS[name], height]
            for begin, end in windows:
                part = (time >= begin) & (time <= end)
                cells.append(f"{1e3 * amplitude(heights[height][part]):.1f}" if part.any() else "")
            cells.append(REPORTED[name] if height == "CW" else "")
            lines.append("| " + " | ".join(cells) + " |")
    return lines


def main():
    """Make the figures and the table of the runs that there are."""
    directory = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "out" / "three_layer"
    runs = {name: directory / name for name in RUNS if (directory / name / "run.json").is_file()}
    if not runs:
        sys.exit(f"{directory}: none of the runs {', '.join(RUNS)} is there")
    snapshots(runs, directory / "snapshots.png")
    histories(runs, directory / "heights.png")
    lines = table(runs)
    (directory / "amplitudes.md").write_text("\n".join(lines) + "\n")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
