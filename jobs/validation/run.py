"""Validation: run the cases, measure their errors, write a report (``make validate``).

usage: python jobs/validation/run.py [CASE ...] [--preset P ...] [--spacing S ...] [--variant V ...] [--quick]
           [--report]

A case is a directory with ``case.yaml``, the job; ``README.md``; reference data if there are any; and ``case.py``:

- ``TITLE``; ``SPACINGS``, coarsest first, of which ``--quick`` takes the first alone;
- ``VARIANTS``: by name, what ``--set`` changes (optional); ``NOT_IN_PAPERS``: those that `papers` refuses (optional);
- ``TARGETS``: by measure, the largest error of `accurate`, one for all spacings or one each, perhaps by variant;
  `balanced` is allowed 1.5 times as much;
- ``measure(results)``: the errors of a run by name; ``plot(figure, runs)``: the picture;
- ``initial(job)``: position and velocity of the liquid at the start, (n, 3), and numbers of the liquids if there are
  several, (n,), or None for those of the job (optional).

A run is kept in out/validation until the code, the job or its settings change, so that a stopped validation goes on
where it was. Each case's part of the report is <case>/results.md, from all of its runs that are kept; together they
are jobs/validation/results.md. Runs are on one rank; CPU-seconds are those of the time loop, without the start-up.
"""

import argparse
import hashlib
import importlib.util
import json
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
OUT = ROOT / "out" / "validation"
PRESETS = ("papers", "fast", "balanced", "accurate")
ALLOWANCE = {"accurate": 1.0, "balanced": 1.5}
"""Share of the target that a preset may use; the others are told without a verdict."""

sys.path[:0] = [str(ROOT), str(HERE), str(HERE.parent)]

import h5py  # noqa: E402
import matplotlib  # noqa: E402

matplotlib.use("Agg")
from matplotlib import pyplot  # noqa: E402
from provenance import processor  # noqa: E402
from results import Results  # noqa: E402

from parmps.loader import load_job  # noqa: E402


def load_case(name):
    """Import the module of a case.

    Parameters
    ----------
    name : str
        Directory under jobs/validation.

    Returns
    -------
    module
    """
    spec = importlib.util.spec_from_file_location(f"case_{name}", HERE / name / "case.py")
    case = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(case)
    return case


