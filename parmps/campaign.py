"""The cases of a sweep on this machine or in a batch system, and the table of their results.

Every case has a directory of its own, named by its number, with its whole job in ``job.yaml`` and all results of
a run. What became of a case is read from that directory alone, so that a sweep can be stopped, continued, or
run by other means, and knows at any time which cases are missing.
"""

import contextlib
import csv
import fcntl
import io
import json
import math
import os
import shlex
import signal
import subprocess
import sys
import time as clock
from pathlib import Path

from tqdm import tqdm

from parmps.errors import InputError, StoppedError
from parmps.interrupt import Interrupt, reason
from parmps.loader import job_text
from parmps.lock import DirectoryLock
from parmps.motion import forcing_period
from parmps.output import prepare_directory, write_text
from parmps.report import say
from parmps.schema import unit_of_key
from parmps.signals import BESIDE, MEASURES, find_signal, measure, read_signals
from parmps.slabs import output_errors
from parmps.sweep import parameters

ERRORS = "errors.txt"
"""What a case wrote to its standard error."""
FAILURE = "parmps: error: "
"""Beginning of the line that tells why a case failed."""
EARLY_END = 5
"""Exit status of a run that was asked to stop; it goes on when the sweep does."""
BEYOND_LIMITS = 6
"""Exit status of a run that is done, with a warning in its ``run.json``."""
FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""What a cell begins with that a spreadsheet executes."""
SECONDS_BETWEEN_LOOKS = 0.1
SECONDS_TO_SAVE = 60.0
"""How long stopped cases have to write their checkpoints."""


def prepare(sweep, cases):
    """Make the directories of the cases and write their jobs.

    Results of a case that was different when they were computed move to its sub-directory ``previous``.

    Parameters
    ----------
    sweep : Sweep
    cases : list of Case

    Raises
    ------
    OutputError
        If they cannot be written, or a case that changed runs at present.
    """
    for case in cases:
        place, text = directory(sweep, case), job_text(case.job)
        with output_errors(place):
            place.mkdir(parents=True, exist_ok=True)
            same = (place / "job.yaml").exists() and (place / "job.yaml").read_text(encoding="utf-8") == text
        if not same:
            with contextlib.closing(DirectoryLock(place)):  # the case may run, as started by a script
                prepare_directory(place, restart=False)
                with output_errors(place):
                    (place / ERRORS).unlink(missing_ok=True)
                write_text(place / "job.yaml", text)


def directory(sweep, case):
    """Directory of a case.

    Parameters
    ----------
    sweep : Sweep
    case : Case

    Returns
    -------
    Path
    """
    return Path(sweep.run.directory) / case.name


def state(place):
    """Tell what became of a case.

    Parameters
    ----------
    place : Path
        Its directory.

    Returns
    -------
    str
        ``done``, ``missing``, or ``failed: `` and the reason.
    """
    with contextlib.suppress(OSError, ValueError):
        if json.loads((place / "run.json").read_text(encoding="utf-8"))["status"] == "done":
            return "done"
    with contextlib.suppress(OSError):
        for line in reversed((place / ERRORS).read_text(encoding="utf-8", errors="replace").splitlines()):
            if line.startswith(FAILURE):
                return f"failed: {line.removeprefix(FAILURE)}"
    return "missing"


def missing_cases(sweep, cases, retry=False):
    """Cases that are still to run.

    Parameters
    ----------
    sweep : Sweep
    cases : list of Case
    retry : bool
        Whether those that failed are to run again.

    Returns
    -------
    list of Case
    """
    left = []
    for case in cases:
        found = state(directory(sweep, case))
        if found == "missing" or (retry and found != "done"):
            left.append(case)
    return left


def command(sweep, case):
    """Command line that runs a case here, from its checkpoint if it has one.

    Parameters
    ----------
    sweep : Sweep
    case : Case

    Returns
    -------
    list of str
    """
    place = directory(sweep, case)
    where = "--restart" if (place / "checkpoint.h5").exists() else "--out"
    words = [*_launcher(sweep, "--oversubscribe"), sys.executable, "-m", "parmps"]
    return [*words, str(place / "job.yaml"), where, str(place)]


def _launcher(sweep, *options):
    """Words that start the ranks of a case; the options are mpirun's."""
    if sweep.run.launcher is not None:
        return sweep.run.launcher.split()
    return [] if sweep.run.ranks == 1 else ["mpirun", *options, "-n", str(sweep.run.ranks)]


# On this machine


