"""The models of a job: what is accepted, what is refused and with which message, warnings, the schema."""

import copy
import math
import random
from pathlib import Path

import pytest
import yaml
from pydantic import ValidationError

from parmps.cautions import cautions
from parmps.errors import InputError
from parmps.fields import Section, models_in
from parmps.loader import job_text, load_job, parse_job
from parmps.scene import Job
from parmps.schema import json_schema, schema_markdown, schema_rows, schema_table
from parmps.scheme import PRESETS, Scheme

ROOT = Path(__file__).parents[1]
BASE_2D = {
    "dimension": 2,
    "spacing": 0.01,
    "tank": {"size": [0.8, 0.5]},
    "fluids": [{"name": "water", "depth": 0.15}, {"name": "oil", "depth": 0.1, "density": 800.0}],
    "motion": [{"kind": "surge", "amplitude": 0.02, "omega": 6.469}],
    "time": {"end": 1.0},
}
BASE_3D = BASE_2D | {
    "dimension": 3,
    "tank": {
        "size": [0.8, 0.4, 0.5],
        "shape": "prism",
        "chamfer": {"bottom": [0.1, 0.1], "top": [0.1, 0.15]},
    },
}
FULL_2D = {
    "interfaces": [{"between": ["water", "oil"], "surface_tension": 0.05}],
    "initial": {"kind": "standing_wave", "mode": 2, "amplitude": 0.05},
    "tank": {
        "size": [0.8, 0.5],
        "baffles": [
            {"x": 0.4, "bottom": 0.0, "top": 0.15, "thickness": 0.02},
            {"z": 0.3, "left": 0.0, "right": 0.2, "thickness": 0.02},
        ],
    },
    "probes": [
        {"name": "P1", "kind": "pressure", "at": [0.0, 0.05], "radius": 0.02},
        {"name": "eta", "kind": "elevation", "at": [0.01]},
        {"name": "cw", "kind": "interface", "between": ["water", "oil"], "at": [0.01]},
        {"name": "load", "kind": "force"},
    ],
    "scheme": {"preset": "papers", "gamma": 0.02},
}


def build(changes=None, base=BASE_2D):
    return parse_job(yaml.safe_dump(copy.deepcopy(base | (changes or {}))))


def changed(path, value, base):
    """Copy a job's data with one value replaced."""
    data = copy.deepcopy(base)
    place = data
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    return data


def test_defaults():
    job = build()
    assert job.gravity == 9.8
    assert job.tank.lid is True
    assert job.tank.shape == "box"
    assert job.initial.kind == "level"
    assert job.fluids[0].density == 1000.0
    assert job.time.cfl is None
    assert job.courant == job.scheme.courant == 0.4
    assert job.time.max_step is None
    assert job.output.particles_every == 0.1
    assert job.output.probes_every == 0.005
    assert job.output.checkpoint_every == 1.0
    assert job.scheme == Scheme()


@pytest.mark.parametrize("base", [BASE_2D, BASE_2D | FULL_2D, BASE_3D])
def test_a_job_is_rebuilt_from_its_plain_data_and_from_its_text(base):
    job = build(base=base)
    assert Job.model_validate(job.model_dump()) == job
    assert parse_job(job_text(job)) == job


def test_text_that_yaml_would_misread_survives():
    for title in ("1e-6", "060", "090", "yes", "null", "", "1:30", "2020-01-01", "a: b", "é\nx"):
        job = Job.model_validate(BASE_2D | {"title": title})
        assert parse_job(job_text(job)).title == title


def test_exponent_without_point_is_a_number():
    fluids = [{"name": "water", "depth": 0.2, "kinematic_viscosity": "1e-6"}]
    assert Job.model_validate(BASE_2D | {"fluids": fluids}).fluids[0].kinematic_viscosity == 1e-6


def test_jobs_are_immutable():
    with pytest.raises(ValidationError):
        build().spacing = 1.0


