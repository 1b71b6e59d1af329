"""The plan of a job tells its particles, steps and stages."""

import math
import time
from pathlib import Path

import pytest

from parmps.domain import Domain
from parmps.errors import InputError
from parmps.expectation import error_class, expected_cost, expected_errors, interpolate, read_table
from parmps.figures.start import draw_plan
from parmps.lattice import build_geometry
from parmps.loader import load_job, parse_job
from parmps.machine import available_memory
from parmps.output import POINT_BYTES, ParticleFile
from parmps.planning import (
    SIGNAL_BYTES,
    TIME_BYTES,
    check_machine,
    disk_estimate,
    estimate_particles,
    needs,
    plan_text,
)
from parmps.probes import build_probes
from parmps.simulation import Simulation
from parmps.tank import count_particles


def test_plan_counts_the_particles_that_a_run_has_and_names_its_stages():
    job = load_job("jobs/sloshing.yaml", ["spacing=0.02"])
    text = plan_text(job, Domain())
    sim = Simulation(job, Domain())
    rows = dict(line.split()[:2] for line in text.splitlines() if line.split()[:1] in (["fluid"], ["total"]))
    assert int(rows["fluid"]) == sim.totals["fluid"] == 480
    assert int(rows["total"]) == sim.totals["total"]
    for stage in (*sim.plan.solve, *sim.plan.move):
        assert stage.name in text
        assert stage.reason in text
    assert "viscosity" in dict(sim.plan.left_out)


def test_the_papers_counts_of_case_1():
    text = plan_text(load_job("jobs/sloshing.yaml", ["scheme=papers"]), Domain())
    assert "12338" in text
    assert str(12338 + 1974) in text


@pytest.mark.parametrize(("depth", "courant"), [(0.1, 0.4), (0.2, 0.2)])
def test_the_plan_knows_the_courant_number_of_a_full_tank(depth, courant):
    text = (
        "dimension: 2\nspacing: 0.01\ntank: {size: [0.4, 0.2]}\ntime: {end: 1.0}\noutput: {probes_every: 0.05}\n"
        f"gravity: 0\nfluids: [{{name: water, depth: {depth}}}]\n"
        "initial: {kind: velocity, fluid: water, value: [1, 0]}\n"
    )
    assert f"cfl: {courant} l0/u" in plan_text(parse_job(text), Domain())


@pytest.mark.parametrize(("depth", "share"), [(0.1, 0.25), (0.2, 0.125)])
def test_the_plan_knows_the_step_at_rest(depth, share):
    text = (
        "dimension: 2\nspacing: 0.01\ntank: {size: [0.4, 0.2]}\ntime: {end: 1.0}\noutput: {probes_every: 0.05}\n"
        f"fluids: [{{name: water, depth: {depth}}}]\n"
    )
    sim = Simulation(parse_job(text), Domain())
    sim.step(1.0)
    sim.choose_step(2.0)
    assert f"{share:g} sqrt(l0/f)" in plan_text(sim.job, Domain())
    assert sim.dt == pytest.approx(share * math.sqrt(0.01 / 9.8), rel=0.05)
    sim.close()


def test_plan_draws_the_start(tmp_path):
    draw_plan(load_job("jobs/sloshing.yaml", ["spacing=0.02"]), tmp_path / "start.png")
    assert (tmp_path / "start.png").stat().st_size > 5000


BAFFLE = "tank.baffles=[{x: 0.4, bottom: 0.0, top: 0.3, thickness: 0.02}]"


@pytest.mark.parametrize("changes", [[], ["fluids[0].depth=0.5"], [BAFFLE]])
def test_the_estimate_for_large_tanks_is_near_the_count(changes):
    job = load_job("jobs/sloshing.yaml", ["spacing=0.004", *changes])
    exact, _ = count_particles(job, "half")
    estimate, _ = estimate_particles(job, 3)
    for name in ("fluid", "wall", "dummy", "total"):
        assert estimate[name] == pytest.approx(exact[name], rel=0.06), name


@pytest.mark.parametrize("baffle", ["ring: 0.1", "bottom: 0, top: 0.477, openings: [[[0.1, 0.1], [0.5, 0.4]]]"])
def test_the_estimate_knows_what_a_baffle_in_3d_leaves_open(baffle):
    counts = []
    for baffles in ("", f"{{x: 0.4, thickness: 0.02, {baffle}}}"):
        tank = f"tank={{size: [0.834, 0.664, 0.477], baffles: [{baffles}]}}"
        job = load_job("jobs/lng_tank.yaml", ["spacing=0.01", tank, "probes=[]"])
        counts.append((count_particles(job, "half")[0]["wall"], estimate_particles(job, 3)[0]["wall"]))
    (exact, estimate), (more, estimate_more) = counts
    assert estimate_more - estimate == pytest.approx(more - exact, rel=0.15)


