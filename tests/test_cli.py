"""The command line: refusals, results on disk, restarts, and ends that are not good."""

import argparse
import csv
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from parmps import checkpoint, cli
from parmps.errors import OutputError
from parmps.run import Schedule

ROOT = Path(__file__).parents[1]
ENVIRONMENT = {
    **os.environ,
    "OMP_NUM_THREADS": "1",
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "PYTHONPATH": str(ROOT),
}
JOB = """
title: Short
dimension: 2
spacing: 0.02
tank: {size: [0.4, 0.3]}
fluids: [{name: water, depth: 0.15, kinematic_viscosity: 1.0e-6}]
motion: [{kind: surge, amplitude: 0.02, omega: 7.0}]
time: {end: 0.1, max_step: 5.0e-3}
probes:
  - {name: P1, kind: pressure, at: [0.0, 0.05]}
  - {name: eta, kind: elevation, at: [0.02]}
  - {name: load, kind: force}
output: {directory: out, particles_every: 0.05, probes_every: 0.01, checkpoint_every: 0.1}
"""


def parmps(directory, *arguments, ranks=1, script=("-m", "parmps")):
    # one rank starts without mpirun, as a newcomer would do it
    launch = [] if ranks == 1 else ["mpirun", "--oversubscribe", "-n", str(ranks)]
    return subprocess.run(
        [*launch, sys.executable, *script, *map(str, arguments)],
        cwd=directory, env=ENVIRONMENT, capture_output=True, text=True, timeout=300, stdin=subprocess.DEVNULL,
    )  # fmt: skip


@pytest.fixture
def here(capfd):
    """Run the command in this process, which spares the start of another; what `parmps` returns."""

    def run(directory, *arguments):
        with pytest.raises(SystemExit) as end, pytest.MonkeyPatch.context() as patch:
            patch.chdir(directory)
            patch.setattr(sys, "argv", ["parmps", *map(str, arguments)])
            cli.main()
        return subprocess.CompletedProcess(arguments, end.value.code, *capfd.readouterr())

    return run


@pytest.fixture
def job(tmp_path):
    path = tmp_path / "job.yaml"
    path.write_text(JOB)
    return path


def check_refused(done, key, before, directory):
    assert done.returncode == 2, done.stderr
    errors = [line for line in done.stderr.splitlines() if line.startswith("parmps: error:")]
    assert len(errors) == 1
    assert errors[0].startswith(f"parmps: error: {key}: "), errors[0]
    assert "Traceback" not in done.stderr + done.stdout
    assert sorted(directory.rglob("*")) == before


BAD = {
    "unknown key": (("spacing: 0.02", "spacing: 0.02\nspacign: 0.02"), "spacign", "did you mean 'spacing'"),
    "wrong type": (("dimension: 2", "dimension: [2]"), "dimension", "must be"),
    "negative spacing": (("spacing: 0.02", "spacing: -0.02"), "spacing", "greater than 0"),
    "text in a number": (("spacing: 0.02", "spacing: two cm"), "spacing", "must be a number"),
    "baffle outside the tank": (
        ("size: [0.4, 0.3]", "size: [0.4, 0.3], baffles: [{x: 0.9, bottom: 0, top: 0.1, thickness: 0.02}]"),
        "tank.baffles[0].x",
        "0.4",
    ),
    "overfull tank": (("depth: 0.15", "depth: 0.35"), "fluids", "0.3"),
    "missing motion file": (
        ("{kind: surge, amplitude: 0.02, omega: 7.0}", "{kind: file, path: nowhere.csv}"),
        "motion[0].path",
        "nowhere.csv",
    ),
    "a gradient for one density": (
        (
            "{name: water, depth: 0.15, kinematic_viscosity: 1.0e-6}]",
            "{name: a, depth: 0.1}, {name: b, depth: 0.1}]\nscheme: {gradient: sum}",
        ),
        "scheme.gradient",
        "corrected",
    ),
    "no YAML": (("title: Short", "title: [Short"), None, ""),
}


@pytest.mark.parametrize(
    ("case", "ranks"), [*((name, 1) for name in BAD), ("unknown key", 2), ("missing motion file", 2)]
)
def test_bad_input(job, tmp_path, here, case, ranks):
    (old, new), key, rule = BAD[case]
    assert old in JOB
    job.write_text(JOB.replace(old, new))
    before = sorted(tmp_path.rglob("*"))
    done = here(tmp_path, job) if ranks == 1 else parmps(tmp_path, job, ranks=ranks)
    message = done.stderr.split("parmps: error: ")[-1]
    check_refused(done, key or message.split(": ")[0], before, tmp_path)
    assert rule in message


