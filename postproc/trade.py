"""Draw error against CPU-seconds, and find the presets and the price of accuracy.

usage: python postproc/trade.py TRADE.csv

Reads what jobs/validation/trade.py wrote. Writes beside it TRADE.png, the points of each scene with their Pareto
front, and TRADE.md: the presets' place among all settings by the rule below, what it costs to be faster, the price
of 5 % of amplitude error, and all points.

The rule. At the middle spacing every setting has an error and a cost relative to those of `balanced`; errors below
0.1 % count as 0.1 %, since no use of a run tells them apart. The geometric means over the scenes are one point a
setting. On the Pareto front of these points

- `fast` is the cheapest whose error is at most 1.5 times that of `balanced`;
- `accurate` is the one of least error that costs at most twice as much as `balanced`;
- `balanced` is the one of least error times cost between them.

Courant numbers above 0.6 are left out: a tank that starts to roll with a jolt then gains 3 % of energy, more than the
2 % that `make extremes` allows. The means of the costs of settings that take the same steps differ by up to 1.2, and
those of errors that differ by nothing but rounding by 1.05: a preset that is as near to what the rule would choose
stays.
"""

import argparse
import csv
import math
import sys
from pathlib import Path
from typing import NamedTuple

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot
from matplotlib.ticker import LogLocator, NullFormatter

from parmps.figures.style import COLOURS

PRESETS = ("balanced", "fast", "accurate", "papers")
MOST_ERROR, MOST_COST = 1.5, 2.0
"""Of `fast` and `accurate`, over those of `balanced`."""
MARKED = 2.5
"""Error over that of `balanced` from which a changed setting is named in the picture: the others lie too close."""
MOST_COURANT = 0.6
"""Greatest Courant number of a preset."""
AMPLITUDE = 5.0
"""Error of the amplitude of which the price is told, %."""
FAR = 100.0
"""Times the rows of the finest run, beyond which nothing is extrapolated."""
FASTER = (2.0, 5.0, 20.0)
SAME_COST, SAME_ERROR = 1.2, 1.05
"""How much better than a preset another setting must be to take its place: what is measured is no better."""
LEAST = 0.1
"""%; smaller errors count as this."""


class Point(NamedTuple):
    """One run."""

    scene: str
    preset: str
    change: str
    spacing: float
    rows: float
    error: float
    amplitude: float | None
    cost: float

    @property
    def setting(self):
        """What was set beside the spacing."""
        return self.change.replace("scheme.", "").replace(" ", ", ") or self.preset


def read(path):
    """Read the points, and the runs without a result.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    list of Point
    list of (str, str, str, str)
        Scene, setting, spacing and what happened.
    str
        Where the file says that its figures come from.
    """
    points, failed = [], []
    with open(path, newline="", encoding="utf-8") as file:
        source = file.readline().removeprefix("#").strip()
        for row in csv.DictReader(file):
            if row["note"]:
                failed.append((row["scene"], row["change"] or row["preset"], row["spacing [m]"], row["note"]))
            elif row["error [%]"]:
                numbers = [float(row[name]) for name in ("spacing [m]", "rows", "error [%]")]
                amplitude = float(row["amplitude [%]"]) if row["amplitude [%]"] else None
                texts = (row["scene"], row["preset"], row["change"])
                points.append(Point(*texts, *numbers, amplitude, float(row["CPU time [s]"])))
    return points, failed, source


def pareto(points):
    """Points that no other beats in both cost and error, cheapest first.

    Parameters
    ----------
    points : list
        With ``error`` and ``cost``.

    Returns
    -------
    list
        Of `points`.
    """
    front = []
    for point in sorted(points, key=lambda each: (each.cost, each.error)):
        if not front or point.error < front[-1].error:
            front.append(point)
    return front


class Mean(NamedTuple):
    """A setting in all scenes: geometric means of its error and cost over those of `balanced`."""

    setting: str
    error: float
    cost: float


