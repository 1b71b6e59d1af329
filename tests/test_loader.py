"""Reading job files: safe YAML, overrides, relative paths, and mutated jobs."""

import copy
import json
import os
import time
from types import SimpleNamespace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from parmps.cautions import cautions
from parmps.errors import InputError
from parmps.loader import MAX_NODES, load_job, parse_job, read_yaml
from parmps.planning import plan_text
from parmps.records import read_motion_file
from parmps.scene import Job

FUZZ_FACTOR = float(os.environ.get("PARMPS_FUZZ", "1"))
"""How many times the usual 2000 mutations."""

TEXT = """
title: Surge sloshing
dimension: 2
spacing: 0.01
tank:
  size: [0.8, 0.5]
  baffles: [{x: 0.4, bottom: 0.0, top: 0.15, thickness: 0.02}]
fluids:
  - {name: water, depth: 0.15, kinematic_viscosity: 1e-6}
  - {name: oil, depth: 0.1, density: 800}
interfaces: [{between: [water, oil], surface_tension: 0.05}]
motion:
  - {kind: surge, amplitude: 0.02, omega: 6.469}
  - {kind: roll, amplitude_deg: 2, omega: 3, centre: [0.4, 0.0]}
time: {end: 1.0, max_step: 1e-3}
scheme: balanced
probes:
  - {name: P1, kind: pressure, at: [0.0, 0.05]}
  - {name: eta, kind: elevation, at: [0.01]}
  - {name: cw, kind: interface, between: [water, oil], at: [0.01]}
  - {name: load, kind: force}
output: {probes_every: 0.01}
"""


def refusal(text, *overrides):
    with pytest.raises(InputError) as caught:
        parse_job(text, overrides, source="job.yaml")
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_numbers():
    job = parse_job(TEXT)
    assert job.fluids[0].kinematic_viscosity == 1e-6
    assert job.time.max_step == 1e-3
    assert job.spacing == 0.01


def test_numbers_are_read_as_they_look():
    """YAML 1.1 would read 060 as 48, and 1:30 as 90."""
    assert parse_job(TEXT, ["motion[0].phase_deg=060"]).motion[0].phase_deg == 60
    assert refusal(TEXT, "time.end=1:30") == "time.end: got '1:30', must be a number (s)"
    assert refusal(TEXT, "time.end=.inf") == "time.end: got '.inf', must be a number (s)"
    assert refusal(TEXT, "time.end=1e999") == "time.end: got inf, must be a finite number (s)"
    assert refusal(TEXT, f"time.end={'9' * 5000}") == "time.end: got inf, must be a finite number (s)"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "job.yaml: got nothing, must be a mapping"),
        ("- 1\n- 2\n", "job.yaml: got [1, 2], must be a mapping"),
        ("a: [1, 2\nb: 3\n", "job.yaml, line 2: "),
        ("a: 1\nb: 'x\n", "job.yaml, line 3: "),
        ("spacing: 1\ntank:\n  size: 1\n  size: 2\n", "job.yaml, line 4: the key 'size' is given twice"),
        ("a: &x [1]\nb: *x\n", "job.yaml, line 2: aliases (*name) are not allowed"),
        ("a: !!python/object/apply:os.system [ls]\n", "job.yaml, line 1: tags are not allowed"),
        ("a: !!binary aGk=\n", "job.yaml, line 1: tags are not allowed"),
        ("1: 2\n", "job.yaml, line 1: the key 1 must be text"),
        ("[1]: 2\n", "job.yaml, line 1: the key [1] must be text"),
        ("? {a: 1}\n: 2\n", "must be text"),
        ("<<: {a: 1}\n", "<<: unknown key"),
        ("a: 1\n---\nb: 2\n", "job.yaml, line 2: expected a single document in the stream, but found another document"),
        ("a: " + "[" * 60, "nested more than 50 deep"),
        ("a: " + "{b: " * 60, "nested more than 50 deep"),
        ("a: [" + "1," * (MAX_NODES + 1) + "]", f"more than {MAX_NODES} values"),
        ('a: "\\UFFFFFFFF"', "job.yaml: an escape or directive has a number out of range"),
        ("a: 1\nb: \x01\n", "job.yaml, line 2: the character 0x1 is not allowed"),
        ('"\\uD800": 1', "got '\\ud800', must be valid Unicode text"),
        ('title: "\\uD800"', "title: "),
    ],
)
def test_bad_yaml(text, expected):
    assert expected in refusal(text)


