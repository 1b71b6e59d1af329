"""Ends that nobody wished for: kills, signals, full disks, ranks that fail alone. Nothing is lost or hangs."""

import contextlib
import errno
import json
import multiprocessing
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import time

import h5py
import numpy as np
import pytest
from test_cli import ENVIRONMENT, JOB, last_frame, parmps, read_table

from parmps import checkpoint, lock
from parmps.domain import Domain
from parmps.errors import ParmpsError
from parmps.interrupt import WALL_LIMIT, Interrupt, reason
from parmps.loader import parse_job
from parmps.lock import LOCK_FILE, DirectoryLock
from parmps.output import ParticleFile
from parmps.run import Run

KILLS = int(os.environ.get("PARMPS_KILLS", "8"))
"""Random moments at which a run is killed; 50 before a release."""

DENSE = ["output.checkpoint_every=0.01", "output.particles_every=0.01", "output.probes_every=0.005"]
"""Results so often that most of the time goes into writing them."""


def go(directory, restart=False, wall_limit=None, overrides=DENSE):
    """Run the job; the exit status. In a child of this process, which has MPI and the kernels loaded."""
    job = parse_job(JOB, overrides)
    status = 0
    with contextlib.suppress(ParmpsError), Interrupt(wall_limit) as interrupt:
        try:
            run = Run(job, Domain(), directory, directory if restart else None, interrupt)
            try:
                run.go()
            finally:
                run.close()
        except ParmpsError as error:
            print(error, file=sys.stderr)
            status = error.exit_status
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


def start(*arguments, **options):
    child = multiprocessing.get_context("fork").Process(target=go, args=arguments, kwargs=options)
    child.start()
    return child


def finish(*arguments, **options):
    child = start(*arguments, **options)
    child.join(60)
    return child.exitcode


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory):
    directory = tmp_path_factory.mktemp("unbroken")
    assert finish(directory) == 0
    return directory


def final_state(directory):
    moment, arrays = last_frame(directory / "particles.vtkhdf")
    assert moment == 0.1
    steps = json.loads((directory / "run.json").read_text())["steps"]
    return (directory / "probes.csv").read_text(), steps, {n: a.tobytes() for n, a in sorted(arrays.items())}


def check_whole(directory):
    """Every file that is there is readable, whole and without a gap or a double; whether there is a checkpoint."""
    if (directory / "checkpoint.h5").exists():
        header = checkpoint.read_header(directory / "checkpoint.h5")
        checkpoint.read_slabs(directory / "checkpoint.h5", range(len(header.slabs)))
    if (directory / "probes.csv").exists():
        times = read_table(directory / "probes.csv")[1].reshape(-1, 10)[:, 0]
        np.testing.assert_allclose(times, 0.005 * np.arange(len(times)), atol=1e-12)
    if (directory / "particles.vtkhdf").exists():
        with h5py.File(directory / "particles.vtkhdf") as file:
            times = file["VTKHDF/Steps/Values"][()]
            assert file["VTKHDF/Steps"].attrs["NSteps"] == len(times)
        np.testing.assert_allclose(times, 0.01 * np.arange(len(times)), atol=1e-12)
    return (directory / "checkpoint.h5").exists()


def test_a_kill_at_any_moment_costs_no_more_than_the_time_since_the_checkpoint(tmp_path, unbroken):
    draw = random.Random(3)
    kills = rounds = 0
    while kills < KILLS:
        directory = tmp_path / str(rounds)
        directory.mkdir()
        restart, done = False, False
        while not done:
            child = start(directory, restart)
            child.join(draw.uniform(0.02, 0.25) if kills < KILLS else 60)
            done = child.exitcode is not None
            if not done:
                os.kill(child.pid, signal.SIGKILL)
                child.join()
                kills += 1
            assert not done or child.exitcode == 0
            restart = check_whole(directory)
        assert final_state(directory) == final_state(unbroken)
        rounds += 1


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGUSR1])
def test_a_signal_ends_a_run_with_a_checkpoint_of_its_last_step(tmp_path, number, capfd):
    child = start(tmp_path, overrides=["time.end=50"])
    until_it_writes(tmp_path)
    os.kill(child.pid, number)
    child.join(10)
    assert child.exitcode == 5
    status = json.loads((tmp_path / "run.json").read_text())["status"]
    assert status.startswith(f"stopped by signal {number.name} at t = 0.")
    counters = checkpoint.read_header(tmp_path / "checkpoint.h5").attributes["counters"]
    assert f"step {counters['step_number']}" in status
    assert status in capfd.readouterr().err
    assert f"--restart {tmp_path}" in (tmp_path / "run.log").read_text()