def run_here(sweep, cases):
    """Run cases on this machine, so many at a time as the sweep says.

    Parameters
    ----------
    sweep : Sweep
    cases : list of Case

    Raises
    ------
    InputError
        If cases of this sweep run already.
    StoppedError
        On a signal; the cases under way wrote checkpoints.
    OutputError
        If a directory cannot be written.
    """
    waiting, running = list(cases), {}
    bar = tqdm(total=len(cases), bar_format="{percentage:3.0f}%|{bar}| {desc}", disable=None)
    with _lock(sweep) as lock, bar, Interrupt() as interrupt:
        while (waiting or running) and not interrupt.request():
            while waiting and len(running) < sweep.run.jobs:
                case = waiting.pop(0)
                running[_start(sweep, case, lock)] = case
            clock.sleep(SECONDS_BETWEEN_LOOKS)
            for process in [process for process in running if process.poll() is not None]:
                case = running.pop(process)
                _end(directory(sweep, case), process.returncode)
                with tqdm.external_write_mode(file=sys.stdout):
                    say(f"case {case.name}: {state(directory(sweep, case))}", sys.stdout)
            _show(bar, sweep, running, len(cases) - len(waiting) - len(running))
        request = interrupt.request()
        if running:
            _stop(running)
    if request:
        raise StoppedError(f"the sweep was stopped by {reason(request)}; the same command continues it")


@contextlib.contextmanager
def _lock(sweep):
    """Hold the directory of the sweep; the cases inherit the lock, so that it lasts as long as one of them."""
    path = Path(sweep.run.directory) / "sweep.lock"
    with output_errors(path), open(path, "a") as file:  # noqa: SIM117 - errors of the body are not of this file
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError("run.directory", f"cases of this sweep are running in {sweep.run.directory}") from None
        yield file


def _start(sweep, case, lock):
    place = directory(sweep, case)
    environment = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", **os.environ}
    with output_errors(place / ERRORS), open(place / ERRORS, "w") as errors:
        return subprocess.Popen(
            command(sweep, case),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,  # run.log has the same lines
            stderr=errors,
            env=environment,
            pass_fds=[lock.fileno()],
            start_new_session=True,  # a signal from the terminal is for the sweep, which tells its cases
        )


def _end(place, status):
    """Note a failure that the case itself could not tell."""
    if status not in (0, EARLY_END, BEYOND_LIMITS) and state(place) == "missing":
        with output_errors(place / ERRORS), open(place / ERRORS, "a") as errors:
            errors.write(f"{FAILURE}{exit_text(status)}\n")


def exit_text(status):
    """Say how a process ended.

    Parameters
    ----------
    status : int
        Exit status; negative, or 128 more, for a signal.

    Returns
    -------
    str
    """
    number = -status if status < 0 else status - 128
    with contextlib.suppress(ValueError):
        return f"killed by {signal.Signals(number).name}"
    return f"ended with exit status {status}"


def _stop(running):
    """Ask the cases under way to write checkpoints and end; SIGUSR1, because mpirun kills after the others."""
    for process in running:
        process.send_signal(signal.SIGUSR1)
    until = clock.monotonic() + SECONDS_TO_SAVE
    for process in running:
        try:
            process.wait(max(until - clock.monotonic(), 0.0))
        except subprocess.TimeoutExpired:
            process.kill()


def _show(bar, sweep, running, ended):
    """Show the cases that ended, and how far each of those under way is."""
    parts = {case.name: _progress(directory(sweep, case), case.job.time.end) for case in running.values()}
    bar.n = ended + sum(parts.values())
    under_way = ", ".join(f"{name} {part:.0%}" for name, part in parts.items())
    bar.set_description_str(f"{ended} of {bar.total} cases ended; {under_way}")


def _progress(place, end):
    """Part of a case's simulated time that is done, by the last line of its probes."""
    try:
        with open(place / "probes.csv", "rb") as file:
            file.seek(max(os.fstat(file.fileno()).st_size - 4096, 0))
            return float(file.read().splitlines()[-1].split(b",")[0]) / end
    except (OSError, ValueError, IndexError):
        return 0.0


# In a batch system


def script(sweep, cases, kind):
    """Write a script that runs cases, each from its checkpoint if it has one then.

    Parameters
    ----------
    sweep : Sweep
    cases : list of Case
        Prepared by `prepare`.
    kind : str
        ``slurm``, an array script for sbatch, or ``shell``.

    Returns
    -------
    str

    Raises
    ------
    InputError
        If no case is missing.
    """
    if not cases:
        raise InputError("", "no case is missing; nothing is left for a script")
    places = " ".join(shlex.quote(str(directory(sweep, case))) for case in cases)
    run = shlex.join([*_launcher(sweep), sys.executable, "-m", "parmps"])
    if kind == "slurm":
        logs = shlex.quote(str(Path(sweep.run.directory) / "slurm-%a.log"))
        head = [
            f"#SBATCH --array=0-{len(cases) - 1}",
            f"#SBATCH --ntasks={sweep.run.ranks}",
            f"#SBATCH --output={logs}",
            "#SBATCH --signal=B:USR1@120  # two minutes for the checkpoint before the time limit",
            *(f"#SBATCH {option}" for option in sweep.run.slurm),
        ]
        choice = ['cases=("${cases[$SLURM_ARRAY_TASK_ID]}")']
    else:
        head = choice = []
    return SCRIPT.format(
        head="\n".join(["#!/bin/bash", *head]),
        choice="\n".join(choice),
        places=places,
        run=run,
        early=EARLY_END,
        beyond=BEYOND_LIMITS,
        failure=FAILURE,
    )


