"""Linear response of a surging tank that starts from rest; writes linear_theory.csv for fill_frequency.yaml.

Nothing damps the waves of the start, so the curve is finite at resonance and depends on the time: it is the root mean
square of the elevation at the gauge over the same time as the runs, not a steady amplitude. The theory itself is
`surge_response` in jobs/validation/potential.py.

usage: python jobs/sweeps/linear_theory.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "validation"))
from potential import surge_response  # noqa: E402

GRAVITY, LENGTH, AMPLITUDE, GAUGE, END = 9.8, 0.8, 0.002, 0.01, 6.0
DEPTHS = (0.125, 0.25)


def table():
    """Write the response at all depths and frequencies as CSV text."""
    time = np.linspace(0.0, END, 601)
    lines = ["fluids[0].depth [m],motion[0].omega [rad/s],linear theory [m]"]
    for depth in DEPTHS:
        for omega in np.arange(2.5, 8.5001, 0.1):
            elevation = surge_response(GAUGE, time, LENGTH, depth, GRAVITY, AMPLITUDE, omega)
            lines.append(f"{depth},{omega:.2f},{elevation.std():.6f}")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    Path(__file__).with_suffix(".csv").write_text(table(), encoding="utf-8")
