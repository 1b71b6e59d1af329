"""Sweeps: what their files may say, how cases run, fail, stop and go on, and what the table says of them."""

import contextlib
import csv
import multiprocessing
import signal
import subprocess
import sys
import time
from importlib import util
from pathlib import Path

import numpy as np
import pytest
from test_cli import ENVIRONMENT, JOB

from parmps import campaign, cli
from parmps.errors import InputError, OutputError
from parmps.figures.charts import draw_measure, draw_sweep
from parmps.figures.page import sweep_sections, write_html
from parmps.lock import DirectoryLock
from parmps.schema import json_schema, schema_table, unit_of_key
from parmps.signals import measure, read_signals
from parmps.sweep import Sweep, load_sweep

SWEEPS = sorted((Path(__file__).parents[1] / "jobs" / "sweeps").glob("*.yaml"))
GRID = """
title: Depth and motion
job: base.yaml
set: {time.end: 0.02, output.probes_every: 0.005}
grid: {"fluids[0].depth": [0.1, 0.15], "motion[0].omega": [5.0, 7.0, 9.0]}
measures:
  - {name: greatest pressure, column: P1, kind: max}
  - {name: force, column: load.Fx, kind: rms, begin: 0.005}
"""
TWO = GRID.replace("[0.1, 0.15]", "[0.15]").replace("[5.0, 7.0, 9.0]", "[5.0, 7.0]")
PEAKS = TWO.replace("kind: rms, begin: 0.005", "kind: mean_peaks")


@pytest.fixture
def write(tmp_path):
    (tmp_path / "base.yaml").write_text(JOB)

    def write(text):
        (tmp_path / "sweep.yaml").write_text(text)
        return tmp_path / "sweep.yaml"

    return write


def command(*words):
    """Run the command in this process; its exit status."""
    with pytest.raises(SystemExit) as end, pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["parmps", "sweep", *map(str, words)])
        cli.main()
    return end.value.code


def table(path):
    with open(path / "out" / "sweep" / "results.csv", newline="") as file:
        return list(csv.DictReader(file))


def test_a_grid_has_all_combinations(write):
    sweep, cases = load_sweep(write(GRID))
    assert [case.name for case in cases] == ["001", "002", "003", "004", "005", "006"]
    values = [(case.job.fluids[0].depth, case.job.motion[0].omega, case.job.time.end) for case in cases]
    assert values == [(depth, omega, 0.02) for depth in (0.1, 0.15) for omega in (5.0, 7.0, 9.0)]
    assert cases[1].job.output.directory == f"{sweep.run.directory}/002"


def test_a_list_changes_what_each_case_says(write):
    text = GRID.split("grid")[0] + "list: [{spacing: 0.025}, {title: 'a = b', scheme: fast}]\n"
    one, two = (case.job for case in load_sweep(write(text))[1])
    assert (one.spacing, one.title, one.scheme.preset) == (0.025, "Short", "balanced")
    assert (two.spacing, two.title, two.scheme.preset) == (0.02, "a = b", "fast")


def test_a_sample_fills_every_stratum_of_every_key_once(write):
    ranges = '{"fluids[0].depth": [0.1, 0.2], "motion[0].omega": [4.0, 8.0]}'
    text = GRID.split("grid")[0] + f"sample: {{count: 20, seed: 7, ranges: {ranges}}}\n"
    values = [tuple(case.values.values()) for case in load_sweep(write(text))[1]]
    assert values == [tuple(case.values.values()) for case in load_sweep(write(text))[1]]
    for column, (low, high) in zip(np.array(values).T, ((0.1, 0.2), (4.0, 8.0)), strict=True):
        strata = np.floor((column - low) / (high - low) * 20)
        assert sorted(strata) == list(range(20))
    other = load_sweep(write(text.replace("seed: 7", "seed: 8")))[1]
    assert values != [tuple(case.values.values()) for case in other]


