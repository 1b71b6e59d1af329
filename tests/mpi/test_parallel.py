"""The same liquid on any number of ranks: ownership, halo, operators, and whole runs with migration."""

import functools

import numpy as np
import pytest
from mpi4py import MPI
from scipy.spatial import cKDTree

from parmps.domain import Domain
from parmps.loader import parse_job
from parmps.loads import Loads
from parmps.neighbors import Pairs
from parmps.particles import DUMMY, FIELDS, FLUID, WALL, Particles
from parmps.probes import build_probes
from parmps.simulation import BALANCE_EVERY, DISTRIBUTION_STEPS, HALO_COST, Simulation
from parmps.stages import pressure_gradient, wall_friction

JOB = """
dimension: 2
spacing: 0.02
tank: {size: [0.4, 0.3]}
fluids: [{name: water, depth: 0.15, kinematic_viscosity: 1.0e-4}]
motion:
  - {kind: surge, amplitude: 0.02, omega: 7.0}
  - {kind: roll, amplitude_deg: 4, omega: 6.0, centre: [0.2, 0.1]}
time: {end: 1.0, max_step: 2.0e-3}
scheme: {ksp_rtol: 1.0e-12}
"""


def cloud(comm, count, dimension, seed=0):
    """Some random particles of all kinds on each rank, with something in every field."""
    rng = np.random.default_rng([seed, comm.rank])
    mine = count // comm.size + (comm.rank < count % comm.size)
    first = comm.exscan(mine) or 0
    arrays = {}
    for name, (dtype, shape) in FIELDS.items():
        values = (
            rng.normal(size=(mine, *shape)) if dtype is np.float64 else rng.integers(0, 100, (mine, *shape))
        )
        arrays[name] = values.astype(dtype)
    arrays["id"] = first + np.arange(mine)
    arrays["kind"] = rng.choice([FLUID, FLUID, WALL, DUMMY], mine).astype(np.int8)
    arrays["position"] = rng.random((mine, 3)) * [2.0, 0.0 if dimension == 2 else 1.0, 1.0]
    return Particles(arrays)


def everyone(comm, particles):
    """Fields of the owned particles of all ranks, in the order of their ids."""
    parts = comm.allgather(particles.arrays())
    arrays = {name: np.concatenate([part[name] for part in parts]) for name in FIELDS}
    order = np.argsort(arrays["id"], kind="stable")
    return {name: values[order] for name, values in arrays.items()}


@pytest.mark.parametrize("dimension", [2, 3])
def test_distribution_keeps_every_particle_with_all_its_fields(comm, dimension):
    before = cloud(comm, 2000, dimension)
    expected = everyone(comm, before)
    domain = Domain(comm)
    for _ in range(2):
        after = domain.distribute(before, np.ones(before.owned), 0.1)
        got = everyone(comm, after)
        for name in FIELDS:
            np.testing.assert_array_equal(got[name], expected[name], err_msg=name)
            assert getattr(after, name).dtype == FIELDS[name][0]
        assert np.all(np.diff(after.kind) >= 0)
        assert after.liquid == np.sum(after.kind == FLUID)
        assert after.rows == after.liquid + np.sum(after.kind == WALL)
        before = after


@pytest.mark.parametrize("dimension", [2, 3])
def test_bisection_balances_the_cost(comm, dimension):
    particles = cloud(comm, 4000, dimension)
    weight = np.where(particles.position[:, 0] < 0.5, 3.0, 1.0)
    after = Domain(comm).distribute(particles, weight, 0.1)
    cost = comm.allgather(float(np.where(after.position[:, 0] < 0.5, 3.0, 1.0).sum()))
    assert max(cost) - min(cost) <= 6.0 * comm.size
    corners = np.array([after.position.min(axis=0), after.position.max(axis=0)])
    boxes = np.array(comm.allgather(corners))
    overlap = np.minimum(boxes[:, None, 1], boxes[None, :, 1]) - np.maximum(
        boxes[:, None, 0], boxes[None, :, 0]
    )
    overlap = overlap[:, :, [0, 2] if dimension == 2 else [0, 1, 2]]
    area = np.prod(np.maximum(overlap, 0.0), axis=2)
    np.fill_diagonal(area, 0.0)
    assert area.max() < 1e-3


