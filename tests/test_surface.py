"""Surface tension at the free surface: curvature, its pressure, and where there is none."""

import numpy as np
import pytest

from parmps.errors import InputError
from parmps.liquids import Liquids
from parmps.loader import parse_job
from parmps.stages import make_plan
from parmps.surface import find_surface_pressure
from parmps.waves import layers_of, modes

DROP = {2: "disc: {centre: [0.25, 0.25], radius: 0.1}", 3: "ball: {centre: [0.15, 0.15, 0.15], radius: 0.06}"}
TENSE = (
    "dimension: 2\nspacing: 0.01\ntank: {size: [0.2, 0.2]}\ntime: {end: 1.0, max_step: 0.001}\n"
    "fluids: [{name: water, depth: 0.06, kinematic_viscosity: 0, surface_tension: %g}]\n"
)


def ready(sim):
    """Find neighbours, moments and the surface."""
    sim.choose_step(1.0)
    for stage in sim.plan.solve:
        if stage.name in ("neighbours", "density", "surface"):
            stage.run(sim)
    return sim.particles, sim.work


@pytest.mark.parametrize("dimension", [2, 3])
def test_drop_has_the_pressure_of_laplace(start, dimension):
    size = [0.5, 0.5] if dimension == 2 else [0.3, 0.3, 0.3]
    sim = start(
        f"dimension: {dimension}\nspacing: 0.01\ngravity: 0\ntank: {{size: {size}}}\ntime: {{end: 9.0}}\n"
        f"fluids: [{{name: a, region: {{{DROP[dimension]}}}, kinematic_viscosity: 1.0e-3, surface_tension: 1}}]\n"
    )
    for _ in range(30):
        sim.step(9.0)
    p, radius = sim.particles, 0.1 if dimension == 2 else 0.06
    r = np.linalg.norm(p.position[: p.liquid] - p.position[: p.liquid].mean(axis=0), axis=1)
    assert p.pressure[: p.liquid][r < 0.6 * radius].mean() == pytest.approx((dimension - 1) / radius, rel=0.03)


def test_curvature_of_a_wave_that_stands_on_walls(start):
    sim = start(TENSE % 1.0)
    p, k, amplitude = sim.particles, np.pi / 0.2, 0.001
    p.position[: p.liquid, 2] += amplitude * np.cos(k * p.position[: p.liquid, 0])
    p, w = ready(sim)
    find_surface_pressure(sim)
    row = np.flatnonzero(w.surface[: p.liquid])
    wanted = amplitude * k * k * np.cos(k * p.position[row, 0])
    np.testing.assert_allclose(w.above[row], wanted, atol=0.05 * amplitude * k * k)
    assert len(row) == 20 and not w.above[: p.liquid][w.surface[: p.liquid] == 0].any()


def test_standing_wave_of_gravity_and_tension():
    job = parse_job(TENSE % 10.0)
    k = np.pi / 0.2
    found, _ = modes(layers_of(job), k)
    assert found[0] == pytest.approx((9.8 * k + 10.0 / 1000.0 * k**3) * np.tanh(0.06 * k))


@pytest.mark.parametrize(
    ("change", "reason"),
    [("fluids[0].surface_tension=0", "no surface tension"), ("fluids[0].depth=0.2", "the tank is full")],
)
def test_scene_without_it_has_no_stage(change, reason):
    job = parse_job(TENSE % 1.0, [change])
    plan = make_plan(job, 1)
    assert reason in dict(plan.left_out)["surface pressure"]
    assert Liquids(job).surface_tension is None and Liquids(job).capillary_rate == 0.0
    assert "surface pressure" in [stage.name for stage in make_plan(parse_job(TENSE % 1.0), 1).solve]


def test_particles_stand_evenly_along_a_free_drop(start):
    drop = "fluids=[{name: a, region: {disc: {centre: [0.25, 0.25], radius: 0.1}}, surface_tension: %g}]"
    spread = []
    for tension in (0.0, 1.0):
        sim = start(TENSE % 1.0, "tank.size=[0.5, 0.5]", drop % tension)
        p, w = ready(sim)
        row = np.flatnonzero(w.surface[: p.liquid])
        spread.append(np.std(np.linalg.norm(p.position[row] - [0.25, 0.0, 0.25], axis=1)) / sim.l0)
    assert spread[1] < 0.5 * spread[0]


def test_a_surface_that_is_squeezed_stays_one(start):
    square = "fluids=[{name: a, region: {box: [[0.05, 0.05], [0.15, 0.15]]}, surface_tension: 1}]"
    sim = start(TENSE % 1.0, "gravity=0", square)
    p, w = ready(sim)
    whole = w.surface[: p.liquid].copy()
    p.position[: p.liquid] = 0.1 + (p.position[: p.liquid] - 0.1) * [1.0 / 0.72, 1.0, 0.72] - [0.0, 0.1, 0.0]
    _, w = ready(sim)
    assert whole.sum() == 36
    np.testing.assert_array_equal(w.surface[: p.liquid], whole)


@pytest.mark.parametrize(("squeeze", "crowded"), [(1.0, False), (0.7, True)])
def test_particles_leave_a_crowded_row_where_it_is_deeper(start, squeeze, crowded):
    row = "region: {box: [[0.02, 0.05], [0.18, 0.11]]}, surface_tension: 1"
    sim = start(TENSE % 1.0, "gravity=0", f"fluids=[{{name: a, {row}}}]")
    p, w = ready(sim)
    p.position[: p.liquid, 0] = 0.1 + squeeze * (p.position[: p.liquid, 0] - 0.1)
    top = np.flatnonzero(p.position[: p.liquid, 2] > 0.1)
    top = top[np.argsort(p.position[top, 0])]
    p.position[top[1::2], 2] -= 0.0005
    p, w = ready(sim)
    find_surface_pressure(sim)
    middle = slice(len(top) // 4, -len(top) // 4)
    deeper = np.arange(len(top)) % 2 == 1
    inward = w.inward[top]
    assert (w.surface[top] != 0).all()
    assert (inward[deeper][3:-3] < 0.0).all() if crowded else not inward[middle].any()
    assert not inward[~deeper][3:-3].any()


def test_papers_scheme_has_none():
    with pytest.raises(InputError, match="surface_tension.*scheme.position: start, scheme.gradient: corrected"):
        parse_job(TENSE % 1.0, ["scheme=papers"])