@pytest.mark.parametrize(
    ("path", "value", "expected"),
    [
        (["spacing"], -0.004, "spacing: got -0.004, must be greater than 0 (m)"),
        (["spacing"], 0, "spacing: got 0, must be greater than 0 (m)"),
        (["spacing"], "four", "spacing: got 'four', must be a number (m)"),
        (["spacing"], True, "spacing: got True, must be a number (m)"),
        (["spacing"], None, "spacing: got None, must be a number (m)"),
        (["spacing"], [1], "spacing: got [1], must be a number (m)"),
        (["tnak"], 1, "tnak: unknown key; did you mean 'tank'?"),
        (["tank", "szie"], 1, "tank.szie: unknown key; did you mean 'size'?"),
        (["motion", 0, "omga"], 1, "motion[0].omga: unknown key; did you mean 'omega'?"),
        (["@Translation"], 1, "@Translation: unknown key"),
        (["motion", 0, "@Translation"], 1, "motion[0].@Translation: unknown key"),
        (["dimension"], 4, "dimension: got 4, must be 2 or 3"),
        (["tank", "size"], [0.8], "tank.size: got [0.8], must have at least 2 entries (m)"),
        (["tank", "size"], [0.8, 0.4, 0.5], "tank.size: got [0.8, 0.4, 0.5], must be [length, height] in 2D"),
        (["tank", "size", 0], "x", "tank.size[0]: got 'x', must be a number (m)"),
        (["tank", "size", 0], -1, "tank.size[0]: got -1, must be greater than 0 (m)"),
        (["tank", "lid"], "yes", "tank.lid: got 'yes', must be true or false"),
        (["tank", "chamfer"], {"top": [0.1, 0.1]}, "tank.chamfer: a box has none; it belongs to shape: prism"),
        (["tank", "shape"], "prism", "tank.chamfer: missing"),
        (["tank", "shape"], "pyramid", "tank.shape: got 'pyramid', must be 'box'"),
        (["tank"], 3, "tank: got 3, must be a mapping of keys"),
        (["tank", "baffles", 0, "x"], 0.795, "tank.baffles[0].x: the baffle reaches from 0.785 m to 0.805 m"),
        (["tank", "baffles", 0, "top"], 0.6, "tank.baffles[0].top: the baffle reaches from 0 m to 0.6 m"),
        (["tank", "baffles", 0, "top"], 0.0, "the first must be the lower"),
        (["tank", "baffles", 0, "thickness"], 0, "tank.baffles[0].thickness: got 0, must be greater than 0"),
        (["tank", "baffles", 0, "width"], [0, 0.1], "tank.baffles[0].width: a 2D tank has no width"),
        (["tank", "baffles", 0, "z"], 0.1, "tank.baffles[0]: got x, bottom, top, z, must be"),
        (["tank", "baffles", 1, "right"], 0.9, "tank.baffles[1].right: the baffle reaches from 0 m to 0.9 m"),
        (["fluids"], [], "fluids: got [], must have at least 1 entries"),
        (
            ["fluids", 0, "depth"],
            0.45,
            "overfull: depths sum to 0.55 m, must be at most the tank's height 0.5 m",
        ),
        (["fluids", 0, "depth"], None, "fluids[0].depth: each fluid must have exactly one of depth, fill and region"),
        (["fluids", 0, "name"], "oil", "fluids[1].name: 'oil' is taken"),
        (["fluids", 0, "name"], "a,b", "fluids[0].name: got 'a,b', must be 1 to 64 letters"),
        (["fluids", 0, "density"], 1e5, "fluids[0].density: got 100000.0, must be at most 20000 (kg/m3)"),
        (["fluids", 0, "region"], {"box": [[0, 0], [0.1, 0.1]]}, "exactly one of depth, fill and region"),
        (
            ["fluids", 0],
            {"name": "w", "region": {}},
            "fluids[0].region: got none, must be exactly one of box",
        ),
        (
            ["fluids", 0],
            {"name": "w", "region": {"ball": {"centre": [0.2, 0.2], "radius": 0.1}}},
            "fluids[0].region: got ball, must be exactly one of box and disc in 2D",
        ),
        (
            ["fluids", 0],
            {"name": "w", "region": {"disc": {"centre": [0.2, 0.2], "radius": 0.3}}},
            "fluids[0].region.disc.radius: got 0.3 m, must be at most 0.2 m",
        ),
        (
            ["fluids", 0],
            {"name": "w", "region": {"box": [[0, 0], [0.9, 0.1]]}},
            "fluids[0].region.box[1][0]: got 0.9, must be inside the tank: 0 to 0.8 (m)",
        ),
        (["fluids", 0], {"name": "w", "region": {"box": [[0.2, 0], [0.1, 0.1]]}}, "corner must be the lower"),
        (["initial"], "rst", "initial.kind: got 'rst', must be one of level, rest, upright, standing_wave"),
        (
            ["initial"],
            {"kind": "standing_wave", "amplitude": 0.1, "mode": 1.5},
            "initial.mode: got 1.5, must be a whole",
        ),
        (["initial"], {"kind": "velocity", "fluid": "watr", "value": [1, 0]}, "did you mean 'water'?"),
        (
            ["initial"],
            {"kind": "velocity", "fluid": "oil", "value": [1, 0, 0]},
            "initial.value: got [1.0, 0.0, 0.0]",
        ),
        (["initial"], {"kind": "file", "path": "no.h5"}, "initial.path: "),
        (
            ["interfaces", 0, "between"],
            ["water", "air"],
            "interfaces[0].between[1]: got 'air', no such fluid",
        ),
        (["interfaces", 0, "between"], ["oil", "oil"], "must be two different fluids"),
        (
            ["interfaces", 0],
            {"between": ["water", "oil"], "wetting_angle": 60},
            "interfaces[0].wetting_angle: got 60, must be 90 (deg) without surface_tension > 0",
        ),
        (["interfaces", 0, "wetting_angle"], 20, "interfaces[0].wetting_angle: got 20, must be at least 30 (deg)"),
        (
            ["motion", 0],
            {"kind": "yaw", "amplitude_deg": 2, "omega": 3},
            "motion[0].kind: got 'yaw', must be surge, sway, heave, roll, pitch or file in 2D",
        ),
        (
            ["motion", 0],
            {"kind": "surge", "amplitude": 2},
            "motion[0].omega: got neither, must be exactly one of omega (rad/s) and period (s)",
        ),
        (
            ["motion", 0],
            {"kind": "roll", "amplitude_deg": 2, "omega": 3, "period": 2},
            "motion[0].omega: got both, must be exactly one of omega (rad/s) and period (s)",
        ),
        (
            ["motion", 0],
            {"kind": "roll", "amplitude_deg": 2, "period": 0},
            "motion[0].period: got 0, must be at least 0.0001 (s)",
        ),
        (["motion", 0, "kind"], "surg", "motion[0].kind: got 'surg', must be one of surge, sway, heave"),
        (["motion", 0], {"amplitude": 1}, "motion[0].kind: missing"),
        (["motion", 0], "surge", "motion[0]: got 'surge', must be a mapping with a kind"),
        (["motion", 0], {"kind": "yaw", "amplitude_deg": 1, "omega": 1}, "motion[0].kind: got 'yaw'"),
        (
            ["motion", 0],
            {"kind": "roll", "amplitude_deg": 1, "omega": 1, "centre": [0, 0, 0]},
            "motion[0].centre",
        ),
        (["motion", 0], {"kind": "file", "path": "no.csv"}, "motion[0].path: "),
        (["motion", 0, "amplitude"], float("inf"), "motion[0].amplitude: "),
        (["motion"], {"kind": "surge"}, "motion: got {'kind': 'surge'}, must be a list"),
        (["time"], {}, "time.end: missing"),
        (["time", "end"], 0, "time.end: got 0, must be greater than 0 (s)"),
        (["time", "max_step"], 0, "time.max_step: got 0, must be greater than 0 (s)"),
        (["time", "cfl"], 2, "time.cfl: got 2, must be at most 1"),
        (["scheme"], "balancd", "scheme.preset: got 'balancd', no such preset; did you mean 'balanced'?"),
        (["scheme"], {"gama": 0.1}, "scheme.gama: unknown key; did you mean 'gamma'?"),
        (["scheme"], {"radius": 9}, "scheme.radius: got 9, must be at most 5 (l0)"),
        (["scheme"], 3, "scheme: got 3, must be a preset name or a mapping"),
        (["probes", 0, "at"], [0.0, 0.6], "probes[0].at[1]: got 0.6, must be inside the tank: 0 to 0.5 (m)"),
        (["probes", 0, "at"], [0.4, 0.1], "probes[0].at: got [0.4, 0.1] m, which lies inside tank.baffles[0]"),
        (["probes", 0, "at"], [0.0, 0.1, 0.1], "probes[0].at: got [0.0, 0.1, 0.1], must be [x, z] in 2D (m)"),
        (["probes", 1, "at"], [0.0, 0.1], "probes[1].at: got [0.0, 0.1], must be [x] in 2D (m)"),
        (["probes", 1, "name"], "P1", "probes[1].name: 'P1' is taken"),
        (["probes", 2, "between"], ["water", "ol"], "probes[2].between[1]: got 'ol', no such fluid"),
        (["probes", 3, "kind"], "forse", "probes[3].kind: got 'forse', must be one of pressure, elevation"),
        (["output"], {"probes_every": 0}, "output.probes_every: got 0, must be greater than 0 (s)"),
        (["output"], {"directory": "a\nb"}, "output.directory: got "),
        (["output"], {"directory": ""}, "output.directory: got '', must not be empty"),
    ],
)
def test_refusals(path, value, expected):
    with pytest.raises(InputError) as refusal:
        build(base=changed(path, value, BASE_2D | FULL_2D))
    assert expected in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("path", "value", "expected"),
    [
        (["tank", "chamfer", "top"], [0.3, 0.1], "tank.chamfer.top[0]: got 0.3 m, must be at most half"),
        (["tank", "chamfer", "top"], [0.1, 0.45], "tank.chamfer: the chamfers' heights sum to 0.55 m"),
        (
            ["probes"],
            [{"name": "P", "kind": "pressure", "at": [0.1, 0.01, 0.01]}],
            "outside the tank's prism",
        ),
        (["probes"], [{"name": "e", "kind": "elevation", "at": [0.1]}], "must be [x, y] in 3D"),
        (
            ["tank", "baffles"],
            [{"x": 0.4, "bottom": 0, "top": 0.1, "thickness": 0.02, "width": [0.1, 0.5]}],
            "tank.baffles[0].width: the baffle reaches from 0.1 m to 0.5 m, outside the tank's 0 m to 0.4 m",
        ),
    ],
)
def test_refusals_3d(path, value, expected):
    with pytest.raises(InputError) as refusal:
        build(base=changed(path, value, BASE_3D))
    assert expected in str(refusal.value)