def means(points):
    """The settings that were measured in all scenes where settings were changed, at the spacing of the changes.

    Parameters
    ----------
    points : list of Point

    Returns
    -------
    list of Mean
    """
    base = {}
    for scene, spacing in {(p.scene, p.spacing) for p in points if p.change}:
        here = [p for p in points if (p.scene, p.spacing) == (scene, spacing)]
        base[scene] = {p.setting: p for p in here}
    common = set.intersection(*(set(found) for found in base.values())) if base else set()
    out = []
    for setting in common:
        ratios = [
            (
                max(found[setting].error, LEAST) / max(found["balanced"].error, LEAST),
                found[setting].cost / found["balanced"].cost,
            )
            for found in base.values()
        ]
        error, cost = (math.prod(values) ** (1.0 / len(ratios)) for values in zip(*ratios, strict=True))
        out.append(Mean(setting, error, cost))
    return sorted(out, key=lambda mean: mean.cost)


def chosen(found):
    """What the rule makes of the settings: preset to the setting that it should be."""
    front = pareto(found)

    def best(preset, allowed, value, same):
        own = next((m for m in found if m.setting == preset), None)
        first = min(allowed, key=value)
        return own if own and value(own) <= same * value(first) else first

    fast = best("fast", [m for m in front if m.error <= MOST_ERROR], lambda m: m.cost, SAME_COST)
    accurate = best("accurate", [m for m in front if m.cost <= MOST_COST], lambda m: m.error, SAME_ERROR)
    between = [m for m in front if fast.cost < m.cost < accurate.cost] or [fast]
    balanced = best("balanced", between, lambda m: m.error * m.cost, SAME_COST)
    return {"fast": fast, "balanced": balanced, "accurate": accurate}


def allowed_courant(setting):
    """Whether a setting's Courant number is one that a preset may have."""
    given = [float(part.partition("=")[2]) for part in setting.split(", ") if part.startswith("courant=")]
    return max(given, default=0.0) <= MOST_COURANT


def rule_lines(points):
    """The settings' means, and whether each preset is the one that the rule chooses."""
    found = [mean for mean in means(points) if allowed_courant(mean.setting)]
    if not any(mean.setting == "balanced" for mean in found):
        return []
    front, choice = pareto(found), chosen(found)
    lines = ["## The presets", "", *__doc__.split("The rule. ")[1].strip().splitlines(), ""]
    for preset, mean in choice.items():
        if mean.setting == preset:
            lines.append(f"- `{preset}` is what the rule chooses.")
            continue
        own = next(m for m in found if m.setting == preset)
        lines.append(
            f"- for `{preset}` (error {own.error:.2f}, cost {own.cost:.2f}) the rule chooses {mean.setting} (error "
            f"{mean.error:.2f}, cost {mean.cost:.2f})."
        )
    lines += ["", "| setting | error over that of `balanced` | cost over that of `balanced` | |", "|---|---|---|---|"]
    lines += [f"| {m.setting} | {m.error:.2f} | {m.cost:.2f} | {'front' if m in front else ''} |" for m in found]
    return [*lines, ""]


def along(front, cost):
    """Error on a front at a cost, by straight lines between the logarithms; None beyond its ends."""
    for cheap, dear in zip(front, front[1:], strict=False):
        if cheap.cost <= cost <= dear.cost:
            share = math.log(cost / cheap.cost) / math.log(dear.cost / cheap.cost)
            return cheap.error ** (1.0 - share) * dear.error**share
    return None


def faster_lines(points):
    """What error costs: the front of spacings and presets, from the finest `balanced` that has an error."""
    lines = ["## Faster", ""]
    lines += ["| scene | from | " + " | ".join(f"{factor:g}x faster" for factor in FASTER) + " |"]
    lines += ["|---" * (2 + len(FASTER)) + "|"]
    for scene in dict.fromkeys(p.scene for p in points):
        mine = [p for p in points if p.scene == scene and not p.change]
        start = min((p for p in mine if p.preset == "balanced"), key=lambda p: p.spacing)
        front = pareto(mine)
        cells = []
        for factor in FASTER:
            error, wanted = along(front, start.cost / factor), start.cost / factor
            near = [p for p in front if p.cost <= wanted]
            if error is None or not near:
                cells.append("below the cheapest measured")
                continue
            knob = f"{near[-1].preset}, {near[-1].rows:.0f} rows"
            cells.append(f"{error:.2g} % ({error / start.error:.1f}x; {knob} has {near[-1].error:.2g} %)")
        begin = f"balanced, {start.rows:.0f} rows: {start.error:.2g} %, {start.cost:.0f} CPU-s"
        lines.append(f"| {scene} | {begin} | " + " | ".join(cells) + " |")
    return [*lines, ""]


