"""The ledger of the liquid's energy."""

import json

import numpy as np
import pytest

from parmps import energy, stages
from parmps.domain import Domain
from parmps.energy import ACCOUNTS, STAGES, Ledger
from parmps.errors import BeyondLimits
from parmps.loader import parse_job
from parmps.run import Run

TANK = "dimension: 2\nspacing: 0.02\ntime: {end: 0.2}\ntank: {size: [0.4, 0.3]}\n"
COLUMN = "fluids: [{name: water, region: {box: [[0, 0], [0.2, 0.2]]}}]\n"
SCENES = {
    "dam break": TANK + COLUMN,
    "papers": TANK + COLUMN + "scheme: papers\n",
    "viscous": TANK + "fluids: [{name: oil, kinematic_viscosity: 0.01, region: {box: [[0, 0], [0.2, 0.2]]}}]\n",
    "layers": TANK + "fluids: [{name: salt, density: 1200, depth: 0.1}, {name: oil, density: 800, depth: 0.1}]\n"
    "motion: [{kind: surge, amplitude: 0.02, omega: 8}]\n",
    "roll": TANK + "fluids: [{name: water, depth: 0.12}]\nmotion: [{kind: pitch, amplitude_deg: 10, omega: 8}]\n",
    "papers with tension": TANK
    + "fluids: [{name: salt, density: 1200, depth: 0.1}, {name: oil, density: 800, depth: 0.1}]\n"
    "interfaces: [{between: [salt, oil], surface_tension: 0.03}]\nscheme: papers\n",
}


def march(sim, time):
    while sim.time < time:
        sim.step(time)
    sim.note_energy()


@pytest.mark.parametrize("text", SCENES.values(), ids=SCENES)
def test_the_stages_give_what_kinetic_energy_rises_by_beyond_the_work(start, text):
    sim = start(text)
    sim.start()
    march(sim, 0.1)
    assert sim.kinetic_energy() > 0.0
    net = sim.ledger.totals[:-1].sum()
    rise = sim.kinetic_energy() - sim.initial_energy - sim.work_done()
    assert net == pytest.approx(rise, abs=1e-11 * sim.energy_scale)
    record = sim.ledger.summary(
        sim.kinetic_energy() - sim.initial_energy, sim.potential_energy() - sim.initial_potential
    )
    assert record["kinetic"] + record["potential"] == pytest.approx(
        record["work"] + record["gained"] - record["dissipated"], abs=1e-9 * sim.energy_scale
    )
    if "motion" not in text:  # a tank at rest does no work
        assert record["work"] == pytest.approx(0.0, abs=1e-9 * sim.energy_scale)


def test_what_falls_freely_loses_what_the_method_takes_and_gains_nothing(start):
    """Symplectic Euler: kinetic energy rises by m g^2 dt^2 / 2 a step less than the work along the way."""
    sim = start(
        "dimension: 2\nspacing: 0.02\ntime: {end: 1, max_step: 0.002}\ntank: {size: [0.4, 0.6]}\n"
        "fluids: [{name: water, region: {box: [[0.1, 0.4], [0.3, 0.5]]}}]\n"
    )
    march(sim, 0.1)
    mass = sim.particle_mass[0] * sim.totals["fluid"]
    lost = 0.5 * mass * 9.81**2 * 0.002**2 * sim.step_number
    assert sim.ledger.totals[:-1].sum() == pytest.approx(-lost, rel=0.02)
    assert sim.ledger.gained_most < 1e-5


def test_gains_do_not_hide_behind_losses():
    ledger, domain = Ledger(np.ones(1), np.ones(1)), Domain()
    for time in range(1, 11):
        ledger.book("shifting", 1.0 if time <= 6 else -1.0)
        ledger.book("damping", -5.0)
        ledger.book("pressure", -2.0 if time <= 3 else 1.0)
        ledger.settle(domain)
        ledger.note(float(time), 100.0, 0.0)
    # shifting is 2 above its least at the end and was 6 at time 6; pressure has risen by 7 since its least, at time 3
    assert ledger.gains[ACCOUNTS.index("shifting")] == 2.0
    assert ledger.gains[ACCOUNTS.index("pressure")] == 7.0
    assert ledger.gained_most == pytest.approx(0.09)
    assert ledger.worst == {"stage": "shifting", "time": 6.0}
    record = ledger.summary(0.0, 0.0)
    assert record["gained"] == 9.0 and record["dissipated"] == 9.0 - (2.0 - 50.0 + 1.0)
    (said,) = ledger.warnings()
    assert "9.0% of the liquid's at t = 6 s, most of it by shifting" in said
    assert "by damping" in ledger.account() and "2.0% by shifting" in ledger.account()
    state = json.loads(json.dumps(ledger.state))
    again = Ledger(np.ones(1), np.ones(1))
    again.state = state
    assert again.state == ledger.state and len(again.totals) == len(STAGES) + 1


def test_what_surfaces_under_tension_may_give_is_no_gain():
    ledger = Ledger(np.ones(1), np.ones(1))
    ledger.book("pressure", 3.0)
    ledger.settle(Domain())
    ledger.note(1.0, 1.0, 4.0)
    assert ledger.gained_most == 0.0


def test_volume_beyond_its_limit_is_told_with_its_time():
    ledger = Ledger(np.ones(1), np.ones(1))
    for time, drift in ((1.0, 0.01), (2.0, -0.07), (3.0, 0.02)):
        ledger.note_volume(time, drift)
    (said,) = ledger.warnings()
    assert "-7.0% at t = 2 s" in said


def run(text, directory):
    domain = Domain()
    job = parse_job(f"{text}output: {{probes_every: 0.02}}\n")
    one = Run(job, domain, directory)
    try:
        one.go()
    finally:
        one.close()
    return json.loads((directory / "run.json").read_text()), (directory / "run.log").read_text()


def test_a_sound_run_is_within_its_limits_and_says_what_went_to_heat(tmp_path):
    record, log = run(SCENES["dam break"], tmp_path / "out")
    assert record["status"] == "done" and record["warnings"] == []
    assert set(record["energy"]) >= {"work", "kinetic", "potential", "dissipated", "gained", "gained_most"}
    assert record["energy"]["dissipated"] > 0.0 and 0.0 <= record["energy"]["gained_most"] < 0.02
    assert abs(record["volume_most"]) < 0.02 and record["put_back"] == record["put_back_from_walls"]
    assert "went to heat" in log and "came from nowhere" in log and "warning" not in log


def test_a_pressure_that_gives_energy_ends_with_status_6_and_keeps_the_results(tmp_path, monkeypatch):
    right = stages.gradient.corrected_gradient

    def too_strong(*arguments):
        right(*arguments)
        arguments[13][:] *= 1.2  # what acts on the particles is not what the pressure equation was solved for

    monkeypatch.setattr(stages.gradient, "corrected_gradient", too_strong)
    with pytest.raises(BeyondLimits, match="by pressure") as end:
        run(SCENES["roll"], tmp_path / "out")
    assert end.value.exit_status == 6
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert record["status"] == "done" and "by pressure" in record["warnings"][0]
    assert record["energy"]["gained_most"] > energy.GAINED_LIMIT
