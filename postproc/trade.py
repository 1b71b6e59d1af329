"""Draw error against CPU-seconds with the Pareto front of each scene.

usage: python postproc/trade.py TRADE.csv

Reads scene, setting, error in % and CPU-seconds; settings without an error failed and are listed. Writes the
picture and a table beside the file: TRADE.png and TRADE.md.
"""

import argparse
import csv
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot

from parmps.figures.style import COLOURS


def pareto(points):
    """Settings that no other beats in both cost and error, cheapest first.

    Parameters
    ----------
    points : list of tuple
        Setting (str), error and cost of each.

    Returns
    -------
    list of tuple
        Of `points`.
    """
    front = []
    for point in sorted(points, key=lambda each: (each[2], each[1])):
        if not front or point[1] < front[-1][1]:
            front.append(point)
    return front


def read(path):
    """Read the points of each scene, and the runs without a result.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    dict of str to list of tuple
        Scene to its points, as for `pareto`.
    list of tuple
        Scene, setting and what happened.
    """
    scenes, failed = {}, []
    with open(path, newline="", encoding="utf-8") as file:
        for scene, setting, error, cost in list(csv.reader(file))[1:]:
            if cost:
                scenes.setdefault(scene, []).append((setting, float(error), float(cost)))
            else:
                failed.append((scene, setting, error))
    return scenes, failed


def main(arguments=None):
    """Run the command; returns the exit status."""
    parser = argparse.ArgumentParser(description="Draw error against CPU-seconds with the Pareto front of each scene.")
    parser.add_argument("file", metavar="TRADE.csv", type=Path)
    path = parser.parse_args(arguments).file
    try:
        scenes, failed = read(path)
    except (OSError, ValueError) as error:
        print(f"trade: {error}", file=sys.stderr)
        return 2
    figure = pyplot.figure(figsize=(5.0 * len(scenes), 5.0), layout="constrained")
    lines = ["| scene | setting | error [%] | CPU s | |", "|---|---|---|---|---|"]
    for panel, (scene, points) in zip(figure.subplots(1, len(scenes), squeeze=False)[0], scenes.items(), strict=True):
        front = pareto(points)
        panel.loglog(*zip(*((cost, error) for _, error, cost in front), strict=True), color="0.6")
        for setting, error, cost in points:
            panel.plot(cost, error, "o", color=COLOURS[(setting, error, cost) in front])
            panel.annotate(setting.removeprefix("scheme."), (cost, error), fontsize=6, rotation=20)
            mark = "front" if (setting, error, cost) in front else ""
            lines.append(f"| {scene} | {setting} | {error:.2f} | {cost:.1f} | {mark} |")
        panel.set_title(scene)
        panel.set_xlabel("CPU time [s]")
        panel.set_ylabel("Error [%]")
        panel.grid(alpha=0.3, which="both")
    lines += [f"| {scene} | {setting} | {what} | | |" for scene, setting, what in failed]
    figure.savefig(path.with_suffix(".png"), dpi=120)
    path.with_suffix(".md").write_text("\n".join(lines) + "\n")
    print(path.with_suffix(".png"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
