"""Scaling beyond one machine, predicted: ``python jobs/benchmarks/scaling.py``, results in ``scaling.md``.

Cuts a real 3D state into 8 to 4096 parts as `Domain` would on so many ranks, counts what each owns, its halo and its
neighbours, and predicts the time of a step from them:

- work: the measured core-time a particle, times the largest share of the cost, plus `HALO_WORK` for each particle of
  the halo, which is sorted and searched but gets no row;
- halo: the exchanges of a step, as counted in a run on two ranks, and a look at all ranks' boxes, whether it must be
  found anew;
- multigrid: each iteration of CG has a product and, on each level, `SWEEPS` exchanges of the rows in the halo; the
  coarsest level is gathered and spread over all ranks;
- sums: `DOTS` reductions an iteration, and those of the step itself;
- distribution: `DISTRIBUTION_STEPS` times the work, and the reductions of the bisection, over the steps between two.
  These are as many as the rule of `Simulation.balance` allows while the halos grow, as they do in `AGE` steps of the
  simulation with the particles where they are: the halo above is the mean of that time.

An exchange takes the latency, an overhead for each neighbour, and its bytes over the bandwidth; a reduction over P
ranks takes log2(P) exchanges with one neighbour. Computing and communication do not overlap. What a model cannot know
is left out: other jobs on the network, uneven cores, output.
"""

import argparse
import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

ROOT = Path(__file__).resolve().parents[2]
HERE = ROOT / "jobs" / "benchmarks"
JOB = ROOT / "jobs" / "lng_tank.yaml"

sys.path[:0] = [str(ROOT), str(ROOT / "jobs")]

from provenance import provenance  # noqa: E402

from parmps.checkpoint import read_header, read_slabs  # noqa: E402
from parmps.domain import BISECTIONS, Domain  # noqa: E402
from parmps.loader import load_job  # noqa: E402
from parmps.particles import FLUID, PARTICLE_BYTES, WALL  # noqa: E402
from parmps.pressure import PRESSURE_OPTIONS  # noqa: E402
from parmps.simulation import BALANCE_EVERY, DISTRIBUTION_STEPS, HALO_COST, SORT_EVERY, Simulation  # noqa: E402

HALO_WORK = 0.05
"""Work of a halo particle over that of an owned one, as of a dummy: it is a candidate of the neighbour search alone."""
DOTS = 3
"""Reductions in an iteration of PETSc's CG: two products and a norm."""
SWEEPS = 4
"""Exchanges on a level in a cycle of multigrid: a smoother before and after, the residual, the prolongation."""
COARSENING = 20.0
"""Rows of a level over those of the next one, by smoothed aggregation in 3D."""
COARSEST = PRESSURE_OPTIONS["pc_gamg_coarse_eq_limit"]
"""Rows of the coarsest level, where PETSc stops."""
TRAFFIC_STEPS = 40
AGE = 20
"""Steps in which the growth of the halos is measured."""


class Counts(NamedTuple):
    """What the parts of a state have: (parts,) arrays.

    Attributes
    ----------
    owned : int64
        Particles.
    cost : float64
        Sum of their costs.
    halo, neighbours : int64
        Particles of other parts that it needs, and the parts that it exchanges with.
    columns, coupled : int64
        The same for the matrix: rows of other parts, at most, that its rows are linked to.
    growth : float
        Of the mean halo, particles a step, while everything stays where it is.
    """

    owned: np.ndarray
    cost: np.ndarray
    halo: np.ndarray
    neighbours: np.ndarray
    columns: np.ndarray
    coupled: np.ndarray
    growth: float = 0.0

    def interval(self):
        """Steps between two distributions, by the rule of `Simulation.balance`."""
        loss = HALO_COST * self.growth / self.cost.mean()  # steps, each step more than in the last one
        steps = math.sqrt(2.0 * DISTRIBUTION_STEPS / loss) if loss > 0.0 else math.inf
        return min(max(steps, BALANCE_EVERY), SORT_EVERY)


def count(state, part, parts):
    """Count what each part owns and needs.

    Parameters
    ----------
    state : State
    part : (n,) int64
        Part of each particle.
    parts : int

    Returns
    -------
    Counts
    """
    return Counts(
        np.bincount(part, minlength=parts),
        np.bincount(part, state.weight, parts),
        *_count_halo(state.position, part, parts, state.width),
        *_count_halo(state.position[state.row], part[state.row], parts, state.width),
    )