PLATE = {"x": 0.4, "bottom": 0, "top": 0.2, "thickness": 0.02}


@pytest.mark.parametrize(
    ("baffle", "at", "refused"),
    [
        (PLATE, [0.4, 0.2, 0.1], True),
        (PLATE, [0.41, 0.2, 0.1], False),
        (PLATE, [0.4, 0.2, 0.2], False),
        (PLATE | {"width": [0.1, 0.2]}, [0.4, 0.25, 0.1], False),
        (PLATE | {"openings": [[[0.1, 0.05], [0.3, 0.15]]]}, [0.4, 0.2, 0.1], False),
        ({"x": 0.4, "ring": 0.1, "thickness": 0.02}, [0.4, 0.2, 0.05], True),
        ({"x": 0.4, "ring": 0.1, "thickness": 0.02}, [0.4, 0.2, 0.2], False),
        ({"z": 0.2, "left": 0.0, "right": 0.3, "thickness": 0.02}, [0.0, 0.2, 0.2], True),
        ({"z": 0.2, "left": 0.0, "right": 0.3, "thickness": 0.02}, [0.4, 0.2, 0.2], False),
    ],
)
def test_a_pressure_probe_is_on_a_face_of_a_baffle_or_outside(baffle, at, refused):
    job = BASE_3D | {"probes": [{"name": "P", "kind": "pressure", "at": at}]}
    job = changed(["tank", "baffles"], [baffle], job)
    if refused:
        with pytest.raises(InputError, match="inside tank.baffles"):
            build(base=job)
    else:
        build(base=job)


