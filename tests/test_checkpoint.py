"""Checkpoints: bit for bit, never half there, never silently wrong, never of another run."""

import json
import multiprocessing
import os
import random
import signal
import subprocess
import sys
import time
import zlib

import h5py
import numpy as np
import pytest

from parmps import checkpoint
from parmps.errors import InputError, OutputError

SLABS = [(0, 400), (400, 400), (400, 1000)]
ARRAYS = {"position": ("<f8", (3,)), "id": ("<i8", ()), "wet": ("|b1", ())}


def state(seed, total=1000):
    draw = np.random.default_rng(seed)
    return {
        "position": draw.standard_normal((total, 3)),
        "id": draw.integers(0, 2**62, total),
        "wet": draw.random(total) < 0.5,
    }


def write(path, seed, slabs=SLABS):
    everything = state(seed)
    attributes = {"seed": seed, "time": 0.1 + 0.2, "version": "0.1.0"}
    checkpoint.create(path, ARRAYS, 1000, slabs, attributes)
    for index, rows in enumerate(slabs):
        checkpoint.write_slab(path, index, {name: array[slice(*rows)] for name, array in everything.items()})
    checkpoint.commit(path)


def check(path):
    """Check a checkpoint in full; return the seed that it was written with."""
    header = checkpoint.read_header(path)
    found = checkpoint.read_slabs(path, range(len(header.slabs)))
    expected = state(header.attributes["seed"])
    assert found.keys() == expected.keys()
    for name, array in expected.items():
        assert found[name].dtype == array.dtype
        assert found[name].tobytes() == array.tobytes()
    return header.attributes["seed"]


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "checkpoint.h5"
    write(path, 1)
    return path


def test_everything_comes_back_bit_for_bit(path):
    assert check(path) == 1
    header = checkpoint.read_header(path)
    assert (header.total, header.slabs) == (1000, SLABS)
    assert header.attributes["time"] == 0.1 + 0.2
    assert np.array_equal(checkpoint.read_slabs(path, [2])["id"], state(1)["id"][400:])
    assert checkpoint.read_slabs(path, [])["position"].shape == (0, 3)
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]


@pytest.mark.parametrize("ranks", [1, 2, 3, 4, 7])
def test_slabs_are_shared_out_once_in_order(ranks):
    shares = [checkpoint.share_slabs(3, ranks, rank) for rank in range(ranks)]
    assert [slab for share in shares for slab in share] == [0, 1, 2]


def test_it_is_an_hdf5_file(path):
    with h5py.File(path, "r") as file:
        for name, array in state(1).items():
            assert np.array_equal(file["arrays"][name][()], array)
        assert json.loads(file["header"][()].tobytes())["attributes"]["seed"] == 1


def test_a_new_checkpoint_replaces_the_present_one_only_when_committed(path):
    everything = state(2)
    checkpoint.create(path, ARRAYS, 1000, [(0, 1000)], {"seed": 2})
    assert check(path) == 1
    checkpoint.write_slab(path, 0, everything)
    assert check(path) == 1
    checkpoint.commit(path)
    assert check(path) == 2


def test_a_slab_that_was_never_written_is_noticed(path):
    checkpoint.create(path, ARRAYS, 1000, [(0, 1000)], {"seed": 2})
    checkpoint.commit(path)
    with pytest.raises(OutputError, match="position of slab 0 fails its checksum"):
        checkpoint.read_slabs(path, [0])


@pytest.mark.parametrize("name", ["position", "id", "wet"])
def test_an_altered_array_is_named(path, name):
    with h5py.File(path, "r") as file:
        offset = file["arrays"][name].id.get_offset()
        row = file["arrays"][name].dtype.itemsize * file["arrays"][name][0].size
    with open(path, "r+b") as file:
        file.seek(offset + 700 * row)
        byte = file.read(1)[0]
        file.seek(-1, os.SEEK_CUR)
        file.write(bytes([byte ^ 1]))
    assert len(checkpoint.read_slabs(path, [0, 1])[name]) == 400
    with pytest.raises(OutputError, match=f"{name} of slab 2 fails its checksum"):
        checkpoint.read_slabs(path, [2])


def test_an_altered_header_is_named(path):
    data = path.read_bytes()
    assert data.count(b'"version": "0.1.0"') == 1
    path.write_bytes(data.replace(b'"version": "0.1.0"', b'"version": "0.1.1"'))
    with pytest.raises(OutputError, match="the header fails its checksum"):
        checkpoint.read_header(path)


