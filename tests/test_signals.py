"""What is measured on a signal, against signals whose measures are known."""

import numpy as np
import pytest

from parmps.errors import InputError
from parmps.figures.tables import peak_rows, response
from parmps.signals import find_signal, measure, peaks, read_signals, spectrum

TIME = np.arange(0.0, 20.0, 0.01)


def wave(frequency=0.83, amplitude=3.0, mean=10.0, noise=0.0):
    ripple = np.random.default_rng(1).normal(size=len(TIME))
    return mean + amplitude * np.sin(2 * np.pi * frequency * TIME) + noise * ripple


@pytest.mark.parametrize("frequency", [0.3, 0.83, 4.71])
def test_frequency_of_a_sine_lies_between_the_lines_of_the_spectrum(frequency):
    assert measure("frequency", TIME, wave(frequency)) == pytest.approx(frequency, rel=1e-3)
    lines, amplitude = spectrum(TIME, wave(frequency))
    assert amplitude.max() == pytest.approx(3.0, rel=0.01)
    assert lines[np.argmax(amplitude)] == pytest.approx(frequency, abs=0.02)


def test_measures_of_a_sine():
    period = 1 / 0.83
    whole = {"begin": 0.0, "end": 12 * period}
    assert measure("max", TIME, wave()) == pytest.approx(13.0, rel=1e-3)
    assert measure("min", TIME, wave()) == pytest.approx(7.0, rel=1e-3)
    assert measure("mean", TIME, wave(), **whole) == pytest.approx(10.0, rel=1e-3)
    assert measure("rms", TIME, wave(), **whole) == pytest.approx(3.0 / np.sqrt(2.0), rel=1e-2)
    assert measure("impulse", TIME, wave(), **whole) == pytest.approx(120.0 * period, rel=1e-3)
    # half a cycle of sin above the mean: 2 A / w
    half = measure("impulse", TIME, wave(mean=0.0), 0.0, period / 2)
    assert half == pytest.approx(2.0 * 3.0 / (2 * np.pi * 0.83), rel=1e-3)


def test_peaks_are_one_a_cycle_in_spite_of_noise():
    assert measure("mean_peaks", TIME, wave()) == pytest.approx(13.0, rel=1e-3)
    moments, heights = peaks(TIME, wave(noise=0.2))
    assert len(moments) == 14 or len(moments) == 15
    np.testing.assert_allclose(np.diff(moments), 1 / 0.83, atol=0.35)
    growing = wave() * TIME
    assert np.all(np.diff(peaks(TIME, growing)[1]) > 0.0)


def test_a_signal_without_a_cycle_has_no_peaks():
    assert np.isnan(measure("mean_peaks", TIME, TIME))
    assert np.isnan(measure("frequency", TIME, np.full(len(TIME), 3.0)))
    row = peak_rows(TIME, [("a", "m", np.zeros(len(TIME)))])[0]
    assert row[:2] == ("a", "m")


def test_phase_against_the_motion():
    omega = 2 * np.pi * 0.83
    values = 1.0 + 0.2 * np.sin(omega * TIME - np.radians(40.0))
    amplitude, phase = response(TIME, values, omega)
    assert amplitude == pytest.approx(0.2, rel=1e-6)
    assert phase == pytest.approx(-40.0, abs=1e-3)


def test_windows_and_columns_that_are_not_there_are_refused(tmp_path):
    with pytest.raises(InputError, match="0 samples from 30 s"):
        measure("max", TIME, wave(), 30.0)
    path = tmp_path / "probes.csv"
    path.write_text("time [s],P1 [Pa],load.Fx [N/m]\n0,1,2\n1,3,4\n")
    time, signals = read_signals(path)
    assert time.tolist() == [0.0, 1.0]
    assert find_signal(signals, "load.Fx [N/m]")[2].tolist() == [2.0, 4.0]
    with pytest.raises(InputError, match="no column 'P2'; there are P1, load.Fx"):
        find_signal(signals, "P2")
    path.write_text("time [s],P1 [Pa]\n0,1\n1\n")
    with pytest.raises(InputError, match="as many numbers"):
        read_signals(path)