def fitted(points, value):
    """Power law of a value over the spacing, by least squares of logarithms: exponent, and value at spacing 1."""
    x, y = [math.log(p.spacing) for p in points], [math.log(value(p)) for p in points]
    mean_x, mean_y = sum(x) / len(x), sum(y) / len(y)
    slope = sum((a - mean_x) * (b - mean_y) for a, b in zip(x, y, strict=True)) / sum((a - mean_x) ** 2 for a in x)
    return slope, math.exp(mean_y - slope * mean_x)


def price(points):
    """CPU-seconds for the amplitude within `AMPLITUDE`.

    Where a coarser run is beyond it and a finer one within, by straight lines between the logarithms. A preset whose
    every run is beyond loses amplitude at the rate -ln(1 - loss) over the run; the power laws of rate and cost over
    the spacing, continued, tell the spacing that it needs and the cost.

    Parameters
    ----------
    points : list of Point
        Of one scene and preset.

    Returns
    -------
    float
        CPU-seconds; infinite where refinement does not help, or too little.
    str
        How it was found.
    """
    points = sorted(points, key=lambda p: -p.spacing)
    errors = [abs(p.amplitude) for p in points]
    if errors[0] <= AMPLITUDE:
        return points[0].cost, f"at most: {errors[0]:.1f} % with {points[0].rows:.0f} rows, the fewest measured"
    for k in range(len(points) - 1):
        if all(error <= AMPLITUDE for error in errors[k + 1 :]):
            share = math.log(AMPLITUDE / errors[k]) / math.log(errors[k + 1] / errors[k])
            return points[k].cost ** (1.0 - share) * points[k + 1].cost**share, (
                f"between {points[k].rows:.0f} rows ({errors[k]:.1f} %) and {points[k + 1].rows:.0f} "
                f"({errors[k + 1]:.1f} %)"
            )
    rate, rate_at_1 = fitted(points, lambda p: -math.log(1.0 - min(abs(p.amplitude) / 100.0, 0.999)))
    cost, cost_at_1 = fitted(points, lambda p: p.cost)
    measured = ", ".join(f"{error:.0f} % with {p.rows:.0f} rows" for error, p in zip(errors, points, strict=True))
    if rate <= 0.0:
        return math.inf, f"not reached, nor approached by refinement: {measured}"
    spacing = (-math.log(1.0 - AMPLITUDE / 100.0) / rate_at_1) ** (1.0 / rate)
    rows = points[0].rows * points[0].spacing / spacing
    if rows > FAR * points[-1].rows:
        return math.inf, (
            f"not reached, nor within {FAR:g} times the rows: {measured}, the loss's rate falling with the spacing to "
            f"the power {rate:.2f}"
        )
    return cost_at_1 * spacing**cost, (
        f"extrapolated to {rows:.0f} rows from {measured}, the loss's rate falling with the spacing to the power "
        f"{rate:.2f} and the cost growing with {-cost:.1f}"
    )


def headline(points):
    """The price of the amplitude, `balanced` and `papers`."""
    lines = [f"## CPU-seconds for {AMPLITUDE:g} % of amplitude error", ""]
    lines += ["| scene | `balanced` | `papers` | ratio |", "|---|---|---|---|"]
    for scene in dict.fromkeys(p.scene for p in points if p.amplitude is not None):
        sets = [
            [p for p in points if (p.scene, p.preset) == (scene, name) and p.amplitude is not None and not p.change]
            for name in ("balanced", "papers")
        ]
        if min(map(len, sets)) < 2:
            continue
        (mine, how), (other, other_how) = map(price, sets)
        told, ratio = (f"{other:.2g} ({other_how})", f"{other / mine:.2g}") if other < math.inf else (other_how, "")
        lines.append(f"| {scene} | {mine:.2g} ({how}) | {told} | {ratio} |")
    return [*lines, ""]