SCRIPT = """\
{head}
# Runs the cases of a sweep; those that are done are left out, those with a checkpoint continue. USR1, INT or TERM to
# this script has the case write a checkpoint and ends the script.
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
cases=({places})
{choice}
set -m  # a signal from the terminal is for this script, which tells its case
stop=
trap 'stop=1; kill -USR1 $child' USR1 INT TERM
for case in "${{cases[@]}}"; do
    grep -qs '"status": "done"' "$case/run.json" && continue
    where=--out
    [[ -f $case/checkpoint.h5 ]] && where=--restart
    {run} "$case/job.yaml" $where "$case" 2>"$case/errors.txt" &
    child=$!
    wait $child
    status=$?
    [[ $stop ]] && wait $child  # the signal ended the wait before this one, not the case
    [[ $stop || $status == {early} ]] && exit {early}
    [[ $status == 0 || $status == {beyond} ]] || grep -qs '^{failure}' "$case/errors.txt" ||
        echo "{failure}ended with exit status $status; see $case/errors.txt" >>"$case/errors.txt"
done
"""


# Results


def results(sweep, cases):
    """Measure all cases and write ``results.csv`` into the directory of the sweep.

    Parameters
    ----------
    sweep : Sweep
    cases : list of Case

    Returns
    -------
    list of str
        What became of each case, as `state` tells; a case whose measures fail is failed.

    Raises
    ------
    OutputError
        If the table cannot be written.
    """
    keys = parameters(sweep)
    names = [name for measure in sweep.measures for name in measure_names(measure)]
    units = [""] * len(names)
    rows, ends = [], []
    for case in cases:
        end, values = state(directory(sweep, case)), [""] * len(names)
        if end == "done":
            try:
                values, units = _measure(sweep, case)
            except InputError as error:
                end = f"failed: {error}"
        rows.append([case.name, *(case.values.get(key, "") for key in keys), *values, end])
        ends.append(end)
    titles = [_title(key, unit_of_key(key)) for key in keys]
    titles += [_title(name, unit) for name, unit in zip(names, units, strict=True)]
    text = io.StringIO()
    cells = [[_harmless(cell) for cell in row] for row in (["case", *titles, "status"], *rows)]
    csv.writer(text, lineterminator="\n").writerows(cells)
    write_text(results_path(sweep), text.getvalue())
    return ends


def _harmless(cell):
    """Mark a text that a spreadsheet would take for a formula as a text."""
    if not isinstance(cell, str) or not cell.startswith(FORMULA):
        return cell
    try:
        float(cell)
    except ValueError:
        return f"'{cell}"
    return cell


def results_path(sweep):
    """Where the table of results is.

    Parameters
    ----------
    sweep : Sweep

    Returns
    -------
    Path
    """
    return Path(sweep.run.directory) / "results.csv"


def _measure(sweep, case):
    """Values of all measures of a case that is done, as text, and their units."""
    time, signals = read_signals(directory(sweep, case) / "probes.csv")
    values, units = [], []
    for item in sweep.measures:
        _, unit, signal_values = find_signal(signals, item.column)
        for kind in (item.kind, *BESIDE.get(item.kind, ())):
            value = measure(kind, time, signal_values, item.begin, item.end, forcing_period(case.job.motion))
            values.append("" if math.isnan(value) else f"{value:.8g}")
            units.append(MEASURES[kind][1].format(unit))
    return values, units


def measure_names(measure):
    """Names of the columns of a measure in the table of results.

    Parameters
    ----------
    measure : parmps.sweep.Measure

    Returns
    -------
    list of str
        Its own, and those beside it.
    """
    return [measure.name, *(f"{measure.name}: {word}" for word in BESIDE.get(measure.kind, {}).values())]


def _title(name, unit):
    return f"{name} [{unit}]" if unit else name


def run_sweep(sweep, cases, retry=False):
    """Run what is missing of a sweep on this machine and write its results.

    Parameters
    ----------
    sweep : Sweep
    cases : list of Case
    retry : bool
        Whether cases that failed are to run again.

    Returns
    -------
    list of str
        As `results`.

    Raises
    ------
    InputError, OutputError, StoppedError
        As `run_here`; the results of the cases that are done are written before.
    """
    prepare(sweep, cases)
    left = missing_cases(sweep, cases, retry)
    how = f"{sweep.run.jobs} at a time on {sweep.run.ranks} rank(s) each"
    say(f"{len(cases)} cases, {len(left)} to run, {how}", sys.stdout)
    try:
        if left:
            run_here(sweep, left)
    finally:
        ends = results(sweep, cases)
    return ends
