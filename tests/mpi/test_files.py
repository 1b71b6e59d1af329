"""The slab files written by the ranks of a real run."""

import contextlib
import os
import subprocess
import sys

import h5py
import numpy as np
import pytest

from parmps import checkpoint
from parmps.domain import Domain
from parmps.errors import OutputError
from parmps.loader import parse_job
from parmps.output import ParticleFile
from parmps.run import Run

POINTS = 1000


def slab_of(rank, ranks):
    """Rows of one rank; the first of several has none, as a rank without particles."""
    bounds = np.linspace(0, POINTS, max(ranks, 2)).astype(int) if ranks > 1 else np.array([0, POINTS])
    bounds = np.concatenate([[0], bounds]) if ranks > 1 else bounds
    return int(bounds[rank]), int(bounds[rank + 1])


def frame_arrays(rows, frame):
    ids = np.arange(*rows)
    return {
        "id": ids,
        "type": ids % 3,
        "fluid": ids % 2,
        "surface": ids % 2,
        "position": np.stack([ids + frame, ids * 3.0, ids * 2.0], axis=1),
        "velocity": np.stack([ids * 0.5, ids * 0.25, ids - frame], axis=1),
        "pressure": ids * 10.0 + frame,
    }


def test_particle_frames_of_all_ranks(comm, shared_path):
    path = shared_path / "particles.vtkhdf"
    if comm.rank == 0:
        ParticleFile.create(path, POINTS, 3, {"job": "title: test"})
    comm.Barrier()
    rows = slab_of(comm.rank, comm.size)
    with contextlib.closing(ParticleFile(path)) as file:
        for frame in range(3):
            file.write(frame, rows[0], frame_arrays(rows, frame))
            comm.Barrier()
            if comm.rank == 0:
                file.commit(frame, 0.1 * frame)
            comm.Barrier()
            assert file.frames == frame + 1
    with h5py.File(path, "r") as file:
        everything = frame_arrays((0, POINTS), 1)
        part = slice(POINTS, 2 * POINTS)
        assert np.array_equal(file["VTKHDF/PointData/pressure"][part], everything["pressure"])
        assert np.array_equal(file["VTKHDF/Points"][part], everything["position"])


def test_checkpoint_gives_every_rank_its_own_slab_back(comm, shared_path):
    path = shared_path / "checkpoint.h5"
    rows = slab_of(comm.rank, comm.size)
    slabs = comm.allgather(rows)
    state = {"position": np.random.default_rng(comm.rank).random((rows[1] - rows[0], 3))}
    if comm.rank == 0:
        checkpoint.create(path, {"position": ("<f8", (3,))}, POINTS, slabs, {"time": 0.1})
    comm.Barrier()
    checkpoint.write_slab(path, comm.rank, state)
    comm.Barrier()
    if comm.rank == 0:
        checkpoint.commit(path)
    comm.Barrier()
    header = checkpoint.read_header(path)
    mine = checkpoint.share_slabs(len(header.slabs), comm.size, comm.rank)
    assert np.array_equal(checkpoint.read_slabs(path, mine)["position"], state["position"])


JOB = """
dimension: 2
spacing: 0.02
tank: {size: [0.4, 0.3]}
fluids: [{name: water, depth: 0.14}]
time: {end: 0.02}
output: {particles_every: 0.01, probes_every: 0.01, checkpoint_every: 0.01}
"""
HOLD = """
import sys
from parmps.lock import DirectoryLock
lock = DirectoryLock(sys.argv[1])
print("held", flush=True)
sys.stdin.read()
"""


def go(domain, directory, restart=None):
    with contextlib.closing(Run(parse_job(JOB), domain, directory, restart)) as run:
        run.go()


def test_all_ranks_are_told_that_another_run_has_the_directory(comm, shared_path):
    holder = None
    if comm.rank == 0:
        command = [sys.executable, "-c", HOLD, str(shared_path / "out")]
        holder = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert holder.stdout.readline() == "held\n"
    comm.Barrier()
    with pytest.raises(OutputError, match="out: another run writes here: process "):
        Run(parse_job(JOB), Domain(comm), shared_path / "out")
    if comm.rank == 0:
        holder.communicate()
        assert [path.name for path in (shared_path / "out").iterdir()] == ["run.lock"]
    comm.Barrier()
    go(Domain(comm), shared_path / "out")
    comm.Barrier()
    assert not (shared_path / "out" / "run.lock").exists()


def test_all_ranks_refuse_a_checkpoint_that_one_cannot_use(comm, shared_path):
    domain, path = Domain(comm), shared_path / "checkpoint.h5"
    go(domain, shared_path)
    header = checkpoint.read_header(path)
    arrays = checkpoint.read_slabs(path, [comm.size - 1])
    arrays["kind"][0] = 7
    comm.Barrier()
    if comm.rank == 0:
        copies = [checkpoint.read_slabs(path, [index]) for index in range(comm.size - 1)]
        checkpoint.create(path, header.arrays, header.total, header.slabs, header.attributes)
        for index, slab in enumerate([*copies, arrays]):
            checkpoint.write_slab(path, index, slab)
        checkpoint.commit(path)
    comm.Barrier()
    with pytest.raises(OutputError, match="is damaged: the kind of some of its particles cannot be"):
        go(domain, shared_path, shared_path)
    if comm.rank == 0:
        path.unlink()
        os.mkfifo(path)
    comm.Barrier()
    with pytest.raises(OutputError, match="is not a regular file"):
        go(domain, shared_path, shared_path)
