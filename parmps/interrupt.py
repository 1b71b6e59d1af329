"""Requests to end a run before its end: a signal, or the end of the wall time allowed."""

import signal
import time as clock

SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGUSR1)
"""Signals that ask for an end with a checkpoint. Batch systems send the first before they kill, a person at the
terminal the second; mpirun passes the third on and kills nobody after it."""

WALL_LIMIT = 1000
"""The request of the wall time, beside the numbers of the signals."""


class Interrupt:
    """Takes notice of requests to stop, while it is entered as a context.

    A signal is taken notice of and no more: the time loop asks when its state is whole. A second signal of
    the same kind does what it does to any program, so that a run that does not get to its loop can be ended.

    Parameters
    ----------
    wall_limit : float, optional
        Wall time from now on, s.
    """

    def __init__(self, wall_limit=None):
        self._deadline = None if wall_limit is None else clock.monotonic() + wall_limit
        self._signal = 0

    def __enter__(self):
        self._before = {number: signal.signal(number, self._notice) for number in SIGNALS}
        return self

    def __exit__(self, *_):
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _notice(self, number, _frame):
        self._signal = number
        signal.signal(number, signal.SIG_DFL)

    def request(self):
        """Tell whether this rank was asked to stop.

        Returns
        -------
        int
            0, the number of a signal, or `WALL_LIMIT`; of the requests of several ranks the greatest counts.
        """
        if self._deadline is not None and clock.monotonic() >= self._deadline:
            return WALL_LIMIT
        return self._signal


def reason(request):
    """Name a request.

    Parameters
    ----------
    request : int
        As `Interrupt.request` gave it, not 0.

    Returns
    -------
    str
        Such as ``signal SIGTERM``.
    """
    return "the wall time limit" if request == WALL_LIMIT else f"signal {signal.Signals(request).name}"
