"""State files that others may have written: refused before they take time, memory, or what is not theirs."""

import multiprocessing
import os
import resource
import time
import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest

from parmps.errors import InputError
from parmps.loader import parse_job
from parmps.tank import initial_velocity, place

X, Z = (grid.ravel() for grid in np.meshgrid(0.02 * (np.arange(20) + 0.5), 0.02 * (np.arange(7) + 0.5)))
POSITION = np.stack([X, Z], axis=1)
COUNT = len(POSITION)
MEGABYTES = 2**20


def placed(path, size="[0.4, 0.3]"):
    job = parse_job(
        f"{{dimension: 2, spacing: 0.02, tank: {{size: {size}}}, fluids: [{{name: a, depth: 0.1}}, {{name: b, "
        f"depth: 0.04}}], initial: {{kind: file, path: '{path}'}}, time: {{end: 1}}}}"
    )
    particles = place(job, "half")
    return particles, initial_velocity(job, particles)


@pytest.fixture
def state(tmp_path):
    """Write a state file in which some arrays are others, or left out."""

    def write(**changes):
        arrays = {"position": POSITION, "velocity": 0.1 * POSITION, "fluid": np.arange(COUNT) % 2, **changes}
        with h5py.File(tmp_path / "state.h5", "w") as file:
            for name, values in arrays.items():
                if callable(values):
                    values(file)
                elif values is not None:
                    file[name] = values
        return tmp_path / "state.h5"

    return write


PACKED = {"compression": "gzip", "shuffle": True, "fletcher32": True}


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"fluid": np.arange(COUNT) % 2.0},
        {"fluid": np.arange(COUNT) % 2 > 0},
        {"position": lambda file: file.create_dataset("position", data=POSITION, **PACKED)},
        {"position": lambda file: file.create_dataset("position", data=POSITION, maxshape=(None, 2))},
        {"position": POSITION.astype("f4")},
    ],
)
def test_what_a_state_file_may_be(state, changes):
    particles, velocity = placed(state(**changes))
    np.testing.assert_allclose(particles.position[:COUNT, ::2], POSITION, atol=1e-8)
    np.testing.assert_array_equal(particles.fluid[:COUNT], np.arange(COUNT) % 2)
    np.testing.assert_array_equal(velocity[:COUNT, ::2], 0.1 * POSITION)


def virtual(file):
    layout = h5py.VirtualLayout((COUNT, 2), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "velocity", (COUNT, 2))
    file.create_virtual_dataset("velocity", layout)


def external(file):
    file.create_dataset("velocity", (COUNT, 2), "f8", external=[("/etc/passwd", 0, 16 * COUNT)])


def unpacking(file, size=2**21):
    """A chunk that says 2 kB and unpacks to more, where it could as well be terabytes."""
    data = file.create_dataset("velocity", (COUNT, 2), "f8", chunks=(COUNT, 2), maxshape=(None, 2), compression="gzip")
    data.id.write_direct_chunk((0, 0), zlib.compress(bytes(size)))


def frames(file, **attributes):
    steps = file.create_group("VTKHDF/Steps")
    steps.attrs.update({"NSteps": 1, **attributes})
    steps["PointOffsets"] = np.array([-5])
    file["VTKHDF/NumberOfPoints"] = np.array([100])
    for name, shape in {"Points": (100, 3), "PointData/velocity": (100, 3)}.items():
        file[f"VTKHDF/{name}"] = np.zeros(shape)
    for name in ("fluid", "type"):
        file[f"VTKHDF/PointData/{name}"] = np.zeros(100, np.int8)


def many(file, name="velocity", **how):
    file.create_dataset(name, (10**12, 3), "f8", chunks=(1000, 3), **how)


def references(file):
    file.create_dataset("fluid", (COUNT,), h5py.ref_dtype)


def huge_chunk(file):
    file.create_dataset("velocity", (COUNT, 2), "f8", chunks=(10**8, 2), maxshape=(None, 2))


HOSTILE = {
    "10^12 particles": ({"position": lambda f: many(f, "position"), "velocity": many}, "has 1000000000000 particles"),
    "10^12 velocities": ({"velocity": many}, r"'velocity' has the shape \(1000000000000, 3\)"),
    "10^12 packed": ({"position": lambda f: many(f, "position", compression="gzip")}, "has 1000000000000 particles"),
    "text": ({"fluid": np.array([b"water"] * COUNT)}, "'fluid' holds text, must be whole numbers"),
    "texts": ({"fluid": ["water"] * COUNT}, "'fluid' holds text"),
    "references": ({"fluid": references}, "'fluid' holds references"),
    "complex": ({"velocity": 1j * POSITION}, "'velocity' holds .*, must be numbers"),
    "records": ({"velocity": np.zeros(COUNT, [("x", "f8")])}, "'velocity' holds records"),
    "external storage": ({"velocity": external}, "'velocity' has its data in other files"),
    "virtual": ({"velocity": virtual}, "'velocity' has its data in other files"),
    "soft link": ({"velocity": h5py.SoftLink("/position")}, "'velocity' is a link"),
    "link to itself": ({"velocity": h5py.SoftLink("/velocity")}, "'velocity' is a link"),
    "external link": ({"velocity": h5py.ExternalLink("other.h5", "/velocity")}, "'velocity' is a link"),
    "missing": ({"velocity": None}, "has no 'velocity'"),
    "group": ({"velocity": lambda f: f.create_group("velocity")}, "'velocity' is not an array"),
    "nothing": ({"velocity": h5py.Empty("f8")}, "'velocity' is not an array"),
    "one number": ({"position": 1.0}, "'position' has the shape"),
    "one column": ({"position": POSITION[:, :1]}, "'position' has the shape"),
    "long bomb": ({"velocity": lambda f: unpacking(f, 2**24)}, "'/velocity' unpacks to more than it says"),
    "bomb": ({"velocity": unpacking}, "'/velocity' unpacks to more than it says"),
    "chunk": ({"velocity": huge_chunk}, "'/velocity' is stored in chunks of 200000000 entries"),
    "coincident": ({name: np.full((20000, 2), 0.1) for name in ("position", "velocity")} | {"fluid": None}, "coincide"),
    "far": ({"position": 1e300 * POSITION}, "outside the tank"),
    "half a liquid": ({"fluid": np.full(COUNT, 0.5)}, "numbers of fluids must be 0 to 1"),
    "no liquid": ({"fluid": np.full(COUNT, np.nan)}, "numbers of fluids must be 0 to 1"),
    "frame before the file": ({"VTKHDF": frames}, "frames are not where it says"),
    "10^9 frames": ({"VTKHDF": lambda f: frames(f, NSteps=10**9)}, "frames are not where it says"),
    "frames in words": ({"VTKHDF": lambda f: frames(f, NSteps="many")}, "not a state file"),
    "group elsewhere": ({"VTKHDF": h5py.SoftLink("/")}, "'VTKHDF' is a link"),
}


def refused(path, message):
    limit = 500 * MEGABYTES  # more than this process has now
    has = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    resource.setrlimit(resource.RLIMIT_AS, (has + limit, has + limit))
    start = time.process_time()
    with pytest.raises(InputError, match=rf"^initial\.path: .*{message}"):
        placed(path, size="[8.0, 3.0]")
    assert time.process_time() - start < 1.0


@pytest.mark.parametrize("case", HOSTILE)
def test_a_hostile_state_file_is_refused_at_once(state, case):
    changes, message = HOSTILE[case]
    child = multiprocessing.get_context("fork").Process(target=refused, args=(state(**changes), message))
    child.start()
    child.join(20)
    assert child.exitcode == 0