def test_bad_command_lines(job, tmp_path, here):
    before = sorted(tmp_path.rglob("*"))
    check_refused(here(tmp_path, job, "--set", "time.ned=1"), "time.ned", before, tmp_path)
    check_refused(here(tmp_path, job, "--color"), "command line", before, tmp_path)
    check_refused(parmps(tmp_path, job, "--restart", "nowhere"), "command line", before, tmp_path)
    done = here(tmp_path, tmp_path / "absent.yaml")
    assert done.returncode == 2 and "absent.yaml" in done.stderr and "Traceback" not in done.stderr


def test_numbers_with_an_exponent_and_no_point_are_numbers(job, tmp_path):
    job.write_text(JOB.replace("1.0e-6", "1e-6"))
    done = parmps(tmp_path, job, "--set", "time.end=1e-2")
    assert done.returncode == 0, done.stderr


def read_table(path):
    with path.open(newline="") as file:
        names, *rows = csv.reader(file)
    return names, np.array(rows, float)


def last_frame(path):
    with h5py.File(path) as file:
        group = file["VTKHDF"]
        begin = int(group["Steps/PointOffsets"][-1])
        count = int(group["NumberOfPoints"][-1])
        rows = slice(begin, begin + count)
        arrays = {name: values[rows] for name, values in group["PointData"].items()}
        return float(group["Steps/Values"][-1]), arrays | {"position": group["Points"][rows]}


@pytest.mark.parametrize("ranks", [1, 2])
def test_a_good_run_writes_all_results(job, tmp_path, ranks):
    done = parmps(tmp_path, job, "--set", "output.particles_every=0.2", ranks=ranks)
    assert done.returncode == 0, done.stderr
    out = tmp_path / "out"
    assert {path.name for path in out.iterdir()} == {
        "probes.csv", "particles.vtkhdf", "checkpoint.h5", "run.json", "run.log",
    }  # fmt: skip
    names, rows = read_table(out / "probes.csv")
    assert names[:4] == ["time [s]", "P1 [Pa]", "P1.max [Pa]", "eta [m]"]
    np.testing.assert_allclose(rows[:, 0], np.arange(11) * 0.01, atol=1e-12)
    assert np.all(np.isfinite(rows))
    np.testing.assert_allclose(rows[:, 3], 0.15, atol=0.03)
    record = json.loads((out / "run.json").read_text())
    expected = {
        "status", "ranks", "steps", "simulated_seconds", "wall_seconds", "particles", "particles_lost",
        "stage_seconds", "ksp", "time_step", "volume_drift", "energy_drift", "peak_memory_bytes", "versions",
        "warnings",
    }  # fmt: skip
    assert expected <= set(record)
    assert record["status"] == "done" and record["ranks"] == ranks and record["particles_lost"] == 0
    assert set(record["particles"]) == {"fluid", "wall", "dummy", "total"}
    assert record["particles"]["total"] == sum(record["particles"][k] for k in ("fluid", "wall", "dummy"))
    assert set(record["ksp"]) == {"iterations_mean", "iterations_max", "rebuilds"}
    assert all(set(stage) == {"max", "mean"} for stage in record["stage_seconds"].values())
    assert record["simulated_seconds"] == 0.1
    (warning,) = record["warnings"]
    assert warning.startswith("output.particles_every: 0.2 s is longer")
    assert f"parmps: warning: {warning}\n" in done.stderr
    assert f"warning: {warning}\n" in (out / "run.log").read_text()
    assert 0 < record["time_step"]["min"] <= record["time_step"]["max"] <= 5e-3 * (1 + 1e-9)
    assert len(record["peak_memory_bytes"]) == ranks
    assert sum(stage["mean"] for stage in record["stage_seconds"].values()) < record["wall_seconds"]
    moment, arrays = last_frame(out / "particles.vtkhdf")
    assert moment == 0.1
    assert len(arrays["id"]) == record["particles"]["total"]
    assert set(arrays) >= {"type", "fluid", "velocity", "pressure", "position"}
    header = checkpoint.read_header(out / "checkpoint.h5")
    assert header.attributes["counters"]["time"] == 0.1
    log = (out / "run.log").read_text()
    assert f"plot them: {sys.executable} -m parmps plot probes out\n" in log
    assert "Traceback" not in done.stderr