def code_key():
    """Hash of the solver's code."""
    digest = hashlib.sha256()
    for path in sorted((ROOT / "parmps").rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def initial_state(case, job):
    """Position and velocity that a case wants at the start; empty for those of the job.

    Parameters
    ----------
    case : module
    job : parmps.scene.Job

    Returns
    -------
    tuple of (n, 3) float64
    """
    return (case.initial(job) if hasattr(case, "initial") else None) or ()


def write_state(state, directory):
    """Write an initial state into a directory.

    Parameters
    ----------
    state : tuple of (n, 3) float64
        As returned by `initial_state`.
    directory : Path

    Returns
    -------
    list of str
        What ``--set`` needs.
    """
    if not state:
        return []
    with h5py.File(directory / "state.h5", "w") as file:
        for name, values in zip(("position", "velocity", "fluid"), state, strict=False):
            file[name] = values
    return [f"initial={{kind: file, path: {directory / 'state.h5'}}}"]


class Kept:
    """A run of a case, kept in a directory together with the key of what it was run from.

    Parameters
    ----------
    name : str
    case : module
    variant, preset : str
    spacing : float
        m.
    changes : sequence of str, optional
        More settings, as for ``--set``.
    label : str, optional
        What tells a run with changes from others; in the name of its directory.
    """

    def __init__(self, name, case, variant, preset, spacing, changes=(), label=""):
        self.name, self.case = name, case
        self.variant, self.preset, self.spacing = variant, preset, spacing
        self.directory = OUT / name / "-".join(filter(None, [label, variant, preset, f"{spacing:g}"]))
        self.job = HERE / name / "case.yaml"
        self.overrides = [f"spacing={spacing:g}", f"scheme.preset={preset}", *variants(case)[variant]]
        self.overrides += changes
        self.state = initial_state(case, load_job(self.job, self.overrides))
        sources = [self.job.read_bytes(), repr(self.overrides).encode(), *(array.tobytes() for array in self.state)]
        self.key = hashlib.sha256(b"".join([code_key().encode(), *sources])).hexdigest()

    @property
    def status(self):
        """``done``, or why there is no result; None if it has not been run as things are now."""
        mark = self.directory / "validation.json"
        kept = json.loads(mark.read_text()) if mark.is_file() else {"key": None}
        return kept["status"] if kept["key"] == self.key else None

    def run(self, limit):
        """Run it, for so many seconds at most."""
        shutil.rmtree(self.directory, ignore_errors=True)
        self.directory.mkdir(parents=True)
        overrides = self.overrides + write_state(self.state, self.directory)
        command = [sys.executable, "-m", "parmps", self.job, "--out", self.directory]
        command += [f"--set={override}" for override in overrides]
        print(f"{self.directory.relative_to(OUT)} ...", end=" ", flush=True)
        env = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
        try:
            done = subprocess.run(command, env=env, capture_output=True, text=True, check=False, timeout=limit)
            status = _status(done, self.directory)
        except subprocess.TimeoutExpired:
            status = f"stopped after {limit:g} s"
        print(status, flush=True)
        (self.directory / "validation.json").write_text(json.dumps({"key": self.key, "status": status}))


def _status(done, directory):
    """What became of a run; one that diverged did so after its last sample."""
    if done.returncode == 0:
        return "done"
    if done.returncode == 6:
        return f"done, {done.stderr.strip().splitlines()[-1].removeprefix('parmps: ')}"
    if done.returncode == 3:
        last = (directory / "probes.csv").read_text().splitlines()[-1].split(",")[0]
        return f"diverged after t = {last} s"
    return f"exit status {done.returncode}: {done.stderr.strip().splitlines()[-1]}"


def variants(case):
    """The variants of a case: name to overrides; one without a name if it has none."""
    return getattr(case, "VARIANTS", {"": []})


def target(run, measure):
    """Target of a measure in a run, or None.

    Parameters
    ----------
    run : Kept
    measure : str

    Returns
    -------
    float or None
    """
    found = getattr(run.case, "TARGETS", {}).get(measure)
    if isinstance(found, dict):
        found = found.get(run.variant)
    return found[run.case.SPACINGS.index(run.spacing)] if isinstance(found, tuple) else found


def observed_order(spacings, errors):
    """Slope of log error over log spacing, least squares; None with fewer than two errors.

    Parameters
    ----------
    spacings, errors : sequence of float

    Returns
    -------
    float or None
    """
    points = [(math.log(s), math.log(abs(e))) for s, e in zip(spacings, errors, strict=True) if e]
    if len(points) < 2:
        return None
    mean = [sum(axis) / len(points) for axis in zip(*points, strict=True)]
    across = sum((x - mean[0]) ** 2 for x, _ in points)
    return sum((x - mean[0]) * (y - mean[1]) for x, y in points) / across


def section(name, case, runs, measures):
    """The part of the report about one case.

    Parameters
    ----------
    name : str
    case : module
    runs : list of Kept
    measures : dict of Kept to (dict, Results)
        Errors by name, and the results, of the runs that are done.

    Returns
    -------
    list of str
        Lines of Markdown.
    """
    names = list(dict.fromkeys(key for found, _ in measures.values() for key in found))
    titles = [*(["variant"] if "" not in variants(case) else []), "spacing", "preset", *names, "CPU s", "steps"]
    lines = [f"## {case.TITLE}", "", f"Method and reference: [{name}](README.md). {provenance()}", ""]
    lines += ["| " + " | ".join(titles) + " |", "|---" * len(titles) + "|"]
    for run in runs:
        cells = [*([run.variant] if run.variant else []), f"{run.spacing:g} m", run.preset]
        if run in measures:
            found, results = measures[run]
            cells += [_cell(run, key, found.get(key)) for key in names]
            cells += [f"{results.record['cpu_seconds']:.1f}", str(results.record["steps"])]
        else:
            cells += [run.status, *[""] * (len(titles) - len(cells) - 1)]
        lines.append("| " + " | ".join(cells) + " |")
    return [*lines, "", *_orders(case, names, measures), f"![{case.TITLE}](picture.png)", ""]


def _cell(run, key, value):
    if value is None:
        return ""
    bound = target(run, key)
    text = f"{value:.3g}"
    if bound is None or run.preset not in ALLOWANCE:
        return text
    allowed = bound * ALLOWANCE[run.preset]
    return f"{text} (of {allowed:.3g})" if abs(value) <= allowed else f"**{text}** (over {allowed:.3g})"


def _orders(case, names, measures):
    """Lines with the observed order of convergence of the measures that have a target."""
    lines = []
    for variant in variants(case):
        for preset in PRESETS:
            mine = [run for run in measures if (run.variant, run.preset) == (variant, preset)]
            orders = {
                key: observed_order([run.spacing for run in mine], [measures[run][0].get(key) for run in mine])
                for key in names
                if key in getattr(case, "TARGETS", {})
            }
            told = ", ".join(f"{key.split(' [')[0]} {order:.1f}" for key, order in orders.items() if order is not None)
            if told:
                lines.append(f"- observed order, {' '.join(filter(None, [variant, preset]))}: {told}")
    return [*lines, ""] if lines else []


def provenance():
    """With what code and on what machine."""
    git = ["git", "-C", ROOT, "log", "-1", "--format=%h", "--", "parmps"]
    commit = subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip()
    return f"Solver at commit {commit}, one rank, {processor()}."


def combinations(case):
    """Variants, presets and spacings of a case, in the order of the report."""
    refused = getattr(case, "NOT_IN_PAPERS", ())
    return [
        (variant, preset, spacing)
        for variant in variants(case)
        for spacing in case.SPACINGS
        for preset in PRESETS
        if preset != "papers" or variant not in refused
    ]


def run_case(name, options):
    """Run what the options choose of a case, and write its part of the report from all runs that are kept.

    Parameters
    ----------
    name : str
    options : argparse.Namespace
    """
    case = load_case(name)
    runs = [Kept(name, case, *combination) for combination in combinations(case)]
    for run in runs:
        wanted = (
            run.preset in (options.preset or PRESETS)
            and run.spacing in (options.spacing or case.SPACINGS[: 1 if options.quick else None])
            and run.variant in (options.variant or variants(case))
        )
        if wanted and run.status is None and not options.report:
            run.run(options.limit)
    runs = [run for run in runs if run.status]
    finished = {run: Results(run.directory) for run in runs if run.status == "done"}
    measures = {run: (case.measure(results), results) for run, results in finished.items()}
    if not measures:
        return
    figure = pyplot.figure(figsize=(9.0, 6.0), layout="constrained")
    case.plot(figure, {(run.variant, run.preset, run.spacing): results for run, results in finished.items()})
    figure.savefig(HERE / name / "picture.png", dpi=100)
    pyplot.close(figure)
    (HERE / name / "results.md").write_text("\n".join(section(name, case, runs, measures)))


HEAD = """# Validation

Written by `make validate`. Errors in bold miss their target, which `accurate` has to meet and `balanced` to meet
within 1.5 times. CPU-seconds are those of the time loop; other programs ran on the machine at the same time.
"""


def main():
    """Run the command line."""
    names = sorted(path.parent.name for path in HERE.glob("*/case.py"))
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"of {', '.join(names)}; all by default")
    parser.add_argument("--preset", action="append", choices=PRESETS, help="all four by default")
    parser.add_argument("--spacing", action="append", type=float, help="of those of the cases; all by default")
    parser.add_argument("--variant", action="append", help="of those of the cases; all by default")
    parser.add_argument("--quick", action="store_true", help="only the coarsest spacing")
    parser.add_argument("--report", action="store_true", help="run nothing, only report the runs that are kept")
    parser.add_argument("--limit", type=float, default=3600.0, help="seconds a run may take")
    options = parser.parse_args()
    unknown = set(options.cases) - set(names)
    if unknown:
        parser.error(f"no such case: {', '.join(sorted(unknown))}; there are {', '.join(names)}")
    for name in options.cases or names:
        run_case(name, options)
    written = [name for name in names if (HERE / name / "results.md").is_file()]
    # their links are relative to the case
    parts = [(HERE / name / "results.md").read_text().replace("](", f"]({name}/") for name in written]
    (HERE / "results.md").write_text("\n".join([HEAD, *parts]))


if __name__ == "__main__":
    main()
