"""What the README shows can be done as it stands."""

import re
import shlex
import shutil
import subprocess
import textwrap
from pathlib import Path

import pytest

from parmps import cli
from parmps.loader import load_job
from parmps.sweep import load_sweep

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
FENCED = re.compile(r"^( *)```(\w*)\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)
BLOCKS = [(kind, textwrap.dedent(code)) for _, kind, code in FENCED.findall(TEXT)]
COMMANDS = [" ".join(c.split()) for c in re.findall(r"`[^`]*?python -m parmps ([^`]*)`", FENCED.sub("", TEXT))]
"""What follows `python -m parmps` in the text, but for blocks."""


def blocks(kind):
    return [code for each, code in BLOCKS if each == kind]


@pytest.mark.parametrize("code", blocks("yaml"), ids=lambda code: code.split("\n")[0])
def test_jobs_and_sweeps_are_valid(code, tmp_path):
    (tmp_path / "sweeps").mkdir()
    for path in (*ROOT.glob("jobs/*.yaml"), *ROOT.glob("jobs/sweeps/*.csv")):
        shutil.copy(path, tmp_path / path.relative_to(ROOT / "jobs"))
    path = tmp_path / "sweeps" / "readme.yaml"
    path.write_text(code)
    if code.startswith("job:"):
        assert len(load_sweep(path)[1]) > 1
    else:
        load_job(path)


def test_all_kinds_of_blocks_are_looked_at():
    assert {kind for kind, _ in BLOCKS} == {"", "yaml", "bash"}
    assert len(blocks("yaml")) >= 3 and len(COMMANDS) > 10


@pytest.mark.parametrize("code", blocks(""), ids=lambda code: code.split("\n")[0])
def test_commands_of_make_are_there(code):
    for line in code.splitlines():
        words = line.split("#")[0].split()
        if words:
            assert words[0] == "make"
            subprocess.run(["make", "-n", *words[1:]], cwd=ROOT, check=True, capture_output=True)


@pytest.mark.parametrize("words", COMMANDS)
def test_commands_are_understood(words):
    """Their options and kinds; what stands for a choice is written out as its first."""
    words = words.split(" > ")[0].replace("KIND", "probes").replace("; `", "")
    words = re.sub(r"\[(--\w+)[^\]]*\]", r"\1", words)
    if words not in ("plan", "plot", "..."):
        try:
            cli._arguments(cli._split(shlex.split(words)))
        except SystemExit as end:
            assert end.code == 0  # --help


def test_the_script_for_a_batch_system_has_the_run_save_itself(tmp_path):
    """With a program in the place of mpirun: the signal comes to the run, and the script waits for its end."""
    (code,) = blocks("bash")
    run = 'trap "echo saved; exit 5" USR1; echo "$@" >begun; while :; do sleep 0.05; done'
    (tmp_path / "mpirun").write_text(f"#!/bin/bash\n{run}\n")
    (tmp_path / "mpirun").chmod(0o755)
    (tmp_path / "job.sh").write_text(code)
    wait = "until [[ -s begun ]]; do sleep 0.05; done; kill -USR1 $!; wait $!"
    start = f'PATH="{tmp_path}:$PATH" bash job.sh & {wait}'
    done = subprocess.run(["bash", "-c", start], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (5, "saved\n"), done.stderr
    assert (tmp_path / "begun").read_text() == "python -m parmps my_tank.yaml\n"
