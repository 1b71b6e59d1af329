"""Several liquids in the papers' scheme: its operators against sums over all pairs, its stages, and layers at rest."""

import numpy as np
import pytest

from parmps.kernels.weight import lattice
from parmps.particles import FLUID

REACH, WIDE = 2.1, 4.01
LAYERS = (
    "spacing: 0.01\ntank: {{size: {size}}}\ndimension: {dimension}\ntime: {{end: 9.0}}\nscheme: papers\nfluids: "
    "[{{name: a, depth: 0.04, density: 1300, kinematic_viscosity: 0.03}},"
    " {{name: b, depth: 0.04, density: 780, kinematic_viscosity: 1.0e-6}}]\n"
)
TENSE = "interfaces=[{between: [a, b], surface_tension: 0.5}]"
SIZE = {2: [0.1, 0.16], 3: [0.06, 0.06, 0.12]}


@pytest.fixture
def start(start):
    """Start simulations, and choose their first step."""

    def begin(text, *overrides):
        sim = start(text, *overrides)
        sim.choose_step(1.0)
        return sim

    return begin


@pytest.fixture
def shaken(start):
    """Start two layers whose particles are moved off the lattice; their liquid's distances in spacings, and pairs."""

    def begin(dimension):
        sim = start(LAYERS.format(dimension=dimension, size=SIZE[dimension]), TENSE)
        p, rng = sim.particles, np.random.default_rng(3)
        axes = [0, 2] if dimension == 2 else [0, 1, 2]
        p.position[: p.liquid, axes] += 0.1 * sim.l0 * rng.uniform(-1.0, 1.0, (p.liquid, len(axes)))
        p.velocity[: p.liquid, axes] = rng.normal(size=(p.liquid, len(axes)))
        at = p.position[: p.liquid] / sim.l0
        return sim, at[None, :, :] - at[:, None, :]

    return begin


def run(sim, *names):
    """Run the first stages of these names."""
    for name in names:
        next(stage for stage in sim.plan.move if stage.name == name).run(sim)


def weight(r):
    """W of the papers, at 0 too ([000] eq. 3)."""
    return np.where(r < REACH, REACH / (0.85 * r + 0.15 * REACH) - 1.0, 0.0)


@pytest.mark.parametrize("dimension", [2, 3])
def test_smoothed_density(shaken, dimension):
    sim, d = shaken(dimension)
    run(sim, "neighbours", "wall liquids", "density smoothing")
    p, w = sim.particles, sim.work
    weights = weight(np.linalg.norm(d, axis=2))
    rho, number = np.array([1300.0, 780.0]), p.fluid[: p.liquid]
    wanted = weights @ rho[number] / weights.sum(axis=1)
    np.testing.assert_allclose(w.mass_density[: p.liquid], wanted, rtol=1e-6)
    far = np.abs(p.position[: p.liquid, 2] - 0.045) > 0.03
    np.testing.assert_array_equal(w.mass_density[: p.liquid][far], rho[number[far]])
    np.fill_diagonal(weights, 0.0)
    same = (weights * (number[:, None] == number)).sum(axis=1)
    np.testing.assert_allclose(w.fraction[: p.liquid], same / weights.sum(axis=1), rtol=1e-6)
    nearest = w.nearest[p.liquid : p.rows]
    wet = nearest >= 0
    np.testing.assert_array_equal(w.mass_density[p.liquid : p.rows][wet], w.mass_density[nearest[wet]])


@pytest.mark.parametrize("dimension", [2, 3])
def test_surface_force(shaken, dimension):
    """Sum for the colour's gradient, and the curvature from differences of the smoothed colour around the particle."""
    sim, d = shaken(dimension)
    run(sim, "neighbours", "wall liquids", "density smoothing")
    p, w = sim.particles, sim.work
    w.intermediate[:] = 0.0
    run(sim, "surface tension")
    number = p.fluid[: p.liquid]
    other = number[:, None] != number
    r = np.linalg.norm(d, axis=2)
    np.fill_diagonal(r, np.inf)
    slope = dimension / lattice(dimension, REACH).density * np.einsum("ij,ijk->ik", other * weight(r) / r**2, d)
    near = np.flatnonzero(np.any(slope != 0.0, axis=1))
    h, axes = 1e-3, [0, 2] if dimension == 2 else [0, 1, 2]
    basis = h * np.eye(3)[axes]
    inside = np.where(np.isinf(r), 0.0, r)[near] < WIDE

    def colour(at):
        g = np.exp(-9.0 * np.sum((d[near] - at) ** 2, axis=2) / WIDE**2) * inside
        return (g * other[near]).sum(axis=1) / g.sum(axis=1)

    def normal(at):
        grad = np.stack([colour(at + e) - colour(at - e) for e in basis], axis=1)
        return grad / np.linalg.norm(grad, axis=1)[:, None]

    pairs = enumerate(basis)
    kappa = -sum((normal(e) - normal(-e))[:, axis] for axis, e in pairs) / (2.0 * h)
    kappa = np.clip(kappa, 1.0 - dimension, dimension - 1.0)
    force = 0.5 * kappa[:, None] * slope[near] / sim.l0**2
    wanted = sim.dt * force / w.mass_density[near, None]
    np.testing.assert_allclose(w.intermediate[near], wanted, atol=1e-4 * np.abs(wanted).max())
    assert not np.delete(w.intermediate[: p.liquid], near, axis=0).any()


