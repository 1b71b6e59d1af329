"""The command line: ``python -m parmps JOB.yaml``, and the sub-commands."""

import argparse
import json
import os
import re
import sys
import traceback
from functools import partial
from importlib.util import find_spec

from parmps import __version__
from parmps.errors import InputError, OutputError, ParmpsError
from parmps.interrupt import Interrupt
from parmps.loader import load_job
from parmps.report import say
from parmps.scene import Job
from parmps.schema import json_schema, schema_markdown, schema_table

SECONDS_TO_END = 5.0
"""How long a rank with an error waits for the others to come to the same end before it ends them."""

RUN_HELP = """\
examples:
  mpirun -n 2 python -m parmps job.yaml
  python -m parmps job.yaml --out out/run --set motion[0].amplitude=0.03 --set time.end=5
  python -m parmps job.yaml --restart out/job --set time.end=20
  srun python -m parmps job.yaml --wall-limit 23:50:00

other commands (each with --help): plan, sweep, plot, schema

exit status: 0 done, 2 bad input, 3 diverged, 4 a rank failed or an output could not be written, 5 stopped early
by SIGTERM, SIGINT, SIGUSR1 or --wall-limit, 6 done, but energy came from nowhere or volume was lost beyond the limits:
run.json and the log say where and when, results are kept. After 3 and 5 there is a checkpoint to continue from.
Options of the pressure solver go to PETSc with the prefix -ppe_, such as -ppe_ksp_monitor.
"""

PLAN_HELP = """\
examples:
  python -m parmps plan job.yaml
  mpirun -n 8 python -m parmps plan job.yaml       (memory and particles of each of 8 ranks)
  python -m parmps plan job.yaml --set spacing=0.002 --png start.png
"""

SCHEMA_HELP = """\
examples:
  python -m parmps schema | less
  python -m parmps schema --json > job.schema.json
  python -m parmps schema --sweep
"""

SWEEP_HELP = """\
examples:
  python -m parmps sweep sweep.yaml --jobs 2          run what is missing, two cases at a time
  python -m parmps sweep sweep.yaml --script slurm > sweep.sbatch; sbatch sweep.sbatch
  python -m parmps sweep sweep.yaml --collect         only the table and the figures

Results: results.csv and a figure a measure in the directory of the sweep, a directory with a whole run a case.
Exit status: 0 all cases done, 2 bad input, 4 some case failed (results.csv says why), 5 stopped; the same command
continues it.
"""

PLOT_HELP = """\
examples:
  python -m parmps plot probes out/job --reference measured.csv
  python -m parmps plot particles out/job --time 1.0 2.0 3.0 --field speed
  python -m parmps plot spectra out/job --begin 2
  python -m parmps plot peaks out/job
  python -m parmps plot animation out/job --format mp4
  python -m parmps plot sweep sweep.yaml
  python -m parmps plot report out/job                     (or SWEEP.yaml: one HTML page to send to a colleague)

Each has more options: python -m parmps plot probes --help. Pictures go into the directory of the results.
"""


class _Parser(argparse.ArgumentParser):
    """Tells what is wrong by `InputError`, so that one rank can speak for all."""

    def error(self, message):
        raise InputError("command line", f"{message}; see {self.prog} --help")


def _split(arguments):
    """Separate PETSc's options, a name and perhaps a value, from the others."""
    ours, skip = [], False
    for number, word in enumerate(arguments):
        if skip:
            skip = False
        elif word.startswith(("-ppe_", "-viscosity_")):
            after = arguments[number + 1 : number + 2]
            skip = bool(after) and re.fullmatch(r"-[^\d.].*|.*\.ya?ml", after[0]) is None
        else:
            ours.append(word)
    return ours


def _program():
    """How the program was started."""
    return "parmps" if os.path.basename(sys.argv[0]) == "parmps" else "python -m parmps"