def test_equal_places_are_divided_along_another_axis(comm):
    """A lattice has many particles in the same column: a cut along it must still balance."""
    x, z = np.meshgrid(np.arange(20.0), np.arange(15.0))
    count = x.size
    position = np.column_stack([x.ravel(), np.zeros(count), z.ravel()])
    mine = slice(comm.rank, None, comm.size)
    particles = Particles({"id": np.arange(count)[mine], "position": position[mine]})
    after = Domain(comm).distribute(particles, np.ones(particles.owned), 2.0)
    counts = comm.allgather(after.owned)
    assert sum(counts) == count
    assert max(counts) - min(counts) <= 2


@pytest.mark.parametrize("dimension", [2, 3])
def test_halo_holds_all_within_its_width(comm, dimension):
    domain, width = Domain(comm), 0.15
    particles = cloud(comm, 1200, dimension)
    particles = domain.distribute(particles, np.ones(particles.owned), 0.1)
    everything = everyone(comm, particles)
    domain.build_halo(particles, width)
    halo = slice(particles.owned, len(particles))
    assert domain.halo == len(particles) - particles.owned
    assert len(np.unique(particles.id)) == len(particles)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(particles, name), everything[name][particles.id], err_msg=name)
    own = particles.position[: particles.owned]
    gap = np.linalg.norm(everything["position"][:, None] - own[None], axis=2).min(axis=1, initial=np.inf)
    missing = np.setdiff1d(np.flatnonzero(gap < width), particles.id)
    assert len(missing) == 0
    # exchange of any number of arrays of any type
    flag = np.zeros(len(particles), np.int8)
    vector = np.zeros((len(particles), 3))
    number = np.zeros(len(particles), np.int64)
    for round_ in range(3):
        flag[: particles.owned] = (particles.id[: particles.owned] + round_) % 5
        vector[: particles.owned] = own * (round_ + 1)
        number[: particles.owned] = particles.id[: particles.owned] * 7 - round_
        flag[halo], vector[halo], number[halo] = -1, np.nan, -1
        domain.exchange(flag, vector, number)
        np.testing.assert_array_equal(flag, (particles.id + round_) % 5)
        np.testing.assert_array_equal(vector, particles.position * (round_ + 1))
        np.testing.assert_array_equal(number, particles.id * 7 - round_)
        domain.exchange(number)


@pytest.mark.parametrize("dimension", [2, 3])
def test_halo_is_stale_once_it_lacks_a_particle(comm, dimension):
    domain, reach, margin = Domain(comm), 0.1, 0.05
    particles = cloud(comm, 1200, dimension)
    particles = domain.distribute(particles, np.ones(particles.owned), 0.1)
    owned = particles.owned
    drift = np.random.default_rng(comm.rank).normal(size=(owned, 3)) * [0.004, 0.0 if dimension == 2 else 0.004, 0.004]
    domain.build_halo(particles, reach + margin)
    for _ in range(40 if comm.size > 1 else 1):
        particles.position[:owned] += drift
        domain.exchange(particles.position)
        everything = everyone(comm, particles)["position"]
        gap = cKDTree(particles.position[:owned]).query(everything)[0]
        lacking = comm.allreduce(len(np.setdiff1d(np.flatnonzero(gap < reach), particles.id)))
        stale = domain.halo_is_stale(particles, reach)
        assert stale or not lacking
        if stale:
            break
    assert stale == (comm.size > 1)
    if comm.size > 1:
        particles.resize(owned)
        domain.build_halo(particles, reach + margin)
        assert not domain.halo_is_stale(particles, reach)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_ranks_without_particles(comm, count):
    domain = Domain(comm)
    particles = cloud(comm, count, 2)
    particles.kind[:] = FLUID
    particles = domain.distribute(particles, np.ones(particles.owned), 0.1)
    assert comm.allreduce(particles.owned) == count
    domain.build_halo(particles, 10.0)
    expected = 0 if particles.owned == 0 else count
    assert len(particles) == expected
    value = particles.id.astype(float)
    value[particles.owned :] = -1.0
    domain.exchange(value)
    np.testing.assert_array_equal(value, particles.id)
    pairs = Pairs(10.0, np.empty((0, 2, 3)))
    pairs.find(particles)
    assert comm.allreduce(pairs.count) == count * (count - 1)


def test_sums_over_the_ranks(comm):
    domain = Domain(comm)
    ranks = np.arange(comm.size)
    assert domain.sum(float(comm.rank)) == ranks.sum()
    np.testing.assert_array_equal(domain.max(np.array([comm.rank, -comm.rank])), [comm.size - 1, 0])
    np.testing.assert_array_equal(domain.min(np.array([comm.rank, -comm.rank])), [0, 1 - comm.size])
    assert domain.first_of(3) == 3 * comm.rank
    assert domain.gather(comm.rank) == ranks.tolist()
    assert domain.share(comm.rank) == 0


