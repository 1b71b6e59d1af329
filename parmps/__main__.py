"""``python -m parmps``, and the command ``parmps`` of an installation."""

import os
import sys
from importlib import import_module

from parmps.errors import ParmpsError
from parmps.installation import fitting

NEEDED = ("numba", "h5py")
"""Compiled packages that the commands import; PETSc's own is loaded where it is told its options."""


def main():
    """Run the command line; where the installation itself is at fault, end with one message as well."""
    try:
        for name in NEEDED:
            with fitting(name):
                import_module(name)
        from parmps.cli import main as run
    except ParmpsError as problem:
        rank = os.environ.get("OMPI_COMM_WORLD_RANK", os.environ.get("PMI_RANK", "0"))  # MPI has not started
        if rank == "0":
            print(f"parmps: {problem.title}: {problem}", file=sys.stderr)
        sys.exit(problem.exit_status)
    run()


if __name__ == "__main__":
    main()
