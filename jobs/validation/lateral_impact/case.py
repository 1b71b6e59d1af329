"""Lateral impacts in shallow sloshing against the repetitions of SPHERIC benchmark 10, in 2D."""

import impacts
from impacts import TARGETS, measure

__all__ = ["SPACINGS", "TARGETS", "TITLE", "VARIANTS", "measure", "plot"]

TITLE = "Lateral impact, SPHERIC 10"
SPACINGS = (0.0066, 0.0033)
VARIANTS = {
    "water": [],
    # sunflower oil, as the benchmark gives it
    "oil": [
        "fluids[0].density=900",
        "fluids[0].kinematic_viscosity=5.0e-5",
        "motion[0].path=roll_oil.csv",
        "time.end=7.6",
    ],
}


def plot(figure, runs):
    """Pressure of the sensor, water and oil."""
    for panel, variant, highest in zip(figure.subplots(2, 1), VARIANTS, (12.0, 4.0), strict=True):
        mine = {f"{k[1]}, {1e3 * k[2]:g} mm": results for k, results in runs.items() if k[0] == variant}
        impacts.plot(panel, mine, highest)
    panel.set_xlabel("Time [s]")
