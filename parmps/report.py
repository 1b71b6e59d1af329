"""What a person reads while a run goes on and after it: ``run.log``, progress, timer table.

A log is used by one process only. Everything said goes to ``run.log`` and to the standard output; on a terminal a
progress bar in simulated time takes the place of the progress lines, which then go to the log alone.
"""

import os
import shlex
import sys
import time as clock
from pathlib import Path

from numba.core.event import TimingListener
from tqdm import tqdm

from parmps.slabs import output_errors

LEAST_STEPS = 50
"""Steps of a run from which its costs say something."""
LARGE_SHARE = 0.3
"""Share of the wall time that deserves a word."""
OFTEN = 10
"""Steps that a multigrid hierarchy should last."""
MANY_ITERATIONS = 30
"""Iterations a step beyond which the preconditioner is poor."""
SECONDS_BETWEEN_LINES = 5.0
"""Least wall time between two progress lines, s."""

_BAR_FORMAT = "{percentage:3.0f}%|{bar}| {n:.3f}/{total:g} s simulated, {postfix}"


class RunLog:
    """The log of a run and its progress.

    Parameters
    ----------
    path : path-like
        ``run.log``; lines are added to it, so that a restart continues it.
    terminal : bool
        Whether a person watches a terminal: draw a progress bar.

    Raises
    ------
    OutputError
        If the file cannot be written; so do all methods.
    """

    def __init__(self, path, terminal):
        self.path = Path(path)
        self._terminal = terminal
        self._bar = None
        with output_errors(self.path):
            self._file = open(self.path, "a", encoding="utf-8", buffering=1)  # noqa: SIM115

    def line(self, text=""):
        """Write a line, or several, to the log and the standard output.

        Parameters
        ----------
        text : str
            What to say.
        """
        self.note(text)
        if self._bar is not None:
            self._bar.write(text, file=sys.stdout)
        else:
            print(text, flush=True)

    def start(self, time, end):
        """Begin to show progress.

        Parameters
        ----------
        time, end : float
            Simulated time now and at the end, s.
        """
        self._end = end
        self._began = self._last_clock = clock.monotonic()
        self._first_time = None
        if self._terminal:
            self._bar = tqdm(total=end, initial=time, bar_format=_BAR_FORMAT, leave=True, dynamic_ncols=True)
            self._bar.set_postfix_str("starting")

    def progress(self, time, step, dt, iterations):
        """Show how far the run is; call it every step, it speaks every few seconds.

        Parameters
        ----------
        time : float
            Simulated time, s.
        step : int
            Number of steps done.
        dt : float
            Last time step, s.
        iterations : int
            Iterations of the pressure solver in the last step.
        """
        now = clock.monotonic()
        if self._first_time is None:  # the speed counts from here: the first step may have compiled kernels
            self._first_time, self._first_clock = time, now
        left = self._time_left(time, now)
        if self._bar is not None:
            self._bar.set_postfix_str(f"{left} left, dt {dt * 1e3:.3g} ms", refresh=False)
            self._bar.update(time - self._bar.n)
        if now - self._last_clock >= SECONDS_BETWEEN_LINES:
            self._last_clock = now
            text = (
                f"t = {time:.4f} s of {self._end:g} s   step {step}   dt = {dt * 1e3:.3g} ms   "
                f"{iterations} iterations   {left} left"
            )
            if self._bar is not None:
                self.note(text)
            else:
                self.line(text)

    def stop(self):
        """End the progress bar, if there is one."""
        if self._bar is not None:
            self._bar.set_postfix_str(f"{duration(clock.monotonic() - self._began)} taken")
            self._bar.close()
            self._bar = None

    def close(self):
        """End the progress bar and close the log."""
        self.stop()
        with output_errors(self.path):
            self._file.close()

    def note(self, text):
        """Write a line to the file alone.

        Parameters
        ----------
        text : str
        """
        with output_errors(self.path):
            self._file.write(text + "\n")

    def _time_left(self, time, now):
        """Return the wall time to the end at the mean speed so far, as text."""
        done = time - self._first_time
        if done <= 0.0:
            return "unknown time"
        return duration((self._end - time) / done * (now - self._first_clock))


class Compilation(TimingListener):
    """Time that numba spends on compiling kernels, while it listens to ``numba:compile``.

    Parameters
    ----------
    say : callable, optional
        Takes a line for the person who waits, when it begins.
    """

    def __init__(self, say=None):
        super().__init__()
        self._say = say

    @property
    def seconds(self):
        """Time so far, s."""
        return self.duration if self.done else 0.0

    def on_start(self, event):
        """Take notice of a kernel that is about to be compiled; kernels that it calls come within it."""
        if self._say is not None:
            self._say("Compiling the kernels; later runs find them compiled.")
            self._say = None
        super().on_start(event)


