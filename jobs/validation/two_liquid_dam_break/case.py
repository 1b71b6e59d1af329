"""A column of water that collapses in a lighter liquid: volumes are kept, and layers form."""

import numpy as np

TITLE = "Dam break in a lighter liquid"
SPACINGS = (0.01,)
TARGETS = {"volume of water [%]": 0.5, "volume of oil [%]": 0.5}


def measure(results):
    """Volumes in the last fifth of the run over those of the start, and how far the liquids have settled."""
    late = results.time > 0.8 * results.time[-1]
    found = {}
    for name in ("water", "oil"):
        volume = results.probe(f"{name}.volume")
        found[f"volume of {name} [%]"] = 100.0 * (volume[late].mean() / volume[0] - 1.0)
        found[f"strayed {name} [%]"] = 100.0 * results.probe(f"{name}.strayed")[late].mean()
    liquid = results.liquid(results.frames[-1])
    found["rms speed [mm/s]"] = 1e3 * np.sqrt(np.mean(np.sum(liquid["velocity"] ** 2, axis=1)))
    found["interface [mm]"] = 1e3 * results.probe("interface")[late].mean()
    return found


def plot(figure, runs):
    """The liquids at four instants, and their volumes."""
    panels = figure.subplots(2, 3).ravel()
    results = next(iter(runs.values()))
    for panel, time in zip(panels[:4], (0.0, 1.0, 3.0, results.frames[-1]), strict=True):
        liquid = results.liquid(time)
        for number, colour in enumerate(("#0072B2", "#E69F00")):
            at = liquid["position"][liquid["fluid"] == number]
            panel.plot(at[:, 0], at[:, 2], ".", markersize=1.5, color=colour)
        panel.set_title(f"{time:g} s", fontsize="small", loc="left")
        panel.set_aspect("equal")
    for (_, preset, _), found in runs.items():
        for name in ("water", "oil"):
            volume = found.probe(f"{name}.volume")
            panels[4].plot(found.time, 100.0 * (volume / volume[0] - 1.0), label=f"{name}, {preset}")
        panels[5].plot(found.time, found.probe("interface"))
    panels[4].set_ylabel("Volume change [%]")
    panels[4].legend(fontsize="x-small")
    panels[5].set_ylabel("Interface [m]")
    for panel in panels[4:]:
        panel.grid(alpha=0.3)
        panel.set_xlabel("Time [s]")
