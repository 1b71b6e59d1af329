"""Front of a collapsing column against Martin & Moyce 1952 and Koshizuka & Oka 1996."""

from pathlib import Path

import numpy as np
from results import read_reference, rms

TITLE = "Dam break: front"
SPACINGS = (0.0073, 0.00365)
WIDTH = 0.146
"""m, of the column."""
REFERENCE = {
    name: read_reference(Path(__file__).with_name(file))
    for name, file in (
        ("Koshizuka & Oka", "koshizuka_oka.csv"),
        ("Martin & Moyce 2.25 in", "martin_moyce.csv"),
        ("Martin & Moyce 1.125 in", "martin_moyce_small.csv"),
    )
}
REACH = 9.5
"""Widths of the column up to which the record is used: the tank ends at 10."""
TARGETS = {"Koshizuka & Oka [%]": 3.0, "Martin & Moyce 2.25 in [%]": 3.0}


def front(position, spacing):
    """End of the liquid that is connected along the floor, m."""
    x = np.sort(position[position[:, 2] < 2.5 * spacing, 0])
    gaps = np.flatnonzero(np.diff(x) > 3.0 * spacing)
    return (x[gaps[0]] if len(gaps) else x[-1]) + 0.5 * spacing


def history(results):
    """Front over time: T = t sqrt(2 g / a) and Z = x / a."""
    reached = [front(results.liquid(t)["position"], results.job.spacing) for t in results.frames]
    return results.frames * np.sqrt(2.0 * results.job.gravity / WIDTH), np.array(reached) / WIDTH


def measure(results):
    """Rms error over the rms of the front's position, as recorded and with the best constant delay of the record."""
    time, reached = history(results)
    found = {}
    for name, record in REFERENCE.items():
        record = record[record[:, 1] < REACH]
        delays = np.arange(0.0, 0.6, 0.01)
        errors = [rms(np.interp(record[:, 0] - d, time, reached) - record[:, 1]) / rms(record[:, 1]) for d in delays]
        found[f"{name} [%]"] = 100.0 * errors[0]
        found[f"{name}, delayed [%]"] = 100.0 * min(errors)
        found[f"{name}, delay [-]"] = delays[int(np.argmin(errors))]
    return found


def plot(figure, runs):
    """Front over time."""
    panel = figure.subplots()
    for (_, preset, spacing), results in runs.items():
        panel.plot(*history(results), linewidth=1.0, label=f"{preset}, a / {WIDTH / spacing:.0f}")
    for marker, (name, record) in zip("o^v", REFERENCE.items(), strict=True):
        panel.plot(*record.T, marker, color="black", markerfacecolor="none", label=name)
    panel.set_xlim(0.0, 7.0)
    panel.set_ylim(1.0, 11.0)
    panel.set_xlabel("$t\\sqrt{2g/a}$")
    panel.set_ylabel("Front $x/a$")
    panel.grid(alpha=0.3)
    panel.legend(fontsize="small")