def test_a_truncated_or_foreign_or_missing_file_is_refused(path):
    data = path.read_bytes()
    for size in (0, 100, 2000, 6000, len(data) // 2):
        path.write_bytes(data[:size])
        with pytest.raises(OutputError, match=r"checkpoint\.h5"):
            checkpoint.read_slabs(path, [0])
    path.unlink()
    with h5py.File(path, "w"), pytest.raises(OutputError, match="is damaged"):
        checkpoint.read_header(path)
    path.unlink()
    with pytest.raises(OutputError, match=r"checkpoint\.h5: No such file"):
        checkpoint.read_header(path)


NOW = checkpoint.FORMAT_VERSION


def rewrite(path, change):
    """Change the header of a checkpoint, in its place, and give it the right checksum."""
    data = path.read_bytes()
    _, _, _, place, size, _ = data[:512].split()[:6]
    place, size = int(place), int(size)
    header = json.loads(data[place : place + size])
    change(header)
    text = json.dumps(header).encode()
    line = b"parmps checkpoint %d %d %d %d\n" % (checkpoint.FORMAT_VERSION, len(data), len(text), zlib.crc32(text))
    path.write_bytes(line + data[len(line) :] + text)


ABSURD = {
    "no header": lambda header: header.clear(),
    "another field": lambda header: header.update(more=1),
    "text": lambda header: header.update(total="many"),
    "rows beyond the file": lambda header: header.update(total=10**12, slabs=[[0, 10**12]]),
    "slabs that overlap": lambda header: header.update(slabs=[[0, 600], [400, 1000]]),
    "a slab that ends before it begins": lambda header: header.update(slabs=[[0, 2000], [2000, 1000]]),
    "objects": lambda header: header["arrays"].update(id=["|O", []]),
    "text in an array": lambda header: header["arrays"].update(id=["<U9", []]),
    "a wide array": lambda header: header["arrays"].update(position=["<f8", [3, 10**9]]),
    "a place before the file": lambda header: header["places"].update(id=-8),
    "a place beyond it": lambda header: header["places"].update(id=2**70),
    "no place": lambda header: header["places"].pop("id"),
    "checksums beyond it": lambda header: header.update(sums_place=2**62),
}


@pytest.mark.parametrize("case", ABSURD)
def test_a_header_of_absurd_contents_is_refused(path, case):
    rewrite(path, ABSURD[case])
    with pytest.raises(OutputError, match=r"checkpoint\.h5: is damaged: the header"):
        checkpoint.read_slabs(path, [0])


@pytest.mark.parametrize("line", ["9" * 300, f"{NOW} {2**70} 9 9", f"{NOW} 0 {2**70} 9", f"{NOW} -1 5 5"])
def test_a_first_line_of_absurd_contents_is_refused(path, line):
    path.write_bytes(f"parmps checkpoint {line}\n".encode().ljust(512, b" ") + path.read_bytes()[512:])
    with pytest.raises(OutputError, match="is damaged"):
        checkpoint.read_header(path)


def test_what_is_no_file_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.h5")
    (tmp_path / "directory.h5").mkdir()
    (tmp_path / "device.h5").symlink_to("/dev/zero")
    for path in tmp_path.iterdir():
        with pytest.raises(OutputError, match="is not a regular file"):
            checkpoint.read_header(path)


READ_FLIPPED = """
import sys
from pathlib import Path
import numpy as np
from parmps import checkpoint
from parmps.errors import ParmpsError
source, copy = Path(sys.argv[1]), Path(sys.argv[2])
data = source.read_bytes()
whole = checkpoint.read_slabs(source, [0, 1, 2])
header = checkpoint.read_header(source)
for place in range(5, len(data), 61):
    copy.write_bytes(data[:place] + bytes([data[place] ^ 0x41]) + data[place + 1 :])
    try:
        found = checkpoint.read_slabs(copy, [0, 1, 2])
        same = all(found[name].tobytes() == whole[name].tobytes() for name in whole)
        assert same and checkpoint.read_header(copy) == header, place
    except ParmpsError:
        pass
"""


def test_any_altered_byte_is_harmless_or_refused(tmp_path, path):
    # In a process of its own, which a crash would end.
    command = [sys.executable, "-c", READ_FLIPPED, path, tmp_path / "copy.h5"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


def write_one(path, barrier, index):
    for seed in range(10, 15):
        if index == 0:
            attributes = {"seed": seed}
            checkpoint.create(path, ARRAYS, 1000, SLABS, attributes)
        barrier.wait(20)
        rows = slice(*SLABS[index])
        checkpoint.write_slab(path, index, {name: array[rows] for name, array in state(seed).items()})
        barrier.wait(20)
        if index == 0:
            checkpoint.commit(path)
        barrier.wait(20)


def test_processes_write_their_slabs_side_by_side(path):
    context = multiprocessing.get_context("fork")
    barrier = context.Barrier(3)
    workers = [context.Process(target=write_one, args=(path, barrier, index)) for index in range(3)]
    for worker in workers:
        worker.start()
    while any(worker.is_alive() for worker in workers):
        checkpoint.read_slabs(path, range(3))
    assert [worker.exitcode for worker in workers] == [0, 0, 0]
    assert check(path) == 14


def write_forever(path):
    for seed in range(100, 1000):
        write(path, seed)


def test_a_kill_at_any_moment_leaves_a_whole_checkpoint(path):
    draw = random.Random(2)
    for _ in range(12):
        worker = multiprocessing.get_context("fork").Process(target=write_forever, args=(path,))
        worker.start()
        time.sleep(draw.uniform(0.005, 0.08))
        os.kill(worker.pid, signal.SIGKILL)
        worker.join()
        check(path)
    write(path, 5)
    assert check(path) == 5


def test_what_cannot_be_written_is_an_output_error(tmp_path, path):
    with pytest.raises(OutputError, match="missing"):
        write(tmp_path / "missing" / "checkpoint.h5", 1)
    (tmp_path / "way.h5").mkdir()
    with pytest.raises(OutputError, match="way.h5"):
        write(tmp_path / "way.h5", 1)
    with pytest.raises(ValueError, match="do not cover"):
        checkpoint.create(path, ARRAYS, 1000, [(0, 400), (500, 1000)], {})
    checkpoint.create(path, ARRAYS, 1000, SLABS, {})
    with pytest.raises(ValueError, match="position"):
        checkpoint.write_slab(path, 0, state(1))


def test_another_format_is_refused(path):
    title = b"parmps checkpoint %d "
    path.write_bytes(path.read_bytes().replace(title % checkpoint.FORMAT_VERSION, title % 99, 1))
    with pytest.raises(InputError, match=f"format 99, this parmps reads format {checkpoint.FORMAT_VERSION}"):
        checkpoint.read_header(path)