def _count_halo(position, part, parts, width):
    """Particles of other parts within ``width`` of each part's box, and those parts: `Domain.build_halo`'s rule."""
    position = position[np.argsort(part, kind="stable")]
    sizes = np.bincount(part, minlength=parts)
    own = [position[end - n : end] for n, end in zip(sizes, np.cumsum(sizes), strict=True)]
    nowhere = np.full(3, np.inf)
    low = np.array([at.min(axis=0) if len(at) else nowhere for at in own])
    high = np.array([at.max(axis=0) if len(at) else -nowhere for at in own])
    halo, neighbours = np.zeros(parts, np.int64), np.zeros(parts, np.int64)
    for mine in range(parts):
        lower, upper = low[mine] - width, high[mine] + width
        near = np.all((low <= upper) & (high >= lower), axis=1)
        near[mine] = False
        others = np.flatnonzero(near)
        neighbours[mine] = len(others)
        halo[mine] = sum(
            np.count_nonzero(np.all((own[other] >= lower) & (own[other] <= upper), axis=1)) for other in others
        )
    return halo, neighbours


class State(NamedTuple):
    """Particles, and how far they need to know each other.

    Attributes
    ----------
    position : (n, 3) float64, m
    weight : (n,) float64
        Costs.
    row : (n,) bool
        Whether the particle has a row in the matrix.
    width : float
        Of the halo, m.
    """

    position: np.ndarray
    weight: np.ndarray
    row: np.ndarray
    width: float


def load_simulation(job, checkpoint, domain):
    """Simulation of a job at the start, or from a checkpoint on.

    Parameters
    ----------
    job : Job
    checkpoint : path-like or None
    domain : Domain
        Of this process alone.

    Returns
    -------
    Simulation
    """
    sim = Simulation(job, domain)
    if checkpoint is not None:
        header = read_header(checkpoint)
        arrays = read_slabs(checkpoint, range(len(header.slabs)))
        sim.restore({"counters": header.attributes["counters"], "arrays": arrays, "left": header.attributes["left"]})
    return sim


def state_of(sim):
    """Present state of a simulation.

    Parameters
    ----------
    sim : Simulation

    Returns
    -------
    State
    """
    kind = sim.particles.kind
    return State(sim.particles.position, sim.costs(), (kind == FLUID) | (kind == WALL), sim.halo_width)


def cut(sim, numbers):
    """Cut the present state into each of some numbers of parts, and count again after `AGE` steps.

    Parameters
    ----------
    sim : Simulation
        Is `AGE` steps further afterwards.
    numbers : sequence of int

    Returns
    -------
    dict of int to Counts
    """
    first = state_of(sim)
    parts = {number: sim.domain.bisect(first.position, first.weight, number) for number in numbers}
    counts = {number: count(first, part, number) for number, part in parts.items()}
    before = sim.particles.id.copy()
    for _ in range(AGE):
        sim.step(sim.job.time.end)
    then = state_of(sim)
    order = np.argsort(before)
    same = order[np.searchsorted(before, sim.particles.id, sorter=order)]  # where each particle was
    for number, part in parts.items():
        halo, _ = _count_halo(then.position, part[same], number, then.width)
        growth = (halo.mean() - counts[number].halo.mean()) / AGE
        counts[number] = counts[number]._replace(growth=max(growth, 0.0))
    return counts