BULKHEAD = PLATE | {"top": 0.5}


@pytest.mark.parametrize("kind", ["elevation", "interface"])
@pytest.mark.parametrize(
    ("tank", "at", "refused"),
    [
        ({"baffles": [BULKHEAD]}, [0.4, 0.2], "lies inside tank.baffles[0] from the tank's floor to its lid"),
        ({"baffles": [BULKHEAD]}, [0.41, 0.2], None),
        ({"baffles": [PLATE]}, [0.4, 0.2], None),
        ({"baffles": [PLATE, PLATE | {"bottom": 0.2, "top": 0.5}]}, [0.4, 0.2], "[0], tank.baffles[1] from the"),
        ({"baffles": [PLATE, PLATE | {"bottom": 0.3, "top": 0.5}]}, [0.4, 0.2], None),
        ({"baffles": [BULKHEAD | {"width": [0.0, 0.1]}]}, [0.4, 0.2], None),
        ({"baffles": [BULKHEAD | {"openings": [[[0.1, 0.05], [0.3, 0.15]]]}]}, [0.4, 0.2], None),
        ({"baffles": [{"x": 0.4, "ring": 0.1, "thickness": 0.02}]}, [0.4, 0.05], "tank.baffles[0] from"),
        ({"baffles": [{"x": 0.4, "ring": 0.1, "thickness": 0.02}]}, [0.4, 0.2], None),
        ({"shape": "sphere", "size": [0.5] * 3}, [0.05, 0.05], "where the tank's sphere is 0 m high"),
        ({"shape": "sphere", "size": [0.5] * 3}, [0.25, 0.05], None),
        ({"shape": "cylinder", "size": [0.8, 0.5, 0.5]}, [0.4, 0.0], "where the tank's cylinder is 0 m high"),
    ],
)
def test_a_gauge_has_room_for_liquid(kind, tank, at, refused):
    probe = {"name": "e", "kind": kind, "at": at} | ({"between": ["water", "oil"]} if kind == "interface" else {})
    fluids = [{"name": "water", "depth": 0.1}, {"name": "oil", "depth": 0.1}]
    base = {"size": [0.8, 0.4, 0.5], "shape": "box"} | tank
    job = BASE_3D | {"tank": base, "fluids": fluids, "probes": [probe]}
    if refused is None:
        build(base=job)
        return
    with pytest.raises(InputError) as refusal:
        build(base=job)
    assert refused in str(refusal.value) and str(refusal.value).startswith("probes[0].at: ")
    if "baffles" in tank:
        probe["fixed_to"] = "earth"  # the tank moves on
        build(base=job)


