"""The validation's references against each other, and its cheapest cases within bounds of theory."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from parmps.domain import Domain
from parmps.loader import load_job
from parmps.run import Run

VALIDATION = Path(__file__).parents[1] / "jobs" / "validation"
sys.path.insert(0, str(VALIDATION))

import potential  # noqa: E402
import run as validation  # noqa: E402
from results import Results  # noqa: E402

LENGTH, DEPTH, G = 1.0, 0.5, 9.8


@pytest.fixture
def measured(tmp_path):
    """Run a case with some settings changed, and measure it."""

    def measure(name, *overrides):
        case = validation.load_case(name)
        job = VALIDATION / name / "case.yaml"
        state = validation.initial_state(case, load_job(job, overrides))
        overrides = [*overrides, *validation.write_state(state, tmp_path)]
        run = Run(load_job(job, overrides), Domain(), tmp_path / "run")
        try:
            run.go()
        finally:
            run.close()
        return case.measure(Results(tmp_path / "run"))

    return measure


def test_all_cases_can_run():
    for name in (path.parent.name for path in VALIDATION.glob("*/case.py")):
        case = validation.load_case(name)
        for variant, preset, spacing in validation.combinations(case):
            changes = [f"spacing={spacing:g}", f"scheme.preset={preset}", *validation.variants(case)[variant]]
            assert load_job(VALIDATION / name / "case.yaml", changes).scheme.preset == preset


# References


def test_spectral_method_solves_linear_theory():
    amplitude, omega, phase = 0.01, 4.0, 0.7
    time = np.linspace(0.0, 3.0, 61)
    flow = potential.PotentialFlow(LENGTH, DEPTH, G, order=1)
    flow.potential = -amplitude * omega * np.cos(phase) * (flow.x - LENGTH / 2.0)
    modes = flow.run(time, 0.005, lambda t: -amplitude * omega**2 * np.sin(omega * t + phase))
    theory = potential.surge_response(0.3, time, LENGTH, DEPTH, G, amplitude, omega, phase, modes=9)
    np.testing.assert_allclose(flow.elevation(modes[:, :10], 0.3), theory, atol=1e-4 * np.abs(theory).max())


def test_spectral_method_has_the_period_of_finite_amplitude_theory():
    amplitude = 0.05
    linear = potential.frequency(1, LENGTH, DEPTH, G)
    wanted = potential.finite_amplitude_frequency(amplitude, LENGTH, DEPTH, G)
    k = potential.wave_number(1, LENGTH)
    flow = potential.PotentialFlow(LENGTH, DEPTH, G, order=3, modes=12)
    flow.potential = amplitude * linear / k / np.tanh(k * DEPTH) * np.cos(k * flow.x)
    time = np.linspace(0.0, 1.3, 261)
    first = flow.run(time, 0.01)[:, 1]
    crossings = validation.load_case("standing_wave").crossings(time, first)
    assert len(crossings) == 1
    assert wanted < 0.998 * linear
    assert 2.0 * np.pi / crossings[-1] == pytest.approx(wanted, rel=3e-4)


@pytest.mark.parametrize("side", [0, 1])
def test_spectral_method_in_3d_has_the_waves_along_each_side(side):
    amplitude, omega, time = 0.02, 4.0, np.linspace(0.0, 1.5, 31)

    def run(flow, at, axis):
        flow.potential = flow.potential - amplitude * omega * (at - LENGTH / 2.0)
        return flow.run(time, 0.02, lambda t: -amplitude * omega**2 * np.sin(omega * t) * axis)

    flat = potential.PotentialFlow(LENGTH, DEPTH, G, order=3, modes=6)
    sides = (LENGTH, 0.7) if side == 0 else (0.7, LENGTH)
    deep = potential.PotentialFlow(sides[0], DEPTH, G, order=3, modes=6, width=sides[1])
    wanted = run(flat, flat.x, np.ones(1))
    found = run(deep, (deep.x, deep.y)[side], np.eye(2)[side])
    np.testing.assert_allclose(np.take(found, 0, axis=2 - side), wanted, atol=1e-9)


def test_spectral_method_in_3d_has_the_period_of_linear_theory():
    k = np.pi * np.hypot(1.0 / LENGTH, 1.0 / 0.7)
    omega, time = np.sqrt(G * k * np.tanh(k * DEPTH)), np.linspace(0.0, 1.0, 21)
    flow = potential.PotentialFlow(LENGTH, DEPTH, G, order=1, modes=4, width=0.7)
    flow.potential = np.cos(np.pi * flow.x / LENGTH) * np.cos(np.pi * flow.y / 0.7)
    found = flow.run(time, 0.01)[:, 1, 1]
    np.testing.assert_allclose(found, omega / G * np.sin(omega * time), atol=1e-4 * omega / G)


def test_linear_theory_of_a_baffle_that_is_none(monkeypatch):
    case = validation.load_case("baffled_3d")
    monkeypatch.setattr(case, "CELLS", 40)
    changes = ["tank.baffles=[{x: 0.285, bottom: 0.1999, top: 0.23, thickness: 0.006}]", "motion[0].omega=5.0"]
    job = load_job(VALIDATION / "baffled_3d" / "case.yaml", changes)
    time = np.linspace(0.0, 2.0, 201)
    theory = potential.surge_response(0.01, time, 0.57, 0.2, 9.8, 0.03, 5.0)
    np.testing.assert_allclose(case.linear(job, 2.0, 201), theory, atol=0.01 * np.abs(theory).max())


def test_decay_of_a_wave_in_a_deep_tank_is_that_of_its_end_walls():
    # for k h -> infinity the bottom is still, and both ends together take sqrt(nu omega / 2) / L
    nu = 1e-6
    bulk, layers = potential.viscous_decay(1, 1.0, 5.0, G, nu)
    omega = potential.frequency(1, 1.0, 5.0, G)
    assert bulk == pytest.approx(2.0 * nu * np.pi**2)
    assert layers == pytest.approx(np.sqrt(nu * omega / 2.0), rel=1e-6)


def test_observed_order():
    assert validation.observed_order([0.02, 0.01], [4.0, -1.0]) == pytest.approx(2.0)
    assert validation.observed_order([0.02], [4.0]) is None


def test_a_kept_run_counts_while_nothing_has_changed(tmp_path, monkeypatch):
    monkeypatch.setattr(validation, "OUT", tmp_path)
    case = validation.load_case("surge")
    kept = validation.Kept("surge", case, "0.9", "balanced", 0.02)
    assert kept.status is None
    kept.directory.mkdir(parents=True)
    (kept.directory / "validation.json").write_text(json.dumps({"key": kept.key, "status": "done"}))
    assert validation.Kept("surge", case, "0.9", "balanced", 0.02).status == "done"
    monkeypatch.setattr(case, "VARIANTS", {"0.9": ["motion[0].amplitude=0.003"]})
    assert validation.Kept("surge", case, "0.9", "balanced", 0.02).status is None


def test_targets_by_spacing_and_variant():
    def bound(name, variant, spacing, measure):
        case = validation.load_case(name)
        return validation.target(validation.Kept(name, case, variant, "accurate", spacing), measure)

    assert bound("standing_wave", "", 0.01, "amplitude [%]") == 2.0
    assert bound("standing_wave", "", 0.02, "amplitude [%]") == 4.0
    assert bound("rest", "baffle", 0.01, "pressure [% of rho g h]") == pytest.approx(0.6)
    assert bound("rest", "plain", 0.01, "mean level [%]") is None


# Cases


def test_water_at_rest(measured):
    found = measured("rest", "spacing=0.01", "time.end=1.5", "output.particles_every=0.25")
    assert found["pressure [% of rho g h]"] < 0.3
    assert found["speed [% of sqrt(g h)]"] < 0.1
    assert abs(found["volume [%]"]) < 0.1


def test_standing_wave(measured):
    found = measured("standing_wave", "spacing=0.02", "time.end=1.2")
    assert abs(found["amplitude [%]"]) < 4.0
    assert abs(found["period [%]"]) < 0.6
    assert abs(found["volume [%]"]) < 0.15


def test_waves_in_a_tank_that_has_stopped_do_not_grow(measured):
    found = measured("stopped_tank", "spacing=0.02", "time.max_step=0.01", "output.particles_every=32")
    assert found["early [mm]"] > 4.0
    assert found["growth [%]"] < 5.0


def test_viscous_flow_between_plates(measured):
    found = measured("spin_up", "spacing=0.005", "time.end=0.1", "output.particles_every=0.1")
    assert found["early [%]"] < 5.0


def test_viscous_drop(measured):
    """With the Laplacian alone, it decays half as fast."""
    found = measured("viscous_drop", "spacing=0.01")
    assert abs(found["decay [%]"]) < 6.0
    assert abs(found["period [%]"]) < 2.5
