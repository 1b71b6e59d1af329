"""The offline partition of the scaling model against what the ranks of a run own, need and talk to."""

import sys
from pathlib import Path

import numpy as np
from mpi4py import MPI

from parmps.domain import Domain
from parmps.loader import load_job
from parmps.simulation import Simulation

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "jobs" / "benchmarks"))

import scaling  # noqa: E402


def test_offline_partition_counts_what_a_run_has(comm):
    job = load_job(ROOT / "jobs" / "lng_tank.yaml", ["spacing=0.06"])
    alone = Domain(MPI.COMM_SELF)
    sim = scaling.load_simulation(job, None, alone)
    counts = scaling.cut(sim, [comm.size])[comm.size]
    sim.close()
    assert (counts.growth > 0.0) == (comm.size > 1)
    sim = Simulation(job, Domain(comm))
    owned, halo, neighbours = sim.particles.owned, sim.domain.halo, len(sim.domain._sends)
    sim.close()
    np.testing.assert_array_equal(counts.owned, comm.allgather(owned))
    np.testing.assert_array_equal(counts.halo, comm.allgather(halo))
    np.testing.assert_array_equal(counts.neighbours, comm.allgather(neighbours))
    assert counts.columns.max() <= counts.halo.max()
