"""What several keys mean together: what a job accepts runs and restarts, and what cannot run is refused."""

import numpy as np
import pytest

from parmps import checkpoint
from parmps.domain import Domain
from parmps.errors import InputError
from parmps.loader import parse_job
from parmps.particles import WALL
from parmps.run import Run
from parmps.simulation import Simulation

JOB = """
dimension: 2
spacing: 0.05
tank: {size: [1.0, 0.6]}
fluids: [{name: water, depth: 0.3}]
time: {end: 0.04}
output: {probes_every: 0.01, particles_every: 0.02, checkpoint_every: 0.02}
probes:
  - {name: load, kind: force}
  - {name: wall, kind: pressure, at: [0.0, 0.1]}
  - {name: level, kind: elevation, at: [0.5]}
"""
LAYERS = "fluids=[{name: a, depth: 0.2}, {name: b, depth: 0.2, density: 800}]"
SHAKEN = "motion=[{kind: surge, amplitude: 0.05, omega: 6.0}]"


def go(directory, *overrides, restart=None):
    """Run the job; its samples, and the arrays of its last checkpoint in the order of the particles."""
    run = Run(parse_job(JOB, overrides), Domain(), directory, restart)
    try:
        run.go()
    finally:
        run.close()
    arrays = checkpoint.read_slabs(directory / "checkpoint.h5", [0])
    return (directory / "probes.csv").read_text(), {name: a[np.argsort(arrays["id"])] for name, a in arrays.items()}


@pytest.mark.parametrize(
    "overrides",
    [("scheme=papers",), ("scheme=papers", LAYERS, SHAKEN), ("scheme={preset: papers, gradient: min}", LAYERS)],
)
def test_the_papers_scheme_measures_and_restarts(tmp_path, overrides):
    """At t = 0, at checkpoints and at restarts, no step has found neighbours or the free surface before they are used.

    The probes crashed, gauges read nothing, and with more ranks the lists were those of other particles.
    """
    whole, arrays = go(tmp_path / "whole", *overrides)
    rows = np.genfromtxt(whole.splitlines(), delimiter=",", names=True)
    depth = 0.4 if LAYERS in overrides else 0.3
    np.testing.assert_allclose(rows["level_m"], depth, atol=0.03)  # its rows are half a spacing higher
    go(tmp_path / "parts", *overrides, "time.end=0.02")
    again, continued = go(tmp_path / "parts", *overrides, restart=tmp_path / "parts")
    assert again == whole
    for name, values in arrays.items():
        np.testing.assert_array_equal(continued[name], values, err_msg=name)


def test_a_restart_that_has_no_step_to_take(tmp_path):
    go(tmp_path, "scheme=papers", LAYERS)
    go(tmp_path, "scheme=papers", LAYERS, restart=tmp_path)


def test_pressures_that_are_known_are_exact(start):
    """Walls in the papers' free surface have none. The solver's error there put dummies behind them under pressure.

    It was of either sign, by the number of ranks: three layers in a prism then were 1.7e-4 spacings apart on one and
    three ranks after 0.08 s.
    """
    sim = start(JOB, "scheme=papers", SHAKEN)
    for _ in range(5):
        sim.particles.pressure += 100.0 * np.sin(sim.particles.id)  # as if all had been wet
        sim.step(1.0)
        p, rows = sim.particles, slice(0, sim.particles.rows)
        surface = sim.work.surface[rows] != 0
        assert (surface & (p.kind[rows] == WALL)).any()
        assert not p.pressure[rows][surface].any()


@pytest.mark.parametrize(
    ("overrides", "key", "rule"),
    [
        (("scheme.gradient=sum",), "scheme.gradient", "scheme.position: moved"),
        (("scheme.surface=dirichlet",), "scheme.gradient", "scheme.surface: ghost"),
        (("scheme.position=moved",), "scheme.gradient", "scheme.position: start"),
        (("scheme={preset: papers, gradient: corrected}",), "scheme.gradient", "scheme.position: start"),
        (("scheme={preset: papers, position: start}",), "scheme.gradient", "scheme.position: moved"),
    ],
)
def test_gradients_that_feed_liquid_at_rest_are_refused(overrides, key, rule):
    with pytest.raises(InputError, match=rule) as caught:
        parse_job(JOB, overrides)
    assert str(caught.value).startswith(key)


@pytest.mark.parametrize("depth", [0.6, 0.59])
def test_no_standing_wave_in_a_tank_full_of_one_liquid(depth):
    job = parse_job(JOB, (f"fluids[0].depth={depth}", "initial={kind: standing_wave, amplitude: 0.01}"))
    with pytest.raises(InputError, match="initial.kind: a standing wave needs a boundary that moves"):
        Simulation(job, Domain())