SAMPLE = GRID.split("grid")[0] + "sample: {count: 2, ranges: {spacing: [2, 1]}}"
BAD = {
    "no YAML": ("grid: [", "line 1: "),
    "unknown key": (GRID.replace("title", "titel"), "titel: unknown key; did you mean 'title'?"),
    "nothing varies": (GRID.split("grid")[0], "sweep: got none, must have one of grid, list and sample"),
    "two kinds": (GRID + "list: [{spacing: 0.1}]\n", "sweep: got grid and list, must have one of"),
    "no such key": (GRID.replace("omega", "omga"), "'motion[0].omga': 5.0}): motion[0].omga: unknown key"),
    "bad value": (GRID.replace("0.15]", "0.5]"), "case 004 ({'fluids[0].depth': 0.5, 'motion[0].omega': 5.0}): fluids"),
    "no such job": (GRID.replace("base", "other"), "other.yaml: cannot be read: No such file or directory"),
    "no such probe": (GRID.replace("P1", "P9"), "measures[0].column: got 'P9', must be of a probe of the job"),
    "late window": (GRID.replace("begin: 0.005", "begin: 3"), "measures[1].begin: got 3 s, must be before"),
    "same name": (GRID.replace("name: force", "name: greatest pressure"), "measures[1].name: 'greatest pressure' is"),
    "no such measure": (GRID.replace("kind: rms", "kind: best"), "measures[1].kind: got 'best', must be 'max', 'min'"),
    "too many": (GRID.replace("[5.0, 7.0, 9.0]", str(list(range(1, 6001)))), "grid: has 12000 combinations"),
    "range": (SAMPLE, "sample.ranges.spacing: got 2 to 1"),
    "script": (GRID + 'run: {slurm: ["--time=1\\nrm x"]}', "run.slurm[0]: got '--time=1\\nrm x', must be one option"),
    "launcher": (GRID + 'run: {launcher: "srun; \'rm x"}', "must be words without quotes"),
    "alias": (GRID + "run: &x {jobs: 2}\nnext: *x", "aliases"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_sweeps_are_refused_with_one_message(write, case, capsys):
    text, expected = BAD[case]
    path = write(text)
    assert command(path) == 2
    error = capsys.readouterr().err
    assert error.startswith("parmps: error: ") and error.count("\n") == 1
    assert expected in error
    assert sorted(path.parent.iterdir()) == [path.parent / "base.yaml", path]


def test_peaks_have_their_number_and_scatter_beside_them(write, tmp_path):
    """By the period of each case's motion: peaks of 5, 7 and of 3 rad/s are as many as there are periods."""
    sweep, cases = load_sweep(write(PEAKS))
    time = np.arange(0.0, 10.0, 0.005)
    for case in cases:
        place = campaign.directory(sweep, case)
        place.mkdir(parents=True)
        omega = case.job.motion[0].omega
        force = (1.0 + 0.1 * np.sin(0.37 * time)) * np.sin(omega * time) + 0.8 * np.sin(3.3 * omega * time)
        rows = "".join(f"{t},0,{f}\n" for t, f in zip(time, force, strict=True))
        (place / "probes.csv").write_text(f"time [s],P1 [Pa],load.Fx [N/m]\n{rows}")
        (place / "run.json").write_text('{"status": "done"}')
    assert campaign.results(sweep, cases) == ["done", "done"]
    for case, row in zip(cases, table(tmp_path), strict=True):
        period = 2.0 * np.pi / case.job.motion[0].omega
        assert abs(float(row["force: number"]) - 10.0 / period) <= 1.0
        mean, deviation = float(row["force [N/m]"]), float(row["force: deviation [N/m]"])
        assert 1.2 < mean < 1.8 and 0.0 < deviation < 0.3
        error = deviation / float(row["force: number"]) ** 0.5
        assert float(row["force: standard error [N/m]"]) == pytest.approx(error)
    assert [figure.axes[0].get_ylabel() for figure in draw_sweep(sweep).values()][1] == "force [N/m]"


def test_missing_cases_run_failures_are_recorded_and_the_rest_goes_on(write, tmp_path, capfd):
    path, out = write(TWO), tmp_path / "out" / "sweep"
    (out / "001" / "checkpoint.h5.tmp").mkdir(parents=True)
    assert command(path, "--jobs", 2) == 4
    assert "2 cases, 2 to run, 2 at a time" in capfd.readouterr().out
    failed, done = table(tmp_path)
    assert failed["status"].startswith(f"failed: {out / '001' / 'checkpoint.h5'}: ")
    assert failed["greatest pressure [Pa]"] == "" and failed["motion[0].omega [rad/s]"] == "5.0"
    assert done["status"] == "done"
    seconds, signals = read_signals(out / "002" / "probes.csv")
    pressure, force = signals[0][2], signals[3][2]
    assert float(done["greatest pressure [Pa]"]) == pytest.approx(measure("max", seconds, pressure), rel=1e-7)
    assert float(done["force [N/m]"]) == pytest.approx(measure("rms", seconds, force, 0.005), rel=1e-7)
    assert (out / "greatest pressure.png").stat().st_size > 5000
    title, sections, place = sweep_sections(load_sweep(path)[0])
    page = write_html(place / "report.html", title, sections).read_text()
    assert page.count("data:image/png;base64,") == 2 and "<td>002</td>" in page

    (out / "001" / "checkpoint.h5.tmp").rmdir()
    before = (out / "002" / "run.log").stat().st_mtime_ns
    assert command(path) == 4
    assert "2 cases, 0 to run" in capfd.readouterr().out
    assert command(path, "--retry") == 0
    assert "2 cases, 1 to run" in capfd.readouterr().out
    assert (out / "002" / "run.log").stat().st_mtime_ns == before
    assert [row["status"] for row in table(tmp_path)] == ["done", "done"]

    other = write(TWO.replace("[5.0, 7.0]", "[5.0, 8.0]"))
    sweep, cases = load_sweep(other)
    campaign.prepare(sweep, cases)
    assert [case.name for case in campaign.missing_cases(sweep, cases)] == ["002"]
    assert (out / "002" / "previous" / "run.json").exists()


def test_a_stopped_sweep_continues_from_its_checkpoints(write, tmp_path):
    path = write(TWO.replace("[5.0, 7.0]", "[7.0]").replace("time.end: 0.02", "time.end: 0.5"))
    log = tmp_path / "out" / "sweep" / "001" / "probes.csv"
    launch = [sys.executable, "-m", "parmps", "sweep", path]
    with subprocess.Popen(launch, env=ENVIRONMENT, stderr=subprocess.PIPE, text=True) as process:
        until = time.monotonic() + 60.0
        while not (log.exists() and log.read_text().count("\n") > 3):
            assert time.monotonic() < until and process.poll() is None
            time.sleep(0.01)
        with pytest.raises(InputError, match="cases of this sweep are running"):
            sweep, cases = load_sweep(path)
            campaign.run_here(sweep, cases)
        process.send_signal(signal.SIGTERM)
        errors = process.communicate(timeout=300)[1]
    assert process.returncode == 5
    assert "parmps: early end: the sweep was stopped by signal SIGTERM; the same command continues it" in errors
    assert table(tmp_path)[0]["status"] == "missing"
    assert (log.parent / "checkpoint.h5").exists()
    assert command(path) == 0
    assert table(tmp_path)[0]["status"] == "done"
    assert "to continue: --restart" in (log.parent / "run.log").read_text()
    assert not (log.parent / "previous").exists()
    seconds = read_signals(log)[0]
    np.testing.assert_allclose(seconds, 0.005 * np.arange(101), atol=1e-12)


def hold(place, held, done):
    with contextlib.closing(DirectoryLock(place)):
        held.set()
        done.wait(20)


def test_results_of_a_case_that_runs_are_not_moved(write, tmp_path):
    sweep, cases = load_sweep(write(TWO))
    campaign.prepare(sweep, cases)
    place = campaign.directory(sweep, cases[0])
    (place / "probes.csv").write_text("mine")
    changed, others = load_sweep(write(TWO.replace("time.end: 0.02", "time.end: 0.03")))
    context = multiprocessing.get_context("fork")
    held, done = context.Event(), context.Event()
    child = context.Process(target=hold, args=(place, held, done))
    child.start()
    assert held.wait(20)
    campaign.prepare(sweep, cases)  # nothing to move
    with pytest.raises(OutputError, match=f"another run writes here: process {child.pid}"):
        campaign.prepare(changed, others)
    assert (place / "probes.csv").read_text() == "mine"
    done.set()
    child.join()
    campaign.prepare(changed, others)
    assert (place / "previous" / "probes.csv").exists()


def test_scripts(write, tmp_path, capfd):
    path = write(TWO.replace("[5.0, 7.0]", "[7.0]") + "run: {ranks: 1, slurm: [--time=00:10:00]}\n")
    assert command(path, "--script", "slurm") == 0
    script = capfd.readouterr().out
    subprocess.run(["bash", "-n"], input=script, text=True, check=True)
    for line in ("#SBATCH --array=0-0", "#SBATCH --ntasks=1", "#SBATCH --time=00:10:00"):
        assert line in script.splitlines()
    assert command(path, "--script", "shell") == 0
    script = capfd.readouterr().out
    subprocess.run(["bash"], input=script, text=True, check=True, env=ENVIRONMENT, cwd=tmp_path, timeout=300)
    assert command(path, "--collect") == 0
    assert [row["status"] for row in table(tmp_path)] == ["done"]
    assert command(path, "--script", "shell") == 2
    assert "no case is missing" in capfd.readouterr().err


def test_a_script_that_is_stopped_has_its_case_saved_and_continues_it(write, tmp_path, capfd):
    """As by a Slurm time limit, which sends USR1 to the script alone, or by a person at the terminal."""
    path = write(TWO.replace("[5.0, 7.0]", "[7.0]").replace("time.end: 0.02", "time.end: 0.5"))
    log = tmp_path / "out" / "sweep" / "001" / "probes.csv"
    assert command(path, "--script", "shell") == 0
    (tmp_path / "sweep.sh").write_text(capfd.readouterr().out)
    with subprocess.Popen(["bash", tmp_path / "sweep.sh"], env=ENVIRONMENT, stdout=subprocess.DEVNULL) as process:
        until = time.monotonic() + 60.0
        while not (log.exists() and log.read_text().count("\n") > 3):
            assert time.monotonic() < until and process.poll() is None
            time.sleep(0.01)
        process.send_signal(signal.SIGUSR1)
        assert process.wait(timeout=300) == campaign.EARLY_END
    assert "stopped by signal SIGUSR1" in (log.parent / "run.json").read_text()
    subprocess.run(["bash", tmp_path / "sweep.sh"], env=ENVIRONMENT, stdout=subprocess.DEVNULL, check=True, timeout=300)
    np.testing.assert_allclose(read_signals(log)[0], 0.005 * np.arange(101), atol=1e-12)


def test_a_launcher_is_used_as_it_is_given(write):
    sweep, cases = load_sweep(write(TWO + "run: {ranks: 4, launcher: srun --mpi=pmix}\n"))
    assert campaign.command(sweep, cases[0])[:2] == ["srun", "--mpi=pmix"]
    assert f"\n    srun --mpi=pmix {sys.executable} -m parmps " in campaign.script(sweep, cases, "slurm")
    assert "\n    mpirun -n 4 " in campaign.script(load_sweep(write(TWO), {"ranks": 4})[0], cases, "slurm")


def test_a_case_that_is_killed_says_by_what(tmp_path):
    assert campaign.exit_text(-signal.SIGKILL) == campaign.exit_text(128 + signal.SIGKILL) == "killed by SIGKILL"
    assert campaign.exit_text(1) == "ended with exit status 1"
    (tmp_path / campaign.ERRORS).write_text("warning\n")
    campaign._end(tmp_path, -9)
    assert campaign.state(tmp_path) == "failed: killed by SIGKILL"


@pytest.mark.parametrize(
    ("key", "unit"),
    [
        ("motion[0].omega", "rad/s"),
        ("tank.baffles[1].top", "m"),
        ("fluids.0.density", "kg/m3"),
        ("tank.size[0]", "m"),
        ("time.cfl", ""),
        ("scheme.preset", ""),
        ("scheme.volume_time", "sqrt(L / f)"),
        ("nowhere", ""),
    ],
)
def test_units_of_keys(key, unit):
    assert unit_of_key(key) == unit


def test_the_keys_of_a_sweep_are_documented_from_its_model():
    table, schema = schema_table(Sweep), json_schema(Sweep)
    assert "measures[].begin: number >= 0 (s), default 0.0" in table
    assert set(schema["properties"]) == set(Sweep.model_fields)


def test_a_chart_has_a_curve_for_each_combination_and_the_reference():
    depth, omega = ["0.1"] * 3 + ["0.2"] * 3, ["5", "7", "9"] * 2
    reference = (["depth [m]", "omega [rad/s]", "theory [m]"], [["0.1", "5", "1"], ["0.1", "9", "2"]])
    figure = draw_measure(["depth [m]", "omega [rad/s]"], [depth, omega], "rms [m]", np.arange(6.0), reference)
    lines = {line.get_label(): line for line in figure.axes[0].lines}
    assert list(lines) == ["depth [m] = 0.1", "depth [m] = 0.2", "theory, depth [m] = 0.1"]
    assert lines["depth [m] = 0.2"].get_xydata().tolist() == [[5, 3], [7, 4], [9, 5]]
    assert figure.axes[0].get_xlabel() == "omega [rad/s]" and figure.axes[0].get_ylabel() == "rms [m]"
    with pytest.raises(InputError, match="no column 'omega"):
        draw_measure(["omega [1/s]"], [omega], "rms [m]", np.arange(6.0), reference)


@pytest.mark.parametrize("path", SWEEPS, ids=lambda path: path.stem)
def test_shipped_sweeps_are_valid(path):
    sweep, cases = load_sweep(path)
    assert len(cases) > 3 and sweep.measures
    assert all(Path(item.reference).exists() for item in sweep.measures if item.reference)


def test_the_table_of_linear_theory_is_that_of_the_script():
    path = next(path for path in SWEEPS if path.stem == "fill_frequency").with_name("linear_theory.py")
    spec = util.spec_from_file_location("linear_theory", path)
    theory = util.module_from_spec(spec)
    spec.loader.exec_module(theory)
    assert path.with_suffix(".csv").read_text() == theory.table()


LAYOUTS = TWO.replace(
    'grid: {"fluids[0].depth": [0.15], "motion[0].omega": [5.0, 7.0]}',
    """grid:
  tank.baffles:
    - {name: without a baffle, value: []}
    - {name: =one low baffle, value: [{x: 0.2, bottom: 0.0, top: 0.1, thickness: 0.04}]}
  motion[0].omega: [5.0, 7.0]""",
)
NAMED = TWO.split("grid")[0] + (
    "list:\n  - {name: no baffle, tank.baffles: []}\n"
    "  - {name: a baffle, tank.baffles: [{x: 0.2, bottom: 0.0, top: 0.1, thickness: 0.04}]}\n"
    "  - {tank.baffles: [{x: 0.3, bottom: 0.0, top: 0.1, thickness: 0.04}]}\n"
    "measures:\n  - {name: greatest pressure, column: P1, kind: max}\n"
)


def pretend(path, heights):
    """Leave results of a sweep's cases as if they had run, with these pressures; the sweep."""
    sweep, cases = load_sweep(path)
    for case, height in zip(cases, heights, strict=True):
        place = campaign.directory(sweep, case)
        place.mkdir(parents=True)
        rows = "".join(f"{0.01 * n},{height},{n}\n" for n in range(5))
        (place / "probes.csv").write_text(f"time [s],P1 [Pa],load.Fx [N/m]\n{rows}")
        (place / "run.json").write_text('{"status": "done"}')
    assert campaign.results(sweep, cases) == ["done"] * len(cases)
    return sweep


def test_layouts_with_names_are_bars(write, tmp_path):
    sweep = pretend(write(LAYOUTS), [1.0, -2.0, 3.0, 4.0])
    jobs = [case.job for case in load_sweep(tmp_path / "sweep.yaml")[1]]
    assert [len(job.tank.baffles) for job in jobs] == [0, 0, 1, 1]
    rows = table(tmp_path)
    # a spreadsheet would take what begins with = for a formula; numbers stay numbers
    assert [row["tank.baffles"] for row in rows] == ["without a baffle"] * 2 + ["'=one low baffle"] * 2
    assert rows[1]["greatest pressure [Pa]"] == "-2"
    panel = draw_sweep(sweep)["greatest pressure"].axes[0]
    assert panel.get_xlabel() == "motion[0].omega [rad/s]" and len(panel.lines) == 2
    layouts, depth = ["none", "one", "two"], ["0.1"] * 3
    panel = draw_measure(["depth [m]", "tank.baffles"], [depth, layouts], "Pa", np.arange(3.0)).axes[0]
    assert [bar.get_height() for bar in panel.patches] == [0.0, 1.0, 2.0]


def test_cases_with_names_are_bars_and_the_others_have_their_number(write, tmp_path):
    sweep = pretend(write(NAMED), [1.0, 2.0, 3.0])
    assert [row["name"] for row in table(tmp_path)] == ["no baffle", "a baffle", ""]
    titles = [case.job.title for case in load_sweep(tmp_path / "sweep.yaml")[1]]
    assert titles == ["no baffle", "a baffle", "Short"]
    panel = draw_sweep(sweep)["greatest pressure"].axes[0]
    assert [tick.get_text() for tick in panel.get_xticklabels()] == ["no baffle", "a baffle", "003"]
    assert [bar.get_height() for bar in panel.patches] == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (NAMED.replace("a baffle", "no baffle"), "list[1].name: 'no baffle' is taken; names must be unique"),
        (NAMED.replace("a baffle", "7"), "list[1].name: got 7, must be a text of 1 to 100 characters"),
        (LAYOUTS.replace("=one low", "without a"), "grid.tank.baffles[1].name: 'without a baffle' is taken"),
    ],
)
def test_bad_names_of_cases(write, text, message):
    with pytest.raises(InputError) as refusal:
        load_sweep(write(text))
    assert message in str(refusal.value)
