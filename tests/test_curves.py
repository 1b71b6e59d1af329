"""Curves through recorded samples, against the motion that was sampled."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from parmps.curves import Curve
from parmps.rounding import resolution, rounding_matters, steady_clock


def sine(t, amplitude=0.01, omega=4.5, phase=0.0):
    """Value and first two derivatives."""
    angle = omega * t + phase
    value = amplitude * np.sin(angle)
    return np.array([value, amplitude * omega * np.cos(angle), -(omega**2) * value])


def two_sines(t):
    return sine(t) + sine(t, 0.002, 13.0, 0.4)


def assert_near(curve, law, ends, step, share):
    """Displacement within a step; acceleration within a share, and 4 times that near the ends, where less is known."""
    t = np.linspace(*ends, 4001)
    found, true = curve(t), law(t)
    assert np.abs(found[0] - true[0]).max() <= step
    off = np.abs(found[2] - true[2]) / np.abs(true[2]).max()
    assert np.sqrt(np.mean(off**2)) <= share
    inside = (t > ends[0] + 0.15) & (t < ends[1] - 0.15)
    assert off[inside].max() <= 2 * share
    assert off.max() <= 8 * share


@pytest.mark.parametrize("phase", [0.0, 1.2])
@pytest.mark.parametrize(("rate", "decimals"), [(1000, 5), (200, 4), (200, 5)])
def test_a_rounded_record_has_the_motion_that_was_rounded(rate, decimals, phase):
    t = np.arange(0, 2.0005, 1 / rate)
    samples = np.round(sine(t, phase=phase)[0], decimals)
    curve, step = Curve(t, samples), 10.0**-decimals
    assert curve.resolution == pytest.approx(step)
    assert np.abs(curve(t)[0] - samples).max() <= 0.5 * step * (1 + 1e-6)
    assert_near(curve, lambda t: sine(t, phase=phase), (0, 2), 0.5 * step, 0.02)


def test_without_smoothing_the_rounding_would_be_many_times_the_acceleration():
    t = np.arange(0, 2.0005, 0.001)
    spline = CubicSpline(t, np.round(sine(t)[0], 5))
    assert np.abs(spline(t, 2)).max() > 100 * np.abs(sine(t)[2]).max()


def roughly(text):
    return lambda value: float(text % value)


@pytest.mark.parametrize(
    ("law", "rate", "rounded", "step"),
    [
        (lambda t: 400 * sine(t, phase=2.0), 100, lambda x: np.round(x, 1), 0.1),
        (lambda t: 5 * sine(t, omega=4.8, phase=1.0), 20, lambda x: np.round(x, 3), 1e-3),
        (two_sines, 200, lambda x: np.round(x, 4), 1e-4),
        (sine, 200, np.vectorize(roughly("%.3g")), 1e-5),
        (lambda t: 200 * sine(t) + [[0.1234], [0], [0]], 200, lambda x: 0.1234 + np.round((x - 0.1234) * 409.6) / 409.6,
         1 / 409.6),
        (lambda t: sine(t) + [[3.0], [0], [0]], 1000, lambda x: x.astype(np.float32).astype(float), 2.4e-7),
    ],
    ids=["degrees", "20 Hz", "two sines", "three digits", "converter", "single precision"],
)  # fmt: skip
def test_whatever_rounds_is_found(law, rate, rounded, step):
    t = np.arange(0, 8, 1 / rate)
    curve = Curve(t, rounded(law(t)[0]))
    assert curve.resolution == pytest.approx(step, rel=0.01)
    assert_near(curve, law, (0, t[-1]), 1.2 * step, 0.03)


def test_exact_samples_are_interpolated():
    t = np.arange(0, 5, 0.01)
    curve, spline = Curve(t, sine(t)[0]), CubicSpline(t, sine(t)[0])
    at = np.linspace(0, t[-1], 999)
    assert curve.resolution == 0.0 and curve.swing is None and curve.scatter == 0.0
    for order in range(3):
        np.testing.assert_allclose(curve(at)[order], spline(at, order), atol=1e-9)


@pytest.mark.parametrize("values", [0.5 * np.arange(300) ** 2 * 1e-4, 0.0025 * np.arange(300), np.full(300, 5.0)])
def test_straight_lines_and_parabolas_have_no_rounding(values):
    t = 0.01 * np.arange(300)
    curve = Curve(t, values)
    assert curve.resolution == 0.0
    np.testing.assert_allclose(curve(t)[2], np.gradient(np.gradient(values, t), t)[150], atol=1e-6)


def test_a_logger_that_paused_does_not_swing():
    t = np.concatenate([np.arange(0, 5, 0.005), np.arange(60, 62, 0.005)])
    still = np.minimum(t, 5.0)
    samples = np.round(sine(still)[0], 4)
    curve = Curve(t, samples)
    pause = curve(np.linspace(5.0, 60.0, 5001))[0]
    assert curve.resolution == pytest.approx(1e-4)
    low, high = sorted([samples[999], samples[1000]])
    assert low - 1e-4 < pause.min() and pause.max() < high + 1e-4


def test_scatter_beyond_the_rounding_is_told():
    t = np.arange(0, 4, 0.005)
    noise = np.random.default_rng(1).normal(size=len(t))
    curve = Curve(t, np.round(sine(t)[0] + 2e-4 * noise, 5))
    assert curve.resolution == 0.0
    assert curve.scatter == pytest.approx(2e-4, rel=0.1)


def test_a_sparse_record_is_not_overshot():
    t, values = np.array([0, 1, 1.2, 5, 60.0]), np.array([0, 0, 0.05, 0.05, 0.05])
    curve = Curve(t, values)
    at = np.linspace(0, 60, 60_001)
    value, rate, acceleration = curve(at)
    assert value.min() >= 0.0 and value.max() <= 0.05 + 1e-12
    assert np.all(curve(at[at <= 1.0]) == 0.0)
    assert np.all(rate >= -1e-12)
    # a smooth step of 0.05 m in 0.2 s: 10 / sqrt(3) times distance / time^2
    assert np.abs(acceleration).max() == pytest.approx(0.05 / 0.2**2 * 10 / np.sqrt(3), rel=1e-3)
    swing_time, swing, low, high = curve.swing
    assert 5 < swing_time < 60 and swing < -29 and low == high == 0.05


@pytest.mark.parametrize("seed", range(5))
def test_sparse_steps_stay_between_their_rows(seed):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.choice([0.1, 1.0, 20.0], 12))
    values = np.repeat(rng.choice([0.0, 0.02, 0.05], 6), 2)  # holds, with jumps between
    at = np.linspace(t[0], t[-1], 20_001)
    found = Curve(t, values)(at)[0]
    for k in range(len(t) - 1):
        inside = found[(at >= t[k]) & (at <= t[k + 1])]
        low, high = sorted(values[k : k + 2])
        assert len(inside) == 0 or (inside.min() >= low - 5e-4 and inside.max() <= high + 5e-4)
        if low == high and t[k + 1] - t[k] > 2.0 * np.diff(t)[[k - 1, (k + 1) % 11]].max():
            np.testing.assert_allclose(inside, low, atol=1e-12)


@pytest.mark.parametrize(("rows", "error"), [(8, 0.012), (12, 0.0025), (16, 0.0008)])
def test_few_samples_a_period_are_as_accurate_as_their_spline(rows, error):
    for phase in np.linspace(0, 6, 7):
        t = np.arange(0, 30, 2 * np.pi / rows)
        at = np.linspace(0, t[-1], 3001)
        assert np.abs(Curve(t, np.sin(t + phase))(at)[0] - np.sin(at + phase)).max() < error


def test_derivatives_are_continuous():
    t = np.array([0, 0.3, 0.5, 1.0, 4.0, 4.1, 9.0])
    curve = Curve(t, np.array([0, 0.1, 0.05, 0.2, 0.2, 0.0, 1.0]))
    for node in t[1:-1]:
        np.testing.assert_allclose(curve(node - 1e-10), curve(node + 1e-10), atol=1e-5)
    at = np.linspace(0, 9, 90_001)
    value, rate, acceleration = curve(at)
    np.testing.assert_allclose(np.gradient(value, at)[1:-1], rate[1:-1], atol=1e-3)
    np.testing.assert_allclose(np.gradient(rate, at)[1:-1], acceleration[1:-1], atol=0.5)


def test_rounded_times_of_a_steady_clock():
    steps = np.arange(900)
    for kept in (steps, steps[(steps < 300) | (steps > 340)]):
        times = steady_clock(np.round(kept / 300, 3))
        np.testing.assert_allclose(times, kept / 300, atol=5e-6)
    uneven = np.round(np.cumsum(np.random.default_rng(2).uniform(0.01, 0.05, 200)), 3)
    np.testing.assert_array_equal(steady_clock(uneven), uneven)
    even = 0.01 * steps
    np.testing.assert_array_equal(steady_clock(even), even)


def test_a_record_with_rounded_times_and_values():
    t = np.arange(600) / 300
    times, samples = np.round(t, 3), np.round(sine(t)[0], 5)
    assert_near(Curve(steady_clock(times), samples), sine, (0, t[-1]), 1e-5, 0.02)


def test_resolution():
    t = np.arange(0, 3, 0.001)
    for values, steps in ((np.round(sine(t)[0], 5), 1e-5), (np.round(7 + sine(t)[0], 4), 1e-4), (sine(t)[0], 0.0)):
        np.testing.assert_allclose(resolution(values), steps)
    fine = np.round(sine(t)[0], 9)
    assert not rounding_matters(t[::20], fine[::20], resolution(fine[::20]))
    assert rounding_matters(t, np.round(fine, 5), resolution(np.round(fine, 5)))
