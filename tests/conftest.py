"""What several files of tests use."""

import subprocess
from pathlib import Path

import pytest


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 1 MiB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1M", "tmpfs", disk], capture_output=True)
    if mounted.returncode:
        pytest.skip("needs the right to mount a file system")
    yield disk
    subprocess.run(["umount", disk], check=True)


@pytest.fixture
def start():
    """Start simulations of a job's text or file, and free their solvers afterwards."""
    # Imported here: where MPI has started, what it adds to the environment keeps mpirun from starting below it.
    from parmps.domain import Domain
    from parmps.loader import load_job, parse_job
    from parmps.simulation import Simulation

    begun = []

    def begin(text, *overrides):
        job = load_job(text, overrides) if isinstance(text, Path) else parse_job(text, overrides)
        begun.append(Simulation(job, Domain()))
        return begun[-1]

    yield begin
    for sim in begun:
        sim.close()
