"""Viscous stress: there is none in free liquid that turns as a whole, and that on the walls is part of their load."""

import numpy as np
import pytest

from parmps.domain import Domain
from parmps.loader import parse_job
from parmps.run import Run
from parmps.signals import read_signals
from parmps.stages import make_plan


@pytest.mark.parametrize(
    ("dimension", "spacing", "viscosity", "implicit"),
    [(2, 0.01, 1e-3, False), (2, 0.01, 0.1, True), (2, 0.01, 20.0, True), (3, 0.02, 2e-3, False)],
)
def test_a_free_drop_goes_on_turning(start, dimension, spacing, viscosity, implicit):
    """With the Laplacian alone, for which a free surface brakes what turns, it loses a third in a second and more."""
    region = f"{'disc' if dimension == 2 else 'ball'}: {{centre: {[0.2] * dimension}, radius: 0.1}}"
    sim = start(
        f"dimension: {dimension}\nspacing: {spacing}\ngravity: 0\ntank: {{size: {[0.4] * dimension}}}\n"
        f"fluids: [{{name: oil, region: {{{region}}}, kinematic_viscosity: {viscosity}, surface_tension: 1}}]\n"
        "time: {end: 1, max_step: 0.005}\n"
    )

    def parts():
        p = sim.particles
        return p.position[: p.liquid] - p.position[: p.liquid].mean(axis=0), p.velocity[: p.liquid]

    def spin():
        r, v = parts()
        return np.sum(r[:, 2] * v[:, 0] - r[:, 0] * v[:, 2])

    r, v = parts()
    v[:, 0], v[:, 2] = 0.5 * r[:, 2], -0.5 * r[:, 0]
    before = spin()
    while sim.time < 1.0:
        sim.step(1.0)
    assert sim.implicit == implicit
    assert spin() == pytest.approx(before, rel=0.01)


@pytest.mark.parametrize(
    ("depth", "viscosity", "scheme", "stages"),
    [
        (0.05, 1e-3, "balanced", {"viscosity", "strain"}),
        (0.1, 1e-3, "balanced", {"viscosity"}),  # no surface
        (0.05, 1e-6, "balanced", {"viscosity"}),  # takes 0.2 % of the first wave in the run
        (0.05, 1e-7, "balanced", set()),
        (0.05, 1e-3, "papers", {"viscosity"}),
    ],
)
def test_stress_at_the_surface_is_modelled_where_viscosity_shows(start, depth, viscosity, scheme, stages):
    job = start(
        "dimension: 2\nspacing: 0.01\ntank: {size: [0.1, 0.1]}\ntime: {end: 1.0}\n"
        f"fluids: [{{name: oil, depth: {depth}, kinematic_viscosity: {viscosity}}}]\nscheme: {scheme}\n"
    ).job
    plan = make_plan(job, 1)
    assert {stage.name for stage in plan.move + plan.solve} & {"viscosity", "strain"} == stages


@pytest.mark.parametrize("viscosity", [2e-3, 2e-2])
def test_load_on_a_tank_is_what_its_liquid_loses_of_momentum(tmp_path, viscosity):
    """Without friction, 14 % are missing at 0.02 m2/s."""
    amplitude, omega, mass = 0.005, 8.0, 1000.0 * 0.4 * 0.2
    job = parse_job(
        "dimension: 2\nspacing: 0.01\ntank: {size: [0.4, 0.3]}\n"
        f"fluids: [{{name: oil, depth: 0.2, kinematic_viscosity: {viscosity}}}]\n"
        f"motion: [{{kind: surge, amplitude: {amplitude}, omega: {omega}}}]\ntime: {{end: 2}}\n"
        "probes: [{name: load, kind: force}, {name: oil, kind: liquid, fluid: oil}]\noutput: {probes_every: 0.01}\n"
    )
    run = Run(job, Domain(), tmp_path / "run")
    try:
        run.go()
    finally:
        run.close()
    time, signals = read_signals(tmp_path / "run" / "probes.csv")
    values = {name: column for name, _, column in signals}
    load = values["load.Fx"]
    impulse = np.concatenate([[0.0], np.cumsum(0.5 * (load[1:] + load[:-1]) * np.diff(time))])
    velocity = np.gradient(values["oil.x"], time, edge_order=2) + amplitude * omega * np.cos(omega * time)
    settled = time > 0.3
    error = (impulse + mass * velocity)[settled]
    assert error.std() < 0.04 * mass * velocity[settled].std()