def test_surface_force_on_a_disc(start):
    """Across the interface, the force sums to sigma / R, inwards."""
    sim = start(
        "dimension: 2\nspacing: 0.025\ngravity: 0\ntank: {size: [1.0, 1.0]}\ntime: {end: 1.0}\nscheme: papers\n"
        "fluids: [{name: a, region: {disc: {centre: [0.5, 0.5], radius: 0.3}}}, {name: b, depth: 1.0}]\n",
        TENSE,
    )
    assert "density smoothing" not in sim.seconds
    run(sim, "neighbours")
    sim.work.intermediate[:] = 0.0
    run(sim, "surface tension")
    p = sim.particles
    out = p.position[: p.liquid] - [0.5, 0.0, 0.5]
    out /= np.maximum(np.linalg.norm(out, axis=1), 1e-9)[:, None]
    force = sim.particle_mass[0] / sim.dt * sim.work.intermediate[: p.liquid]
    assert -np.einsum("ij,ij->", force, out) == pytest.approx(0.5 / 0.3 * 2.0 * np.pi * 0.3, rel=0.05)
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-9)


def test_viscosity_between_liquids(shaken):
    """2 D / (n0 lambda) sum mu_ij (v_j - v_i) W over the density, mu_ij the harmonic mean ([000] eqs. 13 and 14)."""
    sim, d = shaken(2)
    run(sim, "neighbours")
    p, w = sim.particles, sim.work
    w.intermediate[:] = 0.0
    sim.implicit = False
    run(sim, "viscosity")
    number = p.fluid[: p.liquid]
    rho, mu = np.array([1300.0, 780.0])[number], np.array([1300.0 * 0.03, 780.0 * 1e-6])[number]
    r = np.linalg.norm(d, axis=2)
    np.fill_diagonal(r, np.inf)
    pair = 2.0 * mu[:, None] * mu / (mu[:, None] + mu) * weight(r)
    change = pair @ p.velocity[: p.liquid] - pair.sum(axis=1)[:, None] * p.velocity[: p.liquid]
    lat = lattice(2, REACH)
    wanted = sim.dt * 4.0 / (lat.density * lat.lam * sim.l0**2) * change / rho[:, None]
    inner = (np.abs(p.position[: p.liquid, 0] - 0.05) < 0.025) & (p.position[: p.liquid, 2] > 0.025)
    np.testing.assert_allclose(w.intermediate[: p.liquid][inner], wanted[inner], atol=1e-6 * np.abs(wanted).max())


def test_only_several_liquids_have_the_stages(start):
    text = LAYERS.format(dimension=2, size=SIZE[2])
    both = start(text, TENSE)
    one = start(text, "fluids=[{name: a, depth: 0.08}]")
    own = {"wall liquids", "density smoothing", "surface tension"}
    assert own <= set(both.seconds)
    assert not own & set(one.seconds)
    assert own <= set(dict(one.plan.left_out))
    sharp = ("bend", "near_interface")
    assert not any(hasattr(getattr(both.work, name), "__len__") for name in sharp)
    assert one.work.mass_density is None
    assert one.work.fraction is None
    assert len(one.work.nearest) == 0


def test_layers_stay_at_rest_for_a_while(start):
    sim = start(LAYERS.format(dimension=2, size=SIZE[2]))
    for _ in range(40):
        sim.step(9.0)
    p = sim.particles
    assert np.count_nonzero(p.kind[: p.liquid] == FLUID) == sim.totals["fluid"]
    height = p.position[: p.liquid, 2] / sim.l0 - 4.5
    assert np.all((height < 1.0) | (p.fluid[: p.liquid] == 1))
    assert np.all((height > -1.0) | (p.fluid[: p.liquid] == 0))
    assert abs(sim.energy_drift()) < 0.01
    assert abs(sim.volume_drift()) < 0.01
