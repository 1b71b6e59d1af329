"""The slab files written by the ranks of a real run."""

import contextlib

import h5py
import numpy as np

from parmps import checkpoint
from parmps.output import ParticleFile

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
