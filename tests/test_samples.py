"""Samples: means over the interval around them, however they are taken, stopped and restarted."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from test_cli import read_table

from parmps.domain import Domain
from parmps.errors import DivergedError, InputError, StoppedError
from parmps.interrupt import WALL_LIMIT
from parmps.loader import parse_job
from parmps.probes import build_probes
from parmps.run import Run, Schedule
from parmps.samples import Samples
from parmps.signals import read_signals
from parmps.simulation import Simulation

DAM = """
dimension: 2
spacing: 0.02
tank: {size: [0.8, 0.5]}
fluids: [{name: water, region: {box: [[0.0, 0.0], [0.2, 0.3]]}}]
time: {end: 0.6, max_step: 2.0e-3}
probes: [{name: P, kind: pressure, at: [0.8, 0.02]}, {name: load, kind: force}, {name: eta, kind: elevation, at: [0.7]}]
output: {particles_every: 10.0, checkpoint_every: 10.0, probes_every: 0.02}
"""


class Known:
    """A load whose one sum is its value."""

    columns, on_wall, peaks, signals, sums = {"k [Pa]": "", "k.max [Pa]": ""}, False, True, 1, 1

    def partial(self, particles, density, out):
        out[:] = particles.value

    def values(self, sums, frames):
        return sums


def sampled(times, values, every, end, restart=None):
    """Rows of a known load, restarted after so many steps."""
    schedule = Schedule(every, end)
    frame = SimpleNamespace(force=np.zeros(3), omega=np.zeros(3), alpha=np.zeros(3), rotation=np.eye(3))
    walls = {"position": np.zeros((0, 3)), "normal": np.zeros((0, 3)), "depth": np.zeros(0)}
    fields = {"pressure": np.zeros(0), "fluid": np.zeros(0, np.int8), "liquid": 0, "rows": 0}

    def make():
        return Samples([Known()], Domain(), SimpleNamespace(**walls, **fields), schedule, False)

    samples, rows = make(), []
    for step, (time, value) in enumerate(zip(times, values, strict=True)):
        particles = SimpleNamespace(**walls, **fields, value=value)
        samples.step(time, particles, np.array([1000.0]), frame, None)
        if schedule.due(time):
            rows += samples.take(time, None)
        if step == restart:
            samples.flush()
            text = json.dumps(samples.state())
            samples = make()
            samples.restore(json.loads(text))
    return np.array([[time, *row] for time, row in rows + samples.rows()])


def test_a_mean_is_that_of_the_steps_nearest_to_the_sample():
    times = np.arange(101) / 100
    values = np.cos(3.0 * times)
    rows = sampled(times, values, 0.1, 1.0)
    np.testing.assert_allclose(rows[:, 0], np.arange(11) * 0.1)
    inner = rows[1:-1]
    # the mean of a cosine over an interval of 0.1 around t, by trapezoids of 0.01
    exact = np.cos(3.0 * inner[:, 0]) * np.sin(0.15) / 0.15
    np.testing.assert_allclose(inner[:, 1], exact, rtol=2e-4, atol=1e-5)
    for time, _, highest in rows:
        assert highest == values[np.abs(times - time) < 0.05 + 1e-9].max()
    every_step = sampled(times, values, 0.01, 1.0)
    np.testing.assert_allclose(every_step[:, 1], values, rtol=1e-12)
    np.testing.assert_allclose(every_step[:, 2], values, rtol=1e-12)
    constant = sampled(times, np.full(101, 7.0), 0.1, 1.0)
    np.testing.assert_allclose(constant[:, 1:], 7.0, rtol=1e-12)


@pytest.mark.parametrize("every", [0.013, 0.05, 0.3, 5.0])
def test_an_impulse_does_not_depend_on_the_interval(every):
    """Steps of any length, which end at the samples as those of a run do."""
    rng = np.random.default_rng(5)
    schedule, times = Schedule(every, 1.0), [0.0]
    while times[-1] < 1.0:
        times.append(min(times[-1] + rng.uniform(0.001, 0.02), schedule.after(times[-1])))
    times = np.array(times)
    values = np.exp(-(((times - 0.4) / 0.02) ** 2)) + rng.random(len(times))
    rows = sampled(times, values, every, 1.0)
    assert np.trapz(rows[:, 1], rows[:, 0]) == pytest.approx(np.trapz(values, times), rel=1e-12)
    assert rows[:, 2].max() == values.max() and (rows[:, 2] >= rows[:, 1] * (1.0 - 1e-12)).all()
    for restart in (0, 7, len(times) - 2):
        np.testing.assert_array_equal(sampled(times, values, every, 1.0, restart), rows)


def run(directory, overrides=(), text=DAM, interrupt=None, restart=None):
    job = parse_job(text, list(overrides))
    this = Run(job, Domain(), directory, restart, interrupt)
    try:
        this.go()
    finally:
        this.close()
    return read_table(directory / "probes.csv")


def test_the_impulse_of_an_impact_sampled_every_20_ms_is_that_of_all_steps(tmp_path):
    _, coarse = run(tmp_path / "coarse")
    titles, fine = run(tmp_path / "fine", ["output.probes_every=0.002"])
    assert len(fine) == 301 and len(coarse) == 31
    for column, title in enumerate(titles):
        if title.startswith(("P [", "load.")):
            whole, part = (np.trapz(rows[:, column], rows[:, 0]) for rows in (fine, coarse))
            scale = np.trapz(np.abs(fine[:, column]), fine[:, 0])
            assert part == pytest.approx(whole, abs=1e-6 * scale), title
        elif title.startswith("eta"):
            np.testing.assert_array_equal(coarse[:, column], fine[::10, column])
    highest = titles.index("P.max [Pa]")
    assert coarse[:, highest].max() == pytest.approx(fine[:, 1].max(), rel=1e-6)
    assert coarse[:, highest].max() > 1.05 * coarse[:, 1].max()  # or nothing was lost between samples


def test_a_run_that_is_stopped_keeps_its_last_sample_and_goes_on_as_if_it_had_not(tmp_path):
    """On one rank; stopped between samples and at one, its rows are those of a run that was not."""
    short = ["time.end=0.1", "scheme.ksp_rtol=1e-12"]  # after a checkpoint, the solver does not know its past
    _, whole = run(tmp_path / "whole", short)
    for steps in (4, 23, 30):
        place = tmp_path / str(steps)
        asked = iter([0] * steps + [WALL_LIMIT] * 1000)
        with pytest.raises(StoppedError):
            run(place, short, interrupt=SimpleNamespace(request=lambda asked=asked: next(asked)))
        _, part = read_table(place / "probes.csv")
        np.testing.assert_allclose(part[:, 0], np.arange(-(-steps // 10)) * 0.02)
        np.testing.assert_array_equal(part[:-1], whole[: len(part) - 1])
        if steps == 23:  # elsewhere, rows begin with the first sample to come
            _, rows = run(tmp_path / "elsewhere", short, restart=place)
            np.testing.assert_allclose(rows, whole[3:], rtol=1e-7, atol=1e-6)
        _, rows = run(place, short, restart=place)
        np.testing.assert_allclose(rows, whole, rtol=1e-7, atol=1e-6)


def test_a_run_that_diverges_keeps_its_last_sample_and_goes_on_from_it(tmp_path):
    short = ["time.end=0.1", "scheme.ksp_rtol=1e-12"]
    _, whole = run(tmp_path / "whole", short)
    with pytest.MonkeyPatch.context() as patch, pytest.raises(DivergedError):
        patch.setattr(Simulation, "move", diverging(Simulation.move, 34))
        run(tmp_path / "run", short)
    _, part = read_table(tmp_path / "run" / "probes.csv")
    np.testing.assert_array_equal(part[:-1], whole[:3])
    assert part[-1, 0] == 0.06
    _, rows = run(tmp_path / "run", short, restart=tmp_path / "run")
    np.testing.assert_allclose(rows, whole, rtol=1e-4, atol=1e-3)  # from a state that was solved once more


def diverging(move, last):
    def wrong(self):
        move(self)
        if self.step_number == last:
            self.particles.velocity[0] = np.nan

    return wrong


SMALL = """
dimension: 2
spacing: 0.02
tank: {size: [0.4, 0.3]}
fluids: [{name: water, depth: 0.16}]
time: {end: 0.02}
output: {particles_every: 10.0, checkpoint_every: 10.0, probes_every: 0.01}
"""


def test_a_baffle_at_rest_carries_its_buoyancy_and_all_together_the_weight(tmp_path):
    baffle = "tank.baffles=[{name: post, x: 0.2, bottom: 0.0, top: 0.1, thickness: 0.04}]"
    tip = "{name: tip, kind: pressure, at: [0.2, 0.1], radius: 0.001}"
    run(tmp_path, [baffle, f"probes=[{{name: load, kind: force}}, {tip}]", "time.end=0.1", "gravity=9.8"], SMALL)
    _, signals = read_signals(tmp_path / "probes.csv")
    last = {name: values[-1] for name, _, values in signals}
    weight = 9800.0 * (0.4 * 0.16 - 0.04 * 0.1)
    assert last["load.Fz"] == pytest.approx(-weight, rel=0.01)
    assert last["load.post.Fz"] == pytest.approx(-9800.0 * 0.06 * 0.04, rel=0.01)
    assert last["load.tank.Fz"] + last["load.post.Fz"] == pytest.approx(last["load.Fz"], rel=1e-9)
    assert last["tip"] == pytest.approx(9800.0 * 0.06, rel=0.01)  # though no particle is within its radius
    columns = json.loads((tmp_path / "run.json").read_text())["columns"]
    with (tmp_path / "probes.csv").open() as file:
        assert list(columns) == file.readline().strip().split(",")[1:]
    meaning = columns["load.post.My [N m/m]"]
    assert all(word in meaning for word in ("post", "[0.2, 0.0] m", "z to x", "axes of the tank"))


def test_a_wall_without_particles_near_the_probe_is_refused():
    job = parse_job(SMALL, ["probes=[{name: P, kind: pressure, at: [0.0, 0.1]}]"])
    simulation = Simulation(job, Domain())
    probe = build_probes(job, simulation.geometry)[0]
    message = r"probes\[0\].at: the wall there is too small .* 0.05 m away, must be at most 0.04"
    with pytest.raises(InputError, match=message):
        probe.settle(0.05)


@pytest.mark.parametrize("fixed_to", ["tank", "earth"])
@pytest.mark.parametrize("tank", ["{size: [0.4, 0.2]}", "{shape: cylinder, size: [0.4, 0.4]}"])
def test_a_gauge_ends_at_the_lid(tank, fixed_to):
    """Liquid that fills the tank, a third of a spacing too high."""
    gauges = ", ".join(
        f"{{name: g{n}, kind: elevation, at: [{x}], fixed_to: {fixed_to}}}" for n, x in enumerate((0.02, 0.1, 0.2))
    )
    job = parse_job(SMALL, [f"tank={tank}", "fluids=[{name: water, fill: 1.0}]", f"probes=[{gauges}]"])
    simulation = Simulation(job, Domain())
    p = simulation.particles
    p.position[: p.liquid] += [0.0, 0.0, 0.007]
    state = SimpleNamespace(
        position=p.position, kind=p.kind, surface=np.ones(len(p), np.int8), frame=simulation.frame
    )
    for x, gauge in zip((0.02, 0.1, 0.2), build_probes(job, simulation.geometry), strict=True):
        found = gauge.value(gauge.partial(state))[0]
        lid = 0.2 if "cylinder" not in tank else 0.2 + np.sqrt(0.04 - (x - 0.2) ** 2)
        assert lid - 0.02 < found <= lid + 1e-6


@pytest.mark.parametrize("scheme", ["papers", "balanced"])
def test_the_force_of_viscous_liquid_at_rest_is_measured_from_the_first_step_on(tmp_path, scheme):
    probes = "probes=[{name: load, kind: force}]"
    water = "fluids=[{name: water, depth: 0.16, kinematic_viscosity: 1.0e-3}]"
    _, rows = run(tmp_path, [f"scheme={scheme}", probes, water], SMALL)
    np.testing.assert_allclose(rows[1:, 2], -9800.0 * 0.4 * 0.16, rtol=0.05)