WALL_TIMES = {
    "90": 90.0, "1.5": 1.5, "2:30": 150.0, "23:50:00": 85800.0, "1-00:00:00": 86400.0, "2-1:30": 178200.0,
    "7-12": 648000.0,
}  # fmt: skip


@pytest.mark.parametrize(("text", "seconds"), WALL_TIMES.items())
def test_wall_times(text, seconds):
    assert cli.wall_time(text) == seconds


@pytest.mark.parametrize("text", ["", "-1", "1h", "1:2:3:4", "1:234", "nan", "١", "1-", "1-2-3", "1-1.5", "-1-2:00:00"])
def test_bad_wall_times(text):
    with pytest.raises(argparse.ArgumentTypeError, match="must be seconds, MM:SS or HH:MM:SS"):
        cli.wall_time(text)


def test_a_checkpoint_names_its_directory():
    for text, directory in {"out/a": "out/a", "out/a/checkpoint.h5": "out/a", "checkpoint.h5": "."}.items():
        assert cli.run_directory(text) == directory


def test_schema_and_help(tmp_path, here):
    done = parmps(tmp_path, "schema")
    assert done.returncode == 0 and "spacing" in done.stdout
    done = here(tmp_path, "--help")
    assert done.returncode == 0 and "exit status" in done.stdout


def test_what_was_asked_for_and_cannot_be_printed_is_an_error(monkeypatch):
    with open("/dev/full", "w") as full:
        monkeypatch.setattr(sys, "stdout", full)
        with pytest.raises(OutputError, match="standard output: No space left on device"):
            cli._print("text")
    reader, writer = os.pipe()
    os.close(reader)
    with open(writer, "w") as left:
        monkeypatch.setattr(sys, "stdout", left)
        cli._print("text")  # as for `head`, which has seen enough
        cli._print("text")


def test_an_end_that_is_a_multiple_but_for_rounding_has_one_frame(job, tmp_path):
    """5 x 0.013663391496202944 s, rounded to 12 digits, is 1e-14 s before the end."""
    every, end = "output.particles_every=0.013663391496202944", "time.end=0.06831695748101471"
    done = parmps(tmp_path, job, "--set", every, "--set", end)
    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "out" / "particles.vtkhdf") as file:
        assert len(file["VTKHDF/Steps/Values"]) == 6


@pytest.mark.parametrize("start", [0.0, 0.37])
def test_a_schedule_counts_what_will_be_due(start):
    rng = np.random.default_rng(3)
    for every in rng.uniform(0.01, 0.1, 200):
        for end in (every * 7, every * rng.uniform(5, 50)):
            schedule, time, due = Schedule(every, end), start, 0
            while time < end:
                due, time = due + schedule.due(time), schedule.after(time)
            assert schedule.count(start) == due + 1


def test_restart_continues_bit_by_bit(job, tmp_path):
    ranks = 2
    whole = parmps(tmp_path, job, "--out", "whole", "--set", "time.end=0.2", ranks=ranks)
    first = parmps(tmp_path, job, "--out", "parts", ranks=ranks)
    then = parmps(tmp_path, job, "--restart", "parts", "--set", "time.end=0.2", ranks=ranks)
    assert (whole.returncode, first.returncode, then.returncode) == (0, 0, 0), then.stderr
    names, rows = read_table(tmp_path / "parts" / "probes.csv")
    expected_names, expected = read_table(tmp_path / "whole" / "probes.csv")
    assert names == expected_names
    np.testing.assert_array_equal(rows, expected)
    moment, arrays = last_frame(tmp_path / "parts" / "particles.vtkhdf")
    expected_moment, expected = last_frame(tmp_path / "whole" / "particles.vtkhdf")
    assert moment == expected_moment == 0.2
    for name, values in expected.items():
        np.testing.assert_array_equal(arrays[name], values, err_msg=name)
    steps = [json.loads((tmp_path / d / "run.json").read_text())["steps"] for d in ("parts", "whole")]
    assert steps[0] == steps[1]


