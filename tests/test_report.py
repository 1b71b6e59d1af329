"""What a person reads: log, progress and timer table."""

import errno
import os
import sys

import pytest
from numba.core import event

from parmps import report
from parmps.errors import OutputError
from parmps.report import Compilation, RunLog, advice, command_line, duration, timer_table


class Clock:
    """A clock that the test moves."""

    now = 100.0

    def monotonic(self):
        return self.now


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(report, "clock", clock)
    return clock


def run(log, clock, steps=200):
    log.line("parmps 0.1.0")
    log.start(0.0, 10.0)
    for step in range(1, steps + 1):
        clock.now += 0.5
        log.progress(0.05 * step, step, 0.05, 7)
    log.close()


def test_a_batch_log_has_a_line_every_few_seconds(tmp_path, clock, capsys):
    run(RunLog(tmp_path / "run.log", terminal=False), clock)
    lines = (tmp_path / "run.log").read_text().splitlines()
    assert capsys.readouterr().out.splitlines() == lines
    assert len(lines) == 1 + 200 * 0.5 / report.SECONDS_BETWEEN_LINES
    expected = "t = 0.5000 s of 10 s   step 10   dt = 50 ms   7 iterations   1 min 35 s left"
    assert lines[1] == expected


def test_a_terminal_has_a_bar_and_the_log_has_the_lines(tmp_path, clock, capsys):
    run(RunLog(tmp_path / "run.log", terminal=True), clock)
    printed = capsys.readouterr()
    assert printed.out.splitlines() == ["parmps 0.1.0"]
    assert "100%" in printed.err
    assert "1 min 40 s taken" in printed.err
    assert len((tmp_path / "run.log").read_text().splitlines()) == 21


def test_a_restart_adds_to_the_log_and_counts_from_its_start(tmp_path, clock, capsys):
    path = tmp_path / "run.log"
    path.write_text("before\n")
    log = RunLog(path, terminal=False)
    log.start(9.0, 10.0)
    for step, time in enumerate((9.25, 9.5), start=899):
        clock.now += 20.0
        log.progress(time, step, 0.05, 7)
    log.close()
    assert "before\nt = 9.2500 s" in path.read_text()
    assert "t = 9.5000 s of 10 s   step 900   dt = 50 ms   7 iterations   40 s left" in capsys.readouterr().out


def test_a_log_that_cannot_be_written_is_an_output_error(tmp_path):
    with pytest.raises(OutputError, match="run.log: No such file or directory"):
        RunLog(tmp_path / "missing" / "run.log", terminal=False)
    log = RunLog("/dev/full", terminal=False)
    with pytest.raises(OutputError, match="/dev/full: No space left on device"):
        log.line("text")


@pytest.mark.parametrize("target", ["/dev/full", "pipe"])
def test_a_standard_output_that_takes_no_more_leaves_the_log(tmp_path, monkeypatch, target):
    if target == "pipe":
        reader, writer = os.pipe()
        os.close(reader)
    else:
        writer = os.open(target, os.O_WRONLY)
    with open(writer, "w") as stream:
        monkeypatch.setattr(sys, "stdout", stream)
        log = RunLog(tmp_path / "run.log", terminal=False)
        log.line("first")
        log.line("second")
        log.close()
    lines = (tmp_path / "run.log").read_text().splitlines()
    assert [lines[0], lines[2]] == ["first", "second"] and len(lines) == 3
    assert lines[1].startswith("The standard output takes no more (")


def test_a_terminal_that_is_closed_leaves_the_log(tmp_path, clock, monkeypatch, capsys):
    log = RunLog(tmp_path / "run.log", terminal=True)
    log.start(0.0, 10.0)

    def gone(*_):
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(log._bar, "update", gone)
    for step in range(1, 40):
        clock.now += 0.5
        log.progress(0.05 * step, step, 0.05, 7)
    log.line("the end")
    log.close()
    lines = (tmp_path / "run.log").read_text().splitlines()
    assert sum("takes no more (Input/output error)" in line for line in lines) == 1
    assert sum(line.startswith("t = ") for line in lines) == 3 and lines[-1] == "the end"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.2, "0 s"), (59.7, "1 min 00 s"), (185, "3 min 05 s"), (7800, "2 h 10 min")],
)
def test_durations(seconds, text):
    assert duration(seconds) == text


