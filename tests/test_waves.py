"""Linear waves of layered liquids against closed formulas."""

import numpy as np
import pytest
from scipy.optimize import brentq

from parmps.loader import parse_job
from parmps.tank import FLUID, initial_velocity, place
from parmps.waves import Layers, modes, velocity

G = 9.81


def layers(depth, density, tension=None, lid=False):
    depth, density = np.array(depth, float), np.array(density, float)
    return Layers(depth, density, G, np.zeros(len(depth)) if tension is None else np.array(tension), lid)


def test_one_layer():
    for k in (0.5, 3.0, 400.0):
        omega2, shape = modes(layers([0.3], [1000.0], [0.07]), k)
        assert omega2[0] == pytest.approx((G * k + 0.07 * k**3 / 1000.0) * np.tanh(0.3 * k), rel=1e-12)
        assert shape[0, 0] == 1.0


@pytest.mark.parametrize("densities", [(1300.0, 1000.0), (1000.0, 1.0), (800.0, 1000.0)])
def test_two_layers_under_a_lid(densities):
    """Lamb, Hydrodynamics, section 231, with section 266 for the tension; unstable where the upper is heavier."""
    h, rho, k, sigma = (0.2, 0.35), densities, 4.0, 0.5
    omega2, _ = modes(layers(h, rho, [sigma, 0.0], lid=True), k)
    wanted = (G * k * (rho[0] - rho[1]) + sigma * k**3) / (rho[0] / np.tanh(k * h[0]) + rho[1] / np.tanh(k * h[1]))
    assert omega2 == pytest.approx([wanted], rel=1e-12)


def test_two_layers_with_a_free_surface():
    """Lamb, section 231, eq. 12: a quadratic in omega^2."""
    (h, above), (rho, light), k = (0.2, 0.35), (1300.0, 900.0), 2.5
    c, d = 1.0 / np.tanh(k * h), 1.0 / np.tanh(k * above)
    found, shape = modes(layers([h, above], [rho, light]), k)
    wanted = np.roots([rho * c * d + light, -rho * (c + d) * G * k, (rho - light) * (G * k) ** 2])
    np.testing.assert_allclose(found, np.sort(wanted)[::-1], rtol=1e-10)
    # section 231, eq. 13: the ratio of the surface's elevation to the interface's
    ratio = found / (found * np.cosh(k * above) - G * k * np.sinh(k * above))
    np.testing.assert_allclose(shape[1] / shape[0], ratio, rtol=1e-10)


def test_paper_000_tank():
    omega2, shape = modes(layers([0.15, 0.15, 0.38], [1300.0, 1000.0, 780.0]), np.pi / 1.08)
    np.testing.assert_allclose(np.sqrt(omega2), [5.204, 1.838, 1.050], rtol=1e-3)
    np.testing.assert_allclose(shape[:, 1], [0.72, 1.0, -0.10], atol=5e-3)


def test_many_equal_layers_are_one():
    omega2, _ = modes(layers([0.1] * 5, [1000.0] * 5), 3.0)
    assert omega2[0] == pytest.approx(G * 3.0 * np.tanh(1.5), rel=1e-12)
    np.testing.assert_allclose(omega2[1:], 0.0, atol=1e-9)


def test_velocity_is_a_potential_flow_between_the_boundaries():
    tank, k = layers([0.2, 0.3], [1300.0, 1000.0]), 3.0
    speed, e = np.array([0.7, -0.4]), 1e-5
    x, z, layer = np.array([0.3, 0.3]), np.array([0.11, 0.37]), np.array([0, 1])

    def at(dx, dz):
        return np.array(velocity(tank, k, speed, x + dx, z + dz, layer))

    (ux, wx), (uz, wz) = (at(e, 0.0) - at(-e, 0.0)) / (2 * e), (at(0.0, e) - at(0.0, -e)) / (2 * e)
    np.testing.assert_allclose(ux + wz, 0.0, atol=1e-8)
    np.testing.assert_allclose(uz - wx, 0.0, atol=1e-8)
    for height, number, wanted in ((0.0, 0, 0.0), (0.2, 0, 0.7), (0.2, 1, 0.7), (0.5, 1, -0.4)):
        w = velocity(tank, k, speed, np.array([0.1]), np.array([height]), np.array([number]))[1]
        assert w[0] == pytest.approx(wanted * np.cos(0.3), abs=1e-12)


def test_the_initial_wave_moves_the_layers_by_its_shape():
    job = parse_job(
        "dimension: 2\nspacing: 0.01\ntank: {size: [0.5, 0.4]}\ntime: {end: 1.0}\n"
        "fluids: [{name: a, depth: 0.1, density: 1300}, {name: b, depth: 0.2}]\n"
        "initial: {kind: standing_wave, mode: 1, amplitude: 0.01, branch: 2}\n"
    )
    p = place(job, "half")
    liquid = p.kind == FLUID
    v, x = initial_velocity(job, p)[liquid], p.position[liquid]
    jump = v[(x[:, 2] > 0.1) & (x[:, 2] < 0.11)] - v[(x[:, 2] > 0.09) & (x[:, 2] < 0.1)]
    middle = np.argmax(np.abs(jump[:, 0]))
    slip = brentq(lambda s: s * np.sin(np.pi * 0.5) - jump[middle, 0], -1.0, 1.0)
    assert abs(slip) > 0.02 and np.abs(jump[:, 2]).max() < 0.1 * abs(slip)
