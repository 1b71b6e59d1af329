"""What is measured on a signal, against signals whose measures are known."""

import numpy as np
import pytest

from parmps.errors import InputError
from parmps.figures.tables import peak_rows, response
from parmps.loader import parse_job
from parmps.motion import forcing_period
from parmps.signals import find_signal, measure, peaks, principal, read_signals, spectrum

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


def roll_moment(period=1.32, count=4, seed=1, noise=0.15):
    """A wave with harmonics and impacts, of known peaks, in noise as of grids: neither slow nor small."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, count * period, 0.005)
    heights = 200.0 + 40.0 * rng.random(count)
    turn = time / period % 1.0
    values = 60.0 * np.sin(2.0 * np.pi * turn - 1.0) + 25.0 * np.sin(4.0 * np.pi * turn)
    ripple = noise * 60.0 * (np.sin(2.0 * np.pi * 7.3 * time) + rng.normal(size=len(time)))
    values = values + np.where(np.abs(turn - 0.4) < 0.1, 0.0, ripple)
    cycle = (time / period).astype(int)
    near = np.abs(turn - 0.4) < 0.03
    return time, np.where(near, heights[cycle] * np.cos((turn - 0.4) / 0.03 * np.pi / 4.0) ** 2, values), heights


@pytest.mark.parametrize("noise", [0.0, 0.15, 0.5])
@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("phase", [0.0, 0.25, 0.5, 0.8])
def test_peaks_of_a_forced_signal_are_one_a_period_in_spite_of_noise(noise, known, phase):
    period = 1.32
    time, values, heights = roll_moment(period, 12, noise=noise)
    shown = slice(int(phase * period / 0.005), None)
    time, values = time[shown], values[shown]
    heights = heights if phase < 0.4 else heights[1:]
    moments, found = peaks(time, values, period if known else None)
    # without the period, a cycle begins at an upward crossing: those at the ends may not be whole
    assert len(heights) - (0 if known else 2) <= len(found) <= len(heights)
    at = [np.abs(np.arange(12)[-len(heights) :] * period + 0.4 * period - moment).argmin() for moment in moments]
    np.testing.assert_allclose(found, heights[at], rtol=3e-3)  # their tops are between samples
    kinds = ("mean_peaks", "peak_count", "peak_deviation", "peak_error")
    measured = [measure(kind, time, values, period=period if known else None) for kind in kinds]
    deviation = np.std(found, ddof=1)
    assert measured == pytest.approx([found.mean(), len(found), deviation, deviation / np.sqrt(len(found))])


def test_peaks_follow_a_signal_whose_phase_drifts():
    """A crest that moves by a third of a period within the window counts once a period."""
    time = np.arange(0.0, 20.0, 0.01)
    values = np.sin(2.0 * np.pi * time + 1.0 * np.tanh((time - 10.0) / 2.0))
    moments, heights = peaks(time, values, 1.0)
    assert len(heights) == 20
    np.testing.assert_allclose(heights, 1.0, rtol=1e-3)
    assert np.all(np.abs(np.diff(moments) - 1.0) < 0.2)


def test_peaks_of_irregular_waves_are_those_between_upward_crossings():
    """A narrow spectrum, whose cycles are from 0.7 to 1.4 s: noise of a fifth of it adds none."""
    rng = np.random.default_rng(3)
    time = np.arange(0.0, 100.0, 0.02)
    frequency = rng.normal(1.0, 0.08, 40)
    waves = np.sin(2.0 * np.pi * (frequency[:, None] * time + rng.random(40)[:, None])).sum(axis=0)
    smooth, noisy = peaks(time, waves)[1], peaks(time, waves + 0.2 * waves.std() * rng.normal(size=len(time)))[1]
    crossings = np.count_nonzero((waves[1:] >= 0.0) & (waves[:-1] < 0.0))
    assert abs(len(noisy) - len(smooth)) <= 2
    assert 0.8 * crossings < len(smooth) <= crossings


def test_the_period_of_a_motion():
    surge, roll = "{kind: surge, amplitude: 0.1, omega: 4.0}", "{kind: roll, amplitude_deg: 1, omega: %s}"
    base = "dimension: 2\nspacing: 0.1\ntank: {size: [1, 1]}\nfluids: [{name: w, depth: 0.5}]\ntime: {end: 1}\n"
    for motion, period in (
        ([surge], np.pi / 2),
        ([surge, roll % "4.0"], np.pi / 2),
        ([surge, roll % "0"], np.pi / 2),
        ([surge, roll % "5.0"], None),
        ([], None),
    ):
        assert forcing_period(parse_job(f"{base}motion: [{', '.join(motion)}]\n").motion) == period


def test_signals_that_repeat_others_are_left_out_of_pictures():
    one, two = np.arange(3.0), np.arange(3.0) + 1.0
    names = ["P", "P.max", "a.Fx", "a.tank.Fx", "b.Fx", "b.tank.Fx", "b.post.Fx"]
    values = [one, two, one, one, two, one, one]
    kept = principal([(name, "N", value) for name, value in zip(names, values, strict=True)])
    assert [name for name, _, _ in kept] == ["P", "a.Fx", "b.Fx", "b.tank.Fx", "b.post.Fx"]


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
