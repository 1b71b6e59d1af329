"""The harness of the MPI tests itself: failures are reported once, and nobody waits for ever."""

import os
import subprocess
import sys
from pathlib import Path

HARNESS = Path(__file__).parent / "mpi" / "conftest.py"
RUN_AS_ROOT = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}

EVERYWHERE = """
def test_fails_on_one(comm):
    assert comm.rank == 0, "only rank 0 is well"

def test_passes(comm):
    assert comm.allreduce(1) == 2
"""

WAITING = """
def test_fails_while_the_other_waits(comm):
    assert comm.rank == 0, "only rank 0 is well"
    comm.Barrier()

def test_fails_on_one(comm):
    if comm.rank == 1:
        raise RuntimeError("rank 1 gives up")
    comm.Barrier()
"""


def run_tests(tmp_path, tests):
    harness = HARNESS.read_text()
    patient, hasty = "SECONDS_TO_AGREE = 10.0", "SECONDS_TO_AGREE = 1.0"
    assert patient in harness
    (tmp_path / "conftest.py").write_text(harness.replace(patient, hasty))
    (tmp_path / "test_it.py").write_text(tests)
    command = ["mpirun", "--oversubscribe", "-n", "2", sys.executable, "-m", "pytest", "-q", "--color=no"]
    return subprocess.run(
        [*command, "-p", "no:cacheprovider", "--rootdir", tmp_path, tmp_path],
        capture_output=True,
        text=True,
        timeout=60,
        stdin=subprocess.DEVNULL,
        env={**os.environ, **RUN_AS_ROOT},
    )


def test_a_failure_on_one_rank_fails_the_test_and_the_rest_go_on(tmp_path):
    done = run_tests(tmp_path, EVERYWHERE)
    assert done.returncode != 0
    assert "on rank 1:" in done.stdout
    assert "only rank 0 is well" in done.stdout
    assert done.stdout.count("1 failed, 1 passed") == 1


def test_a_failure_that_others_wait_for_ends_the_run_with_its_message(tmp_path):
    done = run_tests(tmp_path, WAITING)
    assert done.returncode != 0
    assert "rank 1 failed in" in done.stderr
    assert "only rank 0 is well" in done.stderr
