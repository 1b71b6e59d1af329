"""Ends that nobody wished for: kills, signals, full disks, ranks that fail alone. Nothing is lost or hangs."""

import contextlib
import json
import multiprocessing
import os
import random
import shutil
import signal
import subprocess
import sys
import time

import h5py
import numpy as np
import pytest
from test_cli import ENVIRONMENT, JOB, last_frame, parmps, read_table

from parmps import checkpoint
from parmps.domain import Domain
from parmps.errors import ParmpsError
from parmps.interrupt import WALL_LIMIT, Interrupt, reason
from parmps.loader import parse_job
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
            run.go()
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
    until = time.monotonic() + 20.0
    while not (tmp_path / "probes.csv").exists() or len((tmp_path / "probes.csv").read_text().splitlines()) < 4:
        assert time.monotonic() < until
        time.sleep(0.01)
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


def test_a_checkpoint_of_another_job_or_a_damaged_one_is_refused_and_left(tmp_path, unbroken, capfd):
    shutil.copytree(unbroken, tmp_path / "run")
    path = tmp_path / "run" / "checkpoint.h5"
    assert finish(tmp_path / "run", restart=True, overrides=[*DENSE, "fluids[0].density=999"]) == 2
    message = capfd.readouterr().err.splitlines()[-1]
    assert message.startswith("fluids[0].density: 1000.0 in the checkpoint, 999.0 in the job; only time.end and output")
    assert final_state(tmp_path / "run") == final_state(unbroken)
    whole = path.read_bytes()
    for damaged in (whole[: len(whole) // 2], whole[:-2000] + bytes([whole[-2000] ^ 1]) + whole[-1999:]):
        path.write_bytes(damaged)
        assert finish(tmp_path / "run", restart=True) == 4
        assert f"{path}: is damaged" in capfd.readouterr().err
    assert final_state(tmp_path / "run") == final_state(unbroken)


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
