"""Decay and period of a free wave of viscous liquid in a tank without slip, against finite elements."""

import viscous
from scipy.optimize import curve_fit

TITLE = "Viscous wave"
SPACINGS = (0.02, 0.01)
VARIANTS = {f"{nu:g} m2/s": [f"fluids[0].kinematic_viscosity={nu}"] for nu in (1e-3, 5e-3, 2e-2)}
TARGETS = {"decay [%]": 10.0, "period [%]": 2.0}


def theory(job):
    """The first wave of a job, as exp(s t): complex s, 1/s."""
    oil = job.fluids[0]
    return viscous.viscous_wave(job.tank.length, oil.depth, job.gravity, oil.kinematic_viscosity)


def fit(results):
    """Parameters of `swing` in a run, over four periods."""
    s, mode = theory(results.job), results.first_mode()
    return curve_fit(viscous.swing, results.frames, mode, [mode.max(), -s.real, s.imag, 0.0])[0]


def measure(results):
    """Errors of decay and period."""
    return viscous.errors(theory(results.job), fit(results))


def plot(figure, runs):
    """First mode over time, and the reference with the amplitude and phase of the finest run."""

    def mode(results):
        return 1e3 * results.first_mode()

    def exact(results, time):
        s, (amplitude, _, _, phase) = theory(results.job), fit(results)
        return 1e3 * viscous.swing(time, amplitude, -s.real, s.imag, phase)

    viscous.plot(figure, runs, VARIANTS, mode, exact, ("finite elements", "First mode [mm]"))
