"""Where compiled kernels are kept: beside their source, in the user's cache, or else in the temporary directory."""

import os
import stat
import tempfile
from pathlib import Path

import numba

from parmps.errors import InputError

KEY = "NUMBA_CACHE_DIR"
"""Environment variable by which numba, here and in the processes started from here, is told of a directory."""
NEEDED = "must name a directory for compiled kernels: neither beside them, nor in a home, nor in the temporary one"
"""What is wrong where no place is found; the reason follows."""


def find_place():
    """Give numba a directory for its cache where it finds none: neither the installation nor a home can be written.

    Raises
    ------
    InputError
        If the temporary directory has no place for it either.
    """
    if not os.path.isabs(os.path.expanduser("~")):
        # Of a user without a home, numba would make a directory named ~ here, and Open MPI's PMIx crashes.
        os.environ["HOME"] = os.devnull
    try:
        numba.njit(cache=True)(find_place)  # compiles nothing, but looks for the place
    except RuntimeError:
        os.environ[KEY] = str(temporary_place())
        numba.config.reload_config()


def temporary_place():
    """Make a directory below the temporary directory that nobody else can write: what lies there will be executed.

    Returns
    -------
    Path
        The same for all processes of a user.

    Raises
    ------
    InputError
        If it cannot be made, or is not the user's own.
    """
    try:
        place = Path(tempfile.gettempdir()) / f"parmps-{os.getuid()}"
        place.mkdir(mode=0o700, exist_ok=True)
        found = place.lstat()
    except OSError as error:
        raise InputError(KEY, f"{NEEDED} can they be kept ({error})") from None
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o077:
        raise InputError(KEY, f"{NEEDED} can they be kept ({place} is not of this user alone)")
    return place