def test_bad_files(tmp_path):
    for name, data, expected in [
        ("latin.yaml", b"a: 1\ntitle: \xe9\n", "line 2: not UTF-8 text"),
        ("large.yaml", b"#" * (2**18 + 1), "must be at most 256 KiB"),
    ]:
        path = tmp_path / name
        path.write_bytes(data)
        with pytest.raises(InputError, match=expected):
            load_job(path)
    for path in (tmp_path, tmp_path / "missing.yaml"):
        with pytest.raises(InputError, match="cannot be read"):
            load_job(path)
    with pytest.raises(InputError, match="not a file name"):
        load_job("a\0b")


def test_paths_are_relative_to_the_job_file(tmp_path, monkeypatch):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "motion.csv").write_text("time [s],surge [m]\n0,0\n1,1\n2,0\n3,1\n")
    file = tmp_path / "first.yaml"
    file.write_text(TEXT)
    monkeypatch.chdir(tmp_path.parent)
    job = load_job(file, ["motion=[{kind: file, path: data/motion.csv}]"])
    assert job.motion[0].path == str(tmp_path / "data" / "motion.csv")
    assert job.output.directory == str(tmp_path / "out" / "first")
    relative = load_job(f"{tmp_path.name}/first.yaml", ["output.directory=there"])
    assert relative.output.directory == str(tmp_path / "there")


def test_overrides():
    job = parse_job(
        TEXT,
        [
            "motion[0].amplitude=0.03",
            "motion.1.omega=2",
            "tank.size=[1.0, 0.6]",
            "tank.size[1]=0.7",
            "output.directory=/tmp/x",
            "scheme.gamma=1e-3",
            "initial.kind=standing_wave",
            "initial.amplitude=0.01",
            "title=a = b",
            "time.cfl=0.1",
        ],
    )
    assert job.motion[0].amplitude == 0.03
    assert job.motion[1].omega == 2
    assert job.tank.size == (1.0, 0.7)
    assert job.output.directory == "/tmp/x"
    assert job.scheme.gamma == 1e-3
    assert job.scheme.preset == "balanced"
    assert job.initial.amplitude == 0.01
    assert job.title == "a = b"
    assert job.time.cfl == 0.1


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("spacing", "--set 'spacing': must be path.to.key=value"),
        ("=3", "must be path.to.key=value"),
        ("a..b=3", "must be path.to.key=value"),
        ("motion[x].omega=3", "must be path.to.key=value"),
        ("tnak.size=3", "tnak: unknown key; did you mean 'tank'?"),
        ("motion[0].omga=3", "motion[0].omga: unknown key; did you mean 'omega'?"),
        ("motion[7].omega=3", "motion[7]: no such entry; motion has 2"),
        ("motion[2]=3", "motion[2]: no such entry; motion has 2"),
        ("motion.omega=3", "motion.omega: motion is a list; give an index, such as motion[0]"),
        ("tank[0]=3", "tank[0]: no such entry; tank is not a list"),
        ("spacing.x=3", "spacing.x: spacing is 0.01, which has no keys"),
        ("spacing=[1", "--set spacing, line 1: "),
        ("spacing=!!python/name:os.system", "tags are not allowed"),
        ("scheme.preset=best", "scheme.preset: got 'best', no such preset"),
    ],
)
def test_bad_overrides(override, expected):
    assert expected in refusal(TEXT, override)


# Values that a careless or hostile author might put anywhere.
SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.sampled_from(
        [0, -1, 1e-300, 1e300, 10**400, "1e-6", "x", "", "../..", "\0", "rest", "file", "/dev/zero"]
    ),
    st.text(max_size=20),
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)
SMALL = """
dimension: 2
spacing: 0.02
tank: {size: [0.8, 0.5], baffles: [{x: 0.4, bottom: 0.0, top: 0.15, thickness: 0.02}]}
fluids: [{name: water, depth: 0.25, kinematic_viscosity: 1e-6}]
motion: [{kind: surge, amplitude: 0.02, omega: 6.469}]
time: {end: 1.0}
probes: [{name: P1, kind: pressure, at: [0.0, 0.05]}, {name: load, kind: force}]
"""
BASE = read_yaml(SMALL, "job")