def _parser(command, description, examples):
    return _Parser(
        prog=f"{_program()} {command}".strip(),
        description=description,
        epilog=examples.replace("python -m parmps", _program()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


def _add_job(parser):
    parser.add_argument("job", metavar="JOB.yaml", help=f"job file; its keys: {_program()} schema")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="change a key, such as motion[0].omega=6"
    )


def _run_parser():
    about = "Violent sloshing of liquids in moving tanks by the Moving Particle Semi-implicit method. Runs a job."
    parser = _parser("", about, RUN_HELP)
    parser.add_argument("--version", action="version", version=f"parmps {__version__}")
    _add_job(parser)
    parser.add_argument("--out", metavar="DIR", help="output directory, instead of the job's")
    parser.add_argument(
        "--restart",
        metavar="DIR",
        type=run_directory,
        help="continue from that run's checkpoint, DIR/checkpoint.h5, there or in --out",
    )
    parser.add_argument(
        "--force", action="store_true", help="run even if more memory or disk is needed than this machine has"
    )
    parser.add_argument(
        "--wall-limit",
        metavar="TIME",
        type=wall_time,
        help="stop with a checkpoint after this wall time: seconds, MM:SS, HH:MM:SS or D-HH:MM:SS; leave time for a "
        "checkpoint",
    )
    return parser


def _plan_parser():
    parser = _parser("plan", "Shows what a job would take and run; solves nothing.", PLAN_HELP)
    _add_job(parser)
    parser.add_argument("--png", metavar="FILE", help="also draw the particles at the start")
    return parser


def _schema_parser():
    parser = _parser("schema", "Prints every key of a job: type, unit, default and meaning.", SCHEMA_HELP)
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print the JSON Schema, for editors")
    form.add_argument("--markdown", action="store_true", help="print a table, as in the README")
    parser.add_argument("--sweep", action="store_true", help="the keys of a sweep file instead")
    return parser


def _sweep_parser():
    parser = _parser("sweep", "Runs a base job with changed values, case by case; one table of results.", SWEEP_HELP)
    parser.add_argument("sweep", metavar="SWEEP.yaml", help=f"sweep file; its keys: {_program()} schema --sweep")
    parser.add_argument("--jobs", type=_count, metavar="N", help="cases at a time, instead of the file's")
    parser.add_argument("--ranks", type=_count, metavar="N", help="MPI ranks of each case, instead of the file's")
    parser.add_argument("--retry", action="store_true", help="run the cases that failed again")
    parser.add_argument("--script", choices=("slurm", "shell"), help="run nothing, print a script of the missing cases")
    parser.add_argument("--collect", action="store_true", help="run nothing, only collect the results there are")
    return parser


def _plot_parser():
    from parmps.figures.command import add_commands

    parser = _parser("plot", "Draws the results of a run or a sweep.", PLOT_HELP)
    add_commands(parser)
    return parser


def _count(text):
    if not text.isdecimal() or not 1 <= int(text[:9]) <= 100_000:
        raise argparse.ArgumentTypeError(f"got '{text}', must be a whole number from 1 to 100000")
    return int(text)


PARSERS = {"plan": _plan_parser, "schema": _schema_parser, "sweep": _sweep_parser, "plot": _plot_parser}
ALONE = ("sweep", "plot")
"""Commands of one process, which never starts MPI: children with MPI could not start from it."""


def wall_time(text):
    """Read a wall time as batch systems write it.

    Parameters
    ----------
    text : str
        Seconds, ``MM:SS``, ``HH:MM:SS``, or with days ``D-HH``, ``D-HH:MM`` or ``D-HH:MM:SS``.

    Returns
    -------
    float
        s.

    Raises
    ------
    argparse.ArgumentTypeError
        If it is none of these.
    """
    days, dash, rest = text.rpartition("-")
    pattern = r"\d{1,2}(:\d{1,2}){0,2}" if dash else r"\d{1,9}(\.\d*)?|(\d{1,6}:)?\d{1,6}:\d{1,2}"
    if not (re.fullmatch(r"\d{1,6}" if dash else "", days, re.ASCII) and re.fullmatch(pattern, rest, re.ASCII)):
        raise argparse.ArgumentTypeError(f"got '{text}', must be seconds, MM:SS or HH:MM:SS, or D-HH:MM:SS with days")
    parts = rest.split(":")
    if dash:
        parts += ["0"] * (3 - len(parts))
    seconds = 0.0
    for part in parts:
        seconds = 60.0 * seconds + float(part)
    return 86400.0 * float(days or 0.0) + seconds


def run_directory(text):
    """Directory of the run that is meant.

    Parameters
    ----------
    text : str
        The directory, or the checkpoint in it.

    Returns
    -------
    str
    """
    return (os.path.dirname(text) or ".") if os.path.basename(text) == "checkpoint.h5" else text


def _arguments(words):
    """Parse the command line: the name of the command, which ``run`` need not be, and its arguments."""
    if words and words[0] in PARSERS:
        return words[0], PARSERS[words[0]]().parse_args(words[1:])
    return "run", _run_parser().parse_args(words[1:] if words[:1] == ["run"] else words)


def _print_anything():
    """Have characters that the encoding of the standard output lacks replaced: titles and paths may hold any."""
    if sys.stdout is not None:
        sys.stdout.reconfigure(errors="replace")  # the standard error writes their numbers


def _open_standard_streams():
    """Give those that were closed at the start a file that takes all, so that no result takes their numbers."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest number that is free
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, "w" if number else "r"))  # noqa: SIM115 - for the life of the process


def main():
    """Run the command line and exit with its status."""
    _open_standard_streams()
    _print_anything()
    if sys.argv[1:2] and sys.argv[1] in ALONE:
        sys.exit(_main_alone())
    from parmps.domain import Domain

    domain = Domain()
    try:
        command, arguments, job, error = _prepare(domain)
        if error is not None:
            raise error
        if command == "schema":
            if domain.rank == 0:
                _print_schema(arguments)
        elif command == "plan":
            _plan(job, arguments, domain)
        else:
            _run(job, arguments, domain)
    except ParmpsError as problem:
        # Raised on all ranks alike as a rule; a file that only one rank writes may fail that rank alone.
        alone = not domain.all_end(SECONDS_TO_END)
        if domain.rank == 0 or alone:
            _tell(problem)
        if alone:
            domain.abort(problem.exit_status)
        sys.exit(problem.exit_status)
    except Exception:  # noqa: BLE001 - whatever failed on this rank, the others must not wait for it
        say(f"parmps: rank {domain.rank} failed:\n{traceback.format_exc()}", sys.stderr)
        domain.abort(4)


def _main_alone():
    """Run a command of one process; its exit status."""
    try:
        if int(os.environ.get("OMPI_COMM_WORLD_SIZE", os.environ.get("PMI_SIZE", "1"))) > 1:
            raise InputError("command line", f"{sys.argv[1]} starts its own ranks; run it without mpirun")
        command, arguments = _arguments(sys.argv[1:])
        return _sweep(arguments) if command == "sweep" else arguments.draw(arguments)
    except ParmpsError as problem:
        _tell(problem)
        return problem.exit_status


def _tell(problem):
    say(f"parmps: {problem.title}: {problem}", sys.stderr)


def _print(text):
    """Print what was asked for; a reader such as `head` may have seen enough of it."""
    problem = say(text, sys.stdout)
    if problem is not None and not isinstance(problem, BrokenPipeError):
        raise OutputError("standard output", problem.strerror)


def _print_schema(arguments):
    from parmps.sweep import Sweep

    model = Sweep if arguments.sweep else Job
    if arguments.json:
        _print(json.dumps(json_schema(model), indent=2))
    else:
        _print(schema_markdown(model) if arguments.markdown else schema_table(model))


def _sweep(arguments):
    from parmps import campaign
    from parmps.sweep import load_sweep

    counts = {name: value for name in ("jobs", "ranks") if (value := getattr(arguments, name)) is not None}
    sweep, cases = load_sweep(arguments.sweep, counts)
    if arguments.script:
        campaign.prepare(sweep, cases)
        _print(campaign.script(sweep, campaign.missing_cases(sweep, cases, arguments.retry), arguments.script))
        return 0
    run = campaign.results if arguments.collect else partial(campaign.run_sweep, retry=arguments.retry)
    ends = run(sweep, cases)
    if find_spec("matplotlib"):
        from parmps.figures.charts import save_sweep

        drawn = [picture.stem for picture in save_sweep(sweep)]
        empty = [measure.name for measure in sweep.measures if measure.name not in drawn]
        if empty and "done" in ends:
            why = "peaks need at least one whole cycle in the window"
            say(f"no case has a value of {', '.join(empty)}: {why}", sys.stdout)
    else:
        say("no figures were drawn: that needs matplotlib", sys.stdout)
    done = ends.count("done")
    failed = [f"case {case.name} {end}" for case, end in zip(cases, ends, strict=True) if end.startswith("failed")]
    end = f"{done} of {len(cases)} cases are done; results are in {campaign.results_path(sweep)}"
    say("\n".join([*failed, end]), sys.stdout)
    return 4 if failed else 0


def _prepare(domain):
    """Read the command line and the job on rank 0, and tell all ranks what came of it."""
    from parmps.cautions import cautions

    result = None
    if domain.rank == 0:
        try:
            command, arguments = _arguments(_split(sys.argv[1:]))
            job = None
            if command != "schema":
                job = load_job(arguments.job, arguments.set)
                _check_restart(getattr(arguments, "restart", None))
                for warning in cautions(job):
                    say(f"parmps: warning: {warning}", sys.stderr)
            result = command, arguments, job, None
        except ParmpsError as problem:
            result = None, None, None, problem
        except SystemExit as end:  # --help and --version have printed what they had to say
            result = "exit", end.code, None, None
    result = domain.share(result)
    if result[0] == "exit":
        sys.exit(result[1])
    return result


def _check_restart(directory):
    if directory is not None and not os.path.exists(os.path.join(directory, "checkpoint.h5")):
        raise InputError("command line", f"--restart {directory}: there is no checkpoint.h5 to continue from")


def _on_main(domain, action):
    """Do something on rank 0 alone; its error is raised on all ranks."""
    error = None
    if domain.rank == 0:
        try:
            action()
        except ParmpsError as problem:
            error = problem
    error = domain.share(error)
    if error is not None:
        raise error


def _plan(job, arguments, domain):
    from parmps.planning import plan_text

    def tell():
        _print(plan_text(job, domain))
        if arguments.png:
            from parmps.figures.start import draw_plan

            _print(f"\nThe particles at the start are drawn in {draw_plan(job, arguments.png)}")

    _on_main(domain, tell)


def _check_machine(job, domain, directory, goes_on):
    from parmps.output import RESULT_FILES
    from parmps.planning import check_machine

    here, kept = domain.ranks_here(), 0
    if goes_on:
        files = [os.path.join(directory, name) for name in RESULT_FILES]
        kept = sum(512 * os.stat(file).st_blocks for file in files if os.path.exists(file))
    _on_main(domain, lambda: check_machine(job, domain.size, here, directory, kept))


def _run(job, arguments, domain):
    from parmps.run import Run

    directory = arguments.out or arguments.restart or job.output.directory
    if not arguments.force:
        _check_machine(job, domain, directory, arguments.restart is not None)
    with Interrupt(arguments.wall_limit) as interrupt:
        run = Run(job, domain, directory, arguments.restart, interrupt)
        try:
            run.go()
        finally:
            run.close()