def measure_traffic():
    """Count what the ranks of this process exchange in a step; return it on rank 0."""
    class Counting(Domain):
        """Counts exchanges, their bytes a particle, reductions and new halos."""

        def __init__(self):
            super().__init__()
            self.counted = dict.fromkeys(("exchanges", "bytes", "reductions", "halos"), 0)

        def exchange(self, *arrays):
            self.counted["exchanges"] += 1
            self.counted["bytes"] += sum(a.itemsize * math.prod(a.shape[1:]) for a in arrays)
            super().exchange(*arrays)

        def _reduce(self, values, operation):
            self.counted["reductions"] += 1
            return super()._reduce(values, operation)

        def build_halo(self, particles, width):
            before = dict(self.counted)
            super().build_halo(particles, width)
            self.counted = before | {"halos": before["halos"] + 1}  # counted apart, by the model

    job = load_job(JOB, ["spacing=0.04"])
    sim = Simulation(job, Counting())
    for _ in range(5):
        sim.step(job.time.end)
    before = dict(sim.domain.counted)
    for _ in range(TRAFFIC_STEPS):
        sim.step(job.time.end)
    counted = {name: (sim.domain.counted[name] - before[name]) / TRAFFIC_STEPS for name in before}
    if sim.domain.rank == 0:
        print(json.dumps(counted))
    sim.close()


def traffic():
    """Run `measure_traffic` on two ranks: exchanges, bytes a halo particle, reductions and halos, all a step."""
    command = ["mpirun", "--oversubscribe", "-n", "2", sys.executable, __file__, "--traffic"]
    env = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(done.stderr)
    return json.loads(done.stdout.splitlines()[-1])


def measured(row):
    """Figure on one rank in a row of the last table of results_3d.md or, where there is none, results.md."""
    tables = HERE / "results_3d.md"
    text = (tables if tables.exists() else HERE / "results.md").read_text()
    return float(re.findall(rf"^\| {re.escape(row)} \| ([\d.]+)", text, re.MULTILINE)[-1])


def predict(counts, ranks, options, flows):
    """Predict the time of a step on some ranks, from the counts of a part.

    Parameters
    ----------
    counts : Counts
        Of a state; its worst part tells.
    ranks : int
        Those that reductions run over.
    options : argparse.Namespace
        ``cost``, s; ``iterations``; ``latency`` and ``overhead``, s; ``bandwidth``, bytes/s.
    flows : dict
        As returned by `traffic`.

    Returns
    -------
    dict of str to float
        Seconds, by what takes them.
    """
    interval = counts.interval()
    total, halo = counts.owned.mean() * ranks, counts.halo.max() + 0.5 * counts.growth * interval
    levels = max(math.ceil(math.log(total / COARSEST) / math.log(COARSENING)), 1)
    spread = math.log2(ranks)

    def exchange(neighbours, size):
        return options.latency + neighbours * options.overhead + size / options.bandwidth

    def reduction(size=8.0):
        return spread * exchange(1, 0.0) + size / options.bandwidth

    # what a level exchanges shrinks with its surface
    smoothing = [
        exchange(counts.coupled.max(), 8.0 * counts.columns.max() * COARSENING ** (-2.0 * level / 3.0))
        for level in range(levels)
    ]
    neighbours = counts.neighbours.max()
    work = options.cost * counts.owned.mean() * counts.cost.max() / counts.cost.mean()
    bisection = math.ceil(spread) * (BISECTIONS + 3) * reduction(4.0 * ranks)
    return {
        "work": work + options.cost * HALO_WORK * halo,
        "halo": flows["exchanges"] * exchange(neighbours, flows["bytes"] * halo / flows["exchanges"])
        + flows["halos"] * 2.0 * exchange(neighbours, 0.5 * PARTICLE_BYTES * halo)
        + (1.0 + flows["halos"]) * reduction(48.0 * ranks),
        "multigrid": options.iterations * (smoothing[0] + SWEEPS * sum(smoothing) + 2.0 * reduction(8.0 * COARSEST)),
        "sums": (options.iterations * DOTS + flows["reductions"]) * reduction(),
        "distribution": (DISTRIBUTION_STEPS * work + bisection) / interval,
    }


def strong_rows(states, options, flows):
    """Rows of the strong table: counts, efficiency, and the shares of the predicted step."""
    rows = []
    for parts, counts in states.items():
        times = predict(counts, parts, options, flows)
        step, total = sum(times.values()), counts.owned.sum()
        efficiency = options.cost * total / (parts * step)
        shares = [f"{times[name] / step:.0%}" for name in times]
        mean = counts.owned.mean()
        told = [str(parts), f"{mean:.0f} ({counts.owned.max()})", f"{counts.cost.max() / counts.cost.mean():.3f}"]
        told += [f"{values.mean():.0f} ({values.max()})" for values in (counts.halo, counts.neighbours, counts.coupled)]
        rows.append([*told, f"{counts.interval():.0f}", f"{1e3 * step:.3g}", f"{efficiency:.0%}", *shares])
    return rows