def places(data, path=()):
    """List the paths of all values in nested data."""
    found = [path] if path else []
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for step, inner in items:
        found += places(inner, (*path, step))
    return found


@st.composite
def mutated_jobs(draw):
    data = copy.deepcopy(BASE)
    for _ in range(draw(st.integers(1, 3))):
        path = draw(st.sampled_from(places(data)))
        place = data
        for step in path[:-1]:
            place = place[step]
        action = draw(st.sampled_from(["scale", "scale", "scale", "replace", "remove", "rename", "repeat", "move"]))
        old = place[path[-1]]
        if action == "scale" and isinstance(old, (int, float)):
            place[path[-1]] = old * draw(st.sampled_from([-1, 0, 1e-12, 1e-6, 1e-3, 0.1, 0.5, 2, 10, 1000, 1e6, 1e12]))
        elif action == "remove" and len(data) > 1:
            del place[path[-1]]
        elif action == "rename" and isinstance(place, dict):
            place[draw(st.text(max_size=10))] = place.pop(path[-1])
        elif action == "repeat" and isinstance(old, list):
            place[path[-1]] = old * 2
        elif action == "move":
            other = draw(st.sampled_from(places(BASE)))
            value = BASE
            for step in other:
                value = value[step]
            place[path[-1]] = copy.deepcopy(value)
        else:
            place[path[-1]] = draw(VALUES)
    return data


def job_or_refusal(build):
    """A job that can be planned, or one readable message, in under a second.

    On a loaded machine even processor time is not that of the program alone: a case that took longer is tried again,
    and the least of three times counts.
    """
    seconds = []
    while len(seconds) < 3 and min(seconds, default=1.0) >= 1.0:
        start = time.process_time()
        try:
            job = build()
            assert isinstance(job, Job)
            assert all(isinstance(warning, str) for warning in cautions(job))
            assert "Stages of a step" in plan_text(job, SimpleNamespace(size=3))
        except InputError as error:
            assert str(error).isprintable()
            assert len(str(error)) < 5000
        seconds.append(time.process_time() - start)
    assert min(seconds) < 1.0


def fuzz(examples):
    return settings(
        max_examples=round(FUZZ_FACTOR * examples),
        deadline=None,
        suppress_health_check=list(HealthCheck),
        derandomize=True,
        database=None,
    )


@fuzz(900)
@given(mutated_jobs())
def test_mutated_jobs_run_or_are_refused(data):
    job_or_refusal(lambda: parse_job(json.dumps(data)))


@fuzz(600)
@given(st.data())
def test_mutated_text_runs_or_is_refused(data):
    text = SMALL
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(text)))
        length = data.draw(st.integers(0, 12))
        fragment = st.text(max_size=6) | st.sampled_from(
            ["[", "}", "*a", "&a ", "!!x ", "- ", "? ", "\t", "<<: ", "'"]
        )
        text = text[:start] + data.draw(fragment) + text[start + length :]
    job_or_refusal(lambda: parse_job(text))


CSV = "time [s],surge [m],roll [deg]\n0,0,0\n0.5,0.1,2\n1,0.2,1\n1.5,0,0\n2,0.1,-1\n"


@fuzz(500)
@given(st.data())
def test_mutated_motion_files_are_read_or_refused(tmp_path_factory, data):
    raw = CSV.encode()
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(raw)))
        fragment = data.draw(
            st.binary(max_size=6) | st.sampled_from([b"nan", b"1e999", b",", b"\n", b"-", b"1_0", b" "])
        )
        raw = raw[:start] + fragment + raw[start + data.draw(st.integers(0, 6)) :]
    path = tmp_path_factory.getbasetemp() / "fuzz.csv"
    path.write_bytes(raw)
    try:
        read_motion_file(str(path))
    except InputError as error:
        assert str(error).isprintable()
        return
    job_or_refusal(lambda: parse_job(SMALL, [f"motion[0]={{kind: file, path: {path}}}"]))
