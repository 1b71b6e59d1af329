"""The command line: ``python -m parmps JOB.yaml``, and the sub-commands plan and schema."""

import argparse
import json
import sys
import traceback

from parmps import __version__
from parmps.checks import job_warnings
from parmps.domain import Domain
from parmps.errors import InputError, ParmpsError
from parmps.loader import load_job
from parmps.schema import json_schema, schema_table

EPILOG = """\
examples:
  mpirun -n 2 python -m parmps jobs/sloshing.yaml
  python -m parmps jobs/sloshing.yaml --out /tmp/run --set motion[0].amplitude=0.03 --set time.end=5
  python -m parmps jobs/sloshing.yaml --restart out/sloshing --set time.end=20
  python -m parmps plan jobs/sloshing.yaml --png start.png
  python -m parmps schema

exit status: 0 done, 2 bad input, 3 diverged, 4 a rank failed or an output could not be written.
Options of the pressure solver go to PETSc with the prefix -ppe_, such as -ppe_ksp_monitor.
"""


class _Parser(argparse.ArgumentParser):
    """Tells what is wrong by `InputError`, so that one rank can speak for all."""

    def error(self, message):
        raise InputError("command line", f"{message}; see python -m parmps --help")


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


def _arguments(words):
    parser = _Parser(
        prog="python -m parmps",
        description="Violent sloshing of liquids in moving tanks by the Moving Particle Semi-implicit method.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"parmps {__version__}")
    command = words[0] if words and words[0] in ("plan", "schema") else "run"
    if command == "schema":
        parser.add_argument("command", choices=["schema"])
        parser.add_argument("--json", action="store_true", help="print the JSON Schema, for editors")
        return command, parser.parse_args(words)
    if command == "plan":
        parser.add_argument("command", choices=["plan"], help="show what would run; solves nothing")
    parser.add_argument("job", metavar="JOB.yaml", help="job file, or plan JOB.yaml, or schema")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="change a key of the job")
    if command == "plan":
        parser.add_argument("--png", metavar="FILE", help="also draw the particles at the start")
    if command == "run":
        parser.add_argument("--out", metavar="DIR", help="output directory, instead of the job's")
        parser.add_argument("--restart", metavar="DIR", help="continue from the checkpoint of an earlier run")
    return command, parser.parse_args(words)


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
        # Raised on all ranks alike, so that all come here and none waits for another.
        if domain.rank == 0:
            print(f"parmps: error: {problem}", file=sys.stderr, flush=True)
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

                overrides = list(arguments.set)
                job = load_job(arguments.job, overrides)
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
    run = Run(job, domain, directory, arguments.restart)
    try:
        run.go()
    finally:
        run.close()