def test_the_wall_limit_ends_a_run_with_a_checkpoint_and_a_restart_completes_it(tmp_path, unbroken):
    assert finish(tmp_path, wall_limit=0.0, overrides=DENSE) == 5
    status = json.loads((tmp_path / "run.json").read_text())["status"]
    assert status == "stopped by the wall time limit at t = 0 s, step 0"
    assert finish(tmp_path, restart=True) == 0
    assert final_state(tmp_path) == final_state(unbroken)


def test_requests_to_stop_are_noticed_once_and_a_second_signal_kills():
    with Interrupt() as interrupt:
        assert interrupt.request() == 0
        os.kill(os.getpid(), signal.SIGTERM)
        assert reason(interrupt.request()) == "signal SIGTERM"
        assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
        assert callable(signal.getsignal(signal.SIGINT))
    assert signal.getsignal(signal.SIGINT) == signal.default_int_handler
    assert Interrupt(0.0).request() == WALL_LIMIT
    assert Interrupt(100.0).request() == 0


def test_a_full_disk_ends_a_run_and_keeps_what_was_written(tmp_path, capfd):
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=400k", "tmpfs", disk], capture_output=True).returncode:
        pytest.skip("needs the right to mount a file system")
    try:
        assert finish(disk / "out") == 4
        message = capfd.readouterr().err.splitlines()[-1]
        assert message.startswith(str(disk / "out")) and message.endswith(": No space left on device")
        assert check_whole(disk / "out")
        assert not list((disk / "out").glob("*.tmp"))
    finally:
        subprocess.run(["umount", disk], check=True)


def test_what_is_in_the_way_is_refused_and_earlier_results_stay(tmp_path, unbroken, capfd):
    (tmp_path / "file").write_text("mine")
    assert finish(tmp_path / "file") == 4
    assert capfd.readouterr().err.splitlines()[-1] == f"{tmp_path / 'file'}: is in the way: not a directory"
    assert finish("/proc/self/out") == 4
    assert "/proc/self/out" in capfd.readouterr().err
    before = final_state(unbroken)
    (unbroken / "run.log").rename(unbroken / "kept.log")
    (unbroken / "run.log").mkdir()
    assert finish(unbroken) == 4
    assert "run.log: a directory is in the way" in capfd.readouterr().err
    (unbroken / "run.log").rmdir()
    assert final_state(unbroken) == before


def until_it_writes(directory):
    until = time.monotonic() + 20.0
    while not (directory / "probes.csv").exists() or len((directory / "probes.csv").read_text().splitlines()) < 4:
        assert time.monotonic() < until
        time.sleep(0.01)


def test_a_second_run_in_a_directory_is_refused_and_the_first_goes_on(tmp_path, capfd):
    child = start(tmp_path, overrides=["time.end=50"])
    until_it_writes(tmp_path)
    before = {path.name: path.stat().st_ino for path in tmp_path.iterdir() if path.name != "run.json"}
    assert finish(tmp_path) == 4
    assert capfd.readouterr().err.splitlines()[-1] == (
        f"{tmp_path}: another run writes here: process {child.pid} on {socket.gethostname()}"
    )
    assert child.exitcode is None
    assert {name: (tmp_path / name).stat().st_ino for name in before} == before
    os.kill(child.pid, signal.SIGKILL)
    child.join()
    assert finish(tmp_path, wall_limit=0.0) == 5  # the lock ended with its owner
    assert not (tmp_path / LOCK_FILE).exists()


