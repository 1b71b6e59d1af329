"""Linear response of a surging tank that starts from rest; writes linear_theory.csv for fill_frequency.yaml.

With the surface at eta = sum over odd n of beta_n(t) cos(k_n x), k_n = n pi / L, a tank displaced by
a sin(w t) from t = 0 on has

    beta_n'' + w_n^2 beta_n = F_n x'',   F_n = 4 tanh(k_n h) / (n pi),   w_n^2 = g k_n tanh(k_n h)

(Faltinsen & Timokha 2009, Sloshing, section 5.2, for this motion), where the jump of the tank's velocity to a w at the
start gives beta_n'(0) = F_n a w. Nothing damps the waves of the start, so the curve is finite at resonance and
depends on the time: it is the root mean square over the same time as the runs, not a steady amplitude.

usage: python jobs/sweeps/linear_theory.py
"""

from pathlib import Path

import numpy as np

GRAVITY, LENGTH, AMPLITUDE, GAUGE, END = 9.8, 0.8, 0.002, 0.01, 6.0
DEPTHS = (0.125, 0.25)
MODES = 41
"""The response of the higher ones at the gauge is below a thousandth of that of the first."""


def elevation(time, depth, omega):
    """Elevation of the surface at the gauge.

    Parameters
    ----------
    time : (n,) float64
        s.
    depth : float
        m.
    omega : float
        rad/s, not a natural frequency.

    Returns
    -------
    (n,) float64
        m.
    """
    total = np.zeros(len(time))
    for n in range(1, MODES + 1, 2):
        k = n * np.pi / LENGTH
        natural = np.sqrt(GRAVITY * k * np.tanh(k * depth))
        load = 4.0 * np.tanh(k * depth) / (n * np.pi) * AMPLITUDE
        forced = -load * omega**2 / (natural**2 - omega**2)
        free = (load - forced) * omega / natural
        total += (forced * np.sin(omega * time) + free * np.sin(natural * time)) * np.cos(k * GAUGE)
    return total


def main():
    """Write the table."""
    time = np.linspace(0.0, END, 601)
    lines = ["fluids[0].depth [m],motion[0].omega [rad/s],linear theory [m]"]
    for depth in DEPTHS:
        for omega in np.arange(2.5, 8.5001, 0.1):
            lines.append(f"{depth},{omega:.2f},{elevation(time, depth, omega).std():.6f}")
    Path(__file__).with_suffix(".csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
