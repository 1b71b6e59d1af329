"""What a restart refuses and what it takes: another job, other files, states that no run can have left."""

import copy
import shutil

import numpy as np
import pytest

from parmps.checkpoint import Header
from parmps.continuation import Inputs, check_arrays, check_attributes, check_particles
from parmps.errors import InputError, OutputError
from parmps.loader import load_job
from parmps.particles import FIELDS
from parmps.simulation import COUNTERS

JOB = """
dimension: 2
spacing: 0.02
tank: {size: [0.4, 0.3]}
fluids: [{name: water, depth: 0.14}]
motion:
  - {kind: file, path: motion.csv}
  - {kind: heave, amplitude: 0.01, omega: 3.0}
time: {end: 10.0, cfl: 0.2}
probes: [{name: P1, kind: pressure, at: [0.0, 0.05]}, {name: eta, kind: elevation, at: [0.02]}]
"""
TIME = 0.1
TIMES = 0.025 * np.arange(500)
RESULTS = {
    "table": {"columns": ["P1 [Pa]"], "rows": 20, "last": 0.095, "sha256": "0"},
    "particles": {"frames": 1, "last": 0.0},
}


def write_motion(path, change=None):
    values = 0.01 * np.sin(TIMES)
    if change is not None:
        values[change] += 1e-6
    np.savetxt(path, np.stack([TIMES, values], 1), "%.12g", ",", header="time [s],surge [m]", comments="")


@pytest.fixture
def case(tmp_path):
    """Directory of a job whose motion is in a file."""
    (tmp_path / "job.yaml").write_text(JOB)
    write_motion(tmp_path / "motion.csv")
    return tmp_path


@pytest.fixture
def begun(case, start):
    return start(case / "job.yaml")


def counters_of(simulation):
    return {name: getattr(simulation, name) for name in COUNTERS}


def header_of(simulation, **changes):
    """What a run of this simulation writes at 0.1 s, changed."""
    attributes = {
        "version": "1.0",
        "job": simulation.job.model_dump(mode="json"),
        "inputs": Inputs(simulation.job).until(TIME),
        "results": RESULTS,
        "counters": counters_of(simulation) | {"time": TIME},
        "left": [[3, [0.1, 0.0, 0.4], 17]],
        "ledger": simulation.ledger.state,
    }
    arrays = {name: (np.dtype(dtype).str, shape) for name, (dtype, shape) in FIELDS.items()}
    total = simulation.totals["total"]
    fields = {"arrays": arrays, "total": total, "slabs": [(0, total)], "places": {}, "sums_place": 0}
    return Header(attributes=copy.deepcopy(attributes | changes), **fields)


def check(header, simulation, job, version="1.0"):
    counters = counters_of(simulation)
    check_attributes("checkpoint.h5", header, job.model_dump(mode="json"), version, Inputs(job), counters)


def test_a_later_end_other_output_and_more_probes_may_continue(case, begun):
    header = header_of(begun)
    check(header, begun, begun.job)
    first, second = "{name: P1, kind: pressure, at: [0.0, 0.05]}", "{name: eta, kind: elevation, at: [0.02]}"
    probes = f"probes=[{{name: new, kind: force}}, {second}, {first}]"
    check(header, begun, load_job(case / "job.yaml", ["time.end=12", "output.probes_every=0.5", probes]))


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["spacing=0.01"], r"^spacing: 0\.02 in the checkpoint, 0\.01 in the job; only time\.end and output"),
        (["tank.size=[0.4, 0.32]"], r"^tank\.size\[1\]: 0\.3 in the checkpoint, 0\.32 in the job"),
        (["time.cfl=0.1", "time.end=1"], r"^time\.cfl: 0\.2 in the checkpoint, 0\.1 in the job"),
        (["tank.lid=false"], r"^tank\.lid: True in the checkpoint, False in the job"),
        (["spacing=0.01", "tank.lid=false"], r"also different: tank\.lid"),
        (["probes[1].at=[0.03]"], r"^probes\[1\]\.at\[0\]: 0\.02 in the checkpoint, 0\.03 in the job"),
        (["probes=[]"], r"^probes\[0\]: .*P1.* in the checkpoint, nothing in the job"),
        (["probes[0].name=P2"], r"^probes\[0\]: .*P1.* in the checkpoint, nothing in the job"),
        (["motion[1].omega=3.1"], r"^motion\[1\]\.omega: 3\.0 in the checkpoint, 3\.1 in the job"),
        (["motion=[]"], r"^motion: "),
        (["motion[0]={kind: surge, amplitude: 1, omega: 1}"], r"^motion\[0\]\.kind: file in the checkpoint, surge in"),
        (["time.end=0.05"], r"^time\.end: got 0\.05 s, must be at least 0\.1 s, the time of the checkpoint"),
    ],
)
def test_another_job_is_refused_by_its_difference(case, begun, overrides, message):
    with pytest.raises(InputError, match=message):
        check(header_of(begun), begun, load_job(case / "job.yaml", overrides))


def test_another_version_is_refused(begun):
    with pytest.raises(InputError, match=r"written by parmps 1\.0, this is 1\.1"):
        check(header_of(begun), begun, begun.job, "1.1")


