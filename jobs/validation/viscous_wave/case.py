"""Decay and period of a free wave of viscous liquid in a tank without slip, against finite elements."""

import numpy as np
from scipy.optimize import curve_fit
from viscous import viscous_wave

TITLE = "Viscous wave"
SPACINGS = (0.02, 0.01)
VARIANTS = {f"{nu:g} m2/s": [f"fluids[0].kinematic_viscosity={nu}"] for nu in (1e-3, 5e-3, 2e-2)}
TARGETS = {"decay [%]": 10.0, "period [%]": 2.0}


def theory(job):
    """The first wave of a job, as exp(s t): complex s, 1/s."""
    oil = job.fluids[0]
    return viscous_wave(job.tank.length, oil.depth, job.gravity, oil.kinematic_viscosity)


def swing(time, amplitude, decay, frequency, phase):
    """A wave that decays."""
    return amplitude * np.exp(-decay * time) * np.sin(frequency * time + phase)


def fit(results):
    """Parameters of `swing` in a run, over four periods."""
    s, mode = theory(results.job), results.first_mode()
    return curve_fit(swing, results.frames, mode, [mode.max(), -s.real, s.imag, 0.0])[0]


def measure(results):
    """Errors of decay and period."""
    s, found = theory(results.job), fit(results)
    return {
        "decay [%]": 100.0 * (found[1] / -s.real - 1.0),
        "period [%]": 100.0 * (s.imag / found[2] - 1.0),
    }


def plot(figure, runs):
    """First mode over time, and the reference with the amplitude of the finest run."""
    panels = dict(zip(VARIANTS, figure.subplots(1, len(VARIANTS), sharey=True), strict=True))
    for (variant, preset, spacing), results in runs.items():
        mode = 1e3 * results.first_mode()
        panels[variant].plot(results.frames, mode, label=f"{preset}, {1e3 * spacing:g} mm")
    for variant, panel in panels.items():
        mine = [results for (name, *_), results in runs.items() if name == variant]
        if mine:
            s, (amplitude, _, _, phase) = theory(mine[-1].job), fit(mine[-1])
            t = np.linspace(0.0, mine[-1].frames[-1], 300)
            exact = swing(t, amplitude, -s.real, s.imag, phase)
            panel.plot(t, 1e3 * exact, "k--", linewidth=0.8, label="finite elements")
        panel.set_title(variant, fontsize="medium")
        panel.set_xlabel("Time [s]")
        panel.grid(alpha=0.3)
    panel.legend(fontsize="small", loc="upper right")
    next(iter(panels.values())).set_ylabel("First mode [mm]")
