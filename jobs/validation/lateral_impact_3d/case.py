"""Lateral impacts of oil between the side walls of SPHERIC benchmark 10's tank."""

import impacts
from impacts import TARGETS, measure

__all__ = ["SPACINGS", "TARGETS", "TITLE", "measure", "plot"]

TITLE = "Lateral impact of oil in 3D, SPHERIC 10"
SPACINGS = (0.0088, 0.0066, 0.0044)


def plot(figure, runs):
    """Pressure of the sensor."""
    panel = figure.subplots()
    impacts.plot(panel, {f"{k[1]}, {1e3 * k[2]:g} mm": results for k, results in runs.items()}, 2.5)
    panel.set_xlabel("Time [s]")