def weak_rows(states, options, flows):
    """Rows of the weak table: efficiency with as many particles a rank as each state has, on ever more ranks."""
    rows = []
    for counts in states.values():
        mean = counts.owned.mean()
        cells = [f"{mean:.0f}"]
        for ranks in states:
            times = predict(counts, ranks, options, flows)
            cells.append(f"{options.cost * mean / sum(times.values()):.0%}")
        rows.append(cells)
    return rows


def table(head, rows):
    """Lines of Markdown."""
    return ["| " + " | ".join(cells) + " |" for cells in [head, ["---"] * len(head), *rows]]


def bottleneck(states, options, flows):
    """What takes most beside the work, where efficiency first falls below one half."""
    for parts, counts in states.items():
        times = predict(counts, parts, options, flows)
        ideal = options.cost * counts.owned.sum() / parts
        if ideal < 0.5 * sum(times.values()):
            break
    excess = times | {"work of the halo and imbalance": times["work"] - ideal}
    del excess["work"]
    worst = max(excess, key=excess.get)
    share = excess[worst] / sum(times.values())
    return f"The most beside the even work at {parts} ranks: {worst}, {share:.0%} of the step."


def main():
    """Partition, count, predict, write; or with --traffic count exchanges on the ranks of this process."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--job", default=JOB, help="the state to cut: the start of a job")
    parser.add_argument("--set", action="append", metavar="KEY=VALUE", help="spacing=0.006 by default")
    parser.add_argument("--checkpoint", help="of that job, instead of its start")
    parser.add_argument("--parts", type=int, nargs="+", default=[8, 64, 512, 4096])
    parser.add_argument("--cost", type=float, metavar="US", help="core-microseconds a particle and step; as measured")
    parser.add_argument("--iterations", type=float, help="of the solver a step; as measured")
    parser.add_argument("--latency", type=float, default=2.0, metavar="US", help="of an exchange")
    parser.add_argument("--overhead", type=float, default=0.5, metavar="US", help="of each neighbour in it")
    parser.add_argument("--bandwidth", type=float, default=1.0, metavar="GB/S", help="of a rank")
    parser.add_argument("--traffic", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.traffic:
        measure_traffic()
        return
    cost = options.cost or measured("core-microseconds per particle and step")
    options.iterations = options.iterations or measured("solver iterations a step")
    options.cost, options.latency, options.overhead = 1e-6 * cost, 1e-6 * options.latency, 1e-6 * options.overhead
    options.bandwidth *= 1e9
    job, domain = load_job(options.job, options.set or ["spacing=0.006"]), Domain(MPI.COMM_SELF)
    sim = load_simulation(job, options.checkpoint, domain)
    started, total = sim.time, len(sim.particles)
    states = cut(sim, options.parts)
    sim.close()
    flows = traffic()
    head = ["ranks", "owned", "cost, max/mean", "halo", "neighbours", "coupled by the matrix"]
    head += ["steps between distributions", "step, ms", "efficiency"]
    lines = [
        f"{job.title}: {total} particles at {started:g} s, on ever more ranks; means, and in brackets the most.",
        "",
        *table([*head, "work", "halo", "multigrid", "sums", "distribution"], strong_rows(states, options, flows)),
        "",
        bottleneck(states, options, flows),
        "",
        "Efficiency with a fixed number of particles a rank:",
        "",
        *table(["particles a rank", *(f"{parts} ranks" for parts in states)], weak_rows(states, options, flows)),
        "",
        f"{cost:g} core-microseconds a particle and step, {options.iterations:g} iterations, "
        f"{flows['exchanges']:g} exchanges of {flows['bytes']:.0f} bytes a halo particle, {flows['reductions']:g} "
        f"reductions and {flows['halos']:.2g} new halos a step; latency {1e6 * options.latency:g} us and "
        f"{1e6 * options.overhead:g} us a neighbour, {1e-9 * options.bandwidth:g} GB/s a rank. Made at {provenance()}.",
    ]
    text = "\n".join(lines) + "\n"
    (HERE / "scaling.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