def test_a_lock_that_is_removed_while_another_waits_is_noticed(tmp_path):
    """Who opened the file before its owner removed it locks a file that nobody else will find."""
    owner = DirectoryLock(tmp_path)
    take, owners = DirectoryLock._take, [owner]

    def after_its_owner(waiting):
        if owners:
            owners.pop().close()
        take(waiting)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(DirectoryLock, "_take", after_its_owner)
        taken = DirectoryLock(tmp_path)
    assert os.path.samestat(os.fstat(taken._descriptor), (tmp_path / LOCK_FILE).stat())
    taken.close()


def test_a_file_system_without_locks_is_told_of(tmp_path, monkeypatch):
    def lockf(*_):
        raise OSError(errno.ENOSYS, "Function not implemented")

    monkeypatch.setattr(lock.fcntl, "lockf", lockf)
    assert finish(tmp_path) == 0
    assert f"The file system of {tmp_path} has no locks" in (tmp_path / "run.log").read_text()


@pytest.mark.parametrize("where", ["2>&1 | head -1", ">&- 2>&-"])
def test_a_run_that_nobody_listens_to_goes_on(tmp_path, where):
    (tmp_path / "job.yaml").write_text(JOB)
    command = f"set -o pipefail; {sys.executable} -m parmps job.yaml {where}"
    done = subprocess.run(["bash", "-c", command], cwd=tmp_path, env=ENVIRONMENT, capture_output=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "out" / "run.json").read_text())["status"] == "done"
    assert "Results are in" in (tmp_path / "out" / "run.log").read_text()


def test_vtk_reads_every_step_array_and_value_of_a_run(unbroken):
    hdf = pytest.importorskip("vtkmodules.vtkIOHDF")
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline

    reader = hdf.vtkHDFReader()
    reader.SetFileName(str(unbroken / "particles.vtkhdf"))
    reader.UpdateInformation()
    key = vtkStreamingDemandDrivenPipeline.TIME_STEPS()
    times = [reader.GetOutputInformation(0).Get(key, step) for step in range(reader.GetNumberOfSteps())]
    np.testing.assert_allclose(times, 0.01 * np.arange(11), atol=1e-12)
    with h5py.File(unbroken / "particles.vtkhdf") as file:
        group, count = file["VTKHDF"], file["VTKHDF/NumberOfPoints"][0]
        for step, moment in enumerate(times):
            reader.UpdateTimeStep(moment)
            data, rows = reader.GetOutputDataObject(0), slice(step * count, (step + 1) * count)
            np.testing.assert_array_equal(vtk_to_numpy(data.GetPoints().GetData()), group["Points"][rows])
            assert data.GetPointData().GetNumberOfArrays() == len(group["PointData"]) == 6
            for name, values in group["PointData"].items():
                found = vtk_to_numpy(data.GetPointData().GetArray(name))
                np.testing.assert_array_equal(found, values[rows], err_msg=name)


LATER = [*DENSE, "time.end=0.12"]


def refused(directory, capfd, overrides=LATER, status=4):
    """A restart in place is refused with one message, which is returned, and leaves everything as it is."""
    before = {path: path.stat().st_mtime_ns for path in directory.iterdir()}
    capfd.readouterr()
    assert finish(directory, restart=True, overrides=overrides) == status
    assert {path: path.stat().st_mtime_ns for path in directory.iterdir()} == before
    (message,) = capfd.readouterr().err.splitlines()
    return message


@pytest.fixture
def copied(tmp_path, unbroken):
    shutil.copytree(unbroken, tmp_path / "run")
    return tmp_path / "run"


