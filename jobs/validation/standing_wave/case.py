"""A free standing wave against potential flow, finite-amplitude theory and viscous decay."""

import functools

import numpy as np
from potential import PotentialFlow, finite_amplitude_frequency, frequency, viscous_decay, wave_number
from results import rms
from scipy.optimize import curve_fit

TITLE = "Standing wave"
SPACINGS = (0.02, 0.01)
PERIODS = 5
TARGETS = {"amplitude [%]": (4.0, 2.0), "period [%]": (0.4, 0.2), "volume [%]": 0.1, "volume by height [%]": 0.1}


def mode(elevations):
    """Amplitude of the first mode from gauges at the middles of equal parts of the tank: (samples,) float64."""
    count = elevations.shape[1]
    return 2.0 / count * elevations @ np.cos(np.pi * (np.arange(count) + 0.5) / count)


def crossings(time, signal):
    """Times at which a signal rises through zero, from lines between samples, s."""
    at = np.flatnonzero((signal[:-1] < 0.0) & (signal[1:] >= 0.0))
    return time[at] - signal[at] * (time[at + 1] - time[at]) / (signal[at + 1] - signal[at])


def amplitudes(time, signal, omega, periods):
    """Amplitude of a sine fitted to each period: (periods,) float64."""
    period = 2.0 * np.pi / omega
    found = []
    for number in range(periods):
        part = (time >= number * period) & (time <= (number + 1) * period)
        fit, _ = curve_fit(
            lambda t, a, w, phase: a * np.sin(w * t + phase), time[part], signal[part], [signal.max(), omega, 0.0]
        )
        found.append(abs(fit[0]))
    return np.array(found)


@functools.lru_cache
def reference(job, end, samples):
    """Cosine modes of the elevation in potential flow with the same start, m: (samples, modes) float64."""
    length, depth = job.tank.length, job.fluids[0].depth
    flow = PotentialFlow(length, depth, job.gravity, modes=24)
    k = wave_number(1, length)
    start = job.initial.amplitude * frequency(1, length, depth, job.gravity) / k / np.tanh(k * depth)
    flow.potential = start * np.cos(k * flow.x)
    return flow.run(np.linspace(0.0, end, samples), 0.01)


def height_drift(results, mode):
    """Relative change of the volume from the height of the centre, less the wave's own rise a^2 / (4 h); last third."""
    depth = results.job.fluids[0].depth
    height = np.array([results.liquid(time)["position"][:, 2].mean() for time in results.frames])
    return float((2.0 * (height - mode**2 / (4.0 * depth)) / depth - 1.0)[-len(mode) // 3 :].mean())


def measure(results):
    """Worst amplitude over the periods, mean period and volume, each over what theory says.

    The amplitude is that of the first mode as the centre of the liquid tells it; from the gauges it is told beside.
    """
    job, time = results.job, results.frames
    length, depth, target = job.tank.length, job.fluids[0].depth, job.initial.amplitude
    omega = finite_amplitude_frequency(target, length, depth, job.gravity)
    periods = int(time[-1] * omega / (2.0 * np.pi))
    bulk, _ = viscous_decay(1, length, depth, job.gravity, job.fluids[0].kinematic_viscosity)
    decay = np.exp(-bulk * (np.arange(periods) + 0.5) * 2.0 * np.pi / omega)
    modes = reference(job, float(time[-1]), len(time))
    odd = np.arange(1, modes.shape[1], 2)
    exact, signal = modes[:, odd] @ (1.0 / odd**2) * np.exp(-bulk * time), results.first_mode()
    error = amplitudes(time, signal, omega, periods) / amplitudes(time, exact, omega, periods) - 1.0
    fine = reference(job, float(results.time[-1]), len(results.time))[:, 1]
    elevations = results.probes("eta") - depth
    gauged = amplitudes(results.time, mode(elevations), omega, periods)
    gauged /= amplitudes(results.time, fine, omega, periods) * decay
    zeros = np.concatenate([[0.0], crossings(time, signal)])
    return {
        "amplitude [%]": 100.0 * error[np.abs(error).argmax()],
        "last amplitude [%]": 100.0 * error[-1],
        "centre [%]": 100.0 * rms(signal - exact) / rms(exact),
        "by gauges [%]": 100.0 * (gauged[np.abs(gauged - 1.0).argmax()] - 1.0),
        "period [%]": 100.0 * ((zeros[-1] - zeros[0]) / (len(zeros) - 1) * omega / (2.0 * np.pi) - 1.0),
        "volume [%]": 100.0 * results.record["volume_drift"],
        "volume by height [%]": 100.0 * height_drift(results, signal),
        "mean level [%]": 100.0 * (elevations.mean(axis=1)[results.time > results.time[-1] / 2.0].mean() / depth),
    }


def plot(figure, runs):
    """First mode over time, and its difference from potential flow."""
    above, below = figure.subplots(2, 1, sharex=True)
    drawn = False
    for (_, preset, spacing), results in runs.items():
        modes = reference(results.job, float(results.frames[-1]), len(results.frames))
        odd = np.arange(1, modes.shape[1], 2)
        wanted, signal = modes[:, odd] @ (1.0 / odd**2), results.first_mode()
        if not drawn:
            above.plot(results.frames, wanted, color="black", linewidth=2.0, alpha=0.5, label="potential flow")
            drawn = True
        above.plot(results.frames, signal, linewidth=1.0, label=f"{preset}, {1e3 * spacing:g} mm")
        below.plot(results.frames, 1e3 * (signal - wanted), linewidth=1.0)
    above.set_ylabel("First mode [m]")
    above.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    below.set_ylabel("Difference [mm]")
    below.set_xlabel("Time [s]")
    for panel in (above, below):
        panel.grid(alpha=0.3)