# Simulations


def simulation(comm, text=JOB, *overrides):
    return Simulation(parse_job(text, overrides), Domain(comm))


def fields_of(comm, sim):
    p, w = sim.particles, sim.work
    own = {name: getattr(p, name)[: p.owned] for name in ("id", "kind", "position", "velocity", "pressure")}
    own["surface"] = w.surface[: p.owned]
    own["asymmetry"], own["gradient"] = w.asymmetry[: p.owned], w.gradient[: p.owned]
    parts = comm.allgather(own)
    arrays = {name: np.concatenate([part[name] for part in parts]) for name in own}
    order = np.argsort(arrays["id"])
    return {name: values[order] for name, values in arrays.items()}


class Restless(Domain):
    """Favours the left and the right half of the tank in turn, so that particles migrate each time."""

    rounds = 0

    def distribute(self, particles, weight, cell):
        self.rounds += 1
        turn = (self.rounds + 1) // 2 % 2  # it takes two rounds: to know the costs, and to share them
        favoured = (particles.position[: particles.owned, 0] < 0.2) == turn
        return super().distribute(particles, np.where(favoured, 5.0, 1.0) * weight, cell)


def march(comm, steps, redistribute, *overrides):
    sim = Simulation(parse_job(JOB, overrides), Restless(comm) if redistribute else Domain(comm))
    moved = 0
    for number in range(steps):
        if redistribute and number and number % 10 == 0:
            before = sim.particles.id[: sim.particles.owned].copy()
            sim.distribute()
            moved += len(np.setdiff1d(sim.particles.id[: sim.particles.owned], before))
        sim.step(1.0)
    result = fields_of(comm, sim)
    result["migrated"] = comm.allreduce(moved)
    result["time"], result["l0"], result["energy"] = sim.time, sim.l0, sim.kinetic_energy()
    result["work"] = sim.work_done()
    liquid = result["kind"] == FLUID
    result["momentum"] = sim.particle_mass[0] * result["velocity"][liquid].sum(axis=0)
    p = sim.particles
    partial = sim.particle_mass[0] * p.velocity[: p.liquid].sum(axis=0)
    result["momentum of the ranks"] = sim.domain.sum(partial)
    result["mass"] = sim.particle_mass[0] * sim.domain.sum(p.liquid)
    sim.close()
    return result


@functools.cache
def alone(steps, *overrides):
    """The same job on one rank: every rank does it for itself."""
    return march(MPI.COMM_SELF, steps, False, *overrides)


@pytest.mark.parametrize("redistribute", [False, True])
def test_positions_do_not_depend_on_the_number_of_ranks(comm, redistribute):
    one, many = alone(50), march(comm, 50, redistribute)
    assert many["time"] == pytest.approx(one["time"], rel=1e-13)
    np.testing.assert_array_equal(many["id"], np.arange(len(one["id"])))
    np.testing.assert_array_equal(many["kind"], one["kind"])
    assert np.abs(many["position"] - one["position"]).max() < 1e-8 * one["l0"]
    assert np.abs(many["velocity"] - one["velocity"]).max() < 1e-7
    assert np.abs(many["pressure"] - one["pressure"]).max() < 1e-6 * 1500.0
    np.testing.assert_array_equal(many["surface"], one["surface"])
    assert many["mass"] == pytest.approx(one["mass"], rel=1e-14)
    scale = np.abs(one["velocity"]).sum() * one["mass"] / np.sum(one["kind"] == FLUID)
    np.testing.assert_allclose(many["momentum of the ranks"], many["momentum"], atol=1e-14 * scale)
    np.testing.assert_allclose(many["momentum"], one["momentum"], atol=1e-8 * scale)
    assert many["energy"] == pytest.approx(one["energy"], rel=1e-7)
    assert many["work"] == pytest.approx(one["work"], rel=1e-7)
    if redistribute and comm.size > 1:
        assert many["migrated"] > 300


LAYERS = ", ".join(
    f"{{name: {name}, depth: 0.06, density: {rho}, kinematic_viscosity: 1.0e-4}}"
    for name, rho in (("a", 1300), ("b", 1000), ("c", 500))
)
TENSE_LAYERS = (
    f"fluids=[{LAYERS}]",
    "interfaces=[{between: [a, b], surface_tension: 0.5}, {between: [b, c], surface_tension: 0.1}]",
)