def test_names_of_loads_are_unique():
    baffles = [PLATE, PLATE | {"x": 0.6, "name": "baffle1"}]
    with pytest.raises(InputError, match=r"tank.baffles\[1\].name: 'baffle1' is taken"):
        build(base=changed(["tank", "baffles"], baffles, BASE_3D))
    with pytest.raises(InputError, match=r"tank.baffles\[0\].name: 'tank' is taken"):
        build(base=changed(["tank", "baffles"], [PLATE | {"name": "tank"}], BASE_3D))
    probes = [{"name": name, "kind": "pressure", "at": [0.0, 0.2, 0.2]} for name in ("P", "P.max")]
    with pytest.raises(InputError, match="'P.max' is taken"):
        build(base=BASE_3D | {"probes": probes})
    with pytest.raises(InputError, match=r"probes\[0\].about: got \[0.1, 0.2\], must be \[x, y, z\] in 3D"):
        build(base=BASE_3D | {"probes": [{"name": "load", "kind": "force", "about": [0.1, 0.2]}]})


def test_motion_file_must_cover_the_run_and_stay_in_plane(tmp_path):
    path = tmp_path / "motion.csv"
    path.write_text("time [s],surge [m],sway [m]\n0,0,0\n1,1,0\n2,0,0\n3,1,0\n")
    motion = {"motion": [{"kind": "file", "path": str(path)}]}
    build(motion | {"time": {"end": 3.0}})
    with pytest.raises(
        InputError, match=r"time.end: got 3.1 s, must be at most 3 s, where .*motion.csv ends"
    ):
        build(motion | {"time": {"end": 3.1}})
    path.write_text(path.read_text() + "4,0,0.1\n")
    with pytest.raises(InputError, match="one of the columns surge and sway must be absent or zero in 2D"):
        build(motion)
    path.write_text("time [s],sway [m],roll [deg]\n0,0,0\n1,1,0\n2,0,3\n3,1,0\n")
    build(motion)
    path.write_text("time [s],yaw [deg]\n0,0\n1,1\n")
    with pytest.raises(InputError, match="column yaw must be absent or zero in 2D"):
        build(motion)
    row = "({} (({} {} 0) ({} {} 0)))\n"
    for columns, match in (((0.1, 0, 2, 0), "surge and roll"), ((0, 0.1, 0, 2), "sway and pitch")):
        path.write_text("(" + "".join(row.format(t, *columns) for t in range(4)) + ")")
        with pytest.raises(InputError, match=f"one of the columns {match} must be absent"):
            build(motion)


