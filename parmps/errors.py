"""The ways a run can end early, each with the exit status that scripts rely on."""


class ParmpsError(Exception):
    """Base of the errors that end a run with one message and no traceback."""

    exit_status = 4
    title = "error"
    """What the message begins with."""


class InputError(ParmpsError):
    """A job, motion file or command line that cannot be run (exit status 2).

    Parameters
    ----------
    key : str
        Dotted path of the offending key, such as ``tank.size[0]``.
    message : str
        What was found and what is allowed, values with units.
    """

    exit_status = 2

    def __init__(self, key, message):
        super().__init__(f"{key}: {message}" if key else message)
        self.key, self._message = key, message

    def __reduce__(self):  # to be passed to the other ranks
        return type(self), (self.key, self._message)


class InstallationError(ParmpsError):
    """A package that is needed is missing, or does not fit the others (exit status 4)."""


class DivergedError(ParmpsError):
    """The solution cannot be continued: a solver diverged or a value is not finite (exit status 3)."""

    exit_status = 3


class StoppedError(ParmpsError):
    """The run was asked to stop before its end; a checkpoint holds its state (exit status 5)."""

    exit_status = 5
    title = "early end"


class BeyondLimits(ParmpsError):  # noqa: N818 - the run came to its end, and its results are kept
    """The run is done, but made energy or lost volume beyond its limits (exit status 6)."""

    exit_status = 6
    title = "beyond limits"


class OutputError(ParmpsError):
    """An output file could not be written or read back (exit status 4)."""

    exit_status = 4

    def __init__(self, path, reason):
        super().__init__(f"{path}: {reason}")
        self.path, self._reason = path, reason

    def __reduce__(self):  # to be passed to the other ranks
        return type(self), (self.path, self._reason)