def table_lines(points, failed):
    """All points."""
    lines = ["## All runs", "", "| scene | spacing [mm] | setting | error [%] | amplitude [%] | CPU s | |"]
    lines += ["|---|---|---|---|---|---|---|"]
    for scene in dict.fromkeys(p.scene for p in points):
        mine = [p for p in points if p.scene == scene]
        front = pareto(mine)
        for p in mine:
            amplitude = "" if p.amplitude is None else f"{p.amplitude:.2f}"
            lines.append(
                f"| {scene} | {1e3 * p.spacing:g} | {p.setting} | {p.error:.2f} | {amplitude} | {p.cost:.1f} | "
                f"{'front' if p in front else ''} |"
            )
    return lines + [f"| {scene} | {1e3 * float(s):g} | {what} | {why} | | | |" for scene, what, s, why in failed]


def draw(points):
    """One panel a scene: presets over spacings, single settings, and the front; from 0.1 times `LEAST` on.

    Parameters
    ----------
    points : list of Point

    Returns
    -------
    matplotlib.figure.Figure
    """
    scenes = list(dict.fromkeys(p.scene for p in points))
    columns = min(len(scenes), 3)
    rows = math.ceil(len(scenes) / columns)
    figure = pyplot.figure(figsize=(4.6 * columns, 4.2 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for panel, scene in zip(panels, scenes, strict=False):
        mine = [p for p in points if p.scene == scene]
        front = pareto(mine)
        panel.loglog([p.cost for p in front], [p.error for p in front], color="0.8", linewidth=6.0, zorder=0)
        changed = [p for p in mine if p.change]
        usual = {p.spacing: p.error for p in mine if p.preset == "balanced" and not p.change}
        panel.plot([p.cost for p in changed], [p.error for p in changed], ".", color="0.5")
        for p in changed:
            if p.error > MARKED * usual.get(p.spacing, math.inf):
                where = {"textcoords": "offset points", "ha": "right", "fontsize": 7, "color": "0.4"}
                panel.annotate(p.setting, (p.cost, p.error), (-4, 2), **where)
        for colour, marker, preset in zip(COLOURS, "os^D", PRESETS, strict=False):
            line = sorted((p for p in mine if p.preset == preset and not p.change), key=lambda p: p.spacing)
            panel.plot([p.cost for p in line], [p.error for p in line], marker=marker, color=colour, label=preset)
            if preset == "balanced":
                for p in line:
                    panel.annotate(f"{p.rows:.0f}", (p.cost, p.error), (3, 4), textcoords="offset points", fontsize=7)
        panel.set_title(scene)
        panel.set_xlabel("CPU time [s]")
        panel.set_ylabel("Error [%]")
        for axis in (panel.xaxis, panel.yaxis):
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=20))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
        panel.set_ylim(bottom=max(panel.get_ylim()[0], 0.1 * LEAST))
        panel.grid(alpha=0.3)
    for panel in panels[len(scenes) :]:
        panel.axis("off")
    handles = [
        *panels[0].get_legend_handles_labels()[0],
        pyplot.Line2D([], [], marker=".", color="0.5", linestyle=""),
        pyplot.Line2D([], [], color="0.8", linewidth=6.0),
    ]
    labels = [*PRESETS, "balanced with one setting changed", "front"]
    place = {"loc": "center"} if len(panels) > len(scenes) else {"loc": "outside lower center", "ncols": 6}
    (panels[-1] if len(panels) > len(scenes) else figure).legend(handles, labels, **place)
    return figure


def main(arguments=None):
    """Run the command; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", metavar="TRADE.csv", type=Path)
    path = parser.parse_args(arguments).file
    try:
        points, failed, source = read(path)
    except (OSError, ValueError, KeyError) as error:
        print(f"trade: {error}", file=sys.stderr)
        return 2
    draw(points).savefig(path.with_suffix(".png"), dpi=120)
    parts = [*headline(points), *faster_lines(points), *rule_lines(points), *table_lines(points, failed)]
    head = ["# What accuracy costs", "", source, "", f"![Error against CPU time]({path.with_suffix('.png').name})", ""]
    path.with_suffix(".md").write_text("\n".join([*head, *parts]) + "\n")
    print(path.with_suffix(".png"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
