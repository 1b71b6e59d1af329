"""A sweep: a base job and the values that its cases change, as a validated model of ``SWEEP.yaml``.

The keys of a sweep file are declared here and nowhere else, with the same means as those of a job.
"""

import itertools
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, model_validator

from parmps.errors import InputError
from parmps.fields import Command, Name, Number, Option, Section, setting, show, validated
from parmps.loader import parse_job, read_text, read_yaml
from parmps.scene import InputPath, Job
from parmps.signals import MEASURES

MAX_CASES = 10_000

NAME = "name"
"""What a case, or a value, may have beside what it changes, for tables and figures."""

Key = Annotated[str, Field(min_length=1, max_length=200)]
Values = dict[Key, Any]
Range = Annotated[tuple[Number, ...], Field(min_length=2, max_length=2)]


class Sample(Section):
    """A Latin-hypercube sample of several keys."""

    count: int = setting("number of cases", ge=1, le=MAX_CASES, strict=True)
    seed: int = setting("seed of the random numbers; the same seed gives the same cases", default=1, ge=0, strict=True)
    ranges: Annotated[dict[Key, Range], Field(min_length=1)] = setting("[least, greatest] value of each key of the job")


class Measure(Section):
    """One number a case: a column of results.csv and a figure."""

    name: Name = setting("name of the measure, in results.csv and as the title of its figure")
    column: Annotated[str, Field(min_length=1, max_length=200)] = setting("column of probes.csv, such as P1 or load.Fx")
    kind: Literal[tuple(MEASURES)] = setting(", ".join(f"{kind}: {what}" for kind, (what, _, _) in MEASURES.items()))
    begin: Number = setting("start of the window", "s", 0.0, ge=0)
    end: Number | None = setting("end of the window; null: the end of the run", "s", None)
    reference: InputPath | None = setting(
        "CSV file drawn beside the results, relative to the sweep file: columns of varied keys, then the measure",
        default=None,
    )


class Runs(Section):
    """Where and how the cases run."""

    directory: InputPath = setting(
        "directory of the cases and results.csv, relative to the sweep file; left out: out/ and the sweep file's name",
        default="out/sweep",
        validate_default=True,
    )
    jobs: int = setting("cases that run at a time", default=1, ge=1, le=1000, strict=True)
    ranks: int = setting("MPI ranks of each case", default=1, ge=1, le=100_000, strict=True)
    launcher: Command | None = setting(
        "command that starts the ranks, such as srun --mpi=pmix or mpirun -n 4 --bind-to core; null: mpirun",
        default=None,
    )
    slurm: Annotated[tuple[Option, ...], Field(max_length=50)] = setting(
        "options of sbatch for the array script, such as --time=02:00:00", default=()
    )


class Sweep(Section):
    """A whole sweep file; build one with `load_sweep`."""

    title: str = setting("what the sweep is about", default="", max_length=500)
    job: InputPath = setting("job file that all cases start from, relative to the sweep file")
    set: Values = setting("values that all cases have: key of the job and value", default_factory=dict)
    grid: dict[Key, Annotated[tuple[Any, ...], Field(min_length=1)]] | None = setting(
        "values of each key; the cases are all combinations. {name: one baffle, value: [...]} is a value with a name "
        "for tables and figures",
        default=None,
    )
    list: Annotated[tuple[Values, ...], Field(min_length=1, max_length=MAX_CASES)] | None = setting(
        "the cases one by one, each with its keys and values, and perhaps a name for tables and figures", default=None
    )
    sample: Sample | None = setting("a Latin-hypercube sample", default=None)
    measures: Annotated[tuple[Measure, ...], Field(max_length=100)] = setting("what to measure in a case", default=())
    run: Runs = setting("where and how the cases run", default_factory=dict, validate_default=True)

    @model_validator(mode="before")
    @classmethod
    def _name_directory_after_sweep_file(cls, data, info: ValidationInfo):
        if not isinstance(data, dict):
            return data
        run = {} if data.get("run") is None else data["run"]
        if not isinstance(run, dict) or "directory" in run:
            return data
        return {**data, "run": {**run, "directory": f"out/{info.context['file'].stem}"}}

    @model_validator(mode="after")
    def _consistent(self):
        given = [name for name in ("grid", "list", "sample") if getattr(self, name) is not None]
        if len(given) != 1:
            raise InputError("sweep", f"got {' and '.join(given) or 'none'}, must have one of grid, list and sample")
        names = [measure.name for measure in self.measures]
        for number, name in enumerate(names):
            if name in names[:number]:
                raise InputError(f"measures[{number}].name", f"'{name}' is taken; names must be unique")
        _check_names([values.get(NAME) for values in self.list or ()], "list[{}].name")
        for key, values in (self.grid or {}).items():
            _check_names([value[NAME] if _has_name(value) else None for value in values], f"grid.{key}[{{}}].name")
        return self


def _check_names(names, key):
    """Refuse names of values or cases that are no short texts, or not unique; None is no name."""
    for number, name in enumerate(names):
        if name is None:
            continue
        if not isinstance(name, str) or not 1 <= len(name) <= 100 or not name.isprintable():
            raise InputError(key.format(number), f"got {show(name)}, must be a text of 1 to 100 characters")
        if name in names[:number]:
            raise InputError(key.format(number), f"'{name}' is taken; names must be unique")


