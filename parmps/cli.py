"""The command line: ``python -m parmps JOB.yaml``, and the sub-commands."""

import argparse
import json
import re
import sys
import traceback

from parmps import __version__
from parmps.checks import job_warnings
from parmps.domain import Domain
from parmps.errors import InputError, ParmpsError
from parmps.interrupt import Interrupt
from parmps.loader import load_job
from parmps.schema import json_schema, schema_table

SECONDS_TO_END = 5.0
"""How long a rank with an error waits for the others to come to the same end before it ends them."""

RUN_HELP = """\
examples:
  mpirun -n 2 python -m parmps jobs/sloshing.yaml
  python -m parmps jobs/sloshing.yaml --out /tmp/run --set motion[0].amplitude=0.03 --set time.end=5
  python -m parmps jobs/sloshing.yaml --restart out/sloshing --set time.end=20
  srun python -m parmps jobs/sloshing.yaml --wall-limit 23:50:00

other commands (each with --help): plan, schema

exit status: 0 done, 2 bad input, 3 diverged, 4 a rank failed or an output could not be written, 5 stopped early
by SIGTERM, SIGINT, SIGUSR1 or --wall-limit. After 3 and 5 there is a checkpoint to continue from.
Options of the pressure solver go to PETSc with the prefix -ppe_, such as -ppe_ksp_monitor.
"""

PLAN_HELP = """\
examples:
  python -m parmps plan jobs/sloshing.yaml
  mpirun -n 8 python -m parmps plan jobs/sloshing.yaml       (memory and particles of each of 8 ranks)
  python -m parmps plan jobs/sloshing.yaml --set spacing=0.002 --png start.png
"""

SCHEMA_HELP = """\
examples:
  python -m parmps schema | less
  python -m parmps schema --json > job.schema.json
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
        elif word.startswith("-ppe_"):
            after = arguments[number + 1 : number + 2]
            skip = bool(after) and not after[0].startswith("-") and not after[0].endswith((".yaml", ".yml"))
        else:
            ours.append(word)
    return ours


def _parser(command, description, examples):
    prog = f"python -m parmps {command}".strip()
    return _Parser(
        prog=prog, description=description, epilog=examples, formatter_class=argparse.RawDescriptionHelpFormatter
    )


def _add_job(parser):
    parser.add_argument("job", metavar="JOB.yaml", help="job file; its keys: python -m parmps schema")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="change a key, such as motion[0].omega=6"
    )


def _run_parser():
    about = "Violent sloshing of liquids in moving tanks by the Moving Particle Semi-implicit method. Runs a job."
    parser = _parser("", about, RUN_HELP)
    parser.add_argument("--version", action="version", version=f"parmps {__version__}")
    _add_job(parser)
    parser.add_argument("--out", metavar="DIR", help="output directory, instead of the job's")
    parser.add_argument("--restart", metavar="DIR", help="continue from the checkpoint of an earlier run")
    parser.add_argument(
        "--wall-limit",
        metavar="TIME",
        type=wall_time,
        help="stop with a checkpoint after this wall time: seconds, MM:SS or HH:MM:SS; leave time for a checkpoint",
    )
    return parser


def _plan_parser():
    parser = _parser("plan", "Shows what a job would take and run; solves nothing.", PLAN_HELP)
    _add_job(parser)
    parser.add_argument("--png", metavar="FILE", help="also draw the particles at the start")
    return parser


def _schema_parser():
    parser = _parser("schema", "Prints every key of a job: type, unit, default and meaning.", SCHEMA_HELP)
    parser.add_argument("--json", action="store_true", help="print the JSON Schema, for editors")
    return parser


PARSERS = {"plan": _plan_parser, "schema": _schema_parser}


def wall_time(text):
    """Read a wall time as batch systems write it.

    Parameters
    ----------
    text : str
        Seconds, ``MM:SS`` or ``HH:MM:SS``.

    Returns
    -------
    float
        s.

    Raises
    ------
    argparse.ArgumentTypeError
        If it is none of these.
    """
    if not re.fullmatch(r"\d{1,9}(\.\d*)?|(\d{1,6}:)?\d{1,6}:\d{1,2}", text):
        raise argparse.ArgumentTypeError(f"got '{text}', must be seconds, MM:SS or HH:MM:SS")
    seconds = 0.0
    for part in text.split(":"):
        seconds = 60.0 * seconds + float(part)
    return seconds


def _arguments(words):
    """Parse the command line: the name of the command, and its arguments."""
    if words and words[0] in PARSERS:
        return words[0], PARSERS[words[0]]().parse_args(words[1:])
    return "run", _run_parser().parse_args(words)


def main():
    """Run the command line and exit with its status."""
    domain = Domain()
    try:
        command, arguments, job, error = _prepare(domain)
        if error is not None:
            raise error
        if command == "schema":
            if domain.rank == 0:
                print(json.dumps(json_schema(), indent=2) if arguments.json else schema_table())
        elif command == "plan":
            _plan(job, arguments, domain)
        else:
            _run(job, arguments, domain)
    except ParmpsError as problem:
        # Raised on all ranks alike as a rule; a file that only one rank writes may fail that rank alone.
        alone = not domain.all_end(SECONDS_TO_END)
        if domain.rank == 0 or alone:
            print(f"parmps: {problem.title}: {problem}", file=sys.stderr, flush=True)
        if alone:
            domain.abort(problem.exit_status)
        sys.exit(problem.exit_status)
    except Exception:  # noqa: BLE001 - whatever failed on this rank, the others must not wait for it
        print(f"parmps: rank {domain.rank} failed:\n{traceback.format_exc()}", file=sys.stderr, flush=True)
        domain.abort(4)


def _prepare(domain):
    """Read the command line and the job on rank 0, and tell all ranks what came of it."""
    result = None
    if domain.rank == 0:
        try:
            command, arguments = _arguments(_split(sys.argv[1:]))
            job = None
            if command != "schema":
                from parmps.tank import require_supported

                job = load_job(arguments.job, arguments.set)
                require_supported(job)
                for warning in job_warnings(job):
                    print(f"parmps: warning: {warning}", file=sys.stderr, flush=True)
            result = command, arguments, job, None
        except ParmpsError as problem:
            result = None, None, None, problem
        except SystemExit as end:  # --help and --version have printed what they had to say
            result = "exit", end.code, None, None
    result = domain.share(result)
    if result[0] == "exit":
        sys.exit(result[1])
    return result


def _plan(job, arguments, domain):
    from parmps.planning import draw_plan, plan_text

    error = None
    if domain.rank == 0:
        try:
            print(plan_text(job, domain))
            if arguments.png:
                draw_plan(job, arguments.png)
                print(f"\nThe particles at the start are drawn in {arguments.png}")
        except ParmpsError as problem:
            error = problem
    error = domain.share(error)
    if error is not None:
        raise error


def _run(job, arguments, domain):
    from parmps.run import Run

    directory = arguments.out or arguments.restart or job.output.directory
    with Interrupt(arguments.wall_limit) as interrupt:
        run = Run(job, domain, directory, interrupt, arguments.restart)
        try:
            run.go()
        finally:
            run.close()
