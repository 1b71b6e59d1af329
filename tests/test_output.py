"""Particle frames, probe table and summary: readable by others at any moment, never half there."""

import contextlib
import json
import multiprocessing
import os
import random
import resource
import signal
import subprocess
import sys
import time

import h5py
import numpy as np
import pytest

from parmps import checkpoint
from parmps.errors import OutputError
from parmps.output import POINT_DATA, ParticleFile, prepare_directory, write_json
from parmps.table import ProbeTable

POINTS = 5000


def rows_of(frame, start=0, stop=POINTS):
    """A frame whose values say which frame and particle they belong to."""
    ids = np.arange(start, stop)
    value = ids + 1000.0 * frame
    return {
        "id": ids,
        "type": ids % 3,
        "fluid": ids % 2,
        "surface": (ids + frame) % 2,
        "position": np.stack([value, value + 0.25, value + 0.5], axis=1),
        "velocity": np.stack([-value, value / 3, value * 2], axis=1),
        "pressure": value * 7,
    }


def write_frames(path, first, last, delay=0.0):
    with contextlib.closing(ParticleFile(path)) as file:
        for frame in range(first, last):
            for start in range(0, POINTS, POINTS // 5):
                file.write(frame, start, rows_of(frame, start, start + POINTS // 5))
                time.sleep(delay)
            file.commit(frame, 0.1 * frame)


def marked(path, frames):
    """What a checkpoint knew when there were so many frames."""
    with contextlib.closing(ParticleFile(path)) as file:
        file._set_count(frames)
        return file.mark()


def check_frames(path, live=False):
    """Check every committed frame in full with plain h5py; return how many there are.

    While others commit, the times may be read later than the number of frames.
    """
    with h5py.File(path, "r") as file:
        group = file["VTKHDF"]
        frames = int(group["Steps"].attrs["NSteps"])
        times = group["Steps/Values"][()]
        assert live or len(times) == frames
        assert np.array_equal(times[:frames], 0.1 * np.arange(frames))
        for frame in range(frames):
            expected = rows_of(frame)
            part = slice(frame * POINTS, (frame + 1) * POINTS)
            assert np.array_equal(group["Points"][part], expected.pop("position"))
            for name, values in expected.items():
                assert np.array_equal(group["PointData"][name][part], values), (frame, name)
        return frames


@pytest.fixture
def particles(tmp_path):
    path = tmp_path / "particles.vtkhdf"
    ParticleFile.create(path, POINTS, 6, {"job": "title: µ test\n", "version": "1.2"})
    return path


def test_a_new_file_has_no_frames_and_holds_the_job(particles):
    assert check_frames(particles) == 0
    with h5py.File(particles) as file:
        assert file["parmps/attributes/job"].asstr()[()] == "title: µ test\n"
    assert os.stat(particles).st_blocks * 512 < os.stat(particles).st_size / 4, "the file is not sparse"


def test_frames_appear_only_when_committed(particles):
    with contextlib.closing(ParticleFile(particles)) as file:
        file.write(0, 0, rows_of(0))
        assert file.frames == check_frames(particles) == 0
        file.commit(0, 0.0)
        assert file.frames == check_frames(particles) == 1


def test_frames_out_of_order_or_beyond_the_end_are_refused(particles):
    write_frames(particles, 0, 6)
    with contextlib.closing(ParticleFile(particles)) as file:
        for frame in (5, 6):
            with pytest.raises(ValueError, match="is not the next"):
                file.write(frame, 0, rows_of(frame))
        with pytest.raises(ValueError, match="rows"):
            ParticleFile.resume(particles, POINTS, 5, {"frames": 1, "last": 0.0})
            file.write(1, 1, rows_of(1))


def test_vtk_reads_every_step_array_and_value(particles):
    hdf = pytest.importorskip("vtkmodules.vtkIOHDF")
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline

    write_frames(particles, 0, 4)
    reader = hdf.vtkHDFReader()
    reader.SetFileName(str(particles))
    reader.UpdateInformation()
    key = vtkStreamingDemandDrivenPipeline.TIME_STEPS()
    times = [reader.GetOutputInformation(0).Get(key, step) for step in range(reader.GetNumberOfSteps())]
    assert times == list(0.1 * np.arange(4))
    for frame, value in enumerate(times):
        reader.UpdateTimeStep(value)
        data = reader.GetOutputDataObject(0)
        expected = rows_of(frame)
        assert data.GetClassName() == "vtkPolyData"
        assert data.GetNumberOfVerts() == data.GetNumberOfCells() == POINTS
        assert np.array_equal(vtk_to_numpy(data.GetPoints().GetData()), expected["position"])
        for name in POINT_DATA:
            assert np.array_equal(vtk_to_numpy(data.GetPointData().GetArray(name)), expected[name]), name


def write_share(path, barrier, index, count):
    bounds = np.linspace(0, POINTS, count + 1).astype(int)
    start, stop = int(bounds[index]), int(bounds[index + 1])
    with contextlib.closing(ParticleFile(path)) as file:
        for frame in range(6):
            file.write(frame, start, rows_of(frame, start, stop))
            barrier.wait(20)
            if index == 0:
                file.commit(frame, 0.1 * frame)
            barrier.wait(20)


def test_processes_write_their_rows_side_by_side(particles):
    context = multiprocessing.get_context("fork")
    barrier = context.Barrier(3)
    workers = [context.Process(target=write_share, args=(particles, barrier, i, 3)) for i in range(3)]
    for worker in workers:
        worker.start()
    while any(worker.is_alive() for worker in workers):
        check_frames(particles, live=True)
    for worker in workers:
        worker.join()
        assert worker.exitcode == 0
    assert check_frames(particles) == 6


def test_a_kill_at_any_moment_leaves_whole_frames_and_a_restart_completes_them(particles):
    draw = random.Random(1)
    context = multiprocessing.get_context("fork")
    kept = 0
    for _ in range(12):
        worker = context.Process(target=write_frames, args=(particles, kept, 6, 0.001))
        worker.start()
        time.sleep(draw.uniform(0.0, 0.05))
        os.kill(worker.pid, signal.SIGKILL)
        worker.join()
        assert check_frames(particles) >= kept
        mark = marked(particles, draw.randint(0, check_frames(particles)))
        kept = ParticleFile.resume(particles, POINTS, 0, mark)
        assert check_frames(particles) == kept == mark["frames"]
    write_frames(particles, kept, 6)
    assert check_frames(particles) == 6


def test_a_restart_keeps_the_frames_of_its_checkpoint(particles):
    write_frames(particles, 0, 4)
    mark = marked(particles, 4)
    write_frames(particles, 4, 5)
    assert ParticleFile.resume(particles, POINTS, 2, mark) == 4
    assert check_frames(particles) == 4
    write_frames(particles, 4, 6)
    assert check_frames(particles) == 6


def test_a_restart_to_a_later_end_makes_room(particles):
    write_frames(particles, 0, 6)
    assert ParticleFile.resume(particles, POINTS, 4, {"frames": 5, "last": 0.1 * 4}) == 5
    write_frames(particles, 5, 9)
    assert check_frames(particles) == 9
    with h5py.File(particles) as file:
        assert file["parmps/attributes/version"].asstr()[()] == "1.2"
    assert [entry.name for entry in particles.parent.iterdir()] == [particles.name]


def test_a_restart_with_other_particles_or_frames_is_refused(particles):
    with pytest.raises(OutputError, match="5000 particles a frame, the run has 10"):
        ParticleFile.resume(particles, 10, 6, {"frames": 0, "last": None})
    write_frames(particles, 0, 3)
    with pytest.raises(OutputError, match=r"has 3 of the 5 frames up to t = 0\.4 s .*, the last of them at t = 0\.2 s"):
        ParticleFile.resume(particles, POINTS, 6, {"frames": 5, "last": 0.1 * 4})
    with pytest.raises(OutputError, match=r"has frame 2 at t = 0\.1 s, which the checkpoint knows at t = 0\.15 s"):
        ParticleFile.resume(particles, POINTS, 6, {"frames": 2, "last": 0.15})
    assert check_frames(particles) == 3


def elsewhere(file):
    del file["VTKHDF/Points"]
    shape = (6 * POINTS, 3)
    file.create_dataset("VTKHDF/Points", shape, "<f8", external=[("/etc/passwd", 0, h5py.h5f.UNLIMITED)])


def linked(file):
    del file["VTKHDF/PointData/pressure"]
    file["VTKHDF/PointData/pressure"] = h5py.SoftLink("/VTKHDF/Points")


def packed(file):
    del file["VTKHDF/PointData/pressure"]
    file.create_dataset("VTKHDF/PointData/pressure", (6 * POINTS,), "<f8", chunks=(POINTS,), compression="gzip")


def beyond(file):
    file["parmps/times_at"][()] = 2**62


def before(file):
    file["parmps/commit_words"][:] = -8


@pytest.mark.parametrize("change", [elsewhere, linked, packed, beyond, before])
def test_a_file_that_would_be_written_elsewhere_is_refused(particles, change):
    with h5py.File(particles, "r+") as file:
        change(file)
    with pytest.raises(OutputError, match="particles.vtkhdf: "):
        ParticleFile(particles)


@pytest.mark.parametrize("content", [b"", b"not HDF5", None])
def test_what_is_no_particle_file_is_refused(tmp_path, content):
    path = tmp_path / "particles.vtkhdf"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(OutputError, match="particles.vtkhdf"):
        ParticleFile(path)


def test_another_hdf5_file_is_refused(tmp_path):
    path = tmp_path / "particles.vtkhdf"
    h5py.File(path, "w").close()
    with pytest.raises(OutputError, match="cannot be used"):
        ParticleFile(path)


def test_a_failed_creation_leaves_the_earlier_file(particles, monkeypatch):
    write_frames(particles, 0, 2)

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OutputError, match="No space left"):
        ParticleFile.create(particles, POINTS, 9, {})
    assert check_frames(particles) == 2
    assert [entry.name for entry in particles.parent.iterdir()] == [particles.name]


def test_a_full_disk_loses_no_committed_frame(small_disk):
    path = small_disk / "particles.vtkhdf"
    ParticleFile.create(path, POINTS, 6, {})
    with pytest.raises(OutputError, match=r"particles\.vtkhdf: No space left on device"):
        write_frames(path, 0, 6)
    assert check_frames(path) in (1, 2)
    with pytest.raises(OutputError, match="probes.csv"):
        ProbeTable(small_disk / "probes.csv", ["a" * 5000])
    with pytest.raises(OutputError, match=r"other\.vtkhdf"):
        ParticleFile.create(small_disk / "other.vtkhdf", POINTS, 6, {})
    assert [entry.name for entry in small_disk.iterdir()] == [path.name]


def test_a_write_beyond_the_file_size_limit_is_an_output_error(particles):
    def limited():
        size = particles.stat().st_size // 2
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
        with pytest.raises(OutputError, match="File too large"):
            write_frames(particles, 0, 6)

    worker = multiprocessing.get_context("fork").Process(target=limited)
    worker.start()
    worker.join(20)
    assert worker.exitcode == 0
    check_frames(particles)


COLUMNS = ["P1 [Pa]", "eta, left [m]"]


def test_json_is_replaced_whole(tmp_path):
    path = tmp_path / "run.json"
    write_json(path, {"status": "running", "steps": np.int64(3), "energy": np.array([0.5])})
    assert json.loads(path.read_text()) == {"status": "running", "steps": 3, "energy": [0.5]}
    with pytest.raises(OutputError, match="No such file"):
        write_json(tmp_path / "missing" / "run.json", {})


def test_a_fresh_run_moves_earlier_results_and_a_restart_does_not(tmp_path):
    out = tmp_path / "a" / "b"
    prepare_directory(out, restart=False)
    (out / "checkpoint.h5").write_text("first")
    (out / "notes.txt").write_text("mine")
    prepare_directory(out, restart=True)
    assert (out / "checkpoint.h5").exists()
    prepare_directory(out, restart=False)
    assert not (out / "checkpoint.h5").exists()
    assert (out / "previous" / "checkpoint.h5").read_text() == "first"
    assert (out / "notes.txt").exists()


def test_what_is_in_the_way_is_named_and_kept(tmp_path):
    (tmp_path / "out").write_text("a file")
    with pytest.raises(OutputError, match="out: is in the way: not a directory"):
        prepare_directory(tmp_path / "out", restart=False)
    with pytest.raises(OutputError, match="Not a directory"):
        prepare_directory(tmp_path / "out" / "inner", restart=False)
    (tmp_path / "results" / "run.log").mkdir(parents=True)
    (tmp_path / "results" / "probes.csv").write_text("kept")
    with pytest.raises(OutputError, match="run.log: a directory is in the way"):
        prepare_directory(tmp_path / "results", restart=False)
    assert (tmp_path / "results" / "probes.csv").read_text() == "kept"


def test_links_are_not_followed(tmp_path):
    """Names that a run makes anew, some of them for a moment: what a link of that name leads to stays as it is."""
    victim = tmp_path / "victim"
    victim.write_text("mine")
    names = ("probes.csv", "particles.vtkhdf", "checkpoint.h5", "run.json")
    for name in names:
        (tmp_path / f"{name}.tmp").symlink_to(victim)
    (tmp_path / "run.log").symlink_to(tmp_path / "not there")
    prepare_directory(tmp_path, restart=False)
    assert (tmp_path / "previous" / "run.log").is_symlink()
    ProbeTable(tmp_path / "probes.csv", COLUMNS).close()
    ParticleFile.create(tmp_path / "particles.vtkhdf", POINTS, 6, {})
    write_json(tmp_path / "run.json", {})
    checkpoint.create(tmp_path / "checkpoint.h5", {"id": ("<i8", ())}, 1, [(0, 1)], {})
    checkpoint.commit(tmp_path / "checkpoint.h5")
    assert victim.read_text() == "mine"
    assert all((tmp_path / name).is_file() and not (tmp_path / name).is_symlink() for name in names)
    (tmp_path / "previous" / "run.log").unlink()
    (tmp_path / "previous").rmdir()
    (tmp_path / "previous").symlink_to(tmp_path)
    with pytest.raises(OutputError, match="previous: is in the way"):
        prepare_directory(tmp_path, restart=False)


@pytest.mark.parametrize("name", ["probes.csv", "particles.vtkhdf", "run.log"])
def test_a_pipe_is_not_waited_for(tmp_path, name):
    os.mkfifo(tmp_path / name)
    for restart in (False, True):
        with pytest.raises(OutputError, match="not a regular file"):
            prepare_directory(tmp_path, restart)


def test_a_directory_that_cannot_be_written_is_refused():
    with pytest.raises(OutputError, match="/proc"):
        prepare_directory("/proc/self", restart=False)


def test_the_modules_know_no_mpi():
    modules = "parmps.output, parmps.checkpoint, parmps.report, parmps.campaign, parmps.figures.page"
    code = f"import sys, {modules}; assert 'mpi4py' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