def test_start_must_be_within_the_record_and_the_record_within_the_run(tmp_path):
    path = tmp_path / "motion.csv"
    rows = [(k / 10, 0.1 * math.sin(k / 4)) for k in range(21)]
    path.write_text("time [s],surge [m]\n" + "".join(f"{12.5 + time:.1f},{value:.4f}\n" for time, value in rows))

    def job(**keys):
        return build({"motion": [{"kind": "file", "path": str(path), **keys}], "time": {"end": 2.0}})

    with pytest.raises(InputError, match=r"motion\[0\].start: missing; .* begins at 12.5 s, after .* start: 12.5"):
        job()
    job(start=12.5)
    for start in (0.0, 12.4, 14.5):
        with pytest.raises(InputError, match=r"motion\[0\].start: got .* from 12.5 s to before 14.5 s"):
            job(start=start)
    with pytest.raises(InputError, match=r"time.end: got 2 s, must be at most 1.9 s, where .* ends"):
        job(start=12.6)
    path.write_text("time [s],surge [m]\n" + "".join(f"{1.5 + time:.1f},{value:.4f}\n" for time, value in rows))
    (warning,) = cautions(job())
    assert warning.startswith("motion[0].path: the record begins at 1.5 s, and the tank rests until then; start: 1.5")


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        ({"kind": "roll", "amplitude_deg": 4, "omega": 270}, ["[0].omega: 270 rad/s", " g at most", "omega: 4.712"]),
        ({"kind": "roll", "amplitude_deg": 4, "period": 0.023}, ["motion[0].period: 0.023 s", " g at most"]),
        ({"kind": "surge", "amplitude": 0.02, "omega": 60}, ["[0].omega: 60 rad/s accelerates the tank by 7.34 g"]),
        ({"kind": "roll", "amplitude_deg": 0.07, "omega": 4.5}, ["motion[0].amplitude_deg: 0.07 deg", "4.01 deg"]),
        ({"kind": "surge", "amplitude": 20, "omega": 0.5}, ["[0].amplitude: 20 m is more than the tank's longest"]),
    ],
)
def test_motions_that_look_wrong(law, expected):
    found = " ".join(cautions(build({"motion": [law]})))
    for part in expected:
        assert part in found


@pytest.mark.parametrize(
    ("header", "rows", "expected"),
    [
        ("surge [m]", [(0, 0), (1, 0), (1.2, 0.05), (5, 0.05), (60, 0.05)], ["swing to a surge of -29.5 m at 39.4 s"]),
        ("roll [deg]", [(k / 20, 0.07 * math.sin(k / 4)) for k in range(80)], ["[0].path: a roll of 0.07", "4.01"]),
        ("surge [m]", [(k / 20, 20 * math.sin(k / 4)) for k in range(80)], ["a surge of 20 m is more", " g at most"]),
        (
            "surge [m]",
            [(k / 50, 0.01 * math.sin(k / 9) + 1e-3 * random.Random(k).gauss(0, 1)) for k in range(200)],
            ["its surge scatters by 0.00099 m from row to row", " g at most"],
        ),
    ],
)
def test_records_that_look_wrong(tmp_path, header, rows, expected):
    path = tmp_path / "motion.csv"
    path.write_text(f"time [s],{header}\n" + "".join(f"{time},{value}\n" for time, value in rows))
    found = " ".join(cautions(build({"motion": [{"kind": "file", "path": str(path)}], "time": {"end": 2.0}})))
    for part in expected:
        assert part in found