def test_restart_elsewhere_with_other_output(job, tmp_path):
    """Frames are as many as the new interval has from the restart on; the first run's results stay as they are."""
    assert parmps(tmp_path, job, "--out", "first").returncode == 0
    before = (tmp_path / "first" / "probes.csv").read_bytes()
    end = read_table(tmp_path / "first" / "probes.csv")[1][-1, 0]
    more = "--set", f"time.end={2 * end}", "--set", f"output.particles_every={end / 2}"
    for out in ((), ("--out", "second")):
        source = tmp_path / "first"
        if not out:
            shutil.copytree(source, tmp_path / "copy")
            source = tmp_path / "copy"
        named = source.name if out else f"{source.name}/checkpoint.h5"
        done = parmps(tmp_path, job, "--restart", named, *out, *more)
        assert done.returncode == 0, done.stderr
        moment, _ = last_frame((tmp_path / "second" if out else source) / "particles.vtkhdf")
        assert moment == 2 * end
    rows = [read_table(tmp_path / name / "probes.csv")[1] for name in ("copy", "second")]
    assert rows[1][0, 0] == end
    np.testing.assert_array_equal(rows[0][rows[0][:, 0] >= end], rows[1])
    assert (tmp_path / "first" / "probes.csv").read_bytes() == before


def test_options_of_petsc_are_told_from_ours():
    words = ["job.yaml", "-ppe_pc_gamg_threshold", "-1", "-viscosity_ksp_rtol", "1e-8", "-ppe_ksp_view", "--out", "x"]
    assert cli._split(words) == ["job.yaml", "--out", "x"]
    assert cli._split(["-ppe_ksp_monitor", "job.yml"]) == ["job.yml"]


def test_a_solver_that_fails_ends_with_status_3_and_a_checkpoint(job, tmp_path):
    ranks = 2
    options = ("--set", "scheme.ksp_rtol=1e-14", "-ppe_ksp_max_it", "1")
    done = parmps(tmp_path, job, *options, ranks=ranks)
    assert done.returncode == 3, done.stderr
    errors = [line for line in done.stderr.splitlines() if line.startswith("parmps: error:")]
    assert len(errors) == 1 and "did not converge" in errors[0] and "max it" in errors[0]
    assert "Traceback" not in done.stderr
    header = checkpoint.read_header(tmp_path / "out" / "checkpoint.h5")
    arrays = checkpoint.read_slabs(tmp_path / "out" / "checkpoint.h5", range(len(header.slabs)))
    assert np.all(np.isfinite(arrays["position"]))
    again = parmps(tmp_path, job, "--restart", "out", "--set", "scheme.ksp_rtol=1e-14", ranks=ranks)
    assert again.returncode == 0, again.stderr


def test_characters_that_a_terminal_lacks_are_replaced(tmp_path):
    """On a terminal with Latin-1; `run` may be said, and keys without a value are as if they were not there."""
    (tmp_path / "job.yaml").write_text(
        "title: \u03c9 = 4.5\ndimension: 2\nspacing: 0.05\ntank: {size: [0.4, 0.3], baffles: }\nprobes:\nmotion:\n"
        "fluids: [{name: water, depth: 0.15}]\noutput:\ntime: {end: 1.0e-3}\n",
        encoding="utf-8",
    )
    done = subprocess.run(
        [sys.executable, "-m", "parmps", "run", "job.yaml"],
        cwd=tmp_path, env=ENVIRONMENT | {"PYTHONIOENCODING": "latin-1"}, capture_output=True, encoding="latin-1",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "? = 4.5" in done.stdout and "Traceback" not in done.stderr
    assert "\u03c9 = 4.5" in (tmp_path / "out" / "job" / "run.log").read_text(encoding="utf-8")


def test_options_that_petsc_does_not_know_are_named(job, tmp_path):
    good = ("-ppe_ksp_max_it", "400", "-ppe_mg_levels_ksp_max_it", "2", "-ppe_mg_coarse_sub_pc_type", "lu")
    done = parmps(tmp_path, job, "--set", "time.end=0.01", *good, "-ppe_pc_typ", "hypre", ranks=2)
    assert done.returncode == 0, done.stderr
    (line,) = {line for line in (done.stdout + done.stderr).splitlines() if "no solver has used" in line}
    assert line.startswith("warning: -ppe_pc_typ: ")
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert f"warning: {record['warnings'][-1]}" == line
    done = parmps(tmp_path, job, "-ppe_pc_type", "hypr", ranks=2)
    assert done.returncode == 2 and "Traceback" not in done.stderr
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("parmps: error:")]
    assert "PETSc refuses -ppe_pc_type hypr: Unable to find" in line