def test_timer_table_is_sorted_and_adds_up():
    stages = {"shift": {"max": 1.0, "mean": 0.5}, "pressure solve": {"max": 7.0, "mean": 6.5}}
    lines = timer_table(stages, 10.0).splitlines()
    assert [line.split("  ")[0] for line in lines[1:3]] == ["pressure solve", "shift"]
    assert lines[1].split()[-3:] == ["7.000", "6.500", "65.0%"]
    assert lines[3].split()[-3:] == ["3.000", "3.000", "30.0%"]
    assert lines[4].split()[-3:] == ["10.000", "10.000", "100.0%"]
    assert len({len(line) for line in lines}) == 1


def record(wall=100.0, ranks=1, iterations=5.0, rebuilds=10, compiling=0.0, **stages):
    times = {name: {"max": 1.2 * s if ranks > 1 and name == "move" else s, "mean": s} for name, s in stages.items()}
    ksp = {"iterations_mean": iterations, "iterations_max": 99, "rebuilds": rebuilds}
    particles = {"total": 5000}
    counts = {"ranks": ranks, "ksp": ksp, "particles": particles}
    return {"wall_seconds": wall, "compile_seconds": compiling, "stage_seconds": times, **counts}


def test_advice_names_what_was_expensive_and_nothing_else():
    assert advice(record(pressure=50.0, move=45.0), 1000) == []
    assert advice(record(pressure=95.0, rebuilds=500), 40) == []  # too short to say
    (often,) = advice(record(pressure=95.0, rebuilds=500), 1000)
    assert "every 2.0 steps" in often and "output.checkpoint_every" in often
    assert advice(record(pressure=20.0, move=75.0, rebuilds=500), 1000) == []
    (many,) = advice(record(pressure=95.0, iterations=80.4), 1000)
    assert "80 iterations a step" in many and "ksp_rtol" in many
    (files,) = advice(record(pressure=50.0, results=50.0), 1000)
    assert "50% of the time" in files and "output.probes_every" in files
    (halo,) = advice(record(ranks=4, halo=40.0, pressure=55.0), 1000)
    assert "1250 particles a rank" in halo
    slow = record(ranks=2, pressure=50.0, move=45.0)
    slow["stage_seconds"]["pressure"]["max"] = 85.0
    (waited,) = advice(slow, 1000)
    assert "44%" in waited and "more ranks than free cores" in waited


def test_a_first_run_is_told_about_compiling_and_nothing_else():
    (only,) = advice(record(compiling=60.0, results=40.0, pressure=60.0, rebuilds=500), 20)
    assert only.startswith("60% of the time went into compiling")


def test_compiling_is_announced_once_and_counted_with_what_it_calls(monkeypatch):
    moments = iter([1.0, 4.0, 10.0, 10.5])
    monkeypatch.setattr(event, "timer", lambda: next(moments))
    said = []
    compilation = Compilation(said.append)
    assert compilation.seconds == 0.0
    for notice in "start", "start", "end", "end", "start", "end":
        getattr(compilation, f"on_{notice}")(None)
    assert compilation.seconds == pytest.approx(3.5)
    assert said == ["Compiling the kernels; later runs find them compiled."]


def test_commands_can_be_pasted(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = (tmp_path / ".venv" / "python", "/opt/plot.py", tmp_path / "my run")
    assert command_line(*words) == ".venv/python /opt/plot.py 'my run'"


def test_the_time_left_is_that_after_the_first_step(tmp_path, clock, capsys):
    log = RunLog(tmp_path / "run.log", terminal=False)
    log.start(0.0, 1.0)
    clock.now += 100.0  # compiling
    log.progress(0.1, 1, 0.1, 7)
    clock.now += 6.0
    log.progress(0.2, 2, 0.1, 7)
    first, second = capsys.readouterr().out.splitlines()
    assert first.endswith("unknown time left") and second.endswith("48 s left")
