"""No constant of the scheme has a unit, and no physics depends on how long a run is."""

import numpy as np
import pytest

from parmps.loader import parse_job
from parmps.stages import make_plan

TANK = """
dimension: 2
spacing: {spacing}
gravity: 9.81
tank: {{size: [{length}, {height}], baffles: [{{x: {middle}, bottom: 0.0, top: {top}, thickness: {thick}}}]}}
fluids: [{{name: water, depth: {depth}, kinematic_viscosity: {viscosity}}}]
motion: [{{kind: surge, amplitude: {amplitude}, omega: {omega}}}]
time: {{end: {end}}}
scheme: {preset}
"""
PERIOD = 1.26
"""s, of the first wave of a tank of 1 m with 0.3 m of liquid."""


def scaled(preset, s, end):
    """A tank whose lengths are s times, and times sqrt(s) times, those of one of 1 m (Froude)."""
    time = s**0.5
    return TANK.format(
        preset=preset, spacing=0.05 * s, length=1.0 * s, height=0.6 * s, middle=0.5 * s, top=0.15 * s, thick=0.02 * s,
        depth=0.3 * s, viscosity=1e-3 * s * time, amplitude=0.02 * s, omega=4.9 / time, end=end * time,
    )


@pytest.mark.parametrize(
    ("preset", "share"),
    [
        ("fast", 1.0),
        ("balanced", 1.0),
        ("accurate", 0.5),
        ("papers", 0.2),  # whose gradient of P_j + P_i scatters rounding tenfold in a quarter of a period
    ],
)
def test_a_job_scaled_by_froudes_law_is_the_same_job(start, preset, share):
    found = []
    for s in (1.0, 1.0 / 50.0, 1000.0):
        sim = start(scaled(preset, s, share * PERIOD))
        while sim.time < sim.job.time.end:
            sim.step(sim.job.time.end)
        p = sim.particles
        order = np.argsort(p.id[: p.liquid])
        found.append((p.position[: p.liquid][order] / s, p.velocity[: p.liquid][order] / s**0.5))
    for position, velocity in found[1:]:
        assert np.abs(position - found[0][0]).max() < 1e-6
        assert np.abs(velocity - found[0][1]).max() < 1e-5


SYRUP = """
dimension: 2
spacing: 0.02
tank: {size: [0.4, 0.3]}
fluids: [{name: syrup, depth: 0.2, kinematic_viscosity: NU}]
motion: [{kind: surge, amplitude: 0.01, omega: 8.0}]
time: {end: END}
output: {probes_every: 0.01, particles_every: 0.1, checkpoint_every: 0.1}
"""


def test_a_run_is_the_first_half_of_one_twice_as_long(start):
    states = []
    for end in (0.1, 0.2):
        sim = start(SYRUP.replace("NU", "3.0e-5").replace("END", str(end)))
        for sample in range(1, 11):
            while sim.time < sample / 100:
                sim.step(sample / 100)
        states.append(sim.particles.arrays())
    for name, values in states[0].items():
        np.testing.assert_array_equal(values, states[1][name], err_msg=name)


@pytest.mark.parametrize("viscosity", ["1.0e-6", "1.0e-5", "3.0e-5", "1.0e-4", "1.0e-3"])
def test_the_plan_does_not_depend_on_the_end(viscosity):
    plans = [
        make_plan(parse_job(SYRUP.replace("NU", viscosity).replace("END", end), ()), 1)
        for end in ("0.1", "10.0", "1.0e4")
    ]
    names = [[stage.name for stage in (*plan.solve, *plan.move)] for plan in plans]
    assert names[0] == names[1] == names[2]
    assert ("viscosity" in names[0]) == (float(viscosity) > 5e-6)


def test_the_plan_does_not_depend_on_a_presets_name():
    """What the preset `papers` sets is what makes its plan, whatever it is called."""
    papers = parse_job(SYRUP.replace("NU", "1.0e-6").replace("END", "1.0") + "scheme: papers\n", ())
    settings = papers.scheme.model_dump(exclude={"preset"})
    renamed = papers.model_copy(update={"scheme": papers.scheme.model_validate({"preset": "balanced", **settings})})
    plans = make_plan(papers, 1), make_plan(renamed, 1)
    assert [stage.name for stage in plans[0].move] == [stage.name for stage in plans[1].move]