def test_a_checkpoint_of_another_job_or_a_damaged_one_is_refused_and_left(copied, capfd):
    path = copied / "checkpoint.h5"
    message = refused(copied, capfd, [*DENSE, "fluids[0].density=999"], status=2)
    assert message.startswith("fluids[0].density: 1000.0 in the checkpoint, 999.0 in the job; only time.end and output")
    message = refused(copied, capfd, [*DENSE, "time.end=0.05"], status=2)
    assert message == "time.end: got 0.05 s, must be at least 0.1 s, the time of the checkpoint"
    whole = path.read_bytes()
    for damaged in (whole[: len(whole) // 2], whole[:-2000] + bytes([whole[-2000] ^ 1]) + whole[-1999:]):
        path.write_bytes(damaged)
        assert f"{path}: is damaged" in refused(copied, capfd)
    path.unlink()
    os.mkfifo(path)
    assert refused(copied, capfd) == f"{path}: is not a regular file"


def test_results_that_are_not_what_the_checkpoint_left_are_refused(copied, capfd):
    table, frames = copied / "probes.csv", copied / "particles.vtkhdf"
    whole = table.read_bytes()
    lines = whole.splitlines(keepends=True)
    table.write_bytes(b"".join(lines[:12]) + b"\0" * 4096)
    assert refused(copied, capfd) == (
        f"{table}: has 11 of the 19 rows that belong to the checkpoint: those after t = 0.05 s up to t = 0.09 s are "
        "missing, NUL bytes are in their place; with --out DIR the run continues without this file"
    )
    table.write_bytes(b"".join([*lines[:12], *lines[13:]]))
    assert "has a gap from t = 0.05 to 0.06 s" in refused(copied, capfd)
    table.write_bytes(whole.replace(b"0.05,", b"0.05,1", 1))
    assert "was changed" in refused(copied, capfd)
    table.write_bytes(whole)
    with h5py.File(frames) as file:
        number = file["VTKHDF/NumberOfPoints"][0]
    assert ParticleFile.resume(frames, number, 0, {"frames": 6, "last": 0.05}) == 6
    assert "has 6 of the 10 frames up to t = 0.09 s" in refused(copied, capfd)


@pytest.mark.parametrize(("counter", "kind"), [(float("nan"), 0), (0.1, 7)])
def test_a_checkpoint_of_absurd_contents_is_refused(copied, capfd, counter, kind):
    """With right checksums; all that `continuation` refuses is in its own tests."""
    path = copied / "checkpoint.h5"
    header = checkpoint.read_header(path)
    arrays = checkpoint.read_slabs(path, [0])
    header.attributes["counters"]["time"] = counter
    arrays["kind"][0] = kind
    checkpoint.create(path, header.arrays, header.total, header.slabs, header.attributes)
    checkpoint.write_slab(path, 0, arrays)
    checkpoint.commit(path)
    problem = "the kind of some of its particles cannot be" if kind else "its counter time is nan"
    assert refused(copied, capfd) == f"{path}: is damaged: {problem}"


def test_a_restart_may_add_probes_and_go_on_with_another_record(tmp_path, capfd):
    """The record is the same up to the checkpoint; moved with its record, the case runs as it would have."""
    record, other = tmp_path / "a" / "motion.csv", tmp_path / "b" / "motion.csv"
    times = 0.01 * np.arange(13)
    surge = 0.02 * np.sin(7.0 * times)
    for path in (record, other):
        path.parent.mkdir()
        np.savetxt(path, np.stack([times, surge], 1), "%.9g", ",", header="time [s],surge [m]", comments="")
    moving = [f"motion[0]={{kind: file, path: {record}}}"]
    assert finish(tmp_path / "run", overrides=[*DENSE, *moving]) == 0
    shutil.copytree(tmp_path / "run", tmp_path / "moved")
    record.unlink()
    moved = [f"motion[0]={{kind: file, path: {other}}}"]
    assert finish(tmp_path / "moved", restart=True, overrides=[*LATER, *moved]) == 0
    shutil.copy(other, record)
    more = "probes=[{name: new, kind: elevation, at: [0.2]}, {name: P1, kind: pressure, at: [0.0, 0.05]}, "
    more += "{name: eta, kind: elevation, at: [0.02]}, {name: load, kind: force}]"
    surge[11:] += 0.001  # after the checkpoint
    np.savetxt(record, np.stack([times, surge], 1), "%.9g", ",", header="time [s],surge [m]", comments="")
    shutil.copytree(tmp_path / "run", tmp_path / "more")
    assert finish(tmp_path / "more", restart=True, overrides=[*LATER, *moving, more]) == 0
    (names, rows), (others, plain) = (read_table(tmp_path / name / "probes.csv") for name in ("more", "moved"))
    assert names[:3] == ["time [s]", "new [m]", "P1 [Pa]"] and [names[0], *names[2:]] == others
    assert np.isnan(rows[:20, 1]).all() and np.isfinite(rows[20:, 1]).all() and len(rows) == len(plain) == 25
    np.testing.assert_array_equal(np.delete(rows, 1, axis=1)[:20], plain[:20])
    surge[3] += 1e-6
    np.savetxt(record, np.stack([times, surge], 1), "%.9g", ",", header="time [s],surge [m]", comments="")
    message = refused(tmp_path / "run", capfd, [*LATER, *moving], status=2)
    assert message.startswith(f"motion[0].path: {record}: its rows up to t = 0.1 s, the time of the checkpoint")


def test_a_signal_to_some_rank_stops_all_and_another_number_of_ranks_completes_the_run(tmp_path):
    """The final state is that of a run without a stop, to the solver's tolerance."""
    job = tmp_path / "job.yaml"
    job.write_text(JOB + "scheme: {ksp_rtol: 1.0e-12}\n")
    script = tmp_path / "signalled.py"
    script.write_text(PRELUDE + "os.kill(os.getpid(), signal.SIGTERM)\n" + EPILOGUE)
    done = parmps(tmp_path, job, ranks=2, script=(script,))
    assert done.returncode == 5, done.stderr
    assert done.stderr.count("parmps: early end: stopped by signal SIGTERM at t = 0.02") == 1
    assert len(checkpoint.read_header(tmp_path / "out" / "checkpoint.h5").slabs) == 2
    accurate = ["scheme.ksp_rtol=1e-12", "output.particles_every=0.05", "output.probes_every=0.01"]
    assert finish(tmp_path / "out", restart=True, overrides=[*accurate, "output.checkpoint_every=0.1"]) == 0
    assert finish(tmp_path / "whole", overrides=accurate) == 0
    (_, one), (_, two) = (last_frame(tmp_path / name / "particles.vtkhdf") for name in ("out", "whole"))
    one, two = ({n: a[np.argsort(arrays["id"])] for n, a in arrays.items()} for arrays in (one, two))
    assert np.abs(one["position"] - two["position"]).max() < 1e-9 * 0.4
    assert np.abs(one["velocity"] - two["velocity"]).max() < 1e-7
    (names, one), (_, two) = (read_table(tmp_path / name / "probes.csv") for name in ("out", "whole"))
    assert len(one) == 11
    np.testing.assert_allclose(one, two, rtol=1e-5, atol=1e-5)


PRELUDE = """
import os, pathlib, signal, time
from parmps import cli, errors, report, simulation
original = simulation.Simulation.move
def move(self):
    if self.step_number == 3 and self.domain.rank == self.domain.size - 1:
        pathlib.Path("failed").write_text(repr(time.time()))
        """
EPILOGUE = """
    original(self)
simulation.Simulation.move = move
cli.main()
"""
ALONE = {
    "NaN": ("self.particles.pressure[0] = float('nan')", 3, "parmps: error: a velocity is not finite at t = 0.0"),
    "exception": ("raise RuntimeError('this rank fails')", 4, "parmps: rank 1 failed:"),
    "kill": ("os.kill(os.getpid(), signal.SIGKILL)", 137, "exited on signal 9"),
    "disk of one rank": ("raise errors.OutputError('run.log', 'No space left')", 4, "error: run.log: No space left"),
}


@pytest.mark.parametrize("case", ALONE)
def test_what_fails_on_one_rank_ends_all_with_one_message(tmp_path, case):
    fault, status, message = ALONE[case]
    (tmp_path / "job.yaml").write_text(JOB)
    (tmp_path / "failing.py").write_text(PRELUDE + fault + EPILOGUE)
    command = ["mpirun", "--oversubscribe", "-n", "2", sys.executable, "failing.py", "job.yaml"]
    done = subprocess.run(
        command, cwd=tmp_path, env=ENVIRONMENT, capture_output=True, text=True, timeout=300, stdin=subprocess.DEVNULL
    )
    assert time.time() - float((tmp_path / "failed").read_text()) < 10.0
    said = " ".join(done.stderr.split())  # Open MPI 5 breaks lines
    assert (done.returncode, said.count(message)) == (status, 1), done.stderr
    assert ("Traceback" in done.stderr) == (case == "exception")