@pytest.mark.parametrize(
    "tank",
    [
        "{shape: prism, size: [1.0, 0.8], chamfer: {bottom: [0.3, 0.3], top: [0.3, 0.3]}}",
        "{shape: cylinder, size: [0.8, 0.8]}",
    ],
)
def test_the_estimate_knows_what_other_tanks_hold(tank):
    job = load_job("jobs/sloshing.yaml", [f"tank={tank}", "probes=[]"])
    assert estimate_particles(job, 3)[0]["fluid"] == pytest.approx(count_particles(job, "half")[0]["fluid"], rel=0.01)


def test_a_tank_of_any_size_is_planned_at_once():
    start = time.process_time()
    text = plan_text(load_job("jobs/sloshing.yaml", ["spacing=1e-5"]), Domain())
    assert "Particles (an estimate)" in text and "2000000000" in text
    assert time.process_time() - start < 1.0


def test_errors_between_two_runs_follow_their_order_and_beyond_are_those_of_the_nearest():
    points = [(10.0, 8.0), (40.0, 0.5)]  # second order
    assert interpolate(points, 20.0, "rows").value == pytest.approx(2.0)
    assert interpolate(points, 80.0, "rows") == (0.5, "measured with 40 rows")
    assert interpolate(points, 5.0, "rows", slope=1.0) == (4.0, "measured with 10 rows")
    assert [error_class(e) for e in (0.5, 1.0, 29.0, 30.0)] == ["below 1 %", "1 to 3 %", "10 to 30 %", "above 30 %"]


def test_the_plan_tells_what_the_study_measured():
    table, source = read_table()
    job = load_job("jobs/sloshing.yaml", ["spacing=0.01"])
    text = plan_text(job, Domain())
    errors = expected_errors(table, "balanced", 2, 25.0)
    assert {"standing wave", "resonant sloshing", "water at rest"} <= set(errors)
    for scene, error in errors.items():
        line = next(line for line in text.splitlines() if line.startswith(f"  {scene}  "))
        assert error_class(error.value) in line
    assert source in text
    total = sum(1 for line in text.splitlines() if line.startswith("  total"))
    assert total == 1
    cost = expected_cost(table, "balanced", 2, 2500)
    assert math.isfinite(cost.value) and cost.value > 0.0
    assert "ksp_rtol" in plan_text(load_job("jobs/sloshing.yaml", ["scheme.ksp_rtol=1e-6"]), Domain())


def limit(monkeypatch, memory, disk):
    monkeypatch.setattr("parmps.planning.available_memory", lambda: memory)
    monkeypatch.setattr("parmps.planning.free_disk", lambda directory: disk)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (["output.particles_every=3.5e-7"], "output.particles_every: the results take about .* GB of disk"),
        (["output.probes_every=1e-8"], "output.probes_every: the results take about .* probes.csv"),
        (["spacing=2e-5"], "spacing: got 2e-05 m, with which the run takes about .* GB of memory for 2 rank"),
    ],
)
def test_what_exceeds_the_machine_is_refused_at_once(monkeypatch, changes, message):
    limit(monkeypatch, 4e9, 4e9)
    start = time.process_time()
    with pytest.raises(InputError, match=f"{message}.*--force"):
        check_machine(load_job("jobs/sloshing.yaml", changes), 2, 2, "out", 0)
    assert time.process_time() - start < 1.0
    check_machine(load_job("jobs/sloshing.yaml"), 2, 2, "out", 0)


def test_the_plan_says_that_a_run_would_be_refused(monkeypatch):
    job = load_job("jobs/sloshing.yaml")
    limit(monkeypatch, 4e9, 4e9)
    assert "refused" not in plan_text(job, Domain())
    limit(monkeypatch, 1e8, 1e6)
    assert plan_text(job, Domain()).count("refused without --force") == 2


@pytest.mark.parametrize("name", ["particles_every", "probes_every", "checkpoint_every"])
@pytest.mark.parametrize("every", ["1e-300", "3e-12"])
def test_intervals_that_times_cannot_tell_apart_are_refused(name, every):
    with pytest.raises(InputError, match=rf"output.{name}: got .* s, must be at least 3.5e-09 s, 1e-09 of time.end"):
        load_job("jobs/sloshing.yaml", [f"output.{name}={every}"])


def test_the_disk_that_results_take_and_many_frames_take_none_before_they_are_written(tmp_path):
    job = load_job("jobs/sloshing.yaml", ["spacing=0.02"])
    counts, _ = count_particles(job, "half")
    path, frames = tmp_path / "particles.vtkhdf", 36
    ParticleFile.create(path, counts["total"], frames, {})
    frame = counts["total"] * POINT_BYTES
    assert path.stat().st_size == pytest.approx(frames * frame, rel=0.05)
    assert disk_estimate(job, counts)["particles.vtkhdf"] == pytest.approx(frames * frame, rel=0.01)
    ParticleFile.create(path, 1000, 100_000, {})
    assert 512 * path.stat().st_blocks < 3e6 < 6e9 < path.stat().st_size