JOBS = sorted(path for path in (ROOT / "jobs").rglob("*.yaml") if "sweeps" not in path.parts)


@pytest.mark.parametrize("path", JOBS, ids=lambda path: str(path.relative_to(ROOT / "jobs")))
def test_motions_of_the_jobs_here_look_right(path):
    assert [warning for warning in cautions(load_job(path)) if warning.startswith("motion")] == []


@pytest.mark.parametrize(
    ("path", "value", "expected"),
    [
        (["spacing"], 1.0, ["1 m is larger than the tank's side of 0.8 m", "0.1 rows"]),
        (["spacing"], 0.05, ["fluids[0].depth: 0.15 m at a spacing of 0.05 m is 3.0 rows"]),
        (["spacing"], 1e-6, ["2e+11 particles"]),
        (
            ["motion", 0, "omega"],
            0.85,
            ["motion[0].omega: 0.85 rad/s", "0.857 Hz", "5.39 rad/s", "omega: 5.3407"],
        ),
        (["motion", 0, "amplitude"], 2.0, ["motion[0].amplitude: 2 m is more than"]),
        (["fluids", 1, "density"], 0.8, ["fluids[1].density: 0.8 kg/m3", "g/cm3"]),
        (["fluids", 1, "kinematic_viscosity"], 1.0, ["fluids[1].kinematic_viscosity: 1 m2/s"]),
        (["output"], {"particles_every": 5.0}, ["output.particles_every: 5 s is longer than the run of 1 s"]),
        (
            ["tank", "baffles"],
            [{"x": 0.4, "bottom": 0, "top": 0.1, "thickness": 0.006}],
            ["tank.baffles[0].thickness: 0.006 m is less than the spacing of 0.01 m"],
        ),
        (
            ["probes"],
            [{"name": "P", "kind": "pressure", "at": [0.0, 0.1], "radius": 0.006}],
            ["probes[0].radius: 0.006 m is less than the spacing of 0.01 m"],
        ),
    ],
)
def test_warnings(path, value, expected):
    warnings = " ".join(cautions(build(base=changed(path, value, BASE_2D))))
    for part in expected:
        assert part in warnings


def test_sensible_jobs_give_no_warning():
    for base in (BASE_2D, BASE_2D | FULL_2D, BASE_3D):
        assert cautions(build(base=base)) == []


def test_presets():
    def scheme_of(value):
        return build({"scheme": value}).scheme

    for name, changes in PRESETS.items():
        assert scheme_of(name) == Scheme(preset=name, **changes)
    assert scheme_of({"preset": "papers", "gradient": "min"}).gradient == "min"
    assert scheme_of({"preset": "papers", "gradient": "min"}).wall == "line"
    scheme = scheme_of("papers")
    assert scheme_of(scheme.model_dump()) == scheme
    with pytest.raises(InputError, match="scheme.ksp_rtoll: unknown key; did you mean 'ksp_rtol'"):
        scheme_of({"ksp_rtoll": 1e-3})


def all_sections(model):
    yield model
    for field in model.model_fields.values():
        for inner in models_in(field.annotation):
            yield from all_sections(inner)


def test_every_key_has_a_meaning_and_appears_in_the_schema():
    table = schema_table()
    assert len(schema_rows()) > 80
    for section in all_sections(Job):
        assert issubclass(section, Section)
        for name, field in section.model_fields.items():
            assert field.description, name
            assert field.description.split()[0] in table
    assert "phase_deg: number >= -360 and <= 360 (deg), default 0.0" in table
    assert "spacing: number > 0 and <= 1000 (m), required" in table
    assert "fluids[].depth: number > 0 and <= 10000 or null (m), default null" in table


def test_json_schema_knows_units_and_bounds():
    schema = json_schema()
    spacing = schema["properties"]["spacing"]
    assert spacing["unit"] == "m"
    assert spacing["exclusiveMinimum"] == 0
    assert schema["additionalProperties"] is False
    assert any("papers" in option.get("enum", []) for option in schema["properties"]["scheme"]["anyOf"])


def test_the_table_in_the_readme_is_that_of_the_schema():
    """To renew it: python -m parmps schema --markdown."""
    readme = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    assert schema_markdown() in readme
