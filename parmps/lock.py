"""One run a directory: a lock that ends with its owner, on this machine and on network file systems."""

import contextlib
import errno
import fcntl
import os
import socket
from pathlib import Path

from parmps.errors import OutputError
from parmps.slabs import make_directory, open_regular, output_errors

LOCK_FILE = "run.lock"
"""Name of the file, which holds the machine and the process of its owner and is gone after the run."""


class DirectoryLock:
    """Hold a directory against other runs; for one process a run.

    The lock is one of POSIX (``fcntl``): the system, and over NFS version 4 the server, takes it back when its owner
    ends, however that is. The file that carries it may stay behind then, and means nothing.

    Parameters
    ----------
    directory : path-like
        Made with its parents if missing.

    Attributes
    ----------
    holds : bool
        Whether others are kept out; some file systems have no locks.

    Raises
    ------
    OutputError
        If another run holds it, or no file can be made in it.
    """

    def __init__(self, directory):
        self.path = Path(directory) / LOCK_FILE
        self.holds = True
        make_directory(directory)
        with output_errors(directory):
            while True:
                self._descriptor = open_regular(self.path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW)
                self._take()
                if self._is_in_place():
                    break
                os.close(self._descriptor)  # its owner removed it after it was opened here
            os.ftruncate(self._descriptor, 0)
            os.pwrite(self._descriptor, f"process {os.getpid()} on {socket.gethostname()}\n".encode(), 0)

    def _take(self):
        try:
            fcntl.lockf(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno in (errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOLCK):
                self.holds = False
                return
            owner = os.pread(self._descriptor, 200, 0).decode(errors="replace").strip()
            os.close(self._descriptor)
            if error.errno in (errno.EACCES, errno.EAGAIN):
                raise OutputError(self.path.parent, f"another run writes here: {owner or 'it just began'}") from None
            raise

    def _is_in_place(self):
        """Whether the file that is locked is the one that others will find."""
        try:
            found = os.stat(self.path, follow_symlinks=False)
        except FileNotFoundError:
            return False
        return os.path.samestat(found, os.fstat(self._descriptor))

    def close(self):
        """Let others have the directory, and remove the file first, while nobody else can hold it."""
        with contextlib.suppress(OSError):
            self.path.unlink()
        os.close(self._descriptor)