def test_a_record_may_go_on_otherwise_after_the_checkpoint_only(case, begun):
    header, path = header_of(begun), case / "motion.csv"
    write_motion(path, change=TIMES > TIME)
    check(header, begun, begun.job)
    for change in (TIMES == 0.0, np.isclose(TIMES, TIME)):
        write_motion(path, change)
        with pytest.raises(InputError, match=r"^motion\[0\]\.path: .*/motion\.csv: its rows up to t = 0\.1 s"):
            check(header, begun, begun.job)
    path.write_text(path.read_text().replace("surge", "heave"))
    with pytest.raises(InputError, match=r"^motion\[0\]\.path: .*motion\.csv"):
        check(header, begun, begun.job)


def test_a_case_that_was_moved_continues(case, begun, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    shutil.copytree(case, elsewhere / "case")
    job = load_job(elsewhere / "case" / "job.yaml")
    check(header_of(begun), begun, job)
    write_motion(elsewhere / "case" / "motion.csv", change=2)
    with pytest.raises(InputError, match=rf"{elsewhere}/case/motion\.csv \(in the checkpoint {case}/motion\.csv\)"):
        check(header_of(begun), begun, job)


def test_all_files_that_a_job_reads_are_known_by_their_contents(case, begun):
    trimesh = pytest.importorskip("trimesh")
    surface = trimesh.creation.box((0.4, 0.4, 0.3))
    surface.export(case / "tank.stl")
    (case / "state.h5").write_bytes(b"some")
    three = ["dimension=3", "tank={shape: stl, size: [0.4, 0.4, 0.3], surface: tank.stl}", "probes=[]"]
    job = load_job(case / "job.yaml", [*three, "initial={kind: file, path: state.h5}"])
    files = {"tank.surface": "tank.stl", "initial.path": "state.h5", "motion[0].path": "motion.csv"}
    assert job.input_files == {key: str(case / name) for key, name in files.items()}
    header = header_of(begun, job=job.model_dump(mode="json"), inputs=Inputs(job).until(TIME))
    check(header, begun, job)
    for key, name in list(files.items())[:2]:
        before = (case / name).read_bytes()
        (case / name).write_bytes(before + b"\n")
        with pytest.raises(InputError) as refusal:
            check(header, begun, job)
        assert str(refusal.value) == (
            f"{key}: {case / name}: its contents are not those that the run up to the checkpoint read"
        )
        (case / name).write_bytes(before)


ABSURD = {
    "time": {"counters": {"time": np.nan}},
    "past": {"counters": {"time": -1.0}},
    "step": {"counters": {"step_number": 2.5}},
    "steps back": {"counters": {"step_number": -3}},
    "many": {"counters": {"contacts": 10**400}},
    "much": {"counters": {"work_done": 10**400}},
    "text": {"counters": {"work_done": "much"}},
    "truth": {"counters": {"iterations": True}},
    "another": {"counters": {"more": 1}},
    "no counters": {"counters": []},
    "left": {"left": [[1, [0.0, 0.0], 3]]},
    "job": {"job": 5},
    "probes": {"job": {"probes": [5]}},
    "rows": {"results": {**RESULTS, "table": {**RESULTS["table"], "rows": -1}}},
    "frames": {"results": {**RESULTS, "particles": {"frames": 1.5, "last": None}}},
    "no results": {"results": None},
    "inputs": {"inputs": {"motion[0].path": "m.csv"}},
}


@pytest.mark.parametrize("absurd", ABSURD)
def test_a_header_that_no_run_can_have_written_is_refused(begun, absurd):
    changes = dict(ABSURD[absurd])
    if isinstance(changes.get("counters"), dict):
        changes["counters"] = counters_of(begun) | {"time": TIME} | changes["counters"]
    with pytest.raises(OutputError, match=r"^checkpoint\.h5: is damaged: "):
        check(header_of(begun, **changes), begun, begun.job)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("kind", 7), ("kind", 1), ("fluid", 1), ("fluid", -1), ("position", 1e300), ("position", np.nan),
        ("velocity", np.inf), ("pressure", np.nan), ("id", 2**40), ("id", -1), ("id", 5), ("parent", 2**40),
    ],
)  # fmt: skip
def test_particles_that_no_run_can_have_left_are_refused(begun, name, value):
    arrays = {field: values.copy() for field, values in begun.particles.arrays().items()}
    check_particles("checkpoint.h5", arrays, begun.totals, begun.job)
    first = np.argmin(arrays["id"])
    arrays[name][first] = value
    with pytest.raises(OutputError, match=f"is damaged: the {name} of some of its particles cannot be"):
        check_particles("checkpoint.h5", arrays, begun.totals, begun.job)


def test_arrays_of_other_particles_are_refused(begun):
    header = header_of(begun)
    check_arrays("checkpoint.h5", header, begun.totals)
    with pytest.raises(OutputError, match=f"holds {header.total} particles, the job has"):
        check_arrays("checkpoint.h5", header, {**begun.totals, "total": header.total + 1})
    with pytest.raises(OutputError, match="its arrays are not those of a run"):
        check_arrays("checkpoint.h5", header.model_copy(update={"arrays": {}}), begun.totals)