@pytest.mark.parametrize("liquids", [(), TENSE_LAYERS])
def test_papers_scheme_does_not_depend_on_the_number_of_ranks(comm, liquids):
    """Short and from rest: the printed scheme magnifies rounding, and a jolt ends it at this step."""
    more = ("scheme.preset=papers", "motion=[]", *liquids)
    one, many = alone(10, *more), march(comm, 10, True, *more)
    assert np.abs(many["position"] - one["position"]).max() < 1e-8 * one["l0"]
    assert np.abs(many["pressure"] - one["pressure"]).max() < 1e-6 * 1500.0


def test_implicit_viscosity_does_not_depend_on_the_number_of_ranks(comm):
    more = ("fluids[0].kinematic_viscosity=1.0",)
    one, many = alone(10, *more), march(comm, 10, True, *more)
    assert np.abs(many["position"] - one["position"]).max() < 1e-8 * one["l0"]
    assert np.abs(many["velocity"] - one["velocity"]).max() < 1e-7


def test_three_dimensions_do_not_depend_on_the_number_of_ranks(comm):
    more = (
        "dimension=3",
        "tank.size=[0.2, 0.12, 0.2]",
        "fluids[0].depth=0.1",
        "motion[1].centre=[0.1, 0.06, 0.1]",
    )
    one, many = alone(5, *more), march(comm, 5, True, *more)
    assert np.abs(many["position"] - one["position"]).max() < 1e-8 * one["l0"]
    assert np.abs(many["pressure"] - one["pressure"]).max() < 1e-6 * 1500.0


def test_operators_are_the_same_next_to_another_rank(comm):
    """One step on moved particles: each operator's result, the values of halo particles included."""
    rng = np.random.default_rng(8)

    def fields(communicator, shake):
        sim = simulation(communicator)
        p = sim.particles
        own = p.kind[: p.owned] == FLUID
        p.position[: p.owned][own] += shake[p.id[: p.owned][own]]
        sim.distribute()
        sim.choose_step(1.0)
        sim.solve()
        pressure_gradient(sim)  # which exchanges the pressure
        result = fields_of(communicator, sim)
        p, w = sim.particles, sim.work
        # what exchanged arrays hold in the halo is what the owner has
        for name, values in (("asymmetry", w.asymmetry), ("surface", w.surface), ("pressure", p.pressure)):
            np.testing.assert_array_equal(values[: p.rows], result[name][p.id[: p.rows]])
            halo = np.arange(p.owned, len(p))
            halo = halo[p.kind[halo] != DUMMY]
            np.testing.assert_array_equal(values[halo], result[name][p.id[halo]])
        sim.close()
        return result

    total = simulation(comm).totals["total"]
    shake = rng.uniform(-0.2, 0.2, (total, 3)) * 0.02
    shake[:, 1] = 0.0
    one, many = fields(MPI.COMM_SELF, shake), fields(comm, shake)
    liquid = one["kind"] == FLUID
    np.testing.assert_array_equal(many["position"], one["position"])
    np.testing.assert_array_equal(many["surface"][liquid], one["surface"][liquid])
    np.testing.assert_allclose(many["asymmetry"][liquid], one["asymmetry"][liquid], atol=1e-13)
    np.testing.assert_allclose(many["gradient"][liquid], one["gradient"][liquid], atol=1e-9)
    np.testing.assert_allclose(many["pressure"], one["pressure"], atol=1e-8 * np.abs(one["pressure"]).max())


def test_full_and_floating_liquid_on_several_ranks(comm):
    """A full tank has no known pressure on any rank; its least pressure is zero on all."""
    more = ("fluids[0].depth=0.3", "motion[1].amplitude_deg=0")
    one, many = alone(3, *more), march(comm, 3, True, *more)
    assert np.abs(many["pressure"] - one["pressure"]).max() < 1e-6 * 3000.0
    wet = one["kind"] != DUMMY
    assert many["pressure"][wet].min() == pytest.approx(0.0, abs=1e-9)


def test_more_ranks_than_particles(comm):
    """A drop of a few particles in free fall: some ranks have walls alone, or nothing."""
    more = (
        "fluids=[{name: water, region: {disc: {centre: [0.2, 0.2], radius: 0.025}}}]",
        "motion=[]",
        "time.max_step=5e-3",
    )
    one, many = alone(3, *more), march(comm, 3, True, *more)
    assert np.sum(one["kind"] == FLUID) < 10
    assert np.abs(many["position"] - one["position"]).max() < 1e-8 * one["l0"]


