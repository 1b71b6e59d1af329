"""MPI tests: every rank runs the same tests, and a failure on one cannot leave the others waiting.

After each phase of a test the ranks agree on its outcome, on a communicator of their own. A failure on any
rank fails the test on all, and rank 0, the only one that reports, shows the messages of the ranks that
failed. Where some ranks never get to the agreement, because they wait for one that failed, the failed rank
prints its message and aborts the run.
"""

import contextlib
import sys
import tempfile
import time
from pathlib import Path

import pytest
from mpi4py import MPI

SECONDS_TO_AGREE = 10.0
"""How long a failed rank waits for the others to end the same phase of the test."""

AGREEMENT = MPI.COMM_WORLD.Dup()


@pytest.fixture
def comm():
    """All ranks."""
    return MPI.COMM_WORLD


@pytest.fixture
def shared_path(comm):
    """A temporary directory that all ranks see."""
    with contextlib.ExitStack() as stack:
        made = stack.enter_context(tempfile.TemporaryDirectory()) if comm.rank == 0 else None
        yield Path(comm.bcast(made))
        comm.Barrier()


@pytest.hookimpl(trylast=True)
def pytest_configure(config):
    if AGREEMENT.rank > 0:
        config.pluginmanager.unregister(name="terminalreporter")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    if not all_ended(report.failed):
        where = f"rank {AGREEMENT.rank} failed in {item.nodeid} ({call.when}), others wait for it:"
        print(where, report.longreprtext, sep="\n", file=sys.stderr, flush=True)
        AGREEMENT.Abort(1)
    messages = AGREEMENT.allgather(report.longreprtext if report.failed else None)
    if AGREEMENT.size > 1 and any(messages):
        report.outcome = "failed"
        report.longrepr = "\n".join(f"on rank {rank}:\n{text}" for rank, text in enumerate(messages) if text)
    return report


def all_ended(failed):
    """Wait until all ranks have ended the phase; return False if they did not while this one failed."""
    request = AGREEMENT.Ibarrier()
    limit = time.monotonic() + SECONDS_TO_AGREE
    while not request.Test():
        if failed and time.monotonic() > limit:
            return False
        time.sleep(0.001)
    return True