def command_line(*words):
    """Write a command as a person can paste it where the run was started.

    Parameters
    ----------
    *words : path-like
        Paths below the working directory are written from there.

    Returns
    -------
    str
    """
    here = os.getcwd() + os.sep
    return shlex.join(str(word).removeprefix(here) for word in words)


def duration(seconds):
    """Return a wall time as a person would say it.

    Parameters
    ----------
    seconds : float
        s.

    Returns
    -------
    str
        Such as ``42 s``, ``3 min 05 s`` or ``2 h 10 min``.
    """
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes:02d} min"
    if minutes:
        return f"{minutes} min {rest:02d} s"
    return f"{rest} s"


def timer_table(stages, wall):
    """Return the times of the stages as a table, the dearest first.

    Parameters
    ----------
    stages : dict of str to dict
        ``{"max": s, "mean": s}`` over the ranks, by stage, as in ``run.json``.
    wall : float
        Wall time of the time loop, s, which the shares refer to.

    Returns
    -------
    str
        Lines with the stage, its greatest and mean time over the ranks, and the share of the mean.
    """
    spent = sum(times["mean"] for times in stages.values())
    rows = sorted(stages.items(), key=lambda item: -item[1]["mean"])
    rows.append(("(not in a stage)", {"max": wall - spent, "mean": wall - spent}))
    width = max(len("stage"), *(len(name) for name, _ in rows))
    lines = [f"{'stage':<{width}}  {'max [s]':>10}  {'mean [s]':>10}  {'share':>6}"]
    for name, times in rows:
        share = times["mean"] / wall if wall > 0.0 else 0.0
        lines.append(f"{name:<{width}}  {times['max']:>10.3f}  {times['mean']:>10.3f}  {share:>6.1%}")
    lines.append(f"{'time loop':<{width}}  {wall:>10.3f}  {wall:>10.3f}  {1:>6.1%}")
    return "\n".join(lines)


def advice(record, steps):
    """Tell what was expensive in a run, and what can be done about it.

    Parameters
    ----------
    record : dict
        As in ``run.json``.
    steps : int
        Steps that the times and counts of the record are of.

    Returns
    -------
    list of str
        One sentence each; empty for a run in which nothing stands out.
    """
    wall, stages, ksp = record["wall_seconds"], record["stage_seconds"], record["ksp"]
    if wall <= 0.0:
        return []
    compiling = record["compile_seconds"] / wall
    if compiling > LARGE_SHARE:
        return [f"{compiling:.0%} of the time went into compiling the kernels: the next run finds them compiled."]
    if steps < LEAST_STEPS:
        return []
    spent = {name: times["mean"] / wall for name, times in stages.items()}
    pressure, halo, results = (spent.get(name, 0.0) for name in ("pressure", "halo", "results"))
    each = record["particles"]["total"] / record["ranks"]
    lines = []
    if pressure > LARGE_SHARE and steps < OFTEN * ksp["rebuilds"]:
        lines.append(
            f"The multigrid hierarchy was set up every {steps / ksp['rebuilds']:.1f} steps: each checkpoint makes a "
            "new one (output.checkpoint_every); a shorter step (time.cfl) keeps it longer."
        )
    if pressure > LARGE_SHARE and ksp["iterations_mean"] > MANY_ITERATIONS:
        lines.append(
            f"The pressure took {ksp['iterations_mean']:.0f} iterations a step: try scheme.ksp_rtol a decade larger, "
            "or another preconditioner (-ppe_pc_type hypre)."
        )
    if results > LARGE_SHARE:
        lines.append(
            f"{results:.0%} of the time went into samples, snapshots and checkpoints: see output.probes_every, "
            "output.particles_every and output.checkpoint_every."
        )
    if halo > LARGE_SHARE:
        lines.append(f"{halo:.0%} of the time went into the halo: {each:.0f} particles a rank are few.")
    waited = sum(times["max"] - times["mean"] for name, times in stages.items() if name != "halo") / wall
    if record["ranks"] > 1 and waited > LARGE_SHARE:
        lines.append(
            f"Ranks waited for each other for about {waited:.0%} of the time: are there more ranks than free cores, or "
            "do threads compete (OMP_NUM_THREADS=1)?"
        )
    return lines