def test_layers_do_not_depend_on_the_number_of_ranks(comm):
    """Three liquids with surface tension, whose interfaces run from rank to rank."""
    one, many = alone(20, *TENSE_LAYERS), march(comm, 20, True, *TENSE_LAYERS)
    assert np.abs(many["position"] - one["position"]).max() < 1e-8 * one["l0"]
    assert np.abs(many["pressure"] - one["pressure"]).max() < 1e-6 * 2000.0
    assert many["energy"] == pytest.approx(one["energy"], rel=1e-7)


def test_wetting_does_not_depend_on_the_number_of_ranks(comm):
    """Three liquids, two of whose interfaces meet walls at angles of their own."""
    tense = TENSE_LAYERS[1].replace("tension: 0.5", "tension: 0.5, wetting_angle: 60")
    more = (TENSE_LAYERS[0], tense.replace("tension: 0.1", "tension: 0.1, wetting_angle: 110"))
    one, many = alone(20, *more), march(comm, 20, True, *more)
    assert np.abs(many["position"] - one["position"]).max() < 1e-8 * one["l0"]
    assert np.abs(many["pressure"] - one["pressure"]).max() < 1e-6 * 2000.0


def test_surface_tension_does_not_depend_on_the_number_of_ranks(comm):
    """A surface that stands on walls and runs from rank to rank."""
    fluid = "fluids=[{name: water, depth: 0.12, kinematic_viscosity: 1.0e-4, surface_tension: 10}]"
    one, many = alone(20, fluid), march(comm, 20, True, fluid)
    assert np.abs(many["position"] - one["position"]).max() < 1e-8 * one["l0"]
    assert np.abs(many["pressure"] - one["pressure"]).max() < 1e-6 * 2000.0


def test_ranks_share_the_work_evenly(comm):
    """In a tank filled by a third, where most walls are dry and cost nothing."""
    sim = simulation(comm, JOB, "spacing=0.005", "fluids=[{name: water, fill: 0.3}]")
    work = comm.allgather(float(sim.costs().sum()))
    sim.close()
    assert max(work) <= 1.01 * np.mean(work)


def test_halos_stay_small(comm):
    """Sloshing carries particles into the boxes of other ranks; what their halos cost pays for a new distribution."""
    sim = simulation(comm, JOB, "spacing=0.01", "motion=[{kind: surge, amplitude: 0.1, omega: 8.0}]")
    total, overdue, last = sim.domain.sum, 0.0, None
    for _ in range(250):
        if sim.particles is not last:  # distributed anew
            last, first, lost = sim.particles, total(float(sim.domain.halo)), []
        sim.step(1.0)
        if sim.particles is last:
            lost.append(HALO_COST * (total(float(sim.domain.halo)) - first) / total(float(sim.pairs.count)))
            overdue = max(overdue, sum(lost[:-BALANCE_EVERY]))  # the ranks look every so many steps
    sim.close()
    assert overdue <= 1.05 * DISTRIBUTION_STEPS


@pytest.mark.parametrize("scheme", ["balanced", "papers"])
def test_loads_are_those_of_one_rank(comm, scheme):
    """Pressure and friction on walls, from the first step on, across new distributions."""
    at = "{name: P, kind: pressure, at: [0.0, 0.05]}, {name: L, kind: pressure, at: [0.2, 0.06]}"
    probes = f"[{at}, {{name: load, kind: force}}]"
    job = parse_job(JOB, ["motion=[]", f"scheme={{preset: {scheme}, ksp_rtol: 1e-12}}", f"probes={probes}"])

    def measured(domain):
        sim = Simulation(job, domain)
        assert sim.job.scheme.preset != "papers" or "viscosity" in sim.seconds
        sim.particles.velocity[: sim.particles.liquid, 0] = 0.1  # along the floor: friction from the start
        loads = Loads(build_probes(job, sim.geometry), domain, "viscosity" in sim.seconds)
        loads.bind(sim.particles)
        values = []
        for step in range(6):
            sim.choose_step(0.02)
            sim.solve()
            sums = loads.sums(sim.particles, sim.liquids.density, sim.frame, wall_friction(sim))
            values.append(loads.values(domain.sum(sums)[None], [sim.frame])[0])
            sim.move()
            if step % 2:
                sim.distribute()
        sim.close()
        return np.array(values)

    one = measured(Domain(MPI.COMM_SELF))
    assert np.abs(one[:, 2:]).max(axis=0).min() > 0.0
    np.testing.assert_allclose(measured(Domain(comm)), one, rtol=1e-6, atol=1e-6 * np.abs(one).max())