def _has_name(value):
    """Whether a value of a grid is a mapping of a name and the value proper."""
    return isinstance(value, dict) and set(value) == {NAME, "value"}


@dataclass(frozen=True)
class Case:
    """One case of a sweep.

    Attributes
    ----------
    name : str
        Its number, and the name of its directory.
    values : dict
        Values of the keys that vary, by key, or their names; and the name of the case, if it has one.
    job : Job
    """

    name: str
    values: dict
    job: Job


def load_sweep(path, counts=None):
    """Read and validate a sweep file and the jobs of all its cases.

    Parameters
    ----------
    path : path-like
        YAML sweep file.
    counts : dict of str to int, optional
        ``jobs`` and ``ranks`` in place of the file's.

    Returns
    -------
    sweep : Sweep
    cases : list of Case

    Raises
    ------
    InputError
        One message that names the first offending key, of the sweep or of a case's job.
    """
    file = Path(path).absolute()
    data = read_yaml(read_text(path), str(path))
    if not isinstance(data, dict):
        raise InputError("", f"{path}: got {show(data)}, must be a mapping of keys such as job, grid and measures")
    sweep = validated(Sweep, data, context={"file": file})
    sweep = sweep.model_copy(update={"run": sweep.run.model_copy(update=counts or {})})
    return sweep, _cases(sweep)


def parameters(sweep):
    """Keys of the job that the cases of a sweep change.

    Parameters
    ----------
    sweep : Sweep

    Returns
    -------
    list of str
        In the order of the file, after the name, if cases have names.
    """
    if sweep.list is not None:
        keys = dict.fromkeys(key for values in sweep.list for key in values)
        return sorted(keys, key=lambda key: key != NAME)  # the name first
    return list(sweep.grid if sweep.grid is not None else sweep.sample.ranges)


def _combinations(sweep):
    """Values of the varied keys, case by case."""
    if sweep.list is not None:
        return list(sweep.list)
    if sweep.grid is not None:
        count = 1
        for values in sweep.grid.values():
            count *= len(values)
        if count > MAX_CASES:
            raise InputError("grid", f"has {count} combinations, must be at most {MAX_CASES}")
        return [dict(zip(sweep.grid, values, strict=True)) for values in itertools.product(*sweep.grid.values())]
    low, high = zip(*sweep.sample.ranges.values(), strict=True)
    for key, (least, greatest) in sweep.sample.ranges.items():
        if least >= greatest:
            raise InputError(f"sample.ranges.{key}", f"got {least:g} to {greatest:g}, the first must be the lower")
    from scipy.stats import qmc  # here, since it takes as long to import as everything else together

    # McKay, Beckman & Conover 1979; six digits are enough to tell cases apart and can be read
    points = qmc.scale(qmc.LatinHypercube(len(low), seed=sweep.sample.seed).random(sweep.sample.count), low, high)
    return [
        {key: float(f"{value:.6g}") for key, value in zip(sweep.sample.ranges, point, strict=True)} for point in points
    ]


def _cases(sweep):
    """Build and validate the jobs of all cases."""
    text, file = read_text(sweep.job), Path(sweep.job)
    combinations = _combinations(sweep)
    digits = max(3, len(str(len(combinations))))
    cases = []
    for number, values in enumerate(combinations, start=1):
        name = f"{number:0{digits}}"
        place = {"output.directory": str(Path(sweep.run.directory) / name)}
        changes = {key: value["value"] if _has_name(value) else value for key, value in values.items() if key != NAME}
        title = {"title": values[NAME]} if values.get(NAME) else {}  # by which pictures tell runs apart
        settings = {**title, **sweep.set, **changes, **place}
        overrides = [f"{key}={json.dumps(value)}" for key, value in settings.items()]
        try:
            job = parse_job(text, overrides, file=file, source=sweep.job)
            _check_measures(sweep, job)
        except InputError as error:
            raise InputError("", f"case {name} ({show(values, 200)}): {error}") from None
        shown = {key: value[NAME] if _has_name(value) else value for key, value in values.items()}
        cases.append(Case(name, shown, job))
    return cases


def _check_measures(sweep, job):
    """Refuse a measure of what no probe of the job will write, or of a time that it will not reach."""
    names = [probe.name for probe in job.probes]
    for number, measure in enumerate(sweep.measures):
        key, column = f"measures[{number}]", measure.column.split(" [")[0]
        if not any(column == name or column.startswith(f"{name}.") for name in names):
            allowed = ", ".join(names) or "none: the job has no probes"
            raise InputError(f"{key}.column", f"got '{measure.column}', must be of a probe of the job: {allowed}")
        end = job.time.end if measure.end is None else measure.end
        if end > job.time.end:
            raise InputError(f"{key}.end", f"got {end:g} s, must be within the run of {job.time.end:g} s")
        if measure.begin >= end:
            raise InputError(f"{key}.begin", f"got {measure.begin:g} s, must be before the window ends at {end:g} s")