def test_the_memory_of_placing_is_part_of_what_a_run_needs():
    text = "dimension: 3\nspacing: 0.02\ntank: {{{}}}\nfluids: [{{name: w, fill: 0.5}}]\ntime: {{end: 1}}"
    box = needs(parse_job(text.format("size: [1, 1, 1]")), 64)[0]
    ball = needs(parse_job(text.format("shape: sphere, size: [1, 1, 1]")), 64)[0]
    assert ball - 258e6 > 158e6 > box - 258e6  # as measured for the ball: every rank places all


def test_memory_is_the_least_that_the_system_and_control_groups_leave(monkeypatch, tmp_path):
    group = tmp_path / "memory" / "jobs" / "mine"
    group.mkdir(parents=True)
    for place, most in ((group, 3_000_000_000), (group.parent, 2_000_000_000)):
        (place / "memory.limit_in_bytes").write_text(f"{most}\n")
        (place / "memory.usage_in_bytes").write_text("1500000000\n")
        (place / "memory.stat").write_text("cache 5\ntotal_inactive_file 400000000\n")
    monkeypatch.setattr("parmps.machine.CGROUPS", tmp_path)
    read = {"/proc/meminfo": "MemAvailable: 8000000 kB\n", "/proc/self/cgroup": "4:memory:/jobs/mine\n"}
    real = Path.read_text
    monkeypatch.setattr(Path, "read_text", lambda path: read.get(str(path)) or real(path))
    assert available_memory() == 900_000_000
    read["/proc/self/cgroup"] = "4:memory:/elsewhere\n0::/\n"
    assert available_memory() == 8_192_000_000
def test_plan_tells_the_greatest_of_every_motion(tmp_path):
    times = [k / 200 for k in range(401)]
    rows = "".join(f"{t:.3f},{0.01 * math.sin(4.5 * t):.4f}\n" for t in times)
    (tmp_path / "motion.csv").write_text("time [s],surge [m]\n" + rows)
    text = (
        "dimension: 2\nspacing: 0.05\ntank: {size: [1.0, 0.6]}\ntime: {end: 2.0}\nfluids: [{name: water, depth: 0.3}]\n"
        f"motion: [{{kind: roll, amplitude_deg: 4, period: 2}}, {{kind: file, path: {tmp_path}/motion.csv}}]\n"
    )
    lines = plan_text(parse_job(text), Domain()).splitlines()
    roll, surge = (next(line.split() for line in lines if name in line) for name in ("[0] roll", "[1] surge"))
    assert roll[2:6] == ["4", "deg", "12.57", "deg/s"]
    acceleration = 4 * math.pi**2
    assert roll[6:8] == [f"{acceleration:.4g}", "deg/s2,"]
    felt = math.hypot(0.5, 0.6) * math.radians(acceleration) / 9.80665
    assert float(roll[8]) == pytest.approx(felt, rel=0.02) and roll[9] == "g"
    assert surge[3] == "m" and surge[5] == "m/s" and surge[7] == "g"
    assert float(surge[2]) == pytest.approx(0.01, abs=5e-5)
    assert float(surge[4]) == pytest.approx(0.045, rel=0.02)
    assert float(surge[6]) == pytest.approx(0.01 * 4.5**2 / 9.80665, rel=0.05)
    assert "recorded in steps of 0.0001 m" in " ".join(surge)


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_table_of_probes_is_as_wide_as_was_planned(dimension):
    """Loads of the tank, its baffles and all, highest values beside the means, and what a liquid's probe tells."""
    flat = dimension == 2
    corners = [[0.0, 0.0], [0.0, 0.1]] if flat else [[0.0, 0.0, 0.0], [0.0, 0.1, 0.1]]
    job = parse_job(
        f"dimension: {dimension}\nspacing: 0.02\n"
        f"tank: {{size: {[0.4, 0.2] if flat else [0.4, 0.2, 0.2]}, "
        "baffles: [{x: 0.2, bottom: 0.0, top: 0.06, thickness: 0.04}]}\n"
        "fluids: [{name: water, depth: 0.1}]\ntime: {end: 1.0}\noutput: {probes_every: 1.0}\n"
        f"probes: [{{name: load, kind: force}}, {{name: P, kind: pressure, at: {corners[0]}}}, "
        f"{{name: wall, kind: panel, corners: {corners}}}, {{name: level, kind: elevation, at: {corners[0][:-1]}}}, "
        "{name: all, kind: liquid, fluid: water}]\n",
        (),
    )
    geometry = build_geometry(job, job.scheme.wall, 3)
    columns = sum(len(probe.columns) for probe in build_probes(job, geometry))
    size = disk_estimate(job, {"total": 1, "wall": 0, "dummy": 0})["probes.csv"]
    assert size == 2 * (TIME_BYTES + SIGNAL_BYTES * columns)
